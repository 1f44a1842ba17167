"""The checkpoint and the preview that are written from time to time while an optimisation runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.colour import to_srgb8
from holoview.commands.console import print_stderr
from holoview.commands.optimise_options import RunOptions
from holoview.io.pictures import write_png
from holoview.util.errors import UserError

_PREVIEW_INTERVAL_S = 2.0


class _State(Protocol):
    """What the states of the model's and of the camera's loop have in common."""

    @property
    def iteration(self) -> int: ...
    @property
    def psnr_db(self) -> float: ...
    @property
    def picture(self) -> Callable[[], NDArray[np.floating]]: ...
    @property
    def checkpoint(self) -> Callable[[], Any]: ...


class IntermediateFiles:
    """Writes what the options of a run ask for."""

    def __init__(self, options: RunOptions) -> None:
        self._options = options
        self._checkpoint_time = self._preview_time = time.monotonic()

    def write_due(self, state: _State, *, is_last: bool) -> None:
        """Writes the files whose interval is over, and all of them after the last iteration."""
        now = time.monotonic()
        if is_last or now - self._checkpoint_time >= self._options.checkpoint_interval_s:
            self.write_checkpoint(state)
            self._checkpoint_time = now
        if is_last or state.iteration == 0 or now - self._preview_time >= _PREVIEW_INTERVAL_S:
            _write_or_warn("preview", self._options.preview, state, _write_preview)
            self._preview_time = now

    def write_checkpoint(self, state: _State) -> None:
        """Writes the checkpoint if one was asked for."""
        _write_or_warn("checkpoint", self._options.checkpoint, state, lambda s, path: s.checkpoint().save(path))


def _write_or_warn(what: str, path: Path | None, state: _State, write: Callable[[_State, Path], None]) -> None:
    """Writes a file if it was asked for; a failure only prints a note, because the optimisation isn't affected."""
    if path is None:
        return
    try:
        write(state, path)
    except UserError as error:
        print_stderr(f"note: no {what} after iteration {state.iteration}: {error}")


def _write_preview(state: _State, path: Path) -> None:
    texts = {"holoview.iteration": str(state.iteration), "holoview.psnr_db": f"{state.psnr_db:.2f}"}
    write_png(path, to_srgb8(state.picture()), texts)
