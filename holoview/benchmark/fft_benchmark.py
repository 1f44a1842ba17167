"""Jobs that time a 2-D FFT on the device, and torch.fft for comparison."""

from __future__ import annotations

import numpy as np
import torch

from holoview.benchmark.timing import TimedJob
from holoview.benchmark.torch_baseline import torch_threads
from holoview.gpu.device import Device
from holoview.gpu.fft import FftPlan
from holoview.gpu.line_fft import Strategy
from holoview.gpu.recorder import CommandRecorder

FFT, TORCH_FFT = "FFT2", "torch.fft2, 2 threads"
_TORCH_THREADS, _FFTS_PER_JOB = 2, 4


def fft_jobs(device: Device, shape: tuple[int, int], strategy: Strategy) -> dict[str, TimedJob]:
    """Jobs of four 2-D FFTs each of a complex64 field of `shape` (ny, nx), in memory that is already allocated."""
    parts = np.random.default_rng(0).standard_normal((2, *shape)).astype(np.float32)
    field = (parts[0] + 1j * parts[1]).astype(np.complex64)
    plan = FftPlan(device, shape, strategy=strategy)
    buffer = device.upload(plan.pack(field), "field")
    tensor, out = torch.from_numpy(field), torch.empty(shape, dtype=torch.complex64)

    def device_ffts() -> None:
        recorder = CommandRecorder(device, "FFT2")
        for direction in (plan.forward, plan.inverse) * (_FFTS_PER_JOB // 2):  # alternating, so that values stay finite
            direction(recorder, buffer)
        recorder.submit(wait=True)

    def torch_ffts() -> None:
        with torch_threads(_TORCH_THREADS), torch.inference_mode():
            for _ in range(_FFTS_PER_JOB):
                torch.fft.fft2(tensor, out=out)

    return {FFT: device_ffts, TORCH_FFT: torch_ffts}
