"""Speckle on the retina: its contrast at every sample and as cones see it, for pupils of several diameters.

A pupil of diameter d makes grains about λ/d wide (Goodman, *Speckle Phenomena in Optics*, 2007, ch. 4): a small pupil
makes coarse speckle, a large one fine. Their contrast doesn't depend on the pupil as long as the patterns of the lasers
are fully developed and independent; then it is √(Σm²)/Σm for mean luminances m, 1/√N for N equal ones. Foveal cones
average over discs of 0.5 arcmin, which hides grains that are smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from holoview.metrics.laser_patterns import mean_wavelength
from holoview.metrics.speckle import speckle_contrast
from holoview.model.eye import PUPIL
from holoview.model.system import System
from holoview.model.visual_angle import sample_degrees
from holoview.numerics.image_region import Region
from holoview.util.errors import UserError

CONE_ARCMIN = 0.5
"""Diameter of a foveal cone (Curcio et al., J. Comp. Neurol. 292, 497 (1990)): 2.5 µm at 17 mm."""
PUPILS_M = (2e-3, 2.5e-3, 3e-3, 4e-3, 5e-3, 6e-3)
"""Diameters of natural pupils, from bright light to dim."""
MAX_PUPILS = 50


@dataclass(frozen=True)
class RetinalContrast:
    """Speckle contrast of a region of the retinal image, seen through one pupil.

    pupil_m: its diameter. contrast: of the luminance at every sample. cone_contrast: of its means over cones.
    grain_arcmin: λ/d, about the width of a grain, at the mean wavelength of the luminance.
    """

    pupil_m: float
    contrast: float
    cone_contrast: float
    grain_arcmin: float


def pupils_of(system: System, pupils_m: Sequence[float] = PUPILS_M) -> list[System]:
    """The system with its eye's pupil of each diameter.

    Raises UserError without an eye, for no diameter or more than MAX_PUPILS, and for one out of range.
    """
    if system.eye is None:
        raise UserError("pupils", "there is no eye", expected="a bench with an eye", remedy="--set eye={}")
    if not 1 <= len(pupils_m) <= MAX_PUPILS:
        raise UserError("pupils", str(len(pupils_m)), expected=f"1 to {MAX_PUPILS} diameters")
    for diameter_m in pupils_m:
        PUPIL.parse(diameter_m, "pupils")
    return [system.with_(eye=replace(system.eye, pupil_m=diameter_m)) for diameter_m in pupils_m]


def default_pupils(system: System) -> tuple[float, ...]:
    """Those of PUPILS_M that fit the eyepiece of a system's eye, wherever its pupil is."""
    eye = system.eye
    if eye is None:
        return PUPILS_M
    reach_m = 2 * (eye.eyepiece_m - float(np.hypot(eye.pupil_y_m, eye.pupil_x_m)))
    return tuple(d for d in PUPILS_M if d < reach_m) or (min(PUPILS_M[0], 0.9 * reach_m),)


def retinal_contrast(
    system: System,
    luminance: NDArray[np.floating],
    region: Region | None = None,
    target: NDArray[np.floating] | None = None,
) -> RetinalContrast:
    """Contrast of a region of what the eye of a system sees.

    luminance: (y, x) of the whole image. target: (y, x), whose structure is divided out.
    Raises UserError without an eye, and as `speckle_contrast` does.
    """
    if system.eye is None:
        raise UserError("retinal speckle", "there is no eye", expected="a bench with an eye")
    pitch_m = system.modulators[0].pitch_m / system.sampling.upsample
    degrees = sample_degrees(pitch_m, system.eye.eyepiece_m)
    blurred = None if target is None else seen_by_cones(target, degrees)
    diameter_m = system.eye.pupil_diameter_m(system.field_m)
    return RetinalContrast(
        pupil_m=diameter_m,
        contrast=speckle_contrast(luminance, region, target).contrast,
        cone_contrast=speckle_contrast(seen_by_cones(luminance, degrees), region, blurred).contrast,
        grain_arcmin=60 * float(np.degrees(mean_wavelength(system) / diameter_m)),
    )


def seen_by_cones(image: NDArray[np.floating], degrees_per_sample: float) -> NDArray[np.float64]:
    """The mean of an image (y, x) over a disc as wide as a foveal cone, around every sample; it counts as periodic."""
    from scipy.special import j1  # slow start: a viewer begins without it

    y, x = (np.fft.fftfreq(n, degrees_per_sample) for n in image.shape)
    v = np.pi * CONE_ARCMIN / 60 * np.hypot(y[:, None], x[None, :])
    transfer = np.divide(2 * j1(v), v, out=np.ones_like(v), where=v > 0)
    return np.asarray(np.fft.ifft2(np.fft.fft2(image) * transfer).real)
