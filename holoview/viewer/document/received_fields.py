"""Fields that other programs on this machine send to a session, such as each iteration of their optimisers."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock

import numpy as np

from holoview.holograms.fields.exchange import FieldListener
from holoview.holograms.fields.wavefield import Wavefield
from holoview.holograms.hologram import Hologram
from holoview.light.model.system import System
from holoview.util.text import printable
from holoview.viewer.document.editing_session import EditingSession


class ReceivedFields:
    """Listens for fields and shows the newest of each name in a session, whose owner calls `poll`.

    is_ready: whether the session's image is up to date; a field that comes before waits, and is replaced by a newer one
    of its name, so that a fast program never keeps an image from being finished.
    """

    def __init__(self, session: EditingSession, is_ready: Callable[[], bool]) -> None:
        self._session, self._is_ready = session, is_ready
        self._lock, self._waiting = Lock(), dict[str, Hologram]()
        self._listener: FieldListener | None = None

    def listen(self, port: int = 0) -> str:
        """Begins to listen, and returns the address with its token. Raises UserError when the port is in use."""
        if self._listener is None:
            self._listener = FieldListener(self._receive, port)
        return self._listener.listener.address

    def poll(self) -> None:
        """Shows the field that waits longest; a new version of the shown field waits until the session is ready."""
        with self._lock:
            name = next(iter(self._waiting), None)
            if name is None or (self._session.document.origin == _origin(name) and not self._is_ready()):
                return
            hologram = self._waiting.pop(name)
        with self._session.report_errors():
            self._show(name, hologram)

    def close(self) -> None:
        """Ends listening."""
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def _receive(self, field: Wavefield) -> None:
        """Called on a thread of the listener. Raises UserError for a field that no bench shows."""
        hologram = Hologram.of_field(field)
        with self._lock:
            self._waiting[field.name] = hologram
        self._session.call_on_owner(lambda: None)  # wakes the owner, which polls

    def _show(self, name: str, hologram: Hologram) -> None:
        session = self._session
        title, origin = f"Receive {printable(name)}", _origin(name)
        if session.document.origin == origin and _shows(session.system, hologram.system):
            session.edit(title, drive=hologram.drive, undoable=False)
            return
        view_settings = session.document.view_settings_for_picture.with_(plane_m=float(hologram.system.planes_m[0]))
        session.edit(
            title,
            system=hologram.system,
            drive=hologram.drive,
            target_spec=session.target_spec if session.system.is_field else None,
            view_settings=view_settings,
            origin=origin,
            path=None,
        )
        session.fits_exposure = True


def _origin(name: str) -> str:
    return f"field {printable(name)} of a running program"


def _shows(present: System, new: System) -> bool:
    """Whether a bench shows fields of the samples and wavelengths of another, so that it can stay as it was edited."""
    same_lasers = np.array_equal(present.wavelengths_m, new.wavelengths_m)
    return present.modulators == new.modulators and present.drive_shape == new.drive_shape and same_lasers
