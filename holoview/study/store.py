"""Stores job results as JSON and PNG files in a folder, so that a repeated run continues."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.io.png import write_png
from holoview.study.study import JobResult, StudyJob
from holoview.targets.image_reader import read_raster
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder, write_file
from holoview.util.input_file import read_text
from holoview.util.tables import parse_json_table

_FORMAT, _WHAT = "holoview-result", "the result of a study's job"
_MOST_BYTES = 1 << 28  # of its numbers


class ResultStore:
    """The results in a folder, by the keys of their jobs. Raises WriteError when the folder can't be made."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        make_folder(folder)

    def load(self, job: StudyJob) -> JobResult | None:
        """The result of a job; None when it is missing, incomplete or damaged, so that the job is to be done again."""
        path = self._path(job)
        try:
            stored = parse_json_table(read_text(path, _WHAT, most=_MOST_BYTES), str(path), _WHAT)
            numbers, files = stored.get("numbers"), stored.get("pictures")
            if stored.get("format") != _FORMAT or not isinstance(numbers, dict) or not isinstance(files, dict):
                return None
            return JobResult(numbers, {name: self._read_pixels(file) for name, file in files.items()})
        except UserError:
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
        write_file(self._path(job), json.dumps(content, indent=1))

    def _read_pixels(self, name: Any) -> NDArray[np.uint8]:
        """The pixels of a picture of this folder, (y, x, 3)."""
        if not isinstance(name, str) or Path(name).name != name:
            raise UserError(str(self.folder), f"the picture {name!r}", expected="the name of a file in this folder")
        raster = read_raster(self.folder / name)
        return np.broadcast_to(np.rint(raster.values * 255).astype(np.uint8), (*raster.values.shape[:2], 3))

    def _path(self, job: StudyJob) -> Path:
        return self.folder / f"{job.key}.json"
