"""The brightness of a session's first quick image, remembered from the last time that its scene was opened.

Measured anew it takes three lasers of the full image, before which no image would be shown.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from contextlib import suppress
from importlib.metadata import version
from typing import Any

import numpy as np

from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import TEXT_LIMIT, cache_dir, read_limited
from holoview.viewer.render.scene import Scene

Gain = tuple[float, float, float]
_FILE = "quick-brightness.json"
_MOST = 100  # scenes, the newest ones
_RANGE = 1e-3, 1e3  # of factors that can be


def remembered_gain(scene: Scene) -> Gain | None:
    """The factors of X, Y and Z by which the quick image of a scene was multiplied; None of a scene that is new."""
    match _entries().get(_key(scene)):
        case [float(x), float(y), float(z)] if all(_RANGE[0] < factor < _RANGE[1] for factor in (x, y, z)):
            return x, y, z
    return None


def remember_gain(scene: Scene, gain: Gain) -> None:
    """Stores the factors of a scene where the folder can be written."""
    key, path = _key(scene), cache_dir() / _FILE
    entries = {name: own for name, own in _entries().items() if name != key} | {key: list(gain)}
    newest = dict(list(entries.items())[-_MOST:])
    with suppress(OSError, UserError):  # the next time it is measured again
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, json.dumps(newest, indent=1), is_durable=False)


def _key(scene: Scene) -> str:
    """A digest of everything that the brightness of a scene depends on: a bench of one or two modulators."""
    assert isinstance(scene.drive, np.ndarray)
    digest = hashlib.blake2b(repr((version("holoview"), scene.plane_m, scene.drive.shape)).encode(), digest_size=16)
    digest.update(np.ascontiguousarray(scene.drive).tobytes())
    for field in dataclasses.fields(scene.system):
        value = getattr(scene.system, field.name)
        digest.update(
            field.name.encode() + (value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
        )
    return digest.hexdigest()


def _entries() -> dict[str, Any]:
    try:
        entries = json.loads(read_limited(cache_dir() / _FILE, "brightnesses", TEXT_LIMIT).decode("utf-8"))
    except (OSError, ValueError, RecursionError, UserError):
        return {}
    return entries if isinstance(entries, dict) else {}
