"""The table of regions and the profiles along a line, as text for the clipboard and as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.exports import check_suffix, with_default_suffix
from holoview.viewer.document.measurements import (
    PROFILE_CHANNELS,
    LineProfile,
    RegionRow,
    ShownImage,
    light_profile,
    measure_regions,
)

HEADINGS = (
    *("image", "region", "x", "y", "width", "height", "contrast", "standard_error", "withheld", "raw_contrast"),
    *("mean_luminance", "psnr_db", "delta_e2000"),
)
_PROFILE_HEADINGS = ("image", "distance_mm", *PROFILE_CHANNELS)


def region_rows(session: EditingSession, images: Sequence[ShownImage]) -> list[RegionRow]:
    """The measurements of all regions of images, the first of which is the displayed one.

    Raises UserError while there is no image.
    """
    _require_images(images)
    document = session.document
    return [row for image in images for row in measure_regions(image, document.measured_regions, document.image_shape)]


def table_cells(row: RegionRow) -> list[str]:
    """The cells of a row under HEADINGS; what isn't known is empty."""
    found = row.metrics
    cells = [row.image, row.name, *map(str, row.region)]
    if found is None:
        return [*cells, "", "", row.problem, "", "", "", ""]
    numbers = (found.raw_contrast, found.mean, found.psnr_db, found.delta_e)
    contrast = ["", ""] if found.contrast is None else [_number(found.contrast), _number(found.standard_error)]
    return [*cells, *contrast, found.withheld, *map(_number, numbers)]


def table_text(rows: Iterable[RegionRow]) -> str:
    """The table with tabs between cells, as spreadsheets and mails take it."""
    lines = [HEADINGS, *(table_cells(row) for row in rows)]
    return "\n".join("\t".join(cell.replace("\t", " ") for cell in line) for line in lines) + "\n"


def save_regions(session: EditingSession, path: Path, images: Sequence[ShownImage]) -> None:
    """Writes the table of regions as CSV. Raises UserError while there is no image."""
    _write(session, path, HEADINGS, map(table_cells, region_rows(session, images)), "regions")


def save_profile(session: EditingSession, path: Path, images: Sequence[ShownImage]) -> None:
    """Writes the light along the line as CSV: a row for each place, of one image after the other.

    Raises UserError without a line, and while there is no image.
    """
    _require_images(images)
    document = session.document
    line = document.view_settings.profile
    if line is None:
        raise UserError("profile", "no line", expected="one drawn on the image", remedy="press Shift+L and drag")
    same = [image for image in images if image.xyz.shape[:2] == document.image_shape]
    found = [light_profile(image, line, document.sample_pitch_m) for image in same]
    _write(session, path, _PROFILE_HEADINGS, (cells for of in found for cells in _profile_cells(of)), "profile")


def _profile_cells(profile: LineProfile) -> Iterable[list[str]]:
    for distance_m, values in zip(profile.distance_m, profile.values, strict=True):
        yield [profile.image, _number(distance_m * 1e3), *map(_number, values)]


def _write(
    session: EditingSession, path: Path, headings: Sequence[str], rows: Iterable[Sequence[str]], what: str
) -> None:
    file, text = check_suffix(with_default_suffix(path, ".csv"), (".csv",)), io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(headings)
    writer.writerows(rows)
    write_file(file, text.getvalue())
    session.messages.post(f"{what} written to {file}")


def _require_images(images: Sequence[ShownImage]) -> None:
    if not images:
        raise UserError("image", "is still being computed", remedy="try again in a moment")


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"
