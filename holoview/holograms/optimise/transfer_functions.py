"""Precomputed factors of a beam's spectrum: transfer functions, pupils and the spectrum of a pixel's shape."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.optimise.beams import FlatView, SpectralAxis, padded_rows, samples_a_pixel, slices, strided_view
from holoview.light.model.plan import Plan
from holoview.light.optics.bench import pupil_with_effects, pupil_without_effects, relay_response, wave_axes
from holoview.light.optics.propagate import (
    free_space_at,
    phase_per_metre,
    phase_wavelength_derivative,
    stopped,
)
from holoview.light.optics.slm import pixel_spectrum

Tensor = torch.Tensor

_MIN_TRANSMISSION = 1e-100  # of a pupil: below, the derivative of its logarithm is rounding, and no light passes


class TransferFunctions:
    """The factors of a plan for each wavelength in use, complex, at the frequencies that pass the relays' stops.

    column_width: of the blocks in which factors are stored, as `BeamFields` stores spectra. by_rows: for compiled
    passes, one block whose rows are contiguous.
    columns: these blocks behind the last modulator. planes (wavelength, plane, row, k_x) in each of them: H × pupil
    from the last modulator to a focal plane, divided by the length P_y·P_x of the FFT. plane_rows (k_y,): the row of a
    frequency. For compiled passes, frequencies ±k_y share a row if H is even, which takes half the memory.
    gap_tiles: blocks of the spectrum of pixels, and the columns of the gap's band that each makes.
    gap (wavelength, k_y, k_x) for each of these columns: H × pupil between the modulators, 1 for one modulator, times
    the spectrum of a pixel's shape if there is only one source.
    gap_storage (wavelength, k_y, tile, k_x): the same numbers as `gap` for compiled passes; None otherwise.
    pixel_shapes, illumination: (wavelength, source, n) for each axis y, x. The spectra of the pixel's shape, None if
    `gap` holds them; the plane waves at the pixels, None if all sources lie on the axis.

    They are evaluated in float64, on the CPU where the device has none. Memory is allocated for all of them before the
    first is computed, so that temporary tensors don't fragment it.
    """

    def __init__(
        self,
        plan: Plan,
        axes: tuple[SpectralAxis, SpectralAxis],
        column_width: int,
        dtype: torch.dtype,
        device: torch.device,
        *,
        by_rows: bool = False,
    ) -> None:
        self.plan, self.axes, self.dtype, self.device = plan, axes, dtype, device
        self._by_rows = by_rows
        self.gap_storage: Tensor | None = None
        self._float64_device = device if device.type == "cuda" else torch.device("cpu")
        self.wavelengths = [λ for λ in range(len(plan.system.wavelengths_m)) if plan.lit(λ)]
        self.columns = slices(axes[1].last.frequencies, column_width)
        self.gap_tiles = axes[1].tiles_of_blocks(column_width)
        self._gap_columns = [columns for _, tiles in self.gap_tiles for columns, _ in tiles]
        count = len(self.wavelengths)
        self._stored_rows, self.plane_rows = self._find_rows()
        self._flat_planes: dict[tuple[int, int, int], FlatView] = {}
        self._flat_gaps: dict[tuple[int, int], FlatView] = {}
        self.planes = self._empty_blocks(self.columns, count, len(plan.planes), len(self._stored_rows))
        self.gap = self._empty_gap(count)
        for i, λ in enumerate(self.wavelengths):
            self._fill(i, λ)
        self._free_space: dict[tuple[int, float], Tensor] = {}
        self.illumination = self._all_illumination() if plan.slopes.any() else None
        self.pixel_shapes: tuple[Tensor, Tensor] | None = self._all_pixel_shapes()
        if len(plan.slopes) == 1:
            y, x = self.pixel_shapes
            for block, columns in zip(self.gap, self._gap_columns, strict=True):
                block.mul_(y.mT).mul_(x[..., columns])
            self.pixel_shapes = None

    def of_plane(self, block: int, wavelengths: slice, plane: int) -> Tensor:
        """H × pupil to a plane in a block of columns, (wavelength, k_y, k_x)."""
        stored = self.planes[block][wavelengths, plane]
        return stored if len(self._stored_rows) == len(self.plane_rows) else stored[:, self.plane_rows]

    def flat_plane(self, wavelengths: slice, plane: int) -> FlatView:
        """The stored rows (wavelength, row, k_x) of a plane for compiled passes, which have one block."""
        key = (wavelengths.start, wavelengths.stop, plane)
        if key not in self._flat_planes:
            self._flat_planes[key] = strided_view(self.planes[0][wavelengths, plane])
        return self._flat_planes[key]

    def flat_gap(self, wavelengths: slice) -> FlatView:
        """The same of `gap_storage`."""
        key = (wavelengths.start, wavelengths.stop)
        if key not in self._flat_gaps:
            assert self.gap_storage is not None
            self._flat_gaps[key] = strided_view(self.gap_storage[wavelengths])
        return self._flat_gaps[key]

    @cached_property
    def flat_rows(self) -> NDArray[np.int64]:
        """The same of `plane_rows`."""
        return self.plane_rows.numpy()

    def _find_rows(self) -> tuple[Tensor, Tensor]:
        """The frequencies k_y whose rows of H are stored, as indices, and the row of each frequency."""
        signed = self._frequencies(1)[0].cpu().numpy()
        every = torch.arange(len(signed))
        if not (self._by_rows and self.wavelengths and self._is_even_in_y(signed)):
            return every, every
        _, stored, rows = np.unique(np.abs(signed), return_index=True, return_inverse=True)
        return torch.from_numpy(stored), torch.from_numpy(rows)

    def _is_even_in_y(self, ky: NDArray[np.int64]) -> bool:
        """Whether H × pupil is the same at ±k_y in all planes: in free space it is."""
        plan = self.plan
        if plan.nominal.eye is not None or pupil_with_effects(plan, 1, self.wavelengths[0]) is not None:
            return False
        supports = (plan.transfer(1, λ).support for λ in self.wavelengths)
        return all(np.array_equal(rows[ky % len(rows)], rows[-ky % len(rows)]) for rows in map(np.asarray, supports))

    def _empty_blocks(self, columns: Sequence[slice], *sizes: int) -> list[Tensor]:
        *outer, rows = sizes
        if self._by_rows:
            like = torch.empty(0, dtype=self.dtype, device=self.device)
            return [padded_rows(*outer, rows, part.stop - part.start, like=like) for part in columns]
        shapes = [(*outer, part.stop - part.start, rows) for part in columns]
        return [torch.empty(shape, dtype=self.dtype, device=self.device).mT for shape in shapes]

    def _empty_gap(self, count: int) -> list[Tensor]:
        rows = self.axes[0].gap.frequencies
        if not self._by_rows:
            return self._empty_blocks(self._gap_columns, count, rows)
        widths = [part.stop - part.start for part in self._gap_columns]
        like = torch.empty(0, dtype=self.dtype, device=self.device)
        storage = self.gap_storage = padded_rows(count, rows, len(widths), widths[0], like=like)
        return [storage[:, :, tile, :width] for tile, width in enumerate(widths)]

    def set_eyes(self, plan: Plan) -> None:
        """Changes to a plan whose planes are seen from other places of the pupil (`Plan.seen_from`).

        Without a pupil function, only stops and displacements change: the factors of free space are kept.
        """
        self.plan = plan
        for i, λ in enumerate(self.wavelengths):
            if pupil_with_effects(plan, 1, λ, plan.planes[0].eye) is None:
                self._stop_planes(i, λ)
            else:
                self._fill_planes(i, λ)

    def _fill_planes(self, i: int, wavelength: int) -> None:
        """Evaluates H × pupil of the wavelength that is number `i` of those in use, for each plane."""
        padded = math.prod(self.plan.grid.padded)
        for k in range(len(self.plan.planes)):
            transfer = self.relay_transfer(1, wavelength, k, self._stored_rows).div_(padded)
            for block, columns in zip(self.planes, self.columns, strict=True):
                block[i, k] = transfer[:, columns]

    def _stop_planes(self, i: int, wavelength: int) -> None:
        """The same without a pupil function, from the kept factors of free space."""
        ky, kx = (frequencies.to(self._float64_device) for frequencies in self._frequencies(1))
        if 0 in (len(ky), len(kx)):
            return
        before, stops = None, torch.empty(0)
        for k, plane in enumerate(self.plan.planes):
            transfer = self.plan.transfer(1, wavelength, k)
            if before is None or not transfer.has_stops_of(before):
                whole = torch.ones(len(ky), len(kx), dtype=self.dtype, device=self._float64_device)
                stops, before = stopped(whole, transfer, ky, kx).to(self.device), transfer
            key = (wavelength, plane.true_m)
            if key not in self._free_space:
                free = free_space_at(transfer, ky, kx, self.dtype) / math.prod(self.plan.grid.padded)
                self._free_space[key] = free.to(self.device)
            for block, columns in zip(self.planes, self.columns, strict=True):
                torch.mul(self._free_space[key][:, columns], stops[:, columns], out=block[i, k])

    def _fill(self, i: int, wavelength: int) -> None:
        """Evaluates the transfer functions of the wavelength that is number `i` of those in use."""
        self._fill_planes(i, wavelength)
        if self.plan.system.gap_m is None:
            for block in self.gap:
                block[i] = 1
            return
        transfer = self.relay_transfer(0, wavelength)
        for block, columns in zip(self.gap, self._gap_columns, strict=True):
            block[i] = transfer[:, columns]

    def transmittances(self, wavelength: int) -> tuple[float, float]:
        """Fractions of the power of a pixel's light, from modulator 1 and from the last one, that reach the planes."""
        last = self._transmitted_share(1, wavelength)
        return (1.0 if self.plan.system.gap_m is None else self._transmitted_share(0, wavelength)) * last, last

    def relay_transfer(self, relay: int, wavelength: int, plane: int = 0, rows: Tensor | slice = slice(None)) -> Tensor:
        """H × pupil in a relay's band, over the gap (0) or to a plane (1); complex128 with a pupil.

        rows: of the band's frequencies k_y.
        """
        ky, kx = (frequencies.to(self._float64_device) for frequencies in self._frequencies(relay))
        ky = ky[rows]
        transfer = self.plan.transfer(relay, wavelength, plane)
        if 0 in (len(ky), len(kx)):
            return torch.zeros(len(ky), len(kx), dtype=self.dtype, device=self._float64_device)
        pupil = pupil_with_effects(self.plan, relay, wavelength, self.plan.planes[plane].eye)
        return relay_response(transfer, ky, kx, pupil, self.dtype if pupil is None else torch.complex128)

    def stop_transmittance(self, wavelength: int) -> Tensor:
        """Power transmission of the last relay's stops and pupil without an eye, (frequency_y, frequency_x)."""
        ky, kx = (frequencies.to(self._float64_device) for frequencies in self._frequencies(1))
        pupil = pupil_with_effects(replace(self.plan, nominal=self.plan.nominal.with_(eye=None)), 1, wavelength)
        return relay_response(self.plan.stops(1, wavelength), ky, kx, pupil, self.dtype).abs().square()

    def across_gap(self, wavelength: int) -> Tensor:
        """H × pupil between the modulators, (frequency_y, frequency_x)."""
        assert self.plan.system.gap_m is not None
        return self.relay_transfer(0, wavelength).to(self.dtype).to(self.device)

    def phase_derivative(self, relay: int, wavelength: int) -> Tensor:
        """∂(phase of H)/∂λ per metre of distance, real, (frequency_y, frequency_x)."""
        ky, kx = self._frequencies(relay)
        λ = float(self.plan.system.wavelengths_m[wavelength])
        derivative = phase_wavelength_derivative(λ, self.plan.grid)[ky][:, kx]
        return derivative.to(torch.float64 if self.dtype == torch.complex128 else torch.float32).to(self.device)

    def focus_derivative(self, wavelength: int) -> Tensor | None:
        """∂(phase of H)/∂λ of the last relay because an eye is focused elsewhere, real; None without an eye."""
        eye, λ = self.plan.nominal.eye, float(self.plan.system.wavelengths_m[wavelength])
        if eye is None:
            return None
        (ky, kx), slope = self._frequencies(1), eye.focus_slope(λ)
        turns = [
            df * shift * k.double()
            for df, shift, k in zip(self.plan.grid.frequency_step, eye.image_shift_m(slope), (ky, kx), strict=True)
        ]
        derivative = slope * phase_per_metre(λ, self.plan.grid)[ky][:, kx] - 2 * math.pi * (
            turns[0][:, None] + turns[1]
        )
        return derivative.to(torch.float64 if self.dtype == torch.complex128 else torch.float32).to(self.device)

    def log_pupil_derivative(self, relay: int, wavelength: int) -> Tensor | None:
        """∂(ln pupil)/∂λ of a relay, 1/m; None where it has neither aberration nor apodisation.

        Central differences over 2·10⁻⁶·λ in float64. Stops don't contribute: their edges move with λ in whole samples.
        """
        step, λ = 1e-6, self.plan.system.wavelengths_m[wavelength]
        pupil = pupil_without_effects(self.plan, relay, wavelength)
        if pupil is None:
            return None
        sides = []
        for sign in (1, -1):
            moved = self.plan.system.edit({"wavelengths": self.plan.system.wavelengths_m * (1 + sign * step)})
            side = pupil_without_effects(replace(self.plan, system=moved), relay, wavelength)
            assert side is not None
            sides.append(side)
        derivative = torch.where(pupil.abs() > _MIN_TRANSMISSION, (sides[0] - sides[1]) / (2 * step * λ * pupil), 0)
        ky, kx = self._frequencies(relay)
        return derivative[ky][:, kx].to(self.dtype).to(self.device)

    def _frequencies(self, relay: int) -> tuple[Tensor, Tensor]:
        """Signed frequency indices (y, x) of a relay's band."""
        y, x = (axis.last_frequencies if relay else axis.gap_frequencies for axis in self.axes)
        return y, x

    def _transmitted_share(self, relay: int, wavelength: int) -> float:
        """The fraction of the power of a pixel's light that passes a relay, from the first source."""
        upsample = self.plan.grid.upsample
        shapes = [self._pixel_shape(axis, wavelength, 0, upsample).abs().square() for axis in (0, 1)]
        y, x = (shape[k].to(self._float64_device) for shape, k in zip(shapes, self._frequencies(relay), strict=True))
        passed = self.relay_transfer(relay, wavelength).abs().square().double()
        return float(y @ passed @ x) / float(shapes[0].sum() * shapes[1].sum())

    def _pixel_shape(self, axis: int, wavelength: int, source: int, samples: int) -> Tensor:
        """The spectrum of a square of `samples` along an axis at all frequencies, (P,) complex128."""
        return pixel_spectrum(self.plan.grid.padded[axis], samples, float(self.plan.slopes[source, wavelength, axis]))

    def _all_pixel_shapes(self) -> tuple[Tensor, Tensor]:
        samples, chosen = samples_a_pixel(self.plan), self._frequencies(0)

        def shape(axis: int, wavelength: int, source: int) -> Tensor:
            return self._pixel_shape(axis, wavelength, source, samples)[chosen[axis]]

        return self._for_all_beams(0, shape), self._for_all_beams(1, shape)

    def _all_illumination(self) -> tuple[Tensor, Tensor]:
        stride = samples_a_pixel(self.plan)

        def wave(axis: int, wavelength: int, source: int) -> Tensor:
            return wave_axes(self.plan, wavelength, source, stride)[axis]

        return self._for_all_beams(0, wave), self._for_all_beams(1, wave)

    def _for_all_beams(self, axis: int, vector: Callable[[int, int, int], Tensor]) -> Tensor:
        """A vector for an axis, each wavelength in use and each source, (wavelength, source, n)."""
        sources = range(len(self.plan.slopes))
        rows = [torch.stack([vector(axis, λ, source) for source in sources]) for λ in self.wavelengths]
        return torch.stack(rows).to(self.dtype).to(self.device)
