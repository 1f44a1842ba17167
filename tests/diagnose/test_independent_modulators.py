"""Faults of modulators and lasers in captures that another program computed: each is named, beside its look-alikes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from holoview.bench.captures import read_captures
from holoview.bench.captures.predictor import SamplingConfig
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.independent import Faults, Laboratory, write_session
from tests.diagnose.independent_modulators import CoverGlass, LightFaults, ModulatorFaults
from tests.explored import explored

SAME = SamplingConfig(padding=3)
"""The samples of the program where its pixels have two along a side and the camera one pixel for each."""
FAIL_AT = 3.0
"""Half-widths of the 95 % interval by which a value may miss the truth; as for hidden faults."""
ALIKE = {
    "second_line": ("bandwidth", "wavelength_offset", "distance", "camera_blur"),
    "lut_dispersion": ("lut", "dispersion", "stroke", "stroke_map", "undiffracted"),
    "stroke_map": ("stroke", "slm_flatness", "lut", "source_profile", "tilt"),
    "polarisation": ("undiffracted", "camera_black", "camera_gamma", "source_profile", "stroke"),
    "slm1_fringes": ("slm2_fringes", "camera_fringes", "source_profile", "vignetting"),
    "slm2_fringes": ("slm1_fringes", "camera_fringes", "source_profile", "vignetting"),
    "crosstalk": ("camera_blur", "stroke", "lut"),
}
"""Effects that change pictures in nearly the same way, by the effect that is to be named."""

CORNER_PX, COLUMNS = 20.0**2 + 16.0**2, 40.0
GLASS = CoverGlass(reflectance=(0.05, 0.04), period_px=25.0, towards_deg=30.0)
WEDGE = {"path_y": 64 / 25.0 * 0.5 * 550e-9, "path_x": 80 / 25.0 * 0.75**0.5 * 550e-9}  # of 64 × 80 pixels
MODERATE: dict[str, tuple[Faults, dict[str, float]]] = {
    "second_line": (
        Faults(light=LightFaults(second_mode=(0.25, 4e-9))),
        {"share": 0.2, "offset": 4e-9},
    ),
    "lut_dispersion": (
        Faults(modulators=ModulatorFaults(exponents=((1.1, 0.9), (1.0, 1.0)))),
        {"slope1": 0.1, "slope2": 0.0},
    ),
    "stroke_map": (
        Faults(modulators=ModulatorFaults(wedge=(0.06, 0.0), bow=(0.0, 0.04))),
        {"z2_1": 0.06 * CORNER_PX**0.5 / (2 * COLUMNS), "z1_2": 0.04 / 2, "z4_2": 0.04 / (2 * 3**0.5)},
    ),
    "polarisation": (Faults(light=LightFaults(turned_deg=12.0)), {"share": 0.0432273}),
    "crosstalk": (Faults(crosstalk_px=0.8), {"sigma": 0.0, "coupling": math.exp(-1 / (2 * 0.8**2))}),
    "slm1_fringes": (Faults(modulators=ModulatorFaults(glass=(GLASS, None))), WEDGE),
    "slm2_fringes": (Faults(modulators=ModulatorFaults(glass=(None, GLASS))), WEDGE),
}
OTHER: list[tuple[str, Faults]] = [
    ("second_line", Faults(light=LightFaults(second_mode=(0.2, -5e-9)))),
    ("second_line", Faults(light=LightFaults(second_mode=(0.8, -8e-9)))),
    ("lut_dispersion", Faults(modulators=ModulatorFaults(exponents=((1.01, 0.99), (1.01, 0.99))))),
    ("lut_dispersion", Faults(modulators=ModulatorFaults(exponents=((1.45, 0.65), (1.0, 1.0))))),
    ("stroke_map", Faults(modulators=ModulatorFaults(wedge=(0.01, 0.0)))),
    ("stroke_map", Faults(modulators=ModulatorFaults(wedge=(0.3, 0.0)))),
    ("polarisation", Faults(light=LightFaults(turned_deg=3.0))),
    ("polarisation", Faults(light=LightFaults(turned_deg=35.0))),
]


def _diagnosed(path: Path, faults: Faults, among: tuple[str, ...] | None = None) -> Diagnosis:
    shape = (64, 80) if any(faults.modulators.glass) else (32, 40)  # a few fringes have to fit into a picture
    file = write_session(path / "c.h5", Laboratory(shape=shape, faults=faults, seed=1, each=4, fine=2))
    effects = None if among is None else [listed_effects()[name] for name in among]
    return diagnose(read_captures(file), effects, workers=1, free_maps=False, sampling=SAME)


SLOW = ("slm1_fringes", "slm2_fringes")
NAMES = [
    *explored([name for name in MODERATE if name not in SLOW], 1),
    *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW),
]


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_a_moderate_fault_is_named_and_measured_beside_its_look_alikes(tmp_path: Path, name: str) -> None:
    faults, values = MODERATE[name]
    found = _diagnosed(tmp_path, faults, (name, *ALIKE[name]))
    assert found.verdict is Verdict.EXPLAINED and [cause.effect for cause in found.causes] == [name]
    assert all(np.isfinite(interval.half_width) for interval in found.causes[0].intervals.values())
    for key, true in values.items():
        interval = found.causes[0].intervals[key]
        assert abs(interval.value - true) <= FAIL_AT * interval.half_width, (key, true, interval)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "faults"), [*((n, f) for n, (f, _) in MODERATE.items()), *OTHER])
def test_of_the_whole_library_it_is_named(tmp_path: Path, name: str, faults: Faults) -> None:
    """From barely visible to gross faults."""
    found = _diagnosed(tmp_path, faults)
    assert found.verdict is Verdict.EXPLAINED and [cause.effect for cause in found.causes] == [name]
