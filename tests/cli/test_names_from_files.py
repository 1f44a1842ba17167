"""A name in a stranger's file neither chooses a file that is written nor does anything to the terminal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import holoview as hv
from holoview.commands.arguments import default_output
from holoview.holograms.files.pictures import write_png
from holoview.holograms.hologram import Hologram
from holoview.util.errors import UserError
from holoview.util.figures import figure_bytes, label, new_figure

Run = Callable[..., Any]
SMALL = ["--set", "shape=[24,32]"]
NAMES = st.text(st.characters(codec="utf-8"), max_size=40)
_SETTINGS = settings(
    deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
HOSTILE = [
    "../victim",
    "/victim",
    "victim",
    "\x1b]0;title\x07",
    "a\nb",
    "..",
    "\u202egnp.exe",
    "-rf",
    "CON",
    "x" * 300,
    "$\\frac",
]


@pytest.mark.long
@given(NAMES, NAMES, st.sampled_from([".png", ".safetensors"]))
@example("../victim", "", ".png")
@_SETTINGS
def test_a_default_name_is_a_new_file_in_the_present_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, target: str, suffix: str
) -> None:
    monkeypatch.chdir(tmp_path)
    path = default_output(name, target, suffix)
    assert path.name == str(path) and path.suffix == suffix and not path.exists()


@pytest.mark.parametrize("content", [b"mine", b"\x89PNG\r\n\x1a\n", b""])
@pytest.mark.parametrize("suffix", [".png", ".safetensors"])
def test_what_is_there_and_not_ours_isn_t_overwritten_by_default(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes, suffix: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / f"mine{suffix}").write_bytes(content)
    with pytest.raises(UserError, match=r"is there already.*name the file to write with -o"):
        default_output("mine", "", suffix)


def test_our_own_files_of_the_same_bench_are_written_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    system = hv.load("simultaneous").edit({"shape": [24, 32], "name": "a/b"})
    Hologram(hv.random_drive(system), system).save("a-b.safetensors")
    write_png("a-b.png", np.zeros((2, 2, 3), np.uint8), {"holoview.preset": "a/b"})
    for suffix in (".png", ".safetensors"):
        assert default_output("a/b", "", suffix) == Path(f"a-b{suffix}")
        with pytest.raises(UserError, match="is there already"):
            default_output("a-b", "", suffix)  # another bench, whose name is as plain


@pytest.mark.parametrize("name", HOSTILE, ids=lambda v: ascii(v)[:20])
def test_a_stranger_s_hologram_is_rendered_to_a_file_of_its_own(holoview: Run, tmp_path: Path, name: str) -> None:
    system = hv.load("simultaneous").edit({"shape": [24, 32], "name": name})
    Hologram(hv.random_drive(system), system).save(tmp_path / "stranger.safetensors")
    victims = [tmp_path / "victim.png", tmp_path / "victim.safetensors"]
    for victim in victims:
        victim.write_bytes(b"mine")
    outcome = holoview("render", "--hologram", "stranger.safetensors", "--backend", "torch")
    assert [victim.read_bytes() for victim in victims] == [b"mine", b"mine"]
    assert not {c for c in outcome.out + outcome.err if not c.isprintable()} - {"\n"}
    if name.strip("./") == "victim":
        assert (
            outcome.code == 2
            and f'victim.png: is there already, and holoview didn\'t write it for "{name}"' in outcome.err
        )
    else:
        assert outcome.code == 0 and len(list(tmp_path.glob("*.png"))) == 2


@pytest.mark.parametrize("name", HOSTILE, ids=lambda v: ascii(v)[:20])
@pytest.mark.parametrize("command", [["info"], ["info", "--json"], ["info", "--toml"], ["contrast", "--json"]])
def test_nothing_that_is_printed_acts_on_the_terminal(
    holoview: Run, tmp_path: Path, command: list[str], name: str
) -> None:
    from holoview.light.model import preset

    system = hv.load("simultaneous").edit({"shape": [24, 32], "name": name, "description": f"{name}\x1b[2J"})
    preset.save(system, tmp_path / "stranger.toml")
    outcome = holoview(command[0], "stranger.toml", *command[1:])
    assert outcome.code == 0 and not {c for c in outcome.out + outcome.err if not c.isprintable()} - {"\n"}
    if command == ["info", "--toml"]:
        assert preset.loads(outcome.out) == system


@given(NAMES)
@example("$\\frac$")
@settings(deadline=None, derandomize=True, database=None, max_examples=20)
def test_a_title_is_no_formula(text: str) -> None:
    import warnings

    figure = new_figure((1, 1), dpi=20)
    figure.suptitle(label(text))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph|Matplotlib currently does not support")
        assert figure_bytes(figure).startswith(b"\x89PNG")
