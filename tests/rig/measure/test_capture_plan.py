"""Plans: which captures they mean, and that none asks for what the rig can't or mustn't do."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from holoview.bench.calibrate.exposure import ExposureLimits, plan_exposures
from holoview.bench.captures import read_captures, write_captures
from holoview.bench.captures.dataset import join_captures
from holoview.bench.rig import RigDescription
from holoview.bench.rig.capture_plan import CapturePlan, default_plan, read_plan
from holoview.bench.rig.measurement import Measurement
from holoview.commands.cli import main
from holoview.util.errors import UserError
from tests.rig.conftest import LASERS_M, MakeRig, direct_devices


def _read(rig: RigDescription, tmp_path: Path, text: str) -> CapturePlan:
    (tmp_path / "plan.toml").write_text(text, encoding="utf-8")
    return read_plan(tmp_path / "plan.toml", rig)


def test_by_default_eight_captures_of_every_laser_and_of_three_planes_within_the_limits(make_rig: MakeRig) -> None:
    rig = make_rig({"limits.stage": ["2 mm", "7 mm"], "limits.power": 0.8})
    requests = default_plan(rig).requests
    default_plan(rig).check(rig)
    conditions = Counter((r.wavelength_m, r.distance_m) for r in requests)
    assert set(conditions.values()) == {8} and len(conditions) == 6
    assert sorted({r.distance_m for r in requests}) == pytest.approx([2.5e-3, 4.5e-3, 6.5e-3])
    powers = np.array([r.power for r in requests])
    assert powers.min() >= 0.4 and powers.max() <= 0.8
    assert len(np.unique(powers)) > 32  # of 48 in steps of 0.001 three meet another by chance, and 16 never do
    assert [r.sigma_px for r in requests[:5]] == [6, 3, 1.5, 0, 6]


def test_a_fourier_bench_is_measured_in_focus(make_rig: MakeRig) -> None:
    changes = {"slm2": None, "geometry": {"focal_length": "100 mm"}, "stage.range": ["-2 mm", "2 mm"]}
    assert {r.distance_m for r in default_plan(make_rig(changes)).requests} == {0.0}


def test_planes_come_one_after_the_other_so_that_the_stage_moves_least(make_rig: MakeRig) -> None:
    distances = [r.distance_m for r in default_plan(make_rig()).requests]
    assert distances == sorted(distances)


def test_a_plan_says_what_is_taken(make_rig: MakeRig, tmp_path: Path) -> None:
    text = (
        'each = 2\nwavelengths = ["638 nm"]\ndistances = ["5 mm", "1 mm"]\npower = [0.3]\nexposure = 0.01\nblur = [2]\n'
    )
    requests = _read(make_rig(), tmp_path, text).requests
    assert [(r.wavelength_m, r.distance_m) for r in requests] == [(LASERS_M[1], z) for z in (5e-3, 5e-3, 1e-3, 1e-3)]
    assert {(r.power, r.exposure_s, r.sigma_px) for r in requests} == {(0.3, 0.01, 2.0)}


def test_patterns_follow_from_plan_and_seed_alone(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig({"slm2.num_levels": 16})
    first, again = (_read(rig, tmp_path, "each = 1\nseed = 5\n").requests for _ in range(2))
    other = _read(rig, tmp_path, "each = 1\nseed = 6\n").requests
    levels = [request.levels(rig) for request in first]
    assert first == again and all(np.array_equal(a, r.levels(rig)) for a, r in zip(levels, again, strict=True))
    assert not np.array_equal(levels[0], other[0].levels(rig)) and not np.array_equal(levels[0], levels[1])
    assert levels[0].shape == (2, *rig.slm_shape) and levels[0].dtype == np.uint8
    assert (levels[0][0].max(), levels[0][1].max()) == (255, 15)


@pytest.mark.parametrize(
    ("text", "where", "words"),
    [
        ("eech = 3", "eech", "did you mean each"),
        ("each = 0", "each", "a whole number from 1"),
        ('wavelengths = ["520 nm"]', "plan: wavelengths", "one of 450 nm, 638 nm"),
        ('distances = ["11 mm"]', "stage", "0 mm … 10 mm"),
        ("power = [0.5, 1.5]", "power", "0 … 1"),
        ("power = [0.0]", "plan: power", "greater than 0"),
        ("power = []", "plan.toml: power", "is empty"),
        ("blur = []", "plan.toml: blur", "is empty"),
        ("distances = []", "plan.toml: distances", "is empty"),
        ("wavelengths = []", "plan.toml: wavelengths", "is empty"),
        ("exposure = 2.0", "exposure", "1e-05 … 0.5"),
        ("exposure = 0", "exposure", "1e-05 … 0.5"),
        ("each = 3.5", "each", "a whole number"),
        ("each =", "plan.toml", "isn't TOML"),
    ],
)
def test_what_is_wrong_in_a_plan_is_named(make_rig: MakeRig, tmp_path: Path, text: str, where: str, words: str) -> None:
    with pytest.raises(UserError) as raised:
        _read(make_rig(), tmp_path, text)
    assert where in raised.value.where and words in str(raised.value)


def test_no_power_that_is_drawn_is_rounded_beyond_a_limit(make_rig: MakeRig, tmp_path: Path) -> None:
    """0.9996 would become 1.0 if powers were rounded before they are compared."""
    rig = make_rig({"limits.power": 0.99960})
    assert max(r.power for r in _read(rig, tmp_path, "power = [0.9996]\n").requests) <= 0.9996


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
