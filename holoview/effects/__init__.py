"""Imperfections of real displays, which the plain model doesn't have: one physical cause in each file.

A file is named as the id of its effect. Where one cause acts at two places, its file holds an effect for each place.

Each effect states its cause and its parameters, and overrides the hooks of the quantities that it changes; the
framework is `holoview.model.effects`, whose registry finds every file of this package by itself.

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
slm_stuck         columns, rows and pixels of a modulator that are stuck (slm1_stuck, slm2_stuck)
fringes           fringes of the cover glass of a modulator or the camera (slm1_fringes, slm2_fringes, camera_fringes)
alignment         position of the second modulator and of the picture (slm_alignment, camera_alignment)

relays
iris              size and position of the irises (iris1, iris2)
dc_block          a stop at the zero order of relay 2
aberration        wavefronts of the relays (aberration1, aberration2)

camera
camera_black      the black level
ambient           light of the room
camera_gamma      the response to light
camera_blur       a blur of the picture
motion_blur       a camera that moves during the exposure
stage             the rail on which the camera moves between planes
plane_errors      planes that the stage misses, each by its own error
vignetting        fall-off towards the edges
ghost             a weak shifted copy

learned by a calibration
calibrated        the effect that applies learned maps (`holoview.model.effects.learned_maps`)

starting_grids    starting points that several effects share
"""

from holoview.model.effects.effect import DataProperties, Effect, Needs, StartKind
from holoview.model.effects.parameter import ListParameter, Parameter, Values

__all__ = ["DataProperties", "Effect", "ListParameter", "Needs", "Parameter", "StartKind", "Values"]
