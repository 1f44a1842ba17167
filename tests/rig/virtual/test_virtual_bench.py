"""The light of a virtual bench, against the model of captures and against what it must be analytically."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from holoview.bench.captures import Captures
from holoview.bench.captures.patterns import random_levels
from holoview.bench.captures.predictor import Predictor
from holoview.bench.rig import RigDescription
from holoview.bench.rig.devices import Counts
from holoview.bench.rig.virtual.server import VirtualBench, VirtualSettings, read_virtual_settings
from holoview.util.errors import UserError
from tests.rig.conftest import CAMERA_SHAPE, LASERS_M, SHAPE, MakeRig

SETTLED_S = 1.0
SCATTER = 5 * (2 / math.prod(CAMERA_SHAPE)) ** 0.5
"""Five standard deviations of χ²/n over the pixels of a picture."""


def _bench(rig: RigDescription) -> VirtualBench:
    return VirtualBench(rig, read_virtual_settings(rig))


def _patterns(count: int, sigma: float = 1.5) -> np.ndarray[Any, Any]:
    rng = np.random.default_rng(7)
    return np.stack([[random_levels(rng, SHAPE, 256, sigma) for _ in range(2)] for _ in range(count)])


def _show(bench: VirtualBench, levels: np.ndarray[Any, Any], wait_s: float = SETTLED_S) -> None:
    for number, own in enumerate(levels):
        bench.show(number, own)
    bench.wait(wait_s)


def _session(rig: RigDescription, levels: np.ndarray[Any, Any], picture: Counts, **values: float) -> Captures:
    arrays = {name: np.array([value]) for name, value in values.items()}
    blank = rig.blank_capture()
    return dataclasses.replace(blank, levels=levels[None], images=picture[None], lasers_m=rig.wavelengths_m, **arrays)


def _gain_and_chi2(captures: Captures, effects: dict[str, dict[str, float]]) -> tuple[float, float, float]:
    """Counts per unit of signal, fitted, its standard deviation as a share of it, and χ² a pixel."""
    prediction = Predictor(captures)([0], effects)
    valid = captures.images[0] < captures.camera.saturation
    expected = prediction.signal[0].double().numpy()[valid]
    seen = captures.images[0][valid] - prediction.black_level
    gain = seen.sum() / expected.sum()
    for _ in range(3):
        weight = expected / captures.camera.noise_variance(gain * expected)
        gain = float(weight @ seen) / float(weight @ expected)
    residual = (seen - gain * expected) ** 2 / captures.camera.noise_variance(gain * expected)
    return gain, 1 / (gain * float(weight @ expected) ** 0.5), float(np.mean(residual))


@pytest.mark.parametrize(
    "effects",
    [{}, {"gap": {"gap_error": "0.15 mm"}}, {"crosstalk": {"sigma": 0.4}, "camera_black": {"black": 30.0}}],
    ids=["none", "gap", "two"],
)
def test_pictures_are_the_model_s_to_their_noise(make_rig: MakeRig, effects: dict[str, dict[str, Any]]) -> None:
    rig = make_rig({"virtual": {"effects": effects}})
    bench, levels = _bench(rig), _patterns(1)[0]
    bench.exposure_s, bench.laser = 5e-3, (LASERS_M[0], 0.7)
    bench.move_to(3e-3)
    _show(bench, levels)
    values = {"wavelength_m": LASERS_M[0], "distance_m": 3e-3, "power": 0.7, "exposure_s": 5e-3}
    captures = _session(rig, levels, bench.take(), **values)
    truth = dict(read_virtual_settings(rig).effects)
    assert _gain_and_chi2(captures, truth)[2] == pytest.approx(1, abs=SCATTER)  # type: ignore[arg-type]
    if effects:
        assert _gain_and_chi2(captures, {})[2] > 2


def test_counts_are_proportional_to_power_and_exposure_with_a_scale_for_each_laser(make_rig: MakeRig) -> None:
    rig = make_rig()
    bench, levels = _bench(rig), _patterns(1)[0]
    bench.move_to(3e-3)
    _show(bench, levels)
    gains: dict[float, list[tuple[float, float]]] = {λ: [] for λ in LASERS_M}
    for wavelength in LASERS_M:
        for power, exposure in ((1.0, 4e-3), (0.5, 8e-3), (0.25, 4e-3), (1.0, 1e-3)):
            bench.laser, bench.exposure_s = (wavelength, power), exposure
            values = {"wavelength_m": wavelength, "distance_m": 3e-3, "power": power, "exposure_s": exposure}
            gains[wavelength].append(_gain_and_chi2(_session(rig, levels, bench.take(), **values), {})[:2])
    for own in gains.values():
        for gain, deviation in own:
            assert gain == pytest.approx(own[0][0], rel=5 * math.hypot(deviation, own[0][1]))
            assert deviation < 5e-3
    assert gains[LASERS_M[0]][0][0] != pytest.approx(gains[LASERS_M[1]][0][0], rel=0.02)


def test_the_first_light_of_a_laser_fills_the_range_within_a_frame_s_time_or_so(make_rig: MakeRig) -> None:
    rig = make_rig()
    bench = _bench(rig)
    _show(bench, _patterns(1)[0])
    bench.laser, bench.exposure_s = (LASERS_M[0], 1.0), 1 / 60 / 1.3 / 1.05
    share = (np.quantile(bench.take(), 0.999) - 64) / (4095 - 64)
    assert 0.7 / 1.3 / 1.05 - 0.02 < share < 1.0


@pytest.mark.parametrize("time", [0.0, 0.01, 0.02, 0.06])
def test_what_remains_of_the_pattern_before_falls_exponentially(make_rig: MakeRig, time: float) -> None:
    """The share that explains the picture best is exp(−t/τ)."""
    rig = make_rig({"virtual.settle": 0.02})
    bench, (before, now) = _bench(rig), _patterns(2, sigma=0.0)
    bench.laser, bench.exposure_s = (LASERS_M[0], 1.0), 4e-3
    bench.move_to(3e-3)
    _show(bench, before)
    bench.take()
    _show(bench, now, time)
    values = {"wavelength_m": LASERS_M[0], "distance_m": 3e-3, "power": 1.0, "exposure_s": 4e-3}
    captures = dataclasses.replace(_session(rig, now, bench.take(), **values), levels_before=before[None])
    share = min(math.exp(-time / 0.02), 0.95)

    def chi2(share: float) -> float:
        return _gain_and_chi2(captures, {"settling": {"share1": share, "share2": share}})[2]

    assert chi2(share) == pytest.approx(1, abs=SCATTER)
    assert min(chi2(max(share - 0.02, 0.0)), chi2(share + 0.02)) > 1.2 or share - 0.02 < 0 < chi2(share + 0.02) - 1.2


def test_a_pattern_that_came_before_the_last_had_settled_starts_from_what_was_there(make_rig: MakeRig) -> None:
    """Of two patterns in quick succession, the second one relaxes from where the first one had come."""
    rig = make_rig({"virtual.settle": 0.02, "slm2": None, "geometry.gap": None, "geometry.iris1_na": None})
    bench = _bench(rig)
    first, second, third = _patterns(3)[:, :1]
    _show(bench, first)
    _show(bench, second, 0.02 * math.log(2))
    _show(bench, third, 0.02 * math.log(4))
    expected = 0.75 * third[0] + 0.25 * (0.5 * second[0] + 0.5 * first[0])
    assert bench.levels_now(0) == pytest.approx(expected, abs=1e-9)


def test_a_dark_picture_is_black_level_and_dark_noise(make_rig: MakeRig) -> None:
    rig = make_rig({"virtual": {"effects": {"camera_black": {"black": 7.0}}}})
    bench, camera = _bench(rig), rig.bench.camera
    pictures = np.stack([bench.take() for _ in range(10)]).astype(np.float64)
    assert pictures.mean() == pytest.approx(71, abs=5 * camera.dark_noise / pictures.size**0.5)
    assert pictures.std() == pytest.approx(camera.dark_noise, rel=5 / (2 * pictures.size) ** 0.5)


def test_time_passes_by_waiting_moving_and_exposing_only(make_rig: MakeRig) -> None:
    bench = _bench(make_rig({"virtual.readout": 0.03}))
    _show(bench, _patterns(1)[0], 2.0)
    assert bench.time_s == 2.0
    bench.exposure_s = 0.25
    bench.take()
    assert bench.time_s == pytest.approx(2.28)
    bench.wait(-5.0)
    bench.move_to(5e-3)
    assert bench.time_s == pytest.approx(3.28)  # 5 mm/s


def test_equal_settings_give_equal_counts(make_rig: MakeRig) -> None:
    pictures = []
    for seed in (3, 3, 4):
        bench = _bench(make_rig({"virtual.seed": seed}))
        bench.laser = (LASERS_M[0], 1.0)
        _show(bench, _patterns(1)[0])
        pictures.append(bench.take())
    assert np.array_equal(pictures[0], pictures[1]) and not np.array_equal(pictures[0], pictures[2])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"virtual.seede": 3}, r"virtual\.seede: unknown key; did you mean seed"),
        ({"virtual.settle": -1.0}, r"virtual\.settle: -1 is out of range"),
        ({"virtual.effects": {"gab": {}}}, "gab"),
        ({"virtual.bench": "x.toml"}, r"virtual\.bench: isn't the only key"),
        ({"virtual": {"bench": "x.toml"}}, r"x\.toml"),
        *(
            ({"virtual.laser_log": name}, r"virtual\.laser_log: ")
            for name in ("../lasers.txt", "/etc/lasers.txt", "rig.toml", "lasers", "lasers.txt/x", "lasers\0.txt", 3)
        ),
    ],
)
def test_wrong_settings_are_named(make_rig: MakeRig, changes: dict[str, Any], words: str) -> None:
    with pytest.raises(UserError, match=words):
        read_virtual_settings(make_rig(changes))


def test_a_hidden_effect_that_the_bench_cant_have_is_refused(make_rig: MakeRig) -> None:
    rig = make_rig({"slm2": None, "geometry": {"iris2_na": 0.03}})
    VirtualBench(rig, VirtualSettings())
    hidden = VirtualSettings(effects={"gap": {"gap_error": 1e-4}})
    with pytest.raises(UserError, match=r"effects\.gap: it needs 2 modulators, there are 1"):
        VirtualBench(rig, hidden)
