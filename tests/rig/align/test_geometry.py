"""Where dots fall, and what a fit makes of them, without light."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from holoview.bench.rig.dots import NAMES, BenchFacts, Dots, brightest_dot, find_dots, fit_geometry, predicted_px
from holoview.bench.rig.rays import RayWay
from holoview.light.model.effects.hook_contexts import Pose

λ = 638e-9
SECOND = ("shift2_y", "shift2_x", "rotation2", "magnification2", "gap")
NEAR = BenchFacts(λ, (RayWay((("space", 1e-3),), gap=0), RayWay()), "flip_x", SECOND)
ONE, FOURIER = BenchFacts(λ, (RayWay(),)), BenchFacts(λ, (RayWay((("fourier", 0.1),)),))
TRUE = {
    "centre_y": 119.3, "centre_x": 149.8, "log_pitch": np.log(3.9e-6), "rotation": 8e-3, "offset": 0.3e-3,
    "scale": 0.02, "walk_y": 1e-3, "walk_x": -2e-3, "shift2_y": 12e-6, "shift2_x": -7e-6, "rotation2": 3e-3,
    "magnification2": 1e-3, "gap": 1.1e-3,
}  # fmt: skip


def values_of(facts: BenchFacts) -> np.ndarray:
    return np.array([0.0 if facts.modulators == 1 and n in SECOND else TRUE[n] for n in NAMES])


def dots_of(
    facts: BenchFacts, noise_px: float, seed: int, settings: tuple[float, ...] = (2e-3, 4e-3, 6e-3)
) -> list[Dots]:
    """Dots of blocks with the four carriers, as they would be seen."""
    rng, true = np.random.default_rng(seed), values_of(facts)
    places = np.stack(np.meshgrid(*(np.linspace(-4e-4, 4e-4, 3),) * 2, indexing="ij"), -1).reshape(-1, 2)
    found = []
    for slm in range(facts.modulators):
        for setting in settings:
            for carrier in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                ν = np.tile(np.array(carrier) * 14e3, (len(places), 1))
                seen = predicted_px(true, facts, slm, setting, places, ν)
                found.append(Dots(slm, setting, places, ν, seen + noise_px * rng.standard_normal(seen.shape)))
    return found


def start_of(facts: BenchFacts) -> np.ndarray:
    """Nominal values, a few pixels and a few per cent away."""
    start = dict.fromkeys(NAMES, 0.0) | {"centre_y": 117.0, "centre_x": 151.0, "log_pitch": np.log(4e-6)}
    return np.array([(start | ({"gap": 1e-3} if facts.modulators == 2 else {}))[n] for n in NAMES])


@pytest.mark.parametrize("facts", [NEAR, FOURIER])
def test_exact_dots_give_the_geometry(facts: BenchFacts) -> None:
    found = fit_geometry(start_of(facts), facts, dots_of(facts, 0.0, 0))
    # Least squares end when a step is below 1e-8 of the values, in units of pixels, mrad and 0.1 mm.
    scale = np.array([1, 1, 1e-3, 1e-3, 1e-4, 1e-2, 1e-3, 1e-3, 1e-6, 1e-6, 1e-3, 1e-3, 1e-4])
    assert np.abs((found.values - values_of(facts)) / scale).max() < 1e-4


def test_errors_of_noisy_dots_are_as_large_as_stated() -> None:
    """8 sessions: the r.m.s. of 8 normal deviates lies beyond either limit once in 10⁸ times (χ² of 8)."""
    pulls = []
    for seed in range(8):
        found = fit_geometry(start_of(ONE), ONE, dots_of(ONE, 0.05, seed, settings=(2e-3, 6e-3)))
        pulls.append([(found[n] - TRUE[n]) / found.uncertainty(n) for n in NAMES[:8]])
    rms = np.sqrt((np.array(pulls) ** 2).mean(axis=0))
    low, high = np.sqrt(chi2.ppf((1e-8, 1 - 1e-8), 8) / 8)  # 0.07 and 2.6
    assert (rms > low).all() and (rms < high).all()


def test_dots_at_wrong_places_are_left_out() -> None:
    dots = dots_of(NEAR, 0.01, 1)
    dots[0].position_px[:3] += 20.0
    dots[5].position_px[2] = np.nan
    found = fit_geometry(start_of(NEAR), NEAR, dots)
    assert found.used[1] - found.used[0] >= 4
    assert abs(found["centre_y"] - TRUE["centre_y"]) < 5 * found.uncertainty("centre_y")


def test_what_one_setting_of_the_stage_cannot_tell_stays() -> None:
    start = start_of(NEAR)
    start[NAMES.index("scale")] = 0.007
    found = fit_geometry(start, NEAR, dots_of(NEAR, 0.01, 1, settings=(4e-3,)))
    assert found["scale"] == 0.007 and found["walk_y"] == 0.0
    assert found.uncertainty("scale") == 0.0


def test_rotation_and_shift_have_the_signs_of_a_pose() -> None:
    """A dot without a carrier lies where `Pose.inverse_affine` takes it back from."""
    pitch = float(np.exp(TRUE["log_pitch"]))
    values = np.array([TRUE[n] if n in ("centre_y", "centre_x", "log_pitch", "rotation") else 0.0 for n in NAMES])
    place = np.array([[1e-4, -2e-4]])
    seen = predicted_px(values, ONE, 0, 0.0, place, np.zeros((1, 2)))[0]
    pose = Pose(shift_m=(0.0, 0.0), rotation_rad=TRUE["rotation"])
    rows = np.array(pose.inverse_affine(pitch))
    back = rows[:, :2] @ (seen - [TRUE["centre_y"], TRUE["centre_x"]]) * pitch
    assert np.allclose(back, place[0], rtol=0, atol=1e-15)


SIGMA = 2.0
WIDTH = SIGMA / 0.4


def picture(places: list[tuple[float, float]], shape: tuple[int, int] = (60, 80)) -> np.ndarray:
    y, x = np.mgrid[: shape[0], : shape[1]]
    return sum(np.exp(-((y - a) ** 2 + (x - b) ** 2) / (2 * SIGMA**2)) for a, b in places)


@pytest.mark.parametrize("place", [(20.0, 30.0), (20.3, 30.5), (20.49, 29.51)])
def test_a_gaussian_dot_is_found_to_a_hundredth_of_a_pixel(place: tuple[float, float]) -> None:
    """What is left is the edge of the window, 3 σ away, where the background is taken from: e^-4.5 of the height."""
    found = find_dots(picture([place]), np.array([[22.0, 28.0]]), WIDTH, 8.0)
    assert np.abs(found.position_px[0] - place).max() < 0.01


def test_noise_moves_a_dot_by_what_its_light_allows() -> None:
    """σ of the centroid is at least σ_dot/√N; the weight and the background make it up to twice that."""
    rng, errors = np.random.default_rng(0), []
    for _ in range(50):
        noisy = rng.poisson(1000 * picture([(20.3, 30.4)])).astype(float)
        errors.append(find_dots(noisy, np.array([[20.0, 30.0]]), WIDTH, 8.0).position_px[0] - [20.3, 30.4])
    photons = 1000 * 2 * np.pi * SIGMA**2
    assert SIGMA / np.sqrt(photons) * 0.7 < np.std(errors) < 3 * SIGMA / np.sqrt(photons)


def test_each_dot_is_found_in_its_own_reach_and_none_beyond_the_picture() -> None:
    found = find_dots(
        picture([(20, 20), (20, 45)]), np.array([[21.0, 19.0], [19.0, 46.0], [1.0, 70.0], [90.0, 20.0]]), WIDTH, 9.0
    )
    assert np.abs(found.position_px[:2] - [[20, 20], [20, 45]]).max() < 0.02
    assert np.isnan(found.position_px[3]).all()
    assert found.contrast[1] > 100


def test_the_brightest_dot_stands_out_of_noise_and_noise_has_none() -> None:
    noise = np.random.default_rng(1).standard_normal((300, 300))
    place, contrast = brightest_dot(noise + 5 * picture([(140.0, 200.0)], (300, 300)), WIDTH)
    assert np.abs(place - [140, 200]).max() <= 2 and contrast > 12  # 5/2 of 1/(2√π·σ), less the noise's own share
    assert brightest_dot(noise, WIDTH)[1] < 8  # 300² values of unit deviation reach 4.4, smoothed ones less


@pytest.mark.parametrize(
    ("way", "a", "b_m", "focal_length_m"),
    [
        (RayWay(), 1.0, 5e-3, None),
        (RayWay((("space", 1e-3), ("space", 2e-3)), behind_m=0.5e-3), 1.0, 7.5e-3, None),
        (RayWay((("fourier", 0.1),)), -0.05, 0.1, 0.1),
        (RayWay((("fourier", 15e-3), ("fourier", 30e-3))), -2.0, -2.5e-3, None),  # an image twice as large
        (RayWay((("space", 20e-3), ("lens", 10e-3), ("space", 15e-3))), -1.0, 0.0, 10e-3),  # an image 2f behind it
    ],
)
def test_a_way_images_or_transforms_a_modulator_as_matrices_say(
    way: RayWay, a: float, b_m: float, focal_length_m: float | None
) -> None:
    """With the camera at 5 mm. A lens of f at 2f images 1 : 1 at 2f behind it, 20 mm = 15 mm + 5 mm."""
    assert way.matrix(5e-3) == pytest.approx((a, b_m), abs=1e-12)
    if focal_length_m is None:
        assert way.focal_length_m is None
    else:
        assert way.focal_length_m == pytest.approx(focal_length_m, rel=1e-9)
        assert way.matrix(way.focus_m)[0] == pytest.approx(0.0, abs=1e-12)


def test_rays_leave_the_axis_by_their_tangent_and_begin_at_the_modulators_place() -> None:
    way = RayWay((("space", 1e-3),), gap=0, offset_m=(1e-4, 0.0))
    met = way.traced(np.array([[0.0, 2e-4]]), np.array([[0.6, 0.0]]), 3e-3, 2e-3)
    np.testing.assert_allclose(met, [[1e-4 + 5e-3 * 0.75, 2e-4]], rtol=1e-12)


def test_the_stage_goes_where_a_length_behind_the_modulator_is_seen() -> None:
    assert RayWay((("space", 2e-3),)).stage_m(5e-3, (0.0, 1e-2)) == pytest.approx(3e-3)
    assert RayWay((("fourier", 15e-3),) * 2).stage_m(5e-3, (0.0, 1e-2)) == pytest.approx(5e-3)  # behind the image
    assert RayWay((("fourier", 0.1),)).stage_m(5e-3, (1e-3, 2e-3)) == pytest.approx(1e-3)  # the plane is almost reached
    assert RayWay((("space", 2e-3),)).stage_m(5e-3, (4e-3, 1e-2)) == pytest.approx(4e-3)
