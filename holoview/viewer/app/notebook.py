"""The viewer in a notebook's cell.

viewer = holoview.show("holochrome-8")   # as the last line of a cell, or display(viewer)
viewer.session.change("Gap", {"gap": "3 mm"})
viewer.session.drive                     # the patterns, e.g. after an optimisation in the viewer
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from holoview.holograms.hologram import Hologram
from holoview.light.gpu.device import DeviceLost, open_device
from holoview.light.model import preset
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.packages import import_optional
from holoview.viewer.app.app import App
from holoview.viewer.app.run import compute_loop
from holoview.viewer.document.editing_session import EditingSession

Showable = System | Hologram | EditingSession | str
_MAX_FRAMES_A_SECOND = 30
_INPUT_SCRIPT = Path(__file__).parent / "web" / "input.js"
open_viewers: list[Viewer] = []
"""The viewer that is open, at most one: a process has a single ImGui window."""


class Viewer:
    """A viewer in a notebook's cell; other cells can edit its `session`."""

    def __init__(self, session: EditingSession, app: App, task: asyncio.Task[None]) -> None:
        self.session = session
        self.app, self._task = app, task

    def close(self) -> None:
        """Ends the viewer; the cell keeps its last image.

        The device finishes what it was given: a frame that arrived later would find the event loop or the device gone.
        """
        if self in open_viewers:
            open_viewers.remove(self)
            self._task.cancel()
            self.app.close()
            with suppress(DeviceLost):
                self.app.window.device.wait()

    def _repr_mimebundle_(self, **options: Any) -> Any:
        """Called by IPython to display the value of a cell."""
        return self.app.window.canvas._repr_mimebundle_(**options)


def show(
    what: Showable,
    drive: NDArray[Any] | None = None,
    *,
    size: tuple[int, int] = (1100, 720),
    adapter: str | None = None,
) -> Viewer:
    """Opens the viewer in a notebook's cell; a viewer that was open before is closed.

    what: a `System`, a `Hologram`, an editing session, or a preset's name or file.
    drive: (frame, modulator, y, x) patterns in 0…1 of a system's stroke; random when None.
    size: (width, height) of the widget in pixels.
    adapter: part of the name of the WebGPU adapter to use.

    Returns a `Viewer`, which the notebook displays as the last line of a cell. Its `session` is what the viewer edits:
    code in other cells reads `session.system` and `session.drive`, and changes the display by `session.change`. There
    is one viewer in a process. Raises UserError outside a notebook, without a WebGPU adapter or anywidget (`pip install
    "holoview[notebook]"`), for a wrong preset and for a drive that doesn't fit.

    >>> import holoview as hv
    >>> viewer = hv.show("holochrome-8", size=(640, 400))
    >>> viewer.session.change("Gap", {"gap": "3 mm"})
    >>> viewer.session.system.gap_m
    0.003
    >>> viewer.close()
    """
    canvas_class, loop = _widgets()
    session = _session(what, drive)
    device = open_device(adapter)
    for viewer in list(open_viewers):
        viewer.close()
    canvas = canvas_class(size=size, title="holoview", max_fps=_MAX_FRAMES_A_SECOND)
    app = App(session, device, canvas)
    session.wake = lambda: loop.call_soon_threadsafe(app.window.wake)
    viewer = Viewer(session, app, asyncio.get_running_loop().create_task(compute_loop(app)))
    open_viewers.append(viewer)
    return viewer


def _session(what: Showable, drive: NDArray[Any] | None) -> EditingSession:
    if isinstance(what, EditingSession):
        return what
    if isinstance(what, Hologram):
        return EditingSession(what.system, what.drive, origin="hologram of the notebook")
    return EditingSession(preset.load(what) if isinstance(what, str) else what, drive)


def _widgets() -> tuple[Any, Any]:
    """The widget class of rendercanvas and its loop. Raises UserError without anywidget or a running event loop."""
    try:
        asyncio.get_running_loop()
    except RuntimeError as error:
        remedy = "use `holoview view` on a screen, or holoview.simulate for an image"
        raise UserError("show", "no event loop runs here", expected="a notebook", remedy=remedy) from error
    import_optional("anywidget", "show")
    from rendercanvas.anywidget import RenderCanvas, loop

    class Cell(RenderCanvas):  # type: ignore[misc]
        """A widget that loses no input, and avoids the endless recursion of rendercanvas 2.7 when it is closed."""

        _esm = RenderCanvas._esm + _INPUT_SCRIPT.read_text(encoding="utf-8")

        def _rc_close(self) -> None:
            if not self.get_closed():
                self._is_closed = True
                super()._rc_close()

    return Cell, loop
