"""The eye as data: where it is focused, its pupil, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.light.model import preset
from holoview.light.model.focus import focused_planes


def _bench(**eye: Any) -> hv.System:
    return hv.load("holochrome-8").with_(shape=[24, 32], eye=eye)


def test_without_an_eye_every_wavelength_is_seen_in_the_same_plane() -> None:
    plan = hv.make_plan(_bench().with_(eye="none"))
    assert plan.nominal.eye is None
    assert np.array_equal(plan.distances_m, np.repeat(plan.planes_m[:, None], 8, axis=1))


def test_an_eye_focuses_at_the_planes_of_the_bench_unless_told() -> None:
    assert np.array_equal(focused_planes(_bench()), hv.load("holochrome-8").planes_m)


@pytest.mark.parametrize("eyepiece_mm", [25.0, 40.0])
def test_newtons_equation(eyepiece_mm: float) -> None:
    """x·x′ = −f²: what lies x before the front focal plane is imaged x′ behind the back one, where the pupil is."""
    system = _bench(eyepiece=eyepiece_mm * 1e-3, infinity="9 mm", accommodation=["0 D", "1 D", "-1.5 D"])
    f = eyepiece_mm * 1e-3
    expected = [9e-3] + [9e-3 - f * f / (-1 / vergence) for vergence in (1.0, -1.5)]  # the image lies at −1/V
    assert focused_planes(system) == pytest.approx(expected, rel=1e-12)


def test_larger_z_is_nearer_to_the_viewer() -> None:
    eye = hv.Eye()
    assert eye.dioptres(0.011, [0.009]) > eye.dioptres(0.009, [0.009]) == 0
    assert hv.Eye().far_plane_m(np.array([0.011, 0.009, 0.01])) == 0.009


def test_the_chromatic_eye_of_thibos() -> None:
    """−1.72 D from 589 to 400 nm (Thibos et al. 1992); 1.23 D between 450 and 650 nm are 1.97 mm behind 40 mm."""
    refraction = hv.chromatic_refraction(np.array([400e-9, 589e-9, 450e-9, 650e-9]))
    assert refraction[0] - refraction[1] == pytest.approx(-1.72, abs=0.005)
    assert refraction[3] - refraction[2] == pytest.approx(1.232, abs=0.0005)
    shift = hv.Eye().focus_shift_m(np.array([450e-9, 650e-9, 550e-9]))
    assert shift[0] - shift[1] == pytest.approx(1.97e-3, abs=0.005e-3)
    assert shift[2] == 0.0
    assert not hv.Eye(chromatic=False).focus_shift_m(np.array([450e-9])).any()


def test_the_slope_of_focus_is_what_central_differences_approach() -> None:
    eye, step = hv.Eye(), 1e-12
    for wavelength in (450e-9, 550e-9, 650e-9):
        ends = eye.focus_shift_m(np.array([wavelength - step, wavelength + step]))
        assert eye.focus_slope(wavelength) == pytest.approx((ends[1] - ends[0]) / (2 * step), rel=1e-5)


def test_violet_is_seen_nearer_than_red() -> None:
    distances = hv.make_plan(_bench(accommodation=[0.5])).distances_m[0]
    assert np.all(np.diff(distances) < 0)  # wavelengths rise


def test_a_short_sighted_eye_is_focused_nearer_by_its_prescription() -> None:
    plain, myope = (
        hv.make_plan(_bench(prescription=p, chromatic=False)) for p in ({}, {"sphere": -2, "cylinder": 0.5})
    )
    assert myope.distances_m - plain.distances_m == pytest.approx(1.75 * 0.04**2, rel=1e-9)


def test_the_pupil_of_watson_and_yellott() -> None:
    """At age 28.58 that of Stanley & Davies: 7.75 mm in the dark, 2 mm in glare, 7.75 − 5.75/3 mm where L·a = 846."""
    assert hv.natural_pupil_diameter(1e-9, 1.0, 28.58) == pytest.approx(7.75e-3, rel=1e-3)
    assert hv.natural_pupil_diameter(1e12, 1e3, 28.58) == pytest.approx(2e-3, rel=1e-3)
    assert hv.natural_pupil_diameter(8.46, 100.0, 28.58) == pytest.approx((7.75 - 5.75 / 3) * 1e-3, rel=1e-12)
    old, young = (hv.natural_pupil_diameter(8.46, 100.0, age) for age in (70, 20))
    slope = (0.02132 - 0.009562 * (7.75 - 5.75 / 3)) * 1e-3
    assert old - young == pytest.approx(50 * slope, rel=1e-9)


def test_auto_depends_on_luminance_and_field() -> None:
    dark, bright = (hv.Eye(pupil_m="auto", luminance=L).pupil_diameter_m((6e-3, 8e-3)) for L in (1.0, 1000.0))
    assert 2e-3 < bright < dark < 8e-3


def test_a_preset_keeps_the_eye() -> None:
    system = _bench(
        pupil="auto",
        accommodation=["0.25 D"],
        chromatic=False,
        prescription={"axis": 12.5, "aberration": {"Z8": "1 nm"}},
    )
    again = preset.loads(preset.dumps(system))
    assert again == system and hash(again) == hash(system)
    assert again != system.edit({"eye.pupil_x": "0.1 mm"})


def test_an_edit_inside_an_absent_eye_makes_one() -> None:
    system = hv.load("holochrome-8").edit({"eye.pupil": "4 mm", "eye.prescription.sphere": "-1 D"})
    assert system.eye == hv.Eye(pupil_m=4e-3, prescription=hv.Prescription(sphere_dpt=-1.0))


WRONG: list[tuple[dict[str, Any], tuple[str, ...]]] = [
    ({"pupil": 0}, ("eye.pupil: 0 mm", "between 0.5 mm and 12 mm", '"auto"')),
    ({"pupil": "wide"}, ("eye.pupil", '"auto"')),
    ({"eyepiece": "-40 mm"}, ("eye.eyepiece: -40 mm", "between 1 mm and 1000 mm")),
    ({"eyepiece": 0}, ("eye.eyepiece",)),
    ({"eyepiece": "4 mm", "pupil": "8 mm"}, ("eye.eyepiece: 4 mm", "reaches 4 mm", "narrow the pupil")),
    ({"pupil_y": "30 mm", "pupil_x": "30 mm"}, ("eye.eyepiece: 40 mm", "reaches 43.93 mm")),
    ({"accommodation": []}, ("eye.accommodation: an empty list", "0.5 D")),
    ({"accommodation": ["1 mm"]}, ("eye.accommodation[0]", "dioptres")),
    ({"accommodation": ["50 D"]}, ("eye.accommodation[0]: 50 D", "between -30 D and 30 D")),
    ({"chromatic": "yes"}, ("eye.chromatic: 'yes'", "true or false")),
    ({"chromatic_axis": "nose"}, ("eye.chromatic_axis", '"eyepiece" or "pupil"')),
    ({"pupils": "3 mm"}, ("eye.pupils: unknown key", "pupil")),
    ({"prescription": {"axis": 200}}, ("eye.prescription.axis: 200", "between 0 and 180")),
    ({"prescription": 3}, ("eye.prescription", "sphere, cylinder, axis, aberration")),
]


@pytest.mark.parametrize(("eye", "words"), WRONG, ids=str)
def test_what_is_impossible_is_refused(eye: dict[str, Any], words: tuple[str, ...]) -> None:
    with pytest.raises(hv.UserError) as error:
        _bench(**eye)
    assert all(word in str(error.value) for word in words), str(error.value)


@pytest.mark.parametrize(
    ("eye", "words"),
    [
        ({"accommodation": ["-8 D"]}, ("eye: focused at -8 D", "-3.8 mm", "eye.accommodation")),
        ({"accommodation": [30], "eyepiece": "200 mm"}, ("eye: focused at 30 D", "1 m behind")),
        ({"accommodation": [20], "eyepiece": "200 mm"}, ("eye: it sees a plane at 8", "goes straight on", "padding")),
    ],
)
def test_a_focus_before_the_modulator_or_too_far_behind_it_is_refused(
    eye: dict[str, Any], words: tuple[str, ...]
) -> None:
    with pytest.raises(hv.UserError) as error:
        hv.make_plan(_bench(**eye))
    assert all(word in str(error.value) for word in words), str(error.value)


def test_a_plane_that_is_before_the_modulator_for_red_alone_is_refused() -> None:
    with pytest.raises(hv.UserError, match="at 650 nm"):
        hv.make_plan(_bench(), ["0.6 mm"])


def test_invisible_light_has_no_eye() -> None:
    with pytest.raises(hv.UserError, match="without an eye"):
        _bench().with_(wavelengths=["900 nm"], amplitudes=[[1.0]], observer="mono")
