"""Eyes that a hologram is optimised for: `--pupils`, `--chromatic` and `--views`; what is understood, and refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.holograms.hologram import load_hologram
from holoview.holograms.metrics.fidelity import psnr_linear_srgb
from holoview.holograms.optimise.checkpoint import load_checkpoint

Run = Callable[..., Any]

BARE = ("--set", "shape=[12,16]", "--iterations", 2, "-o", "o.safetensors", "--json")
SMALL = (*BARE, "--set", "eye.pupil=1 mm")


def _scores(holoview: Run, tmp_path: Path, *arguments: object, planes: str = "['2 mm', '2.4 mm']") -> dict[str, Any]:
    Image.new("RGB", (32, 24), "orange").save(tmp_path / "orange.png")
    outcome = holoview("optimise", "simultaneous", *SMALL, "--set", f"planes={planes}", *arguments)
    assert outcome.code == 0, outcome.err
    return dict(json.loads(outcome.out))


def test_a_hologram_is_scored_at_its_places_and_between_them(holoview: Run, tmp_path: Path) -> None:
    found = _scores(holoview, tmp_path, "orange.png", "--pupils", "1x2:0.6mm", planes="['2 mm']")
    assert len(found["pupil_psnr_db"]) == 2 and len(found["held_out_pupil_psnr_db"]) == 1
    assert "held_out_pupil_psnr_between_db" not in found


def test_drawn_places_are_scored_at_others_focused_between_the_planes_too(holoview: Run, tmp_path: Path) -> None:
    found = _scores(holoview, tmp_path, "orange.png", "--pupils", "random:2:0.5mm")
    assert len(found["held_out_pupil_psnr_db"]) == len(found["held_out_pupil_psnr_between_db"]) == 4
    assert "pupil_psnr_db" not in found


@pytest.mark.long
def test_a_draw_is_resumed_from_its_checkpoint(holoview: Run, tmp_path: Path) -> None:
    drawn = ("orange.png", "--pupils", "random:2:0.5mm")
    whole = _scores(holoview, tmp_path, *drawn)
    _scores(holoview, tmp_path, *drawn, "--checkpoint", "c.safetensors", "--until-psnr", "0.001")
    assert load_checkpoint(tmp_path / "c.safetensors").progress.iteration == 1
    assert _scores(holoview, tmp_path, *drawn, "--resume", "c.safetensors")["psnr_db"] == whole["psnr_db"]


def test_chromatic_aberration_is_ignored_in_the_optimisation_and_seen_in_the_score(
    holoview: Run, tmp_path: Path
) -> None:
    """As one optimises without, and then looks at it with."""
    found = _scores(holoview, tmp_path, "orange.png", "--chromatic", "ignore")
    kept = load_hologram(tmp_path / "o.safetensors")
    assert kept.system.eye is not None and kept.system.eye.chromatic
    blind = _scores(holoview, tmp_path, "orange.png", "--set", "eye.chromatic=false")
    drive = load_hologram(tmp_path / "o.safetensors").drive
    assert np.array_equal(kept.drive, drive) and found["psnr_db"] != blind["psnr_db"]
    target = hv.target_for(kept.system, tmp_path / "orange.png").stack
    view = hv.simulate(kept.system, drive, backend="torch")
    assert found["psnr_db"] == pytest.approx(psnr_linear_srgb(view.rgb, target).mean_db, abs=1e-3)


@pytest.mark.long
def test_a_folder_of_views_and_views_of_a_picture_are_targets(holoview: Run, tmp_path: Path) -> None:
    (tmp_path / "views").mkdir()
    for number in range(9):
        Image.new("RGB", (32, 24), "orange").save(tmp_path / "views" / f"view-{number}.png")
    spread = _scores(holoview, tmp_path, "orange.png", "--views", "5x5", "--pupils", "1x2:0.4mm")
    given = _scores(holoview, tmp_path, "views", "--views", "3x3:0.5mm", "--pupils", "1x2:0.4mm")
    (tmp_path / "views" / "views.toml").write_text('rows = 3\ncolumns = 3\nspacing = "0.5 mm"\n', encoding="utf-8")
    told = _scores(holoview, tmp_path, "views", "--pupils", "1x2:0.4mm", "--at", "2.2 mm")
    for found in (given, told):
        assert found["psnr_db"] == pytest.approx(spread["psnr_db"], abs=1e-2), "an even picture, from everywhere"
    assert len(told["held_out_psnr_planes_db"]) == 1 and len(told["held_out_pupil_psnr_between_db"]) == 1
    drawn = _scores(holoview, tmp_path, "views", "--pupils", "random:2:0.2mm")
    assert len(drawn["held_out_pupil_psnr_db"]) == 4


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("orange.png", "--views", "5"), '--views: "5"; expected rows x columns'),
        (("orange.png", "--views", "0x5"), "--views: rows: 0; expected a whole number"),
        (("orange.png", "--views", "3x3:0.1mm"), "reaches beyond the views"),
        (("orange.png", "--views", "3x3", "no eye"), "--views: without an eye"),
        (("orange.png", "--chromatic", "ignore", "no eye"), "--chromatic: without an eye"),
        (("views", "--views", "2x2:0.5mm"), "views: holds 1 picture; expected 4"),
        (("views", "--views", "1x1:0.5mm", "--depth", "d.png"), "--depth: with a folder of views"),
        (("views", "--pupils", "random:2:0.5mm"), "--pupils: with a focal stack"),
    ],
)
def test_contradictions_are_refused(holoview: Run, tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    (tmp_path / "views").mkdir()
    for name in ("orange.png", "views/0.png", "d.png"):
        Image.new("RGB", (32, 24), "orange").save(tmp_path / name)
    bench = BARE if "no eye" in arguments else SMALL
    chosen = [argument for argument in arguments if argument != "no eye"]
    outcome = holoview("optimise", "simultaneous", *bench, "--set", "planes=['2 mm']", *chosen)
    assert outcome.code == 2 and words in outcome.err, outcome.err
