"""Speckle contrast on the retina, against the pupil.

A pupil of diameter d makes grains about λ/d wide (Goodman, *Speckle Phenomena in Optics*, 2007, ch. 4): a small pupil
makes coarse speckle, a large one fine. Their contrast doesn't depend on the pupil as long as the patterns of the
lasers are fully developed and independent; then it is √(Σm²)/Σm for mean luminances m, 1/√N for N equal ones. Foveal
cones average over discs of 0.5 arcmin, which hides grains that are smaller. Beside a target both contrasts are those of
`likeness.luminance_contrast`, which withholds them where the target isn't shown.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.metrics.likeness import luminance_contrast
from holoview.holograms.metrics.speckle import (
    channels_seen_by_cones,
    independent_contrast,
    mean_wavelength,
    seen_by_cones,
)
from holoview.light.model.eye import PUPIL, sample_degrees
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region
from holoview.util.errors import UserError
from holoview.util.progress import ProgressCallback

PUPILS_M = (2e-3, 2.5e-3, 3e-3, 4e-3, 5e-3, 6e-3)
"""Diameters of natural pupils, from bright light to dim."""
MAX_PUPILS = 50


@dataclass(frozen=True)
class RetinalContrast:
    """Speckle contrast of a region of the retinal image, seen through one pupil.

    pupil_m: its diameter. contrast: of the luminance at every sample. cone_contrast: of its means over cones; both None
    where they are withheld, and why. grain_arcmin: λ/d, about the width of a grain, at the mean wavelength of the
    luminance. has_target: whether the structure of a target was divided out.
    """

    pupil_m: float
    contrast: float | None
    cone_contrast: float | None
    grain_arcmin: float
    has_target: bool = False
    withheld: str = ""

    def as_json(self) -> dict[str, Any]:
        """For programs; the diameter in mm."""
        own = {"contrast": self.contrast, "cone_contrast": self.cone_contrast, "grain_arcmin": self.grain_arcmin}
        beside = {"structure_removed": self.has_target, "withheld": self.withheld or None}
        return {"pupil_mm": round(self.pupil_m * 1e3, 6), **own, **beside}


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
    """The diameters of PUPILS_M that fit the eyepiece of a system's eye, wherever its pupil is."""
    eye = system.eye
    if eye is None:
        return PUPILS_M
    reach_m = 2 * (eye.eyepiece_m - float(np.hypot(eye.pupil_y_m, eye.pupil_x_m)))
    return tuple(d for d in PUPILS_M if d < reach_m) or (min(PUPILS_M[0], 0.9 * reach_m),)


def retinal_contrast(
    system: System,
    luminance: NDArray[np.floating],
    region: Region,
    target: NDArray[np.floating] | None = None,
) -> RetinalContrast:
    """Contrast of a region of the picture that the eye of a system sees.

    luminance: (y, x) of the whole image. target: (y, x, 3) in linear sRGB, whose structure is divided out.
    Raises UserError without an eye, and as `luminance_contrast` does.
    """
    if system.eye is None:
        raise UserError("retinal speckle", "there is no eye", expected="a bench with an eye")
    pitch_m = system.way.sample_m
    degrees = sample_degrees(pitch_m, system.eye.eyepiece_m)
    found = luminance_contrast(luminance, region, target)
    of_cones = None if target is None else channels_seen_by_cones(target, degrees)
    seen = luminance_contrast(seen_by_cones(luminance, degrees), region, of_cones)
    withheld = found.withheld or seen.withheld
    diameter_m = system.eye.pupil_diameter_m(system.field_m)
    return RetinalContrast(
        pupil_m=diameter_m,
        contrast=None if withheld else found.estimate.contrast,
        cone_contrast=None if withheld else seen.estimate.contrast,
        grain_arcmin=60 * float(np.degrees(mean_wavelength(system) / diameter_m)),
        has_target=found.has_target and seen.has_target,
        withheld=withheld,
    )


@dataclass(frozen=True, eq=False)
class RetinalCurve:
    """Contrasts through pupils of several diameters, and the contrast of independent patterns of the same lasers."""

    contrasts: tuple[RetinalContrast, ...]
    independent: float

    @property
    def has_target(self) -> bool:
        """Whether the structure of a target was divided out, through some pupil."""
        return any(found.has_target for found in self.contrasts)

    @property
    def withheld(self) -> str:
        """Why some contrast is withheld; "" where none is."""
        return next((found.withheld for found in self.contrasts if found.withheld), "")


def retinal_curve(
    systems: Sequence[System],
    images: Iterable[NDArray[np.floating]],
    region: Region,
    progress: ProgressCallback,
    target_of: Callable[[System], NDArray[np.floating] | None] = lambda system: None,
    plane_m: float | None = None,
) -> RetinalCurve:
    """The contrasts of a region in what the eye of each system sees.

    systems: of `pupils_of`. images: XYZ (y, x, 3), one for each system; they may be computed one by one. progress:
    called after each. target_of: the target (y, x, 3) as the eye of a system sees it; None for none.
    plane_m: that is seen, as of `independent_pattern_count`.
    """
    contrasts = list[RetinalContrast]()
    for number, (system, xyz) in enumerate(zip(systems, images, strict=True), start=1):
        contrasts.append(retinal_contrast(system, xyz[..., 1], region, target_of(system)))
        progress(number, len(systems), f"{contrasts[-1].pupil_m * 1e3:.3g} mm")
    return RetinalCurve(tuple(contrasts), independent_contrast(systems[0], plane_m))
