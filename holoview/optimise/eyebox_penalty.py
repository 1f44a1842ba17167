"""The eyebox while optimising: how evenly it is filled, and a penalty with its gradient.

PSNR alone rewards smooth phase, which sends the light through a small spot of the eyebox. The penalty is the squared
coefficient of variation of block means over the first order, for each wavelength, averaged over wavelengths:

    P = mean_λ [ mean_b (E_λb / mean_b E_λb)² − 1 ],   E_λb = Σ_beams weight·⟨stop·|W|²/envelope⟩_b
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.optics.first_order import first_order
from holoview.optics.frame_inputs import pupil_with_effects
from holoview.optics.propagate import relay_transfer_function
from holoview.optimise.forward_model import ForwardModel

Tensor = torch.Tensor
Floats = NDArray[np.float64]


class EyeboxPenalty:
    """Judges and evens out the spectra of a model, behind the stops of the last relay."""

    def __init__(self, model: ForwardModel) -> None:
        self._model = model
        order = first_order(model.plan.grid)
        self._rows, self._columns = (torch.from_numpy(bins).to(model.device) for bins in order.bins)
        self._row_blocks, self._column_blocks = (
            torch.from_numpy(order.block_matrix(axis)).to(model.real_dtype).to(model.device) for axis in (0, 1)
        )
        self._stop_transmittances = {λ: self._stop_transmittance(λ) for λ in {beam.wavelength for beam in model.beams}}

    def block_means(self, amplitudes: Floats) -> Tensor:
        """Mean light (wavelength, blocks, blocks) for laser amplitudes (frame, wavelength); the present spectra."""
        model = self._model
        sides = (len(self._row_blocks), len(self._column_blocks))
        light = torch.zeros(amplitudes.shape[1], *sides, dtype=model.real_dtype, device=model.device)
        for i, beam in enumerate(model.beams):
            power = self._first_order(model.spectra[i]).abs().square() * self._stop_transmittances[beam.wavelength]
            weight = float(amplitudes[beam.frame, beam.wavelength])
            light[beam.wavelength] += weight * (self._row_blocks @ power @ self._column_blocks.T)
        return light

    def variation(self, blocks: Tensor) -> float:
        """Coefficient of variation of the eyebox's light, wavelengths added by luminance (`score.eyebox_of`'s)."""
        luminance = torch.from_numpy(self._model.plan.colour_weights[:, 1].copy()).to(blocks)
        light = torch.tensordot(luminance, blocks, dims=1)
        return float(light.std(correction=0) / light.mean())

    def add_penalty(self, blocks: Tensor, amplitudes: Floats, weight: float) -> float:
        """weight × P; its gradient is added to what the model carries."""
        model = self._model
        lit = blocks.mean(dim=(1, 2)) > 0
        mean = blocks.mean(dim=(1, 2), keepdim=True).clamp_min(torch.finfo(blocks.dtype).tiny)
        relative = blocks / mean
        square = relative.square().mean(dim=(1, 2), keepdim=True)
        scale = weight / max(int(lit.sum()), 1)
        slopes = scale * 2 * (relative - square) / (mean * relative[0].numel()) * lit[:, None, None]
        for i, beam in enumerate(model.beams):
            factor = float(amplitudes[beam.frame, beam.wavelength])
            if factor == 0.0:
                continue
            slope = self._row_blocks.T @ slopes[beam.wavelength] @ self._column_blocks
            pull = self._first_order(model.spectra[i]).conj() * (
                2 * factor * slope * self._stop_transmittances[beam.wavelength]
            )
            model.adjoint_spectra[i].index_put_((self._rows[:, None], self._columns[None, :]), pull, accumulate=True)
        return scale * float((square.flatten()[lit] - 1).sum())

    def _first_order(self, spectrum: Tensor) -> Tensor:
        return spectrum[self._rows[:, None], self._columns[None, :]]

    def _stop_transmittance(self, wavelength: int) -> Tensor:
        """Transmission of the last relay's stops and apodisation over the order; at no distance only they are left."""
        plan, cpu = self._model.plan, torch.device("cpu")
        glass = pupil_with_effects(plan, 1, wavelength)
        response = relay_transfer_function(plan.transfer(1, wavelength, 0.0), plan.grid, glass, torch.complex128, cpu)
        passed = response.abs().square()[self._rows.cpu()[:, None], self._columns.cpu()[None, :]]
        return passed.to(self._model.real_dtype).to(self._model.device)
