"""Whether the records of a session are right: patterns, pictures and settings that belong together, the right way up.

correction      what a correction is; corrections compose
orientation     patterns or pictures mirrored or turned
pattern_levels  patterns of the other modulator, inverted levels
capture_order   patterns out of step with their pictures
value_order     wavelengths and distances mixed up, or in a wrong unit
power_order     laser powers mixed up
candidates      which corrections are tried, alone and in pairs
capture_choice  on which captures
central_region  the middle of large sessions
speckle         correlation of predicted and seen speckle, and what chance gives
trial           predictions under hypotheses, each computed once
search          from captures to findings
findings        what was found
settings        thresholds with their evidence
"""

from holoview.captures.records.correction import Correction
from holoview.captures.records.findings import RecordFindings
from holoview.captures.records.search import find_record_errors
from holoview.captures.records.value_order import plausible_units

__all__ = ["Correction", "RecordFindings", "find_record_errors", "plausible_units"]
