"""Times an iteration behind stops of the first order beside autograd with stored H, on all frequencies and on few."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from benchmarks.optimiser_work import STOPS, Run, colour_work, interleaved, ours, summary, times_table
from holoview.evidence.benchmark.autograd_loop import Autograd, StoredLoop, Tensor, Work
from holoview.holograms.optimise.parallel import torch_threads
from holoview.light.model.plan import make_plan
from holoview.light.numerics.fourier import PrunedAxis, PrunedTransform
from holoview.light.optics.slm import pixel_spectrum

OWN, MASKED, PRUNED = "holoview", "autograd, cached H", "autograd, cached H, pruned"
_TOLERANCE = 3e-4  # of the loss: a float32 sum of 1.2e7 squares is right to 1e-4


class Pruned(Autograd):
    """Only frequencies that pass: every H, spectrum and transform in the stops' band.

    They are transformed along one axis at a time, and the first spectrum is one of pixels.
    """

    def __init__(self, work: Work) -> None:
        super().__init__(work)
        stored, band = StoredLoop(work), make_plan(work.system).band(1)
        bounds = list(zip(self.shape, band.lowest, band.highest, strict=True))
        y, x = (PrunedAxis.for_band(n, 0, n, low, high) for n, low, high in bounds)
        self._samples = PrunedTransform((y, x))
        periods = [(n // self.upsample, low, high) for n, low, high in bounds]
        self._pixels = PrunedTransform(tuple(PrunedAxis.for_band(n, 0, n, low, high) for n, low, high in periods))  # type: ignore[arg-type]
        ky, kx = (torch.from_numpy(axis.indices) for axis in (y, x))
        shape_y, shape_x = (pixel_spectrum(n, self.upsample, 0.0)[k] for n, k in zip(self.shape, (ky, kx), strict=True))
        shape = (shape_y[:, None] * shape_x).to(torch.complex64)
        self._gaps = [h[ky][:, kx] * shape for h in stored._gaps]
        self._relays = [[h[ky][:, kx] for h in relay] for relay in stored._relays]

    def _intensities(self, wavelength: int, drive: Tensor) -> list[Tensor]:
        λ = self.wavelengths_m[wavelength]
        first = self.phasor(0, λ, drive)[:: self.upsample, :: self.upsample]
        field = self._samples.inverse(self._pixels.forward(first) * self._gaps[wavelength])
        spectrum = self._samples.forward(field * self.phasor(1, λ, drive))
        fields = [self._samples.inverse(spectrum * h) for h in self._relays[wavelength]]
        return [field.real.square() + field.imag.square() for field in fields]


def measure(size: Sequence[int], repeats: int, thread_counts: Sequence[int]) -> dict[str, Any]:
    """Differences of the losses, and times by number of threads. Raises RuntimeError where the losses differ."""
    open_work = colour_work(size)
    work = Work(open_work.system.edit(STOPS), open_work.stack, open_work.drive)
    result: dict[str, Any] = {"loss_differences": _loss_differences(work), "threads": {}}
    for count in thread_counts:
        with torch_threads(count):
            runs: dict[str, Run] = {OWN: ours(work).__next__, MASKED: StoredLoop(work).step, PRUNED: Pruned(work).step}
            result["threads"][str(count)] = summary(interleaved(runs, repeats), OWN)
    return result


def _loss_differences(work: Work) -> dict[str, float]:
    """Relative difference of each baseline's first loss from the optimiser's."""
    loss = next(ours(work)).loss
    baselines: dict[str, Autograd] = {MASKED: StoredLoop(work), PRUNED: Pruned(work)}
    found = {name: abs(model.loss(model.drive).item() / loss - 1) for name, model in baselines.items()}
    if max(found.values()) > _TOLERANCE:
        raise RuntimeError(f"the baselines don't compute what the optimiser does: {found}")
    return found


def report(result: dict[str, Any]) -> str:
    """The results as text and tables."""
    lines = [f"{name}: first loss differs by {off:.1e}" for name, off in result["loss_differences"].items()]
    for count, rows in result["threads"].items():
        lines += ["", times_table("", count, rows, list(rows))]
    return "\n".join(lines)
