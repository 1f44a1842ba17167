"""What timing the strategies of a transform told, remembered on disk.

One JSON file in the user's cache folder holds an entry for each adapter, driver, version of wgpu and size. It saves
time and nothing else: what can't be read, or isn't as expected, counts as not there, and failing to write is no error.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

from holoview.gpu.adapter import AdapterInfo
from holoview.gpu.line_fft import STRATEGIES, Strategy
from holoview.util.errors import UserError
from holoview.util.files import atomic_write

FORMAT = 1
"""To be raised when the shaders become faster or slower, or the file's layout changes."""
_FILE = "fft-strategies.json"


@dataclass(frozen=True)
class TuningResult:
    """Seconds that a forward and an inverse FFT take by each strategy, and seconds that compiling them took.

    A strategy that wasn't compiled within the budget, failed, or gave wrong results, is in `refused` with the reason.
    """

    seconds: Mapping[Strategy, float]
    compile_seconds: Mapping[Strategy, float]
    refused: Mapping[Strategy, str]

    @property
    def best(self) -> Strategy:
        """The fastest strategy that isn't refused."""
        offered = {s: t for s, t in self.seconds.items() if s not in self.refused}
        return min(offered, key=lambda s: offered[s]) if offered else "passes"

    def without(self, strategy: Strategy, reason: str) -> TuningResult:
        """The same with a strategy refused."""
        return TuningResult(self.seconds, self.compile_seconds, {**self.refused, strategy: reason})

    def with_answer(self, answer: Mapping[str, Any]) -> TuningResult:
        """The same with what an answer of the helper says of its strategy."""
        strategy = answer["strategy"]
        if "refused" in answer:
            return self.without(strategy, answer["refused"])
        parts = [{**old, strategy: answer[name]} if name in answer else old for name, old in self._times()]
        return TuningResult(parts[0], parts[1], self.refused)

    def _times(self) -> list[tuple[str, Mapping[Strategy, float]]]:
        return [("seconds", self.seconds), ("compile_seconds", self.compile_seconds)]


class TuningStore:
    """Tunings in a file below `folder`, by default that of the user's caches."""

    def __init__(self, folder: Path | None = None) -> None:
        self.path = (cache_dir() if folder is None else folder) / _FILE

    def load(self, info: AdapterInfo, shape: tuple[int, int]) -> TuningResult | None:
        """What is known about an adapter and a shape (ny, nx)."""
        return _tuning(self._entries().get(_key(info, shape)))

    def save(self, info: AdapterInfo, shape: tuple[int, int], tuning: TuningResult) -> None:
        """Keep a tuning for the next time, where that is possible."""
        entry = {
            "seconds": dict(tuning.seconds),
            "compile_seconds": dict(tuning.compile_seconds),
            "refused": dict(tuning.refused),
        }
        entries = {**self._entries(), _key(info, shape): entry}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(self.path) as beside:
                beside.write_text(json.dumps(entries, indent=1, sort_keys=True), encoding="utf-8")
        except (OSError, UserError):
            return  # a folder that can't be written to, or a full disk: it is measured again next time

    def _entries(self) -> dict[str, Any]:
        try:
            found = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return {}
        return found if isinstance(found, dict) else {}


def cache_dir() -> Path:
    """The folder for what can be made again, of this user and this program; it may not exist yet."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA", "")
    elif sys.platform == "darwin":
        base = str(Path.home() / "Library" / "Caches")
    else:
        base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if Path(base).is_absolute() else Path.home() / ".cache") / "holoview"


def _key(info: AdapterInfo, shape: tuple[int, int]) -> str:
    """All that the choice depends on."""
    return json.dumps([FORMAT, info.name, info.backend, info.driver, version("wgpu"), *shape])


def _tuning(entry: object) -> TuningResult | None:
    """A tuning from JSON, if it is one."""
    if not isinstance(entry, dict):
        return None
    seconds, compiled, refused = (entry.get(name) for name in ("seconds", "compile_seconds", "refused"))
    if not (_is_times(seconds) and _is_times(compiled) and _is_by_strategy(refused)):
        return None
    if not all(isinstance(reason, str) for reason in cast("dict[str, Any]", refused).values()):
        return None
    return TuningResult(
        cast("dict[Strategy, float]", seconds),
        cast("dict[Strategy, float]", compiled),
        cast("dict[Strategy, str]", refused),
    )


def _is_times(values: object) -> bool:
    return _is_by_strategy(values) and all(
        isinstance(t, int | float) and math.isfinite(t) and t >= 0 for t in cast("dict[str, Any]", values).values()
    )


def _is_by_strategy(values: object) -> bool:
    return isinstance(values, dict) and set(values) <= set(STRATEGIES)
