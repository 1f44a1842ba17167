"""One 2-D FFT on the device beside torch's."""

from __future__ import annotations

import numpy as np
import torch

from holoview.benchmark.timing import TimedJob
from holoview.gpu.device import Device
from holoview.gpu.fft import FftPlan
from holoview.gpu.line_fft import Strategy
from holoview.gpu.recorder import CommandRecorder

FFT, TORCH_FFT = "FFT2", "torch.fft2, 2 threads"
_THREADS, _AT_A_TIME = 2, 4


def fft_jobs(device: Device, shape: tuple[int, int], strategy: Strategy) -> dict[str, TimedJob]:
    """Forward FFTs of a complex64 field of `shape` (ny, nx), `_AT_A_TIME` a job: warm, in memory that is there."""
    parts = np.random.default_rng(0).standard_normal((2, *shape)).astype(np.float32)
    field = (parts[0] + 1j * parts[1]).astype(np.complex64)
    plan = FftPlan(device, shape, strategy=strategy)
    buffer = device.upload(plan.pack(field), "field")
    given, out = torch.from_numpy(field), torch.empty(shape, dtype=torch.complex64)

    def ours() -> None:
        recorder = CommandRecorder(device, "FFT2")
        for direction in (plan.forward, plan.inverse) * (_AT_A_TIME // 2):  # back again, so that values stay finite
            direction(recorder, buffer)
        recorder.submit(wait=True)

    def torchs() -> None:
        before = torch.get_num_threads()
        torch.set_num_threads(_THREADS)
        try:
            with torch.inference_mode():
                for _ in range(_AT_A_TIME):
                    torch.fft.fft2(given, out=out)
        finally:
            torch.set_num_threads(before)

    return {FFT: ours, TORCH_FFT: torchs}
