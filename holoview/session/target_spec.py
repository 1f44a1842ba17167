"""A target as a recipe: a picture, where it stands, how bright; built for whatever bench is current."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.model.system import System
from holoview.session.document import Document
from holoview.session.latest_task import LatestTask
from holoview.targets.focal_stack import Target
from holoview.targets.picture import Picture
from holoview.targets.rendered_stacks import target_from_stack
from holoview.targets.target import Placement, target_for

Image = NDArray[np.float32]
_KEPT_IMAGES = 24


@dataclass(frozen=True, eq=False)
class TargetSpec:
    """What a hologram should show: a picture in linear light, or the path of a ready focal stack.

    brightness: a factor on linear light; saturation: one on chroma in CIE LCHuv; space: what a float file holds.
    """

    source: Picture | Path
    title: str
    placement: Placement = field(default_factory=Placement)
    brightness: float = 1.0
    saturation: float = 1.0
    space: str = "srgb"

    @property
    def is_stack(self) -> bool:
        """Whether it is a ready stack, a picture a plane, which has nothing to say about other planes."""
        return isinstance(self.source, Path)

    def build(self, system: System, planes_m: NDArray[np.float64] | None = None) -> Target:
        """The target at the system's planes, or at others if it isn't a ready stack. Raises UserError as those do."""
        if isinstance(self.source, Path):
            return target_from_stack(
                system, self.source, brightness=self.brightness, saturation=self.saturation, space=self.space
            )
        return target_for(
            system, self.source, self.placement, self.brightness, saturation=self.saturation, planes=planes_m
        )


def target_geometry_key(system: System) -> Hashable:
    """What a target depends on besides its recipe: planes, grid, and the cone of light that blurs it."""
    modulator, middle = system.modulators[0], float(np.median(system.wavelengths_m))
    grid = (modulator.shape, modulator.pitch_m, system.sampling.upsample)
    return grid, middle, system.relay2.iris_na, system.planes_m.tobytes()


class TargetBuilder:
    """Targets of states at a plane, built on a thread; only the latest that was asked for, the rest are dropped."""

    def __init__(
        self, deliver: Callable[[Callable[[], None]], None], ready: Callable[[], None], failed: Callable[..., None]
    ) -> None:
        self._ready = ready
        self._failed = failed
        self._cache: dict[Hashable, Image | None] = {}
        self._asked: Hashable = None
        self._newest: LatestTask[_Built] = LatestTask("targets", deliver, lambda error: None)

    def get(self, state: Document, plane_m: float) -> Image | None:
        """The target (y, x, 3), linear sRGB, at a plane; None where there is none or it is still being built."""
        if state.target_spec is None:
            return None
        asked = _TargetRequest(state.target_spec, state.system, plane_m)
        if asked.key in self._cache:
            return self._cache[asked.key]
        if self._asked != asked.key:
            self._asked = asked.key
            self._newest.submit(asked.build, partial(self._on_built, asked))
        return None

    @property
    def is_building(self) -> bool:
        """Whether one is on its way."""
        return self._newest.is_busy

    def close(self) -> None:
        """Ends the thread."""
        self._newest.close()

    def _on_built(self, asked: _TargetRequest, built: _Built) -> None:
        found, error = built
        self._cache |= {replace(asked, plane_m=z).key: image for z, image in found.items()}
        self._cache.setdefault(asked.key, None)
        while len(self._cache) > _KEPT_IMAGES:
            self._cache.pop(next(iter(self._cache)))
        if error is not None:
            self._failed(error, "target")
        self._ready()


_Built = tuple[dict[float, Image], Exception | None]


@dataclass(frozen=True, eq=False)
class _TargetRequest:
    """A target that is asked for, at a plane."""

    target_spec: TargetSpec
    system: System
    plane_m: float

    @property
    def key(self) -> Hashable:
        return self.target_spec, target_geometry_key(self.system), self.plane_m

    def build(self) -> _Built:
        """The images of the bench's planes where it is one of them, else that of the plane alone."""
        own = bool(np.any(self.system.planes_m == self.plane_m))
        if not own and self.target_spec.is_stack:
            return {}, None
        try:
            target = self.target_spec.build(self.system, None if own else np.array([self.plane_m]))
        except Exception as error:  # the owner tells the user, once for each target
            return {}, error
        return dict(zip(target.planes_m, target.stack, strict=True)), None
