"""The machine of a measurement: adapter, driver, processor, versions; the device's bandwidth at best, and its power."""

from __future__ import annotations

import os
import platform
import statistics
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import torch

from holoview.evidence.benchmark.frame_jobs import TimedJob, frames_in_a_row
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.gpu.adapter import AdapterInfo, native_adapters
from holoview.light.gpu.device import Buffer, Device
from holoview.light.gpu.recorder import CommandRecorder, Dispatch, workgroup_grid
from holoview.light.gpu.shader import link
from holoview.light.numerics.sampling import ceil_div
from holoview.util.packages import __version__
from holoview.util.processes import process_cpu_count

_PACKAGES = ("numpy", "torch", "wgpu")


def machine_facts(device: Device) -> dict[str, Any]:
    """All facts as JSON values; None for what isn't known."""
    native = device.raw.adapter
    return {
        "adapter": asdict(device.info),
        "adapters": [AdapterInfo.of(other).label for other in native_adapters()],
        "limits": dict(device.limits),
        "features": {"used": sorted(device.features), "all": sorted(native.features)},
        "processor": processor_name(),
        "cores": process_cpu_count(),
        "memory_bytes": _memory_bytes(),
        "platform": platform.platform(),
        "torch_threads": torch.get_num_threads(),
        "cuda": _cuda(),
        "versions": versions(),
    }


def versions() -> dict[str, str]:
    """Versions of holoview, Python and the libraries that decide about speed."""
    return {"holoview": __version__, "python": platform.python_version()} | {name: _version(name) for name in _PACKAGES}


_VECTORS = {"avx512f": "AVX-512", "avx2": "AVX2", "avx": "AVX"}


def processor_name(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """The processor's model and its widest vectors where the system tells them, else its architecture.

    Under one name of a model some machines offer AVX-512 and others don't, which changes how fast shaders run on them.
    cpuinfo: the file of Linux.
    """
    try:
        lines = cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    stated = {name.strip(): text.strip() for name, _, text in (line.partition(":") for line in reversed(lines))}
    flags = stated.get("flags", "").split()
    vectors = next((f", {name}" for flag, name in _VECTORS.items() if flag in flags), "")
    return stated.get("model name", platform.machine()) + vectors


def _memory_bytes() -> int | None:
    """Main memory of the machine; None where the system has no POSIX call for it."""
    if not hasattr(os, "sysconf"):
        return None
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def has_cuda() -> bool:
    """Whether torch computes on a CUDA device here."""
    return torch.cuda.is_available()


def _cuda() -> dict[str, Any] | None:
    """The card that PyTorch computes on, if it has one."""
    if not torch.cuda.is_available():
        return None
    properties = torch.cuda.get_device_properties(0)
    return {
        "name": properties.name,
        "memory_bytes": properties.total_memory,
        "multiprocessors": properties.multi_processor_count,
        "cuda": torch.version.cuda,
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


# --- what a device can do at best ---
#
# A frame's share of the memory bandwidth refers to the bandwidth of a copy; the times of an empty submission and of a
# dispatch tell what part of a short frame is overhead.


_COPY_BYTES, _CPU_COPY_BYTES = 2**28, 2**25
"""Size of the copied buffer: more than a card's cache holds; less on CPU adapters, which take long."""
_COPIES, _CPU_COPIES = (4, 20), (1, 4)
"""Few and many copies: the difference of two such submissions is free of the time that a submission takes."""
_DISPATCHES = (20, 220)
_WORKGROUP = 256  # of shaders/benchmark/copy.wgsl
_VEC4_BYTES = 16


@dataclass(frozen=True)
class DeviceProbe:
    """Bandwidths (bytes/s, read plus written) of copies by command and by shader, and overheads (s).

    submission_s: of an empty submission and waiting for its end. check_s: of the check that precedes each submission,
    whether the device is still there. dispatch_s: of a dispatch that does next to nothing, after another.
    """

    copy_command: float
    copy_shader: float
    copy_bytes: int
    submission_s: float
    check_s: float
    dispatch_s: float

    @property
    def copy_bandwidth(self) -> float:
        """The greater of the two bandwidths."""
        return max(self.copy_command, self.copy_shader)


def probe_device(device: Device, rounds: int, copy_bytes: int | None = None) -> DeviceProbe:
    """Measure a device; medians of `rounds` differences.

    copy_bytes: size of the copied buffer; by default 256 MiB (32 MiB on a CPU adapter) or the most that the device
    allows. Raises UserError if that is too much for the device's memory.
    """
    allowed = min(device.limits["max-buffer-size"], device.limits["max-storage-buffer-binding-size"])
    wanted, copies = (_CPU_COPY_BYTES, _CPU_COPIES) if device.info.is_cpu else (_COPY_BYTES, _COPIES)
    nbytes = copy_bytes or min(wanted, allowed - allowed % _VEC4_BYTES)
    source, target = (device.buffer(nbytes, f"{name} of a copy") for name in ("source", "target"))

    def command(recorder: CommandRecorder) -> None:
        recorder.copy(source, target)

    large = copy_dispatch(device, source, target)
    small = copy_dispatch(device, *(device.buffer(_VEC4_BYTES, f"small {i}") for i in (0, 1)))
    moved = 2 * nbytes
    return DeviceProbe(
        copy_command=moved / _step_s(device, command, copies, rounds),
        copy_shader=moved / _step_s(device, lambda recorder: recorder.add(large), copies, rounds),
        copy_bytes=nbytes,
        submission_s=statistics.median(_submission_s(device, command, 0) for _ in range(rounds)),
        check_s=statistics.median(_check_s(device) for _ in range(rounds)),
        dispatch_s=_step_s(device, lambda recorder: recorder.add(small), _DISPATCHES, rounds),
    )


def copy_dispatch(device: Device, source: Buffer, target: Buffer) -> Dispatch:
    """The dispatch of a shader that copies `source` to `target`, whose size is a multiple of 16 bytes."""
    pipeline = device.pipeline(link("benchmark/copy.wgsl"))
    groups = workgroup_grid(ceil_div(target.nbytes, _WORKGROUP * _VEC4_BYTES), device)
    return Dispatch.bind(device, pipeline, [[source, target]], (*groups, 1))


def _step_s(device: Device, record: Callable[[CommandRecorder], None], counts: tuple[int, int], rounds: int) -> float:
    """Time (s) of one recorded step: the difference of submissions with many and with few of them, `counts`.

    Where noise hides the difference, the whole time of the many, which is an upper limit.
    """
    few, many = counts
    for count in counts:
        _submission_s(device, record, count)
    pairs = [[_submission_s(device, record, count) for count in counts] for _ in range(rounds)]
    short, long = (statistics.median(times) for times in zip(*pairs, strict=True))
    return (long - short) / (many - few) if long > short else long / many


def _submission_s(device: Device, record: Callable[[CommandRecorder], None], count: int) -> float:
    """Time (s) from submitting `count` recorded steps to their end."""
    recorder = CommandRecorder(device, "probe")
    for _ in range(count):
        record(recorder)
    device.wait()
    start = time.perf_counter()
    recorder.submit(wait=True)
    return time.perf_counter() - start


def _check_s(device: Device) -> float:
    """Time (s) of a check whether the device is still there."""
    start = time.perf_counter()
    device.check_alive()
    return time.perf_counter() - start


# --- the power that a card draws, at rest and while it computes frames, where its driver tells it (nvidia-smi) ---


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
    """Whether nvidia-smi and a graphics driver name the same card; either name may be part of the other."""
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
