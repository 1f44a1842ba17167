"""No output is an input or another output, however it is spelt, and every output is possible: known before any work."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import holoview as hv
from holoview.commands.cli import COMMANDS
from holoview.commands.output_files import ResultSaver, check_files
from holoview.holograms.hologram import Hologram
from holoview.light.model import preset
from holoview.util.errors import UserError
from holoview.util.file_writer import OutputLocks, WriteError, write_file
from tests.pattern_file import write_pattern

Run = Callable[..., Any]
posix = pytest.mark.skipif(sys.platform == "win32", reason="POSIX links")
SMALL = ["--set", "shape=[24,32]"]
OPTIMISE = ["optimise", "simultaneous", "picture.png", *SMALL, "--iterations", "1"]
FILES = ("input", "output", "folder", "shared folder")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, picture: Path) -> Path:
    """picture.png, and things that are read."""
    system = hv.load("simultaneous").edit({"shape": [24, 32]})
    Hologram(hv.random_drive(system), system).save(tmp_path / "h.safetensors")
    preset.save(system, tmp_path / "p.toml")
    (tmp_path / "based.toml").write_text('base = "p.toml"\n[effects.calibrated]\nfile = "c.safetensors"\n')
    (tmp_path / "c.h5").write_bytes(b"captures")
    (tmp_path / "c.safetensors").write_bytes(b"checkpoint")
    write_pattern(tmp_path / "seen-9mm.png", np.zeros((24, 32)))
    (tmp_path / "stack").mkdir()
    (tmp_path / "stack" / "10mm.png").write_bytes(picture.read_bytes())
    return tmp_path


OWN_FILES = [
    [*OPTIMISE, "-o", "o.safetensors", "--preview", "picture.png"],
    [*OPTIMISE, "-o", "o.safetensors", "--checkpoint", "o.safetensors"],
    [*OPTIMISE, "-o", "h.safetensors", "--start", "h.safetensors"],
    [*OPTIMISE, "-o", "c.safetensors", "--resume", "c.safetensors"],
    [*OPTIMISE, "--depth", "seen-9mm.png", "--preview", "seen-9mm.png"],
    ["optimise", "simultaneous", "stack", *SMALL, "--preview", "stack/10mm.png"],
    ["render", "simultaneous", *SMALL, "--slm1", "picture.png", "--slm2", "seen-9mm.png", "-o", "picture.png"],
    [
        "render",
        "p.toml",
        "--slm1",
        "seen-9mm.png",
        "--slm2",
        "seen-9mm.png",
        "--plane",
        "9mm",
        "10mm",
        "-o",
        "seen.png",
    ],
    ["diagnose", "c.h5", "--save-corrected", "c.h5"],
    ["diagnose", "c.h5", "--preset", "p.toml", "--save-preset", "p.toml"],
    ["calibrate", "c.h5", "-o", "p.toml", "--preset", "p.toml"],
    ["calibrate", "c.h5", "-o", "c.toml", "--checkpoint", "c.safetensors"],
    ["calibrate", "c.h5", "-o", "p.toml", "--preset", "based.toml"],
    ["calibrate", "c.h5", "-o", "c.toml", "--preset", "based.toml"],
    ["calibrate", "lut", "sweep.csv", "-o", "a.toml", "--save-preset", "a.toml", "--preset", "p.toml"],
    ["contrast", "picture.png", "--plot", "picture.png"],
    ["view", "picture.png", "--offscreen", "--screenshot", "picture.png"],
]


def _state(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("arguments", OWN_FILES, ids=lambda v: " ".join(v)[:70])
def test_no_command_overwrites_what_it_reads_or_writes_else(holoview: Run, folder: Path, arguments: list[str]) -> None:
    before = _state(folder)
    outcome = holoview(*arguments)
    assert outcome.code == 2 and outcome.out == "" and len(outcome.err.splitlines()) == 1, outcome.err
    assert "would overwrite" in outcome.err or "is the file of" in outcome.err
    assert "expected a file of its own; choose another name" in outcome.err
    assert _state(folder) == before


def test_a_run_that_goes_on_may_write_to_its_checkpoint(holoview: Run, folder: Path) -> None:
    arguments = ("--resume", "c.safetensors", "--checkpoint", "c.safetensors", "-o", "o.safetensors")
    assert "overwrite" not in holoview(*OPTIMISE, *arguments).err


# --- however a name is spelt ------------------------------------------------------------------------------------------


def _spellings(folder: Path) -> list[str]:
    """Names of the file a.png in a folder: plain, with detours, absolute, by links to the file and to the folder."""
    detour = f"sub/../a.png {folder}/a.png ./a.png {folder}/./sub/..//a.png link.png hard.png linked/a.png"
    return ["a.png", *detour.split()]


@posix
@given(st.data(), st.booleans(), st.booleans())
@settings(
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_two_names_of_one_file_are_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, data: st.DataObject, exists: bool, is_input: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    _make_links(tmp_path)
    (tmp_path / "a.png").unlink(missing_ok=True)
    (tmp_path / "hard.png").unlink(missing_ok=True)
    if exists or is_input:
        (tmp_path / "a.png").touch()
        (tmp_path / "hard.png").hardlink_to(tmp_path / "a.png")
    names = [name for name in _spellings(tmp_path) if exists or is_input or name != "hard.png"]
    one, other = data.draw(st.sampled_from(names)), data.draw(st.sampled_from(names))
    with pytest.raises(UserError, match=r"would overwrite|is the file of"):
        check_files(_namespace(one, other, is_input))
    check_files(_namespace(one, "b.png", is_input))


def _make_links(folder: Path) -> None:
    if not (folder / "linked").exists():
        (folder / "sub").mkdir()
        (folder / "linked").symlink_to(folder)
        (folder / "link.png").symlink_to("a.png")


def _namespace(one: str, other: str, is_input: bool) -> argparse.Namespace:
    from holoview.commands.output_files import add_input, add_output

    parser = argparse.ArgumentParser()
    if is_input:
        add_input(parser, "--one")
    else:
        add_output(parser, "--one", suffix=".png")
    add_output(parser, "--other", suffix=".png")
    return parser.parse_args(["--one", one, "--other", other])


# --- every command ----------------------------------------------------------------------------------------------------


def _parsers(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """A parser and those of its subcommands."""
    yield parser
    for action in parser._actions:
        for child in action.choices.values() if isinstance(action, argparse._SubParsersAction) else ():
            yield from _parsers(child)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_argument_that_names_a_file_is_declared(command: str) -> None:
    parser = argparse.ArgumentParser()
    import_module(f"holoview.commands.{command}").configure(parser)
    for each in _parsers(parser):
        declared = {argument.dest for argument in each.get_default("files") or ()}
        assert all(argument.kind in FILES for argument in each.get_default("files") or ())
        words = ("FILE", "DIR", "PNG", "TOML", "CSV", "PICTURE", ".h5", ".toml", ".json", ".py", "PRESET")
        for action in each._actions:
            label = f"{action.metavar or action.dest}"
            names_file = action.type is Path or any(word in label for word in words) or action.dest == "preset"
            assert not names_file or action.dest in declared, f"{command}: {action.option_strings or action.dest}"


IMPOSSIBLE = [
    ("x" * 300, "too long"),
    ("nowhere/a", "nowhere doesn't exist"),
    ("c.h5/a", "c.h5"),
    ("stack", "is a folder"),
]


@posix
@pytest.mark.parametrize(("name", "found"), IMPOSSIBLE, ids=lambda v: v[:20])
@pytest.mark.parametrize(
    ("arguments", "suffix"),
    [
        ([*OPTIMISE, "-o"], ".safetensors"),
        ([*OPTIMISE, "--checkpoint"], ".safetensors"),
        ([*OPTIMISE, "--preview"], ".png"),
        (["captures", "make", "simultaneous", *SMALL, "-o"], ".h5"),
        (["calibrate", "c.h5", "-o"], ".toml"),
        (["diagnose", "c.h5", "--json"], ".json"),
    ],
    ids=lambda v: v[-1] if isinstance(v, list) else "",
)
def test_what_can_t_be_written_is_known_before_the_work(
    holoview: Run,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    suffix: str,
    name: str,
    found: str,
) -> None:
    (folder / f"stack{suffix}").mkdir()
    before = _state(folder)
    outcome = holoview(*arguments, f"{name}{suffix}")
    assert outcome.code == 2 and found in outcome.err and len(outcome.err.splitlines()) == 1
    assert _state(folder) == before


@pytest.mark.parametrize("arguments", [["export", "h.safetensors", "--png"], ["study", "gamut", "-o"], ["demo", "-o"]])
@pytest.mark.parametrize("name", ["c.h5", "c.h5/sub", "x" * 300, "a\0b"])
def test_a_folder_that_can_t_be_made_is_known_before_the_work(
    holoview: Run, folder: Path, arguments: list[str], name: str
) -> None:
    before = sorted(folder.rglob("*"))
    outcome = holoview(*arguments, name)
    assert outcome.code == 2 and len(outcome.err.splitlines()) == 1 and "can't be" in outcome.err
    assert sorted(folder.rglob("*")) == before


# --- what goes wrong all the same -------------------------------------------------------------------------------------


def _full_from_now_on(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Makes a folder take small files only: its disk is full."""
    from holoview.util import file_writer

    real = file_writer._write_beside

    def write_beside(target: Path, *arguments: Any) -> Path:
        if target.parent == folder:
            raise OSError(28, os.strerror(28))
        return real(target, *arguments)

    monkeypatch.setattr(file_writer, "_write_beside", write_beside)


RESULTS = [
    (
        ["optimise", "simultaneous", "picture.png", *SMALL, "--iterations", "1", "-o", "full/o.safetensors"],
        "o.safetensors",
    ),
    (["captures", "make", "simultaneous", *SMALL, "--each", "1", "-o", "full/o.h5"], "o.h5"),
    (["render", "simultaneous", *SMALL, "--backend", "torch", "-o", "full/o.png"], "o.png"),
]


@pytest.mark.parametrize(("arguments", "name"), RESULTS, ids=[name for _, name in RESULTS])
def test_a_result_that_can_t_be_written_is_kept_at_another_place(
    holoview: Run, folder: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], name: str
) -> None:
    (folder / "full").mkdir()
    _full_from_now_on(monkeypatch, folder / "full")
    outcome = holoview(*arguments)
    assert outcome.code == 1 and (folder / name).stat().st_size > 0 and not list((folder / "full").iterdir())
    lines = [
        line
        for line in outcome.err.splitlines()
        if not line.startswith(("measuring", "rendering", "optimising", "note: "))
    ]
    assert lines[0].startswith(f"holoview: full/{name}: can't be written: No space left on device; free ")
    assert lines[1] == f"kept at another place: {folder / name}" and len(lines) == 2
    assert name in outcome.out


def test_a_checkpoint_that_can_t_be_written_is_a_note_and_the_run_goes_on(
    holoview: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "full").mkdir()
    _full_from_now_on(monkeypatch, folder / "full")
    files = ("--checkpoint", "full/c.safetensors", "--preview", "full/p.png", "-o", "o.safetensors")
    outcome = holoview(*OPTIMISE, *files)
    assert outcome.code == 0 and (folder / "o.safetensors").exists()
    notes = [line for line in outcome.err.splitlines() if line.startswith("note: no ")]
    assert {note.split()[2] for note in notes} == {"checkpoint", "preview"}


def test_a_result_that_no_place_takes_is_the_user_s_to_save(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("holoview.commands.output_files.save_elsewhere", lambda path, save: None)
    _full_from_now_on(monkeypatch, tmp_path)
    with pytest.raises(WriteError, match="No space left"):
        ResultSaver().save(tmp_path / "a", lambda path: write_file(path, b"x"))


@pytest.mark.parametrize(
    ("words", "written"),
    [
        ([*OPTIMISE, "-o", "o.safetensors"], "o.safetensors"),
        (OPTIMISE, "simultaneous-picture.safetensors"),
        ([*OPTIMISE, "--checkpoint", "k.safetensors"], "k.safetensors"),
        (["render", "simultaneous", *SMALL, "--backend", "torch"], "simultaneous.png"),
        (["study", "gamut", "--quick", "--shape", "24x32", "-o", "out"], "out"),
        (["study", "gamut", "--quick", "--shape", "24x32"], "out/study-gamut"),
    ],
)
def test_what_another_program_writes_is_refused(words: list[str], written: str, holoview: Run, folder: Path) -> None:
    with OutputLocks() as other:
        other.hold(folder / written)
        before = sorted(folder.iterdir())
        outcome = holoview(*words)
    assert outcome.code == 2 and "is being written by another holoview (process" in outcome.err
    assert sorted(folder.iterdir()) == before
