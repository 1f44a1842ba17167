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
    """Renders XYZ (y, x, 3) at each plane in turn; see `render_each`."""
    return render_each([(system, float(plane_m)) for plane_m in planes_m], drive, check)


def render_each(
    views: Sequence[tuple[System, float]], drive: Drive, check: Callable[[], None] = lambda: None
) -> Iterator[Xyz]:
    """Renders XYZ (y, x, 3) of patterns on each (system, plane in m) in turn; the systems show patterns of one shape.

    Uses the first WebGPU adapter, where the views share what they have in common; torch if there is none. `check` is
    called between steps and may raise an exception to cancel.
    """
    try:
        renderer = IncrementalRenderer(views[0][0], drive, open_device(), plane_m=views[0][1])
    except UserError:
        for system, plane_m in views:
            check()
            yield simulate(system, drive, [plane_m], "torch").xyz[0]
        return
    for system, plane_m in views:
        renderer.edit(system=system, plane_m=plane_m)
        for _ in renderer.steps(with_srgb=False, wait=True):
            check()
        yield renderer.xyz()
