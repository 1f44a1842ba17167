"""The forward model where effects shape modulators' light: its first half is traced, so that any effect has a slope.

    light₁ ─▶ V = H_gap·F light₁ ─▶ E = F⁻¹V ─▶ W = F[E·light₂]

light is whatever the effects make of the optical paths that are sought. From W on, planes and gradients are those of
`Model`; torch carries them from W to the paths. An evaluation with its gradient takes 1.3 to 1.6 times as long as the
plain bench's (holochrome-8 at 512×384 samples, 5 planes, one thread), and what torch keeps on the way comes on top.
"""

from __future__ import annotations

import torch

from holoview.effects.dense import DenseLight
from holoview.optics.resample import upsampled
from holoview.optics.slm import phasor
from holoview.optics.source import plane_wave
from holoview.optimise.model import Model
from holoview.optimise.quantise import Jumps
from holoview.plan import Plan

Tensor = torch.Tensor


class TracedModel(Model):
    """Intensities and gradients of a plan whose modulators have effects, or another stroke than the nominal one.

    Slopes towards neighbouring levels aren't taken: gradients are those of the paths themselves.
    """

    def use(self, plan: Plan) -> None:
        """Goes on with a plan of the same grid, lasers and planes."""
        super().use(plan)
        self._light = DenseLight(plan, torch.empty(0))
        strokes = [panel.stroke_m for panel in plan.nominal.modulators]
        self._strokes = torch.tensor(strokes, dtype=torch.float64, device=self.device)[:, None, None]

    def forward(self, opd_m: Tensor, *, chromatic: bool = False) -> None:
        """Spectra behind the last modulator for nominal optical paths (frame, modulator, y, x), m."""
        assert not chromatic
        self.opd_m = opd_m.detach().requires_grad_()
        self.far, self._traced = None, []
        with torch.enable_grad():
            for i, beam in enumerate(self.beams):
                spectrum = self._spectrum(beam.frame, beam.wavelength, beam.source)
                self._traced.append(spectrum)
                self.spectra[i] = spectrum.detach()
        self.carried.zero_()

    def finish(self, gradient: Tensor, chromatic: Tensor | None = None, jumps: Jumps | None = None) -> None:
        """Adds ∂L/∂opd to `gradient` (frame, modulator, y, x)."""
        assert chromatic is None
        for spectrum, carried in zip(self._traced, self.carried, strict=True):
            (found,) = torch.autograd.grad(spectrum, self.opd_m, carried.conj())  # torch wants ∂L/∂Re + i·∂L/∂Im
            gradient += found
        self._traced = []

    def _spectrum(self, frame: int, wavelength: int, source: int) -> Tensor:
        """W of a beam."""
        light = self._transmission(frame, 0, wavelength)
        if self.plan.slopes[source, wavelength].any():
            light = light * plane_wave(self.plan, wavelength, source, self.complex, self.device)
        spectrum = self._padded_fft(light)
        if not self.two:
            return spectrum
        field = torch.fft.ifft2(spectrum * self.responses.gap(wavelength))[self.plan.grid.inside]
        return self._padded_fft(field * self._transmission(frame, 1, wavelength))

    def _transmission(self, frame: int, modulator: int, wavelength: int) -> Tensor:
        if self._light.is_dense(modulator):
            share = (self.opd_m[frame, modulator] / self._strokes[modulator]).to(self.real)
            return self._light.of(share, modulator, wavelength, self.complex)
        scale = self.plan.system.modulators[modulator].stroke_m / float(self._strokes[modulator])
        λ = float(self.plan.system.wavelengths_m[wavelength])
        return upsampled(phasor(self.opd_m[frame, modulator] * scale, λ, self.complex), self.plan.grid.upsample)

    def _padded_fft(self, field: Tensor) -> Tensor:
        (top, left), (ny, nx) = self.plan.grid.offset, field.shape
        py, px = self.plan.grid.padded
        edges = (left, px - nx - left, top, py - ny - top)
        return torch.fft.fft2(torch.nn.functional.pad(field, edges))


def model_for(plan: Plan, *, device: str, keep: bool) -> Model:
    """The model of a plan: the fast one unless effects shape the light of its modulators."""
    strokes = [[m.stroke_m for m in system.modulators] for system in (plan.system, plan.nominal)]
    shaped = plan.nominal.effects and (strokes[0] != strokes[1] or DenseLight(plan, torch.empty(0)).is_any_dense)
    return (TracedModel if shaped else Model)(plan, device=device, keep=keep)
