"""A beam on a part of the modulator: its shape in the modulator's plane, its wavefront in the far field."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.bench.captures.dataset import Captures
from holoview.bench.diagnose.fit import has_list
from holoview.light.effects import beam
from holoview.light.model.bench_parts import Relay
from holoview.light.model.effects.registry import get_effect, listed_effects
from holoview.util.errors import UserError

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]
HALF = 14 * 8e-6  # of the longer side, m


@pytest.fixture
def near(make_session: Make) -> Captures:
    """A picture of the modulator's own plane."""
    return make_session(1, modulators=1, distance_m=np.zeros(1), relay2=Relay())


def test_a_gaussian_beam_is_the_one_of_source_profile(near: Captures, predicted: Predicted) -> None:
    """exp(−fall·r² + slope·x) is a beam of fall = size², centred at slope/(2·fall) in half sides, times a number."""
    size, centre = 1.3, 0.22
    light = predicted(near, {"beam": {"size": size, "centre_x": centre}})
    profile = predicted(near, {"source_profile": {"fall": size**2, "slope_x": 2 * size**2 * centre}})
    factor = math.exp(-2 * (size * centre) ** 2)
    torch.testing.assert_close(light, profile * factor, rtol=1e-5, atol=1e-9 * float(profile.max()))


def test_an_ellipse_of_steep_edge_holds_the_light_within_it(near: Captures, predicted: Predicted) -> None:
    """exp(−2·ρ^(2·edge)) of the squared distance in radii; the ellipse stretches y by e^0.2 and x by its inverse."""
    size, edge, stretch = 2.0, 6.0, 0.2
    image = predicted(near, {"beam": {"size": size, "edge": edge, "ellipse": stretch}})[0]
    y, x = ((torch.arange(2 * n) // 2 - (n - 1) / 2).double() * 8e-6 / HALF * size for n in (20, 28))
    square = (y[:, None] * math.exp(stretch)) ** 2 + (x[None] * math.exp(-stretch)) ** 2
    expected = torch.exp(-2 * square**edge)
    torch.testing.assert_close(image / image.max(), expected / expected.max(), rtol=1e-5, atol=1e-6)


def test_the_wavefront_is_over_the_beam(near: Captures, predicted: Predicted) -> None:
    """A wavefront of r.m.s. w over a small disc shifts no light in the modulator's plane; beyond it, z4 over the
    modulator's circle of radius R has (R/r)² times the coefficient that it has over the beam's of radius r."""
    far = {"distance_m": np.full(1, 3e-3)}
    size = 2.0
    circle = math.hypot(20, 28) * 8e-6 / 2
    moved = near.__class__(**{f: getattr(near, f) for f in near.__dataclass_fields__} | far)
    disc = {"size": size, "edge": 4.0}
    over_beam = predicted(moved, {"beam": disc | {"z4": 20e-9}})
    over_all = predicted(moved, {"beam": disc, "slm_flatness": {"z4_1": 20e-9 * (circle * size / HALF) ** 2}})
    torch.testing.assert_close(over_beam, over_all, rtol=1e-4, atol=1e-4 * float(over_all.max()))
    plain = predicted(moved, {"beam": disc})
    assert float((over_beam - plain).abs().max()) > 0.05 * float(plain.max())
    assert torch.allclose(predicted(near, {"beam": disc | {"z4": 20e-9}}), predicted(near, {"beam": disc}), rtol=1e-4)


def test_even_light_with_a_wavefront_is_one_of_the_modulator(near: Captures, predicted: Predicted) -> None:
    terms = {4: 60e-9, 8: -50e-9, 11: 20e-9}
    light = predicted(near, {"beam": {f"z{j}": value for j, value in terms.items()}})
    surface = predicted(near, {"slm_flatness": {f"z{j}_1": value for j, value in terms.items()}})
    torch.testing.assert_close(light, surface, rtol=1e-5, atol=1e-8)


def test_it_says_shape_radius_and_wavefront(make_session: Make) -> None:
    system, effect = make_session().nominal_system(), get_effect("beam")
    said = effect.format_finding(system, {"size": 2.0, "edge": 6.0, "centre_x": 0.05, "z7": 30e-9, "z8": 40e-9})
    assert "a disc of radius 0.056 mm" in said and "x = 0.0056 mm" in said and "50 nm of coma" in said
    assert "a Gaussian beam" in effect.format_finding(system, {"size": 1.0})
    assert "even, with 20 nm of defocus" in effect.format_finding(system, {"z4": 20e-9})


STEEP = {"size": 1.5, "edge": 8.0, "centre_y": 0.1, **{f"z{j}": 200e-9 for j in range(4, 9)}}


@pytest.mark.parametrize("name", [n for n, effect in listed_effects().items() if n != "beam" and not has_list(effect)])
@pytest.mark.parametrize("place", ["near", "far"])
def test_an_effect_of_next_to_no_size_changes_next_to_nothing_of_steep_light(
    place: str, name: str, make_session: Make, make_fourier: Make, predicted: Predicted
) -> None:
    """Though it may need samples within pixels: else an effect of no size would stand for the light between them. Its
    numbers are a hundred-thousandth of their usual size, and so is what they change, but for a factor."""
    effect, captures = listed_effects()[name], make_session(1) if place == "near" else make_fourier(1)
    tiny = {p.name: p.nudged(1e-5) for p in effect.parameters if not p.secondary}
    try:
        light = predicted(captures, {"beam": STEEP, name: tiny})
    except UserError as refused:
        pytest.skip(str(refused))
    change = light - predicted(captures, {"beam": STEEP})
    assert float(change.norm() / light.norm()) < 1e-4


@pytest.mark.parametrize("place", ["near", "far"])
def test_steep_light_is_nearly_that_of_eighths_of_pixels(
    place: str, make_session: Make, make_fourier: Make, predicted: Predicted, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Eight by eight pixels of an eighth of the pitch show what one shows, each with the light of its own middle. Two
    samples a pixel and axis err by a quarter of what one does, since the error is of second order."""
    captures = make_session(1, modulators=1) if place == "near" else make_fourier(1)
    levels = captures.levels.repeat(8, axis=2).repeat(8, axis=3)
    panels = tuple(dataclasses.replace(panel, pitch_m=panel.pitch_m / 8) for panel in captures.slms)
    finest = predicted(dataclasses.replace(captures, levels=levels, slms=panels), {"beam": STEEP})

    def error() -> float:
        light = predicted(captures, {"beam": STEEP})
        return float((light / light.norm() - finest / finest.norm()).norm())

    sampled = error()
    monkeypatch.setattr(beam, "_MOST_WITHIN_PIXELS", math.inf)
    assert sampled < 0.3 * error()
