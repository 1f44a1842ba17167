"""What `holoview optimise` can be asked for, and what it refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from holoview.holograms.files.pictures import memory_cells
from holoview.holograms.hologram import load_hologram
from holoview.holograms.optimise.forward_model import ForwardModel

Run = Callable[..., Any]

QUICK = ("--set", "shape=[24,32]", "--iterations", "3", "-o", "h.safetensors")


def _table(holoview: Run, *arguments: object) -> dict[str, Any]:
    outcome = holoview("optimise", *arguments, "--json")
    assert outcome.code == 0, outcome.err
    return dict(json.loads(outcome.out))


@pytest.mark.parametrize("loss", ["linear-srgb", "srgb", "xyz", "lms", "luminance", "mono"])
def test_every_loss_runs_and_is_scored_alike(loss: str, holoview: Run, picture: Path) -> None:
    table = _table(holoview, "simultaneous", picture, *QUICK, "--loss", loss)
    assert table["loss"] > 0
    assert np.isfinite(table["psnr_db"])
    assert table["eyebox_uniformity"] > 0


def test_planes_between_those_that_were_asked_for_are_scored(holoview: Run, picture: Path) -> None:
    table = _table(holoview, "simultaneous", picture, *QUICK)
    assert table["held_out_planes_mm"] == [9.25, 9.75, 10.25, 10.75]
    assert len(table["held_out_psnr_planes_db"]) == 4
    assert table["held_out_psnr_db"] == pytest.approx(np.mean(table["held_out_psnr_planes_db"]))


def test_a_scheme_drives_another_bench(holoview: Run, tmp_path: Path, picture: Path) -> None:
    _table(holoview, "holochrome-8", picture, *QUICK, "--scheme", "time-sequential")
    system = load_hologram(tmp_path / "h.safetensors").system
    assert system.amplitudes.shape == (3, 3)
    assert ((system.amplitudes > 0) == np.eye(3, dtype=bool)).all()


def test_free_wavelengths_move_and_are_told(holoview: Run, tmp_path: Path, picture: Path) -> None:
    everything = ("--free", "patterns,amplitudes,wavelengths", "--wavelength-range", "450", "650", "--iterations", "12")
    table = _table(holoview, "simultaneous", picture, *QUICK, *everything)
    assert table["wavelengths_nm"] != [460, 532, 638]
    assert min(table["wavelengths_nm"]) >= 450 and max(table["wavelengths_nm"]) <= 650
    found = load_hologram(tmp_path / "h.safetensors").system.wavelengths_m * 1e9
    np.testing.assert_allclose(found, table["wavelengths_nm"], atol=1e-3)


def test_a_ready_stack_is_aimed_at(holoview: Run, tmp_path: Path) -> None:
    light = np.random.default_rng(0).random((5, 48, 64, 3)).astype(np.float32)
    tifffile.imwrite(tmp_path / "stack.tif", light, photometric="rgb")
    table = _table(holoview, "simultaneous", "stack.tif", *QUICK, "--saturation", "0.5")
    assert len(table["psnr_planes_db"]) == 5
    assert table["held_out_psnr_db"] is None


def test_the_preview_is_the_middle_plane(holoview: Run, tmp_path: Path, picture: Path) -> None:
    _table(holoview, "simultaneous", picture, *QUICK, "--preview", "now.png")
    with Image.open(tmp_path / "now.png") as image:
        assert image.size == (64, 48)
        assert image.text["holoview.iteration"] == "3"
        assert np.asarray(image).std() > 10


def test_a_region_and_a_margin_say_what_counts(holoview: Run, picture: Path) -> None:
    region = _table(holoview, "simultaneous", picture, *QUICK, "--region", "8,8,48,32")
    margin = _table(holoview, "simultaneous", picture, *QUICK, "--margin", "8")
    assert region["psnr_db"] == margin["psnr_db"]
    assert region["psnr_db"] != _table(holoview, "simultaneous", picture, *QUICK)["psnr_db"]


def test_patterns_leave_for_a_phase_light_modulator_as_memory_cells(
    holoview: Run, tmp_path: Path, picture: Path
) -> None:
    assert holoview("optimise", "simultaneous", picture, *QUICK, "--set", "levels=16").code == 0
    assert holoview("export", "h.safetensors", "--png", "cells", "--cells", "p67").code == 0
    assert holoview("export", "h.safetensors", "--png", "levels", "--levels").code == 0
    with Image.open(tmp_path / "cells" / "slm2.png") as cells, Image.open(tmp_path / "levels" / "slm2.png") as levels:
        np.testing.assert_array_equal(np.asarray(cells), 255 * memory_cells(np.asarray(levels), "p67"))


def test_memory_cells_need_as_many_levels_as_the_device_has(holoview: Run, picture: Path) -> None:
    assert holoview("optimise", "simultaneous", picture, *QUICK, "--set", "levels=8").code == 0
    outcome = holoview("export", "h.safetensors", "--png", "cells", "--cells", "p67")
    assert (outcome.code, outcome.err) == (2, "holoview: --cells: 8 levels; expected 16, as p67 has\n")


REFUSED: list[tuple[list[str], str]] = [
    (["--free", "pattern"], 'free: "pattern"; expected patterns, amplitudes, wavelengths; did you mean patterns?'),
    (["--free", ","], "free: nothing; expected at least one"),
    (["--region", "1,2,3"], '--region: "1,2,3"; expected x,y,width,height'),
    (["--region", "0,0,65,48"], "expected inside the simulated 64 x 48 samples"),
    (["--region", "a,b,c,d"], "expected x,y,width,height in whole samples"),
    (["--region", "9" * 5000 + ",0,9,9"], "expected x,y,width,height in whole samples"),
    (["--margin", "24"], "--margin: 24; expected 0 to 23 samples"),
    (["--margin", "2", "--region", "0,0,9,9"], "--margin with --region: contradict each other"),
    (["--plane-weights", "1,2"], "plane weights: 2 of them; expected one for each of 5 planes"),
    (["--plane-weights", "0,0,0,0,0"], "one of them positive"),
    (["--eyebox", "-1"], "eyebox: -1.0; expected a weight of 0 or more"),
    (["--saturation", "-2"], "--saturation: -2.0; expected a factor of 0 or more"),
    (["--scheme", "sequential"], 'scheme: "sequential"; expected simultaneous'),
    (["--device", "abacus"], 'device: "abacus" isn\'t available; expected one of'),
    (["--space", "xyz"], "picture.png: holds integers"),
    (["--preview", "now.jpg"], 'now.jpg: the suffix ".jpg"; expected .png'),
    (
        ["--free", "wavelengths", "--wavelength-range", "500", "505"],
        "wavelength range: 500 to 505 nm for 3 lasers 4 nm apart; expected at least 8 nm",
    ),
    (["--observers", "20"], "observers: with fixed wavelengths"),
]


@pytest.mark.parametrize(("arguments", "words"), REFUSED, ids=lambda v: " ".join(v)[:50] if isinstance(v, list) else "")
def test_a_mistake_is_refused_in_a_line_and_writes_nothing(
    holoview: Run, tmp_path: Path, picture: Path, arguments: list[str], words: str
) -> None:
    outcome = holoview("optimise", "simultaneous", picture, *QUICK, *arguments)
    assert outcome.code == 2, outcome.out
    assert words in outcome.err
    assert not (tmp_path / "h.safetensors").exists()


def test_too_little_memory_says_how_much_is_needed_and_what_to_lower(
    holoview: Run, tmp_path: Path, picture: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise RuntimeError("[enforce fail at alloc_cpu.cpp] DefaultCPUAllocator: can't allocate memory")

    monkeypatch.setattr(ForwardModel, "process_planes", full)
    outcome = holoview("optimise", "simultaneous", picture, *QUICK)
    assert outcome.code == 2
    assert "needs about " in outcome.err and "GiB of memory" in outcome.err
    assert "lower shape, upsample, frames" in outcome.err
    assert not (tmp_path / "h.safetensors").exists()


def test_named_methods_give_scored_holograms_and_say_what_they_do(holoview: Run, tmp_path: Path, picture: Path) -> None:
    for method, iterations in (("double-phase", 0), ("gerchberg-saxton", 2)):
        given = ("--iterations", str(iterations)) if iterations else ()
        size = ("--set", "shape=[24,32]", "-o", "h.safetensors", "--method", method, "--json")
        outcome = holoview("optimise", "simultaneous", picture, *size, *given)
        assert outcome.code == 0, outcome.err
        assert "the second modulator stays flat" in outcome.err
        table = json.loads(outcome.out)
        assert table["iterations"] == iterations and np.isfinite(table["psnr_db"])
        drive = load_hologram(tmp_path / "h.safetensors").drive
        assert drive[:, 0].any() and not drive[:, 1].any()


@pytest.mark.parametrize(
    "options",
    [("--checkpoint", "c.safetensors"), ("--loss", "srgb"), ("--film",), ("--rig", "rig.toml"), ("--sharded",)],
)
def test_options_of_the_optimiser_are_refused_with_a_named_method(
    options: tuple[str, ...], holoview: Run, picture: Path
) -> None:
    (picture.parent / "rig.toml").touch()
    outcome = holoview("optimise", "simultaneous", picture, "--method", "gerchberg-saxton", *options)
    assert outcome.code != 0
    assert "--method gerchberg-saxton" in outcome.err
    assert not (picture.parent / "simultaneous-picture.safetensors").exists()


def test_a_picture_of_another_aspect_is_placed_as_framing_says(holoview: Run, tmp_path: Path) -> None:
    """The score is that beside the target so placed, and the parts that are cut off or black are told."""
    Image.linear_gradient("L").resize((30, 60)).convert("RGB").save(tmp_path / "portrait.png")
    scores = []
    parts = {"fit": "black: 31 % left, 31 % right", "crop:0.5,0,0.5": "cut off: 25 % left, 25 % right"}
    for framing, said in parts.items():
        outcome = holoview("optimise", "simultaneous", "portrait.png", *QUICK, "--framing", framing, "--json")
        assert outcome.code == 0 and said in outcome.err
        scores.append(json.loads(outcome.out)["psnr_db"])
    assert scores[0] != scores[1]
    for refused in ("stretch", "crop:0.5", "crop:0,0,9"):
        outcome = holoview("optimise", "simultaneous", "portrait.png", *QUICK, "--framing", refused)
        assert outcome.code != 0 and "--framing" in outcome.err and "Traceback" not in outcome.err


def test_framing_without_a_picture_is_refused(holoview: Run, tmp_path: Path) -> None:
    outcome = holoview("contrast", "simultaneous", "--set", "shape=[24,32]", "--framing", "fit")
    assert outcome.code != 0 and "--framing" in outcome.err and "--target" in outcome.err
