"""Places of the eye's pupil for an optimisation: `--pupils 3x3:0.8mm`, its targets, and scores between the places."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.commands.optimise_options import TargetSource
from holoview.io.hologram import Hologram
from holoview.metrics.image_quality import measure_image_quality
from holoview.model.focus import required_eye, with_pupil_at
from holoview.model.system import System
from holoview.numerics.fft_grid import positions
from holoview.numerics.image_region import Region, region_slices
from holoview.util import units
from holoview.util.errors import UserError
from holoview.view import simulate

Places = tuple[tuple[float, float], ...]

_TEXT = re.compile(r"(?P<rows>\d{1,2})x(?P<columns>\d{1,2}):(?P<spacing>.+)")
_MOST = 9  # along each axis


def parse_places(text: str | None, system: System) -> Places:
    """Places (y, x) around that of the system's eye, row by row, m; empty for None.

    Raises UserError for text of another form, and without an eye.
    """
    if text is None:
        return ()
    match = _TEXT.fullmatch(text)
    if match is None or not all(1 <= int(match[key]) <= _MOST for key in ("rows", "columns")):
        raise UserError(
            "--pupils", f'"{text}"', expected=f"rows x columns:spacing up to {_MOST}x{_MOST}, e.g. 3x3:0.8mm"
        )
    eye = required_eye(system, "--pupils")
    spacing_m = units.parse(match["spacing"], "--pupils")
    if not spacing_m > 0:
        raise UserError("--pupils", match["spacing"], expected="a spacing above 0")
    y, x = (
        centre + positions(int(match[key]), spacing_m)
        for key, centre in (("rows", eye.pupil_y_m), ("columns", eye.pupil_x_m))
    )
    return tuple((float(a), float(b)) for a in y for b in x)


def places_between(places: Places) -> Places:
    """The middles of the cells of a grid of places, for which nothing was optimised; empty for fewer than two."""
    y, x = (np.unique(axis) for axis in np.array(places).reshape(-1, 2).T)
    if len(places) < 2:
        return ()
    middle = [(axis[1:] + axis[:-1]) / 2 if len(axis) > 1 else axis for axis in (y, x)]
    return tuple((float(a), float(b)) for a in middle[0] for b in middle[1])


def target_at_places(source: TargetSource, system: System, places: Places) -> NDArray[np.float32]:
    """The focal stacks (place · plane, y, x, 3) as an eye at each place sees them; from its own place without any."""
    if not places:
        return source.build().stack
    if source.is_stack:
        raise UserError(
            "--pupils", "with a focal stack", expected="a picture with a depth map, which is seen from every place"
        )
    return np.concatenate([source.build(system=with_pupil_at(system, place)).stack for place in places])


def score_places(
    hologram: Hologram, source: TargetSource, places: Places, region: Region | None
) -> dict[str, list[float] | float]:
    """PSNR (dB) from each place, and from places between them, as JSON keys and values; empty without places."""
    if not places:
        return {}
    scores = {
        key: [_psnr_db(hologram, source, place, region) for place in some]
        for key, some in (("pupil_psnr_db", places), ("held_out_pupil_psnr_db", places_between(places)))
    }
    return {key: values for key, values in scores.items() if values}


def format_place_scores(scores: dict[str, Any]) -> list[str]:
    """The scores of `score_places` as lines of text."""
    lines = []
    for key, what in (("pupil_psnr_db", "from the pupil's places"), ("held_out_pupil_psnr_db", "between them")):
        if key in scores:
            values = scores[key]
            lines.append(f"{what}: {np.mean(values):.2f} dB, {min(values):.2f} to {max(values):.2f}")
    return lines


def _psnr_db(hologram: Hologram, source: TargetSource, place: tuple[float, float], region: Region | None) -> float:
    system = with_pupil_at(hologram.system, place)
    view, target = simulate(system, hologram.drive, backend="torch"), source.build(system=system).stack
    if region is not None:
        view, target = view.cropped(region), target[:, *region_slices(region)]
    return measure_image_quality(view, target).psnr.mean_db
