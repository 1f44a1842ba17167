"""What is seen: the contract of `simulate`, `random_drive` and `View`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.light.colour import observer_weights, to_srgb8, xyz_to_linear_srgb


def _system(**changes: Any) -> hv.System:
    return hv.load("holochrome-8").edit(
        {"shape": [6, 8], "wavelengths": ["460 nm", "532 nm", "638 nm"]}
        | {"amplitudes": "white", "gap": "0.2 mm"}
        | changes
    )


@pytest.fixture(scope="module")
def view() -> hv.View:
    system = _system()
    return hv.simulate(system, hv.random_drive(system), planes=["0.1 mm", 2e-4], backend="torch64")


@pytest.mark.parametrize(("backend", "dtype"), [("torch", np.float32), ("torch64", np.float64)])
def test_a_view_has_a_plane_a_wavelength_and_the_simulated_pixels(backend: str, dtype: type) -> None:
    system = _system(upsample=3)
    view = hv.simulate(system, hv.random_drive(system), backend=backend)
    assert view.intensity.shape == (5, 3, 18, 24)
    assert view.intensity.dtype == dtype
    assert view.xyz.shape == view.rgb.shape == view.srgb8.shape == (5, 18, 24, 3)
    assert view.srgb8.dtype == np.uint8
    assert view.pitch_m == pytest.approx(8e-6 / 3, rel=1e-15)
    assert backend.removesuffix("64") in view.backend


def test_a_view_says_where_it_was_taken(view: hv.View) -> None:
    assert view.wavelengths_m.tolist() == [460e-9, 532e-9, 638e-9]
    assert view.planes_m.tolist() == [1e-4, 2e-4]
    assert view.backend == "torch, complex128"


def test_colours_follow_from_intensity_by_the_observers_response(view: hv.View) -> None:
    xyz = np.moveaxis(view.intensity, 1, -1) @ observer_weights("eye", view.wavelengths_m)
    np.testing.assert_allclose(view.xyz, xyz, rtol=1e-12)
    np.testing.assert_allclose(view.rgb, xyz_to_linear_srgb(xyz), rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(view.srgb8, to_srgb8(view.rgb))
    assert view.rgb.min() < 0  # the lasers' colours leave the gamut, and are kept


def test_an_idle_bench_of_no_length_is_white() -> None:
    system = _system(gap=0.0, relay1={}, relay2={})
    view = hv.simulate(system, np.zeros(system.drive_shape), planes=[0.0], backend="torch64")
    np.testing.assert_allclose(view.rgb, 1.0, atol=1e-9)
    assert (view.srgb8 == 255).all()


def test_some_planes_of_a_view_are_chosen_by_index(view: hv.View) -> None:
    far = view.at([1])
    assert far.planes_m.tolist() == [2e-4]
    np.testing.assert_array_equal(far.intensity, view.intensity[1:])
    np.testing.assert_array_equal(far.rgb, view.rgb[1:])


@pytest.mark.parametrize("stops", [-2.0, 0.0, 1.5])
def test_exposure_multiplies_light_by_powers_of_two(view: hv.View, stops: float) -> None:
    exposed = view.exposed(stops)
    np.testing.assert_allclose(exposed.intensity, view.intensity * 2**stops, rtol=1e-15)
    np.testing.assert_allclose(exposed.rgb, view.rgb * 2**stops, rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(exposed.srgb8, to_srgb8(exposed.rgb))
    assert exposed.backend == view.backend


def test_a_mono_camera_sees_grey() -> None:
    system = _system(observer="mono")
    rgb = hv.simulate(system, hv.random_drive(system), backend="torch64").rgb
    np.testing.assert_allclose(rgb, np.repeat(rgb[..., :1], 3, axis=-1), rtol=1e-12)


def test_both_precisions_agree() -> None:
    system = _system()
    drive = hv.random_drive(system)
    single, double = (hv.simulate(system, drive, backend=name).intensity for name in ("torch", "torch64"))
    assert np.linalg.norm(single - double) <= 1e-6 * np.linalg.norm(double)  # measured 4e-7


def test_a_random_drive_is_uniform_over_the_stroke_and_repeats_with_its_seed() -> None:
    system = _system(shape=[60, 80])
    drive = hv.random_drive(system, seed=3)
    assert drive.shape == system.drive_shape and drive.dtype == np.float32
    assert drive.min() >= 0 and drive.max() < 1
    np.testing.assert_array_equal(drive, hv.random_drive(system, seed=3))
    assert (drive != hv.random_drive(system, seed=4)).any()
    assert drive.mean() == pytest.approx(0.5, abs=0.02)  # 9600 values: 7 standard errors
    assert drive.var() == pytest.approx(1 / 12, abs=0.005)


def test_simulating_leaves_the_drive_alone_and_repeats_bit_for_bit() -> None:
    system = _system(levels=4, frames=2)
    drive = hv.random_drive(system)
    before = drive.copy()
    first, second = (hv.simulate(system, drive, backend="torch") for _ in range(2))
    np.testing.assert_array_equal(drive, before)
    np.testing.assert_array_equal(first.intensity, second.intensity)


def test_progress_is_reported_to_the_end() -> None:
    system, seen = _system(), []
    hv.simulate(system, hv.random_drive(system), backend="torch", progress=lambda *now: seen.append(now))
    assert seen[-1] == (3, 3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"backend": "torhc"}, r'backend: "torhc".*did you mean torch'),
        ({"planes": ["-1 mm"]}, r"planes\[0\]: -1 mm"),
        ({"planes": ["1 parsec"]}, r'planes\[0\]: .*"parsec"'),
        ({"drive": np.zeros((1, 1, 6, 8))}, r"drive: .*\(1, 1, 6, 8\).*\(1, 2, 6, 8\)"),
        ({"drive": np.full((1, 2, 6, 8), 2.0)}, "drive: values from 2 to 2; expected 0 to 1"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_what_cannot_be_simulated_is_refused(arguments: dict[str, Any], message: str) -> None:
    system = _system()
    with pytest.raises(hv.UserError, match=message):
        hv.simulate(**({"system": system, "drive": hv.random_drive(system), "backend": "torch"} | arguments))


def test_the_package_offers_what_it_lists_and_nothing_else() -> None:
    assert all(getattr(hv, name) is not None for name in hv.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = hv.nonsense
