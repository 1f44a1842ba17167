"""Saves and restores the full state of a calibration between two epochs, in one safetensors file.

A calibration that is resumed on the same machine gives the same numbers, bit for bit, as one that was never stopped.
The file holds, for each tensor NAME of `holoview.model.effects.learned_maps.TENSORS` that isn't empty:

NAME                      its present value
NAME.best                 its value in the epoch with the lowest χ² on the validation captures
NAME.first NAME.second    Adam's first and second moments
NAME.count                Adam's number of steps, int64 (1,)

and besides:

mismatch                  float64 (capture,): each capture's model error when it was last trained on, see `train`
metadata                  format, version; layout, settings, progress and known effects as JSON; digest of the captures
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.calibrate.settings import CalibrationSettings
from holoview.captures.dataset import Captures
from holoview.captures.nominal_bench import stated_keys
from holoview.model.effects.active_effects import EffectValues
from holoview.model.effects.learned_maps import MAP_SCHEMAS, MapLayout, map_sizes, read_layout
from holoview.util.errors import UserError
from holoview.util.file_schema import ArraySchema
from holoview.util.safetensors_file import TensorFormat, differing_fields, refuse_differences
from holoview.util.tables import read_record

_TEXTS = ("layout", "settings", "progress", "known", "captures")


def _format(layout: MapLayout | None) -> TensorFormat:
    """The file format for the maps of a layout; with None, for reading the metadata only."""
    shapes = {} if layout is None else layout.shapes()
    schemas = [part for map_ in MAP_SCHEMAS if 0 not in shapes.get(map_.name, (0,)) for part in _part_schemas(map_)]
    return TensorFormat(
        name="holoview-calibration-checkpoint",
        version="1",
        what="a checkpoint that `holoview calibrate` wrote",
        tensors=(ArraySchema("mismatch", ("float64",), ("capture",), low=0.0, may_be_infinite=True), *schemas),
        metadata_keys=_TEXTS,
    )


def _part_schemas(learned: ArraySchema) -> tuple[ArraySchema, ...]:
    """What the file holds for a tensor: its value and the best one, Adam's moments and number of steps."""
    name = learned.name
    return (
        learned,
        learned.alike(f"{name}.best", learned.low, learned.high),
        learned.alike(f"{name}.first"),
        learned.alike(f"{name}.second", low=0.0),
        ArraySchema(f"{name}.count", ("int64",), (1,), low=0.0, high=1e9),
    )


@dataclass(frozen=True)
class TrainingProgress:
    """How far a calibration has come. The field names are keys of the checkpoint's JSON.

    epoch: the next one to train.
    seconds: time spent so far.
    best_chi2: lowest χ² per pixel on the validation captures.
    """

    epoch: int
    seconds: float
    best_chi2: float

    def __post_init__(self) -> None:
        if self.epoch < 0 or not 0 <= self.seconds < math.inf or math.isnan(self.best_chi2):
            found = f"epoch {self.epoch} after {self.seconds} s, χ² {self.best_chi2}"
            raise UserError("progress", found, expected="numbers of 0 or more")


@dataclass(frozen=True)
class CalibrationCheckpoint:
    """The state of a calibration between two epochs.

    known_effects_json: effects that the bench has besides the learned maps.
    digest: `captures_digest` of the captures.
    tensors: {name: array}, as listed at the head of this module.
    """

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
        """A checkpoint of the calibration of these captures, on a bench with these known effects."""
        return CalibrationCheckpoint(
            layout, settings, _effects_json(known), captures_digest(captures), progress, dict(tensors)
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file atomically: an existing file is replaced only by a complete one. Raises UserError."""
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
        """Raises UserError, naming what differs, unless captures, effects, layout and settings are the checkpoint's."""
        differing = ["the captures"] * (self.digest != captures_digest(captures))
        differing += ["the known effects"] * (self.known_effects_json != _effects_json(known))
        differing += ["the maps"] * (self.layout != layout)
        differing += differing_fields(self.settings, settings)
        refuse_differences(differing, where, "calibration", "captures, preset and options")


def load_checkpoint(path: str | os.PathLike[str]) -> CalibrationCheckpoint:
    """Reads a checkpoint. Raises UserError when the file is missing, damaged, or of another format."""
    with _format(None).open(path) as file:
        texts, what = file.texts, file.format.what
    layout = read_layout(texts["layout"], f"{path}: layout")
    settings = read_record(CalibrationSettings, texts["settings"], f"{path}: settings", what)
    progress = read_record(TrainingProgress, texts["progress"], f"{path}: progress", what)
    with _format(layout).open(path) as file:
        tensors = file.tensors(map_sizes(layout))
    return CalibrationCheckpoint(layout, settings, texts["known"], texts["captures"], progress, tensors)


def captures_digest(captures: Captures) -> str:
    """SHA-256 (hexadecimal) of the captures' patterns, images, conditions and geometry."""
    digest = hashlib.sha256(repr((captures.levels.shape, captures.images.shape)).encode())
    for name in ("levels", "images", "wavelength_m", "distance_m", "power", "exposure_s"):
        digest.update(np.ascontiguousarray(getattr(captures, name)).tobytes())
    bench = {
        "slms": [dataclasses.asdict(slm) for slm in captures.slms],
        "camera": dataclasses.asdict(captures.camera),
        "gap": captures.gap_m,
        "focal_length": captures.focal_length_m,
        "relays": [stated_keys(relay) for relay in (captures.relay1, captures.relay2)],
    }
    digest.update(json.dumps(bench, sort_keys=True).encode())
    return digest.hexdigest()


def _effects_json(known: EffectValues) -> str:
    return json.dumps({name: dict(values) for name, values in known.items()}, sort_keys=True)
