"""Effects on the command line: in presets, by `--effects` and by `--set`; all commands use them at once."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

Run = Callable[..., Any]
PRESET = """
base = "holochrome-8"

[effects.gap]
gap_error = "0.3 mm"

[effects.crosstalk]
sigma = 0.5
"""
SMALL = ("--set", "shape=[24, 32]", "--set", 'planes=["3 mm"]')


def _pixels(path: Path) -> np.ndarray[Any, Any]:
    with Image.open(path) as picture:
        return np.asarray(picture).astype(int)


@pytest.fixture
def own(tmp_path: Path) -> Path:
    path = tmp_path / "own.toml"
    path.write_text(PRESET, encoding="utf-8")
    return path


def test_a_preset_and_the_command_line_say_the_same(holoview: Run, own: Path, tmp_path: Path) -> None:
    flags = ("--effects", "gap.gap_error=0.3mm", "crosstalk.sigma=0.5")
    for name, arguments in {
        "preset": (own, *SMALL),
        "effects": ("holochrome-8", *SMALL, *flags),
        "set": (
            "holochrome-8",
            *SMALL,
            "--set",
            "effects.gap.gap_error=0.3 mm",
            "--set",
            "effects.crosstalk.sigma=0.5",
        ),
        "without": ("holochrome-8", *SMALL),
    }.items():
        outcome = holoview("render", *arguments, "--backend", "torch", "-o", f"{name}.png")
        assert outcome.code == 0, outcome.err
    shown = {name: _pixels(tmp_path / f"{name}.png") for name in ("preset", "effects", "set", "without")}
    assert np.array_equal(shown["preset"], shown["effects"]) and np.array_equal(shown["preset"], shown["set"])
    assert np.abs(shown["preset"] - shown["without"]).mean() > 5


def test_info_tells_them_in_words_and_writes_them_as_toml(holoview: Run, own: Path) -> None:
    told = json.loads(holoview("info", own, *SMALL, "--json").out)["effects"]
    assert told["gap"] == "The gap is 2.3 mm, not 2 mm."
    written = holoview("info", own, "--toml").out
    assert '[effects.gap]\ngap_error = "0.3 mm"' in written


def test_a_hologram_is_made_for_the_bench_as_it_is_and_shown_on_any(
    holoview: Run, own: Path, picture: Path, tmp_path: Path
) -> None:
    small = ("--iterations", 2, *SMALL)
    outcome = holoview("optimise", own, picture, *small, "-o", "a.safetensors")
    assert outcome.code == 0, outcome.err
    for name, more in {"own": (), "other": ("--effects", "gap.gap_error=0mm", "crosstalk.sigma=0")}.items():
        rendered = holoview("render", "--hologram", "a.safetensors", *more, "--backend", "torch", "-o", f"{name}.png")
        assert rendered.code == 0, rendered.err
    assert np.abs(_pixels(tmp_path / "own.png") - _pixels(tmp_path / "other.png")).mean() > 1


def test_the_cameras_effects_are_set_apart(holoview: Run) -> None:
    arguments = ("holochrome-8", *SMALL, "--effects", "camera_gamma.exponent=0.2", "--backend", "torch", "-o", "a.png")
    assert "camera_gamma belongs to the camera" in holoview("render", *arguments).err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[effects.gapp]\ngap_error = 1", "effects.gapp: unknown effect; did you mean gap?"),
        ('[effects.gap]\ngap_eror = "1 mm"', "effects.gap.gap_eror: unknown parameter; did you mean gap_error?"),
        ('[effects.gap]\ngap_error = "1 m"', "effects.gap.gap_error: 1000 mm is out of range"),
        ("[effects.gap]\ngap_error = true", "effects.gap.gap_error"),
        ('effects = "none"', "effects: 'none'"),
        ("[effects.iris1]\nradius_error = 0.1", "effects.iris1: relay 1 has neither an iris nor a square stop"),
        ('[effects.gap]\ngap_error = "-3 mm"', "effects.gap: gap: -1 mm is out of range"),
    ],
)
def test_what_cant_be_is_named(holoview: Run, tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "own.toml").write_text(f'base = "holochrome-8-open"\n{text}\n', encoding="utf-8")
    outcome = holoview("render", tmp_path / "own.toml", *SMALL, "--backend", "torch", "-o", "a.png")
    assert outcome.code == 2 and words in outcome.err
    assert not (tmp_path / "a.png").exists()
