"""Measured data: what was sent to the modulators, what the camera saw, and the geometry that the laboratory believes.

session     Captures: one measurement session as data
file        reading and writing its HDF5 file, version 1
check       what can't be, and what looks like a mistake
patterns    what to send: random, from smooth to rough
make        a virtual measurement session
predict     expected camera signals for any effects, fast
rehearsal   effects of one's own, tried once
"""

from holoview.captures.capture_file import read_captures, write_captures
from holoview.captures.dataset import Camera, Captures, SlmSpec

__all__ = ["Camera", "Captures", "SlmSpec", "read_captures", "write_captures"]
