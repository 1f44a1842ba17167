"""Stores job results as JSON and PNG files in a folder, so that a repeated run continues."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from holoview.io.png import write_png
from holoview.study.study import JobResult, StudyJob
from holoview.util.errors import UserError
from holoview.util.files import atomic_write

_FORMAT = "holoview-result"


class ResultStore:
    """The results in a folder, by the keys of their jobs. Raises UserError when the folder can't be made."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            remedy = "choose another folder"
            raise UserError(str(folder), f"can't be made: {error.strerror}", remedy=remedy) from error

    def load(self, job: StudyJob) -> JobResult | None:
        """The result of a job; None when it is missing or incomplete."""
        path = self._path(job)
        try:
            stored = json.loads(path.read_text(encoding="utf-8"))
            if stored["format"] != _FORMAT:
                return None
            pictures = {name: _read_pixels(self.folder / file) for name, file in stored["pictures"].items()}
            return JobResult(stored["numbers"], pictures)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None

    def save(self, job: StudyJob, result: JobResult) -> None:
        """Writes a result, the JSON file last: where it exists, the pictures do too."""
        files: dict[str, str] = {}
        for name, pixels in result.pictures.items():
            files[name] = f"{job.key}-{name}.png"
            write_png(self.folder / files[name], pixels, {"holoview.job": job.label})
        content: dict[str, Any] = {
            "format": _FORMAT,
            "study": job.study,
            "label": job.label,
            "settings": dict(job.settings),
            "numbers": result.numbers,
            "pictures": files,
        }
        with atomic_write(self._path(job)) as temporary:
            temporary.write_text(json.dumps(content, indent=1), encoding="utf-8")

    def _path(self, job: StudyJob) -> Path:
        return self.folder / f"{job.key}.json"


def _read_pixels(path: Path) -> Any:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))
