"""Measurements of an image, and those of the displayed image kept up to date on a worker thread.

In order: a region's speckle contrast, PSNR and colour error; the table of all regions of all images that are shown;
contrast by the number of wavelengths; lines and pixels;
`LiveMeasurement` and `LiveScore` on their threads; `LimitNotes`, where the model isn't true.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.metrics.fidelity import delta_e_linear_srgb, psnr, psnr_linear_srgb
from holoview.holograms.metrics.grains import contrast_estimate
from holoview.holograms.metrics.likeness import NO_OTHERS, OtherPlanes, luminance_contrast, shown_target
from holoview.holograms.metrics.retinal import RetinalContrast, retinal_contrast
from holoview.holograms.metrics.speckle import (
    SpeckleHistogram,
    independent_pattern_count,
    laser_luminances,
    pattern_likeness,
    speckle_histogram,
)
from holoview.light.colour import gamut_map, xyz_to_linear_srgb
from holoview.light.engine.light_share import luminance_share
from holoview.light.model.field_band import edge_power
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.model.validity import LightFigures, exceeded_limits
from holoview.light.numerics.sampling import region_slices
from holoview.util.errors import UserError
from holoview.util.mailbox import LatestTask, are_same
from holoview.viewer.document.document import Document
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.render.scene import Scene
from holoview.viewer.render.view_settings import Line, NamedRegion, Region

Floats = NDArray[np.float64]
SeenPicture = tuple[Scene, NDArray[np.floating]]
"""A scene and its picture XYZ (y, x, 3)."""


@dataclass(frozen=True, eq=False)
class RegionMetrics:
    """Measurements of a region.

    contrast: speckle contrast σ/μ of the luminance, divided by the target's luminance if there is a target; None where
    it is withheld, and why. doubt: of a stated one. standard_error: of it, or of the raw one where it is withheld.
    raw_contrast: the same without this division. mean: mean luminance, 1 is white. n_pixels: number of samples.
    psnr_db: PSNR of linear sRGB clipped to 0…1; delta_e: mean CIEDE2000; both None without a target.
    """

    contrast: float | None
    standard_error: float
    raw_contrast: float
    mean: float
    n_pixels: int
    withheld: str = ""
    doubt: str = ""
    psnr_db: float | None = None
    delta_e: float | None = None

    @property
    def text(self) -> str:
        """The contrast with its standard error, raw where no target divides it, or that it is withheld."""
        raw = ", raw" if self.psnr_db is None else ""
        return "withheld" if self.contrast is None else f"{self.contrast:.3f} ± {self.standard_error:.3f}{raw}"


def measure_region(
    xyz: NDArray[np.floating],
    region: Region,
    target: NDArray[np.floating] | None = None,
    others: OtherPlanes = NO_OTHERS,
) -> RegionMetrics:
    """Measures a region (x, y, width, height) of XYZ (y, x, 3), compared with a target (y, x, 3) in linear sRGB.

    others: targets that may be shown in its place.
    Raises UserError for a region outside the image, one without light, and a target of another shape.
    """
    if target is not None and target.shape != xyz.shape:
        raise UserError("target", f"shape {target.shape}", expected=f"the image's shape, {xyz.shape}")
    found = luminance_contrast(np.asarray(xyz)[..., 1], region, target, others=others)
    metrics = RegionMetrics(
        contrast=None if found.withheld else found.estimate.contrast,
        standard_error=found.estimate.standard_error,
        raw_contrast=found.raw.contrast,
        mean=found.raw.mean,
        n_pixels=found.raw.n_pixels,
        withheld=found.withheld,
        doubt=found.doubt,
    )
    if target is None:
        return metrics
    image_rgb, reference = gamut_map(xyz_to_linear_srgb(crop(xyz, region))), gamut_map(crop(target, region))
    return replace(metrics, psnr_db=psnr(image_rgb, reference), delta_e=delta_e_linear_srgb(image_rgb, reference))


@dataclass(frozen=True, eq=False)
class ShownImage:
    """An image that is shown: a name for people, XYZ (y, x, 3), and its target (y, x, 3) in linear sRGB.

    other_targets: of other planes.
    """

    name: str
    xyz: NDArray[np.floating]
    target: NDArray[np.floating] | None = None
    other_targets: OtherPlanes = NO_OTHERS


@dataclass(frozen=True, eq=False)
class RegionRow:
    """A region of an image, and its measurements, or the problem for which there are none."""

    image: str
    name: str
    region: Region
    metrics: RegionMetrics | None
    problem: str = ""


def measure_regions(image: ShownImage, regions: Sequence[NamedRegion], shape: tuple[int, int]) -> list[RegionRow]:
    """Measures each region of an image. shape: rows and columns in which the regions are counted."""
    rows = []
    for of in regions:
        metrics, problem = None, ""
        try:
            if image.xyz.shape[:2] != shape:
                size = " × ".join(map(str, image.xyz.shape[1::-1]))
                raise UserError("image", f"{size} samples", expected=f"{shape[1]} × {shape[0]}, as of the other one")
            metrics = measure_region(image.xyz, of.region, image.target, image.other_targets)
        except UserError as error:
            problem = str(error)
        rows.append(RegionRow(image.name, of.name, of.region, metrics, problem))
    return rows


def crop(image: NDArray[np.floating], region: Region) -> NDArray[np.floating]:
    """The region (x, y, width, height) of an image (y, x, …)."""
    x, y, width, height = region
    return image[y : y + height, x : x + width]


# --- contrast by the number of wavelengths --------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ContrastCurve:
    """Luminance contrast of the brightest 1, 2, … N lasers together; each array is (N,).

    wavelengths_m: of the lasers, brightest first. measured, errors: contrast in the image, and its standard error, of
    all lasers as of `measure_region`. independent: the contrast √(Σm²)/Σm of independent, fully developed patterns of
    mean luminance m, with the effects on powers and lines. is_raw: with the structure of the picture.
    """

    wavelengths_m: Floats
    measured: Floats
    errors: Floats
    independent: Floats
    is_raw: bool = True


def contrast_by_wavelength(
    luminance: Callable[[int], NDArray[np.floating]],
    system: System,
    region: Region,
    plane_m: float | None = None,
    target: NDArray[np.floating] | None = None,
) -> ContrastCurve:
    """Speckle contrast of a region as lasers are added one by one, brightest first.

    luminance: returns the luminance (y, x) of a laser's index, with its amplitude applied. plane_m: that is seen.
    target: (y, x, 3) in linear sRGB, whose structure is divided out: of some lasers, that of the mixture of its
    channels which fits their light best. Raises UserError when no visible laser is on.
    """
    from holoview.holograms.metrics.speckle_measurement import laser_pattern  # slow start: it imports scipy

    means, likeness = laser_luminances(system), pattern_likeness(system, plane_m)
    order = [int(i) for i in np.argsort(-means.sum(axis=0), kind="stable") if means[:, i].sum() > 0]
    if not order:
        raise UserError("lasers", "none that can be seen is on", remedy="switch one on")
    total: Floats = np.zeros(())
    sums = list[Floats]()
    for laser in order:
        total = total + np.asarray(luminance(laser), dtype=np.float64)
        sums.append(total[region_slices(region)])
    together = luminance_contrast(total, region, target)
    shown = None if target is None else shown_target(target, region, together.blur_px)
    estimates = [*(contrast_estimate(laser_pattern(some, shown)) for some in sums[:-1]), together.estimate]
    independent, sources = [], len(system.source.directions_rad)
    for count in range(1, len(order) + 1):
        added = means[:, order[:count]]
        squares = np.square(added) * likeness[order[:count]]
        independent.append(float(np.sqrt(squares.sum() / sources) / added.sum()))
    measured, errors = (np.array([getattr(of, name) for of in estimates]) for name in ("contrast", "standard_error"))
    return ContrastCurve(system.wavelengths_m[order], measured, errors, np.array(independent), target is None)


# --- lines and pixels -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class LineProfile:
    """Values (n, channel) along a line, at distances (n,) in metres from its start. image: the name of its image."""

    distance_m: Floats
    values: Floats
    image: str = ""


PROFILE_CHANNELS = ("luminance", "R", "G", "B")


def light_profile(image: ShownImage, line: Line, pitch_m: float) -> LineProfile:
    """The channels PROFILE_CHANNELS along a line of an image, R, G and B in linear sRGB; see `line_profile`."""
    found = line_profile(image.xyz, line, pitch_m)
    values = np.concatenate([found.values[:, 1:2], xyz_to_linear_srgb(found.values)], axis=1)
    return LineProfile(found.distance_m, values, image.name)


def line_profile(image: NDArray[np.floating], line: Line, pitch_m: float) -> LineProfile:
    """Values of an image (y, x) or (y, x, channel) along a line, about one sample apart, by linear interpolation.

    pitch_m: distance between samples in metres. Raises UserError for a line that leaves the image.
    """
    from scipy import ndimage  # slow start: most sessions draw no line

    x0, y0, x1, y1 = line
    rows, columns = image.shape[:2]
    ends_x, ends_y = sorted((x0, x1)), sorted((y0, y1))
    if ends_x[0] < 0 or ends_y[0] < 0 or ends_x[1] > columns - 1 or ends_y[1] > rows - 1:
        raise UserError("line", f"{line}", expected=f"inside the image of {columns} × {rows} samples")
    length = float(np.hypot(x1 - x0, y1 - y0))
    along = np.linspace(0.0, 1.0, max(round(length), 1) + 1)
    where = np.stack([y0 + (y1 - y0) * along, x0 + (x1 - x0) * along])
    channels = np.asarray(image, dtype=np.float64).reshape(rows, columns, -1)
    values = [ndimage.map_coordinates(channels[..., i], where, order=1) for i in range(channels.shape[2])]
    return LineProfile(along * length * pitch_m, np.stack(values, axis=-1))


@dataclass(frozen=True, eq=False)
class PixelValues:
    """XYZ (3,) and linear sRGB (3,) of a sample, and the intensity of each laser (laser,) if it was given."""

    x: int
    y: int
    xyz: Floats
    linear_rgb: Floats
    intensity: Floats | None = None


def sample_pixel(
    x: int, y: int, xyz: NDArray[np.floating], intensity: NDArray[np.floating] | None = None
) -> PixelValues | None:
    """The values at a sample of XYZ (y, x, 3) and intensity (laser, y, x); None outside the image."""
    if not (0 <= y < xyz.shape[0] and 0 <= x < xyz.shape[1]):
        return None
    values = np.asarray(xyz[y, x], dtype=np.float64)
    lasers = None if intensity is None else np.asarray(intensity[:, y, x], dtype=np.float64)
    return PixelValues(x, y, values, xyz_to_linear_srgb(values), lasers)


# --- Measurements of the displayed image, kept up to date on a worker thread while the image changes ---


Image = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class ImageMeasurements:
    """Measurements of an image; each is None where it wasn't requested or isn't possible.

    document: of the image. region, histogram: of the measured region. profiles: light along the line of the view
    settings, of each image that is shown. curve: contrast by the number of wavelengths, if their luminances were given.
    problem: why measurements of the region are missing, e.g. because the region is dark. retinal: the region as cones
    see it, with an eye. rows: all regions of all images that are shown.
    """

    document: Document
    region: RegionMetrics | None
    histogram: SpeckleHistogram | None
    profiles: tuple[LineProfile, ...]
    curve: ContrastCurve | None
    problem: str = ""
    retinal: RetinalContrast | None = None
    rows: tuple[RegionRow, ...] = ()

    @property
    def profile(self) -> LineProfile | None:
        """Light along the line in the image of the document; None without a line."""
        return next(iter(self.profiles), None)


class LiveMeasurement:
    """Measures the newest image in the background.

    measurements: the last results. on_change: called on the owner's thread when there are new measurements.
    """

    def __init__(self, session: EditingSession, on_change: Callable[[], None] = lambda: None) -> None:
        self.measurements: ImageMeasurements | None = None
        self._on_change = on_change
        self._task: LatestTask[ImageMeasurements] = LatestTask(
            "figures", session.call_on_owner, session.messages.post_error
        )

    @property
    def is_busy(self) -> bool:
        """Whether newer measurements are being computed."""
        return self._task.is_busy

    def request(
        self,
        document: Document,
        xyz: Image,
        target: Image | None = None,
        luminance: Image | None = None,
        others: Sequence[ShownImage] = (),
        other_targets: OtherPlanes = NO_OTHERS,
    ) -> None:
        """Requests measurements of an image; see `measure_image`. The arrays must not be changed afterwards."""
        self._task.submit(
            lambda: measure_image(document, xyz, target, luminance, others, other_targets), self._on_result
        )

    def close(self) -> None:
        """Ends the thread."""
        self._task.close()

    def _on_result(self, measurements: ImageMeasurements) -> None:
        self.measurements = measurements
        self._on_change()


def measure_image(
    document: Document,
    xyz: Image,
    target: Image | None = None,
    luminance: Image | None = None,
    others: Sequence[ShownImage] = (),
    other_targets: OtherPlanes = NO_OTHERS,
) -> ImageMeasurements:
    """Measures the image XYZ (y, x, 3) of a document.

    target (y, x, 3), linear sRGB: enables PSNR and colour error. luminance (laser, y, x): enables the curve. others:
    images beside it, in which the same regions are measured. other_targets: of other planes. An error that the user can
    correct, such as a dark region, is stored as `problem`.
    """
    images = [ShownImage(document.title, xyz, target, other_targets), *others]
    rows = [row for image in images for row in measure_regions(image, document.measured_regions, document.image_shape)]
    first = next(row for row in rows if row.region == document.measured_region)
    region, histogram, curve, problem, retinal = first.metrics, None, None, first.problem, None
    try:
        if region is not None:
            plane_m = document.view_settings.plane_m
            patterns = independent_pattern_count(document.system, plane_m)
            histogram = speckle_histogram(xyz[..., 1], document.measured_region, patterns)
            shown = None if region.withheld else target
            retinal = _retinal(document, xyz, shown)
            if luminance is not None:
                curve = contrast_by_wavelength(
                    luminance.__getitem__, document.system, document.measured_region, plane_m, shown
                )
    except UserError as error:
        problem = str(error)
    profiles = tuple(_profiles(document, images))
    return ImageMeasurements(document, region, histogram, profiles, curve, problem, retinal, tuple(rows))


def _retinal(document: Document, xyz: Image, target: Image | None) -> RetinalContrast | None:
    """The measured region as cones see it; None without an eye."""
    if document.system.eye is None:
        return None
    return retinal_contrast(document.system, xyz[..., 1], document.measured_region, target)


def _profiles(document: Document, images: Sequence[ShownImage]) -> Iterator[LineProfile]:
    """Light along the line of the view settings; of images that the line leaves, none."""
    line = document.view_settings.profile
    for image in images if line is not None else ():
        with suppress(UserError):
            assert line is not None
            yield light_profile(image, line, document.sample_pitch_m)


# --- A score of the displayed image beside its target, kept up to date on a worker thread while the image changes ---


Measure = Callable[[Image, Image], float]
"""An image in XYZ (y, x, 3) and its target in linear sRGB to a score."""


_Request = tuple[Image, Image, Measure]


class LiveScore:
    """Measures the newest image in the background.

    name: of the thread. on_change: called on the owner's thread when there is a new result, or none can be had.
    """

    def __init__(self, name: str, session: EditingSession, on_change: Callable[[], None] = lambda: None) -> None:
        self._on_change, self._post_error = on_change, session.messages.post_error
        self._requested: _Request | None = None
        self._result: float | None = None
        self._failed: Measure | None = None
        self._task: LatestTask[float] = LatestTask(name, session.call_on_owner, self._on_error)

    @property
    def is_busy(self) -> bool:
        """Whether the newest image has no result yet."""
        return self._requested is not None and self._result is None and self._failed is None

    def get(self, xyz: Image, target: Image, measure: Measure) -> float | None:
        """The score of an image XYZ (y, x, 3) to a target (y, x, 3) in linear sRGB; None until it is measured.

        The arrays must not be changed afterwards. An error is posted once: the same measure isn't called again before
        another measure was. Images of another shape than the target have no score.
        """
        if xyz.shape != target.shape or measure == self._failed:
            return None
        if self._requested is None or not are_same(self._requested, (xyz, target, measure)):
            self._requested, self._result, self._failed = (xyz, target, measure), None, None
            self._task.submit(partial(measure, xyz, target), partial(self._on_result, self._requested))
        return self._result

    def close(self) -> None:
        """Ends the thread."""
        self._task.close()

    def _on_result(self, request: _Request, score: float) -> None:
        if request is self._requested:
            self._result, self._failed = score, None
            self._on_change()

    def _on_error(self, error: BaseException) -> None:
        self._failed = None if self._requested is None else self._requested[2]
        self._post_error(error)
        self._on_change()


def image_psnr_db(xyz: Image, target: Image) -> float:
    """PSNR (dB) of an image XYZ (y, x, 3) to a target (y, x, 3) in linear sRGB, both clipped to the range of a screen.

    Raises UserError when the shapes differ.
    """
    return psnr_linear_srgb(xyz_to_linear_srgb(xyz), target).mean_db


def difference_db(xyz: Image, other_xyz: Image) -> float:
    """How alike two images XYZ (y, x, 3) are: the PSNR (dB) of one to the other, both clipped to a screen's range."""
    return psnr_linear_srgb(xyz_to_linear_srgb(xyz), xyz_to_linear_srgb(other_xyz)).mean_db


@dataclass(frozen=True)
class ImageScore:
    """A perceptual score of an image XYZ (y, x, 3) to a target (y, x, 3) in linear sRGB.

    name: of the score. samples_per_degree: of visual angle. Called, it raises UserError when the score isn't installed.
    """

    name: str
    samples_per_degree: float

    def __call__(self, xyz: Image, target: Image) -> float:
        from holoview.holograms.metrics.perceptual import measure_score  # loads torch

        return measure_score(self.name, xyz_to_linear_srgb(xyz), target, self.samples_per_degree).mean


# --- Where the model isn't true of the displayed bench, found once for each bench and focal plane ---


class LimitNotes:
    """The limits of the model that the displayed bench exceeds at its planes and at the plane that is shown."""

    def __init__(self, session: EditingSession) -> None:
        self._session = session
        self._known: tuple[Any, ...] | None = None
        self._notes: tuple[str, ...] = ()

    @property
    def known(self) -> tuple[str, ...]:
        """The notes that were found last, which may be of the bench before it was dragged."""
        return self._notes

    def notes(self, picture: SeenPicture | None = None) -> tuple[str, ...]:
        """Each limit as a sentence; for a bench that can't be computed or displayed, only the reason.

        picture: of a field, by which it is known how much of its light is in the picture.
        """
        try:
            document = self._session.displayed_document
        except UserError as error:  # such as of lasers all of which are muted
            return (str(error),)
        system, plane_m = document.system, document.view_settings.plane_m
        seen = picture if system.is_field and picture is not None and picture[0].drive is document.drive else None
        seen = seen if seen is not None and seen[0].plane_m == plane_m else None
        key = (system, plane_m, None if seen is None else seen[1])
        if self._known is None or self._known[:2] != key[:2] or self._known[2] is not key[2]:
            self._known, self._notes = key, _notes(system, plane_m, seen)
        return self._notes


def _notes(system: System, plane_m: float, picture: SeenPicture | None) -> tuple[str, ...]:
    try:
        plan = make_plan(system, [*system.planes_m, plane_m])
    except UserError as error:
        return (str(error),)
    if picture is None:
        return exceeded_limits(plan)
    scene, xyz = picture
    share = luminance_share(make_plan(scene.system, [scene.plane_m]), scene.drive, xyz)
    at_edge = edge_power(scene.drive) if scene.plane_m else None  # at 0 nothing propagates
    return exceeded_limits(plan, LightFigures(share, scene.plane_m, at_edge))
