"""Full pictures of the holograms that are open beside the edited one, computed once, so that they switch at once.

They are computed one after the other while nothing else is to be done. A picture that no longer shows the scene that
is asked for, as after a step of the focal plane, is computed anew.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.light.engine.incremental import IncrementalRenderer, UpdateProgress
from holoview.light.gpu.device import Device
from holoview.viewer.render.progressive_renderer import edit_to_scene, slices
from holoview.viewer.render.scene import DeviceImage, Scene, image_shape, uploaded_image
from holoview.viewer.render.view_settings import ComparisonSide

MOST_BYTES = 1 << 29  # of the device; holograms beyond are computed when they are shown
_SAMPLE_BYTES = 16


@dataclass(frozen=True, eq=False)
class _Kept:
    """A picture on the device and on the host, XYZ (y, x, 3), and its scene; None where it can't be computed."""

    scene: Scene
    picture: DeviceImage | None
    xyz: NDArray[np.float32] | None


class KeptPictures:
    """Call `request` with the scenes of all holograms that are open, and `compute_slice` while `is_busy`."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._scenes: dict[ComparisonSide, Scene] = {}
        self._kept: dict[ComparisonSide, _Kept] = {}
        self._renderer: IncrementalRenderer | None = None
        self._computed: tuple[ComparisonSide, Scene] | None = None
        self._steps: Iterator[UpdateProgress] | None = None

    def request(self, scenes: Mapping[ComparisonSide, Scene]) -> None:
        """Has pictures of these scenes kept, the first ones where memory is short, and forgets others."""
        room, self._scenes = MOST_BYTES, {}
        for side, scene in scenes.items():
            room -= _SAMPLE_BYTES * math.prod(image_shape(scene.system))
            if room >= 0:
                self._scenes[side] = scene
        self._kept = {side: kept for side, kept in self._kept.items() if side in self._scenes}

    @property
    def is_busy(self) -> bool:
        """Whether a picture hasn't been computed yet."""
        return self._next() is not None

    def compute_slice(self) -> bool:
        """Computes a slice of the first missing picture; returns whether one was completed.

        Raises UserError for an impossible scene, once.
        """
        missing = self._next()
        if missing is None:
            return False
        side, scene = missing
        try:
            if self._computed is None or self._computed[0] != side or not self._computed[1].is_same(scene):
                self._computed, self._steps = missing, None
                self._renderer = edit_to_scene(self._renderer, scene, self._device)
                self._steps = slices(self._renderer)
            assert self._steps is not None and self._renderer is not None
            step = next(self._steps, None)
        except Exception:
            self._kept[side], self._computed = _Kept(scene, None, None), None
            raise
        if step is not None and step.done < step.total:
            return False
        xyz = self._renderer.xyz()
        self._kept[side] = _Kept(scene, uploaded_image(self._device, xyz, side.label), xyz)
        self._computed = None
        return True

    def picture(self, side: ComparisonSide, scene: Scene | None = None) -> DeviceImage | None:
        """The picture of a side; of another scene than `scene`, if one is given, None."""
        kept = self._kept.get(side)
        return None if kept is None or not (scene is None or kept.scene.is_same(scene)) else kept.picture

    def xyz(self, side: ComparisonSide, scene: Scene | None) -> NDArray[np.float32] | None:
        """The picture of a side on the host, XYZ (y, x, 3); None unless it shows this scene."""
        kept = self._kept.get(side)
        return kept.xyz if kept is not None and kept.scene.is_same(scene) else None

    def close(self) -> None:
        """Ends the renderer."""
        if self._renderer is not None:
            self._renderer.close()

    def _next(self) -> tuple[ComparisonSide, Scene] | None:
        for side, scene in self._scenes.items():
            kept = self._kept.get(side)
            if kept is None or not kept.scene.is_same(scene):
                return side, scene
        return None
