"""Renders focal planes on a job's thread, for exports and comparisons, with a GPU device of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from holoview.engine.incremental import IncrementalRenderer
from holoview.gpu.device import open_device
from holoview.model.system import System
from holoview.session.document import Drive
from holoview.util.errors import UserError
from holoview.view import simulate

Xyz = NDArray[np.floating]


def render_planes(
    system: System, drive: Drive, planes_m: Sequence[float], check: Callable[[], None] = lambda: None
) -> Iterator[Xyz]:
    """Renders XYZ (y, x, 3) at each plane in turn.

    Uses the first WebGPU adapter, where the planes share what they have in common; torch if there is none. `check` is
    called between steps and may raise an exception to cancel.
    """
    try:
        renderer = IncrementalRenderer(system, drive, open_device(), plane_m=float(planes_m[0]))
    except UserError:
        for plane_m in planes_m:
            check()
            yield simulate(system, drive, [plane_m], "torch").xyz[0]
        return
    for plane_m in planes_m:
        renderer.edit(plane_m=float(plane_m))
        for _ in renderer.steps(with_srgb=False, wait=True):
            check()
        yield renderer.xyz()
