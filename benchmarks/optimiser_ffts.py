"""FFTs: how many an iteration makes, and how long they take alone, which no arithmetic around them can beat."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Any

import torch
from torch.utils._python_dispatch import TorchDispatchMode

from holoview.model.system import System

_FFTS = {"_fft_c2c", "_fft_r2c", "_fft_c2r"}


class FftCount(TorchDispatchMode):
    """Counts the FFTs that torch makes inside a block, autograd's too, as 2-D ones of `size` (y, x) samples.

    A batch counts by its fields, a smaller field by its share of samples, one axis of two as a half.
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
    """Full-size FFTs that loss and gradient take: forward and backward, each wavelength has one of the pixels
    (1/upsample² of a field's samples), one a plane and, with a second modulator, one before and one behind it.
    """
    one_way = 1 / system.sampling.upsample**2 + len(system.planes_m) + (2 if system.gap_m is not None else 0)
    return 2 * one_way * len(system.wavelengths_m)


class Floor:
    """The FFTs of one iteration and nothing else, from and to memory that is already there."""

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
