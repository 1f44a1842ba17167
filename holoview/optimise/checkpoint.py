"""Checkpoints: all that an optimisation needs to go on bit for bit on the same machine, in one safetensors file.

drive first second             float32 (frame, modulator, y, x): patterns and Adam's two moments
best_drive                     float32: the best hologram so far
amplitudes best_amplitudes     float64 (frame, wavelength)
metadata                       format, version, system (TOML), settings and progress (JSON), digest of the target
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from holoview import preset
from holoview.errors import UserError
from holoview.files import replacing
from holoview.optimise.settings import Settings
from holoview.system import System

_FORMAT, _VERSION = "holoview-checkpoint", "1"
_TENSORS = ("drive", "first", "second", "best_drive", "amplitudes", "best_amplitudes")
_WHAT = "a checkpoint that `holoview optimise` wrote"


@dataclass(frozen=True)
class Progress:
    """How far an optimisation has come: the iteration to do next, the time spent, and the best so far."""

    iteration: int
    seconds: float
    best_loss: float
    best_psnr_db: float


@dataclass(frozen=True)
class Checkpoint:
    """An optimisation between two iterations."""

    system: System
    settings: Settings
    target: str
    progress: Progress
    tensors: dict[str, NDArray[np.floating]]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file, whole or not at all: the one before stays until then."""
        metadata = {
            "format": _FORMAT,
            "version": _VERSION,
            "system": preset.dumps(self.system),
            "settings": json.dumps(dataclasses.asdict(self.settings)),
            "progress": json.dumps(dataclasses.asdict(self.progress)),
            "target": self.target,
        }
        with replacing(path) as temporary:
            save_file({name: np.ascontiguousarray(self.tensors[name]) for name in _TENSORS}, temporary, metadata)

    def check(self, system: System, settings: Settings, target: str, where: str) -> None:
        """UserError that names what differs, unless the checkpoint is of this system, settings and target."""
        mine, given = (tomllib.loads(preset.dumps(s)) for s in (self.system, system))
        differing = [key for key in {**mine, **given} if mine.get(key) != given.get(key)]
        ours, theirs = dataclasses.asdict(self.settings), dataclasses.asdict(settings)
        differing += [key for key, value in ours.items() if value != theirs[key]]
        differing += ["the target"] * (self.target != target)
        if differing:
            raise UserError(
                where,
                f"is of another optimisation: {', '.join(differing)} differ",
                expected="the same preset, picture and options as when it was begun",
            )


def load_checkpoint(path: str | os.PathLike[str]) -> Checkpoint:
    """Reads a checkpoint. Raises UserError when it is missing, damaged, or no checkpoint."""
    if not Path(path).is_file():
        raise UserError(str(path), "no such file", expected=_WHAT)
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            if (metadata.get("format"), metadata.get("version")) != (_FORMAT, _VERSION):
                raise UserError(str(path), f'format "{metadata.get("format", "none")}"', expected=_WHAT)
            tensors = {name: file.get_tensor(name) for name in _TENSORS}
        settings = json.loads(metadata["settings"])
        settings["betas"] = tuple(settings["betas"])
        progress = Progress(**json.loads(metadata["progress"]))
        system = preset.loads(metadata["system"], f"{path}: system")
        return Checkpoint(system, Settings(**settings), metadata["target"], progress, tensors)
    except UserError:
        raise
    except (SafetensorError, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UserError(str(path), f"can't be read: {error}", expected=_WHAT) from error


def digest(stack: NDArray[np.floating]) -> str:
    """A fingerprint of a target stack."""
    values = np.ascontiguousarray(stack, dtype=np.float32)
    return hashlib.sha256(repr(values.shape).encode() + values.tobytes()).hexdigest()
