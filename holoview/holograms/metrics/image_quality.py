"""Quality of a hologram: fidelity, speckle and eyebox together, because PSNR alone rewards an unevenly lit eyebox.

measure_image_quality   of a view beside its target
eyebox_uniformity_of    of a hologram's light in the eyebox
score_hologram          all scores at the planes and between them; score_places: from places of the eye's pupil

The eyebox is the area in the pupil plane from which the image can be seen. PSNR alone is misleading: a smooth phase
sends the light through a small spot in the middle of the eyebox, which avoids speckle and gains several decibels, but
the image disappears when the eye moves, and it hardly blurs out of focus. A hologram is better only if its PSNR is
higher at equal uniformity.

The eyebox of a diffuse hologram is itself speckled, so that the intensity at a point says nothing. The measures are of
means over blocks; a mean of n independent samples of fully developed speckle still has a relative deviation of 1/√n.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.holograms.files.image_reader import read_raster
from holoview.holograms.files.light_file import PlaneLight, is_light_file, read_light
from holoview.holograms.files.raster import Raster
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.fidelity import Psnr, delta_e_linear_srgb, psnr_linear_srgb, psnr_luminance
from holoview.holograms.metrics.likeness import luminance_contrast, resolved_contrast
from holoview.holograms.metrics.perceptual import MsSsim, measure_perceptual_scores, ms_ssim
from holoview.holograms.metrics.retinal import RetinalCurve, pupils_of, retinal_curve
from holoview.holograms.metrics.speckle import SpeckleContrast
from holoview.holograms.metrics.speckle_measurement import LaserImages, images_of_lasers
from holoview.holograms.optimise.eyes import PupilPlaces
from holoview.holograms.targets.picture import read_picture
from holoview.holograms.targets.target_source import TargetSource
from holoview.holograms.view import View, simulate
from holoview.light.colour import SRGB_TO_XYZ
from holoview.light.engine.frame import spectrum_behind_modulators
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.model.focus import focused_planes, with_pupil_at
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.numerics.sample_bits import find_clipping
from holoview.light.numerics.sampling import Region, central_region, region_slices
from holoview.light.numerics.structural_similarity import scale_count
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.light.optics.slm import EYEBOX_BLOCKS, eyebox_order
from holoview.util.errors import UserError
from holoview.util.progress import ProgressCallback

CENTRE_DIVISOR = 8
"""The centre, whose relative intensity is reported, is 1/CENTRE_DIVISOR of the eyebox wide and high."""


@dataclass(frozen=True)
class EyeboxUniformity:
    """Measures of the block means, and of the centre.

    coefficient_of_variation: standard deviation of the block means over their mean; 0 for uniform light.
    uniformity: the darkest block mean over their mean; 1 for uniform light, 0 when a block is dark.
    centre_share: mean intensity of the central 1/8 × 1/8 over that of the whole; 1 for uniform light, at most 64.
    """

    coefficient_of_variation: float
    uniformity: float
    centre_share: float


def eyebox_uniformity(eyebox: ArrayLike, blocks: int = 8, envelope: ArrayLike | None = None) -> EyeboxUniformity:
    """Uniformity of the intensity (y, x) over the eyebox, zero frequency at index N//2 as with `fftshift`.

    envelope: (y, x), positive; divided out first. It is the sinc² of the modulator's pixel, which no hologram can
    change. Crop both to the band of the modulator, |f| ≤ 1/(2·pitch), beyond which the envelope falls to zero.
    blocks: number of blocks along each axis; their sizes differ by a sample where it doesn't divide the shape.
    Raises UserError for fewer samples than blocks, an envelope that doesn't fit or isn't positive, and no light.
    """
    light = np.asarray(eyebox, dtype=np.float64)
    if light.ndim != 2 or blocks < 1 or min(light.shape) < blocks:
        raise UserError("eyebox", f"shape {light.shape}", expected=f"(y, x) of at least {blocks} samples, a block each")
    if envelope is not None:
        light = light / _checked_envelope(envelope, light.shape)
    if not light.mean() > 0.0:
        raise UserError("eyebox", f"mean intensity {light.mean():g}", expected="some light")
    means = _block_means(light, blocks)
    return EyeboxUniformity(
        coefficient_of_variation=float(means.std() / means.mean()),
        uniformity=float(means.min() / means.mean()),
        centre_share=float(light[_central_slice(light.shape[0]), _central_slice(light.shape[1])].mean() / light.mean()),
    )


def _checked_envelope(envelope: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    values = np.asarray(envelope, dtype=np.float64)
    if values.shape != shape:
        raise UserError("envelope", f"shape {values.shape}", expected=f"the eyebox's shape, {shape}")
    if not values.min() > 0.0:
        raise UserError(
            "envelope",
            f"least value {values.min():g}",
            expected="positive everywhere",
            remedy="crop to |f| ≤ 1/(2·pitch)",
        )
    return values


def _block_means(light: NDArray[np.float64], blocks: int) -> NDArray[np.float64]:
    """Means (blocks, blocks) over blocks whose sides differ by one sample at most."""
    rows, columns = (np.arange(blocks) * n // blocks for n in light.shape)
    sums = np.add.reduceat(np.add.reduceat(light, rows, axis=0), columns, axis=1)
    heights, widths = np.diff(rows, append=light.shape[0]), np.diff(columns, append=light.shape[1])
    means: NDArray[np.float64] = sums / np.outer(heights, widths)
    return means


def _central_slice(n: int) -> slice:
    """The central 1/CENTRE_DIVISOR of n samples, at least one, around zero frequency at n//2."""
    width = max(1, round(n / CENTRE_DIVISOR))
    start = n // 2 - width // 2
    return slice(start, start + width)


# --- quality of a hologram --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ImageQuality:
    """Fidelity of a view to its target at fixed brightness, and the speckle contrast of its luminance.

    psnr: of linear sRGB (dB). psnr_luminance: of luminance (dB). delta_e: mean CIEDE2000. ms_ssim: multi-scale
    structural similarity of encoded sRGB; None for images with fewer than 11 rows or columns. speckle: of each plane,
    with the target's structure divided out at the resolution that the plane shows.
    """

    psnr: Psnr
    psnr_luminance: Psnr
    delta_e: float
    ms_ssim: MsSsim | None
    speckle: tuple[SpeckleContrast, ...]

    @property
    def mean_speckle_contrast(self) -> float:
        """Mean speckle contrast over the planes."""
        return float(np.mean([plane.contrast for plane in self.speckle]))


def measure_image_quality(view: View, stack: NDArray[np.floating], region: Region | None = None) -> ImageQuality:
    """The quality of a view against its target (plane, y, x, 3) in linear sRGB.

    region: (x, y, width, height) in samples, in which speckle is measured; the central half when None.
    """
    target_xyz = np.asarray(stack) @ SRGB_TO_XYZ.T
    speckle_region = region or central_region(stack.shape[1:3])
    return ImageQuality(
        psnr=psnr_linear_srgb(view.rgb, stack),
        psnr_luminance=psnr_luminance(view.xyz, target_xyz),
        delta_e=delta_e_linear_srgb(np.clip(view.rgb, 0, 1), np.clip(stack, 0, 1)),
        ms_ssim=ms_ssim(view.rgb, stack) if scale_count(stack.shape[1:3]) else None,
        speckle=tuple(
            resolved_contrast(xyz[..., 1], speckle_region, target[..., 1])
            for xyz, target in zip(view.xyz, target_xyz, strict=True)
        ),
    )


def plane_midpoints(planes_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The distances (m) halfway between neighbouring planes, in rising order."""
    ordered = np.unique(planes_m)
    midpoints: NDArray[np.float64] = (ordered[1:] + ordered[:-1]) / 2
    return midpoints


def eyebox_uniformity_of(hologram: Hologram) -> EyeboxUniformity:
    """Uniformity of the light behind the stops of relay 2, over the modulator's first order, wherever an eye is.

    Lasers are summed by luminance at equal spatial frequency, since the first order of each wavelength is |f| ≤
    1/(2·pitch).
    """
    system = hologram.system.with_(eye=None)
    plan = make_plan(system, system.planes_m[:1])
    executor = TorchExecutor(plan, FrameInputs(plan, hologram.drive))
    power = np.zeros(plan.grid.padded)
    band = np.ix_(
        *(k % padded for k, padded in zip(executor.frequencies(plan.way.last), plan.grid.padded, strict=True))
    )
    for wavelength in range(len(plan.system.wavelengths_m)):
        stop = executor.stops(wavelength).abs().square().numpy()
        for frame in plan.lit(wavelength):
            weight = plan.weights[frame, wavelength] * plan.colour_weights[wavelength, 1]
            for source in range(len(plan.slopes)):
                spectrum = spectrum_behind_modulators(executor, wavelength, frame, source)
                power[band] += weight * stop * spectrum.values.abs().square().numpy()
    order = eyebox_order(plan)
    return eyebox_uniformity(power[np.ix_(*order.bins)], EYEBOX_BLOCKS, np.outer(*order.envelopes))


# --- all scores of a hologram ---


PLACE_SCORES = ("pupil_psnr_db", "held_out_pupil_psnr_db", "held_out_pupil_psnr_between_db")
"""Scores from the places of the pupil, from places that weren't used, and from these between the planes."""

Floats = NDArray[np.floating]


@dataclass(frozen=True)
class ScoredImages:
    """The images of a hologram that an observer sees, and the target, at the planes of its bench and at held-out
    planes.

    view: at all planes, the held-out ones last. target: (plane, y, x, 3), linear sRGB, at the same planes.
    held_out_m: distances of the held-out planes, for which the patterns weren't optimised.
    """

    view: View
    target: Floats
    held_out_m: NDArray[np.float64]


def render_for_score(hologram: Hologram, source: TargetSource) -> ScoredImages:
    """Renders a hologram at its planes and halfway between neighbouring ones.

    A target that is a focal stack has no images between its planes, so that no plane is held out.
    """
    planes_m = focused_planes(hologram.system)
    held_out_m = np.array([]) if source.is_stack else plane_midpoints(planes_m)
    all_m = np.concatenate([planes_m, held_out_m])
    target = source.build(None if source.is_stack else all_m).stack
    return ScoredImages(simulate(hologram.system, hologram.drive, all_m, backend="torch"), target, held_out_m)


def score_hologram(
    hologram: Hologram, images: ScoredImages, region: Region | None, further: Sequence[str] = ()
) -> dict[str, Any]:
    """The scores of a hologram as JSON keys and values.

    region: x, y, width, height in samples, inside which images are compared; None for all of them. further: names of
    `OPTIONAL_SCORES` to add.

    Raises UserError when an image is too small for one of the scores.
    """
    view, target, held_out = images.view, images.target, images.held_out_m
    count = len(view.planes_m) - len(held_out)
    quality = _measure(view.at(range(count)), target[:count], region)
    contrast, withheld = _contrast_of_planes(*_cropped(view.at(range(count)), target[:count], region))
    eyebox = eyebox_uniformity_of(hologram)
    perceptual = measure_perceptual_scores(*_cropped(view.at(range(count)), target[:count], region), further)
    between = [_measure(view.at([i]), target[i : i + 1], region) for i in range(count, len(view.planes_m))]
    return {
        "psnr_db": quality.psnr.mean_db,
        "psnr_planes_db": list(quality.psnr.planes_db),
        "psnr_luminance_db": quality.psnr_luminance.mean_db,
        "held_out_planes_mm": [round(float(z) * 1e3, 6) for z in held_out],
        "held_out_psnr_planes_db": [one.psnr.mean_db for one in between],
        "held_out_psnr_db": float(np.mean([one.psnr.mean_db for one in between])) if between else None,
        "delta_e": quality.delta_e,
        "ms_ssim": None if quality.ms_ssim is None else quality.ms_ssim.mean,
        "ms_ssim_scales": None if quality.ms_ssim is None else quality.ms_ssim.scales,
        **{name: score.mean for name, score in perceptual.items()},
        **{f"{name}_planes": list(score.planes) for name, score in perceptual.items()},
        "speckle_contrast": contrast,
        "speckle_withheld": withheld,
        "eyebox_uniformity": eyebox.uniformity,
        "eyebox_variation": eyebox.coefficient_of_variation,
        "eyebox_centre_share": eyebox.centre_share,
    }


def _measure(view: View, target: Floats, region: Region | None) -> ImageQuality:
    """Quality of a view beside its target (plane, y, x, 3) inside a region."""
    view, target = _cropped(view, target, region)
    return measure_image_quality(view, target, _speckle_region(target))


def _contrast_of_planes(view: View, target: Floats) -> tuple[float | None, str | None]:
    """The mean over planes of the contrast that `contrast --target` states and None, or None and why it is withheld.

    The stack is known to be the right one: its planes aren't tried in each other's place.
    """
    region = _speckle_region(target) or central_region(target.shape[1:3])
    pairs = zip(view.xyz[..., 1], target, strict=True)
    found = [luminance_contrast(luminance, region, picture) for luminance, picture in pairs]
    if withheld := next((of.withheld for of in found if of.withheld), None):
        return None, withheld
    return float(np.mean([of.estimate.contrast for of in found])), None


def _cropped(view: View, target: Floats, region: Region | None) -> tuple[View, Floats]:
    """A view and its target (plane, y, x, 3) inside a region."""
    return (view, target) if region is None else (view.cropped(region), target[:, *region_slices(region)])


def _speckle_region(target: Floats) -> Region | None:
    """The region for the speckle contrast: None for the central half, or all of it if that is black in some plane."""
    lit = target[:, *region_slices(central_region(target.shape[1:3]))].any(axis=(1, 2, 3)).all()
    return None if lit else (0, 0, target.shape[2], target.shape[1])


def score_places(
    hologram: Hologram, source: TargetSource, pupils: PupilPlaces, region: Region | None
) -> dict[str, list[float]]:
    """PSNR (dB) from each place, and from places that weren't used, as JSON keys and values; empty without places.

    From the latter also focused halfway between neighbouring planes, for which nothing was optimised either.
    """
    planes_m = focused_planes(hologram.system)
    count, all_m = len(planes_m), np.concatenate([planes_m, plane_midpoints(planes_m)])
    scores: dict[str, list[float]] = {key: [] for key in PLACE_SCORES}
    for place in pupils.fixed:
        scores["pupil_psnr_db"].append(float(np.mean(_psnr_db(hologram, source, place, planes_m, region))))
    for place in pupils.held_out:
        found = _psnr_db(hologram, source, place, all_m, region)
        scores["held_out_pupil_psnr_db"].append(float(np.mean(found[:count])))
        if len(found) > count:
            scores["held_out_pupil_psnr_between_db"].append(float(np.mean(found[count:])))
    return {key: values for key, values in scores.items() if values}


def _psnr_db(
    hologram: Hologram,
    source: TargetSource,
    place: tuple[float, float],
    planes_m: NDArray[np.float64],
    region: Region | None,
) -> tuple[float, ...]:
    """PSNR on each plane, seen from a place."""
    system = with_pupil_at(hologram.system, place)
    view = simulate(system, hologram.drive, planes_m, backend="torch")
    target = source.build(planes_m, system=system).stack
    if region is not None:
        view, target = view.cropped(region), target[:, *region_slices(region)]
    return psnr_linear_srgb(view.rgb, target).planes_db


# --- images whose speckle is measured ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class LuminanceImage:
    """An image to measure.

    luminance: (y, x), linear.
    description: of the image, for people.
    clipped_share: share of its pixels that are as bright as the file can hold, or as its camera could count; they hide
    the brightest speckle. clipped_at: from which number in the file, in words. notes: remarks on how it was read.
    lasers: the light of each laser, where it is known. is_decoded: whether whole numbers were taken as a signal.
    """

    luminance: NDArray[np.floating]
    description: str
    clipped_share: float = 0.0
    clipped_at: str = ""
    notes: tuple[str, ...] = ()
    lasers: LaserImages | None = None
    is_decoded: bool = False


def picture_luminance(path: Path, *, is_linear: bool = False, plane_m: float | None = None) -> LuminanceImage:
    """The luminance of a picture file, or of light that holoview wrote as numbers.

    is_linear: its integers hold intensity, not an sRGB signal. plane_m: of light at several planes; the middle one if
    None, as of a hologram.

    Raises UserError as `read_raster` and `read_picture` do, and for a plane that a file doesn't hold.
    """
    if is_light_file(path):
        light = read_light(path)
        plane = _plane_of(path, light, plane_m)
        name, lasers = f"luminance of {path.name}", _lasers_of_light(light, plane)
        if len(light.xyz) > 1:
            name += f", plane {plane + 1} of {len(light.xyz)}"
        return LuminanceImage(light.xyz[plane, ..., 1], name, lasers=lasers)
    raster = read_raster(path)
    clipped, clipped_at = _clipped(raster)
    if is_linear:
        values = raster.values if raster.values.shape[-1] == 3 else np.repeat(raster.values, 3, axis=-1)
        luminance, name = values @ SRGB_TO_XYZ[1], f"intensity of {path.name}"
    else:
        luminance, name = read_picture(path).rgb.astype(np.float64) @ SRGB_TO_XYZ[1], f"luminance of {path.name}"
    is_decoded = raster.encoded and not is_linear
    return LuminanceImage(luminance, name, clipped, clipped_at, raster.notes, is_decoded=is_decoded)


def _plane_of(path: Path, light: PlaneLight, plane_m: float | None) -> int:
    """The index of a plane (m); of the middle one if None."""
    if plane_m is None:
        return len(light.xyz) // 2
    found = np.flatnonzero(np.abs(light.planes_m - plane_m) < 1e-9)
    if not found.size:
        known = ", ".join(f"{1e3 * z:.4g}" for z in light.planes_m)
        expected = f"one at {known} mm" if known else "no plane: it doesn't say where its light is"
        raise UserError(str(path), f"holds no light at {1e3 * plane_m:.4g} mm", expected=expected)
    return int(found[0])


def _lasers_of_light(light: PlaneLight, plane: int) -> LaserImages | None:
    """The lasers at a plane, whose colours follow from the XYZ that their intensities add up to.

    None where a file doesn't hold intensities, or where they are too much alike to tell the colours.
    """
    if light.intensity is None or len(light.wavelengths_m) != light.intensity.shape[1]:
        return None
    intensity = light.intensity[plane]
    parts = intensity.reshape(len(intensity), -1).astype(np.float64)
    products = parts @ parts.T
    if np.linalg.matrix_rank(products, hermitian=True) < len(products):
        return None
    colours = np.linalg.solve(products, parts @ light.xyz[plane].reshape(-1, 3).astype(np.float64))
    return images_of_lasers(light.wavelengths_m, colours, intensity)


def _clipped(raster: Raster) -> tuple[float, str]:
    """The share of pixels that are clipped in a channel, and the number in the file from which they are."""
    clips = [find_clipping(channel) for channel in np.moveaxis(raster.values, -1, 0)]
    levels = [np.inf if clip is None else clip.level for clip in clips]
    if raster.encoded:
        levels = [min(level, 1.0) for level in levels]
    share = float(np.mean((raster.values >= levels).any(axis=-1)))
    scale = (raster.white or 255) if raster.encoded else 1
    return share, f"{min(levels) * scale:.6g}" if share else ""


def contrast_by_pupil(
    hologram: Hologram,
    plane_m: float,
    pupils_m: Sequence[float],
    region: Region,
    progress: ProgressCallback,
    target_of: Callable[[System], Floats | None] = lambda system: None,
) -> RetinalCurve:
    """Measures the region of a hologram at a plane through each pupil (m). Raises UserError as `simulate` does.

    target_of: the target (y, x, 3) at the plane as the eye of a system sees it; None for none.
    """
    systems = pupils_of(hologram.system, pupils_m)
    images = (simulate(system, hologram.drive, [plane_m], backend="torch").xyz[0] for system in systems)
    return retinal_curve(systems, images, region, progress, target_of, plane_m)
