"""Pictures that change while a hologram is optimised for them: a film, the newest picture of a folder, a camera.

A film's pictures come one after the other, and again from the first. A folder shows its newest picture: another program
writes into it. A camera shows what it sees now; its pictures are read in a thread, so that the newest one is at hand.
"""

from __future__ import annotations

import sys
from collections.abc import Generator, Iterator
from pathlib import Path
from threading import Event, Thread
from typing import Any, Protocol

import numpy as np

from holoview.holograms.targets.focal_stack import Film
from holoview.holograms.targets.picture import Picture, read_picture
from holoview.light.colour import srgb_decode
from holoview.util.errors import UserError
from holoview.util.packages import import_optional

CAMERA = "camera"
"""The name of the first camera; with a colon and a name, of another one."""
_FIRST_PICTURE_S = 10.0  # how long a camera may take
_INPUTS = {"darwin": ("avfoundation", "0"), "win32": ("dshow", "video=0")}
_LINUX = ("v4l2", "/dev/video0")
"""FFmpeg's kind of input for cameras, and the first camera."""


class LivePictures(Protocol):
    """Pictures to be shown one after the other."""

    def next(self) -> Picture:
        """The picture to show from now on: the very object of the last call if that is still the one."""

    def close(self) -> None:
        """Ends reading."""


def open_live_pictures(source: str) -> LivePictures:
    """The pictures of "camera", "camera:NAME", a video file, or a folder.

    Raises UserError for a source that can't be read, and where PyAV is needed and isn't installed.
    """
    kind, _, name = source.partition(":")
    if kind == CAMERA and not Path(source).exists():
        return CameraPictures(name)
    path = Path(source)
    return NewestPicture(path) if path.is_dir() else FilmInTurn(path)


class FilmInTurn:
    """A film's pictures in turn, over and over."""

    def __init__(self, path: Path) -> None:
        self._film = Film(path)
        self._pictures = self._film.pictures()

    def next(self) -> Picture:
        """The next picture; the first one after the last. Raises UserError for one that can't be read."""
        picture = next(self._pictures, None)
        if picture is None:
            self._pictures = self._film.pictures()
            picture = next(self._pictures, None)
        if picture is None:
            raise UserError(str(self._film.path), "has no pictures", expected="a film")
        return picture

    def close(self) -> None:
        """Closes the file."""
        if isinstance(self._pictures, Generator):
            self._pictures.close()


class NewestPicture:
    """The picture of a folder that was written last; one that can't be read, being half written, isn't taken yet."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read: tuple[Path, int] | None = None
        self._picture: Picture | None = None

    def next(self) -> Picture:
        """The newest picture that can be read. Raises UserError for a folder without any."""
        problem: UserError | None = None
        for path, written in self._newest_first():
            if (path, written) == self._read:
                break
            try:
                self._picture, self._read = read_picture(path), (path, written)
                break
            except UserError as error:
                problem = problem or error
        if self._picture is None:
            raise problem or UserError(str(self._folder), "has no pictures", expected="a folder with a picture")
        return self._picture

    def close(self) -> None:
        """Nothing is open between two pictures."""

    def _newest_first(self) -> Iterator[tuple[Path, int]]:
        written = []
        for path in self._folder.iterdir():
            if not path.name.startswith(".") and path.is_file():
                written.append((path.stat().st_mtime_ns, path))
        return ((path, when) for when, path in sorted(written, reverse=True))


class CameraPictures:
    """What a camera sees. name: as FFmpeg calls it, "" for the first camera.

    Raises UserError if there is none, or it sends no picture within 10 seconds.
    """

    def __init__(self, name: str = "") -> None:
        av = import_optional("av", "a camera as the target")
        kind, first = _INPUTS.get(sys.platform, _LINUX)
        self._title = f"{CAMERA} {name or first}"
        try:
            self._container = av.open(name or first, format=kind)
        except (av.error.FFmpegError, ValueError) as error:
            raise UserError(self._title, f"can't be opened: {error}", expected="a camera that FFmpeg reads") from error
        self._latest: Any = None
        self._has_picture, self._ends = Event(), Event()
        self._picture: tuple[Any, Picture] | None = None
        self._error: Exception | None = None
        self._thread = Thread(target=self._read, args=(av.error.FFmpegError,), name="camera", daemon=True)
        self._thread.start()

    def next(self) -> Picture:
        """The newest picture. Raises UserError when the camera has ended."""
        self._has_picture.wait(_FIRST_PICTURE_S)
        frame = self._latest
        if frame is None or self._error is not None:
            raise UserError(self._title, f"sends no pictures: {self._error or 'none came'}", expected="a camera")
        if self._picture is None or self._picture[0] is not frame:
            light = srgb_decode(frame.to_ndarray(format="rgb24") / 255.0).astype(np.float32)
            self._picture = frame, Picture(light, self._title)
        return self._picture[1]

    def close(self) -> None:
        """Lets the camera go."""
        self._ends.set()
        self._thread.join(_FIRST_PICTURE_S)

    def _read(self, failure: type[Exception]) -> None:
        with self._container as container:
            try:
                for frame in container.decode(video=0):
                    self._latest = frame
                    self._has_picture.set()
                    if self._ends.is_set():
                        return
            except failure as error:
                self._error = error
                self._has_picture.set()
