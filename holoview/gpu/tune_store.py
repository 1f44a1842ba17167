"""Caches the measured times of the FFT strategies in a JSON file.

The file in the user's cache folder holds an entry for each adapter, driver, version of wgpu and size. It is only a
cache: entries that can't be read or are invalid are ignored, and so is a failure to write.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

from holoview.gpu.adapter import AdapterInfo
from holoview.gpu.line_fft import STRATEGIES, Strategy
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import cache_dir

FORMAT = 1
"""Version of the entries; to be increased when shaders become faster or slower, or the layout of the file changes."""
_FILE = "fft-strategies.json"


@dataclass(frozen=True)
class TuningResult:
    """Seconds of a forward plus an inverse FFT with each strategy, and seconds to compile both.

    `refused` holds the reason for each strategy that wasn't compiled in time, failed, or gave wrong results.
    """

    seconds: Mapping[Strategy, float]
    compile_seconds: Mapping[Strategy, float]
    refused: Mapping[Strategy, str]

    @property
    def best(self) -> Strategy:
        """The fastest strategy that isn't refused."""
        accepted = {s: t for s, t in self.seconds.items() if s not in self.refused}
        return min(accepted, key=lambda s: accepted[s]) if accepted else "passes"

    def without(self, strategy: Strategy, reason: str) -> TuningResult:
        """The same result with one more strategy refused."""
        return TuningResult(self.seconds, self.compile_seconds, {**self.refused, strategy: reason})

    def with_answer(self, answer: Mapping[str, Any]) -> TuningResult:
        """The same result with an answer of the helper added."""
        strategy = answer["strategy"]
        if "refused" in answer:
            return self.without(strategy, answer["refused"])
        seconds, compile_seconds = (
            {**times, strategy: answer[name]} if name in answer else times
            for name, times in (("seconds", self.seconds), ("compile_seconds", self.compile_seconds))
        )
        return TuningResult(seconds, compile_seconds, self.refused)


class TuningStore:
    """Tuning results in a file in `folder`, by default `cache_dir()`."""

    def __init__(self, folder: Path | None = None) -> None:
        self.path = (cache_dir() if folder is None else folder) / _FILE

    def load(self, info: AdapterInfo, shape: tuple[int, int]) -> TuningResult | None:
        """The result for an adapter and a shape (ny, nx), or None."""
        return _parse_entry(self._entries().get(_key(info, shape)))

    def save(self, info: AdapterInfo, shape: tuple[int, int], tuning: TuningResult) -> None:
        """Store a result if possible."""
        entry = {
            "seconds": dict(tuning.seconds),
            "compile_seconds": dict(tuning.compile_seconds),
            "refused": dict(tuning.refused),
        }
        entries = {**self._entries(), _key(info, shape): entry}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_file(self.path, json.dumps(entries, indent=1, sort_keys=True), is_durable=False)
        except (OSError, UserError):
            return  # the folder isn't writable or the disk is full: the next run measures again

    def _entries(self) -> dict[str, Any]:
        try:
            entries = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return {}
        return entries if isinstance(entries, dict) else {}


def _key(info: AdapterInfo, shape: tuple[int, int]) -> str:
    """Key of an entry: everything that the times depend on."""
    return json.dumps([FORMAT, info.name, info.backend, info.driver, version("wgpu"), *shape])


def _parse_entry(entry: object) -> TuningResult | None:
    """A result from the JSON of an entry; None if it is invalid."""
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
