"""An optimisation between two iterations: what the loop yields, and a file to continue from.

The file is one of safetensors; an optimisation continues from it bit for bit on the same machine.

drive first second               float32 (frame, modulator, y, x): patterns and Adam's two moments
best_drive                       float32: the best hologram so far
amplitudes best_amplitudes       float64 (frame, wavelength)
wavelengths best_wavelengths     float64 (wavelength,), m
amplitude_moments                float64 (2, frame, wavelength), of Adam
wavelength_moments               float64 (2, wavelength)
steps                            float64 (3,): Adam's number of steps of patterns, amplitudes and wavelengths
drive/NAME first/NAME …          of a chain in place of these, for each element: float32 (frame, y, x), of a complex one
                                 (frame, y, x, part); with amplitudes and best_amplitudes; steps: float64 (1,). With
                                 free wavelengths also the three of wavelengths, and wavelength_steps: float64 (1,)
metadata                         format, version, system (TOML), settings and progress (JSON), digest of the target
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.hologram import (
    Hologram,
    chain_schema,
    drive_schema,
    drive_sizes,
    system_with_elements,
)
from holoview.holograms.optimise.settings import Settings
from holoview.light.model import preset
from holoview.light.model.drives import complex_names
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.safetensors_file import TensorFormat, differing_fields, refuse_differences
from holoview.util.tables import ArraySchema, read_record

if TYPE_CHECKING:  # its module imports torch, for which the viewer doesn't wait
    from holoview.holograms.optimise.field_loss import ComplexTarget


@dataclass(frozen=True)
class IterationState:
    """The state of an optimisation after an iteration.

    iteration, iterations: number of this iteration, from 0, and of the last one. loss: with the eyebox's penalty.
    psnr_db: of linear sRGB clipped to 0…1, mean over planes (of luminance where only that is optimised). Loss and PSNR
    are those of the planes that this iteration took (`Settings.drawn_planes`).
    best_psnr_db: that of `best`.
    eyebox: coefficient of variation of the light in the eyebox, measured at most `amplitudes_every` iterations ago.
    light: of a chain of elements, the share of the lasers' light that is in the picture, mean over planes; else NaN.
    seconds: time spent, including that before a checkpoint. make_best(): `best`, which is made when it is asked for.
    picture(): the present image at the middle plane, linear sRGB (y, x, 3). checkpoint(): everything that is needed to
    continue. These two must be called before the next state is requested.
    """

    iteration: int
    iterations: int
    loss: float
    psnr_db: float
    best_psnr_db: float
    eyebox: float
    seconds: float
    make_best: Callable[[], Hologram] = field(repr=False, compare=False)
    picture: Callable[[], NDArray[np.floating]] = field(repr=False, compare=False)
    checkpoint: Callable[[], Checkpoint] = field(repr=False, compare=False)
    light: float = math.nan

    @cached_property
    def best(self) -> Hologram:
        """The hologram of the smallest loss of all planes so far; the latest where pupils are drawn."""
        return self.make_best()


# --- the file ---


_F64 = ("float64",)
_WAVELENGTHS_M = (100e-9, 10e-6)  # least and greatest
VARIABLE_TENSORS = (
    drive_schema("drive", "float32"),
    drive_schema("drive", "float32").alike("first"),
    drive_schema("drive", "float32").alike("second", low=0.0),
    drive_schema("best_drive", "float32"),
    *(ArraySchema(name, _F64, ("frame", "wavelength"), low=0.0) for name in ("amplitudes", "best_amplitudes")),
    *(ArraySchema(name, _F64, ("wavelength",), *_WAVELENGTHS_M) for name in ("wavelengths", "best_wavelengths")),
    ArraySchema("amplitude_moments", _F64, (2, "frame", "wavelength")),
    ArraySchema("wavelength_moments", _F64, (2, "wavelength")),
    ArraySchema("steps", _F64, (3,), low=0.0, high=1e9),
)
"""The tensors of the variables of an optimisation and of its best hologram."""

_FORMAT = TensorFormat(
    name="holoview-checkpoint",
    version="1",
    what="a checkpoint that `holoview optimise` wrote",
    tensors=VARIABLE_TENSORS,
    metadata_keys=("system", "settings", "progress", "target"),
)


CHAIN_TENSORS = ("drive", "first", "second", "best_drive")
"""Of each element of a chain, by what stands before its name."""


def variable_tensors(system: System | None, free: Sequence[str] = ()) -> tuple[ArraySchema, ...]:
    """`VARIABLE_TENSORS`, of a chain with those of each element in their place. free: as of `Settings`."""
    if system is None or not system.is_chain:
        return VARIABLE_TENSORS
    own = (
        replace(chain_schema(system, name, f"{what}/{name}", "float32"), low=0.0 if what == "second" else -math.inf)
        for name in system.drive_shapes
        for what in CHAIN_TENSORS
    )
    names, steps = {"amplitudes", "best_amplitudes"}, ["steps"]
    if "wavelengths" in free:
        names |= {"wavelengths", "best_wavelengths", "wavelength_moments"}
        steps.append("wavelength_steps")
    lasers = (schema for schema in VARIABLE_TENSORS if schema.name in names)
    counts = (ArraySchema(name, _F64, (1,), low=0.0, high=1e9) for name in steps)
    return (*own, *lasers, *counts)


def _format_for(system: System | None, free: Sequence[str]) -> TensorFormat:
    return replace(_FORMAT, tensors=variable_tensors(system, free))


def best_of(system: System, tensors: Mapping[str, NDArray[np.floating]]) -> Hologram:
    """The best hologram of these tensors."""
    lasers = {key: tensors[f"best_{key}"] for key in ("wavelengths", "amplitudes") if f"best_{key}" in tensors}
    system = system.edit(lasers)
    if not system.is_chain:
        return Hologram(tensors["best_drive"].astype(np.float32), system)
    complexes = complex_names(system)
    stored = {name: tensors[f"best_drive/{name}"] for name in system.drive_shapes}
    return Hologram({n: a[..., 0] + 1j * a[..., 1] if n in complexes else a for n, a in stored.items()}, system)


@dataclass(frozen=True)
class CheckpointProgress:
    """How far an optimisation has come.

    iteration: the next one. seconds: time spent. best_loss, best_psnr_db: of the smallest loss so far. eyebox: the
    latest coefficient of variation of the light in the eyebox. by_torch: how many of the iterations were planned to be
    computed by torch, while the compiled kernels were being made.
    """

    iteration: int
    seconds: float
    best_loss: float
    best_psnr_db: float
    eyebox: float
    by_torch: int = 0

    def __post_init__(self) -> None:
        if self.iteration < 0 or self.by_torch < 0 or not 0 <= self.seconds < math.inf:
            found = f"iteration {self.iteration} after {self.seconds} s"
            raise UserError("progress", found, expected="numbers of 0 or more")


@dataclass(frozen=True)
class Checkpoint:
    """An optimisation between two iterations. target: `target_digest` of its focal stack."""

    system: System
    settings: Settings
    target: str
    progress: CheckpointProgress
    tensors: dict[str, NDArray[np.floating]]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file; only a complete file replaces an existing one."""
        texts = {
            "system": preset.dumps(self.system),
            "settings": json.dumps(dataclasses.asdict(self.settings)),
            "progress": json.dumps(dataclasses.asdict(self.progress)),
            "target": self.target,
        }
        _format_for(self.system, self.settings.free).write(path, self.tensors, texts)

    def best(self) -> Hologram:
        """The best hologram so far."""
        return best_of(self.system, self.tensors)

    def check_matches(self, system: System, settings: Settings, target: str, where: str) -> None:
        """Raises UserError that names the difference, unless the checkpoint is of this system, settings and target.

        where: the name of the checkpoint, for the error.
        """
        refuse_other_run((self.system, self.settings, self.target), (system, settings, target), where, "optimisation")


Run = tuple[System, Settings, str]
"""The bench, the settings and the `target_digest` of an optimisation."""


def refuse_other_run(stored: Run, given: Run, where: str, what: str) -> None:
    """Raises UserError that names what differs between a checkpoint's run and another. what: kind of the run."""
    benches = [tomllib.loads(preset.dumps(run[0])) for run in (stored, given)]
    differing = [key for key in {**benches[0], **benches[1]} if benches[0].get(key) != benches[1].get(key)]
    differing += differing_fields(stored[1], given[1])
    differing += ["the target"] * (stored[2] != given[2])
    refuse_differences(differing, where, what, "preset, picture and options")


def load_checkpoint(path: str | os.PathLike[str]) -> Checkpoint:
    """Reads a checkpoint. Raises UserError when the file is missing, damaged, or something else."""
    told = system_with_elements(path)
    with _format_for(told, ()).open(path) as file:
        settings = read_record(Settings, file.texts["settings"], f"{path}: settings", _FORMAT.what)
    with _format_for(told, settings.free).open(path) as file:
        system = told or preset.loads(file.texts["system"], f"{path}: system")
        progress = read_record(CheckpointProgress, file.texts["progress"], f"{path}: progress", _FORMAT.what)
        return Checkpoint(system, settings, file.texts["target"], progress, file.tensors(drive_sizes(system)))


def target_digest(stack: NDArray[np.floating], complex_target: ComplexTarget | None = None) -> str:
    """The SHA-256 of a focal stack's shape and float32 values, and of the fields of a complex target."""
    values = np.ascontiguousarray(stack, dtype=np.float32)
    fields = b"" if complex_target is None else np.ascontiguousarray(complex_target.fields).tobytes()
    return hashlib.sha256(repr(values.shape).encode() + values.tobytes() + fields).hexdigest()
