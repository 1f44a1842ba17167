"""Saves and restores a camera loop in a safetensors file. Pictures are expensive, so that it holds what they taught.

drive first second best_drive …  as in `optimise.checkpoint`: patterns, amplitudes, Adam's moments, the best so far
scale                            float64 (wavelength,), of `Registration`
shift                            float64 (plane, 2), m
correlation                      float64 (plane,)
exposures                        float64 (wavelength,), s; 0 where the next picture is searched for
metadata                         format, version, systems as begun and at present (TOML), settings and progress (JSON),
                                 digest of the target
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import tomllib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.experiment.camera_loop.registration import Registration
from holoview.io.hologram import drive_sizes
from holoview.model import preset
from holoview.model.system import System
from holoview.optimise.checkpoint import VARIABLE_TENSORS
from holoview.optimise.settings import Settings
from holoview.util.errors import UserError
from holoview.util.file_schema import ArraySchema
from holoview.util.safetensors_file import TensorFormat, differing_fields, refuse_differences
from holoview.util.tables import read_record

_F64 = ("float64",)
_FORMAT = TensorFormat(
    name="holoview-camera-loop",
    version="1",
    what="a checkpoint that `holoview optimise --rig` wrote",
    tensors=(
        *VARIABLE_TENSORS,
        ArraySchema("scale", _F64, ("wavelength",), low=0.0),
        ArraySchema("shift", _F64, ("plane", 2)),
        ArraySchema("correlation", _F64, ("plane",), low=-1.0, high=1.0),
        ArraySchema("exposures", _F64, ("wavelength",), low=0.0),
    ),
    metadata_keys=("system", "present", "settings", "progress", "target"),
)


@dataclass(frozen=True)
class LoopProgress:
    """How far a loop has come.

    iteration: the next one. pictures, bench_s: taken so far, and seconds of bench time. seconds: that passed.
    best_loss, best_psnr_db: of the smallest loss so far. step_factor: of the patterns' steps. without_gain: iterations
    since the loss fell last.
    """

    iteration: int
    pictures: int
    bench_s: float
    seconds: float
    best_loss: float
    best_psnr_db: float
    step_factor: float = 1.0
    without_gain: int = 0

    def __post_init__(self) -> None:
        if min(self.iteration, self.pictures) < 0 or not 0 <= self.bench_s < math.inf:
            found = f"iteration {self.iteration}, {self.pictures} pictures in {self.bench_s} s"
            raise UserError("progress", found, expected="numbers of 0 or more")


@dataclass(frozen=True)
class LoopCheckpoint:
    """A loop between two iterations.

    begun: the system that it began with. present: with the effects that have been found since. target: digest of the
    stack. tensors: of the variables and the best hologram. exposures_s: (wavelength,), 0 for none.
    """

    begun: System
    present: System
    settings: Settings
    target: str
    progress: LoopProgress
    registration: Registration
    exposures_s: NDArray[np.float64]
    tensors: dict[str, NDArray[np.floating]]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file; an existing one is replaced only by a complete one."""
        texts = {
            "system": preset.dumps(self.begun),
            "present": preset.dumps(self.present),
            "settings": json.dumps(dataclasses.asdict(self.settings)),
            "progress": json.dumps(dataclasses.asdict(self.progress)),
            "target": self.target,
        }
        own = {
            "scale": self.registration.scale,
            "shift": self.registration.shift_m,
            "correlation": self.registration.correlation,
            "exposures": self.exposures_s,
        }
        _FORMAT.write(path, self.tensors | own, texts)

    def check_matches(self, system: System, settings: Settings, target: str, where: str) -> None:
        """Raises UserError that names what differs, unless the checkpoint is of this system, settings and target."""
        stored, given = (tomllib.loads(preset.dumps(s)) for s in (self.begun, system))
        differing = [key for key in {**stored, **given} if stored.get(key) != given.get(key)]
        differing += differing_fields(self.settings, settings)
        differing += ["the target"] * (self.target != target)
        refuse_differences(differing, where, "camera loop", "preset, picture and options")


def load_loop_checkpoint(path: str | os.PathLike[str]) -> LoopCheckpoint:
    """Reads a checkpoint. Raises UserError when the file is missing, damaged, or something else."""
    with _FORMAT.open(path) as file:
        begun, present = (preset.loads(file.texts[key], f"{path}: {key}") for key in ("system", "present"))
        settings = read_record(Settings, file.texts["settings"], f"{path}: settings", _FORMAT.what)
        progress = read_record(LoopProgress, file.texts["progress"], f"{path}: progress", _FORMAT.what)
        tensors = file.tensors({**drive_sizes(begun), "plane": len(begun.planes_m)})
    registration = Registration(*(tensors.pop(name) for name in ("scale", "shift", "correlation")))
    exposures_s = tensors.pop("exposures")
    target = file.texts["target"]
    return LoopCheckpoint(begun, present, settings, target, progress, registration, exposures_s, tensors)
