"""Images for exports and comparisons, computed on a job's thread with a device of its own, so that no window waits."""

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
    """XYZ (y, x, 3) at each plane, one after the other; `check` is called between steps and may raise.

    On the first adapter that there is, else by torch. What planes share is computed once on an adapter.
    """
    try:
        session = IncrementalRenderer(system, drive, open_device(), plane_m=float(planes_m[0]))
    except UserError:
        for plane_m in planes_m:
            check()
            yield simulate(system, drive, [plane_m], "torch").xyz[0]
        return
    for plane_m in planes_m:
        session.edit(plane_m=float(plane_m))
        for _ in session.steps(with_srgb=False, wait=True):
            check()
        yield session.xyz()
