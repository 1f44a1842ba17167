"""What all tests share: order, seeds, signals, one open graphics device, and a guard that fails on a wgpu warning."""

from __future__ import annotations

import gc
import logging
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

# Before numpy and torch are loaded, and for the programs that tests start: on grids this small, threads that share
# their cores with other processes mostly wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import hypothesis
import psutil
import torch

from holoview.light.gpu.device import Device, open_device
from holoview.light.model.effects.registry import without_user_effects
from holoview.util.errors import UserError
from holoview.util.memory_limit import give_back_freed_memory
from holoview.util.processes import wait_for_threads
from tests.randomness import SeedMover, draw_other_noise

LONGEST = (
    "docs/test_tutorials.py",
    "test_effect_consumers.py",
    "diagnose/test_hidden.py",
    "captures/records/test_search.py",
    "gui/test_panels.py",
    "calibrate/test_train.py",
    "diagnose/test_bad_captures.py",
    "page/test_page.py",
    "gui/test_browser_input.py",
    "gui/test_browser.py",
    "study/test_studies.py",
    "cli/test_diagnose.py",
    "parity/test_stages.py",
)
"""Files that take long, begun first: of several processes none then works on one of them when the others have ended."""

TOGETHER = ("tests/architecture/", "tests/calibrate/")
"""Folders whose files share what takes long: one process works on all of them."""

_MUCH_MEMORY = 64 << 20  # bytes by which a file's tests may leave the process larger


_MOVED = "seeds moved"  # the number that a process of xdist tells the one that prints the summary
_mover: SeedMover | None = None
_moved_elsewhere = 0


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options that give the tests other random numbers; see CONTRIBUTING.md."""
    group = parser.getgroup("random numbers")
    help_text = "move every seed, by another amount for each N; 0 moves none"
    group.addoption("--reseed", type=int, default=0, metavar="N", help=help_text)
    help_text = "draw all noise of numpy elsewhere, as a mathematical library whose last digits differ would"
    group.addoption("--other-noise", action="store_true", help=help_text)


def pytest_configure(config: pytest.Config) -> None:
    """Randomness is fixed, or moved as the options say; programs that tests start can be interrupted."""
    global _mover
    hypothesis.settings.register_profile("fixed", derandomize=True, deadline=None)
    hypothesis.settings.load_profile("fixed")
    if config.getoption("reseed"):
        _mover = SeedMover(config.getoption("reseed"))
        _mover.install()
    if config.getoption("other_noise"):
        draw_other_noise()
    for number in (signal.SIGINT, getattr(signal, "SIGHUP", None)):
        # Programs inherit that a signal is ignored (as nohup and a shell's background do), but not that it is handled.
        if number is not None and signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, lambda *_: None)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """With `--dist loadfile`, the files of a folder of `TOGETHER` go to one process."""
    if config.getoption("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling  # the tests run without it, too

    class Scheduling(LoadFileScheduling):  # type: ignore[misc, unused-ignore]
        def _split_scope(self, nodeid: str) -> str:
            return next((folder for folder in TOGETHER if nodeid.startswith(folder)), super()._split_scope(nodeid))

    return Scheduling(config, log)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """A process of xdist has ended: what it moved is counted."""
    global _moved_elsewhere
    _moved_elsewhere += getattr(node, "workeroutput", {}).get(_MOVED, 0)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """A process of xdist tells how many seeds it moved."""
    if _mover is not None and hasattr(session.config, "workeroutput"):
        session.config.workeroutput[_MOVED] = _mover.moved


def pytest_unconfigure() -> None:
    """Waits for work in the background that closed sessions left behind: it would abort the process."""
    wait_for_threads(60.0)


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Tells how many seeds were moved: none would mean that nothing was tried."""
    if _mover is not None:
        number = config.getoption("reseed")
        terminalreporter.write_line(f"--reseed {number}: {_mover.moved + _moved_elsewhere} seeds moved")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[Any]:
    """Nobody looks for garbage in what collecting makes: 700 000 objects that stay until the end.

    It took 7 of the 25 seconds of collecting, and a second whenever all objects are looked through later.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The longest files first, the others in their order; what hypothesis draws moves with all other seeds."""
    place = {str(Path(__file__).parent / name): number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(str(item.path), len(place)))
    if _mover is not None:
        for item in items:
            test = getattr(item, "obj", None)
            if getattr(test, "is_hypothesis_test", False):
                hypothesis.seed(_mover.move(0))(test)


class _Collector(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(record.getMessage())


@pytest.fixture(autouse=True)
def wgpu_log() -> Iterator[list[str]]:
    """Warnings that wgpu or rendercanvas logged: any left at the end fail the test, so clear those you expect."""
    collector = _Collector()
    loggers = [logging.getLogger(name) for name in ("wgpu", "rendercanvas")]
    for logger in loggers:
        logger.addHandler(collector)
    yield collector.messages
    for logger in loggers:
        logger.removeHandler(collector)
    assert not collector.messages, f"wgpu logged: {collector.messages}"


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> Iterator[None]:
    """Whatever the environment says, torch's sums are those of one thread."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(autouse=True)
def _one_thread_again(_one_thread: None) -> Iterator[None]:
    """Where a test, or what it calls, has set another number, the next test has one thread all the same."""
    yield
    torch.set_num_threads(1)


@pytest.fixture(scope="module", autouse=True)
def _free_memory_given_back() -> Iterator[None]:
    """GNU's allocator keeps what is freed between what is in use: gigabytes after some hundred files."""
    before = psutil.Process().memory_info().rss
    yield
    give_back_freed_memory(before + _MUCH_MEMORY)


@pytest.fixture
def no_user_effects() -> Iterator[None]:
    """Effects that the test loads from files are forgotten at its end."""
    with without_user_effects():
        yield


@pytest.fixture(scope="session")
def device() -> Device:
    """The best adapter's device, shared by all tests; without an adapter they are skipped."""
    try:
        return open_device()
    except UserError as error:
        pytest.skip(str(error))
