"""What all tests share: their order, one open graphics device, and a guard that fails a test on a wgpu warning."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

# Before numpy and torch are loaded, and for the programs that tests start: on grids this small, threads that share
# their cores with other processes mostly wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import psutil
import torch

from holoview.gpu.device import Device, open_device
from holoview.model.effects.registry import without_user_effects
from holoview.util.errors import UserError
from holoview.util.memory_limit import give_back_freed_memory

LONGEST = (
    "docs/test_tutorials.py",
    "diagnose/test_bad_captures.py",
    "captures/records/test_search.py",
    "study/test_studies.py",
    "diagnose/test_hidden.py",
    "gui/test_panels.py",
    "cli/test_diagnose.py",
    "parity/test_stages.py",
)
"""Files that take long, begun first: of several processes none then works on one of them when the others have ended."""

_MUCH_MEMORY = 64 << 20  # bytes by which a file's tests may leave the process larger


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first; the others in their order."""
    place = {str(Path(__file__).parent / name): number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(str(item.path), len(place)))


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
