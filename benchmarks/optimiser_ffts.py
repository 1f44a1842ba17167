"""Counts the FFTs of an iteration, and times them alone, which is a lower limit of the time of an iteration."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Any

import torch
from torch.utils._python_dispatch import TorchDispatchMode

from holoview.model.system import System

_FFTS = {"_fft_c2c", "_fft_r2c", "_fft_c2r"}


class FftCount(TorchDispatchMode):
    """Counts the FFTs that PyTorch (including autograd) computes inside a block, in units of 2-D FFTs of `size` (y, x).

    Each field of a batch counts; smaller fields count by their number of samples, and a 1-D FFT counts as a half.
    """

    def __init__(self, size: Sequence[int]) -> None:
        super().__init__()
        self.count = 0.0
        self._samples = size[0] * size[1]

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        result = func(*args, **(kwargs or {}))
        if func.overloadpacket.__name__ in _FFTS:
            field, axes = args[0], args[1]
            self.count += max(field.numel(), result.numel()) / self._samples * len(axes) / 2
        return result

    def __enter__(self) -> FftCount:
        super().__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)


def iteration_ffts(system: System) -> float:
    """Number of full-size FFTs for loss and gradient.

    For each wavelength, forward and backward: one of the modulator's pixels (1/upsample² of the samples), one for each
    plane, and with a second modulator two more.
    """
    one_way = 1 / system.sampling.upsample**2 + len(system.planes_m) + (2 if system.gap_m is not None else 0)
    return 2 * one_way * len(system.wavelengths_m)


class Floor:
    """Computes the FFTs of one iteration and nothing else, in memory that is already allocated."""

    def __init__(self, system: System) -> None:
        rows, columns = (n * system.sampling.upsample for n in system.modulators[0].shape)
        self._fields = [torch.randn(rows, columns, dtype=torch.complex64) for _ in range(2)]
        self._pixels = [torch.randn(system.modulators[0].shape, dtype=torch.complex64) for _ in range(2)]
        self._wavelengths, self._planes = len(system.wavelengths_m), len(system.planes_m)
        self._two = system.gap_m is not None

    def step(self) -> None:
        """Forward and backward, wavelength by wavelength."""
        forward, inverse = torch.fft.fft2, torch.fft.ifft2
        for _ in range(self._wavelengths):
            forward(self._pixels[0], out=self._pixels[1])
            if self._two:
                inverse(self._fields[0], out=self._fields[1])
                forward(self._fields[0], out=self._fields[1])
            for _ in range(2 * self._planes):
                inverse(self._fields[0], out=self._fields[1])
            if self._two:
                forward(self._fields[0], out=self._fields[1])
                inverse(self._fields[0], out=self._fields[1])
            forward(self._pixels[0], out=self._pixels[1])
