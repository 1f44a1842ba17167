"""The brightness of a session's first quick image, remembered from the last time that its scene was opened.

Measured anew it takes three lasers of the full image, before which no image would be shown. That of the scene with
which the viewer opens is shipped, so that the first start after an installation knows it too.
"""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from holoview.light.model import preset
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import TEXT_LIMIT, cache_dir, data_dir, read_limited
from holoview.viewer.render.scene import Scene

Gain = tuple[float, float, float]
_FILE = "quick-brightness.json"
_REVISION = 1  # of how quick images are computed; to be raised where another one changes their brightness
_MOST = 100  # scenes, the newest ones
_RANGE = 1e-3, 1e3  # of factors that can be


def remembered_gain(scene: Scene) -> Gain | None:
    """The factors of X, Y and Z by which the quick image of a scene was multiplied; None of a scene that is new."""
    match (_entries(shipped_path()) | _entries(cache_dir() / _FILE)).get(_key(scene)):
        case [float(x), float(y), float(z)] if all(_RANGE[0] < factor < _RANGE[1] for factor in (x, y, z)):
            return x, y, z
    return None


def shipped_path() -> Path:
    """The file with the factors of the shipped example."""
    return data_dir("assets") / _FILE


def remember_gain(scene: Scene, gain: Gain, path: Path | None = None) -> None:
    """Stores the factors of a scene where the folder can be written: that of the user's caches, or of another file."""
    key, path = _key(scene), path or cache_dir() / _FILE
    entries = {name: own for name, own in _entries(path).items() if name != key} | {key: list(gain)}
    newest = dict(list(entries.items())[-_MOST:])
    with suppress(OSError, UserError):  # the next time it is measured again
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, json.dumps(newest, indent=1), is_durable=False)


def _key(scene: Scene) -> str:
    """A digest of everything that the brightness of a scene depends on: a bench of one or two modulators. Its text has
    every number exactly, whatever prints it."""
    assert isinstance(scene.drive, np.ndarray)
    text = f"{_REVISION} {float(scene.plane_m)!r} {scene.drive.shape} {preset.dumps(scene.system)}"
    digest = hashlib.blake2b(text.encode(), digest_size=16)
    digest.update(np.ascontiguousarray(scene.drive).tobytes())
    return digest.hexdigest()


def _entries(path: Path) -> dict[str, Any]:
    try:
        entries = json.loads(read_limited(path, "brightnesses", TEXT_LIMIT).decode("utf-8"))
    except (OSError, ValueError, RecursionError, UserError):
        return {}
    return entries if isinstance(entries, dict) else {}
