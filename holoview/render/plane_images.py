"""Renders focal planes on a job's thread, for exports and comparisons, with a GPU device of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from holoview.engine.incremental import IncrementalRenderer
from holoview.gpu.device import open_device
from holoview.model.system import System
from holoview.render.scene import Drive
from holoview.util.errors import UserError
from holoview.view import simulate

Xyz = NDArray[np.floating]


def render_planes(
    system: System, drive: Drive, planes_m: Sequence[float], check: Callable[[], None] = lambda: None
) -> Iterator[Xyz]:
    """Renders XYZ (y, x, 3) at each plane in turn; see `render_each`."""
    return render_each([(system, float(plane_m)) for plane_m in planes_m], drive, check)


def render_each(
    views: Sequence[tuple[System, float]],
    drive: Drive,
    check: Callable[[], None] = lambda: None,
    backend: str = "auto",
    adapter: str | None = None,
) -> Iterator[Xyz]:
    """Renders XYZ (y, x, 3) of patterns on each (system, plane in m) in turn; the systems show patterns of one shape.

    backend, adapter: as `simulate` takes them. With WebGPU, the views share what they have in common. `check` is called
    between steps and may raise an exception to cancel. Raises UserError as `simulate` does.
    """
    renderer = None if backend.startswith("torch") else _open_renderer(views[0], drive, backend, adapter)
    if renderer is None:
        for system, plane_m in views:
            check()
            yield simulate(system, drive, [plane_m], "torch" if backend == "auto" else backend).xyz[0]
        return
    for system, plane_m in views:
        renderer.edit(system=system, plane_m=plane_m)
        for _ in renderer.steps(with_srgb=False, wait=True):
            check()
        yield renderer.xyz()


def _open_renderer(
    view: tuple[System, float], drive: Drive, backend: str, adapter: str | None
) -> IncrementalRenderer | None:
    """A renderer of a view; None for the backend "auto" where no adapter can show it."""
    try:
        return IncrementalRenderer(view[0], drive, open_device(adapter), plane_m=view[1])
    except UserError:
        if backend != "auto" or adapter is not None:
            raise
        return None
