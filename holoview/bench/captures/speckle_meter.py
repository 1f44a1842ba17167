"""The instrument that measures speckle: none (the samples of the simulation), an eye, IEC's camera, or a camera.

A pupil of diameter D makes grains about λ/D wide, and what is wider than half a grain averages them, so that a contrast
means nothing without its instrument.

eye     a pupil of 3 mm, with the aberrations of the bench's eye, and means over foveal cones
iec     a pupil of 1.2 mm without aberrations (a diffraction-limited camera with it has about the point spread of the
        aberrated eye: Opt. Rev. 24, 1 (2017), doi 10.1007/s10043-017-0372-5), and pixels of half a grain or less
camera  a lens of a working f-number that images the plane onto its sensor at magnification 1, pixels that average, shot
        and read noise, whole counts; the noise is taken off the contrast

An eye takes the place of the bench's; behind a lens of focal length f and a pupil D the light has direction sines up to
D/2f, so that a camera is an eye without aberrations with f/D its f-number.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from holoview.bench.captures.dataset import Camera
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, read_out
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.grains import PixelNoise
from holoview.holograms.metrics.likeness import NO_OTHERS, OtherPlanes
from holoview.holograms.metrics.speckle import (
    CONE_ARCMIN,
    Floats,
    channels_seen_by_cones,
    mean_wavelength,
    seen_by_cones,
)
from holoview.holograms.metrics.speckle_measurement import (
    LaserImages,
    SpeckleMeasurement,
    images_of_lasers,
    measure_speckle,
)
from holoview.holograms.targets.target_source import TargetSource
from holoview.holograms.view import View, simulate
from holoview.light.model.eye import Eye, Prescription, sample_degrees
from holoview.light.model.fields import Integer, Number, described_field, flag_of, validate, with_field_docs
from holoview.light.model.focus import focused_planes, plane_label
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region
from holoview.util.errors import UserError

METERS = ("eye", "iec", "camera")

EYE_PUPIL_M, IEC_PUPIL_M, _CAMERA_PUPIL_M = 3e-3, 1.2e-3, 3e-3
_GOOD_SIGMAS = (10.0, 60.0)
_WIDEST_PIXEL = 0.5  # of a grain
_GOOD_BITS = 12
_SAME_PLANE_M = 1e-6
_ARCMIN = math.degrees(1) * 60


@with_field_docs
@dataclass(frozen=True)
class CameraLens:
    """A camera, whose noise is that of `AcquisitionSettings`: 16 000 electrons at full scale, 3 of read noise.

    Raises UserError for numbers out of range.

    Fields:
    """

    f_number: float = described_field(
        Number(low=0.7, high=300.0, words="0.7 to 300"), "Of the camera, working, at magnification 1."
    )
    pixel_m: float = described_field(
        Number("um", low=1e-7, high=1e-3, words="0.1 um to 1 mm"), "Width of the camera's pixels, e.g. 3.45um."
    )
    bits: int = described_field(Integer(4, 16), "Of the camera's counts.", default=12)
    exposure: float = described_field(
        Number(low=1e-4, high=1.0), "Mean light of the region over the full scale.", default=0.05
    )
    seed: int = described_field(Integer(0, 2**63 - 1), "Of the camera's noise.", default=0)

    def __post_init__(self) -> None:
        validate(self, flag_of)


@dataclass(frozen=True)
class Meter:
    """An instrument. name: of `METERS`, or "" for the samples of the simulation. camera: of the meter "camera"."""

    name: str = ""
    camera: CameraLens | None = None

    def bench(self, system: System) -> System:
        """A bench with this instrument behind it."""
        if not self.name:
            return system
        eye = system.eye or Eye()
        if self.name == "eye":
            return system.with_(eye=replace(eye, pupil_m=EYE_PUPIL_M))
        if self.camera is None:
            plain: dict[str, Any] = {"chromatic": False, "stiles_crawford": False, "prescription": Prescription()}
            return system.with_(eye=replace(eye, pupil_m=IEC_PUPIL_M, **plain))
        eyepiece_m = _CAMERA_PUPIL_M * self.camera.f_number
        return system.with_(eye=Eye(eyepiece_m=eyepiece_m, pupil_m=_CAMERA_PUPIL_M, chromatic=False))


NO_METER = Meter()
"""The samples of the simulation themselves."""


@dataclass(frozen=True)
class MeterReading:
    """What an instrument resolves.

    description: of the instrument, in words. grain: λ/D, or λ times the f-number, in words, with its unit.
    pixels_a_grain: samples, cones or pixels across it; None without a pupil. full_scale_sigma: full scale of a camera
    in standard deviations of its picture. notes: conditions that aren't met, as sentences.
    """

    description: str
    grain: str = ""
    pixels_a_grain: float | None = None
    full_scale_sigma: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """All but the notes, in words."""
        parts = [self.description, *([self.grain] if self.grain else [])]
        if self.pixels_a_grain is not None:
            parts.append(f"{self.pixels_a_grain:.2g} pixels a grain")
        if self.full_scale_sigma is not None:
            parts.append(f"full scale {self.full_scale_sigma:.3g} standard deviations")
        return "; ".join(parts)

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "instrument": self.description,
            "lambda_over_d": self.grain or None,
            "pixels_a_grain": self.pixels_a_grain,
            "full_scale_sigma": self.full_scale_sigma,
            "notes": list(self.notes),
        }


@dataclass(frozen=True, eq=False)
class MeasuredHologram:
    """A region of a hologram, measured by an instrument.

    view: of the one plane, behind the instrument's lens. target: (y, x, 3) in linear sRGB, or None.
    """

    hologram: Hologram
    view: View
    found: SpeckleMeasurement
    reading: MeterReading
    target: NDArray[np.floating] | None = field(repr=False, default=None)


def measure_hologram(
    hologram: Hologram,
    plane_m: float,
    region: Region,
    target: TargetSource | None = None,
    meter: Meter = NO_METER,
    *,
    is_aligned: bool = False,
) -> MeasuredHologram:
    """Measures the speckle of a hologram at a plane.

    region: (x, y, width, height) in samples of the image. target: whose structure is divided out. is_aligned: moves it
    to where it fits, by whole samples.
    Raises UserError as `simulate` and `measure_speckle` do, and for a target of the wrong size.
    """
    system = meter.bench(hologram.system)
    view = simulate(system, hologram.drive, [plane_m], backend="torch")
    plan = make_plan(system, [plane_m])
    known, others = (None, NO_OTHERS) if target is None else _target_at(target, system, plane_m)
    lasers = laser_images(view, plan)
    if meter.camera is not None:
        shown = Hologram(hologram.drive, system)
        return _by_camera(shown, view, lasers, known, region, meter.camera, is_aligned=is_aligned)
    luminance: NDArray[np.floating] = view.xyz[0, ..., 1]
    if meter.name == "eye":
        degrees = _degrees(system)
        luminance = seen_by_cones(luminance, degrees)
        lasers = replace(lasers, intensity=np.stack([seen_by_cones(part, degrees) for part in lasers.intensity]))
        if known is not None:
            known = channels_seen_by_cones(known, degrees)
    found = measure_speckle(luminance, region, known, lasers, others=others, is_aligned=is_aligned)
    shown = Hologram(hologram.drive, system)
    return MeasuredHologram(shown, view, found, _reading(system, meter), known)


def _target_at(target: TargetSource, system: System, plane_m: float) -> tuple[NDArray[np.floating], OtherPlanes]:
    """The picture (y, x, 3) of a target at a plane, and those at others.

    Raises UserError for a focal stack that has none there.
    """
    wanted = np.unique([plane_m, *focused_planes(system)])
    built = target.build(None if target.is_stack else wanted, system=system)
    planes_m = np.asarray(built.planes_m)
    nearest = int(np.argmin(np.abs(planes_m - plane_m)))
    if abs(planes_m[nearest] - plane_m) > _SAME_PLANE_M:
        raise UserError(
            "target",
            f"a focal stack without a picture at {plane_m * 1e3:.4g} mm",
            expected=f"one of its planes, {', '.join(f'{z * 1e3:.4g}' for z in planes_m)} mm",
            remedy="choose one by --plane; a picture that is out of focus there is another one",
        )
    rest = {k: of for k, of in enumerate(built.stack) if abs(planes_m[k] - planes_m[nearest]) > _SAME_PLANE_M}
    named = {f"at {plane_label(system, float(planes_m[k]))}": of for k, of in rest.items()}
    return built.stack[nearest], OtherPlanes(named, are_mistakable=built.are_planes_given)


def laser_images(view: View, plan: Plan) -> LaserImages:
    """The light of each laser at the first plane of a view; that of the lines into which effects split one is summed.

    A laser's colour is the mean of its lines', weighted by their light.
    """
    intensity = np.stack([view.intensity[0, list(split.indices)].sum(axis=0) for split in plan.lasers])
    powers = view.intensity[0].sum(axis=(1, 2), dtype=np.float64)
    colours = []
    for split in plan.lasers:
        lines = list(split.indices)
        weights = powers[lines] if powers[lines].sum() > 0 else None
        colours.append(np.average(plan.colour_weights[lines], axis=0, weights=weights))
    return images_of_lasers(plan.nominal.wavelengths_m, np.stack(colours), intensity)


def _degrees(system: System) -> float:
    """Visual angle from sample to sample, with an eye."""
    assert system.eye is not None
    return sample_degrees(system.way.sample_m, system.eye.eyepiece_m)


def _reading(system: System, meter: Meter) -> MeterReading:
    """What an eye, or the samples of the simulation, resolve."""
    eye, pitch_m = system.eye, system.way.sample_m
    if eye is None:
        return MeterReading(
            f"none: samples of the simulation, {pitch_m * 1e6:.3g} um apart, behind the bench's own stops"
        )
    pupil_m, λ = eye.pupil_diameter_m(system.field_m), mean_wavelength(system)
    grain_arcmin, sample_arcmin = λ / pupil_m * _ARCMIN, 60 * _degrees(system)
    pixel_arcmin = CONE_ARCMIN if meter.name == "eye" else sample_arcmin
    pixels, notes = grain_arcmin / pixel_arcmin, _notes_of_pupil(system, eye.pupil_na(system.field_m), pupil_m)
    kind = {
        "eye": "eye",
        "iec": "camera in the manner of IEC 62906-5-2, without aberrations",
        "": "the bench's own eye",
    }
    how = f"means over cones of {CONE_ARCMIN:g}'" if meter.name == "eye" else f"samples of {sample_arcmin:.3g}'"
    if meter.name == "iec" and pixels < 1 / _WIDEST_PIXEL:
        notes += (
            f"the samples of the simulation are wider than half a grain ({pixels:.2g} a grain): the contrast comes out "
            "too low; raise --set sampling.upsample or lengthen the eyepiece",
        )
    text = (
        f"{kind[meter.name]}: pupil {pupil_m * 1e3:.3g} mm behind an eyepiece of {eye.eyepiece_m * 1e3:.3g} mm, {how}"
    )
    return MeterReading(text, f"λ/D = {grain_arcmin:.3g}' at {λ * 1e9:.3g} nm", pixels, notes=notes)


def _notes_of_pupil(system: System, pupil_na: float, pupil_m: float) -> tuple[str, ...]:
    """A sentence where the bench's light doesn't fill a pupil."""
    λ, way = mean_wavelength(system), system.way
    reach = min(way.relays[-1].axis_sine(λ, way.orders_m[-1]), λ / (2 * way.sample_m))
    if reach >= pupil_na:
        return ()
    filled = reach / pupil_na * pupil_m
    return (
        f"the bench's light fills {filled * 1e3:.3g} mm of the pupil of {pupil_m * 1e3:.3g} mm: its grains are as wide "
        "as the bench's stops make them",
    )


# --- through a camera -------------------------------------------------------------------------------------------------


def _by_camera(
    hologram: Hologram,
    view: View,
    lasers: LaserImages,
    target: NDArray[np.floating] | None,
    region: Region,
    lens: CameraLens,
    *,
    is_aligned: bool,
) -> MeasuredHologram:
    """The counts of a monochrome camera, of all lasers and of each at the same exposure, without their noise."""
    system = hologram.system
    pitch_m = system.way.sample_m
    light = np.stack([pixel_means(part, region, lens.pixel_m / pitch_m) for part in lasers.intensity])
    total = light.sum(axis=0)
    if not total.mean() > 0:
        raise UserError("region", "no light in it", remedy="choose a brighter region")
    settings = AcquisitionSettings(bit_depth=lens.bits)
    camera = Camera(lens.pixel_m, lens.bits, settings.full_well / 2**lens.bits, settings.read_noise, 0.0)
    black = min(settings.black_level, camera.saturation / 64)
    scale = lens.exposure * camera.saturation / float(total.mean())
    rng = np.random.default_rng(lens.seed)
    counts = [read_out(camera, scale * part, black, rng) for part in (total, *light)]
    pictures = np.stack([picture.astype(np.float64) - black for picture in counts])
    noise = PixelNoise(camera.electrons_per_count, math.hypot(camera.read_noise / camera.electrons_per_count, 12**-0.5))
    known = (
        None
        if target is None
        else np.stack(
            [pixel_means(channel, region, lens.pixel_m / pitch_m) for channel in np.moveaxis(target, -1, 0)], axis=-1
        )
    )
    own = replace(lasers, colours=None, intensity=pictures[1:], noise=noise)
    whole = (0, 0, total.shape[1], total.shape[0])
    found = measure_speckle(pictures[0], whole, known, own, noise, is_aligned=is_aligned)
    reading = _camera_reading(system, lens, camera, float((counts[0] >= camera.saturation).mean()), pictures[0])
    return MeasuredHologram(hologram, view, found, reading, known)


def pixel_means(image: NDArray[np.floating], region: Region, width: float) -> Floats:
    """Means of an image (y, x) over square pixels of a width in samples that lie in a region, in rows and columns.

    The image counts as periodic and as a sum of waves, which a pixel damps by sinc(f·width); its values at the pixels'
    centres are interpolated by cubic splines. Raises UserError for a region of less than 2 × 2 pixels.
    """
    y, x = (np.fft.fftfreq(n) for n in image.shape)
    damped = np.fft.ifft2(np.fft.fft2(image) * np.outer(np.sinc(y * width), np.sinc(x * width))).real
    x0, y0, columns, rows = region
    counts = int(rows / width), int(columns / width)
    if min(counts) < 2:
        raise UserError("--pixel", f"{width:.3g} samples wide", expected="at least 2 × 2 pixels in the region")
    centres = [first - 0.5 + width * (np.arange(n) + 0.5) for first, n in zip((y0, x0), counts, strict=True)]
    found: Floats = map_coordinates(damped, np.meshgrid(*centres, indexing="ij"), order=3, mode="grid-wrap")
    return found


def _camera_reading(system: System, lens: CameraLens, camera: Camera, clipped: float, counts: Floats) -> MeterReading:
    λ = mean_wavelength(system)
    grain_m = λ * lens.f_number
    pixels, sigmas = grain_m / lens.pixel_m, camera.saturation / max(float(counts.std()), 1e-9)
    notes = _notes_of_pupil(system, 1 / (2 * lens.f_number), _CAMERA_PUPIL_M)
    if pixels < 1 / _WIDEST_PIXEL:
        notes += (
            f"a pixel is wider than half a grain ({pixels:.2g} pixels a grain) and averages speckle: the contrast "
            "comes out too low; take a larger --f-number or a smaller --pixel",
        )
    if lens.bits < _GOOD_BITS:
        notes += (f"the camera has {lens.bits} bits; {_GOOD_BITS} or more are recommended",)
    if not _GOOD_SIGMAS[0] <= sigmas <= _GOOD_SIGMAS[1]:
        cut = "it clips bright grains" if sigmas < _GOOD_SIGMAS[0] else "few counts are left for the speckle"
        notes += (
            f"the full scale is {sigmas:.3g} standard deviations, about 20 are recommended: {cut}; change --exposure",
        )
    if clipped:
        notes += (f"{clipped:.2%} of the pixels are saturated: the contrast comes out too low; lower --exposure",)
    text = (
        f"monochrome camera at magnification 1: f/{lens.f_number:g}, pixels of {lens.pixel_m * 1e6:.3g} um, "
        f"{lens.bits} bits, mean at {lens.exposure:.3g} of full scale, shot and read noise taken off (seed {lens.seed})"
    )
    return MeterReading(text, f"λN = {grain_m * 1e6:.3g} um at {λ * 1e9:.3g} nm", pixels, sigmas, notes)
