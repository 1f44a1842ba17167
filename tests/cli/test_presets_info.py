"""`holoview presets` and `holoview info`: lists, numbers, JSON, and a preset of one's own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from holoview import __version__
from holoview.commands.cli import COMMANDS, main
from holoview.light.model import preset
from tests.patience import PATIENCE_S

Run = Callable[..., Any]

OWN = """
base = "holochrome-8"
description = "two colours"
wavelengths = ["500 nm", "600 nm"]
amplitudes = "white"
gap = "1.5 mm"

[sampling]
propagation = "compact"
"""


def test_every_preset_is_listed_with_its_description_a_line_each(holoview: Run) -> None:
    outcome = holoview("presets")
    assert outcome.code == 0
    assert outcome.err == ""
    assert [line.split()[0] for line in outcome.out.splitlines()] == preset.names()
    assert all(preset.load(name).description in outcome.out for name in preset.names())


def test_the_list_is_available_as_json(holoview: Run) -> None:
    table = json.loads(holoview("presets", "--json").out)
    assert list(table) == preset.names()
    assert table["simultaneous"] == preset.load("simultaneous").description


@pytest.mark.parametrize("name", preset.names())
def test_info_shows_what_a_person_would_check_first(holoview: Run, name: str) -> None:
    outcome = holoview("info", name)
    assert outcome.code == 0
    assert outcome.out.startswith(f"{name}: {preset.load(name).description}\n")
    for heading in ("\nbench\n", "\ndiffraction\n", "\ncut-offs\n", "\nsampling\n", "\nmemory\n"):
        assert heading in outcome.out
    assert "nan" not in outcome.out
    assert "inf" not in outcome.out


def test_info_as_json_holds_the_same_numbers_as_the_text(holoview: Run) -> None:
    table = json.loads(holoview("info", "bench-plm", "--json").out)
    text = holoview("info", "bench-plm").out
    assert table["bench"]["modulators"] == "2 of 1358 x 800 pixels, 16 levels"
    for heading, facts in table.items():
        assert f"\n{heading}\n" in text
        assert all(value in text for value in facts.values())


def test_a_preset_printed_as_toml_is_the_same_bench_again(holoview: Run, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(holoview("info", "multisource-3x3", "--toml").out, encoding="utf-8")
    assert preset.load(tmp_path / "mine.toml") == preset.load("multisource-3x3")


def test_a_preset_of_ones_own_starts_from_another_and_takes_its_file_name(holoview: Run, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(OWN, encoding="utf-8")
    out = holoview("info", "own.toml").out
    assert out.startswith("own: two colours\n")
    assert "2: 500, 600 nm" in out
    assert "1.5 mm" in out
    assert "(compact)" in out


@pytest.mark.parametrize(
    ("changes", "shown"),
    [
        (["gap=3 mm"], "gap                               3 mm"),
        (['gap="3 mm"'], "gap                               3 mm"),
        (["relay2.iris_na=0.02"], "(NA 0.02)"),
        (['wavelengths=["500 nm","600 nm"]', "amplitudes=white"], "2: 500, 600 nm"),
        (['wavelengths=["500 nm","600 nm"]', "amplitudes=[[1, 2]]"], "2: 500, 600 nm"),
        (['wavelengths={first="500 nm",last="600 nm",count=3}', "amplitudes=white"], "3: 500, 550, 600 nm"),
        (["frames=3"], "frames                            3"),
        (["frames=2", "amplitudes=white"], "frames                            2"),
        (["shape=[48,64]"], "2 of 64 x 48 pixels"),
        (["levels=16"], "16 levels"),
        (["upsample=3", "propagation=periodic"], "(periodic)"),
        (['source={grid=[2,2],spacing="5 mrad"}'], "source directions                 4"),
        (["observer=mono"], "observer                          mono"),
    ],
)
def test_set_takes_every_kind_of_value(holoview: Run, changes: list[str], shown: str) -> None:
    flags = [part for change in changes for part in ("--set", change)]
    for order in (["info", "holochrome-8", *flags], ["info", *flags, "holochrome-8"]):
        outcome = holoview(*order)
        assert outcome.code == 0, outcome.err
        assert shown in outcome.out


def test_the_periodic_grid_says_that_light_wraps_around(holoview: Run) -> None:
    out = holoview("info", "holochrome-8-open", "--set", "propagation=periodic").out
    assert "up to 29% of a side (224 samples walk-off over the planes)" in out
    out = holoview("info", "holochrome-8", "--set", "propagation=periodic").out
    assert "up to 15% of a side (112 samples walk-off over the planes)" in out


def test_what_a_stop_passes_is_shown_at_each_wavelength(holoview: Run) -> None:
    table = json.loads(holoview("info", "simultaneous", "--json", "--set", "relay1.square=first order at 638 nm").out)
    cut_offs = table["cut-offs"]
    assert cut_offs["square stop of relay 2"] == "half side 62.5 cycles/mm = 1 first orders (first order)"
    assert cut_offs["square stop of relay 1"] == (
        "half side 86.68, 74.95, 62.5 cycles/mm = 1.387, 1.199, 1 first orders (first order at 638 nm)"
    )


@pytest.mark.parametrize("command", list(COMMANDS))
def test_every_command_explains_itself(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    assert f"usage: holoview {command}" in capsys.readouterr().out


def test_help_lists_the_commands_and_version_says_which_one(capsys: pytest.CaptureFixture[str]) -> None:
    for flag in ("--help", "--version"):
        with pytest.raises(SystemExit) as ended:
            main([flag])
        assert ended.value.code == 0
    out = capsys.readouterr().out
    words = " ".join(out.split())  # lines break where the terminal ends
    assert all(f" {name} " in words and summary in words for name, summary in COMMANDS.items())
    assert f"holoview {__version__}\n" in out


@pytest.mark.long
def test_a_terminal_without_greek_letters_still_gets_its_numbers() -> None:
    command = [sys.executable, "-m", "holoview.commands.cli", "info", "holochrome-8"]
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    ended = subprocess.run(command, env=environment, capture_output=True, timeout=PATIENCE_S)
    assert ended.returncode == 0
    assert b"0.0416 to 0.0831" in ended.stdout
