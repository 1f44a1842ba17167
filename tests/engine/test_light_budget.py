"""Where the light went: sums of 1, and cases whose shares are known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.holograms.view import random_drive, simulate
from holoview.light.engine.light_budget import PLACES, LightBudget, light_budget, told_light
from holoview.light.model import preset
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System

ROUNDING = 2e-6  # of powers of some 10⁴ samples in f32, each wrong by 2⁻²⁴, over transforms of 14 steps


def _share(budget: LightBudget, place: str) -> float:
    return float(budget.total[list(PLACES).index(place)])


def _bench(name: str = "holochrome-8", **changes: Any) -> System:
    return preset.load(name).edit({"shape": [48, 64], **changes})


@pytest.mark.parametrize(
    "system",
    [
        _bench(),
        _bench("holochrome-8-1slm"),
        _bench(eye={"pupil": "1 mm"}),
        _bench("simultaneous", **{"relay1.iris_na": 0.02, "relay2.dc_block_na": 0.002}),
        _bench(propagation="periodic"),
        _bench(effects={"second_line": {"share": 0.3, "offset": "20 nm"}}),
    ],
    ids=["two modulators", "one", "eye", "iris and block", "periodic", "lines"],
)
def test_the_shares_add_up_to_1_and_none_is_negative(system: System) -> None:
    budget = light_budget(make_plan(system, [10e-3]), random_drive(system))
    assert budget.total.sum() == pytest.approx(1.0, abs=1e-12)
    assert budget.by_wavelength.sum(axis=0) == pytest.approx(1.0, abs=1e-12)
    assert budget.total.min() > -ROUNDING and _share(budget, "modulators") < ROUNDING
    assert sum(budget.as_json().values()) == pytest.approx(1.0, abs=10 * ROUNDING)


@pytest.mark.parametrize("name", sorted(of for of in preset.names() if preset.load(of).is_chain))
def test_the_light_of_a_chain_adds_up_to_1(name: str) -> None:
    """The part of the light in the plane that is in the picture is that which rendering measures."""
    system = preset.load(name)
    drive, plane_m = random_drive(system), system.planes_m[:1]
    behind, went = told_light(make_plan(system, plane_m), drive)
    assert sum(went.values()) == pytest.approx(1.0, abs=10 * ROUNDING) and min(went.values()) >= 0
    assert {f"at {of}" for of in behind} < set(went)
    assert list(behind.values())[-1] == pytest.approx(1 - sum(went[f"at {of}"] for of in behind), abs=10 * ROUNDING)
    seen = simulate(system, drive, plane_m, backend="torch")
    share = went["picture"] / (went["picture"] + went["outside_picture"])
    assert seen.light is not None and share == pytest.approx(float(seen.light.by_plane[0]), abs=10 * ROUNDING)


def test_picture_and_zero_order_are_the_light_of_the_image() -> None:
    """On a periodic grid without stops all light is in the picture, but for the zero order."""
    system = _bench("holochrome-8-1slm", propagation="periodic", **{"relay2.square": "none"})
    drive = random_drive(system)
    budget, view = light_budget(make_plan(system, [10e-3]), drive), simulate(system, drive, [10e-3], "torch")
    assert _share(budget, "picture") + _share(budget, "zero_order") == pytest.approx(1.0, abs=10 * ROUNDING)
    whole = make_plan(system).weights.sum() * view.intensity[0, 0].size
    assert view.intensity.sum(dtype=np.float64) / whole == pytest.approx(1.0, abs=10 * ROUNDING)


def test_a_bench_without_patterns_has_its_light_in_the_zero_order() -> None:
    system = _bench("holochrome-8-1slm")
    budget = light_budget(make_plan(system, [10e-3]), np.zeros(system.drive_shape, np.float32))
    assert _share(budget, "zero_order") == pytest.approx(1.0, abs=10 * ROUNDING)


def test_two_phases_leave_cos_squared_in_the_zero_order() -> None:
    """Pixels of ±φ in equal numbers have the mean field cos φ: cos² φ of the light is undiffracted."""
    signs = np.where(np.random.default_rng(0).permutation(64 * 64).reshape(64, 64) % 2 == 0, 1.0, -1.0)
    field = hv.load_field(np.exp(0.8j * signs), pitch="8 um", wavelengths=["532 nm"], distance="20 mm")
    budget = light_budget(make_plan(field.system), field.drive)
    assert _share(budget, "zero_order") == pytest.approx(np.cos(0.8) ** 2, abs=10 * ROUNDING)


def test_the_first_order_s_stop_takes_what_pixels_diffract_beyond_it() -> None:
    """Random pixels light evenly what sinc² of a pixel leaves: (∫ sinc² from −1/2 to 1/2)² = 0.774² passes in area.

    On samples half a pixel apart sinc² is that of two samples; 8 lasers of 3 072 random pixels scatter by 1 %.
    """
    system = _bench("holochrome-8-1slm", **{"relay2.square": "first order"})
    budget = light_budget(make_plan(system, [10e-3]), random_drive(system))
    f = (np.arange(1000) + 0.5) / 1000 - 0.5  # cycles a sample: those of a pixel are cos(πf) of two samples
    inside = np.abs(f) < 0.25
    passes = (np.cos(np.pi * f[inside]) ** 2).sum() / (np.cos(np.pi * f) ** 2).sum()
    stopped = (1 - passes**2) * (1 - _share(budget, "zero_order"))
    assert _share(budget, "stop_2") == pytest.approx(stopped, rel=0.05)


def test_a_wide_pupil_takes_nothing_and_a_narrow_one_most() -> None:
    drive = random_drive(_bench())
    shares = [
        _share(light_budget(make_plan(_bench(eye={"pupil": pupil}), [10e-3]), drive), "pupil")
        for pupil in ("8 mm", "1 mm")
    ]
    assert abs(shares[0]) < ROUNDING and shares[1] > 0.15


def test_light_that_walks_off_is_beside_the_picture_or_beyond_the_grid() -> None:
    system = _bench("holochrome-8-1slm")
    near, far = (light_budget(make_plan(system, [z_m]), random_drive(system)) for z_m in (1e-3, 80e-3))
    lost = [_share(of, "outside_picture") + _share(of, "beyond_grid") for of in (near, far)]
    assert lost[0] < 0.1 < 0.4 < lost[1]
