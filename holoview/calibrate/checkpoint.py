"""Checkpoints: all that a calibration needs to go on bit for bit on the same machine, in one safetensors file.

NAME NAME.best NAME.first NAME.second NAME.count   each tensor, the best one so far, Adam's moments and count
mismatch                                           float64 (capture,): how far off each capture was when last seen
metadata                                           format, version, layout, settings, progress, known effects (JSON),
                                                   digest of the captures
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.calibrate.settings import CalibrationSettings
from holoview.captures.dataset import Captures
from holoview.effects.learned_maps import MapLayout
from holoview.model.effects.active_effects import EffectValues
from holoview.util.errors import UserError
from holoview.util.safetensors_file import TensorFormat

_PARTS = ("", ".best", ".first", ".second", ".count")
_TEXTS = ("layout", "settings", "progress", "known", "captures")


def _format(layout: MapLayout | None) -> TensorFormat:
    """The format for the maps of a layout; without one, for reading the texts."""
    shapes = {} if layout is None else layout.shapes()
    names = [name + part for name, shape in shapes.items() if 0 not in shape for part in _PARTS]
    return TensorFormat(
        name="holoview-calibration-checkpoint",
        version="1",
        what="a checkpoint that `holoview calibrate` wrote",
        tensors=("mismatch", *names),
        metadata_keys=_TEXTS,
    )


@dataclass(frozen=True)
class TrainingProgress:
    """How far a calibration has come: the epoch to do next, seconds spent, the best χ²/n on held-out captures."""

    epoch: int
    seconds: float
    best_chi2: float


@dataclass(frozen=True)
class CalibrationCheckpoint:
    """A calibration between two epochs. known: effects as JSON; captures: their digest."""

    layout: MapLayout
    settings: CalibrationSettings
    known_effects_json: str
    digest: str
    progress: TrainingProgress
    tensors: dict[str, NDArray[Any]]

    @staticmethod
    def create(
        captures: Captures,
        known: EffectValues,
        layout: MapLayout,
        settings: CalibrationSettings,
        progress: TrainingProgress,
        tensors: Mapping[str, NDArray[Any]],
    ) -> CalibrationCheckpoint:
        """A checkpoint of a session."""
        return CalibrationCheckpoint(
            layout, settings, _effects_json(known), captures_digest(captures), progress, dict(tensors)
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file, whole or not at all: the one before stays until then."""
        texts = {
            "layout": self.layout.to_json(),
            "settings": json.dumps(dataclasses.asdict(self.settings)),
            "progress": json.dumps(dataclasses.asdict(self.progress)),
            "known": self.known_effects_json,
            "captures": self.digest,
        }
        _format(self.layout).write(path, self.tensors, texts)

    def check_matches(
        self, captures: Captures, known: EffectValues, layout: MapLayout, settings: CalibrationSettings, where: str
    ) -> None:
        """UserError that names what differs, unless the checkpoint is of these captures, effects and settings."""
        differing = ["the captures"] * (self.digest != captures_digest(captures))
        differing += ["the known effects"] * (self.known_effects_json != _effects_json(known))
        differing += ["the maps"] * (self.layout != layout)
        ours, theirs = dataclasses.asdict(self.settings), dataclasses.asdict(settings)
        differing += [key for key, value in ours.items() if value != theirs[key]]
        if differing:
            raise UserError(
                where,
                f"is of another calibration: {', '.join(differing)} differ",
                expected="the same captures, preset and options as when it was begun",
            )


def load_checkpoint(path: str | os.PathLike[str]) -> CalibrationCheckpoint:
    """Reads a checkpoint. Raises UserError when it is missing, damaged, or no checkpoint."""
    _, texts = _format(None).read(path)
    layout = MapLayout.from_json(texts["layout"], f"{path}: layout")
    tensors, _ = _format(layout).read(path)
    try:
        settings, progress = (
            CalibrationSettings(**json.loads(texts["settings"])),
            TrainingProgress(**json.loads(texts["progress"])),
        )
    except UserError:
        raise
    except (ValueError, TypeError) as error:
        raise UserError(str(path), f"can't be read: {error}", expected=_format(None).what) from error
    return CalibrationCheckpoint(layout, settings, texts["known"], texts["captures"], progress, tensors)


def captures_digest(captures: Captures) -> str:
    """A fingerprint of a session."""
    found = hashlib.sha256(repr((captures.levels.shape, captures.images.shape)).encode())
    for name in ("levels", "images", "wavelength_m", "distance_m", "power", "exposure_s"):
        found.update(np.ascontiguousarray(getattr(captures, name)).tobytes())
    for value in (captures.slms, captures.camera, captures.gap_m, captures.iris1_na, captures.iris2_na):
        found.update(repr(value).encode())
    found.update(repr(captures.focal_length_m).encode())
    return found.hexdigest()


def _effects_json(known: EffectValues) -> str:
    return json.dumps({name: dict(values) for name, values in known.items()}, sort_keys=True)
