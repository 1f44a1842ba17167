"""Penalty, with its gradient, on an unevenly filled eyebox.

PSNR alone rewards smooth phase, which sends the light through a small spot of the eyebox. The penalty is the squared
coefficient of variation of the light's means over blocks b of the first order, averaged over wavelengths:

    P = mean_λ [ mean_b (E_λb / mean_b E_λb)² − 1 ],   E_λb = Σ_beams a·⟨stop·|W|²/envelope⟩_b

with the laser amplitude a, the spectrum W of a beam, the power transmission `stop` of the last relay, and the envelope
of a pixel's diffraction, which no pattern can change.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.optimise.forward_model import ForwardModel
from holoview.light.optics.slm import first_order

Tensor = torch.Tensor
Floats = NDArray[np.float64]


class EyeboxPenalty:
    """Block means, variation and penalty of a model's present spectra, behind the stops of the last relay."""

    def __init__(self, model: ForwardModel) -> None:
        self._model = model
        order = first_order(model.plan.grid)
        chosen, blocks = [], []
        for axis, band in enumerate(model.axes):
            bins = order.bins[axis]
            entries = np.full(model.plan.grid.padded[axis], -1)
            entries[band.last_frequencies.numpy()] = np.arange(band.last.frequencies)
            passes = entries[bins] >= 0  # other bins are dark: they count in their blocks and add nothing
            chosen.append(torch.from_numpy(entries[bins][passes]).to(model.device))
            matrix = torch.from_numpy(order.block_matrix(axis)[:, passes])
            blocks.append(matrix.to(model.real_dtype).to(model.device))
        self._rows, self._columns = chosen
        self._row_blocks, self._column_blocks = blocks

    def block_means(self, amplitudes: Floats) -> Tensor:
        """Mean light E (wavelength, blocks, blocks) for laser amplitudes (frame, wavelength)."""
        model = self._model
        sides = (len(self._row_blocks), len(self._column_blocks))
        light = torch.zeros(amplitudes.shape[1], *sides, dtype=model.real_dtype, device=model.device)
        for laser, (frame, λ) in enumerate(model.lasers):
            for source in range(model.source_count):
                field = self._first_order(laser, source)
                power = field.real.square().addcmul_(field.imag, field.imag).mul_(self._stop_transmittances[λ])
                means = self._row_blocks @ power @ self._column_blocks.T
                light[λ].add_(means, alpha=float(amplitudes[frame, λ]))
        return light

    def variation(self, blocks: Tensor) -> float:
        """Coefficient of variation over blocks, wavelengths summed by luminance, as in `eyebox_uniformity_of`."""
        luminance = torch.from_numpy(self._model.plan.colour_weights[:, 1].copy()).to(blocks)
        light = torch.tensordot(luminance, blocks, dims=1)
        return float(light.std(correction=0) / light.mean())

    def add_penalty(self, blocks: Tensor, amplitudes: Floats, weight: float) -> float:
        """Returns weight × P and adds its conjugate gradient to the model's `adjoint_spectra`."""
        model = self._model
        lit = blocks.mean(dim=(1, 2)) > 0
        mean = blocks.mean(dim=(1, 2), keepdim=True).clamp_min(torch.finfo(blocks.dtype).tiny)
        relative = blocks / mean
        square = relative.square().mean(dim=(1, 2), keepdim=True)
        scale = weight / max(int(lit.sum()), 1)
        block_gradient = scale * 2 * (relative - square) / (mean * relative[0].numel()) * lit[:, None, None]
        for laser, (frame, λ) in enumerate(model.lasers):
            amplitude = float(amplitudes[frame, λ])
            if amplitude == 0.0:
                continue
            power_gradient = self._row_blocks.T @ block_gradient[λ] @ self._column_blocks
            factor = 2 * amplitude * power_gradient * self._stop_transmittances[λ]
            for source in range(model.source_count):
                adjoint = model.adjoint_spectrum(laser, source)
                part = torch.zeros_like(adjoint.whole)
                part[self._rows[:, None], self._columns[None, :]] = self._first_order(laser, source).conj() * factor
                adjoint.add(slice(0, part.shape[1]), part)
        return scale * float((square.flatten()[lit] - 1).sum())

    def _first_order(self, laser: int, source: int) -> Tensor:
        return self._model.spectrum(laser, source).whole[self._rows[:, None], self._columns[None, :]]

    @cached_property
    def _stop_transmittances(self) -> dict[int, Tensor]:
        """Power transmission of the last relay's stops and pupil over the first order, of each wavelength in use,
        wherever an eye is."""
        model, chosen = self._model, (self._rows[:, None], self._columns[None, :])
        powers = {λ: model.transfer_functions.stop_transmittance(λ) for λ in model.transfer_functions.wavelengths}
        return {λ: power.to(model.device, model.real_dtype)[chosen] for λ, power in powers.items()}
