"""A plane further away is a bench with its plane further away; on a Fourier bench, defocus."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.bench.captures.dataset import Captures
from holoview.light.model.derived_numbers import info_rows
from holoview.util.errors import UserError

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_it_adds_to_the_distance(make_session: Make, predicted: Predicted) -> None:
    captures = make_session()
    further = dataclasses.replace(captures, distance_m=np.full(2, 3e-3 + 1e-4))
    assert torch.equal(predicted(captures, {"distance": {"distance_error": 1e-4}}), predicted(further))


def test_a_fourier_bench_is_defocused_either_way(make_fourier: Make, predicted: Predicted) -> None:
    captures = make_fourier()
    nearer = dataclasses.replace(captures, distance_m=np.full(2, -1e-3))
    found = predicted(captures, {"distance": {"distance_error": -1e-3}})
    torch.testing.assert_close(found, predicted(nearer), rtol=1e-9, atol=0)
    assert not torch.allclose(found, predicted(captures), rtol=0.1)


@pytest.mark.parametrize("plane", ["-5 mm", "-0.5 mm", "3 mm"])
def test_the_planes_of_a_field_move_on_both_sides_of_it(plane: str) -> None:
    rng = np.random.default_rng(0)
    hologram = hv.load_field(
        np.exp(2j * np.pi * rng.random((16, 24))).astype(np.complex64), pitch="8 um", wavelengths="532 nm"
    )
    moved = hologram.system.edit({"effects": {"distance": {"distance_error": "1 mm"}}})
    there = float(plane.removesuffix(" mm")) * 1e-3 + 1e-3
    found = hv.simulate(moved, hologram.drive, planes=[plane], backend="torch64")
    expected = hv.simulate(hologram.system, hologram.drive, planes=[there], backend="torch64")
    # a rounding of the distance by 2⁻⁵³ turns the phase by 1e-16·2π·z/λ
    np.testing.assert_allclose(found.intensity, expected.intensity, rtol=1e-9)
    assert found.focus_m.tolist() == pytest.approx([float(plane.removesuffix(" mm")) * 1e-3])


def test_what_an_eye_is_focused_on_is_told_by_the_nominal_planes_everywhere() -> None:
    system = hv.load("holochrome-8").edit(
        {"shape": [24, 32], "planes": ["9 mm", "11 mm"], "eye": {}, "effects": {"distance": {"distance_error": "1 mm"}}}
    )
    told = hv.simulate(system, hv.random_drive(system), backend="torch").accommodation_dpt
    assert told is not None
    (row,) = [row for row in info_rows(system) if row.name == "focused at"]
    assert row.text == f"{', '.join(f'{d:.3g}' for d in told)} D"
    assert [plane.true_m - plane.nominal_m for plane in hv.make_plan(system).planes] == pytest.approx([1e-3, 1e-3])


def test_a_plane_that_would_be_before_the_last_modulator_is_refused_and_one_at_it_is_not() -> None:
    system = hv.load("holochrome-8").edit({"shape": [24, 32], "planes": ["1 mm", "3 mm"]})

    def seen(error: str) -> list[float]:
        return hv.make_plan(system.edit({"effects": {"distance": {"distance_error": error}}})).planes_m.tolist()

    assert seen("-1 mm") == pytest.approx([0.0, 2e-3], abs=1e-15)
    with pytest.raises(UserError, match=r"effects\.distance.*the plane at 1 mm to 0\.1 mm before the last modulator"):
        seen("-1.1 mm")


def test_so_is_a_camera_there(make_session: Make, predicted: Predicted) -> None:
    """At 3 mm, by an error of a single plane."""
    captures = make_session()
    at = dataclasses.replace(captures, distance_m=np.array([3e-3, 4e-3]))
    off = {"plane_errors": {"distances": (3e-3,), "errors": (-3.5e-3,)}}
    with pytest.raises(
        UserError, match=r"effects\.plane_errors: the camera would be 0\.5 mm before the last modulator"
    ):
        predicted(at, off)
