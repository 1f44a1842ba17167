"""Saves and restores an optimisation in a safetensors file, from which it continues bit for bit on the same machine.

drive first second               float32 (frame, modulator, y, x): patterns and Adam's two moments
best_drive                       float32: the best hologram so far
amplitudes best_amplitudes       float64 (frame, wavelength)
wavelengths best_wavelengths     float64 (wavelength,), m
amplitude_moments                float64 (2, frame, wavelength), of Adam
wavelength_moments               float64 (2, wavelength)
steps                            float64 (3,): Adam's number of steps of patterns, amplitudes and wavelengths
metadata                         format, version, system (TOML), settings and progress (JSON), digest of the target
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import tomllib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.model import preset
from holoview.model.system import System
from holoview.optimise.settings import Settings
from holoview.util.checkpoint import differing_fields, refuse_differences
from holoview.util.errors import UserError
from holoview.util.safetensors_file import TensorFormat

_FORMAT = TensorFormat(
    name="holoview-checkpoint",
    version="2",
    what="a checkpoint that `holoview optimise` wrote",
    tensors=(
        *("drive", "first", "second", "best_drive", "amplitudes", "best_amplitudes", "wavelengths"),
        *("best_wavelengths", "amplitude_moments", "wavelength_moments", "steps"),
    ),
    metadata_keys=("system", "settings", "progress", "target"),
)


@dataclass(frozen=True)
class CheckpointProgress:
    """How far an optimisation has come.

    iteration: the next one. seconds: time spent. best_loss, best_psnr_db: of the smallest loss so far. eyebox: the
    latest coefficient of variation of the light in the eyebox.
    """

    iteration: int
    seconds: float
    best_loss: float
    best_psnr_db: float
    eyebox: float


@dataclass(frozen=True)
class Checkpoint:
    """An optimisation between two iterations. target: `target_digest` of its focal stack."""

    system: System
    settings: Settings
    target: str
    progress: CheckpointProgress
    tensors: dict[str, NDArray[np.floating]]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file; an existing one is replaced only by a complete one."""
        texts = {
            "system": preset.dumps(self.system),
            "settings": json.dumps(dataclasses.asdict(self.settings)),
            "progress": json.dumps(dataclasses.asdict(self.progress)),
            "target": self.target,
        }
        _FORMAT.write(path, self.tensors, texts)

    def check_matches(self, system: System, settings: Settings, target: str, where: str) -> None:
        """Raises UserError that names what differs, unless the checkpoint is of this system, settings and target.

        where: how the error names the checkpoint.
        """
        stored, given = (tomllib.loads(preset.dumps(s)) for s in (self.system, system))
        differing = [key for key in {**stored, **given} if stored.get(key) != given.get(key)]
        differing += differing_fields(self.settings, settings)
        differing += ["the target"] * (self.target != target)
        refuse_differences(differing, where, "optimisation", "preset, picture and options")


def load_checkpoint(path: str | os.PathLike[str]) -> Checkpoint:
    """Reads a checkpoint. Raises UserError when the file is missing, damaged, or something else."""
    tensors, texts = _FORMAT.read(path)
    system = preset.loads(texts["system"], f"{path}: system")
    try:
        stored = json.loads(texts["settings"]).items()
        settings: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in stored}
        progress = CheckpointProgress(**json.loads(texts["progress"]))
        return Checkpoint(system, Settings(**settings), texts["target"], progress, tensors)
    except UserError:
        raise
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(str(path), f"can't be read: {error}", expected=_FORMAT.what) from error


def target_digest(stack: NDArray[np.floating]) -> str:
    """The SHA-256 of a focal stack's shape and float32 values."""
    values = np.ascontiguousarray(stack, dtype=np.float32)
    return hashlib.sha256(repr(values.shape).encode() + values.tobytes()).hexdigest()
