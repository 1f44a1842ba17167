"""Imperfections of real displays, which the plain model doesn't have: one physical cause in each file, named as its id.

Each effect states its cause and its parameters, and overrides the hooks of what it changes; the framework is
`holoview.model.effects`, whose registry finds every file of this package by itself.

distances and source
gap               the gap between the modulators
distance          the distance of the focal planes
tilt              the angle of the illumination
source_profile    the brightness of the illumination over the first modulator
source_extent     the angular size of the source
bandwidth         the width of the spectral lines
second_line       a second spectral line of each laser
wavelength_offset the wavelengths of the lasers
laser_power       the power that a laser emits for the one that was set

modulators
stroke            the optical path of full drive
lut               the optical path of each level
lut_dispersion    the shape of the table at each wavelength
dispersion        the optical path at each wavelength
stroke_map        the optical path of full drive over the area
settling          a part of the pattern before remains
crosstalk         fringing fields between pixels
undiffracted      light that isn't modulated
polarisation      light that isn't modulated and adds in intensity
flicker           ripple of the phase within an exposure
slm_flatness      static wavefront of a modulator
slm1_fringes, slm2_fringes  fringes of a modulator's cover glass; slm_fringes_base: their base class
slm1_stuck, slm2_stuck  columns, rows and pixels that are stuck; slm_stuck_base: their base class
slm_alignment     position of the second modulator; alignment_base: its base class

relays
iris1, iris2      size and position of the irises; iris_base: their base class
dc_block          a stop at the zero order of relay 2
aberration1, aberration2  wavefronts of the relays; aberration_base: their base class

camera
camera_black      the black level
ambient           light of the room
camera_gamma      the response to light
camera_blur       a blur of the picture
motion_blur       a camera that moves during the exposure
stage             the rail on which the camera moves between planes
plane_errors      planes that the stage misses, each by its own error
camera_alignment  position of the picture
vignetting        fall-off towards the edges
ghost             a weak shifted copy
camera_fringes    interference fringes of the cover glass

learned by a calibration
calibrated        the effect that applies learned maps; calibration: the maps and their file

starting_grids    starting points that several effects share
fringe_depths     depth and phase of fringes at each wavelength
stuck_places      stuck columns, rows and pixels in words
"""

from holoview.model.effects.effect import DataProperties, Effect, Needs, StartKind
from holoview.model.effects.list_parameter import ListParameter
from holoview.model.effects.parameter import Parameter, Values

__all__ = ["DataProperties", "Effect", "ListParameter", "Needs", "Parameter", "StartKind", "Values"]
