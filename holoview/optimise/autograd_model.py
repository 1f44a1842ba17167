"""The forward model with torch's automatic differentiation, for benches whose effects change the modulators' light.

    t₁ ─▶ V = H_gap·F[s·t₁] ─▶ E = F⁻¹V ─▶ W = F[E·t₂]

with the illumination s and the transmissions t that the effects make of the optical paths. From W on, planes and
gradients are those of `ForwardModel`; torch differentiates W with respect to the paths, so that effects need no adjoint
of their own. An evaluation with its gradient takes 1.3 to 1.6 times as long as that of a bench without effects
(holochrome-8 at 512×384 samples, 5 planes, one thread), and torch holds the intermediate fields in addition.
"""

from __future__ import annotations

import torch

from holoview.model.plan import Plan
from holoview.numerics.pruned_fft import PrunedTransform
from holoview.numerics.resample import upsample_nearest
from holoview.optics.slm import phasor
from holoview.optics.source import plane_wave
from holoview.optics.torch_effects import SampledTransmissions
from holoview.optimise.forward_model import ForwardModel
from holoview.optimise.level_gradients import LevelSteps

Tensor = torch.Tensor


class AutogradModel(ForwardModel):
    """Intensities and gradients of a plan whose modulators have effects, or another stroke than the nominal one.

    Gradients are derivatives also for modulators with few levels (`level_steps` is ignored). There is no gradient of
    the wavelengths.
    """

    def set_plan(self, plan: Plan) -> None:
        """Changes to a plan of the same grid, lasers and planes."""
        super().set_plan(plan)
        self._transmissions = SampledTransmissions(plan, torch.empty(0))
        strokes = [modulator.stroke_m for modulator in plan.nominal.modulators]
        self._strokes = torch.tensor(strokes, dtype=torch.float64, device=self.device)[:, None, None]

    def forward(self, opd_m: Tensor, *, wavelength_gradient: bool = False) -> None:
        """Computes the spectra behind the last modulator for nominal optical paths (frame, modulator, y, x), m."""
        assert not wavelength_gradient
        self.opd_m = opd_m.detach().requires_grad_()
        self._graph_spectra = []
        with torch.enable_grad():
            for i, (frame, wavelength) in enumerate(self.lasers):
                for source in range(self.source_count):
                    spectrum = self._spectrum(frame, wavelength, source)
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

    def _spectrum(self, frame: int, wavelength: int, source: int) -> Tensor:
        """W of a beam (frequency_y, frequency_x)."""
        field = self._modulator_transmission(frame, 0, wavelength)
        if self.plan.slopes[source, wavelength].any():
            field = field * plane_wave(self.plan, wavelength, source, self.complex_dtype, self.device)
        y, x = self.axes
        spectrum = PrunedTransform((y.undisplaced_gap, x.undisplaced_gap)).forward(field)
        if not self.has_second_modulator:
            return spectrum
        field = PrunedTransform((y.gap, x.gap)).inverse(spectrum * self.transfer_functions.across_gap(wavelength))
        return PrunedTransform((y.last, x.last)).forward(field * self._modulator_transmission(frame, 1, wavelength))

    def _modulator_transmission(self, frame: int, modulator: int, wavelength: int) -> Tensor:
        """Complex transmission (y, x) of a modulator on the simulation grid."""
        if self._transmissions.is_sampled(modulator):
            drive, before, first = (
                (self.opd_m[f, modulator] / self._strokes[modulator]).to(self.real_dtype) for f in (frame, frame - 1, 0)
            )
            return self._transmissions.transmission_for(drive, before, first, modulator, wavelength, self.complex_dtype)
        scale = self.plan.system.modulators[modulator].stroke_m / float(self._strokes[modulator])
        λ = float(self.plan.system.wavelengths_m[wavelength])
        pixels = phasor(self.opd_m[frame, modulator] * scale, λ, self.complex_dtype)
        return upsample_nearest(pixels, self.plan.grid.upsample)


def make_forward_model(
    plan: Plan, *, device: str, double: bool = False, rows_at_a_time: int | None = None
) -> ForwardModel:
    """The model of a plan: an `AutogradModel` if effects change the light of its modulators. Arguments as there."""
    strokes_m = [[m.stroke_m for m in system.modulators] for system in (plan.system, plan.nominal)]
    needs_autograd = plan.nominal.effects and (
        strokes_m[0] != strokes_m[1] or SampledTransmissions(plan, torch.empty(0)).is_any_sampled
    )
    model = AutogradModel if needs_autograd else ForwardModel
    return model(plan, double=double, device=device, rows_at_a_time=rows_at_a_time)
