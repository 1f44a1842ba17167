"""`holoview optimise` with a film: a hologram for each picture, from the last one; what is there already is kept."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from holoview.holograms.hologram import load_hologram

Run = Callable[..., Any]

OPTIONS = ("--set", "shape=[24,32]", "--iterations", "4", "--next-iterations", "2", "--film", "--json", "-o", "out")


@pytest.fixture
def film(tmp_path: Path) -> Path:
    """A folder of three pictures: a bright bar that moves to the right."""
    folder = tmp_path / "film"
    folder.mkdir()
    for number in range(3):
        pixels = np.full((48, 64, 3), 60, dtype=np.uint8)
        pixels[:, 10 + 6 * number : 26 + 6 * number] = 200
        Image.fromarray(pixels).save(folder / f"{number}.png")
    return folder


def _drives(folder: Path) -> list[np.ndarray]:
    return [load_hologram(path).drive for path in sorted(folder.iterdir())]


def test_each_picture_gets_a_hologram_that_begins_with_the_last(holoview: Run, tmp_path: Path, film: Path) -> None:
    outcome = holoview("optimise", "simultaneous", film, *OPTIONS)
    assert outcome.code == 0
    table = json.loads(outcome.out)
    assert table["holograms"] == len(table["psnr_db"]) == 3
    drives = _drives(tmp_path / "out")
    system = load_hologram(tmp_path / "out" / "00000.safetensors").system
    # Adam's two steps are at most 0.5 rad and 0.5·√½ rad, at the middle wavelength; from another start they would be
    # anywhere in the stroke.
    farthest = 0.5 * (1 + 0.5**0.5) * np.median(system.wavelengths_m) / (2 * np.pi * system.modulators[0].stroke_m)
    for before, after in pairwise(drives):
        assert 0 < np.abs(after - before).max() < 1.001 * farthest < 0.5
    cold = holoview("optimise", "simultaneous", film, *OPTIONS[:-1], "cold", "--seed", "1")
    assert cold.code == 0
    assert np.abs(_drives(tmp_path / "cold")[0] - drives[0]).max() > 0.5


@pytest.mark.long
def test_the_first_picture_gets_200_iterations_unless_told_otherwise(holoview: Run, tmp_path: Path, film: Path) -> None:
    small = ("--set", "shape=[8,8]", "-o")
    assert holoview("optimise", "simultaneous", film, "--film", "--next-iterations", "1", *small, "out").code == 0
    alone = holoview("optimise", "simultaneous", film / "0.png", "--iterations", "200", *small, "alone.safetensors")
    assert alone.code == 0
    assert np.array_equal(_drives(tmp_path / "out")[0], load_hologram(tmp_path / "alone.safetensors").drive)


def test_a_run_that_goes_on_ends_with_the_same_bits(holoview: Run, tmp_path: Path, film: Path) -> None:
    assert holoview("optimise", "simultaneous", film, *OPTIONS).code == 0
    whole = _drives(tmp_path / "out")
    kept = tmp_path / "out" / "00000.safetensors"
    written = kept.stat().st_mtime_ns
    for number in (1, 2):
        (tmp_path / "out" / f"0000{number}.safetensors").unlink()
    outcome = holoview("optimise", "simultaneous", film, *OPTIONS)
    assert json.loads(outcome.out)["holograms"] == 2
    assert kept.stat().st_mtime_ns == written
    for before, after in zip(whole, _drives(tmp_path / "out"), strict=True):
        assert np.array_equal(before, after)


def test_an_interruption_keeps_what_is_done(interrupted: Run, tmp_path: Path, film: Path) -> None:
    options = [*OPTIONS[:-2], "-o", "out", "--next-iterations", "100000"]
    outcome = interrupted("optimising simultaneous: 1/3", "optimise", "simultaneous", film, *options)
    assert outcome.code == 130
    assert "the same command goes on" in outcome.err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["00000.safetensors"]


def test_holograms_of_another_bench_are_not_gone_on_from(holoview: Run, tmp_path: Path, film: Path) -> None:
    assert holoview("optimise", "simultaneous", film, *OPTIONS).code == 0
    outcome = holoview("optimise", "simultaneous", film, *OPTIONS, "--set", 'planes=["11 mm"]')
    assert outcome.code == 2 and "is a hologram of another bench" in outcome.err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--depth", "film/0.png"), "--depth: with a film"),
        (("--pupils", "2x2:1mm"), "--pupils: with a film"),
        (("--checkpoint", "c.safetensors"), "--checkpoint: with a film"),
        (("--free", "patterns,wavelengths"), "target: that changes, with free wavelengths"),
    ],
)
def test_options_that_a_film_does_not_have_are_refused(
    options: tuple[str, ...], message: str, holoview: Run, tmp_path: Path, film: Path
) -> None:
    outcome = holoview("optimise", "simultaneous", film, *OPTIONS, *options)
    assert outcome.code == 2 and message in outcome.err
    assert not (tmp_path / "out").exists()


def test_a_film_needs_a_folder_to_write_to(holoview: Run, tmp_path: Path, film: Path) -> None:
    outcome = holoview("optimise", "simultaneous", film, *OPTIONS[:-2])
    assert outcome.code == 2 and "-o: is missing; expected a folder" in outcome.err
    (tmp_path / "out").write_text("a file")
    outcome = holoview("optimise", "simultaneous", film, *OPTIONS)
    assert outcome.code == 2 and "it is a file" in outcome.err
