"""A target as a recipe: a picture, where it stands, how bright; built for whatever bench is current."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from threading import Condition, Thread

import numpy as np
from numpy.typing import NDArray

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
        self._deliver, self._ready, self._failed = deliver, ready, failed
        self._known: dict[Hashable, Image | None] = {}
        self._asked: _Asked | None = None
        self._awaits, self._closed = Condition(), False
        self._thread: Thread | None = None

    def at(self, state: State, plane_m: float) -> Image | None:
        """The target (y, x, 3), linear sRGB, at a plane; None where there is none or it is still being built."""
        if state.wanted is None:
            return None
        asked = _Asked(state.wanted, state.system, plane_m)
        if asked.key in self._known:
            return self._known[asked.key]
        with self._awaits:
            self._asked = asked
            self._awaits.notify()
        if self._thread is None:
            self._thread = Thread(target=self._run, name="holoview: targets", daemon=True)
            self._thread.start()
        return None

    @property
    def is_building(self) -> bool:
        """Whether one is on its way."""
        return self._asked is not None

    def close(self) -> None:
        """Ends the thread."""
        with self._awaits:
            self._closed = True
            self._awaits.notify()

    def _run(self) -> None:
        while True:
            with self._awaits:
                self._awaits.wait_for(lambda: self._closed or self._asked is not None)
                asked = self._asked
            if self._closed or asked is None:
                return
            found, error = asked.built()
            self._deliver(partial(self._take, asked, found, error))
            with self._awaits:
                if self._asked is asked:
                    self._asked = None

    def _take(self, asked: _Asked, found: dict[float, Image], error: BaseException | None) -> None:
        self._known |= {replace(asked, plane_m=z).key: image for z, image in found.items()}
        self._known.setdefault(asked.key, None)
        while len(self._known) > _KEPT_IMAGES:
            self._known.pop(next(iter(self._known)))
        if error is not None:
            self._failed(error, "target")
        self._ready()


@dataclass(frozen=True, eq=False)
class _Asked:
    """A target that is asked for, at a plane."""

    wanted: Wanted
    system: System
    plane_m: float

    @property
    def key(self) -> Hashable:
        return self.wanted, geometry(self.system), self.plane_m

    def built(self) -> tuple[dict[float, Image], BaseException | None]:
        """The images of the bench's planes where it is one of them, else that of the plane alone."""
        own = bool(np.any(self.system.planes_m == self.plane_m))
        if not own and self.wanted.is_stack:
            return {}, None
        try:
            target = self.wanted.build(self.system, None if own else np.array([self.plane_m]))
        except Exception as error:  # delivered to the owner, who tells the user
            return {}, error
        return dict(zip(target.planes_m, target.stack, strict=True)), None
