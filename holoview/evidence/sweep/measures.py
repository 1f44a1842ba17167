"""What a sweep measures of a hologram on a bench: the numbers of `contrast`, `optimise`, `compare`, `render`.

contrast         speckle contrast σ/μ of the luminance in a region, as `contrast`; with a target its structure is
                 divided out; not a number where it is withheld
psnr             of linear sRGB to the target, mean over the planes, dB, as `optimise` and `compare`
delta_e          mean CIEDE2000 to the target
ms_ssim          multi-scale structural similarity to the target
eyebox           the darkest block of the eyebox over the mean, as `optimise`
eyebox_variation standard deviation of the blocks over their mean
light            share of the light in the picture, as `render`
luminance        mean luminance of the picture; 1 is the display's white
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.speckle_meter import measure_hologram
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.image_quality import eyebox_uniformity_of, measure_image_quality
from holoview.holograms.targets.target_source import TargetSource
from holoview.holograms.view import simulate
from holoview.light.model.focus import focused_planes
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region, central_region, region_slices
from holoview.util.errors import UserError, suggest_matches


@dataclass(frozen=True)
class Measure:
    """A measure. title: with the unit, for axes of figures. is_better_high: whether more is better. unit: "" for none.

    needs_target: whether it compares with a target.
    """

    title: str
    is_better_high: bool
    unit: str = ""
    needs_target: bool = False


MEASURES = {
    "contrast": Measure("speckle contrast", False),
    "psnr": Measure("PSNR (dB)", True, "dB", needs_target=True),
    "delta_e": Measure("mean CIEDE2000", False, needs_target=True),
    "ms_ssim": Measure("MS-SSIM", True, needs_target=True),
    "eyebox": Measure("eyebox: darkest over mean", True),
    "eyebox_variation": Measure("eyebox: variation", False),
    "light": Measure("light in the picture", True),
    "luminance": Measure("mean luminance", True),
}
_COMPARING = tuple(name for name, measure in MEASURES.items() if measure.needs_target)


def parse_measures(text: str, system: System) -> tuple[str, ...]:
    """The measures of a text such as "contrast,psnr". Raises UserError for unknown ones and what a bench can't have."""
    names = tuple(dict.fromkeys(part.strip() for part in text.split(",")))
    for name in names:
        if name not in MEASURES:
            remedy = suggest_matches(name, MEASURES)
            raise UserError("--measure", f'"{name}"', expected=", ".join(MEASURES), remedy=remedy)
        if system.is_field and name.startswith("eyebox"):
            found = f"{name} of a field, whose light in an eyebox isn't known"
            raise UserError("--measure", found, expected="a bench with modulators")
    return names


def measure_point(
    hologram: Hologram,
    names: Sequence[str],
    source: TargetSource | None,
    plane_m: float | None = None,
    region: Region | None = None,
) -> dict[str, float]:
    """The measures of a hologram by their names; with "contrast" also its standard error, "contrast_error".

    plane_m: where everything is measured; None: fidelity as the mean over all planes, all else in the middle one.
    region: x, y, width, height in samples; None: contrast in the central half, all else in the whole picture.
    """
    system, found = hologram.system, dict[str, float]()
    planes_m = focused_planes(system)
    at_m = float(system.planes_m[len(system.planes_m) // 2]) if plane_m is None else plane_m
    if "contrast" in names:
        measured = measure_hologram(hologram, at_m, region or central_region(system.way.shape), source)
        own, is_withheld = measured.found.luminance, bool(measured.found.withheld)
        found["contrast"] = math.nan if is_withheld else own.contrast
        found["contrast_error"] = math.nan if is_withheld else own.standard_error
    if {"light", "luminance"} & set(names):
        view = simulate(system, hologram.drive, [at_m], backend="torch")
        assert view.light is not None
        found["light"] = float(view.light.by_plane[0])
        seen = view.xyz[0, ..., 1] if region is None else view.xyz[0, *region_slices(region)][..., 1]
        found["luminance"] = float(seen.mean(dtype=np.float64))
    if any(name in _COMPARING for name in names):
        assert source is not None
        found |= _fidelity(hologram, source, planes_m if plane_m is None else np.array([plane_m]), region)
    if any(name.startswith("eyebox") for name in names):
        eyebox = eyebox_uniformity_of(hologram)
        found |= {"eyebox": eyebox.uniformity, "eyebox_variation": eyebox.coefficient_of_variation}
    columns = [column for name in names for column in (name, f"{name}_error")]
    return {column: found[column] for column in columns if column in found}


def _fidelity(
    hologram: Hologram, source: TargetSource, planes_m: NDArray[np.float64], region: Region | None
) -> dict[str, float]:
    """PSNR, colour difference and structural similarity at planes; of a stack at those of its planes."""
    view = simulate(hologram.system, hologram.drive, planes_m, backend="torch")
    built = source.build(None if source.is_stack else planes_m, system=hologram.system)
    own_m = np.asarray(built.planes_m)
    stack = built.stack[[int(np.argmin(np.abs(own_m - plane_m))) for plane_m in planes_m]]
    if region is not None:
        view, stack = view.cropped(region), stack[:, *region_slices(region)]
    quality = measure_image_quality(view, stack, (0, 0, stack.shape[2], stack.shape[1]))
    structure = float("nan") if quality.ms_ssim is None else quality.ms_ssim.mean
    return {"psnr": quality.psnr.mean_db, "delta_e": quality.delta_e, "ms_ssim": structure}
