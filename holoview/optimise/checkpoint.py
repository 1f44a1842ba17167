"""Checkpoints: all that an optimisation needs to go on bit for bit on the same machine, in one safetensors file.

drive first second               float32 (frame, modulator, y, x): patterns and Adam's two moments
best_drive                       float32: the best hologram so far
amplitudes best_amplitudes       float64 (frame, wavelength)
wavelengths best_wavelengths     float64 (wavelength,), m
amplitude_moments                float64 (2, frame, wavelength), of Adam
wavelength_moments               float64 (2, wavelength)
steps                            float64 (3,): how many gradients patterns, amplitudes and wavelengths have seen
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
    """How far an optimisation has come: iteration to do next, seconds spent, the best so far, and the eyebox."""

    iteration: int
    seconds: float
    best_loss: float
    best_psnr_db: float
    eyebox: float


@dataclass(frozen=True)
class Checkpoint:
    """An optimisation between two iterations."""

    system: System
    settings: Settings
    target: str
    progress: CheckpointProgress
    tensors: dict[str, NDArray[np.floating]]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file, whole or not at all: the one before stays until then."""
        texts = {
            "system": preset.dumps(self.system),
            "settings": json.dumps(dataclasses.asdict(self.settings)),
            "progress": json.dumps(dataclasses.asdict(self.progress)),
            "target": self.target,
        }
        _FORMAT.write(path, self.tensors, texts)

    def check_matches(self, system: System, settings: Settings, target: str, where: str) -> None:
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
    tensors, texts = _FORMAT.read(path)
    system = preset.loads(texts["system"], f"{path}: system")
    try:
        written = json.loads(texts["settings"]).items()
        settings: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in written}
        progress = CheckpointProgress(**json.loads(texts["progress"]))
        return Checkpoint(system, Settings(**settings), texts["target"], progress, tensors)
    except UserError:
        raise
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(str(path), f"can't be read: {error}", expected=_FORMAT.what) from error


def target_digest(stack: NDArray[np.floating]) -> str:
    """A fingerprint of a target stack."""
    values = np.ascontiguousarray(stack, dtype=np.float32)
    return hashlib.sha256(repr(values.shape).encode() + values.tobytes()).hexdigest()
