"""What effects put into slots: dense transmissions of modulators, and pupils, for all that computes a frame."""

from __future__ import annotations

import torch

from holoview.model.effects.effect import MODULATOR_HOOKS
from holoview.model.effects.hook_contexts import ModulatorContext, RelayContext
from holoview.model.plan import Plan
from holoview.numerics.fft_grid import frequency_indices
from holoview.optics.slm import nearest_level
from holoview.optics.torch_effects import TorchEffects

Tensor = torch.Tensor


class SampledTransmissions:
    """Transmissions of modulators with the effects of a plan, made when they are asked for.

    drive (frame, modulator, y, x): 0…1 of the stroke, the nominal bench's frames.
    """

    def __init__(self, plan: Plan, drive: Tensor) -> None:
        self.plan, self.effects = plan, TorchEffects(plan.nominal.effect_values)
        self.drive = drive

    def is_sampled(self, modulator: int) -> bool:
        """Whether a modulator's transmission isn't that of its pixels' optical paths."""
        places = {f"modulator {modulator + 1}", "source" if modulator == 0 else ""}
        return any(places & set(one.acts_on) for one, _ in self.effects.with_hooks(*MODULATOR_HOOKS))

    @property
    def is_any_sampled(self) -> bool:
        """Whether some modulator's is."""
        return any(map(self.is_sampled, range(len(self.plan.system.modulators))))

    def sampled_transmission(self, frame: int, modulator: int, wavelength: int) -> Tensor | None:
        """Complex128 transmission of a modulator's samples (y, x), or None where it isn't dense."""
        if not self.is_sampled(modulator):
            return None
        sent, moment = divmod(frame, len(self.plan.moments))
        share = nearest_level(self.drive[sent, modulator], self.plan.nominal.modulators[modulator])
        return self.transmission_for(share, modulator, wavelength, torch.complex128, self.plan.moments[moment])

    def transmission_for(
        self, share: Tensor, modulator: int, wavelength: int, dtype: torch.dtype, factor: float = 1.0
    ) -> Tensor:
        """Transmission of a modulator's samples that was sent `share` (rows, columns) of its stroke."""
        at = self.context(modulator, wavelength)
        return at.sampled(self.effects.modulator_transmission(share, at, dtype, factor))

    def context(self, modulator: int, wavelength: int) -> ModulatorContext:
        """Where the hooks work."""
        system = self.plan.system
        panel = system.modulators[modulator]
        λ = float(system.wavelengths_m[wavelength])
        return ModulatorContext(modulator, λ, panel.stroke_m, panel.pitch_m, panel.shape, self.plan.grid.upsample)


def effects_pupil(plan: Plan, relay: int, wavelength: int) -> Tensor | None:
    """The pupil (P_y, P_x) complex128 that effects add to a relay, in `fftfreq` order; None where none does."""
    λ = float(plan.system.wavelengths_m[wavelength])
    sine_y, sine_x = (
        torch.from_numpy(frequency_indices(p)).double() * (λ * step)
        for p, step in zip(plan.grid.padded, plan.grid.frequency_step, strict=True)
    )
    nominal = (plan.nominal.relay1, plan.nominal.relay2)[relay]
    at = RelayContext(relay, λ, sine_y[:, None], sine_x[None, :], nominal.iris_na or 1.0)
    return TorchEffects(plan.nominal.effect_values).pupil(at, torch.complex128)
