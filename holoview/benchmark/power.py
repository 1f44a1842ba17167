"""Reads the power that a card draws, at rest and while it computes frames, where its driver tells it (nvidia-smi)."""

from __future__ import annotations

import statistics
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from holoview.benchmark.frame_jobs import frames_in_a_row
from holoview.benchmark.timing import TimedJob
from holoview.engine.incremental import IncrementalRenderer

_FIELDS = ("name", "driver_version", "power.draw", "power.limit", "clocks.sm", "clocks.mem", "temperature.gpu")
_INTERVAL_S = 0.1
_REST_S, _SETTLING_S = 1.0, 0.5
_FRAMES = 8
_TIMEOUT_S = 10.0


@dataclass(frozen=True)
class CardState:
    """One reading: power (W), its limit (W), clocks (MHz), temperature (°C); None for what the driver doesn't tell."""

    name: str
    driver: str
    power_w: float | None
    limit_w: float | None
    clock_mhz: float | None
    memory_clock_mhz: float | None
    temperature_c: float | None

    @classmethod
    def parse(cls, line: str) -> CardState | None:
        """A reading from a line of nvidia-smi; None if it isn't one."""
        cells = [cell.strip() for cell in line.split(",")]
        if len(cells) != len(_FIELDS):
            return None
        return cls(cells[0], cells[1], *map(_number, cells[2:]))


def read_card(adapter: str, program: str = "nvidia-smi") -> CardState | None:
    """One reading of the card that the adapter is; None without nvidia-smi or without such a card."""
    command = [program, f"--query-gpu={','.join(_FIELDS)}", "--format=csv,noheader,nounits"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT_S)
    except (OSError, subprocess.TimeoutExpired):
        return None
    states = (CardState.parse(line) for line in done.stdout.splitlines())
    return next((state for state in states if state is not None and _is_same_card(state.name, adapter)), None)


def measure_power(renderer: IncrementalRenderer, duration_s: float, program: str = "nvidia-smi") -> dict[str, Any]:
    """Power at rest and during `duration_s` of frames in a row, as JSON values; {} if the driver doesn't tell it.

    program: nvidia-smi, or what answers in its place. The energy of a frame is the whole card's, with its rest.
    """
    adapter = renderer.device.info.name
    renderer.device.wait()
    if (state := read_card(adapter, program)) is None or state.power_w is None:
        return {}
    time.sleep(_REST_S)
    rest = read_card(adapter, program) or state
    job = frames_in_a_row(renderer, _FRAMES)
    _repeat(job, _SETTLING_S, [state])
    with _readings(adapter, program) as states:
        start = time.perf_counter()
        frames = _FRAMES * _repeat(job, duration_s, states)
        frames_per_s = frames / (time.perf_counter() - start)
    watts = [state.power_w for state in states if state.power_w is not None]
    if not watts:
        return {}
    return {
        "name": state.name,
        "driver": state.driver,
        "rest_w": rest.power_w,
        "load_w": statistics.median(watts),
        "limit_w": state.limit_w,
        "clock_mhz": _median([state.clock_mhz for state in states]),
        "memory_clock_mhz": _median([state.memory_clock_mhz for state in states]),
        "temperature_c": _median([state.temperature_c for state in states]),
        "readings": len(watts),
        "frames_per_s": frames_per_s,
        "energy_per_frame_j": statistics.median(watts) / frames_per_s,
    }


@contextmanager
def _readings(adapter: str, program: str) -> Iterator[list[CardState]]:
    """Reads the card again and again in a thread while the block runs; the list is complete after it."""
    states: list[CardState] = []
    is_over = threading.Event()

    def read() -> None:
        while not is_over.is_set():
            state = read_card(adapter, program)
            if state is not None and not is_over.is_set():
                states.append(state)
            is_over.wait(_INTERVAL_S)

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    try:
        yield states
    finally:
        is_over.set()
        thread.join()


def _is_same_card(name: str, adapter: str) -> bool:
    """Whether a name of nvidia-smi and one of a graphics driver are of the same card; one may be longer."""
    return name in adapter or adapter in name


def _repeat(job: TimedJob, duration_s: float, states: list[CardState]) -> int:
    """Run a job for a time, and longer if there is no reading yet; how often it ran."""
    start, count = time.perf_counter(), 0
    while count == 0 or time.perf_counter() < start + duration_s + (0.0 if states else _TIMEOUT_S):
        job()
        count += 1
    return count


def _median(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return statistics.median(known) if known else None


def _number(text: str) -> float | None:
    """A number, or None for what nvidia-smi writes instead of one, such as [N/A]."""
    try:
        return float(text)
    except ValueError:
        return None
