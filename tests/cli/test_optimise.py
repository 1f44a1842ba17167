"""`holoview optimise`: a hologram file that shows the picture, what is reported, and what `export` makes of it."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.holograms.files.pictures import read_pattern
from holoview.holograms.hologram import Hologram, load_hologram

Run = Callable[..., Any]

SHAPE = (24, 32)
QUICK = ("--set", "shape=[24,32]", "--iterations", "3")


def test_the_file_holds_patterns_amplitudes_and_the_bench_as_it_was_asked_for(
    holoview: Run, tmp_path: Path, picture: Path
) -> None:
    outcome = holoview("optimise", "simultaneous", picture, *QUICK, "-o", "h.safetensors")
    assert outcome.code == 0
    hologram = load_hologram(tmp_path / "h.safetensors")
    assert hologram.drive.shape == (1, 2, *SHAPE)
    asked = hv.load("simultaneous").edit({"shape": list(SHAPE)})
    assert hologram.system == asked.edit({"amplitudes": hologram.system.amplitudes})
    assert not np.array_equal(hologram.system.amplitudes, asked.amplitudes)


def test_the_report_names_file_fidelity_speckle_and_eyebox(holoview: Run, picture: Path) -> None:
    out = holoview("optimise", "simultaneous", picture, *QUICK).out
    name = "simultaneous-picture.safetensors"
    assert out.startswith(f"{name}: 3 iterations in ")
    for words in ("PSNR ", "on the linear grid", "luminance PSNR ", "CIEDE2000 ", "speckle contrast ", "eyebox: "):
        assert words in out
    assert f"holoview render --hologram {name}" in out


def test_json_holds_the_same_numbers(holoview: Run, picture: Path) -> None:
    outcome = holoview("optimise", "simultaneous", picture, *QUICK, "--json", "-o", "h.safetensors")
    table = json.loads(outcome.out)
    assert (table["preset"], table["file"], table["iterations"]) == ("simultaneous", "h.safetensors", 3)
    assert len(table["psnr_planes_db"]) == 5
    assert table["psnr_db"] == pytest.approx(np.mean(table["psnr_planes_db"]))


def test_further_scores_are_reported_by_their_names(holoview: Run, picture: Path) -> None:
    table = json.loads(holoview("optimise", "simultaneous", picture, *QUICK, "--score", "flip", "--json").out)
    assert len(table["flip_planes"]) == 5 and 0 < table["flip"] < 1
    assert table["flip"] == pytest.approx(np.mean(table["flip_planes"]))
    text = holoview("optimise", "simultaneous", picture, *QUICK, "--score", "flip").out
    assert f"FLIP {table['flip']:.3f}" in text.splitlines()


def test_a_score_that_is_not_installed_is_refused_before_anything_is_optimised(
    holoview: Run, tmp_path: Path, picture: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pycvvdp", None)
    outcome = holoview("optimise", "simultaneous", picture, *QUICK, "--score", "flip", "jod", "-o", "h.safetensors")
    assert outcome.code == 2 and 'pip install "holoview[perceptual]"' in outcome.err
    assert not (tmp_path / "h.safetensors").exists()


def test_optimize_is_the_same_command(holoview: Run, tmp_path: Path, picture: Path) -> None:
    assert holoview("optimise", "simultaneous", picture, *QUICK, "-o", "a.safetensors").code == 0
    assert holoview("optimize", *QUICK, "-o", "b.safetensors", "simultaneous", picture).code == 0
    a, b = (load_hologram(tmp_path / f"{name}.safetensors") for name in "ab")
    assert np.array_equal(a.drive, b.drive)
    assert a.system == b.system


@pytest.mark.long
def test_more_iterations_and_a_start_come_closer_to_the_picture(holoview: Run, picture: Path) -> None:
    def psnr_db(*arguments: str) -> float:
        out = holoview("optimise", "holochrome-8", picture, *QUICK, *arguments, "--json").out
        return float(json.loads(out)["psnr_db"])

    first = psnr_db("-o", "h.safetensors")
    assert psnr_db("--start", "h.safetensors", "--step", "0.3", "-o", "better.safetensors") > first
    assert psnr_db("--iterations", "12", "-o", "h.safetensors") > first


def test_a_depth_map_spreads_the_picture_over_the_planes(holoview: Run, tmp_path: Path, picture: Path) -> None:
    with Image.open(picture) as opened:
        width, height = opened.size
    depth = np.broadcast_to(np.linspace(0, 65535, width), (height, width)).astype(np.uint16)
    Image.fromarray(depth).save(tmp_path / "depth.png")
    arguments = ("optimise", "simultaneous", picture, *QUICK, "--depth", "depth.png", "--near", "10.5mm")
    assert holoview(*arguments, "--far", "9.5mm", "-o", "h.safetensors").code == 0


def test_notes_on_the_picture_go_to_stderr(holoview: Run, tmp_path: Path) -> None:
    Image.fromarray(np.full((*SHAPE, 4), 180, np.uint8)).save(tmp_path / "glass.png")
    outcome = holoview("optimise", "simultaneous", "glass.png", *QUICK, "--json", "-o", "h.safetensors")
    assert "note: glass.png: alpha composited over black" in outcome.err
    json.loads(outcome.out)


def test_a_picture_with_a_black_middle_is_scored_all_over(holoview: Run, tmp_path: Path) -> None:
    pixels = np.full((48, 64, 3), 200, np.uint8)
    pixels[6:42, 8:56] = 0
    Image.fromarray(pixels).save(tmp_path / "frame.png")
    near = ("--set", 'planes=["0.1 mm"]', "--set", "gap=0.1 mm")  # no blur into the middle
    outcome = holoview("optimise", "simultaneous", "frame.png", *QUICK, *near, "--json", "-o", "h.safetensors")
    assert outcome.code == 0
    assert json.loads(outcome.out)["speckle_contrast"] > 0


@pytest.mark.long
def test_the_contrast_of_the_scores_is_that_of_the_command_contrast(
    holoview: Run, tmp_path: Path, picture: Path
) -> None:
    """One number by one method: the mean over the planes of what `contrast --target` states, or why none is."""
    scores = json.loads(holoview("optimise", "simultaneous", picture, *QUICK, "--json", "-o", "h.safetensors").out)
    planes_m = hv.load_hologram(tmp_path / "h.safetensors").system.planes_m
    found = [
        json.loads(
            holoview("contrast", "h.safetensors", "--target", picture, "--plane", f"{z * 1e3:.9g} mm", "--json").out
        )
        for z in planes_m
    ]
    if scores["speckle_withheld"] is None:
        assert scores["speckle_contrast"] == pytest.approx(np.mean([of["contrast"] for of in found]), rel=1e-3)
    else:
        assert scores["speckle_contrast"] is None and scores["speckle_withheld"] in [of["withheld"] for of in found]


def test_a_hologram_too_small_to_be_scored_is_saved_all_the_same(holoview: Run, tmp_path: Path, picture: Path) -> None:
    tiny = ("--set", "shape=[2,2]", "--set", "propagation=periodic", "--iterations", "1")
    outcome = holoview("optimise", "simultaneous", picture, *tiny, "-o", "h.safetensors", "--json")
    assert outcome.code == 0
    assert "note: h.safetensors is saved but can't be scored: " in outcome.err
    assert set(json.loads(outcome.out)) == {"preset", "file", "iterations", "seconds", "loss", "wavelengths_nm"}
    assert load_hologram(tmp_path / "h.safetensors").drive.shape == (1, 2, 2, 2)


def test_exported_patterns_are_the_hologram_s(holoview: Run, tmp_path: Path, picture: Path) -> None:
    holoview("optimise", "simultaneous", picture, *QUICK, "-o", "h.safetensors")
    outcome = holoview("export", "h.safetensors", "--png", "patterns", "--bits", 16)
    assert outcome.code == 0
    drive = load_hologram(tmp_path / "h.safetensors").drive
    for number in (1, 2):
        found = read_pattern(tmp_path / "patterns" / f"slm{number}.png", SHAPE)
        assert np.abs(found - drive[0, number - 1]).max() <= 0.5 / 65535 + 1e-7


def test_levels_are_exported_by_their_number(holoview: Run, tmp_path: Path) -> None:
    system = hv.load("simultaneous-1slm").edit({"shape": [2, 3], "levels": [0, 0.1, 0.7, 1]})
    drive = np.array([[0, 0.04, 0.06], [0.3, 0.6, 0.9]], np.float32)[None, None]
    Hologram(drive, system).save(tmp_path / "h.safetensors")
    assert holoview("export", "h.safetensors", "--png", "patterns", "--levels").code == 0
    with Image.open(tmp_path / "patterns" / "slm1.png") as image:
        assert np.asarray(image).tolist() == [[0, 0, 1], [1, 2, 3]]
        assert image.info["holoview.pattern"] == "level number"
        assert image.info["holoview.preset"] == "simultaneous-1slm"
        assert image.info["Software"] == f"holoview {hv.__version__}"
