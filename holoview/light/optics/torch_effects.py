"""Active effects applied to light in torch: transmissions of modulators, pupils of relays, images of the camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.light.model.effects.effect import MODULATOR_HOOKS
from holoview.light.model.effects.hook_contexts import CameraContext, ModulatorContext, Pose, RelayContext
from holoview.light.model.effects.registry import ActiveEffects
from holoview.light.model.plan import Plan
from holoview.light.optics.propagate import direction_sines
from holoview.light.optics.slm import nearest_level, phasor

Tensor = torch.Tensor


class TorchEffects(ActiveEffects):
    """The active effects of a table, with their hooks on light."""

    def modulator_transmission(
        self,
        share: Tensor,
        context: ModulatorContext,
        dtype: torch.dtype,
        path_factor: float = 1.0,
        before: Tensor | None = None,
        first: Tensor | None = None,
    ) -> Tensor:
        """The complex transmission of a modulator, of pixels, or of samples where an effect needs them.

        share: (rows, columns) fraction of the stroke, as it was sent to each pixel.
        dtype: of the result.
        path_factor: factor of the optical paths, of one sample of an exposure.
        before, first: as `share`, of the pattern sent before and of the first of all; None where they aren't known.
        """

        def applied(hook: str, values: Tensor, shown: Tensor | None = None) -> Tensor:
            told = context if shown is None else replace(context, shown=shown)
            changed: Tensor = self.applied(hook, values, told, pairs=self.on_modulator(context.number, hook))
            return changed

        shown = applied("stroke_response", share)
        if before is not None and (settling := self.on_modulator(context.number, "settled_share")):
            shown_before = applied("stroke_response", before)
            told = context if first is None else replace(context, first_shown=applied("stroke_response", first))
            shown = self.applied("settled_share", shown, shown_before, told, pairs=settling)
        path_m = applied("optical_path", shown * context.stroke_m)
        if path_factor != 1.0:
            path_m = path_m * path_factor
        transmission = applied("transmission", phasor(path_m, context.wavelength_m, dtype), shown)
        pose = self.slm2_pose() if context.number == 1 else Pose()
        return transmission if pose.is_identity else context.warped(transmission, pose)

    def slm2_pose(self) -> Pose:
        """The position of the second modulator relative to its nominal one."""
        pose: Pose = self.applied("slm2_pose", Pose())
        return pose

    def pupil(self, context: RelayContext, dtype: torch.dtype) -> Tensor | None:
        """The complex pupil (rows, columns) that effects add to a relay; None if there is none."""
        pairs = [pair for pair in self.with_hooks("pupil") if f"relay {context.relay + 1}" in pair[0].acts_on]
        if not pairs:
            return None
        shape = (len(context.sine_y), context.sine_x.shape[1])
        uniform = torch.ones(shape, dtype=dtype, device=context.sine_y.device)
        pupil: Tensor = self.applied("pupil", uniform, context, pairs=pairs)
        return pupil

    def camera_pose(self, distance_m: float) -> Pose:
        """The position of the camera at a distance (m) relative to its nominal one."""
        pose: Pose = self.applied("camera_pose_at", self.applied("camera_pose", Pose()), distance_m)
        return pose

    def camera_motion(self) -> tuple[float, float]:
        """The line (y, x) along which the camera moves during an exposure, in camera pixels."""
        length_y, length_x = self.applied("camera_motion", (0.0, 0.0))
        return float(length_y), float(length_x)

    def ambient_light(self, context: CameraContext, dtype: torch.dtype) -> Tensor | None:
        """Counts per second (y, x) that light beside the lasers' adds; None if there is none."""
        if not self.with_hooks("ambient_light"):
            return None
        counts_per_s: Tensor = self.applied("ambient_light", torch.zeros(context.shape, dtype=dtype), context)
        return counts_per_s

    def image(self, image: Tensor, context: CameraContext) -> Tensor:
        """The light that the camera collects of an intensity (y, x)."""
        collected: Tensor = self.applied("image", image, context)
        return collected


# --- sampled on the simulation grid ----------------------------------------------------------------------------------


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

        before, first: as `share`, of the frame before and of the first frame.
        """
        context = self.context(modulator, wavelength)
        return context.sampled(self.effects.modulator_transmission(share, context, dtype, path_factor, before, first))

    def source_light(self, wave: Tensor, wavelength: int) -> Tensor:
        """The light before the first modulator: a plane wave (y, x) of the source with the effects on the source."""
        pairs = [pair for pair in self.effects.on_modulator(0, "transmission") if "source" in pair[0].acts_on]
        light: Tensor = self.effects.applied("transmission", wave, self.context(0, wavelength), pairs=pairs)
        return light

    def context(self, modulator: int, wavelength: int) -> ModulatorContext:
        """The context of the hooks on a modulator at the wavelength of an index."""
        return modulator_context(self.plan, modulator, wavelength, self._laser_number(wavelength))

    def _laser_number(self, wavelength: int) -> int:
        """The number, from the shortest wavelength, of the nominal laser that emits a wavelength of the plan."""
        nominal_m = self.plan.nominal.wavelengths_m
        return int(np.count_nonzero(nominal_m < nominal_m[self.plan.laser_of(wavelength)]))


class FieldTransmissions:
    """The samples of a complex field, which the plane of a field multiplies its illumination by.

    plan: its wavelengths are those of the system with effects. field: (frame, wavelength, y, x) complex, of the nominal
    system; an array or a tensor.
    """

    def __init__(self, plan: Plan, field: Tensor | NDArray[np.complexfloating]) -> None:
        self._plan, self._field = plan, field

    def is_sampled(self, modulator: int) -> bool:
        """Always."""
        return True

    def sampled_transmission(self, frame: int, modulator: int, wavelength: int) -> Tensor:
        """The field (y, x) complex128 of a frame; a line of a laser's spectrum has the field of its laser."""
        samples = self._field[frame, self._plan.laser_of(wavelength)]
        tensor = samples if isinstance(samples, Tensor) else torch.from_numpy(np.array(samples))
        return tensor.to(torch.complex128)


def modulator_context(
    plan: Plan,
    number: int,
    wavelength: int,
    laser: int,
    frame: tuple[int, int] | None = None,
    centre_m: tuple[float, float] = (0.0, 0.0),
) -> ModulatorContext:
    """The context of the hooks on modulator `number` at the wavelength of an index.

    laser: its number, 0 for the shortest wavelength of the bench. frame: (rows, columns) of the modulator that the
    plan's is a part of; its own where None. centre_m: (y, x) of that part.
    """
    slm, λ = plan.system.modulators[number], float(plan.system.wavelengths_m[wavelength])
    return ModulatorContext(number, λ, slm.stroke_m, slm.pitch_m, slm.shape, plan.grid.upsample, laser, frame, centre_m)


def effects_pupil(plan: Plan, relay: int, wavelength: int) -> Tensor | None:
    """The pupil (P_y, P_x) complex128 that effects add to a relay, in `fftfreq` order; None if there is none."""
    λ = float(plan.system.wavelengths_m[wavelength])
    nominal = plan.nominal.way.relays[relay]
    radius = nominal.pupil_radius_sine(λ, plan.nominal.way.orders_m[relay])
    context = RelayContext(relay, λ, *direction_sines(plan.grid, λ), radius, nominal.centre_na)
    return TorchEffects(plan.nominal.effect_values).pupil(context, torch.complex128)
