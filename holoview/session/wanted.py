"""A target as a recipe: a picture, where it stands, how bright; built for whatever bench is current."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.session.newest import Newest
from holoview.session.state import State
from holoview.system import System
from holoview.targets.build import Placement, target_for
from holoview.targets.focal_stack import Target
from holoview.targets.picture import Picture
from holoview.targets.stacks import stack_for

Image = NDArray[np.float32]
_KEPT_IMAGES = 24


@dataclass(frozen=True, eq=False)
class Wanted:
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
            return stack_for(
                system, self.source, brightness=self.brightness, saturation=self.saturation, space=self.space
            )
        return target_for(
            system, self.source, self.placement, self.brightness, saturation=self.saturation, planes=planes_m
        )


def geometry(system: System) -> Hashable:
    """What a target depends on besides its recipe: planes, grid, and the cone of light that blurs it."""
    modulator, middle = system.modulators[0], float(np.median(system.wavelengths_m))
    grid = (modulator.shape, modulator.pitch_m, system.sampling.upsample)
    return grid, middle, system.relay2.iris_na, system.planes_m.tobytes()


class Targets:
    """Targets of states at a plane, built on a thread; only the latest that was asked for, the rest are dropped."""

    def __init__(
        self, deliver: Callable[[Callable[[], None]], None], ready: Callable[[], None], failed: Callable[..., None]
    ) -> None:
        self._ready = ready
        self._failed = failed
        self._known: dict[Hashable, Image | None] = {}
        self._asked: Hashable = None
        self._newest: Newest[_Built] = Newest("targets", deliver, lambda error: None)

    def at(self, state: State, plane_m: float) -> Image | None:
        """The target (y, x, 3), linear sRGB, at a plane; None where there is none or it is still being built."""
        if state.wanted is None:
            return None
        asked = _Asked(state.wanted, state.system, plane_m)
        if asked.key in self._known:
            return self._known[asked.key]
        if self._asked != asked.key:
            self._asked = asked.key
            self._newest.ask(asked.built, partial(self._take, asked))
        return None

    @property
    def is_building(self) -> bool:
        """Whether one is on its way."""
        return self._newest.is_busy

    def close(self) -> None:
        """Ends the thread."""
        self._newest.close()

    def _take(self, asked: _Asked, built: _Built) -> None:
        found, error = built
        self._known |= {replace(asked, plane_m=z).key: image for z, image in found.items()}
        self._known.setdefault(asked.key, None)
        while len(self._known) > _KEPT_IMAGES:
            self._known.pop(next(iter(self._known)))
        if error is not None:
            self._failed(error, "target")
        self._ready()


_Built = tuple[dict[float, Image], Exception | None]


@dataclass(frozen=True, eq=False)
class _Asked:
    """A target that is asked for, at a plane."""

    wanted: Wanted
    system: System
    plane_m: float

    @property
    def key(self) -> Hashable:
        return self.wanted, geometry(self.system), self.plane_m

    def built(self) -> _Built:
        """The images of the bench's planes where it is one of them, else that of the plane alone."""
        own = bool(np.any(self.system.planes_m == self.plane_m))
        if not own and self.wanted.is_stack:
            return {}, None
        try:
            target = self.wanted.build(self.system, None if own else np.array([self.plane_m]))
        except Exception as error:  # the owner tells the user, once for each target
            return {}, error
        return dict(zip(target.planes_m, target.stack, strict=True)), None
