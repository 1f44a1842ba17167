"""What effects do to light: modulators, pupils, the camera. Hooks in their order, in torch."""

from __future__ import annotations

import torch

from holoview.effects.effect import Effect
from holoview.effects.parameter import Values
from holoview.effects.places import Aperture, Pose, Sensor, Surface
from holoview.effects.switched import Switched, called
from holoview.optics.slm import phasor

Tensor = torch.Tensor


class Applied(Switched):
    """The effects of a table that are on, with what they do to light."""

    def light(self, share: Tensor, at: Surface, dtype: torch.dtype, factor: float = 1.0) -> Tensor:
        """Complex transmission of a modulator that was sent `share` (rows, columns) of its stroke.

        Of pixels (rows, columns), or of samples where an effect needs them.
        """
        for one, v in self._on_modulator("response", at.number):
            share = called(one, "response", share, at, v)
        path = share * at.stroke_m
        for one, v in self._on_modulator("path", at.number):
            path = called(one, "path", path, at, v)
        if factor != 1.0:
            path = path * factor
        light = phasor(path, at.wavelength_m, dtype)
        for one, v in self._on_modulator("transmission", at.number):
            light = called(one, "transmission", light, at, v)
        seat = self.seat() if at.number == 1 else Pose()
        return light if seat.is_identity else at.warped(light, seat)

    def _on_modulator(self, hook: str, number: int) -> list[tuple[Effect, Values]]:
        """Those with the hook that change this modulator, or what falls onto the first one."""
        places = {f"modulator {number + 1}", "source" if number == 0 else ""}
        return [pair for pair in self.having(hook) if places & set(pair[0].where)]

    def seat(self) -> Pose:
        """How the second modulator lies."""
        pose = Pose()
        for one, v in self.having("seat"):
            pose = called(one, "seat", pose, v)
        return pose

    def pupil(self, at: Aperture, dtype: torch.dtype) -> Tensor | None:
        """Complex pupil that effects add to a relay, (rows, columns); None where none does."""
        on = [pair for pair in self.having("pupil") if f"relay {at.relay + 1}" in pair[0].where]
        if not on:
            return None
        pupil = torch.ones(len(at.sine_y), at.sine_x.shape[1], dtype=dtype, device=at.sine_y.device)
        for one, v in on:
            pupil = called(one, "pupil", pupil, at, v)
        return pupil

    def aim(self) -> Pose:
        """How the camera lies."""
        pose = Pose()
        for one, v in self.having("aim"):
            pose = called(one, "aim", pose, v)
        return pose

    def image(self, image: Tensor, at: Sensor) -> Tensor:
        """What the camera collects of an intensity (y, x)."""
        for one, v in self.having("image"):
            image = called(one, "image", image, at, v)
        return image
