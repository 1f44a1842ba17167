"""What a session makes of what was opened: one edit, a message, a line in the recent files, a file to watch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.model.system import System
from holoview.session.editing_session import EditingSession, middle_plane
from holoview.session.file_reader import FileContent, read_content, target_from_image_bytes, target_from_pixels
from holoview.session.file_watcher import POLL_INTERVAL_S, FileWatcher
from holoview.session.jobs import BackgroundJob, JobControl
from holoview.session.optimisation_job import running_optimisation, start_quick_optimisation
from holoview.session.target_spec import TargetSpec
from holoview.session.view_settings import SPECKLE_EXPOSURE_STOPS, ViewSettings
from holoview.util.errors import UserError

_RETRY_FOR_S = 10.0
"""How long a watched file may stay unreadable before the user is told; it may be half written."""


class FileLoader:
    """Opens files into a session in the background, and again when a hologram on show was rewritten.

    remember: called with the path of what was opened. quick: whether a new target is optimised for a moment, so that
    something of it is seen.
    """

    def __init__(
        self, session: EditingSession, *, remember: Callable[[Path], None] = lambda path: None, quick: bool = True
    ) -> None:
        self.optimises_new_targets = quick
        self._session, self._remember = session, remember
        self._watch: FileWatcher | None = None
        self._watches = True
        self._stop = session.add_listener(lambda change: self._update_watcher() if "drive" in change.kinds else None)
        self._update_watcher()

    def open(self, names: str | Path | Sequence[str | Path]) -> BackgroundJob:
        """Opens files or the preset of a name; what is wrong with them becomes a message."""
        system = self._session.system
        title = _title(names)
        return self._session.jobs.start(f"Open {title}", lambda control: read_content(names, system), self.apply)

    def paste(self, picture: NDArray[np.uint8] | bytes) -> None:
        """Takes 8-bit sRGB pixels (y, x, 3 or 4), or a picture file's bytes, for the target. Raises UserError."""
        wanted = target_from_image_bytes(picture) if isinstance(picture, bytes) else target_from_pixels(picture)
        self.apply(FileContent("picture", wanted.title, target_spec=wanted))

    def apply(self, opened: FileContent) -> None:
        """Makes what was opened an edit of the session. Raises UserError when it doesn't fit."""
        session = self._session
        for note in opened.notes:
            session.messages.post(f"{opened.title}: {note}")
        if opened.target_spec is not None:
            self._set_target(opened.target_spec)
        else:
            self._set_hologram(opened)
        if opened.path is not None:
            self._remember(opened.path)

    def _set_hologram(self, opened: FileContent) -> None:
        session = self._session
        system = opened.system or session.system
        assert opened.drive is not None
        random = ", random patterns" if opened.kind == "preset" else ""
        path = opened.path if opened.kind == "hologram" else None
        session.edit(
            f"Open {opened.title}",
            system=system,
            drive=opened.drive,
            view_settings=_look_for(self._view_settings_after_open(opened), system),
            origin=f"{opened.kind} {opened.title}{random}",
            path=path,
        )

    def _set_target(self, wanted: TargetSpec) -> None:
        """A new target; patterns stay unless a quick look may replace them."""
        session = self._session
        session.edit(f"Target {wanted.title}", target_spec=wanted, view_settings=self._view_settings_after_open())
        if self.optimises_new_targets and running_optimisation(session) is None:
            start_quick_optimisation(session)

    def _view_settings_after_open(self, opened: FileContent | None = None) -> ViewSettings:
        """The look, no longer as dark as random patterns need it once something else is shown."""
        state = self._session.document
        was_random = "random patterns" in state.origin and state.view_settings.exposure_stops == SPECKLE_EXPOSURE_STOPS
        stays = opened is not None and opened.kind == "preset"
        return state.view_settings.with_(exposure_stops=0.0) if was_random and not stays else state.view_settings

    # --- a file that another program rewrites -----------------------------------------------------------------------

    @property
    def watched_path(self) -> Path | None:
        """The file that is watched."""
        return None if self._watch is None else self._watch.path

    def set_watching(self, on: bool) -> None:
        """Whether a hologram file on show is read again when it was rewritten."""
        self._watches = on
        self._update_watcher()

    def close(self) -> None:
        """Ends the watch."""
        self._stop()
        self.set_watching(False)

    def _update_watcher(self) -> None:
        path = self._session.document.path if self._watches else None
        if path == self.watched_path:
            return
        if self._watch is not None:
            self._watch.close()
        self._watch = None if path is None else FileWatcher(path, partial(self._reread, path))

    def _reread(self, path: Path) -> None:
        """On the watch's thread: the file has changed."""
        self._session.call_on_owner(lambda: self._reload(path))

    def _reload(self, path: Path) -> None:
        if path != self.watched_path:
            return
        system = self._session.system
        work = partial(_read_with_retries, path=path, system=system)
        self._session.jobs.start(f"Read {path.name} again", work, self._show_again)

    def _show_again(self, opened: FileContent) -> None:
        if opened.path == self.watched_path and opened.drive is not None:
            self._set_hologram(opened)
            self._session.messages.post(f"{opened.title} was rewritten: read again")


def _read_with_retries(control: JobControl, path: Path, system: System) -> FileContent:
    """What a file holds, tried again while it may be half written. Raises UserError when it stays unreadable."""
    for _ in range(round(_RETRY_FOR_S / POLL_INTERVAL_S)):
        control.check()
        try:
            return read_content(path, system)
        except UserError as error:
            mistake = error
        control.sleep(POLL_INTERVAL_S)
    raise mistake


def _look_for(look: ViewSettings, system: System) -> ViewSettings:
    """The look on another bench: its middle plane where the one before isn't among its planes."""
    near, far = float(system.planes_m.min()), float(system.planes_m.max())
    return look if near <= look.plane_m <= far else look.with_(plane_m=middle_plane(system))


def _title(names: str | Path | Sequence[str | Path]) -> str:
    several = [names] if isinstance(names, str | Path) else list(names)
    return Path(several[0]).name if len(several) == 1 else f"{len(several)} files"
