"""Whether the records of captures are right: patterns, pictures and settings that belong together, the right way up.

corrections     the records that can be wrong, their corrections, and the corrections that are tried
light           how much light each capture holds, beside what is predicted
trials          how well captures are predicted under a hypothesis: the correlation of speckle, also by chance
record_errors   from captures to findings, in words and as JSON; powers of other captures
"""

from holoview.bench.captures.records.corrections import Correction, plausible_units
from holoview.bench.captures.records.record_errors import RecordFindings, find_record_errors

__all__ = ["Correction", "RecordFindings", "find_record_errors", "plausible_units"]
