"""Imperfections of real displays, which the plain model doesn't have: each effect is one physical cause.

Effects of the same part of a display share a file; where one cause acts at two places, there is an effect for each
place. An effect states its cause and its parameters, and overrides the hooks of the quantities that it changes; the
framework is `holoview.light.model.effects`, whose registry finds every file of this package by itself. One more reads
holograms' files and stands beside their readers: `holoview.holograms.fields.source_field`, a complex field as the light
before the first modulator.

emission         the power that is emitted for the one that was set (laser_power), wavelengths (wavelength_offset), a
                 second line of each laser (second_line), the width of the lines (bandwidth)
illumination     brightness over the first modulator (source_profile), angle (tilt), size of the source (source_extent)
beam             a disc, a Gaussian beam or an ellipse, with a wavefront over it (beam)
distance         the focal planes (distance), the gap between the modulators (gap)

modulator_response
                 the optical path of full drive (stroke), and its variation over the area (stroke_map); of each level
                 (lut); at each wavelength (dispersion), and the shape of the table there (lut_dispersion)
settling         a part of the pattern before remains (settling), ripple of the phase within an exposure (flicker)
crosstalk        fringing fields between pixels (crosstalk), and those that smear edges of one sign (fringing)
twisted_nematic  an amplitude that changes with the phase (twisted_nematic)
undiffracted     light that isn't modulated (undiffracted), and adds in intensity (polarisation)
slm_flatness     static wavefront of a modulator (slm_flatness)
slm_stuck        columns, rows and pixels of a modulator that are stuck (slm1_stuck, slm2_stuck)
fringes          fringes of the cover glass of a modulator or the camera (slm1_fringes, slm2_fringes, camera_fringes)
alignment        position of the second modulator and of the picture (slm_alignment, camera_alignment)

iris             size and position of the irises (iris1, iris2), a stop at the zero order of relay 2 (dc_block)
aberration       wavefronts of the relays (aberration1, aberration2)

camera_response  the response to light (camera_gamma), black level (camera_black), light of the room (ambient)
blur             a blur of the picture (camera_blur), a camera that moves during the exposure (motion_blur), a weak
                 shifted copy (ghost)
stage            the rail on which the camera moves between planes (stage), planes that it misses (plane_errors)
vignetting       fall-off towards the edges (vignetting)

amplitude_response
                 black pixels of an amplitude modulator that leak (leakage), its gamma (amplitude_gamma)
element_place    an element of a chain out of its place (misplaced), a mask of another depth (mask_depth)

calibrated       the maps that a calibration learned (`holoview.light.model.effects.learned_maps`)
"""

from holoview.light.model.effects.effect import (
    DataProperties,
    Effect,
    ListParameter,
    Needs,
    Parameter,
    StartKind,
    Values,
)

__all__ = ["DataProperties", "Effect", "ListParameter", "Needs", "Parameter", "StartKind", "Values"]
