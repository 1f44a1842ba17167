"""`--pupils`: places that are understood and refused, and the middles between them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.commands.pupil_places import PupilPlaces, parse_places, places_between

Run = Callable[..., Any]

SYSTEM = hv.load("holochrome-8").with_(eye={"pupil_x": "1 mm"})


def test_a_grid_lies_around_the_pupil() -> None:
    places = parse_places("1x3:0.5mm", SYSTEM).fixed
    assert np.array(places) == pytest.approx(np.array([[0, 0.5e-3], [0, 1e-3], [0, 1.5e-3]]))
    assert np.array(places_between(places)) == pytest.approx(np.array([[0, 0.75e-3], [0, 1.25e-3]]))
    assert len(parse_places("3x3:0.5mm", SYSTEM).held_out) == 4
    assert parse_places(None, SYSTEM) == PupilPlaces() and parse_places("1x1:1mm", SYSTEM).held_out == ()


@pytest.mark.parametrize(
    "text", ["3", "3x3", "0x3:1mm", "99x99:1mm", "3x3:", "3x3:0mm", "3x3:-1mm", "3x3:1 kg", "axb:1mm"]
)
def test_what_is_no_grid_of_places_is_refused(text: str) -> None:
    with pytest.raises(hv.UserError, match="--pupils"):
        parse_places(text, SYSTEM)


def test_places_need_an_eye() -> None:
    with pytest.raises(hv.UserError, match="--pupils: without an eye"):
        parse_places("3x3:1mm", SYSTEM.with_(eye=None))


def test_a_hologram_is_scored_at_its_places_and_between_them(holoview: Run, tmp_path: Path) -> None:
    Image.new("RGB", (32, 24), "orange").save(tmp_path / "orange.png")
    bench = (
        "simultaneous",
        "orange.png",
        "--set",
        "shape=[12,16]",
        "--set",
        "eye.pupil=1 mm",
        "--set",
        "planes=['2 mm']",
    )
    outcome = holoview("optimise", *bench, "--pupils", "1x2:0.6mm", "--iterations", 2, "-o", "o.safetensors", "--json")
    assert outcome.code == 0, outcome.err
    found = json.loads(outcome.out)
    assert len(found["pupil_psnr_db"]) == 2 and len(found["held_out_pupil_psnr_db"]) == 1
