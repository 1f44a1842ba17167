"""Ctrl-C, SIGTERM, SIGHUP: exit code 128 + signal, no traceback, no half file; the optimiser keeps its best so far."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from holoview.commands import cli
from holoview.commands.console import deferred_interrupt
from holoview.holograms.hologram import load_hologram
from holoview.holograms.optimise.solve import iterate
from holoview.util import processes
from tests.explored import explored
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")


@pytest.mark.long
def test_the_optimiser_keeps_its_best_so_far(
    interrupted_program: Callable[..., Any], tmp_path: Path, picture: Path
) -> None:
    arguments = ("--set", "shape=[48,64]", "--iterations", "100000", "-o", "best.safetensors")
    done = interrupted_program("optimising simultaneous: 3/", "optimise", "simultaneous", picture, *arguments)
    assert done.code == 130
    assert done.out == ""
    assert "Traceback" not in done.err
    assert done.err.splitlines()[-1].startswith("interrupted after iteration ")
    assert done.err.endswith("the best so far is kept in best.safetensors\n")
    assert {path.name for path in tmp_path.iterdir()} == {picture.name, "best.safetensors"}
    assert load_hologram(tmp_path / "best.safetensors").drive.shape == (1, 2, 48, 64)


def test_rendering_leaves_nothing_behind(interrupted: Callable[..., Any], tmp_path: Path) -> None:
    slow = ("--set", "shape=[192,256]", "--set", "frames=3", "--plane", "all", "--backend", "torch", "-o", "seen.png")
    done = interrupted("rendering: 1/", "render", "holochrome-8", *slow, number=signal.SIGTERM)
    assert done.code == 143
    assert done.out == ""
    assert done.err.splitlines()[-1] == "holoview: interrupted by SIGTERM"
    assert "Traceback" not in done.err
    assert not list(tmp_path.iterdir())


@pytest.fixture
def signalled(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, int], None]:
    """`signalled(number, count)` makes each of the first `count` iterations of an optimisation end with a signal."""

    def set_up(number: int, count: int) -> None:
        def with_signals(*arguments: Any, **options: Any) -> Iterator[Any]:
            for left, state in zip(range(count, -100, -1), iterate(*arguments, **options), strict=False):
                if left > 0:
                    signal.raise_signal(number)
                yield state

        monkeypatch.setattr("holoview.holograms.optimise.hologram_job.iterate", with_signals)

    return set_up


OPTIMISE = ("optimise", "simultaneous", "picture.png", "--set", "shape=[24,32]", "--iterations", "3")
OPTIMISE += ("-o", "h.safetensors")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_each_signal_saves_and_has_its_exit_code(
    holoview: Callable[..., Any], signalled: Callable[[int, int], None], tmp_path: Path, picture: Path, number: int
) -> None:
    before = [signal.getsignal(one) for one in processes.ENDING]
    signalled(number, 1)
    outcome = holoview(*OPTIMISE)
    assert outcome.code == 128 + number and outcome.out == ""
    assert outcome.err.endswith("interrupted after iteration 0: the best so far is kept in h.safetensors\n")
    assert load_hologram(tmp_path / "h.safetensors").drive.shape == (1, 2, 24, 32)
    assert [signal.getsignal(one) for one in processes.ENDING] == before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_that_is_ignored_stays_so(
    holoview: Callable[..., Any], signalled: Callable[[int, int], None], tmp_path: Path, picture: Path, number: int
) -> None:
    signalled(number, 3)
    before = signal.signal(number, signal.SIG_IGN)
    try:
        assert holoview(*OPTIMISE).code == 0
    finally:
        signal.signal(number, before)


def test_a_second_signal_interrupts_at_once() -> None:
    with pytest.raises(processes.Interrupted) as raised, deferred_interrupt() as interruption:
        assert not interruption() and interruption.exit_code == 0
        signal.raise_signal(signal.SIGTERM)
        assert interruption() and interruption.exit_code == 143
        signal.raise_signal(signal.SIGHUP)
    assert processes.exit_code_of(raised.value) == 129 and processes.exit_code_of(KeyboardInterrupt()) == 130


# Raises SIGINT in itself when a module is about to be imported.
_AT_IMPORT = """
import signal, sys
class Finder:
    def find_spec(name, path, target=None):
        if name == {module!r}:
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Finder)
from holoview.__main__ import run
sys.argv[1:] = ["presets"]
sys.exit(run())
"""


MODULES = ("holoview.commands.cli", "holoview.commands.presets", "numpy", "argparse", "holoview.util.errors", "tomllib")


@pytest.mark.parametrize("module", explored(MODULES, 3))
def test_an_interrupt_at_any_import_is_quiet(module: str) -> None:
    program = _AT_IMPORT.format(module=module)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 130 and done.stdout == "" and done.stderr in ("", "holoview: interrupted\n")


def test_an_interrupt_while_modules_load_is_quiet_too(
    holoview: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(name: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "import_module", interrupt)
    outcome = holoview("render", "holochrome-8")
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "holoview: interrupted\n")


def test_an_interrupt_before_the_first_iteration_writes_nothing(
    holoview: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, picture: Path
) -> None:
    def interrupt(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("holoview.holograms.optimise.hologram_job.iterate", interrupt)
    outcome = holoview("optimise", "simultaneous", picture, "--set", "shape=[24,32]", "-o", "h.safetensors")
    assert outcome.code == 130
    assert outcome.err == "holoview: interrupted\n"
    assert [path.name for path in tmp_path.iterdir()] == [picture.name]
