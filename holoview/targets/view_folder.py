"""Reads a light field from a folder: one picture for each viewpoint, and `views.toml` that says where they are.

    rows = 5                    # of viewpoints in the eyebox, downwards as the viewer moves
    columns = 5                 # to the right
    spacing = "0.5 mm"          # of neighbouring viewpoints
    zero_disparity = "10 mm"    # the distance z at which things are in the same place in all views, or "0.6 D"
    pupil_x = "0 mm"            # place of the grid's middle in the eyebox; pupil_y downwards

The pictures are in the order of the numbers in their names, row by row: view-1.png … view-25.png, or view-1-1.png,
view-1-2.png … view-5-5.png by row and column.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from holoview.model.dataclass_fields import Description, described_field, from_mapping, validate
from holoview.model.field_types import Integer, Number
from holoview.model.focus import parse_plane, required_eye
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.targets.light_field import LightField
from holoview.targets.rendered_stacks import image_files, merge_notes, read_resized_pictures
from holoview.targets.saturation import check_saturation, scale_saturation
from holoview.util.errors import UserError
from holoview.util.input_file import read_text
from holoview.util.tables import parse_toml

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
    where `views.toml` states none; the middle plane when None. saturation: factor on chroma in CIE LCHuv. space: what
    float files hold, "srgb" or "xyz".

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
    """Raises UserError unless there is a picture for each viewpoint; it names those that are missing, as it can."""
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
