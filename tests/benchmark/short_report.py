"""What makes every measurement of a report short."""

from __future__ import annotations

from functools import partial

import pytest

from holoview.commands import bench_report
from holoview.evidence.benchmark import report_run
from holoview.evidence.benchmark.frame_benchmark import Criterion
from holoview.evidence.benchmark.machine import probe_device


def shorten_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few rounds, iterations and bytes, and a first image that nobody waits for."""
    monkeypatch.setattr(report_run, "_POWER_S", 0.0)
    monkeypatch.setattr(report_run, "_QUALITY_LONG", 10)
    monkeypatch.setattr(report_run, "first_image_criterion", lambda *_: Criterion("first image", 2.5, 5.0, 3.0, "s"))
    monkeypatch.setattr(report_run, "probe_device", partial(probe_device, copy_bytes=2**16))
    monkeypatch.setattr(bench_report, "_WINDOW", (320, 200))
    monkeypatch.setattr(bench_report, "_VIEWER_ROUNDS", 2)
