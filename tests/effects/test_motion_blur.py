"""A moving camera sees the mean of all places that it passes, of light that its pixels needn't resolve."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.bench.captures.dataset import Camera, Captures
from holoview.bench.captures.predictor import Predictor
from holoview.light.model.bench_parts import Relay
from tests.effects.conftest import SHAPE

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]
_PLACES = 300
_ROTATED = {"camera_alignment": {"rotation": 0.02, "magnification": 0.03}}


def _coarse(captures: Captures) -> Captures:
    """With pixels of 8 µm, half as many as its speckle asks for."""
    pictures = np.full((1, *SHAPE), 500, np.uint16)
    return dataclasses.replace(captures, images=pictures, camera=Camera(8e-6, 12, 4.0, 3.0, 64.0))


def _brute_force(captures: Captures, y: float, x: float, beside: dict[str, dict[str, float]]) -> torch.Tensor:
    """The mean of 300 pictures of a camera that stands still."""
    predictor, total = Predictor(captures, double_precision=True, cache_mb=1), torch.zeros(captures.shape).double()
    for k in range(_PLACES):
        along = ((k + 0.5) / _PLACES - 0.5) * captures.camera.pitch_m
        place = {"shift_y": along * y, "shift_x": along * x}
        moved = {**beside, "camera_alignment": {**beside.get("camera_alignment", {}), **place}}
        total += predictor([0], moved).signal[0] / _PLACES
    return total


@pytest.mark.parametrize("bench", ["near field", "pixels coarser than speckle", "no iris", "Fourier bench"])
@pytest.mark.parametrize(("y", "x"), [(0.0, 1.0), (3.0, -2.0)])
def test_it_is_the_mean_of_many_pictures(
    make_session: Make, make_fourier: Make, predicted: Predicted, bench: str, y: float, x: float
) -> None:
    """The finest intensity has f ≤ 1 cycle a pixel: middles of 300 parts of 5 pixels err by (π·5·f/300)²/6, 5e-4 of it,
    and by less of all other light. Blurred after the pixels sampled it, a picture of the light's own pixels was off by
    1.6 % since light moves in from beyond its edges, and one of coarser pixels by 10 %."""
    bare = {"relay1": Relay(), "relay2": Relay()} if bench == "no iris" else {}
    captures = make_fourier(1) if bench == "Fourier bench" else make_session(1, **bare)
    captures = _coarse(captures) if "coarser" in bench else captures
    found = predicted(captures, {"motion_blur": {"length_y": y, "length_x": x}})[0]
    expected = _brute_force(captures, y, x, {})
    assert float((found - expected).norm() / expected.norm()) < 2e-4


def test_of_a_rotated_and_larger_picture_too(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1)
    found = predicted(captures, {"motion_blur": {"length_y": 1.0, "length_x": 2.0}, **_ROTATED})[0]
    expected = _brute_force(captures, 1.0, 2.0, _ROTATED)
    assert float((found - expected).norm() / expected.norm()) < 2e-4


def test_motion_there_and_back_is_the_same(make_session: Make, predicted: Predicted) -> None:
    there, back = (
        predicted(make_session(1), {"motion_blur": {"length_y": sign * 2.0, "length_x": sign * 3.0}})
        for sign in (1, -1)
    )
    torch.testing.assert_close(there, back, rtol=1e-12, atol=0)


def test_long_motion_leaves_lines(make_fourier: Make, predicted: Predicted) -> None:
    """Along 100 pixels, forty grains of speckle of 520 nm·0.1 m/(28·8 µm), a row has little left of its contrast."""
    captures = make_fourier(1)
    still, moved = (predicted(captures, {"motion_blur": {"length_x": length}})[0] for length in (0.0, 100.0))
    assert bool((moved >= 0).all())
    assert float((moved.std(dim=1) / moved.mean(dim=1)).mean()) < 0.3 * float(
        (still.std(dim=1) / still.mean(dim=1)).mean()
    )
