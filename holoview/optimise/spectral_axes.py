"""The frequencies that an optimisation computes along each axis, and the transforms between them and samples.

Only frequencies that some relay's stops pass are computed. Two relations save the rest of the work:

- The spectrum of a modulator's pixels is periodic: P/s numbers, repeated s times over the P frequencies of a pattern
  of s samples a pixel. A band that is wider than this period consists of tiles of it.
- Propagation and intensity don't change when all spectra are displaced by the same frequencies. The band behind the
  last modulator is placed at the FFT's first bins, so that no band has to be wrapped around zero.

The field is placed at the first samples of the padded grid, wherever the plan puts it: propagation is a convolution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch

from holoview.model.passband import Band
from holoview.model.plan import Plan
from holoview.numerics.pruned_fft import PrunedAxis
from holoview.optimise.beam_blocks import slices

Tensor = torch.Tensor
Tile = tuple[slice, slice]
"""Entries of the gap's band, and the entries of the pixels' spectrum that they repeat."""


@dataclass(frozen=True)
class SpectralAxis:
    """One axis.

    pixels: transform of the pixels' pattern, true frequencies. gap, last: transforms of samples behind modulator 1 and
    behind the last one, displaced by `displacement` frequencies. With one modulator both bands are the same.
    """

    pixels: PrunedAxis
    gap: PrunedAxis
    last: PrunedAxis
    displacement: int

    @property
    def gap_frequencies(self) -> Tensor:
        """Signed frequency indices (frequency,) of the gap's band."""
        return self._true_frequencies(self.gap)

    @property
    def last_frequencies(self) -> Tensor:
        """Signed frequency indices (frequency,) of the band behind the last modulator."""
        return self._true_frequencies(self.last)

    @property
    def undisplaced_gap(self) -> PrunedAxis:
        """The transform between the gap's band and the field itself."""
        return replace(self.gap, lowest=self.gap.lowest + self.displacement)

    def tiles_of_blocks(self, width: int) -> list[tuple[slice, list[Tile]]]:
        """The pixels' spectrum in blocks of at most `width` entries, each with the parts of the gap's band it makes."""
        return [(part, self.tiles_of(part)) for part in slices(self.pixels.frequencies, width)]

    @property
    def tiles(self) -> list[Tile]:
        """The gap's band in parts, each with the entries of the pixels' spectrum that it consists of."""
        return self.tiles_of(slice(0, self.pixels.frequencies))

    def tiles_of(self, entries: slice) -> list[Tile]:
        """The parts of the gap's band that repeat some entries of the pixels' spectrum; those are counted from 0."""
        period, total = self.pixels.padded, self.gap.frequencies
        starts = range(entries.start, total, period)
        stops = [min(start + entries.stop - entries.start, total) for start in starts]
        return [(slice(a, b), slice(0, b - a)) for a, b in zip(starts, stops, strict=True)]

    def _true_frequencies(self, axis: PrunedAxis) -> Tensor:
        half = axis.padded // 2
        return torch.from_numpy((axis.indices + self.displacement + half) % axis.padded - half)


def samples_a_pixel(plan: Plan) -> int:
    """s: the samples that the transform of pixels takes as one; the largest divisor of `upsample` that fits the FFT."""
    return math.gcd(plan.grid.upsample, *plan.grid.padded)


def spectral_axes(plan: Plan) -> tuple[SpectralAxis, SpectralAxis]:
    """The axes (y, x) of a plan."""
    last = plan.band(1)
    gap = last if plan.system.gap_m is None else plan.band(0)
    y, x = (_spectral_axis(plan, axis, gap, last) for axis in (0, 1))
    return y, x


def _spectral_axis(plan: Plan, axis: int, gap: Band, last: Band) -> SpectralAxis:
    padded, count, samples = plan.grid.padded[axis], plan.grid.shape[axis], samples_a_pixel(plan)
    sizes = [min(band.shape[axis], padded) for band in (gap, last)]
    starts = [band.lowest[axis] for band in (gap, last)]
    narrow = [start for start, size in zip(starts, sizes, strict=True) if size < padded]
    displacement = narrow[-1] if narrow else 0
    # a band of all frequencies may start anywhere: where the FFT does
    lowest = [0 if size == padded else start - displacement for start, size in zip(starts, sizes, strict=True)]
    first_pixel_frequency = lowest[0] + displacement
    period = padded // samples
    return SpectralAxis(
        PrunedAxis(period, 0, count // samples, first_pixel_frequency, min(sizes[0], period)),
        PrunedAxis(padded, 0, count, lowest[0], sizes[0]),
        PrunedAxis(padded, 0, count, lowest[1], sizes[1]),
        displacement,
    )
