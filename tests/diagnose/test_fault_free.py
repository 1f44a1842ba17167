"""Benches without a fault are consistent and blame no capture, whatever light their patterns send to the camera.

Benches are drawn by `benchmarks.fault_free`, which measures hundreds of them; a Fourier bench is also measured by an
independent program.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks import real_benches
from benchmarks.fault_free import ARRANGEMENTS, BLURS_PX, SMALLEST, draw, solve
from holoview.bench.captures import Captures, read_captures
from holoview.bench.captures.picture_import import KnownBench, PictureAndPattern, import_pictures
from holoview.bench.captures.records.light import measure_light
from holoview.bench.captures.validation import check_captures
from holoview.bench.captures.virtual_measurement import make_captures
from holoview.bench.diagnose.correct.bad_captures import find_useless_captures
from holoview.bench.diagnose.correct.judged_captures import find_suspects
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.light.model.effects.registry import listed_effects
from holoview.util.units import parse as parse_length
from tests.diagnose.conftest import make_context_of
from tests.diagnose.independent_fourier import FourierLaboratory, write_session
from tests.explored import explored

KINDS = len(ARRANGEMENTS) * len(BLURS_PX)
FEW = ("camera_alignment", "camera_blur", "distance", "stroke", "tilt")
EFFECTS = listed_effects()
SHORT = FourierLaboratory(focal_length_m=0.02)
LONG = FourierLaboratory(opd_m=520e-9, wavelengths_m=(520e-9,), each=12)
"""Rough patterns of a whole turn have no zero order, and send 1/80 of the light of smooth ones to the camera."""


def _measured(folder: Path, lab: FourierLaboratory) -> Captures:
    return read_captures(write_session(folder / "c.h5", lab))


def _diagnosed(captures: Captures) -> Diagnosis:
    return diagnose(captures, [EFFECTS[n] for n in FEW], workers=1, free_maps=False)


@pytest.mark.long
@pytest.mark.parametrize("seed", explored(range(KINDS), 1))
def test_a_bench_without_a_fault_is_consistent(seed: int) -> None:
    """A file is called anything else with a chance of 1e-6, and one of its captures is blamed with 1e-6 at most."""
    found = solve(seed, SMALLEST, [EFFECTS[n] for n in FEW])
    assert found.is_right, found


@pytest.mark.parametrize(
    "kind, noise",
    [
        pytest.param("picture", 5, marks=pytest.mark.explores),
        *(pytest.param(k, 3, marks=() if k == "near" else pytest.mark.explores) for k in real_benches.KINDS),
    ],
)
def test_nor_is_the_area_of_camera_pixels_a_fault(kind: str, noise: int, tmp_path: Path) -> None:
    """Of a simulator that shares no code, whose camera pixels integrate. Of a picture the gain, the black level,
    the axis and the scale are estimated, which are no faults either: with the second noise the black level, which is
    wrong by one count, hid the gain, and light of the room was named."""
    told = json.loads(real_benches.measure(real_benches.draw(3, "none", kind, 64), tmp_path, noise).read_text())
    if kind == "picture":
        option = dict(zip(told["import"][::2], told["import"][1::2], strict=True))
        lengths = {name: parse_length(option[f"--{name}"], name) for name in ("wavelength", "pitch", "camera-pitch")}
        names = ("none-picture-3", "none-picture-3-mask")
        picture, pattern = (np.asarray(Image.open(tmp_path / f"{name}.png")) for name in names)
        focal_length_m = parse_length(option["--focal-length"], "focal length")
        known = KnownBench(
            **{f"{name.replace('-', '_')}_m": length for name, length in lengths.items()}, focal_length_m=focal_length_m
        )
        captures = import_pictures([PictureAndPattern(picture, pattern)], known).captures
    else:
        captures = read_captures(tmp_path / f"none-{kind}-3.h5")
    assert captures.camera.integrates is None
    few = [EFFECTS[n] for n in (*FEW, "camera_black", "ambient")]
    found = diagnose(captures, few, workers=1, free_maps=False)
    assert found.verdict is Verdict.CONSISTENT and not found.causes and not found.bad_captures


@pytest.mark.explores
@pytest.mark.parametrize("seed", range(KINDS, 5 * KINDS))
def test_nor_is_any_effect_found_in_it(seed: int) -> None:
    found = solve(seed, SMALLEST + 16)
    assert found.is_right, found


@pytest.mark.long
@pytest.mark.parametrize("first", explored(range(0, 8 * KINDS, KINDS), 1))
def test_no_capture_of_such_a_bench_stands_out(first: int) -> None:
    """Before a search and after it; of every kind, and larger."""
    for seed in range(first, first + KINDS):
        _, system, settings = draw(10_000 + seed, 64)
        captures = make_captures(system, {}, settings)
        assert not find_useless_captures(captures, {})
        context = make_context_of(captures)
        for is_final in (False, True):
            assert not find_suspects(context, {}, (), is_final=is_final).indices, seed


@pytest.mark.parametrize(
    "lab",
    explored(
        [
            LONG,
            SHORT,
            FourierLaboratory(bits=8, black=3.0),
            FourierLaboratory(bits=16, black=600.0, iris=2e-3),
            FourierLaboratory(smoothness_px=(0.0,), wavelengths_m=(640e-9,)),
            FourierLaboratory(smoothness_px=(6.0,), full_well=2000.0),
            FourierLaboratory(shape=(64, 48), focal_length_m=0.4, wavelengths_m=(450e-9, 520e-9, 600e-9)),
        ],
        1,
    ),
)
def test_nor_is_one_that_an_independent_program_measured(lab: FourierLaboratory, tmp_path: Path) -> None:
    found = _diagnosed(_measured(tmp_path, lab))
    assert found.verdict is Verdict.CONSISTENT and not found.bad_captures and not found.causes


def test_rough_patterns_may_send_a_hundredth_of_the_light_of_smooth_ones(tmp_path: Path) -> None:
    """Their gains are equal within the noise: of 2000 pixels with 80 counts and more, 320 electrons, each."""
    captures = _measured(tmp_path, LONG)
    light = measure_light(captures, {})
    response = light.seen / (captures.power * captures.exposure_s)
    assert response.max() > 30 * response.min()
    assert light.gain == pytest.approx(light.gain.mean(), rel=0.01)


MISHAPS = [
    (dataclasses.replace(LONG, dimmed={3: 0.0}), {3: "dark"}),
    (dataclasses.replace(SHORT, dimmed={4: 0.0}), {4: "dark"}),
    (dataclasses.replace(LONG, overexposed={5: 6.0}), {5: "saturated"}),
    (dataclasses.replace(LONG, exchanged=((3, 6),)), {3: "exchanged with 6", 6: "exchanged with 3"}),
    (dataclasses.replace(SHORT, exchanged=((0, 4),)), {0: "exchanged with 4", 4: "exchanged with 0"}),
    (dataclasses.replace(SHORT, defocused={3: 1e-3}), {3: "out of focus"}),
    (FourierLaboratory(defocused={7: 0.03}), {7: "out of focus"}),
]


@pytest.mark.long
@pytest.mark.parametrize("mishap", explored(MISHAPS, [MISHAPS[n] for n in (0, 2, 4, 5)]))
def test_bad_captures_of_a_fourier_bench_are_found(
    mishap: tuple[FourierLaboratory, dict[int, str]], tmp_path: Path
) -> None:
    lab, reasons = mishap
    found = _diagnosed(_measured(tmp_path, lab))
    assert {bad.index: bad.why for bad in found.bad_captures} == reasons
    assert found.verdict is Verdict.CONSISTENT


@pytest.mark.long
def test_defocus_is_told_within_the_steps_of_the_depth_of_field(tmp_path: Path) -> None:
    """On a Fourier bench the depth is that of light from the modulator's edge: 4λf²/W², here 10 mm. Steps are factors
    of two, of which the nearest on a scale of logarithms is within √2."""
    (bad,) = _diagnosed(_measured(tmp_path, dataclasses.replace(SHORT, defocused={3: 1e-3}))).bad_captures
    told_mm = float(bad.sentence.split("about ")[1].split(" mm")[0])
    assert 1 / 1.5 < told_mm < 1.5


def test_a_fault_that_darkens_all_captures_of_a_kind_blames_none_of_them(tmp_path: Path) -> None:
    """As a stop that nobody knows of takes the light of rough patterns. A single one of them is to blame."""
    rough = range(3, LONG.each, 4)
    captures = _measured(tmp_path, dataclasses.replace(LONG, dimmed=dict.fromkeys(rough, 0.01)))
    assert not find_useless_captures(captures, {})
    captures = _measured(tmp_path, dataclasses.replace(LONG, dimmed={rough[1]: 0.01}))
    assert [(bad.index, bad.why) for bad in find_useless_captures(captures, {})] == [(rough[1], "dark")]


def test_light_that_a_long_exposure_saturates_as_predicted_is_no_fault(tmp_path: Path) -> None:
    """Its record says so; without the record it is one."""
    told = _measured(tmp_path, dataclasses.replace(LONG, overexposed={5: 6.0}))
    exposure = told.exposure_s.copy()
    exposure[5] *= 6.0
    assert not find_useless_captures(dataclasses.replace(told, exposure_s=exposure), {})
    assert [(bad.index, bad.why) for bad in find_useless_captures(told, {})] == [(5, "saturated")]


def test_a_picture_that_is_saturated_all_over_shows_nothing_though_it_is_predicted(tmp_path: Path) -> None:
    captures = _measured(tmp_path, LONG)
    images, exposure = captures.images.copy(), captures.exposure_s.copy()
    images[5], exposure[5] = captures.camera.saturation, 1e4 * exposure[5]
    found = _diagnosed(dataclasses.replace(captures, images=images, exposure_s=exposure))
    assert [(bad.index, bad.why) for bad in found.bad_captures] == [(5, "saturated")]
    assert found.verdict is Verdict.CONSISTENT


def test_pictures_that_noise_leaves_equal_are_no_copies(tmp_path: Path) -> None:
    """Eight bits of dark pixels mostly read the same; a picture with light never does."""
    captures = _measured(tmp_path, FourierLaboratory(bits=8, black=3.0))
    levels, images = captures.levels.copy(), captures.images.copy()
    levels[1], images[:2] = levels[0], 3
    same = dataclasses.replace(captures, levels=levels, images=images)
    assert "duplicate" not in {bad.why for bad in find_useless_captures(same, {})}
    levels[3], images[3] = levels[2], images[2]
    same = dataclasses.replace(captures, levels=levels, images=images)
    assert [bad.index for bad in find_useless_captures(same, {}) if bad.why == "duplicate"] == [3]


def test_light_in_a_thousandth_of_the_pixels_is_light(tmp_path: Path) -> None:
    """Its mean is below the noise of a pixel."""
    captures = _measured(tmp_path, FourierLaboratory())
    images = np.full_like(captures.images, 64)
    images[:, 30:32, 36:39] = 110  # 6 of 4320 pixels, with a mean of 0.06 counts; noise is 0.8
    check_captures(dataclasses.replace(captures, images=images))
