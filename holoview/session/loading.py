"""What a session makes of what was opened: one edit, a message, a line in the recent files, a file to watch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.errors import UserError
from holoview.session.jobs import Control, Job
from holoview.session.look import SPECKLE_STOPS, Look
from holoview.session.opening import Opened, open_any, pasted, pasted_file
from holoview.session.optimising import quick_look, running
from holoview.session.session import Session, middle_plane
from holoview.session.wanted import Wanted
from holoview.session.watching import INTERVAL_S, Watch
from holoview.system import System

_PATIENCE_S = 10.0
"""How long a watched file may stay unreadable before the user is told; it may be half written."""


class Loader:
    """Opens files into a session in the background, and again when a hologram on show was rewritten.

    remember: called with the path of what was opened. quick: whether a new target is optimised for a moment, so that
    something of it is seen.
    """

    def __init__(
        self, session: Session, *, remember: Callable[[Path], None] = lambda path: None, quick: bool = True
    ) -> None:
        self.quick = quick
        self._session, self._remember = session, remember
        self._watch: Watch | None = None
        self._watches = True
        self._stop = session.listen(lambda change: self._follow() if "drive" in change.kinds else None)
        self._follow()

    def open(self, names: str | Path | Sequence[str | Path]) -> Job:
        """Opens files or the preset of a name; what is wrong with them becomes a message."""
        system = self._session.system
        title = _title(names)
        return self._session.jobs.start(f"Open {title}", lambda control: open_any(names, system), self.take)

    def paste(self, picture: NDArray[np.uint8] | bytes) -> None:
        """Takes 8-bit sRGB pixels (y, x, 3 or 4), or a picture file's bytes, for the target. Raises UserError."""
        wanted = pasted_file(picture) if isinstance(picture, bytes) else pasted(picture)
        self.take(Opened("picture", wanted.title, wanted=wanted))

    def take(self, opened: Opened) -> None:
        """Makes what was opened an edit of the session. Raises UserError when it doesn't fit."""
        session = self._session
        for note in opened.notes:
            session.messages.post(f"{opened.title}: {note}")
        if opened.wanted is not None:
            self._aim(opened.wanted)
        else:
            self._show(opened)
        if opened.path is not None:
            self._remember(opened.path)

    def _show(self, opened: Opened) -> None:
        session = self._session
        system = opened.system or session.system
        assert opened.drive is not None
        random = ", random patterns" if opened.kind == "preset" else ""
        path = opened.path if opened.kind == "hologram" else None
        session.edit(
            f"Open {opened.title}",
            system=system,
            drive=opened.drive,
            look=_look_for(self._toned(opened), system),
            origin=f"{opened.kind} {opened.title}{random}",
            path=path,
        )

    def _aim(self, wanted: Wanted) -> None:
        """A new target; patterns stay unless a quick look may replace them."""
        session = self._session
        session.edit(f"Target {wanted.title}", wanted=wanted, look=self._toned())
        if self.quick and running(session) is None:
            quick_look(session)

    def _toned(self, opened: Opened | None = None) -> Look:
        """The look, no longer as dark as random patterns need it once something else is shown."""
        state = self._session.state
        was_random = "random patterns" in state.origin and state.look.exposure_stops == SPECKLE_STOPS
        stays = opened is not None and opened.kind == "preset"
        return state.look.with_(exposure_stops=0.0) if was_random and not stays else state.look

    # --- a file that another program rewrites -----------------------------------------------------------------------

    @property
    def watching(self) -> Path | None:
        """The file that is watched."""
        return None if self._watch is None else self._watch.path

    def watch(self, on: bool) -> None:
        """Whether a hologram file on show is read again when it was rewritten."""
        self._watches = on
        self._follow()

    def close(self) -> None:
        """Ends the watch."""
        self._stop()
        self.watch(False)

    def _follow(self) -> None:
        path = self._session.state.path if self._watches else None
        if path == self.watching:
            return
        if self._watch is not None:
            self._watch.close()
        self._watch = None if path is None else Watch(path, partial(self._reread, path))

    def _reread(self, path: Path) -> None:
        """On the watch's thread: the file has changed."""
        self._session.deliver(lambda: self._reload(path))

    def _reload(self, path: Path) -> None:
        if path != self.watching:
            return
        system = self._session.system
        work = partial(_patiently, path=path, system=system)
        self._session.jobs.start(f"Read {path.name} again", work, self._show_again)

    def _show_again(self, opened: Opened) -> None:
        if opened.path == self.watching and opened.drive is not None:
            self._show(opened)
            self._session.messages.post(f"{opened.title} was rewritten: read again")


def _patiently(control: Control, path: Path, system: System) -> Opened:
    """What a file holds, tried again while it may be half written. Raises UserError when it stays unreadable."""
    for _ in range(round(_PATIENCE_S / INTERVAL_S)):
        control.check()
        try:
            return open_any(path, system)
        except UserError as error:
            mistake = error
        control.rest(INTERVAL_S)
    raise mistake


def _look_for(look: Look, system: System) -> Look:
    """The look on another bench: its middle plane where the one before isn't among its planes."""
    near, far = float(system.planes_m.min()), float(system.planes_m.max())
    return look if near <= look.plane_m <= far else look.with_(plane_m=middle_plane(system))


def _title(names: str | Path | Sequence[str | Path]) -> str:
    several = [names] if isinstance(names, str | Path) else list(names)
    return Path(several[0]).name if len(several) == 1 else f"{len(several)} files"
