"""Penalty, with its gradient, on an unevenly filled eyebox.

PSNR alone rewards smooth phase, which sends the light through a small spot of the eyebox. The penalty is the squared
coefficient of variation of the light's means over blocks b of the first order, averaged over wavelengths:

    P = mean_λ [ mean_b (E_λb / mean_b E_λb)² − 1 ],   E_λb = Σ_beams a·⟨stop·|W|²/envelope⟩_b

with the laser amplitude a, the spectrum W of a beam, the power transmission `stop` of the last relay, and the envelope
of a pixel's diffraction, which no pattern can change.
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
    """Block means, variation and penalty of a model's present spectra, behind the stops of the last relay."""

    def __init__(self, model: ForwardModel) -> None:
        self._model = model
        order = first_order(model.plan.grid)
        self._rows, self._columns = (torch.from_numpy(bins).to(model.device) for bins in order.bins)
        self._row_blocks, self._column_blocks = (
            torch.from_numpy(order.block_matrix(axis)).to(model.real_dtype).to(model.device) for axis in (0, 1)
        )
        self._stop_transmittances = {λ: self._stop_transmittance(λ) for λ in {beam.wavelength for beam in model.beams}}

    def block_means(self, amplitudes: Floats) -> Tensor:
        """Mean light E (wavelength, blocks, blocks) for laser amplitudes (frame, wavelength)."""
        model = self._model
        sides = (len(self._row_blocks), len(self._column_blocks))
        light = torch.zeros(amplitudes.shape[1], *sides, dtype=model.real_dtype, device=model.device)
        for i, beam in enumerate(model.beams):
            power = self._first_order(model.spectra[i]).abs().square() * self._stop_transmittances[beam.wavelength]
            amplitude = float(amplitudes[beam.frame, beam.wavelength])
            light[beam.wavelength] += amplitude * (self._row_blocks @ power @ self._column_blocks.T)
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
        for i, beam in enumerate(model.beams):
            amplitude = float(amplitudes[beam.frame, beam.wavelength])
            if amplitude == 0.0:
                continue
            power_gradient = self._row_blocks.T @ block_gradient[beam.wavelength] @ self._column_blocks
            adjoint = self._first_order(model.spectra[i]).conj() * (
                2 * amplitude * power_gradient * self._stop_transmittances[beam.wavelength]
            )
            model.adjoint_spectra[i].index_put_((self._rows[:, None], self._columns[None, :]), adjoint, accumulate=True)
        return scale * float((square.flatten()[lit] - 1).sum())

    def _first_order(self, spectrum: Tensor) -> Tensor:
        return spectrum[self._rows[:, None], self._columns[None, :]]

    def _stop_transmittance(self, wavelength: int) -> Tensor:
        """Power transmission of the last relay's stops and apodisation over the first order: its |H|² at distance 0."""
        plan, cpu = self._model.plan, torch.device("cpu")
        pupil = pupil_with_effects(plan, 1, wavelength)
        transfer = relay_transfer_function(plan.transfer(1, wavelength, 0.0), plan.grid, pupil, torch.complex128, cpu)
        power = transfer.abs().square()[self._rows.cpu()[:, None], self._columns.cpu()[None, :]]
        return power.to(self._model.real_dtype).to(self._model.device)
