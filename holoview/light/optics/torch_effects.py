"""Active effects applied to light in torch: transmissions of modulators, pupils of relays, images of the camera."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.light.model.effects.effect import MODULATOR_HOOKS
from holoview.light.model.effects.hook_contexts import CameraContext, ModulatorContext, Pose, RelayContext
from holoview.light.model.effects.registry import ActiveEffects
from holoview.light.model.plan import Plan
from holoview.light.model.system import System
from holoview.light.optics.propagate import direction_sines
from holoview.light.optics.slm import nearest_level, phasor

Tensor = torch.Tensor
_NOMINAL = Pose()


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

        parts = {f"modulator {context.number + 1}", "source" if context.number == 0 else ""}
        shown = self.shown(share, context, parts, before, first)
        path_m = self.on_light("optical_path", shown * context.stroke_m, context, parts)
        if path_factor != 1.0:
            path_m = path_m * path_factor
        pixels = phasor(path_m, context.wavelength_m, dtype)
        transmission = self.on_light("transmission", pixels, replace(context, shown=shown), parts)
        pose = self.element_pose(parts, self.slm2_pose() if context.number == 1 else Pose())
        return transmission if pose.is_identity else context.warped(transmission, pose)

    def on_light(self, hook: str, values: Tensor, context: ModulatorContext, parts: Iterable[str]) -> Tensor:
        """A map (rows, columns) of pixels or samples passed through the hooks of the effects on some parts."""
        changed: Tensor = self.applied(hook, values, context, pairs=self.on_parts(parts, hook))
        return changed

    def shown(
        self,
        share: Tensor,
        context: ModulatorContext,
        parts: Iterable[str],
        before: Tensor | None,
        first: Tensor | None,
    ) -> Tensor:
        """What pixels (rows, columns) show of what was sent to them; before, first: as `modulator_transmission`."""
        shown = self.on_light("stroke_response", share, context, parts)
        if before is None or not (settling := self.on_parts(parts, "settled_share")):
            return shown
        shown_before, told = self.on_light("stroke_response", before, context, parts), context
        if first is not None:
            told = replace(context, first_shown=self.on_light("stroke_response", first, context, parts))
        settled: Tensor = self.applied("settled_share", shown, shown_before, told, pairs=settling)
        return settled

    def element_pose(self, parts: Iterable[str], pose: Pose = _NOMINAL) -> Pose:
        """The position of an element, by its name or place, after the effects on it."""
        moved: Pose = self.applied("element_pose", pose, pairs=self.on_parts(parts, "element_pose"))
        return moved

    def slm2_pose(self) -> Pose:
        """The position of the second modulator relative to its nominal one."""
        pose: Pose = self.applied("slm2_pose", Pose())
        return pose

    def pupil(self, context: RelayContext, dtype: torch.dtype) -> Tensor | None:
        """The complex pupil (rows, columns) that effects add to a relay; None if there is none."""
        pairs = self.on_parts(context.names or (f"relay {context.relay + 1}",), "pupil")
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
        return modulator_context(self.plan, modulator, wavelength, laser_number(self.plan, wavelength))


def laser_number(plan: Plan, wavelength: int) -> int:
    """The number, from the shortest wavelength, of the nominal laser that emits a wavelength of the plan."""
    nominal_m = plan.nominal.wavelengths_m
    return int(np.count_nonzero(nominal_m < nominal_m[plan.laser_of(wavelength)]))


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


def effects_pupil(
    plan: Plan, relay: int, wavelength: int, effects: TorchEffects | None = None, nominal: System | None = None
) -> Tensor | None:
    """The pupil (P_y, P_x) complex128 that effects add to a relay, in `fftfreq` order; None if there is none.

    effects, nominal: the plan's when None.
    """
    nominal = nominal or plan.nominal
    effects = TorchEffects(nominal.effect_values) if effects is None else effects
    λ = float(plan.system.wavelengths_m[wavelength])
    way, names = nominal.way, plan.way.relay_names[relay]
    if names not in way.relay_names or way.kernel(way.relay_names.index(names)) is not None:
        return None  # what a moved element leaves, and a Fourier element, have no pupil
    own = way.relay_names.index(names)
    radius = way.relays[own].pupil_radius_sine(λ, way.orders_m[own])
    context = RelayContext(relay, λ, *direction_sines(plan.grid, λ), radius, way.relays[own].centre_na, names)
    return effects.pupil(context, torch.complex128)
