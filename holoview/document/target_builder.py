"""Builds targets at a focal plane on a worker thread, and caches them."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from holoview.document.document import Document
from holoview.document.jobs import CallOnOwner
from holoview.document.target_spec import TargetSpec
from holoview.model.system import System
from holoview.util.latest_task import LatestTask

Image = NDArray[np.float32]
_MAX_CACHED_IMAGES = 24


class TargetBuilder:
    """Builds the target that was requested last; a request that still waits is dropped when another one comes.

    deliver: has the session's owner make a call. on_ready: called by the owner when a target is available. on_error:
    called by the owner with the exception and "target" when it can't be built.
    """

    def __init__(
        self,
        deliver: CallOnOwner,
        on_ready: Callable[[], None],
        on_error: Callable[[BaseException, str], None],
    ) -> None:
        self._on_ready, self._on_error = on_ready, on_error
        self._cache: dict[Hashable, Image | None] = {}
        self._requested_key: Hashable = None
        self._task: LatestTask[_Built] = LatestTask("targets", deliver, lambda error: None)

    def get(self, document: Document, plane_m: float) -> Image | None:
        """The target (y, x, 3) at a plane, in linear sRGB; None if there is none, or until it is built."""
        if document.target_spec is None:
            return None
        request = _TargetRequest(document.target_spec, document.system, plane_m)
        if request.key in self._cache:
            return self._cache[request.key]
        if self._requested_key != request.key:
            self._requested_key = request.key
            self._task.submit(request.build, partial(self._on_built, request))
        return None

    @property
    def is_building(self) -> bool:
        """Whether a target is being built or waits to be."""
        return self._task.is_busy

    def close(self) -> None:
        """Ends the thread."""
        self._task.close()

    def _on_built(self, request: _TargetRequest, built: _Built) -> None:
        images, error = built
        self._cache |= {replace(request, plane_m=z).key: image for z, image in images.items()}
        self._cache.setdefault(request.key, None)
        while len(self._cache) > max(_MAX_CACHED_IMAGES, len(images) + 1):  # this request's own images stay
            self._cache.pop(next(iter(self._cache)))
        if error is not None:
            self._on_error(error, "target")
        self._on_ready()


_Built = tuple[dict[float, Image], Exception | None]
"""Images by their plane in metres, and what went wrong."""


@dataclass(frozen=True, eq=False)
class _TargetRequest:
    """A target for a system at a plane in metres."""

    target_spec: TargetSpec
    system: System
    plane_m: float

    @property
    def key(self) -> Hashable:
        return self.target_spec, _geometry_key(self.system), self.plane_m

    def build(self) -> _Built:
        """Images of all planes of the system, if `plane_m` is one of them; else of that plane alone."""
        is_own_plane = bool(np.any(self.system.planes_m == self.plane_m))
        if not is_own_plane and self.target_spec.is_stack:
            return {}, None
        try:
            planes_m = self.system.planes_m if is_own_plane else np.array([self.plane_m])
            target = self.target_spec.build(self.system, planes_m)
        except Exception as error:  # reported to the user by the owner, once for each request
            return {}, error
        return dict(zip(target.planes_m, target.stack, strict=True)), None


def _geometry_key(system: System) -> Hashable:
    """What a target depends on besides its specification: planes, sampling, and the cone of light that blurs it.

    With an eye, also its pupil, and the lasers, each of which it sees in another focus.
    """
    modulator, median_m = system.modulators[0], float(np.median(system.wavelengths_m))
    grid = (modulator.shape, modulator.pitch_m, system.sampling.upsample)
    seen = None if system.eye is None else (system.eye, system.observer, system.wavelengths_m.tobytes())
    return grid, median_m, system.relay2, system.planes_m.tobytes(), seen
