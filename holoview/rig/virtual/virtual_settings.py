"""What is really there on a virtual bench, which its user needn't know.

rig.toml names a file of secrets, or holds them itself:

    [virtual]
    bench = "hidden.toml"

    # hidden.toml
    seed = 3
    settle = 0.02                 # s, time constant of the modulators
    prnu = 0.01                   # and exposure_jitter, camera_jitter, wavelength_jitter: standard deviations
    trigger_jitter = 0.001        # s: exposures begin late by the absolute value of a normal number
    camera_drift = "0.5 um"       # and power_drift: random walks, standard deviations after an hour
    laser_log = "lasers.txt"      # a line for each switching of a laser, for tests; a file of this folder
    [effects.gap]
    gap_error = "0.1 mm"
    [faults]                      # what devices do wrong, see `faults`
    timeout = 0.01
    [placement]                   # how modulators and camera are turned: one of `captures.orientations`
    slm1 = "rotate_180"           # what modulator 1 displays arrives on the bench turned so
    camera = "flip_x"             # the picture on the bench is recorded turned so

Where they are beside that is an effect: `camera_alignment`, `slm_alignment`, `distance`, `stage`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from holoview.captures.orientations import ORIENTATIONS, oriented_shape
from holoview.captures.virtual_measurement import Nuisances
from holoview.model.effects.registry import EffectTable
from holoview.model.fields import FieldType, Number
from holoview.rig.description import RigDescription
from holoview.rig.virtual.drift import DriftSettings
from holoview.rig.virtual.faults import FaultSettings, FaultTable
from holoview.util.errors import UserError, suggest_matches
from holoview.util.files import read_text
from holoview.util.tables import parse_toml

_EXPECTED = "what a virtual bench really is, in TOML"
_TURNED = ("slm1", "slm2", "camera")
_SHARE = Number(low=0.0, high=1.0)
_LASER_LOG = re.compile(r"lasers[A-Za-z0-9_-]{0,40}\.txt")


class PlacementTable:
    """Field type of hidden orientations: a table {device: turn}."""

    def parse(self, value: Any, where: str) -> dict[str, str]:
        if not isinstance(value, Mapping):
            raise UserError(where, f"{value!r}", expected='a table such as [placement] camera = "flip_x"')
        for key, turn in value.items():
            if key not in _TURNED:
                raise UserError(f"{where}.{key}", "unknown device", remedy=suggest_matches(key, _TURNED))
            if turn not in ORIENTATIONS:
                raise UserError(f"{where}.{key}", f"{turn!r}", remedy=suggest_matches(str(turn), ORIENTATIONS))
        return {key: str(turn) for key, turn in value.items()}

    def to_toml(self, value: dict[str, str]) -> dict[str, str]:
        return value


class LaserLogName:
    """Field type of the log of the lasers, which is written: a stranger's bench mustn't choose another file."""

    def parse(self, value: Any, where: str) -> str:
        if not (isinstance(value, str) and _LASER_LOG.fullmatch(value)):
            raise UserError(where, f"{value!r}", expected='"lasers.txt", or letters and digits between these words')
        return value

    def to_toml(self, value: str) -> str:
        return value


_KEYS: dict[str, FieldType] = {
    "seed": Number(low=0, high=2**31),
    "settle": Number(low=0.0, high=100.0),
    "finer": Number(low=1, high=8),
    "readout": Number(low=0.0, high=100.0),
    "exposure_jitter": _SHARE,
    "prnu": _SHARE,
    "camera_jitter": Number("um", low=0.0, high=1e-3),
    "wavelength_jitter": Number("nm", low=0.0, high=1e-7),
    "trigger_jitter": Number(low=0.0, high=100.0),
    "camera_drift": Number("um", low=0.0, high=1e-3),
    "power_drift": _SHARE,
    "laser_log": LaserLogName(),
    "faults": FaultTable(),
    "effects": EffectTable(),
    "placement": PlacementTable(),
}


@dataclass(frozen=True)
class VirtualSettings:
    """effects: {id: {parameter: value}}. settle_s: time constant of the modulators. readout_s: of a picture.

    finer: factor by which light is computed finer than a model of the captures would. seed: of all that is random.
    slm_turns: how what each modulator displays arrives on the bench. camera_turn: how its picture is recorded.
    """

    effects: Mapping[str, Mapping[str, Any]]
    nuisances: Nuisances
    seed: int = 0
    settle_s: float = 0.0
    readout_s: float = 0.02
    finer: int = 1
    trigger_jitter_s: float = 0.0
    drift: DriftSettings = field(default_factory=DriftSettings)
    faults: FaultSettings = field(default_factory=FaultSettings)
    laser_log: Path | None = None
    slm_turns: tuple[str, ...] = ("none", "none")
    camera_turn: str = "none"


def read_virtual_settings(rig: RigDescription) -> VirtualSettings:
    """The settings of a rig's virtual bench. Raises UserError that names the key of what is unknown or wrong."""
    table, where = dict(rig.virtual), f"{rig.path}: virtual"
    if "bench" in table:
        if len(table) > 1 or not isinstance(table["bench"], str):
            raise UserError(f"{where}.bench", "isn't the only key, or no text", expected="the name of a file alone")
        file = rig.path.parent / table["bench"]
        table, where = parse_toml(read_text(file, _EXPECTED), str(file), _EXPECTED), str(file)
    for key in table:
        if key not in _KEYS:
            raise UserError(f"{where}.{key}", "unknown key", remedy=suggest_matches(key, _KEYS))
    values = {key: _KEYS[key].parse(value, f"{where}.{key}") for key, value in table.items()}
    turns = values.get("placement", {})
    slm_turns = tuple(turns.get(f"slm{n}", "none") for n in range(1, len(rig.bench.slms) + 1))
    if len({oriented_shape(rig.slm_shape, turn) for turn in slm_turns}) > 1:
        expected = "turns that leave both modulators the same shape"
        raise UserError(f"{where}.placement", f"{slm_turns[0]} and {slm_turns[1]}", expected=expected)
    return VirtualSettings(
        effects={name: dict(pairs) for name, pairs in values.get("effects", ())},
        nuisances=Nuisances(
            values.get("exposure_jitter", 0.0),
            values.get("prnu", 0.0),
            values.get("camera_jitter", 0.0),
            values.get("wavelength_jitter", 0.0),
        ),
        seed=int(values.get("seed", 0)),
        settle_s=values.get("settle", 0.0),
        readout_s=values.get("readout", 0.02),
        finer=int(values.get("finer", 1)),
        trigger_jitter_s=values.get("trigger_jitter", 0.0),
        drift=DriftSettings(values.get("camera_drift", 0.0), values.get("power_drift", 0.0)),
        faults=values.get("faults", FaultSettings()),
        laser_log=rig.path.parent / values["laser_log"] if "laser_log" in values else None,
        slm_turns=slm_turns,
        camera_turn=turns.get("camera", "none"),
    )
