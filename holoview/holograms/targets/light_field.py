"""A light field: pictures of a scene from a grid of viewpoints in the eyebox, and its picture through a pupil there.

A viewpoint at p in the eyebox, behind an eyepiece of focal length f, sees the scene by the light of slope p/f, which is
a `LightCone` without width. Each view shows things at the distance z₀ (zero disparity) in the same place; others at z
are moved by (z₀ − z)·p/f. An eye that is focused on the plane z′ sees the mean of the views in its pupil, each moved by

    (z′ − z₀)·p/f

so that what stands at z′ falls together and the rest spreads over the pupil's disc (shift and add: Ng et al., Light
field photography with a hand-held plenoptic camera, Stanford CSTR 2005-02). Each view stands for the square of the
eyebox around it, and has the weight of the pupil's share in that square. Occlusion differs from view to view, so
that the mean has the true occlusion of a finite pupil.

Limits: out of focus by Δz, neighbouring views lie spacing·Δz/f apart. Beyond a sample or two, edges show this step.
Views are moved by fractions of a sample by linear interpolation.

`ViewingPupil` shows a target as it is seen through a round pupil: perhaps off the axis, and in focus elsewhere at each
wavelength.

A pupil passes the directions |s − c| ≤ NA, where s is a direction's sine in y and x. Its blur is a disc of diameter
2·NA·Δz, moved by c·Δz. An eye with longitudinal chromatic aberration focuses each wavelength at a distance of its own.
A target holds three colours, so that its light is spread over the display's lasers first: linear sRGB C becomes

    C = Σ_λ M_λ·C,    M_λ = w_λ·P_λ + (1 − W·P)/n

with the n lasers' colours at unit intensity w_λ, the columns of W (3, wavelength), and its pseudo-inverse P: of all
mixtures of the colour, the one with the least sum of squared intensities. A colour that fewer than three lasers can't
mix is spread evenly. M_λ·C is blurred for the focus of λ, and the results are added. Blur and occlusion act on all
colours of a wavelength alike, so that M_λ is applied to what they give: all wavelengths share the layers of the scene.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.targets.defocus import LightCone, blur_kernel
from holoview.holograms.targets.focal_stack import image_files, merge_notes, read_resized_pictures, render_focal_stack
from holoview.holograms.targets.picture import check_saturation, scale_saturation
from holoview.light.model.fields import Description, Integer, Number, described_field, from_mapping, validate
from holoview.light.model.focus import parse_plane, required_eye
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.numerics.sampling import positions
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.files import read_text
from holoview.util.tables import parse_toml

_MOST_BYTES = 2**28  # of the pictures that are computed at a time


@dataclass(frozen=True, eq=False)
class ViewingPupil:
    """The pupil through which a target is seen.

    na: sine of the half angle that it takes up, above 0 and below 1. centre: sines (y, x) of the direction of its
    middle; x > 0 is passed by light that goes towards larger x.
    focus_m: distances z (plane, wavelength) where each wavelength is in focus while the eye looks at a plane, m; the
    plane itself when None.

    offsets_m: displacement of each wavelength's picture, (wavelength, 2) y and x, m; none when None.

    Raises ValueError for numbers that make no sense.

    >>> ViewingPupil(0.02, centre=(0.0, 0.01)).cone().centre
    (0.0, 0.01)
    """

    na: float
    centre: tuple[float, float] = (0.0, 0.0)
    focus_m: NDArray[np.float64] | None = None
    offsets_m: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        if not (0 < self.na < 1 and all(-1 < sine < 1 for sine in self.centre)):
            raise ValueError(f"pupil of NA {self.na} about {self.centre}: expected sines, and an NA above 0")
        if self.focus_m is not None and not (np.ndim(self.focus_m) == 2 and np.isfinite(self.focus_m).all()):
            raise ValueError("focus_m: expected finite distances (plane, wavelength)")

    def cone(self, wavelength: int = 0) -> LightCone:
        """The light cone that reaches the retina from an image point, at the wavelength of an index."""
        offset = (0.0, 0.0) if self.offsets_m is None else tuple(self.offsets_m[wavelength].tolist())
        return LightCone(self.na, "disc", self.centre, (offset[0], offset[1]))


def render_through_pupil(
    rgb_linear: NDArray[np.float32],
    depth_m: float | NDArray[np.floating],
    planes_m: Sequence[float] | NDArray[np.floating],
    pitch_m: float,
    pupil: ViewingPupil,
    laser_rgb: NDArray[np.float64],
) -> NDArray[np.float32]:
    """The focal stack (plane, y, x, 3) of a picture as an eye sees it through a pupil, float32.

    laser_rgb: (wavelength, 3) linear sRGB of each laser at unit intensity, which matter if `pupil.focus_m` is given.
    The other arguments are those of `render_focal_stack`.

    Raises ValueError as that does, and if `pupil.focus_m` isn't (plane, wavelength).
    """
    if pupil.focus_m is None:
        return render_focal_stack(rgb_linear, depth_m, planes_m, pitch_m, pupil.cone())
    return sum_over_wavelengths(
        lambda focus_m, cones: render_focal_stack(rgb_linear, depth_m, focus_m, pitch_m, cones),
        (len(planes_m), *rgb_linear.shape),
        pupil,
        laser_rgb,
    )


def sum_over_wavelengths(
    render: Callable[[Sequence[float], Sequence[LightCone]], NDArray[np.float32]],
    shape: tuple[int, ...],
    pupil: ViewingPupil,
    laser_rgb: NDArray[np.float64],
) -> NDArray[np.float32]:
    """The focal stack of shape (plane, y, x, 3) that a pupil sees with its own focus for each wavelength, float32.

    render: from distances (n,) in focus, and as many cones, to what is seen there in all colours, (n, y, x, 3).

    Raises ValueError if `pupil.focus_m` isn't (plane, wavelength).
    """
    expected = (shape[0], len(laser_rgb))
    if pupil.focus_m is None or pupil.focus_m.shape != expected:
        found = None if pupil.focus_m is None else pupil.focus_m.shape
        raise ValueError(f"focus_m {found}: expected (plane, wavelength) = {expected}")
    total = np.zeros(shape, dtype=np.float32)
    shares = colour_shares(laser_rgb).astype(np.float32)
    pairs = list(np.ndindex(*expected))
    at_a_time = max(_MOST_BYTES // (16 * shape[1] * shape[2]), 1)
    for start in range(0, len(pairs), at_a_time):
        some = pairs[start : start + at_a_time]
        seen = render([float(pupil.focus_m[pair]) for pair in some], [pupil.cone(wavelength) for _, wavelength in some])
        for (plane, wavelength), light in zip(some, seen, strict=True):
            total[plane] += light @ shares[wavelength].T
    return total


def colour_shares(laser_rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrices M_λ (wavelength, 3, 3) that give each laser's part of a colour; their sum is the unit matrix.

    laser_rgb: (wavelength, 3) linear sRGB of each laser at unit intensity.
    """
    mixture = np.linalg.pinv(laser_rgb.T)
    own = laser_rgb[:, :, None] * mixture[:, None, :]
    return np.asarray(own + (np.eye(3) - own.sum(axis=0)) / len(laser_rgb))


# --- light fields -----------------------------------------------------------------------------------------------------


_LEAST_ACROSS = 2  # views across a pupil: with fewer, things out of focus are doubled rather than blurred
_ROUNDING = 1e-6  # of a pupil's area, which may lie beyond the views


@dataclass(frozen=True, eq=False)
class LightField:
    """Views (row, column, y, x, 3) float32 in linear light, on the simulation grid of a bench.

    Rows go downwards and columns to the right as the viewer moves in the eyebox, and as `Eye.pupil_y_m` and
    `Eye.pupil_x_m` do. spacing_m: of the viewpoints. centre_m: place (y, x) of the grid's middle in the eyebox.
    zero_m: distance z behind the last modulator at which things are in the same place in all views.
    eyepiece_m: focal length of the eyepiece. source: in words. notes: changes that were made on the way, for the user.

    Raises ValueError for other shapes, and lengths that aren't positive.
    """

    views: NDArray[np.float32]
    spacing_m: float
    zero_m: float
    eyepiece_m: float
    centre_m: tuple[float, float] = (0.0, 0.0)
    source: str = "light field"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.views.ndim != 5 or self.views.shape[-1] != 3 or self.views.size == 0:
            raise ValueError(f"views {self.views.shape}: expected (row, column, y, x, 3)")
        if not (0 < self.spacing_m < math.inf and 0 < self.eyepiece_m < math.inf and math.isfinite(self.zero_m)):
            raise ValueError(f"views {self.spacing_m} m apart behind {self.eyepiece_m} m: expected positive lengths")

    @property
    def slopes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The slopes p/f of the rows' and of the columns' viewpoints."""
        return view_slopes(self.views.shape[:2], self.spacing_m, self.centre_m, self.eyepiece_m)


def view_slopes(
    grid: tuple[int, ...], spacing_m: float, centre_m: tuple[float, float], eyepiece_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The slopes p/f of the rows and of the columns of a grid (rows, columns) of viewpoints."""
    y, x = ((middle + positions(n, spacing_m)) / eyepiece_m for n, middle in zip(grid, centre_m, strict=True))
    return y, x


def render_views(
    rgb_linear: NDArray[np.float32],
    depth_m: float | NDArray[np.floating],
    pitch_m: float,
    grid: tuple[int, int],
    spacing_m: float,
    centre_m: tuple[float, float],
    zero_m: float,
    eyepiece_m: float,
) -> LightField:
    """The light field of a picture (y, x, 3) with depth: grid (rows, columns) of views, with occlusion.

    depth_m: distance z of each pixel (y, x) or of all, m; larger is nearer to the viewer. The others are those of
    `LightField`. Parts of the picture that near things hide are filled in from their surroundings, see
    `render_focal_stack`.
    """
    y, x = view_slopes(grid, spacing_m, centre_m, eyepiece_m)
    cones = [LightCone(0.0, "disc", (a, b)) for a in y.tolist() for b in x.tolist()]
    views = render_focal_stack(rgb_linear, depth_m, [zero_m] * len(cones), pitch_m, cones)
    return LightField(views.reshape(*grid, *rgb_linear.shape), spacing_m, zero_m, eyepiece_m, centre_m)


def see_light_field(
    field: LightField,
    planes_m: Sequence[float] | NDArray[np.floating],
    pitch_m: float,
    pupil: ViewingPupil,
    laser_rgb: NDArray[np.float64],
) -> NDArray[np.float32]:
    """The focal stack (plane, y, x, 3) float32 of a light field as an eye sees it through a pupil.

    planes_m: distances z (n,) on which it is focused. laser_rgb: (wavelength, 3) linear sRGB of each laser at unit
    intensity, which matter if `pupil.focus_m` is given.

    Raises UserError for a pupil that reaches beyond the views, or is too small for them.
    """
    if pupil.focus_m is None:
        return refocus(field, planes_m, pitch_m, pupil.cone())
    return sum_over_wavelengths(
        lambda focus_m, cones: refocus(field, focus_m, pitch_m, cones),
        (len(planes_m), *field.views.shape[2:]),
        pupil,
        laser_rgb,
    )


def refocus(
    field: LightField,
    focus_m: Sequence[float] | NDArray[np.floating],
    pitch_m: float,
    cone: LightCone | Sequence[LightCone],
) -> NDArray[np.float32]:
    """The pictures of a light field on planes at the distances focus_m (n,): (n, y, x, 3) float32.

    cone: of the pupil, one for all planes or one for each. Raises UserError as `see_light_field` does.
    """
    cones = [cone] * len(focus_m) if isinstance(cone, LightCone) else list(cone)
    weights = {one: view_weights(field, one) for one in dict.fromkeys(cones)}
    shifts = [_shifts_px(field, z, pitch_m, one) for z, one in zip(np.asarray(focus_m).tolist(), cones, strict=True)]
    margin = 1 + max(math.ceil(np.abs(axis).max()) for pair in shifts for axis in pair)
    used = np.sum([weight > 0 for weight in weights.values()], axis=0, dtype=bool)
    padding = ((margin, margin), (margin, margin), (0, 0))
    padded = {
        (row, column): np.moveaxis(np.pad(field.views[row, column], padding, mode="edge"), -1, 0)
        for row, column in np.argwhere(used).tolist()
    }
    seen = [
        _shift_and_add(padded, weights[one], shift, field.views.shape[2:4], margin)
        for one, shift in zip(cones, shifts, strict=True)
    ]
    return np.ascontiguousarray(np.moveaxis(np.stack(seen), 1, -1))


def view_weights(field: LightField, cone: LightCone) -> NDArray[np.float32]:
    """The share (row, column) of a pupil's area in the square around each viewpoint; their sum is 1.

    Raises UserError for a pupil that reaches beyond the views, or has fewer than two of them across.
    """
    rows, columns = field.views.shape[:2]
    step = field.spacing_m / field.eyepiece_m
    radius = cone.half_width / step
    if 2 * radius < _LEAST_ACROSS * (1 - _ROUNDING):
        apart, wide = (
            units.format_rounded(length_m, "mm") for length_m in (field.spacing_m, 2 * radius * field.spacing_m)
        )
        raise UserError(
            field.source,
            f"its views are {apart} apart, the pupil {wide} wide",
            expected=f"at least {_LEAST_ACROSS} views across the pupil",
            remedy="give more views or a wider pupil",
        )
    middle = [slopes.mean() for slopes in field.slopes]
    at = [(c - m) / step + (n - 1) / 2 for c, m, n in zip(cone.centre, middle, (rows, columns), strict=True)]
    nearest = [round(place) for place in at]
    kernel = blur_kernel(radius, cone.aperture, (at[0] - nearest[0], at[1] - nearest[1]))
    reach = len(kernel) // 2
    weights = np.zeros((rows, columns))
    (top, bottom), (left, right) = (
        (max(place - reach, 0), min(place + reach + 1, n)) for place, n in zip(nearest, (rows, columns), strict=True)
    )
    if top < bottom and left < right:
        first_row, first_column = nearest[0] - reach, nearest[1] - reach
        weights[top:bottom, left:right] = kernel[
            top - first_row : bottom - first_row, left - first_column : right - first_column
        ]
    if weights.sum() < 1 - _ROUNDING:
        raise _beyond_error(field, cone)
    return np.asarray(weights / weights.sum(), dtype=np.float32)


def largest_step_px(field: LightField, planes_m: NDArray[np.floating], pitch_m: float) -> float:
    """How many samples neighbouring views are apart of something on one of the planes, at most, seen on another."""
    return float(np.ptp(planes_m)) * field.spacing_m / field.eyepiece_m / pitch_m


def _shifts_px(
    field: LightField, z_m: float, pitch_m: float, cone: LightCone
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far the rows' views move along y, and the columns' views along x, in samples, for a focus at z."""
    distance_m, (rows, columns) = z_m - field.zero_m, field.slopes
    y = [LightCone(0.0, "disc", (c, 0.0), cone.offset_m).shift_px(distance_m, pitch_m)[0] for c in rows.tolist()]
    x = [LightCone(0.0, "disc", (0.0, c), cone.offset_m).shift_px(distance_m, pitch_m)[1] for c in columns.tolist()]
    return np.array(y), np.array(x)


def _shift_and_add(
    padded: dict[tuple[int, int], NDArray[np.float32]],
    weights: NDArray[np.float32],
    shifts: tuple[NDArray[np.float64], NDArray[np.float64]],
    shape: tuple[int, int],
    margin: int,
) -> NDArray[np.float32]:
    """The weighted mean (3, y, x) of views that are moved. padded: (3, y, x) by row and column, with a margin."""
    total = np.zeros((3, *shape), dtype=np.float32)
    for row in np.flatnonzero(weights.any(axis=1)).tolist():
        line = np.zeros((3, shape[0] + 2 * margin, shape[1]), dtype=np.float32)
        for column in np.flatnonzero(weights[row]).tolist():
            for start, share in _taps(float(shifts[1][column]), margin):
                line += np.float32(share * weights[row, column]) * padded[row, column][..., start : start + shape[1]]
        for start, share in _taps(float(shifts[0][row]), margin):
            total += np.float32(share) * line[:, start : start + shape[0]]
    return total


def _taps(shift: float, margin: int) -> list[tuple[int, float]]:
    """Where a slice begins in samples with a margin, for a picture that moves by `shift`, and its share: linear."""
    whole = math.floor(shift)
    rest = shift - whole
    return [(start, share) for start, share in ((margin - whole, 1 - rest), (margin - whole - 1, rest)) if share]


def _beyond_error(field: LightField, cone: LightCone) -> UserError:
    """The error for a pupil that sees where there are no views."""
    f, (rows, columns) = field.eyepiece_m, field.views.shape[:2]
    place = ", ".join(units.format_rounded(slope * f, "mm", 3) for slope in reversed(cone.centre))
    sides = [n * field.spacing_m for n in (columns, rows)]
    size, at = (
        ", ".join(units.format_rounded(a, "mm", 3) for a in values) for values in (sides, reversed(field.centre_m))
    )
    return UserError(
        field.source,
        f"the pupil of {units.format_rounded(2 * cone.half_width * f, 'mm', 3)} at x, y = {place} reaches beyond the "
        f"views, which stand for {size} about {at}",
        expected="views wherever the pupil is",
        remedy="give more views, or bring the pupil's places together",
    )


# --- a folder: one picture for each viewpoint, and `views.toml` that says where they are ------------------------------

# rows = 5                    # of viewpoints in the eyebox, downwards as the viewer moves
# columns = 5                 # to the right
# spacing = "0.5 mm"          # of neighbouring viewpoints
# zero_disparity = "10 mm"    # the distance z at which things are in the same place in all views, or "0.6 D"
# pupil_x = "0 mm"            # place of the grid's middle in the eyebox; pupil_y downwards
#
# The pictures are in the order of the numbers in their names, row by row: view-1.png … view-25.png, or view-1-1.png,
# view-1-2.png … view-5-5.png by row and column.


DESCRIPTION_FILE = "views.toml"

_SPACING = Number("mm", low=1e-6, high=0.1)
_PLACE = Number("mm", low=-0.1, high=0.1)
_MOST = 99


@dataclass(frozen=True, eq=False)
class ViewGrid(Description):
    """A grid of viewpoints in the eyebox.

    rows, columns: numbers of viewpoints. spacing_m: of neighbouring ones, m; None where it has to be found.
    pupil_y_m, pupil_x_m: place of the grid's middle, m.

    Lengths may be text such as "0.5 mm". Raises UserError for values out of range.
    """

    rows: int = described_field(Integer(1, _MOST), "Rows of viewpoints, downwards.")
    columns: int = described_field(Integer(1, _MOST), "Columns of viewpoints, to the right.")
    spacing_m: float | None = described_field(
        replace(_SPACING, optional=True), "Distance of neighbouring viewpoints in the eyebox.", default=None
    )
    pupil_y_m: float = described_field(_PLACE, "Place of the grid's middle in the eyebox, downwards.", default=0.0)
    pupil_x_m: float = described_field(_PLACE, "Place of the grid's middle in the eyebox, to the right.", default=0.0)

    def __post_init__(self) -> None:
        validate(self)

    @property
    def centre_m(self) -> tuple[float, float]:
        """Place (y, x) of the grid's middle in the eyebox, m."""
        return self.pupil_y_m, self.pupil_x_m


def is_light_field(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a folder that says where its pictures were seen from."""
    return (Path(path) / DESCRIPTION_FILE).is_file()


def read_light_field(
    system: System,
    folder: str | os.PathLike[str],
    grid: ViewGrid | None = None,
    zero_m: float | None = None,
    *,
    saturation: float = 1.0,
    space: str = "srgb",
) -> LightField:
    """The light field of a folder, each view resized to the simulation grid of a system with an eye.

    grid: used instead of that of `views.toml`, or where the folder has none. zero_m: the distance of zero disparity
    where `views.toml` states none; the middle plane when None. saturation: factor on chroma in CIE LCHuv. space: the
    colour space of float files, "srgb" or "xyz".

    Raises UserError without an eye, and for views that are missing, can't be read or differ in size.
    """
    check_saturation(saturation)
    path, eye = Path(folder), required_eye(system, str(folder))
    if not path.is_dir():
        raise UserError(str(path), "is a file", expected="a folder of views")
    table = _description(path)
    zero = table.pop("zero_disparity", None)
    where = str(path / DESCRIPTION_FILE)
    if grid is None:
        try:
            grid = from_mapping(ViewGrid, table)
        except UserError as error:
            raise error.inside(f"{where}: ") from error
    if grid.spacing_m is None:
        raise UserError(where, "no spacing", expected='that of the viewpoints, e.g. spacing = "0.5 mm"')
    if zero is not None:
        zero_m = parse_plane(system, str(zero), f"{where}: zero_disparity")
    files = image_files(path)
    _check_count(path, files, grid)
    pictures = read_resized_pictures(files, make_plan(system).grid.shape, space)
    views = np.stack([scale_saturation(picture.rgb, saturation) for picture in pictures])
    return LightField(
        views.reshape(grid.rows, grid.columns, *views.shape[1:]),
        grid.spacing_m,
        float(np.median(system.planes_m)) if zero_m is None else zero_m,
        eye.eyepiece_m,
        grid.centre_m,
        str(path),
        merge_notes(pictures),
    )


def _description(folder: Path) -> dict[str, Any]:
    """The table of `views.toml`; empty without the file."""
    path = folder / DESCRIPTION_FILE
    if not path.is_file():
        return {}
    return parse_toml(read_text(path, "TOML"), str(path), "TOML")


def _check_count(folder: Path, files: list[Path], grid: ViewGrid) -> None:
    """Raises UserError unless there is a picture for each viewpoint; the error names missing ones, if it can tell."""
    if len(files) == grid.rows * grid.columns:
        return
    plural = "s" * (len(files) != 1)
    raise UserError(
        str(folder),
        f"holds {len(files)} picture{plural}{_missing(files, grid)}",
        expected=f"{grid.rows * grid.columns}, one for each viewpoint in {grid.rows} rows and {grid.columns} columns",
        remedy="render those that are missing, take out what is no view, or correct rows and columns",
    )


def _missing(files: list[Path], grid: ViewGrid) -> str:
    """The viewpoints that no name has, in words, where names end in row and column; "" elsewhere."""
    numbers = [[int(part) for part in re.findall(r"\d+", file.stem)[-2:]] for file in files]
    if not numbers or any(len(pair) != 2 for pair in numbers):
        return ""
    first = [min(axis) for axis in zip(*numbers, strict=True)]
    expected = [[first[0] + r, first[1] + c] for r in range(grid.rows) for c in range(grid.columns)]
    missing = [f"{r}-{c}" for r, c in expected if [r, c] not in numbers]
    some = ", ".join(missing[:3]) + (" …" if len(missing) > 3 else "")
    return f" and lacks those of row and column {some}" if missing else ""
