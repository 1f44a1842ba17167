"""A study for tests of the runner: its jobs square numbers, and fail or die when their settings say so."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from holoview.evidence.study.study import Findings, JobResult, StatusCallback, Study, StudyJob, StudyScale
from holoview.util.errors import UserError

_FOREVER_S = 600.0


class Probe(Study):
    name = "probe"
    title = "Squares"
    summary = "Nothing."
    quick_note = "Quick: the same."

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return [self.make_job(f"square {n}", {"n": n + seed, "seconds": 1.0}) for n in range(20)]

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        log = Path(settings["log"]) if "log" in settings else None
        if log is not None:
            with log.open("a") as file:
                file.write(f"{settings['n']} {os.getpid()}\n")
        fate, first = settings.get("fate"), log is not None and _times(log, settings["n"]) == 1
        if fate == "dies once" and first:
            os.kill(os.getpid(), signal.SIGKILL)
        if fate == "dies":
            os.kill(os.getpid(), signal.SIGKILL)
        if fate == "fails once" and first:
            raise RuntimeError("a stumble")
        if fate == "fails":
            raise RuntimeError("always")
        if fate == "waits once" and first:
            time.sleep(_FOREVER_S)
        if fate == "refuses":
            raise UserError("n", str(settings["n"]), expected="another")
        time.sleep(settings.get("seconds", 0.0))
        pixels = np.full((2, 3, 3), settings["n"], dtype=np.uint8)
        return JobResult({"square": settings["n"] ** 2}, {"flat": pixels})

    def analyse(self, results: Sequence[tuple[StudyJob, JobResult]]) -> Findings:
        return Findings([{"n": job.settings["n"], **outcome.numbers} for job, outcome in results])


def _times(log: Path, n: int) -> int:
    return sum(line.split()[0] == str(n) for line in log.read_text(encoding="utf-8").splitlines())


STUDY = Probe()
