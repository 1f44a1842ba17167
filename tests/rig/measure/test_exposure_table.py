"""The table of `holoview captures plan`, read by a rig that has these lasers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from holoview.calibrate.exposure import ExposureLimits, plan_exposures
from holoview.captures import read_captures, write_captures
from holoview.captures.dataset import join_captures
from holoview.cli import main
from holoview.rig import RigDescription
from holoview.rig.measure.capture_plan import default_plan, read_plan
from holoview.rig.measure.measurement import Measurement
from holoview.util.errors import UserError
from tests.rig.conftest import LASERS_M, direct_devices

MakeRig = Callable[..., RigDescription]
LIMITS = ExposureLimits((0.1, 1.0), (1e-4, 0.4))
HEAD = "wavelength_nm,power,exposure_s,reached_counts,note\n"


def _write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "plan.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_each_laser_has_its_power_and_exposure_in_the_default_captures(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig()
    path = _write(tmp_path, f"{HEAD}638,0.25,0.004,3000.0,\n450,1.0,0.0123,3600.0,dim\n")
    plan, default = read_plan(path, rig), default_plan(rig)
    settings = {LASERS_M[0]: (1.0, 0.0123), LASERS_M[1]: (0.25, 0.004)}
    assert len(plan.requests) == len(default.requests)
    for own, other in zip(plan.requests, default.requests, strict=True):
        assert (own.power, own.exposure_s) == settings[own.wavelength_m]
        assert (own.wavelength_m, own.distance_m, own.seed) == (other.wavelength_m, other.distance_m, other.seed)


def test_the_table_of_captures_plan_is_read(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig()
    with direct_devices(rig) as devices:
        session = Measurement(rig, devices)
        first = [session.take(request, request.levels(rig)) for request in default_plan(rig).requests[::9][:3]]
    write_captures(tmp_path / "first.h5", join_captures(first))
    table = tmp_path / "plan.csv"
    limits = ("--power", "0.1", "1", "--exposure", "1e-4", "0.4")
    assert main(["captures", "plan", str(tmp_path / "first.h5"), "-o", str(table), *limits]) == 0
    expected = {own.wavelength_m: own for own in plan_exposures(read_captures(tmp_path / "first.h5"), None, LIMITS)}
    assert set(expected) == set(LASERS_M)
    for request in read_plan(table, rig).requests:
        own = expected[request.wavelength_m]
        assert (request.power, request.exposure_s) == (own.power, own.exposure_s)


def test_lasers_that_the_table_leaves_out_are_left_out(make_rig: MakeRig, tmp_path: Path) -> None:
    plan = read_plan(_write(tmp_path, f"{HEAD}450.01,1.0,0.0123,3600.0,\n"), make_rig())
    assert {request.wavelength_m for request in plan.requests} == {LASERS_M[0]}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", r"plan\.csv: is empty"),
        (HEAD, "is empty"),
        ("wavelength_nm,power\n450,1\n", "line 2: exposure_s: is missing"),
        (f"{HEAD}450,strong,0.01,,\n", 'line 2: power: "strong"; expected a number'),
        (f"{HEAD}450,nan,0.01,,\n", "line 2: power: nan"),
        (f"{HEAD}520,1,0.01,,\n", "line 2: wavelength_nm: 520; expected one of 450 nm, 638 nm"),
        (f"{HEAD}450,1,0.01,,\n450,1,0.02,,\n", "line 3: wavelength_nm: 450 again"),
        (f"{HEAD}450,1.5,0.01,,\n", "power: 1.5; expected 0 … 1"),
        (f"{HEAD}450,1,0.9,,\n", "exposure: 0.9 s"),
        (f"{HEAD}450,0,0.1,,\n", "plan: power: 0"),
    ],
)
def test_what_is_wrong_in_a_table_is_named(make_rig: MakeRig, tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(UserError, match=words):
        read_plan(_write(tmp_path, text), make_rig())
