"""The forward model with torch's automatic differentiation, for benches whose effects change the modulators' light.

The spectra W behind the last modulator come from the stages of the reference executor (`engine.frame`), which torch
differentiates with respect to the optical paths, so that effects need no adjoint of their own. From W on, planes and
gradients are those of `ForwardModel`.
"""

from __future__ import annotations

from dataclasses import replace

import torch

from holoview.holograms.optimise.forward_model import ForwardModel
from holoview.holograms.optimise.kernels import Kernels
from holoview.holograms.optimise.level_gradients import LevelSteps
from holoview.holograms.optimise.transfer_functions import TransferFunctions
from holoview.light.engine.frame import spectrum_behind_modulators
from holoview.light.engine.torch_executor import TorchPropagation
from holoview.light.model.plan import Plan
from holoview.light.optics.torch_effects import SampledTransmissions

Tensor = torch.Tensor


class AutogradModel(ForwardModel):
    """Intensities and gradients of a plan whose modulators have effects, or another stroke than the nominal one.

    Gradients are derivatives also for modulators with few levels (`level_steps` is ignored). There is no gradient of
    the wavelengths.
    """

    def set_plan(self, plan: Plan) -> None:
        """Changes to a plan of the same grid, lasers and planes."""
        super().set_plan(plan)
        self._patterns = _Patterns(plan, self.complex_dtype)
        unshifted = replace(plan, grid=replace(plan.grid, offset=(0, 0)))  # where `beams` places the field
        is_double = self.complex_dtype == torch.complex128
        self._stages = _Stages(unshifted, self._patterns, double=is_double, device=self.device)
        self._stages.transfer_functions = self.transfer_functions

    @property
    def is_fixed_work(self) -> bool:
        """As there: torch's own graph of derivatives is made anew in each call."""
        return False

    def forward(self, opd_m: Tensor, *, wavelength_gradient: bool = False) -> None:
        """Computes the spectra behind the last modulator for nominal optical paths (frame, modulator, y, x), m."""
        assert not wavelength_gradient
        self.opd_m = opd_m.detach().requires_grad_()
        self._graph_spectra = []
        with torch.enable_grad():
            self._patterns.nominal_opd_m = self.opd_m
            for i, (frame, wavelength) in enumerate(self.lasers):
                for source in range(self.source_count):
                    spectrum = spectrum_behind_modulators(self._stages, wavelength, frame, source).values
                    self._graph_spectra.append((spectrum, i, source))
                    self.spectrum(i, source).write(slice(0, spectrum.shape[1]), spectrum.detach())
        self._clear_adjoints(False)

    def accumulate_gradients(
        self, path_gradient: Tensor, wavelength_gradient: Tensor | None = None, level_steps: LevelSteps | None = None
    ) -> None:
        """Adds ∂L/∂opd to `path_gradient` (frame, modulator, y, x)."""
        assert wavelength_gradient is None
        for spectrum, laser, source in self._graph_spectra:
            adjoint = self.adjoint_spectrum(laser, source).whole
            (gradient,) = torch.autograd.grad(spectrum, self.opd_m, adjoint.conj())  # torch: ∂L/∂Re + i·∂L/∂Im
            path_gradient += gradient
        self._graph_spectra = []


class _Stages(TorchPropagation):
    """The stages up to the spectrum behind the last modulator."""

    transfer_functions: TransferFunctions

    def transfer(self, relay: int, wavelength: int, plane: int = 0) -> Tensor:
        """Transfer function × pupil of the gap."""
        assert relay == 0
        return self.transfer_functions.across_gap(wavelength)


class _Patterns:
    """The patterns of modulators with effects. nominal_opd_m: their nominal paths (frame, modulator, y, x), m."""

    nominal_opd_m: Tensor

    def __init__(self, plan: Plan, dtype: torch.dtype) -> None:
        self._transmissions, self._dtype = SampledTransmissions(plan, torch.empty(0)), dtype
        self._strokes_m = [modulator.stroke_m for modulator in plan.nominal.modulators]
        pairs = zip(plan.system.modulators, self._strokes_m, strict=True)
        self._factors = [modulator.stroke_m / nominal_m for modulator, nominal_m in pairs]

    def path_m(self, frame: int, modulator: int) -> Tensor:
        """Optical path (y, x) of a modulator's pixels, m, with the stroke that it really has."""
        return self.nominal_opd_m[frame, modulator] * self._factors[modulator]

    def is_sampled(self, modulator: int) -> bool:
        """Whether an effect changes a modulator so that its transmission isn't exp(2πi·opd/λ) of its pixels."""
        return self._transmissions.is_sampled(modulator)

    def transmission(self, frame: int, modulator: int, wavelength: int) -> Tensor | None:
        """The transmission (y, x) of a modulator's samples; None if it is exp(2πi·opd/λ) of its pixels."""
        if not self.is_sampled(modulator):
            return None
        real, stroke_m = torch.empty(0, dtype=self._dtype).real.dtype, self._strokes_m[modulator]
        drive, before, first = ((self.nominal_opd_m[f, modulator] / stroke_m).to(real) for f in (frame, frame - 1, 0))
        return self._transmissions.transmission_for(drive, before, first, modulator, wavelength, self._dtype)


def make_forward_model(
    plan: Plan, *, device: str, double: bool = False, rows_at_a_time: int | None = None, kernels: Kernels
) -> ForwardModel:
    """The model of a plan: an `AutogradModel` if effects change the light of its modulators. Arguments as there."""
    strokes_m = [[m.stroke_m for m in system.modulators] for system in (plan.system, plan.nominal)]
    needs_autograd = plan.nominal.effects and (
        strokes_m[0] != strokes_m[1] or SampledTransmissions(plan, torch.empty(0)).is_any_sampled
    )
    model = AutogradModel if needs_autograd else ForwardModel
    return model(plan, double=double, device=device, rows_at_a_time=rows_at_a_time, kernels=kernels)
