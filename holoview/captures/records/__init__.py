"""Whether the records of captures are right: patterns, pictures and settings that belong together, the right way up.

corrections     which records can be wrong, how each is put right, and which corrections are tried
trials          how well captures are predicted under a hypothesis: the correlation of speckle, also by chance
record_errors   from captures to findings, in words and as JSON; powers of other captures
"""

from holoview.captures.records.corrections import Correction, plausible_units
from holoview.captures.records.record_errors import RecordFindings, find_record_errors

__all__ = ["Correction", "RecordFindings", "find_record_errors", "plausible_units"]
