"""How sparse the edges of a field are at each distance, in each part of the picture.

Out of focus the light of an edge lies beside it. Σ|∇u|² of the whole picture is the same at every distance, and in
focus it stands on the fewest samples. In a tile of the picture, the sparsity ⟨|∇u|²⟩/⟨|∇u|⟩² and the kurtosis
⟨|∇u|⁴⟩/⟨|∇u|²⟩² are therefore largest where edges are sharp: those of opaque objects, of particles, of steps in phase.
The twin image of an in-line recording, noise and light out of focus are spread, and add values that change little from
one distance to the next: 4/π and 2 of speckle.

The range is swept in levels. Each has the middle of the field's band that makes the depth of focus λ/NA² about a
twentieth of the distance, or a fifth, where noise hides fine edges. A level of half the samples covers four times the
distance, and the sweep takes about as many steps from 0.1 to 1 mm as from 0.1 to 1 m. Steps are half a depth of focus.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy.ndimage
import torch
from numpy.typing import NDArray
from torch import Tensor

from holoview.light.numerics.sampling import frequency_indices, next_fast_length, taper
from holoview.light.optics.propagate import free_space

RELATIVE_DEPTHS = (1 / 20, 1 / 5)  # depth of focus of a level over the distance, until half its band has the same
_MANY_SAMPLES, _OF_MANY = 512, 1 / 8  # a level of more samples takes long, and its depth of focus is at least this part
MOST_SAMPLES = 1024  # of the band along its longer side, in the sweep
_LEAST_SAMPLES = 64
_BEYOND, _BEYOND_DEPTHS = 1.5, 8.0
"""A level is swept up to so many times beyond its range, or depths of focus: a maximum has to have both its flanks."""
RIM = 0.06  # of a side, over which the picture is faded out
_SMOOTH = 1 / 8  # of a side: light that is smoother is the beam
_SMOOTH_SAMPLES = 256  # of a side, at least, from which the beam is taken
_TILE = 24  # samples of the band, at least
_MOST_TILES = 12
TINY = 1e-30  # where a picture is dark


@dataclass(frozen=True, eq=False)
class Level:
    """The measures of a part of the field's band over a range of distances.

    samples: of the band along the longer side. distances_m: (n,), rising. own: the distances (first, last) that count;
    the others are those of the next levels. kurtosis, sparsity: (n, rows, columns) ⟨|∇u|⁴⟩/⟨|∇u|²⟩² and ⟨|∇u|²⟩/⟨|∇u|⟩²
    of each tile. edge_sparsity, variance: (n,) the measures of `holoview.holograms.fields.focus`. tile: samples along a
    side of a tile, of the band; rim: those left out at the picture's edges (y, x).
    """

    samples: int
    distances_m: NDArray[np.float64]
    own: tuple[float, float]
    kurtosis: NDArray[np.float64]
    sparsity: NDArray[np.float64]
    edge_sparsity: NDArray[np.float64]
    variance: NDArray[np.float64]
    tile: int
    rim: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Swept:
    """A field (y, x) whose depths are swept.

    values: complex64, without unscattered wave and smooth beam, faded at its edges. spectrum: of it, zero frequency in
    the middle. incident: the mean of the beam, in the field's unit; 0 if it was taken off already.
    """

    values: Tensor
    spectrum: Tensor
    pitch_m: tuple[float, float]
    wavelength_m: float
    incident: float

    @staticmethod
    def of(values: Tensor, pitch_m: tuple[float, float], wavelength_m: float) -> Swept:
        """The field (y, x) complex of an in-line recording: 1 + o + o*, beside a beam that may vary smoothly."""
        real = values.real.numpy()
        beam = _smooth(real)
        fading = [taper(n, RIM) for n in real.shape]
        flat = ((real - beam) * fading[0][:, None] * fading[1]).astype(np.complex64)
        scattered = torch.from_numpy(flat)
        incident = float(beam.mean()) if float(real.min()) >= 0 else 0.0
        return Swept(scattered, torch.fft.fftshift(torch.fft.fft2(scattered)), pitch_m, wavelength_m, incident)

    @property
    def sides_m(self) -> tuple[float, float]:
        """Lengths (y, x) of the field, m."""
        y, x = (n * pitch for n, pitch in zip(self.values.shape, self.pitch_m, strict=True))
        return y, x

    @property
    def side_m(self) -> float:
        """The longer one."""
        return max(self.sides_m)

    @property
    def most_samples(self) -> int:
        """Samples of the field along it."""
        return self.values.shape[int(np.argmax(self.sides_m))]

    @property
    def nearest_sampled_m(self) -> float:
        """side·pitch/λ: of objects so far away all fringes within the frame are sampled."""
        return self.side_m**2 / (self.most_samples * self.wavelength_m)

    def depth_of_focus_m(self, distance_m: float, samples: int | None = None) -> float:
        """λ/NA², of a part of the band."""
        samples = self.most_samples if samples is None else samples
        na = min(self.wavelength_m * samples / (2 * self.side_m), 1.0)
        if distance_m != 0:
            na = min(na, self.side_m / (2 * abs(distance_m)))
        return self.wavelength_m / na**2

    def band(self, samples: int) -> tuple[int, int]:
        """Rows and columns of the spectrum if its longer side has so many samples."""
        rows, columns = (
            min(n, max(8, 2 * round(n * pitch / self.side_m * samples / 2)))
            for n, pitch in zip(self.values.shape, self.pitch_m, strict=True)
        )
        return rows, columns

    def coarse(self, most: int) -> Swept:
        """With this many samples along the longer side at most."""
        if self.most_samples <= most:
            return self
        band = self.band(most)
        top, left = (n // 2 - k // 2 for n, k in zip(self.spectrum.shape, band, strict=True))
        cut = self.spectrum[top : top + band[0], left : left + band[1]] * (math.prod(band) / self.spectrum.numel())
        y, x = (side_m / n for side_m, n in zip(self.sides_m, band, strict=True))
        return Swept(torch.fft.ifft2(torch.fft.ifftshift(cut)), cut, (y, x), self.wavelength_m, self.incident)

    def levels(self, low_m: float, high_m: float, relative_depth: float) -> Iterator[tuple[int, float, float]]:
        """Samples and range of each level. relative_depth: as of `RELATIVE_DEPTHS`."""
        samples, distance_m = min(self.most_samples, MOST_SAMPLES), low_m
        while distance_m < high_m:
            half_m = self.side_m / (samples // 2)
            enough_m = (
                4
                * half_m**2
                / (self.wavelength_m * (max(relative_depth, _OF_MANY) if samples > _MANY_SAMPLES else relative_depth))
            )
            last = samples // 2 < _LEAST_SAMPLES
            top_m = high_m if last else min(high_m, enough_m)
            if top_m > distance_m:
                yield samples, distance_m, top_m
                distance_m = top_m
            samples //= 2

    def nodes(self, low_m: float, high_m: float, samples: int) -> NDArray[np.float64]:
        """Distances half a depth of focus apart, in a range and a little beyond it."""
        found = [max(low_m / _BEYOND, low_m - _BEYOND_DEPTHS * self.depth_of_focus_m(low_m, samples))]
        last_m = min(high_m * _BEYOND, high_m + _BEYOND_DEPTHS * self.depth_of_focus_m(high_m, samples))
        while found[-1] < last_m:
            found.append(found[-1] + 0.5 * self.depth_of_focus_m(found[-1], samples))
        return np.array(found)

    def seen(self, distances_m: NDArray[np.float64], samples: int) -> Iterator[Tensor]:
        """The field (y, x) of a part of the band at each of some distances, in its own frame."""
        band = self.band(samples)
        top, left = (n // 2 - k // 2 for n, k in zip(self.spectrum.shape, band, strict=True))
        cut = self.spectrum[top : top + band[0], left : left + band[1]]
        coarse = torch.fft.ifft2(torch.fft.ifftshift(cut)) * (math.prod(band) / math.prod(self.spectrum.shape))
        farthest_m = float(np.abs(distances_m).max())
        padded = [
            next_fast_length(math.ceil(n * (1 + min(0.5 * farthest_m * self.wavelength_m * n / side_m**2, 1.0))))
            for n, side_m in zip(band, self.sides_m, strict=True)
        ]
        whole = torch.zeros(padded, dtype=coarse.dtype)
        whole[: band[0], : band[1]] = coarse
        spectrum = torch.fft.fft2(whole)
        sines = [self.wavelength_m * n / (side_m * m) for n, side_m, m in zip(band, self.sides_m, padded, strict=True)]
        ky, kx = (torch.from_numpy(frequency_indices(m)) for m in padded)
        before_m, step_m, transfer = 0.0, math.nan, spectrum
        for distance_m in distances_m:
            way_m = float(distance_m) - before_m
            if not math.isclose(way_m, step_m, rel_tol=1e-6):
                transfer = free_space(way_m / self.wavelength_m, (sines[0], sines[1]), ky, kx, spectrum.dtype)
            spectrum, before_m, step_m = spectrum * transfer, float(distance_m), way_m
            yield torch.fft.ifft2(spectrum)[: band[0], : band[1]]

    def level(
        self, samples: int, own: tuple[float, float], told: Callable[[float], None], distances_m: NDArray[np.float64]
    ) -> Level:
        """The measures at some distances. told: called after each."""
        band = self.band(samples)
        rim = math.ceil(RIM * band[0]), math.ceil(RIM * band[1])
        inner = [n - 2 * r - 1 for n, r in zip(band, rim, strict=True)]
        tile = min(max(_TILE, math.ceil(min(band) / _MOST_TILES)), *inner)
        kurtosis, sparsity, edge_sparsity, variance = [], [], [], []
        for distance_m, whole in zip(distances_m, self.seen(distances_m, samples), strict=True):
            field = whole[rim[0] : band[0] - rim[0], rim[1] : band[1] - rim[1]]
            squared = squared_slopes(field)
            squared /= max(float(squared.mean()), TINY)
            slope = squared.sqrt()
            fourth, second, first = (
                torch.nn.functional.avg_pool2d(part[None, None], tile)[0, 0].double().clamp_min(TINY).numpy()
                for part in (squared.square(), squared, slope)
            )
            kurtosis.append(fourth / second**2)
            sparsity.append(second / first**2)
            edge_sparsity.append(math.sqrt(float(slope.std()) / max(float(slope.mean()), TINY)))
            intensity = field.real.square() + field.imag.square()
            variance.append(float(intensity.var()) / max(float(intensity.mean()), TINY) ** 2)
            told(float(distance_m))
        tiles = np.array(kurtosis), np.array(sparsity)
        return Level(samples, distances_m, own, *tiles, np.array(edge_sparsity), np.array(variance), tile, rim)


def _smooth(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Values (y, x) without what is finer than the beam."""
    return np.asarray(smoothed(torch.from_numpy(values), _SMOOTH_SAMPLES, _SMOOTH, truncate=3.0).numpy())


def smoothed(values: Tensor, samples: int, share: float, *, truncate: float = 4.0) -> Tensor:
    """Values (y, x) convolved with a Gaussian of σ = `share` of each side, cut off at `truncate`·σ.

    samples: of a side with more, means over blocks are smoothed, and interpolated.
    """
    blocks = [max(1, n // samples) for n in values.shape]
    coarse = torch.nn.functional.avg_pool2d(values[None, None], blocks, ceil_mode=True)[0, 0].numpy()
    sigmas = [n * share for n in coarse.shape]
    blurred = scipy.ndimage.gaussian_filter(coarse, sigmas, mode="nearest", truncate=truncate)
    return torch.nn.functional.interpolate(torch.from_numpy(blurred)[None, None], values.shape, mode="bilinear")[0, 0]


def squared_slopes(field: Tensor) -> Tensor:
    """|∇u|² (y − 1, x − 1) of a complex field (y, x), by differences of neighbours."""
    down, right = field[1:, :-1] - field[:-1, :-1], field[:-1, 1:] - field[:-1, :-1]
    squared = torch.view_as_real(down).square_().add_(torch.view_as_real(right).square_())
    return squared[..., 0] + squared[..., 1]  # a sum over two values is four times as slow
