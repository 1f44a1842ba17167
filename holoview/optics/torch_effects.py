"""What effects do to light: modulators, pupils, the camera. Hooks in their order, in torch."""

from __future__ import annotations

import torch

from holoview.model.effects.active_effects import ActiveEffects, call_hook
from holoview.model.effects.effect import Effect
from holoview.model.effects.hook_contexts import CameraContext, ModulatorContext, Pose, RelayContext
from holoview.model.effects.parameter import Values
from holoview.optics.slm import phasor

Tensor = torch.Tensor


class TorchEffects(ActiveEffects):
    """The effects of a table that are on, with what they do to light."""

    def modulator_transmission(
        self, share: Tensor, context: ModulatorContext, dtype: torch.dtype, path_factor: float = 1.0
    ) -> Tensor:
        """Complex transmission of a modulator that was sent `share` (rows, columns) of its stroke.

        Of pixels (rows, columns), or of samples where an effect needs them.
        """
        for one, v in self._on_modulator("stroke_response", context.number):
            share = call_hook(one, "stroke_response", share, context, v)
        path = share * context.stroke_m
        for one, v in self._on_modulator("optical_path", context.number):
            path = call_hook(one, "optical_path", path, context, v)
        if path_factor != 1.0:
            path = path * path_factor
        light = phasor(path, context.wavelength_m, dtype)
        for one, v in self._on_modulator("transmission", context.number):
            light = call_hook(one, "transmission", light, context, v)
        seat = self.slm2_pose() if context.number == 1 else Pose()
        return light if seat.is_identity else context.warped(light, seat)

    def _on_modulator(self, hook: str, number: int) -> list[tuple[Effect, Values]]:
        """Those with the hook that change this modulator, or what falls onto the first one."""
        places = {f"modulator {number + 1}", "source" if number == 0 else ""}
        return [pair for pair in self.with_hooks(hook) if places & set(pair[0].acts_on)]

    def slm2_pose(self) -> Pose:
        """How the second modulator lies."""
        pose = Pose()
        for one, v in self.with_hooks("slm2_pose"):
            pose = call_hook(one, "slm2_pose", pose, v)
        return pose

    def pupil(self, at: RelayContext, dtype: torch.dtype) -> Tensor | None:
        """Complex pupil that effects add to a relay, (rows, columns); None where none does."""
        on = [pair for pair in self.with_hooks("pupil") if f"relay {at.relay + 1}" in pair[0].acts_on]
        if not on:
            return None
        pupil = torch.ones(len(at.sine_y), at.sine_x.shape[1], dtype=dtype, device=at.sine_y.device)
        for one, v in on:
            pupil = call_hook(one, "pupil", pupil, at, v)
        return pupil

    def camera_pose(self) -> Pose:
        """How the camera lies."""
        pose = Pose()
        for one, v in self.with_hooks("camera_pose"):
            pose = call_hook(one, "camera_pose", pose, v)
        return pose

    def image(self, image: Tensor, at: CameraContext) -> Tensor:
        """What the camera collects of an intensity (y, x)."""
        for one, v in self.with_hooks("image"):
            image = call_hook(one, "image", image, at, v)
        return image
