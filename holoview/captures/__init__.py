"""Measured data: the patterns sent to the modulators, the camera's images, and the nominal geometry of the bench.

dataset               Captures: the data of one measurement session
capture_file          reads and writes the HDF5 capture file, version 1
capture_schema        what the datasets and attributes of that file may be
plain_hdf5            HDF5 files that hold all of their data themselves
bench_tables          a measured bench as tables of TOML
folder_import         imports a folder of images with captures.csv and bench.toml
turns                 mirroring and turning pictures without resampling
nominal_stops         irises and square stops as attributes of the file and keys of bench.toml
validation            refuses impossible sessions and hints at wrong units
summary               a session as numbers and as a contact sheet
patterns              random test patterns from smooth to rough
virtual_measurement   simulates a measurement session
records               whether patterns, pictures and settings are recorded rightly
prepared_captures     images with black subtracted and unusable pixels masked
noise_model           variances for weights; an estimate of unequal pixel sensitivity (PRNU)
predictor             expected camera signals for any effects: the fast forward model
fit_quality           χ² per pixel and PSNR of a prediction of captures
effect_check          runs users' own effects once before a search
incoherent_component  one of the fields whose intensities add up, and its illumination
near_field_model      camera intensity behind one or two modulators, relays and free space
fourier_model         camera intensity in the back focal plane of a lens
camera_sampling       intensity on the camera's pixels of a field that is known by its spectrum
frequency_band        FFTs restricted to the frequencies that stops pass
tensor_cache          least-recently-used caches of tensors
"""

from holoview.captures.capture_file import read_captures, write_captures
from holoview.captures.dataset import Camera, Captures, SlmSpec

__all__ = ["Camera", "Captures", "SlmSpec", "read_captures", "write_captures"]
