"""Faults of camera, stage, room and in time, in an independent program's own numbers, are named and measured.

Every case has its look-alikes among the candidates. `benchmarks/diagnosis.py` measures them among all effects.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import pytest

from holoview.bench.captures import read_captures
from holoview.bench.captures.predictor import SamplingConfig
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.report.diagnosis import Cause
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.independent import Faults, Laboratory, write_session
from tests.diagnose.independent_camera import CameraFaults, Fringes, Motion, Rail, Room, Shading
from tests.explored import explored

SAME = SamplingConfig(padding=3)
"""The samples of the program where its pixels have two along a side and the camera one pixel for each."""
FAIL_AT = 3.0
"""Half-widths of the 95 % interval by which a value may miss the truth; as for hidden faults."""
COUNTS = 2**12 - 1 - 64
"""That fill the well of the program's camera."""
ALIKE = ["camera_alignment", "camera_black", "camera_blur", "distance", "ghost", "vignetting"]
MINE = ["ambient", "camera_fringes", "crosstalk", "motion_blur", "settling", "stage", "stroke"]
SIDE = 64, 80
"""Rows and columns of its camera."""


@dataclass(frozen=True)
class Case:
    """A fault, the effect that it is, and the values that follow from it."""

    faults: Faults
    effect: str
    values: dict[str, float]
    planes_m: tuple[float, ...] = ()


def _fringes(period_px: float, towards_rad: float) -> dict[str, float]:
    """The wedge whose fringes have this period at 550 nm: so many waves more at the other edge."""
    waves = {"path_y": SIDE[0] * math.sin(towards_rad), "path_x": SIDE[1] * math.cos(towards_rad)}
    return {name: 550e-9 * pixels / period_px for name, pixels in waves.items()}


def _room(room: Room) -> dict[str, float]:
    """From corner to corner the lamp's light grows by rows·sin + columns·cos steps between pixels' centres."""
    sine, cosine = math.sin(room.towards_rad), math.cos(room.towards_rad)
    step = COUNTS * (room.most - room.least) / ((SIDE[0] - 1) * sine + (SIDE[1] - 1) * cosine)
    middle = COUNTS * (room.least + room.most) / 2
    return {"level": middle, "slope_y": step * sine * SIDE[0] / 2, "slope_x": step * cosine * SIDE[1] / 2}


def _shading(shading: Shading) -> dict[str, float]:
    """cos⁴ = (1 + r²/f²)⁻², r from the axis; about the middle, up to a factor, q = 2·(r² − 2r·axis)/(f² + axis²)."""
    scale = 2 / (shading.focal_px**2 + math.hypot(*shading.axis_px) ** 2)
    halves = [side / 2 for side in SIDE]
    falls = {f"fall_{axis}": scale * half**2 for axis, half in zip("yx", halves, strict=True)}
    slopes = {f"slope_{a}": 2 * scale * at * h for a, at, h in zip("yx", shading.axis_px, halves, strict=True)}
    return falls | slopes | {"bend": 1.5}


SHADING = Shading(110.0, (-18.0, 25.0))
ROOM = Room(0.02, 0.06, 0.6)
CASES = [
    Case(
        Faults(camera=CameraFaults(fringes=Fringes(7.0, 0.6, (0.04, 0.06)))),
        "camera_fringes",
        _fringes(7.0, 0.6),
    ),
    Case(
        Faults(camera=CameraFaults(motion=Motion(2.0, 0.7))),
        "motion_blur",
        {"length_y": 2 * math.sin(0.7), "length_x": 2 * math.cos(0.7)},
    ),
    Case(Faults(camera=CameraFaults(room=ROOM)), "ambient", _room(ROOM)),
    Case(Faults(camera=CameraFaults(shading=SHADING)), "vignetting", _shading(SHADING)),
    Case(
        Faults(camera=CameraFaults(fringes=Fringes(9.0, 2.1, (0.05, 0.05), is_moire=True))),
        "camera_fringes",
        {**_fringes(9.0, 2.1), "achromatic": 1.0},
    ),
    Case(Faults(camera=CameraFaults(blur_px=0.6)), "camera_blur", {"sigma": 0.6}),
    Case(Faults(black=20.0), "camera_black", {"black": 20.0}),
    Case(
        Faults(camera=CameraFaults(rail=Rail(1.02, (0.4, -0.25), 0.002))),
        "stage",
        {"scale": 0.02, "walk_y": 0.4 * 4e-3, "walk_x": -0.25 * 4e-3, "growth": 2.0},
        (4e-3, 6e-3),
    ),
    Case(Faults(frames_to_settle=0.5), "settling", {"share1": math.exp(-2), "share2": math.exp(-2)}),
    Case(Faults(distance_m=1.5e-4), "distance", {"distance_error": 1.5e-4}, (4e-3, 6e-3)),
]
CLEAN = Case(Faults(), "", {}, (4e-3, 6e-3))


def _causes(folder: Path, case: Case) -> tuple[Verdict, tuple[Cause, ...]]:
    laboratory = Laboratory(faults=case.faults, seed=0, each=6, fine=2, planes_m=case.planes_m)
    captures = read_captures(write_session(folder / "c.h5", laboratory))
    effects = [listed_effects()[name] for name in (*ALIKE, *MINE)]
    found = diagnose(captures, effects, workers=1, free_maps=False, sampling=SAME)
    return found.verdict, found.causes


@pytest.mark.parametrize("case", explored(CASES, 1), ids=lambda case: case.effect)
def test_a_fault_of_the_camera_is_named_and_measured(tmp_path: Path, case: Case) -> None:
    verdict, causes = _causes(tmp_path, case)
    assert verdict is Verdict.EXPLAINED and [cause.effect for cause in causes] == [case.effect]
    for key, true in case.values.items():
        interval = causes[0].intervals[key]
        assert abs(interval.value - true) <= FAIL_AT * interval.half_width, (key, true, interval)


@pytest.mark.long
def test_a_camera_without_faults_is_consistent(tmp_path: Path) -> None:
    assert _causes(tmp_path, CLEAN) == (Verdict.CONSISTENT, ())
