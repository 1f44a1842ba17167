"""The pictures of a film: a video file, read by PyAV, or a folder of pictures in the natural order of their names."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from holoview.colour import srgb_decode
from holoview.targets.image_reader import natural_sort_key
from holoview.targets.picture import Picture, read_picture
from holoview.util.errors import UserError
from holoview.util.files import require_file
from holoview.util.packages import import_optional

SUFFIXES = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi")
"""Of video files."""
_EXPECTED = f"a video file ({', '.join(SUFFIXES)})"


def is_video(path: Path) -> bool:
    """Whether the name is that of a video file."""
    return path.suffix.lower() in SUFFIXES


@dataclass(frozen=True)
class Film:
    """A film that can be read. count: of its pictures, 0 where a video file doesn't state it. space: of float pictures.

    Raises UserError for a missing or damaged file, a folder without pictures, and where PyAV isn't installed.
    """

    path: Path
    space: str = "srgb"

    def __post_init__(self) -> None:
        if self.path.is_dir():
            if not self._files:
                raise UserError(str(self.path), "has no pictures", expected="the pictures of a film, or " + _EXPECTED)
            return
        require_file(self.path, _EXPECTED)
        if not is_video(self.path):
            raise UserError(str(self.path), "isn't a film", expected=f"{_EXPECTED}, or a folder of pictures")
        with self._stream():
            pass

    @property
    def count(self) -> int:
        """The number of pictures; 0 if it isn't known before they are read."""
        if self.path.is_dir():
            return len(self._files)
        with self._stream() as (_, stream):
            return int(stream.frames)

    def pictures(self) -> Iterator[Picture]:
        """One after the other, as linear light. Raises UserError for a picture that can't be read."""
        if self.path.is_dir():
            for file in self._files:
                yield read_picture(file, space=self.space)
            return
        with self._stream() as (container, stream):
            for number, frame in enumerate(container.decode(stream)):
                light = srgb_decode(frame.to_ndarray(format="rgb24") / 255.0)
                yield Picture(light.astype(np.float32), f"{self.path}, picture {number}")

    @property
    def _files(self) -> list[Path]:
        files = [file for file in self.path.iterdir() if file.is_file() and not file.name.startswith(".")]
        return sorted(files, key=lambda file: natural_sort_key(file.name))

    @contextmanager
    def _stream(self) -> Iterator[tuple[Any, Any]]:
        """The opened video file and its first stream of pictures."""
        av = import_optional("av", "a film")
        try:
            with av.open(str(self.path)) as container:
                if not container.streams.video:
                    raise UserError(str(self.path), "has no pictures", expected=_EXPECTED)
                yield container, container.streams.video[0]
        except av.error.FFmpegError as error:
            raise UserError(str(self.path), f"can't be read: {error.strerror or error}", expected=_EXPECTED) from error
