"""Transmissions of modulators and pupils of relays with the effects of a plan, on the simulation grid."""

from __future__ import annotations

import numpy as np
import torch

from holoview.model.effects.effect import MODULATOR_HOOKS
from holoview.model.effects.hook_contexts import ModulatorContext, RelayContext
from holoview.model.plan import Plan
from holoview.optics.propagate import direction_sines
from holoview.optics.slm import nearest_level
from holoview.optics.torch_effects import TorchEffects

Tensor = torch.Tensor


class SampledTransmissions:
    """Complex transmissions of a plan's modulators with effects, computed when they are asked for.

    plan: its frames are those of the system with effects.
    drive: (frame, modulator, y, x) in 0…1 of the stroke, for the frames of the nominal system.
    """

    def __init__(self, plan: Plan, drive: Tensor) -> None:
        self.plan, self.effects = plan, TorchEffects(plan.nominal.effect_values)
        self.drive = drive

    def is_sampled(self, modulator: int) -> bool:
        """Whether an effect changes a modulator so that its transmission isn't exp(2πi·opd/λ) of its pixels."""
        return bool(self.effects.on_modulator(modulator, *MODULATOR_HOOKS))

    @property
    def is_any_sampled(self) -> bool:
        """Whether `is_sampled` holds for some modulator."""
        return any(map(self.is_sampled, range(len(self.plan.system.modulators))))

    def sampled_transmission(self, frame: int, modulator: int, wavelength: int) -> Tensor | None:
        """The transmission (y, x) complex128 of a modulator's samples in a frame of `plan.system`.

        None if `is_sampled` doesn't hold for the modulator.
        """
        if not self.is_sampled(modulator):
            return None
        drive_frame, moment = divmod(frame, len(self.plan.moments))
        share, before, first = (
            nearest_level(self.drive[f, modulator], self.plan.nominal.modulators[modulator])
            for f in (drive_frame, drive_frame - 1, 0)  # frames repeat, so that before the first one comes the last
        )
        moment_factor = self.plan.moments[moment]
        return self.transmission_for(share, before, first, modulator, wavelength, torch.complex128, moment_factor)

    def transmission_for(
        self,
        share: Tensor,
        before: Tensor,
        first: Tensor,
        modulator: int,
        wavelength: int,
        dtype: torch.dtype,
        path_factor: float = 1.0,
    ) -> Tensor:
        """The transmission (y, x) of the samples of a modulator to which `share` (rows, columns) was sent.

        before, first: as `share`, what was sent in the frame before, and in the first frame.
        """
        context = self.context(modulator, wavelength)
        return context.sampled(self.effects.modulator_transmission(share, context, dtype, path_factor, before, first))

    def context(self, modulator: int, wavelength: int) -> ModulatorContext:
        """What hooks are told about a modulator at the wavelength of an index."""
        system = self.plan.system
        slm = system.modulators[modulator]
        λ = float(system.wavelengths_m[wavelength])
        upsample, laser = self.plan.grid.upsample, self._laser_number(wavelength)
        return ModulatorContext(modulator, λ, slm.stroke_m, slm.pitch_m, slm.shape, upsample, laser)

    def _laser_number(self, wavelength: int) -> int:
        """The number, from the shortest wavelength, of the nominal laser that emits a wavelength of the plan."""
        nominal_m = self.plan.nominal.wavelengths_m
        lines = len(self.plan.system.wavelengths_m) // len(nominal_m)
        return int(np.count_nonzero(nominal_m < nominal_m[wavelength // lines]))


def effects_pupil(plan: Plan, relay: int, wavelength: int) -> Tensor | None:
    """The pupil (P_y, P_x) complex128 that effects add to a relay, in `fftfreq` order; None if there is none."""
    λ = float(plan.system.wavelengths_m[wavelength])
    nominal = (plan.nominal.relay1, plan.nominal.relay2)[relay]
    radius = nominal.pupil_radius_sine(λ, plan.nominal.modulators[0].pitch_m)
    context = RelayContext(relay, λ, *direction_sines(plan.grid, λ), radius, nominal.centre_na)
    return TorchEffects(plan.nominal.effect_values).pupil(context, torch.complex128)
