"""Applies active effects to light: transmissions of modulators, pupils of relays, images of the camera; in torch."""

from __future__ import annotations

from dataclasses import replace

import torch

from holoview.model.effects.active_effects import ActiveEffects
from holoview.model.effects.hook_contexts import CameraContext, ModulatorContext, Pose, RelayContext
from holoview.optics.slm import phasor

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

        share: (rows, columns) fraction of the stroke that was sent to each pixel.
        dtype: of the result.
        path_factor: factor of the optical paths, of one sample of an exposure.
        before: as `share`, what was sent before; None if that isn't known. first: what was sent first of all.
        """

        def applied(hook: str, values: Tensor) -> Tensor:
            changed: Tensor = self.applied(hook, values, context, pairs=self.on_modulator(context.number, hook))
            return changed

        shown = applied("stroke_response", share)
        if before is not None and (settling := self.on_modulator(context.number, "settled_share")):
            shown_before = applied("stroke_response", before)
            told = context if first is None else replace(context, first_shown=applied("stroke_response", first))
            shown = self.applied("settled_share", shown, shown_before, told, pairs=settling)
        path_m = applied("optical_path", shown * context.stroke_m)
        if path_factor != 1.0:
            path_m = path_m * path_factor
        transmission = applied("transmission", phasor(path_m, context.wavelength_m, dtype))
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

    def ambient_light(self, context: CameraContext, dtype: torch.dtype) -> Tensor | None:
        """Counts per second (y, x) that light beside the lasers' adds; None if there is none."""
        if not self.with_hooks("ambient_light"):
            return None
        counts_per_s: Tensor = self.applied("ambient_light", torch.zeros(context.shape, dtype=dtype), context)
        return counts_per_s

    def image(self, image: Tensor, context: CameraContext) -> Tensor:
        """What the camera collects of an intensity (y, x)."""
        collected: Tensor = self.applied("image", image, context)
        return collected
