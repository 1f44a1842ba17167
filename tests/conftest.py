"""Fixtures that all tests share: one open graphics device, and a guard that fails a test on a wgpu warning."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest
import torch

from holoview.gpu.device import Device, open_device
from holoview.model.effects.registry import without_user_effects
from holoview.util.errors import UserError


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
    """On grids this small, threads that share their cores with other processes mostly wait for each other."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


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
