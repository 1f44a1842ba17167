"""Opens files into a session: reads them in the background, applies them as one edit, and watches hologram files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.document.document import middle_plane
from holoview.document.editing_session import EditingSession
from holoview.document.example import has_example_target, is_example_bench, random_patterns_hint, show_example
from holoview.document.file_reader import FileContent, read_content, target_from_image_bytes, target_from_pixels
from holoview.document.file_watcher import POLL_INTERVAL_S, FileWatcher
from holoview.document.jobs import BackgroundJob, JobControl
from holoview.document.optimisation_job import running_optimisation, start_quick_optimisation
from holoview.document.target_spec import TargetSpec
from holoview.model.pupil_path import PupilPath
from holoview.model.system import System
from holoview.render.view_settings import ViewSettings
from holoview.util.errors import UserError

_RETRY_FOR_S = 10.0
"""How long a watched file may stay unreadable, being half written, before an error is reported."""


class FileLoader:
    """Opens files into a session in the background, and reloads a displayed hologram file when it is rewritten.

    remember: called with the path of each file that was opened. quick: whether a quick optimisation starts for a new
    target; it can be changed later as `optimises_new_targets`.
    """

    def __init__(
        self, session: EditingSession, *, remember: Callable[[Path], None] = lambda path: None, quick: bool = True
    ) -> None:
        self.optimises_new_targets = quick
        self._session, self._remember = session, remember
        self._watcher: FileWatcher | None = None
        self._is_watching = True
        self._stop = session.add_listener(lambda change: self._update_watcher() if "drive" in change.kinds else None)
        self._update_watcher()

    def open(self, names: str | Path | Sequence[str | Path]) -> BackgroundJob:
        """Opens one or several files, or a preset by its name; errors become messages."""
        system = self._session.system
        title = _title(names)
        return self._session.jobs.start(f"Open {title}", lambda control: read_content(names, system), self.apply)

    def paste(self, picture: NDArray[np.uint8] | bytes) -> None:
        """Makes 8-bit sRGB pixels (y, x, 3 or 4), or the bytes of a picture file, the target. Raises UserError."""
        target_spec = target_from_image_bytes(picture) if isinstance(picture, bytes) else target_from_pixels(picture)
        self.apply(FileContent("picture", target_spec.title, target_spec=target_spec))

    def apply(self, content: FileContent) -> None:
        """Applies the content of a file as an edit of the session. Raises UserError when it doesn't fit."""
        session = self._session
        for note in content.notes:
            session.messages.post(f"{content.title}: {note}")
        if content.target_spec is not None:
            self._set_target(content.target_spec)
        elif content.pupil_path is not None:
            self._set_pupil_path(content.title, content.pupil_path)
        elif content.kind == "preset" and has_example_target(session) and is_example_bench(content.system):
            show_example(session)
        else:
            self._set_hologram(content)
        if content.path is not None:
            self._remember(content.path)

    def _set_hologram(self, content: FileContent) -> None:
        session = self._session
        system = content.system or session.system
        assert content.drive is not None
        is_preset = content.kind == "preset"
        random = ", random patterns" if is_preset else ""
        path = content.path if content.kind == "hologram" else None
        view_settings = session.view_settings if is_preset else session.document.view_settings_for_picture
        if content.plane_m is not None:
            view_settings = view_settings.with_(plane_m=content.plane_m)
        target_spec = None if has_example_target(session) and not is_preset else session.target_spec
        session.edit(
            f"Open {content.title}",
            system=system,
            drive=content.drive,
            target_spec=target_spec,
            view_settings=_clamp_plane(view_settings, system),
            origin=f"{content.kind} {content.title}{random}",
            path=path,
        )
        if is_preset and target_spec is not None:
            session.messages.post(random_patterns_hint(target_spec))

    def _set_target(self, target_spec: TargetSpec) -> None:
        """Sets a new target; the patterns change only if a quick optimisation starts."""
        session = self._session
        view_settings = session.document.view_settings_for_picture
        session.edit(f"Target {target_spec.title}", target_spec=target_spec, view_settings=view_settings)
        if self.optimises_new_targets and running_optimisation(session) is None:
            start_quick_optimisation(session)

    def _set_pupil_path(self, title: str, path: PupilPath) -> None:
        """Sets the path of the pupil; a bench without an eye gets one."""
        session = self._session
        system = session.system if session.system.eye is not None else session.system.edit({"eye": {}})
        session.edit(f"Open {title}", system=system, view_settings=session.view_settings.with_(pupil_path=path))
        session.messages.post(f"{title}: a path of {path.duration_s:.3g} s; the panel Eye plays it")

    # --- watching ---------------------------------------------------------------------------------------------------

    @property
    def watched_path(self) -> Path | None:
        """The hologram file that is watched, if any."""
        return None if self._watcher is None else self._watcher.path

    def set_watching(self, on: bool) -> None:
        """Sets whether a displayed hologram file is reloaded when another program rewrites it."""
        self._is_watching = on
        self._update_watcher()

    def close(self) -> None:
        """Stops watching."""
        self._stop()
        self.set_watching(False)

    def _update_watcher(self) -> None:
        path = self._session.document.path if self._is_watching else None
        if path == self.watched_path:
            return
        if self._watcher is not None:
            self._watcher.close()
        self._watcher = None if path is None else FileWatcher(path, partial(self._reread, path))

    def _reread(self, path: Path) -> None:
        """Called on the watcher's thread when the file has changed."""
        self._session.call_on_owner(lambda: self._reload(path))

    def _reload(self, path: Path) -> None:
        if path != self.watched_path:
            return
        system = self._session.system
        work = partial(_read_with_retries, path=path, system=system)
        self._session.jobs.start(f"Read {path.name} again", work, self._show_again)

    def _show_again(self, content: FileContent) -> None:
        if content.path == self.watched_path and content.drive is not None:
            self._set_hologram(content)
            self._session.messages.post(f"{content.title} was rewritten: read again")


def _read_with_retries(control: JobControl, path: Path, system: System) -> FileContent:
    """Reads a file, again and again while it may be half written. Raises UserError when it stays unreadable."""
    for _ in range(round(_RETRY_FOR_S / POLL_INTERVAL_S)):
        control.check()
        try:
            return read_content(path, system)
        except UserError as error:
            last_error = error
        control.sleep(POLL_INTERVAL_S)
    raise last_error


def _clamp_plane(view: ViewSettings, system: System) -> ViewSettings:
    """The view settings for another system: its median plane if the present one is outside its range of planes."""
    low, high = float(system.planes_m.min()), float(system.planes_m.max())
    return view if low <= view.plane_m <= high else view.with_(plane_m=middle_plane(system))


def _title(names: str | Path | Sequence[str | Path]) -> str:
    several = [names] if isinstance(names, str | Path) else list(names)
    return Path(several[0]).name if len(several) == 1 else f"{len(several)} files"
