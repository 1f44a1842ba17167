"""Measured data: the patterns sent to the modulators, the camera's images, and the nominal geometry of the bench.

dataset               Captures: patterns, images and settings, with the nominal bench; mirrored and turned pictures
validation            refuses impossible captures and hints at wrong units; a summary as numbers and a contact sheet
nominal_bench         the nominal bench as attributes of the file and as tables of TOML
capture_file          reads and writes the HDF5 capture file, version 1; imports a folder of images
picture_files         pictures and patterns in files of their own, lists of pairs
picture_import        captures from pictures and their patterns, of a Fourier bench of which little is known
picture_geometry      where a picture lies in the spectrum of its pattern
unknown_settings      estimates of camera, powers and exposures that nobody stated
slmsuite_calibration  reads calibrations of slmsuite
patterns              random test patterns from smooth to rough
virtual_measurement   simulates captures of a bench with effects
records               whether patterns, pictures and settings belong together
prepared_captures     images, masks and variances for a comparison with a model; sensitivity of pixels (PRNU)
predictor             expected camera signals for any effects: the fast forward model; checks of users' effects
capture_speckle       speckle contrast of captures, without the noise of their camera
speckle_meter         a hologram measured by an instrument: an eye, the camera of IEC 62906-5-2, a camera
camera_model          camera intensity in the near field, and in the back focal plane of a lens
"""

from holoview.bench.captures.capture_file import read_captures, write_captures
from holoview.bench.captures.dataset import Camera, Captures, SlmSpec

__all__ = ["Camera", "Captures", "SlmSpec", "read_captures", "write_captures"]
