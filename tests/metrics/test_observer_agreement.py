"""People's disagreement on the light of lasers, and the penalty by which wavelengths are chosen on which they agree."""

from __future__ import annotations

import numpy as np
import pytest

import holoview as hv
from holoview.holograms.metrics.fidelity import delta_e_xyz
from holoview.holograms.metrics.observer_agreement import disagreement
from holoview.holograms.optimise.agreement import AgreementPenalty
from holoview.holograms.optimise.settings import find_loss_space
from holoview.light.colour import D65_WHITE, observer_weights
from holoview.light.observers import drawn_people
from holoview.util.errors import UserError

LASERS_M = np.array([460e-9, 532e-9, 638e-9])


def test_equal_people_agree_and_two_differ_by_their_own_colours() -> None:
    light = np.random.default_rng(0).uniform(0.1, 1.0, (3, 16, 24))
    same = disagreement(light, LASERS_M, ["eye", "eye"])
    np.testing.assert_allclose([same.daylight, same.display, same.white], 0, atol=1e-6)
    people = ["age 20", "age 70"]
    even = np.broadcast_to(np.array([0.2, 0.3, 0.4])[:, None, None], (3, 8, 8))
    found = disagreement(even, LASERS_M, people)
    colours = [np.array([0.2, 0.3, 0.4]) @ observer_weights(person, LASERS_M) for person in people]
    expected = [delta_e_xyz(colour, np.mean(colours, axis=0)) for colour in colours]
    np.testing.assert_allclose(found.daylight, expected, rtol=1e-9)


def test_eyes_that_are_used_to_the_display_agree_on_its_white() -> None:
    people = drawn_people(10)
    system = hv.load("holochrome-8").with_(amplitudes="white")
    white = np.broadcast_to(system.amplitudes.mean(axis=0)[:, None, None], (8, 8, 8))
    found = disagreement(white, system.wavelengths_m, people)
    # 5e-9 of Y: the white of the lasers is solved to 1e-12; CIEDE2000 has a square root of differences near 0
    np.testing.assert_allclose(found.display, 0, atol=1e-3)
    assert found.daylight.mean() > 1
    np.testing.assert_allclose(found.daylight, found.white, rtol=1e-6)


def test_an_image_below_a_patch_and_a_single_person_are_refused() -> None:
    with pytest.raises(UserError, match="at least 8 × 8"):
        disagreement(np.ones((3, 4, 8)), LASERS_M, ["eye", "age 60"])
    with pytest.raises(UserError, match="2 or more"):
        disagreement(np.ones((3, 8, 8)), LASERS_M, ["eye"])


@pytest.mark.parametrize("loss", ["linear-srgb", "xyz", "luminance"])
def test_the_penalty_is_the_people_s_variance_and_has_its_gradient(loss: str) -> None:
    people, space = drawn_people(5), find_loss_space(loss)
    penalty = AgreementPenalty(people, space)
    at, powers = np.array([455.3e-9, 531.4e-9, 637.8e-9]), np.array([0.3, 0.5, 0.9])
    value, gradient = penalty.value_and_gradient(at, powers)
    seen = np.stack([powers @ observer_weights(person, at) for person in people])
    channels = (seen / seen[:, 1].mean()) @ space.matrix.T
    assert value == pytest.approx(np.square(channels - channels.mean(axis=0)).sum(axis=1).mean(), rel=1e-12)
    # Three lasers make the mean person's colour by one mixture alone: their powers follow from it. The weights are
    # linear between whole nanometres; over ±1e-12 m the quotient keeps its error of second order below 1e-5.
    shares, step = powers / seen[:, 1].mean(), 1e-12
    mean_colour = shares @ np.mean([observer_weights(person, at) for person in people], axis=0)
    for laser in range(3):
        ends = []
        for sign in (1, -1):
            moved = at.copy()
            moved[laser] += sign * step
            weights = np.stack([observer_weights(person, moved) for person in people])
            mixed = np.linalg.solve(weights.mean(axis=0).T, mean_colour)
            apart = np.einsum("l,olc->oc", mixed, weights) @ space.matrix.T
            ends.append(np.square(apart - apart.mean(axis=0)).sum(axis=1).mean())
        assert gradient[laser] == pytest.approx(
            (ends[0] - ends[1]) / (2 * step), rel=1e-3, abs=1e-3 * abs(gradient).max()
        )


def test_people_agree_more_on_lasers_that_are_chosen_for_it() -> None:
    system = hv.load("holochrome-8").with_(shape=[24, 32], planes=["10 mm"])
    target = np.full((1, 48, 64, 3), 0.4, np.float32)
    found = []
    for people in (0, 5):
        settings = hv.Settings(
            iterations=24, free=("patterns", "amplitudes", "wavelengths"), observers=people, agreement=1e6
        )
        *_, last = hv.iterate(system, target, settings)
        lasers = last.best.system
        penalty = AgreementPenalty(drawn_people(5), find_loss_space("linear-srgb"))
        found.append(penalty.value_and_gradient(lasers.wavelengths_m, lasers.amplitudes.mean(axis=0))[0])
    assert found[1] < 0.8 * found[0]


def test_agreement_is_asked_of_free_wavelengths_and_of_several_people() -> None:
    with pytest.raises(UserError, match="fixed wavelengths"):
        hv.Settings(observers=20)
    for count in (1, 101):
        with pytest.raises(UserError, match=r"observers: .*100"):
            hv.Settings(observers=count, free=("wavelengths",))


def test_light_of_equal_energy_is_white_to_all() -> None:
    at = np.arange(390, 831) * 1e-9
    seen = [observer_weights(person, at).sum(axis=0) for person in drawn_people(5)]
    np.testing.assert_allclose(seen, np.broadcast_to(seen[0], (5, 3)), rtol=1e-6)
    assert D65_WHITE[1] == 1
