"""The forward model where effects shape modulators' light: its first half is traced, so that any effect has a slope.

    light₁ ─▶ V = H_gap·F light₁ ─▶ E = F⁻¹V ─▶ W = F[E·light₂]

light is whatever the effects make of the optical paths that are sought. From W on, planes and gradients are those of
`Model`; torch carries them from W to the paths. An evaluation with its gradient takes 1.3 to 1.6 times as long as the
plain bench's (holochrome-8 at 512×384 samples, 5 planes, one thread), and what torch keeps on the way comes on top.
"""

from __future__ import annotations

import torch

from holoview.model.plan import Plan
from holoview.numerics.resample import upsample_nearest
from holoview.optics.sampled_effects import SampledTransmissions
from holoview.optics.slm import phasor
from holoview.optics.source import plane_wave
from holoview.optimise.forward_model import ForwardModel
from holoview.optimise.level_gradients import LevelSteps

Tensor = torch.Tensor


class AutogradModel(ForwardModel):
    """Intensities and gradients of a plan whose modulators have effects, or another stroke than the nominal one.

    Slopes towards neighbouring levels aren't taken: gradients are those of the paths themselves.
    """

    def set_plan(self, plan: Plan) -> None:
        """Goes on with a plan of the same grid, lasers and planes."""
        super().set_plan(plan)
        self._dense_light = SampledTransmissions(plan, torch.empty(0))
        strokes = [panel.stroke_m for panel in plan.nominal.modulators]
        self._strokes = torch.tensor(strokes, dtype=torch.float64, device=self.device)[:, None, None]

    def forward(self, opd_m: Tensor, *, wavelength_gradient: bool = False) -> None:
        """Spectra behind the last modulator for nominal optical paths (frame, modulator, y, x), m."""
        assert not wavelength_gradient
        self.opd_m = opd_m.detach().requires_grad_()
        self.z_weighted_adjoint, self._graph_spectra = None, []
        with torch.enable_grad():
            for i, beam in enumerate(self.beams):
                spectrum = self._spectrum(beam.frame, beam.wavelength, beam.source)
                self._graph_spectra.append(spectrum)
                self.spectra[i] = spectrum.detach()
        self.adjoint_spectra.zero_()

    def accumulate_gradients(
        self, path_gradient: Tensor, wavelength_gradient: Tensor | None = None, level_steps: LevelSteps | None = None
    ) -> None:
        """Adds ∂L/∂opd to `gradient` (frame, modulator, y, x)."""
        assert wavelength_gradient is None
        for spectrum, carried in zip(self._graph_spectra, self.adjoint_spectra, strict=True):
            (found,) = torch.autograd.grad(spectrum, self.opd_m, carried.conj())  # torch wants ∂L/∂Re + i·∂L/∂Im
            path_gradient += found
        self._graph_spectra = []

    def _spectrum(self, frame: int, wavelength: int, source: int) -> Tensor:
        """W of a beam."""
        light = self._modulator_transmission(frame, 0, wavelength)
        if self.plan.slopes[source, wavelength].any():
            light = light * plane_wave(self.plan, wavelength, source, self.complex_dtype, self.device)
        spectrum = self._padded_fft(light)
        if not self.has_second_modulator:
            return spectrum
        field = torch.fft.ifft2(spectrum * self.transfer_functions.across_gap(wavelength))[self.plan.grid.inside]
        return self._padded_fft(field * self._modulator_transmission(frame, 1, wavelength))

    def _modulator_transmission(self, frame: int, modulator: int, wavelength: int) -> Tensor:
        if self._dense_light.is_sampled(modulator):
            share = (self.opd_m[frame, modulator] / self._strokes[modulator]).to(self.real_dtype)
            return self._dense_light.transmission_for(share, modulator, wavelength, self.complex_dtype)
        scale = self.plan.system.modulators[modulator].stroke_m / float(self._strokes[modulator])
        λ = float(self.plan.system.wavelengths_m[wavelength])
        return upsample_nearest(
            phasor(self.opd_m[frame, modulator] * scale, λ, self.complex_dtype), self.plan.grid.upsample
        )

    def _padded_fft(self, field: Tensor) -> Tensor:
        (top, left), (ny, nx) = self.plan.grid.offset, field.shape
        py, px = self.plan.grid.padded
        edges = (left, px - nx - left, top, py - ny - top)
        return torch.fft.fft2(torch.nn.functional.pad(field, edges))


def make_forward_model(plan: Plan, *, device: str, keep_fields: bool) -> ForwardModel:
    """The model of a plan: the fast one unless effects shape the light of its modulators."""
    strokes = [[m.stroke_m for m in system.modulators] for system in (plan.system, plan.nominal)]
    shaped = plan.nominal.effects and (
        strokes[0] != strokes[1] or SampledTransmissions(plan, torch.empty(0)).is_any_sampled
    )
    return (AutogradModel if shaped else ForwardModel)(plan, device=device, keep_fields=keep_fields)
