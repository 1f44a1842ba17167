"""The fast forward model equals the reference executor, also where it caches, and explains independent captures."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

import holoview as hv
from holoview.bench.captures.camera_model import NearFieldModel, pixel_quadrature
from holoview.bench.captures.capture_file import read_captures
from holoview.bench.captures.dataset import Camera, Captures, SlmSpec
from holoview.bench.captures.predictor import Predictor, check_known_effects
from holoview.light.model.bench_parts import Relay
from holoview.light.model.effects.registry import get_effect
from holoview.util.errors import UserError

FOLDER = Path(__file__).resolve().parents[1] / "data"
CHI2_TOLERANCE = 0.035
"""χ²/n of n = 49152 pixels scatters by √(2/n) = 0.0064; five of these, and the fitted gain's own error."""
SHAPE = (20, 28)
NEAR: dict[str, dict[str, float]] = {
    "gap": {"gap_error": 1e-4},
    "distance": {"distance_error": -2e-4},
    "stroke": {"stroke_error": 0.1, "difference": 0.02},
    "lut": {"gamma1": 1.3, "level2_05": 0.1},
    "lut_dispersion": {"slope1": 0.3, "slope2": -0.2, "offset2": 0.1},
    "stroke_map": {"z2_1": 0.05, "z4_1": -0.03, "z3_2": 0.05},
    "dispersion": {"slope": 0.2},
    "tilt": {"tilt_y": 2e-3, "tilt_x": -1e-3},
    "source_profile": {"fall": 0.5, "slope_y": 0.1},
    "source_extent": {"radius": 0.5e-3},
    "bandwidth": {"sigma": 3e-9},
    "second_line": {"share": 0.3, "offset": -4e-9},
    "wavelength_offset": {"offset": 4e-9},
    "slm_alignment": {"shift_y": 3e-6, "rotation": 5e-3, "magnification": 0.01},
    "slm_flatness": {"z4_1": 1e-7, "z5_2": 1e-7},
    "slm1_fringes": {"path_y": 2e-6, "cos1": 0.1, "cos2": 0.1, "sin1": 0.05, "sin2": 0.05},
    "slm2_fringes": {"path_x": -3e-6, "path_y": 1e-6, "cos1": 0.1, "cos2": 0.1},
    "crosstalk": {"sigma": 0.45},
    "undiffracted": {"share": 0.2, "quadrature": 0.1},
    "polarisation": {"share": 0.2},
    "flicker": {"depth": 0.1},
    "iris1": {"radius_error": 0.2, "decentre_y": 0.3},
    "iris2": {"radius_error": -0.2, "decentre_x": 0.2},
    "dc_block": {"radius": 2e-3},
    "aberration1": {"z5": 1e-7, "z7": 5e-8},
    "aberration2": {"z4": 2e-7, "z6_slope": 1e-7},
}


def _captures(count: int = 3, modulators: int = 2) -> Captures:
    rng = np.random.default_rng(5)
    return Captures(
        levels=rng.integers(0, 16, (count, modulators, *SHAPE), dtype=np.uint8),
        images=np.full((count, 2 * SHAPE[0], 2 * SHAPE[1]), 500, np.uint16),
        wavelength_m=np.linspace(480e-9, 620e-9, count),
        distance_m=np.full(count, 3e-3),
        power=np.linspace(1.0, 0.5, count),
        exposure_s=np.full(count, 0.01),
        slms=(SlmSpec(8e-6, 16, 780e-9),) * modulators,
        camera=Camera(4e-6, 12, 4.0, 3.0, 64.0),
        gap_m=1e-3 if modulators == 2 else None,
        relay1=Relay(iris_na=0.03 if modulators == 2 else None),
        relay2=Relay(iris_na=0.03),
    )


def _executed(captures: Captures, k: int, effects: dict[str, dict[str, float]]) -> NDArray[np.floating]:
    """What the reference executor computes of a capture."""
    system = captures.nominal_system([captures.wavelength_m[k]], [captures.distance_m[k]]).edit({"effects": effects})
    view = hv.simulate(system, captures.drive(k)[None], backend="torch64")
    return view.intensity[0].sum(axis=0) * captures.power[k] * captures.exposure_s[k]


@pytest.mark.parametrize("name", ["none", *NEAR])
def test_it_is_what_the_reference_executor_computes(name: str) -> None:
    captures, effects = _captures(), {name: NEAR[name]} if name in NEAR else {}
    found = Predictor(captures, double_precision=True)([1], effects).signal[0].numpy()
    np.testing.assert_allclose(found, _executed(captures, 1, effects), rtol=1e-9, atol=1e-9 * found.max())


@pytest.mark.parametrize(
    "name", [n for n in NEAR if n not in ("gap", "slm_alignment", "slm2_fringes", "iris1", "aberration1")]
)
def test_one_modulator_too(name: str) -> None:
    captures = _captures(modulators=1)
    own = {p.name for p in get_effect(name).parameters if p.acts_on != "modulator 2"}
    effects = {name: {parameter: value for parameter, value in NEAR[name].items() if parameter in own}}
    found = Predictor(captures, double_precision=True)([0], effects).signal[0].numpy()
    np.testing.assert_allclose(found, _executed(captures, 0, effects), rtol=1e-9, atol=1e-9 * found.max())


def test_weighted_stops_depend_less_on_the_grid() -> None:
    """Sharp stops cut at other frequencies on each grid; what is left is light that a larger grid holds."""
    differences = []
    for has_weighted_stops in (False, True):
        predictors = [Predictor(_captures(), padding=n, has_weighted_stops=has_weighted_stops) for n in (4, 6)]
        first, second = (predict([1], {}).signal[0].numpy() for predict in predictors)
        differences.append(np.linalg.norm(first - second) / np.linalg.norm(second))
    assert differences[1] < 0.5 * differences[0]


STOPS = {
    "square": Relay(square=0.025),
    "first order": Relay(square="first order"),
    "real first order, displaced": Relay(square="first order at 500 nm", centre_na=(0.004, -0.011)),
    "iris and square, displaced": Relay(iris_na=0.03, square=0.025, centre_na=(-0.007, 0.003)),
    "iris beyond the axis": Relay(iris_na=0.01, centre_na=(0.0, 0.02)),
}


@pytest.mark.parametrize("name", ["none", "iris1", "iris2", "aberration1", "aberration2", "dc_block", "tilt"])
@pytest.mark.parametrize("stops", STOPS)
def test_square_and_displaced_stops_too(stops: str, name: str) -> None:
    captures = dataclasses.replace(_captures(), relay1=Relay(square=0.027), relay2=STOPS[stops])
    effects = {name: NEAR[name]} if name in NEAR else {}
    found = Predictor(captures, double_precision=True)([1], effects).signal[0].numpy()
    np.testing.assert_allclose(found, _executed(captures, 1, effects), rtol=1e-9, atol=1e-9 * found.max())


def test_all_of_a_preset_s_relay_counts() -> None:
    relay = Relay(square=0.027, dc_block_na=2e-3, apodisation_na=0.02, aberration_m={"Z5": 1e-7}, centre_na=(0, 2e-3))
    captures = dataclasses.replace(_captures(), relay2=relay)
    found = Predictor(captures, double_precision=True)([0]).signal[0].numpy()
    np.testing.assert_allclose(found, _executed(captures, 0, {}), rtol=1e-9, atol=1e-9 * found.max())


@pytest.mark.parametrize("square", [0.012, "first order", "first order at 600 nm"])
def test_a_square_stop_of_a_fourier_bench_has_straight_edges_where_its_direction_sines_are(square: float | str) -> None:
    f, pixel, relay = 0.1, 10e-6, Relay(square=square, centre_na=(0.00313, -0.00487))
    plain = dataclasses.replace(
        _captures(2, 1),
        images=np.full((2, 601, 801), 500, np.uint16),
        distance_m=np.zeros(2),
        camera=Camera(pixel, 12, 4.0, 3.0, 64.0),
        relay2=Relay(),
        focal_length_m=f,
    )
    y, x = ((np.arange(n) - (n - 1) / 2) * pixel / f for n in plain.shape)
    for k, λ in enumerate(plain.wavelength_m):
        whole, stopped = (
            Predictor(dataclasses.replace(plain, relay2=r), double_precision=True)([k]).signal[0].numpy()
            for r in (Relay(), relay)
        )
        half = square if isinstance(square, float) else (λ if square == "first order" else 600e-9) / 16e-6
        inside = (abs(y - 0.00313) < half)[:, None] & (abs(x + 0.00487) < half)
        np.testing.assert_array_equal(stopped, np.where(inside, whole, 0.0))


def test_all_effects_together() -> None:
    captures = _captures()
    some = {name: NEAR[name] for name in ("gap", "lut", "crosstalk", "slm_alignment", "undiffracted", "iris2", "tilt")}
    found = Predictor(captures, double_precision=True)([2], some).signal[0].numpy()
    np.testing.assert_allclose(found, _executed(captures, 2, some), rtol=1e-9, atol=1e-9 * found.max())


def test_what_is_kept_never_stands_for_something_else() -> None:
    """Effects called in a random order give, to the bit, what each gives alone."""
    captures = _captures()
    camera = {
        "camera_blur": {"sigma": 1.0},
        "camera_alignment": {"shift_y": 2e-6},
        "ghost": {"strength": 0.1, "shift_x": 3},
    }
    tables = [{}, *({name: values} for name, values in {**NEAR, **camera}.items())]
    tables += [{"gap": {"gap_error": e}, "lut": {"gamma1": g}} for e in (1e-4, 2e-4) for g in (1.2, 1.3)]
    shared, rng = Predictor(captures), np.random.default_rng(0)
    for number in rng.integers(0, len(tables), 60):
        k = int(rng.integers(0, 3))
        assert torch.equal(shared([k], tables[number]).signal, Predictor(captures)([k], tables[number]).signal), number


def test_what_is_said_of_another_laser_changes_nothing_and_computes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    computed: list[int] = []
    intensity = NearFieldModel.intensity
    monkeypatch.setattr(NearFieldModel, "intensity", lambda *given: computed.append(1) or intensity(*given))
    predictor = Predictor(_captures())
    fringes = {"path_y": 2e-6, "cos1": 0.1, "cos2": 0.1}
    plain, first = (predictor([0, 1, 2], effects).signal for effects in ({}, {"slm1_fringes": fringes}))
    many = len(computed)
    assert torch.equal(plain[2], first[2]) and not torch.equal(plain[0], first[0])
    again = predictor([0, 1, 2], {"slm1_fringes": {**fringes, "cos2": 0.2, "cos7": 0.3}}).signal
    assert len(computed) == many + 1  # the capture of the second laser
    assert torch.equal(again[[0, 2]], first[[0, 2]]) and not torch.equal(again[1], first[1])


def test_a_picture_of_many_fields_is_kept_though_they_push_each_other_out(monkeypatch: pytest.MonkeyPatch) -> None:
    computed: list[int] = []
    intensity = NearFieldModel.intensity
    monkeypatch.setattr(NearFieldModel, "intensity", lambda *given: computed.append(1) or intensity(*given))
    predictor, effects = Predictor(_captures(), cache_mb=1), {"source_extent": {"radius": 2e-3}}
    first = predictor([0, 1, 2], effects).signal
    many = len(computed)
    assert many > 40
    assert torch.equal(predictor([0, 1, 2], {**effects, "camera_black": {"black": 3.0}}).signal, first)
    assert len(computed) == many
    predictor([0], {"source_extent": {"radius": 2.1e-3}})
    assert len(computed) > many


@pytest.mark.parametrize("capture", [0, 2, 4, 7])
@pytest.mark.parametrize(
    ("name", "effects"),
    [
        ("sample_consistent", {}),
        ("sample_gap", {"gap": {"gap_error": 0.108e-3}}),
        (
            "sample_two",
            {"crosstalk": {"sigma": 0.45}, "slm_alignment": {"shift_y": 0.6 * 8e-6, "shift_x": -0.45 * 8e-6}},
        ),
    ],
)
def test_captures_of_an_independent_program_are_explained_to_their_noise(
    name: str, effects: dict[str, dict[str, float]], capture: int
) -> None:
    captures = read_captures(FOLDER / f"{name}.h5")
    found = Predictor(captures)([capture], effects)
    image, signal = captures.images[capture].astype(float), found.signal[0].double().numpy()
    valid = image < captures.camera.saturation
    seen, signal = image[valid] - found.black_level, signal[valid]
    signal = signal * (signal @ seen) / (signal @ signal)
    assert np.mean((seen - signal) ** 2 / captures.camera.noise_variance(signal)) == pytest.approx(
        1.0, abs=CHI2_TOLERANCE
    )


def test_a_grating_on_a_fourier_bench_sends_its_orders_where_the_grating_equation_says() -> None:
    """A binary phase grating of half a wave, period 4 pixels: orders ±1 at λf/period with (2/π)² of the light each,
    less the pixel's own envelope; none in the middle."""
    λ, f, pitch = 500e-9, 0.128, 8e-6
    levels = np.zeros((1, 1, 32, 64), np.uint8)
    levels[..., np.arange(64) % 4 >= 2] = 1
    captures = dataclasses.replace(
        _captures(1, 1),
        levels=levels,
        images=np.full((1, 401, 401), 500, np.uint16),
        wavelength_m=np.array([λ]),
        distance_m=np.zeros(1),
        power=np.ones(1),
        exposure_s=np.ones(1),
        slms=(SlmSpec(pitch, 2, λ / 2),),
        camera=Camera(20e-6, 12, 4.0, 3.0, 64.0),
        relay2=Relay(),
        focal_length_m=f,
    )
    image = Predictor(captures, double_precision=True)([0]).signal[0]
    away = round(λ * f / (4 * pitch) / 20e-6)  # 100 pixels
    assert away == 100
    order = np.unravel_index(int(image.argmax()), image.shape)
    assert order[0] == 200 and abs(order[1] - 200) == away
    assert float(image[200, 200]) == pytest.approx(0.0, abs=1e-15)
    sampled = abs((1 + np.exp(-0.5j * np.pi) - np.exp(-1j * np.pi) - np.exp(-1.5j * np.pi)) / 4) ** 2
    assert float(image[order]) == pytest.approx(32 * 64 * sampled * np.sinc(0.25) ** 2, rel=1e-9)
    assert sampled * np.sinc(0.25) ** 2 == pytest.approx((2 / np.pi) ** 2, rel=1e-9)


def test_gradients_reach_what_an_own_effect_holds() -> None:
    from holoview.light.effects import Effect, Parameter

    class Map(Effect):
        id = "map"
        cause = finding = "A map."
        parameters = (Parameter("on", "Whether it acts."),)
        acts_on = ("modulator 1",)
        values_m = torch.zeros(SHAPE, dtype=torch.float64, requires_grad=True)

        def optical_path(self, path_m, context, v):  # type: ignore[no-untyped-def]
            return path_m + self.values_m

    predictor = Predictor(_captures(), extra_effects=[Map()], double_precision=True)
    loss = predictor([0], {"map": {"on": 1.0}}, grad=True).signal.square().sum()
    (gradient,) = torch.autograd.grad(loss, Map.values_m)
    step = torch.randn(SHAPE, generator=torch.Generator().manual_seed(2)).double() * 1e-12
    with torch.no_grad():
        Map.values_m += step
        up = predictor([0], {"map": {"on": 1.0}}, grad=True).signal.square().sum()
        Map.values_m -= 2 * step
        down = predictor([0], {"map": {"on": 1.0}}, grad=True).signal.square().sum()
    assert float((gradient * step).sum()) == pytest.approx(float(up - down) / 2, rel=1e-5)


def test_a_camera_with_other_pixels_sees_the_same_light() -> None:
    """Pixels twice as large have the mean of four; a picture cut out is part of the whole."""
    captures = _captures(1)
    whole = Predictor(captures, double_precision=True)([0]).signal[0]
    coarse = dataclasses.replace(
        captures, images=np.zeros((1, *SHAPE), np.uint16), camera=dataclasses.replace(captures.camera, pitch_m=8e-6)
    )
    binned = whole.reshape(SHAPE[0], 2, SHAPE[1], 2).mean(dim=(1, 3))
    torch.testing.assert_close(Predictor(coarse, double_precision=True)([0]).signal[0], binned, rtol=1e-7, atol=1e-9)
    cut = dataclasses.replace(captures, images=np.zeros((1, 20, 30), np.uint16))
    torch.testing.assert_close(
        Predictor(cut, double_precision=True)([0]).signal[0], whole[10:30, 13:43], rtol=1e-7, atol=1e-9
    )


def test_a_bench_that_cant_be_names_the_effect() -> None:
    with pytest.raises(UserError, match=r"effects\.gap"):
        Predictor(_captures())([0], {"gap": {"gap_error": -2e-3}})


def test_a_turned_camera_sees_the_light_beside_the_modulator_too() -> None:
    """By a tiny angle the picture is the same, out to the corners of a camera larger than the modulator."""
    captures = _captures(1)
    large = dataclasses.replace(captures, images=np.zeros((1, 56, 72), np.uint16))
    straight = Predictor(large, double_precision=True)([0]).signal[0]
    turned = Predictor(large, double_precision=True)([0], {"camera_alignment": {"rotation": 1e-9}}).signal[0]
    # Interpolation along rows errs by 1.2e-4 of the sum of the power's waves (`turned_power`).
    assert float((turned - straight).abs().max() / straight.max()) < 2e-4
    torch.testing.assert_close(
        straight[8:48, 8:64], Predictor(captures, double_precision=True)([0]).signal[0], rtol=1e-7, atol=1e-9
    )


def test_beyond_what_is_computed_there_is_no_light() -> None:
    captures = dataclasses.replace(_captures(1), images=np.zeros((1, 120, 150), np.uint16))
    signal = Predictor(captures, double_precision=True)([0]).signal[0]
    assert not bool(signal[:20].any()) and not bool(signal[:, -15:].any())  # of 80 × 120 padded samples
    assert bool(signal[40:80, 50:100].all())


def test_a_part_of_captures_is_predicted_like_the_whole_by_what_differs_from_laser_to_laser() -> None:
    captures, fringes = _captures(), {"camera_fringes": {"path_x": 5e-6, "cos1": 0.1, "cos2": 0.2, "cos3": 0.3}}
    whole = Predictor(captures)(range(len(captures)), fringes).signal
    last = int(captures.wavelength_m.argmax())
    assert captures.laser_number[last] > 0
    part = captures.subset([last, 0]).subset([0])
    assert torch.equal(Predictor(part)([0], fringes).signal[0], whole[last])


@pytest.mark.parametrize(
    ("known", "message"),
    [
        ({"gap": {"gap_error": 1e-4}}, "effects.gap: it needs 2 modulators, there are 1"),
        ({"slm_alignment": {"shift_x": 1e-6}}, "effects.slm_alignment: it needs 2 modulators"),
        ({"distance": {"distance_error": 1e38}}, "effects.distance.distance_error: .*out of range"),
        ({"distance": {"nothing": 1.0}}, "effects.distance.nothing: unknown parameter"),
        ({"nosuch": {}}, "nosuch"),
    ],
)
def test_a_known_effect_that_the_bench_cannot_have_is_refused(
    make_captures: Callable[..., Captures], known: Mapping[str, Mapping[str, float]], message: str
) -> None:
    two = make_captures()
    captures = replace(two, levels=two.levels[:, :1], slms=two.slms[:1], gap_m=None, relay1=Relay())
    check_known_effects(captures, {"distance": {"distance_error": 1e-4}, "laser_power": {}})
    with pytest.raises(UserError, match=message):
        check_known_effects(captures, known)


@pytest.mark.parametrize("effects", [{}, {"camera_alignment": {"rotation": 0.01, "shift_x": 2e-6}}])
@pytest.mark.parametrize("focal_length_m", [None, 9e-3])
def test_a_camera_pixel_that_integrates_is_the_mean_of_its_area(
    effects: dict[str, dict[str, float]], focal_length_m: float | None
) -> None:
    """Against the mean of 12 × 12 points, which errs by (πx/12)²/6 of the contrast of a wave of x periods, 0.002
    for the pixel of a third of a grain here; the places are right to 0.005, and the finest waves are faint.
    Interpolation for a turned camera is good to 1e-4 of the brightest light."""
    captures = dataclasses.replace(
        _captures(1, 1),
        relay2=Relay(iris_na=0.03) if focal_length_m is None else Relay(),
        distance_m=np.full(1, 2e-3 if focal_length_m is None else 0.0),
        camera=Camera(4e-6 if focal_length_m is None else 30e-6, 12, 4.0, 3.0, 64.0, integrates=True),
        focal_length_m=focal_length_m,
    )
    areas = Predictor(captures, double_precision=True)([0], effects).signal[0].numpy()
    points = Predictor(captures, double_precision=True, points=12)([0], effects).signal[0].numpy()
    middle = Predictor(captures, double_precision=True, points=1)([0], effects).signal[0].numpy()
    contrast = points.std()
    assert np.abs(areas - points).max() < 0.02 * contrast and np.abs(areas - points).std() < 0.003 * contrast
    assert np.abs(middle - points).std() > 0.01 * contrast


@pytest.mark.parametrize("grains", [0.1, 0.5, 0.9, 2.0])
def test_the_places_across_a_pixel_average_every_wave(grains: float) -> None:
    """Σ weight·cos(2πxt) is sin(πx)/(πx) for a wave of x periods a pixel, to the stated 0.005."""
    nodes = np.array(pixel_quadrature(grains))
    x = np.linspace(1e-9, grains, 200)
    means = (nodes[:, 1:] * np.cos(2 * np.pi * nodes[:, :1] * x)).sum(axis=0)
    assert np.abs(means - np.sin(np.pi * x) / (np.pi * x)).max() <= 0.0051
    assert nodes[:, 1].min() > 0 and nodes[:, 1].sum() == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("effects", [{}, {"camera_alignment": {"rotation": 0.01}}])
def test_a_camera_pixel_of_a_fourier_bench_averages_points(effects: dict[str, dict[str, float]]) -> None:
    """The mean of 2 × 2 points is the mean of pixels half as large; interpolation for a turned one is good to 1e-4."""
    coarse = dataclasses.replace(
        _captures(1, 1),
        relay2=Relay(),
        distance_m=np.zeros(1),
        camera=Camera(6e-6, 12, 4.0, 3.0, 64.0),
        focal_length_m=9e-3,
    )
    rows, columns = coarse.shape
    fine = dataclasses.replace(
        coarse,
        images=np.full((1, 2 * rows, 2 * columns), 500, np.uint16),
        camera=dataclasses.replace(coarse.camera, pitch_m=3e-6),
    )
    averaged = Predictor(coarse, double_precision=True, points=2)([0], effects).signal[0].numpy()
    points = Predictor(fine, double_precision=True)([0], effects).signal[0].numpy()
    expected = points.reshape(rows, 2, columns, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(averaged, expected, rtol=0, atol=(1e-3 if effects else 1e-9) * expected.max())


@pytest.mark.parametrize("axis_m", [(0.0, 0.0), (0.4e-3, -1.1e-3)])
def test_a_turned_camera_of_a_fourier_bench_sees_the_sum_over_the_modulator(axis_m: tuple[float, float]) -> None:
    """Wherever its axis is: against |Σ t·exp(−2πi·x·r/(λf))|² at each turned pixel, times the envelope of a modulator
    pixel (Goodman, Introduction to Fourier Optics, section 5.2). Interpolation is good to 1e-3 of the brightest light
    (`turned_power`: 1.2e-4 of the sum of the power's waves)."""
    f, wavelength_m = 9e-3, 500e-9
    base = _captures(1, 1)
    captures = dataclasses.replace(
        base,
        images=np.full((1, 30, 70), 500, np.uint16),
        relay2=Relay(),
        distance_m=np.zeros(1),
        wavelength_m=np.full(1, wavelength_m),
        camera=Camera(4e-6, 12, 4.0, 3.0, 64.0),
        focal_length_m=f,
        axis_m=axis_m,
    )
    pose = {"rotation": 0.15, "magnification": 0.05, "shift_y": 3e-6, "shift_x": -5e-6}
    found = Predictor(captures, double_precision=True)([0], {"camera_alignment": pose}).signal[0].numpy()
    y, x = np.meshgrid(*((np.arange(n) - (n - 1) / 2) * 4e-6 for n in captures.shape), indexing="ij")
    y, x = y - axis_m[0] - pose["shift_y"], x - axis_m[1] - pose["shift_x"]
    c, s = np.cos(pose["rotation"]) / 1.05, np.sin(pose["rotation"]) / 1.05
    turned = (c * y - s * x) / (wavelength_m * f), (s * y + c * x) / (wavelength_m * f)
    rows, columns = ((np.arange(n) - (n - 1) / 2) * 8e-6 for n in SHAPE)
    field = np.exp(2j * np.pi * captures.drive(0)[0] * base.slms[0].opd_range_m / wavelength_m)
    along_y, along_x = (
        np.exp(-2j * np.pi * axis[..., None] * places) for axis, places in zip(turned, (rows, columns), strict=True)
    )
    sums = np.einsum("yxr,rc,yxc->yx", along_y, field, along_x)
    expected = np.abs(sums * np.sinc(8e-6 * turned[0]) * np.sinc(8e-6 * turned[1])) ** 2 / field.size
    scale = float((found * expected).sum() / (expected**2).sum())
    assert np.abs(found / scale - expected).max() < 1e-3 * expected.max()
