"""Each measurement of a report by itself: the machine, copies, cases, power, the optimiser, and the goals."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.evidence.benchmark.frame_jobs import (
    amplitude_edit,
    full_frame,
    gap_edit,
    open_renderer,
    scrub,
    time_interleaved,
)
from holoview.evidence.benchmark.machine import (
    CardState,
    copy_dispatch,
    machine_facts,
    measure_power,
    probe_device,
    processor_name,
    read_card,
)
from holoview.evidence.benchmark.optimiser_iteration import time_handover, time_iterations
from holoview.evidence.benchmark.report_run import FrameCase, case_system, frame_bytes, parts_ms, time_case
from holoview.evidence.benchmark.report_text import goals, share_of_copy
from holoview.light.gpu.device import TIMESTAMPS, Device
from holoview.light.gpu.recorder import CommandRecorder
from holoview.light.model import preset
from holoview.light.model.system import System
from holoview.util.errors import UserError

gpu = pytest.mark.gpu
KERNELS = ("light", "propagate", "modulate", "spectrum", "image", "observe", "composite")


def _base() -> System:
    return preset.load("holochrome-8")


# --- machine and device ---------------------------------------------------------------------------------------------


@gpu
def test_facts_name_the_adapter_and_can_be_written_as_json(device: Device) -> None:
    facts = machine_facts(device)
    assert json.loads(json.dumps(facts)) == facts
    assert facts["adapter"]["name"] == device.info.name and facts["limits"] == dict(device.limits)
    assert set(facts["features"]["used"]) <= set(facts["features"]["all"])
    assert facts["adapters"][0].startswith(device.info.name)


def test_the_processor_is_read_where_linux_tells_it(tmp_path: Path) -> None:
    (tmp_path / "cpuinfo").write_text(
        "processor\t: 0\nmodel name\t: Fast One\nprocessor\t: 1\nmodel name\t: Fast One\n"
    )
    assert processor_name(tmp_path / "cpuinfo") == "Fast One"
    for flags, vectors in (("fma avx avx2", "AVX2"), ("avx avx2 avx512f", "AVX-512"), ("sse2", "")):
        (tmp_path / "x86").write_text(f"model name\t: Fast One\nflags\t\t: fpu {flags}\n")
        assert processor_name(tmp_path / "x86") == ", ".join(filter(None, ("Fast One", vectors)))
    (tmp_path / "arm").write_text("processor\t: 0\n")
    assert processor_name(tmp_path / "arm") and processor_name(tmp_path / "missing")


@gpu
def test_the_better_copy_counts_and_one_that_does_not_fit_is_refused(device: Device) -> None:
    probe = probe_device(device, 3, copy_bytes=2**20)
    assert probe.copy_bytes == 2**20
    assert probe.copy_bandwidth == max(probe.copy_command, probe.copy_shader)
    assert min(probe.copy_command, probe.copy_shader, probe.dispatch_s, probe.submission_s, probe.check_s) > 0
    with pytest.raises(UserError, match="copy"):
        probe_device(device, 1, copy_bytes=2 * device.limits["max-buffer-size"])


# --- cases ----------------------------------------------------------------------------------------------------------


def test_the_lasers_of_a_case_span_those_of_the_bench() -> None:
    base = _base()
    for count in (1, 3, 16):
        system = case_system(base, (64, 48), count)
        assert len(system.wavelengths_m) == count and system.modulators[0].shape == (24, 32)
        assert base.wavelengths_m.min() <= system.wavelengths_m.min() <= system.wavelengths_m.max()
        assert system.sampling.propagation == "periodic" and system.frames == 1
    assert case_system(base, (64, 48), 1).wavelengths_m[0] == base.wavelengths_m[len(base.wavelengths_m) // 2]


@gpu
def test_each_job_computes_what_its_name_says_and_nothing_else(device: Device) -> None:
    renderer = open_renderer(case_system(_base(), (64, 48), 3), device, strategy="workgroup")
    expected = {
        full_frame: (3, 3, 3, 3, 3, 3, 1),
        scrub: (0, 0, 0, 0, 3, 3, 1),
        gap_edit: (0, 3, 3, 3, 3, 3, 1),
        amplitude_edit: (0, 0, 0, 0, 0, 0, 1),
    }
    for make, counts in expected.items():
        job: Any = make(renderer)
        job()  # the first run of some stores the first rows, or the sum of the other lasers
        for _ in range(2):
            before = renderer.dispatch_counts.copy()
            job()
            done = tuple(renderer.dispatch_counts[name] - before[name] for name in KERNELS)
            assert done == counts, make.__name__


def test_a_bench_with_one_modulator_has_no_gap_to_edit(device: Device) -> None:
    single = preset.load("holochrome-8-1slm").edit({"shape": [24, 32], "propagation": "periodic"})
    assert gap_edit(open_renderer(single, device, strategy="workgroup")) is None


@gpu
def test_the_copying_shader_copies_every_byte(device: Device) -> None:
    words = np.arange(3 * 4 * 256 + 4, dtype=np.uint32)  # not a whole number of workgroups
    source, target = device.upload(words, "source"), device.buffer(words.nbytes, "target")
    recorder = CommandRecorder(device)
    recorder.add(copy_dispatch(device, source, target))
    recorder.submit()
    assert np.array_equal(device.download(target, np.uint32, words.shape), words)


@gpu
def test_bytes_of_a_frame_are_fields_patterns_intensities_and_xyz(device: Device) -> None:
    renderer = open_renderer(case_system(_base(), (64, 48), 3), device, strategy="workgroup")
    intensity, xyz = 48 * 64 * 4, 48 * 64 * 16
    assert frame_bytes(renderer) == 3 * (renderer.traffic_bytes + intensity) + xyz


@gpu
def test_device_times_are_a_part_of_the_whole(device: Device) -> None:
    found = time_case(device, _base(), FrameCase((64, 48), 2, "workgroup", 2), rounds=2, limit_s=60.0)
    assert found["rounds"] == 2 and found["size"] == [64, 48]
    if TIMESTAMPS in device.features:
        assert 0 < found["device_ms"]["frame"] < math.inf
        share = share_of_copy(found, 1e9)
        assert share == pytest.approx(found["frame_bytes"] / (1e-3 * found["device_ms"]["frame"]) / 1e9)
    assert share_of_copy(found, None) is None


def test_parts_of_a_frame_add_up_to_it() -> None:
    device_ms = {"frame": 10.0, "gap": 8.0, "focal plane": 5.0, "amplitudes": 1.0}
    parts = parts_ms({"device_ms": device_ms})
    assert parts == {"light": 2.0, "propagate, modulate": 3.0, "propagate, observe": 4.0, "composite": 1.0}
    assert parts_ms({}) == parts_ms({"device_ms": {"frame": 1.0, "focal plane": 0.5, "amplitudes": 0.1}}) == {}


def test_no_round_begins_after_the_time_limit_but_one_is_always_timed() -> None:
    ran: list[int] = []
    found = time_interleaved({"job": lambda: ran.append(1)}, rounds=5, warm_up=2, limit_s=-1.0)
    assert len(found["job"].seconds) == 1 and len(ran) == 3


# --- power ----------------------------------------------------------------------------------------------------------


def _fake_smi(folder: Path, text: str) -> str:
    """A program that answers as nvidia-smi would."""
    program = folder / "smi"
    program.write_text(f"#!{sys.executable}\nprint({text!r})\n")
    program.chmod(0o755)
    return str(program)


def test_a_line_of_nvidia_smi_is_read() -> None:
    state = CardState.parse("NVIDIA Card, 580.1, 75.31, [N/A], 345, 3201, 31")
    assert state == CardState("NVIDIA Card", "580.1", 75.31, None, 345.0, 3201.0, 31.0)
    assert CardState.parse("NVIDIA-SMI has failed") is None


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in for nvidia-smi is a script with a #! line")
def test_only_the_card_that_the_adapter_is_counts(tmp_path: Path) -> None:
    lines = "Other, 1, 10, 20, 30, 40, 50\nNVIDIA Card, 1, 99, 700, 1980, 3201, 40"
    found = read_card("NVIDIA Card/PCIe", _fake_smi(tmp_path, lines))
    assert found is not None and found.power_w == 99.0
    assert read_card("Another", _fake_smi(tmp_path, lines)) is None
    assert read_card("NVIDIA Card", str(tmp_path / "missing")) is None


@pytest.mark.long
@gpu
@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in for nvidia-smi is a script with a #! line")
def test_power_is_the_median_of_readings_during_frames(device: Device, tmp_path: Path) -> None:
    renderer = open_renderer(case_system(_base(), (64, 48), 1), device, strategy="workgroup")
    program = _fake_smi(tmp_path, f"{device.info.name.partition(',')[0]}, 1, 250.5, 700, 1980, 3201, 40")
    found = measure_power(renderer, 0.3, program)
    assert found["load_w"] == found["rest_w"] == 250.5 and found["readings"] >= 1
    assert found["energy_per_frame_j"] == pytest.approx(250.5 / found["frames_per_s"])
    assert measure_power(renderer, 0.0, str(tmp_path / "missing")) == {}


# --- optimiser ------------------------------------------------------------------------------------------------------


def test_an_iteration_is_timed_where_torch_has_a_device() -> None:
    system = _base().edit({"shape": [16, 24], "planes": ["10 mm"]})
    found = time_iterations(system, 2, 60.0, ("cpu", "cpu:0", "nonsense"))
    assert found["median_ms"].keys() == {"cpu", "cpu:0"} and found["size"] == [48, 32]
    assert found["losses"]["cpu"] == found["losses"]["cpu:0"]
    assert found["losses"]["cpu"][-1] < found["losses"]["cpu"][0]
    assert "isn't available" in found["failures"]["nonsense"]


def test_a_hologram_goes_from_the_optimiser_to_the_shaders(device: Device) -> None:
    found = time_handover(case_system(_base(), (64, 48), 2), device, 2, "cpu")
    assert list(found) == ["patterns from cpu to the processor", "patterns to the shaders, and a frame", "a frame"]
    assert all(time_ms > 0 for time_ms in found.values())


# --- goals ----------------------------------------------------------------------------------------------------------


def _case(frame_ms: float, device_ms: float, nbytes: int = 10**9) -> dict[str, Any]:
    return {
        "size": [1024, 768],
        "wavelengths": 8,
        "strategy": "workgroup",
        "per_dispatch": 8,
        "frame_bytes": nbytes,
        "median_ms": {"frame": frame_ms, "frame in a row": frame_ms / 2},
        "device_ms": {"frame": device_ms},
    }


def test_goals_tell_what_is_met_and_what_is_not() -> None:
    stages = [{"field": {"error": 2e-7, "allowed": 1e-7}}, {"field": {"error": 1e-8, "allowed": 1e-7}}]
    met = goals([_case(0.9, 0.5), _case(3.0, 2.9)], 4e12, [{"scrub_images_per_s": 61.0}], [stages[1]])
    assert [goal.is_met for goal in met] == [True, True, True, True]
    assert "0.9 ms alone, 0.45 ms in a row, 0.5 ms" in met[1].measured and met[2].measured == "50%"
    missed = goals([_case(1.1, 0.6)], 4e12, [{"scrub_images_per_s": 59.0}], stages)
    assert [goal.is_met for goal in missed] == [False, False, False, False]
    assert [goal.is_met for goal in goals([_case(1.0, 1.0) | {"size": [64, 48]}], 4e12, [], [])] == [None] * 4
