"""The complex field at each stage of a frame, and patterns saved as the field behind them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import holoview as hv
from holoview.light.model.plan import make_plan
from holoview.util.errors import UserError


def _bench(**changes: Any) -> hv.System:
    return hv.load("holochrome-8").edit(
        {"shape": [24, 32], "wavelengths": ["460 nm", "638 nm"], "amplitudes": [[1.0, 2.0]]} | changes
    )


def _drive(system: hv.System) -> NDArray[Any]:
    return hv.random_drive(system, seed=4)


def test_a_phase_modulator_changes_the_phase_of_the_light_and_nothing_else() -> None:
    system = _bench()
    drive = _drive(system)
    behind = hv.field_at(system, drive, stage="slm1", laser=1)
    turns = np.kron(drive[0, 0].astype(float), np.ones((2, 2))) * system.modulators[0].stroke_m / 638e-9
    # the drive is float32 and the rest is computed in float64: products of a few roundings
    np.testing.assert_allclose(behind.values, np.exp(2j * np.pi * turns), atol=1e-12)
    np.testing.assert_array_equal(hv.field_at(system, drive, stage="light").values, np.ones((48, 64)))


@pytest.mark.parametrize(
    "changes", [{}, {"eye": {}}, {"relay2.iris_na": 0.02, "source": {"directions": [[0.01, 0.0]]}}]
)
def test_the_intensity_is_the_square_of_the_field_in_the_plane_or_on_the_retina(changes: dict[str, Any]) -> None:
    system = _bench(**changes)
    drive, stage = _drive(system), "retina" if "eye" in changes else "plane"
    view = hv.simulate(system, drive, planes=["10 mm"], backend="torch64")
    for laser, power in enumerate([1.0, 2.0]):
        seen = hv.field_at(system, drive, stage=stage, plane="10 mm", laser=laser)
        np.testing.assert_allclose(power * np.abs(seen.values) ** 2, view.intensity[0, laser], rtol=1e-9, atol=1e-12)


def test_the_light_behind_the_stop_is_the_spectrum_of_the_field_that_passes_it() -> None:
    system = _bench(**{"relay2.iris_na": 0.02})
    drive = _drive(system)
    field, passed = (hv.field_at(system, drive, stage=stage) for stage in ("slm2", "stop"))
    padded = make_plan(system).grid.padded
    spectrum = np.fft.fftshift(np.fft.fft2(field.values, s=padded))
    step = 460e-9 / (np.array(padded) * 4e-6)
    assert passed.is_by_direction and passed.step == pytest.approx(tuple(step))
    rows, columns = passed.values.shape
    top, left = padded[0] // 2 - rows // 2, padded[1] // 2 - columns // 2
    inside = spectrum[top : top + rows, left : left + columns]
    sine = np.hypot(
        *np.meshgrid(
            *(np.arange(-(n // 2), n - n // 2) * s for n, s in zip((rows, columns), step, strict=True)), indexing="ij"
        )
    )
    expected = np.where(sine <= 0.02, inside, 0)
    # the grid's offset shifts the phase of the spectrum: moduli are compared
    np.testing.assert_allclose(np.abs(passed.values), np.abs(expected), atol=1e-9 * np.abs(spectrum).max())


def test_a_stage_that_a_bench_lacks_is_refused_with_those_it_has() -> None:
    system = _bench(gap=None, modulators=_bench().modulators[:1])
    with pytest.raises(UserError, match="light, slm1, stop, plane") as caught:
        hv.field_at(system, _drive(system), stage="slm2")
    assert caught.value.where == "stage"
    with pytest.raises(UserError, match="laser: 3; expected 1 to 2"):
        hv.field_at(system, _drive(system), laser=2)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"relay1.square": "first order", "relay2.square": "first order", "eye": {}},
        {"propagation": "compact", "relay2": {"iris_na": 0.02, "dc_block_na": 0.002}},
        {"amplitudes": [[1.0, 0.0], [0.0, 2.0]], "upsample": 3},
    ],
)
def test_the_field_behind_patterns_shows_what_they_show(changes: dict[str, Any]) -> None:
    system = _bench(**changes)
    hologram = hv.Hologram(_drive(system), system)
    field = hv.as_field(hologram)
    assert field.system.is_field and hv.as_field(field) is field
    shown, seen = (hv.simulate(h, backend="torch64") for h in (hologram, field))
    # the field is stored in complex64: 6e-8 of each sample, which averages over the many that interfere
    np.testing.assert_allclose(seen.intensity, shown.intensity, atol=5e-7 * shown.intensity.max())
    np.testing.assert_allclose(seen.xyz, shown.xyz, atol=5e-7 * shown.xyz.max())


def test_fields_of_several_directions_are_not_one_field() -> None:
    system = _bench(source={"directions": [[0.0, 0.0], [0.01, 0.0]]})
    with pytest.raises(UserError, match="2 directions"):
        hv.as_field(hv.Hologram(_drive(system), system))


# --- phases from the axis ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("padding", [2, 3])
@pytest.mark.parametrize("side", [32, 33])
def test_a_symmetric_field_has_a_flat_phase_at_the_stop(side: int, padding: int) -> None:
    """A Gaussian about the middle (N − 1)/2 has a real, positive spectrum, whatever the padded grid."""
    y = (np.arange(side) - (side - 1) / 2) * 8e-6
    gauss = np.exp(-(y[:, None] ** 2 + y**2) / 25e-6**2).astype(np.complex64)
    hologram = hv.load_field(gauss, pitch="8 um", wavelengths="532 nm")
    found = hv.field_at(hologram.system.edit({"padding": padding}), hologram.drive, stage="stop").values
    # complex64 rounds each of the samples by 6e-8 of the brightest
    np.testing.assert_allclose(found, np.abs(found), rtol=0, atol=1e-6 * np.abs(found).max())


def test_the_place_of_a_sample_by_direction_is_stated_behind_a_displaced_iris() -> None:
    """Light that falls in at 4 mrad passes the stop there, on a grid that isn't centred on the axis."""
    system = hv.load_field(np.ones((32, 40), np.complex64), pitch="8 um", wavelengths="532 nm").system
    system = system.edit({"relay2.iris_na": 0.01, "relay2.centre_na": [0.004, -0.002]})
    y, x = ((np.arange(n) - (n - 1) / 2) * 8e-6 for n in (32, 40))
    tilted = np.exp(2j * np.pi * (0.004 * y[:, None] - 0.002 * x) / 532e-9).astype(np.complex64)
    found = hv.field_at(system, tilted[None, None], stage="stop")
    brightest = np.unravel_index(np.abs(found.values).argmax(), found.values.shape)
    at = [first + step * i for first, step, i in zip(found.origin, found.step, brightest, strict=True)]
    assert at == pytest.approx([0.004, -0.002], abs=max(found.step))
    place = hv.field_at(system, tilted[None, None], stage="plane")
    assert place.origin == pytest.approx((y[0], x[0]))


# --- one sample of several --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("effects", "share", "words"),
    [
        ({}, 1.0, ""),
        ({"second_line": {"share": 0.3, "offset": "6 nm"}}, 0.7, "2 spectral lines"),
        ({"polarisation": {"share": 0.6}}, 0.4, "2 samples of the exposure"),
        ({"flicker": {"depth": 0.02}}, 1 / 7, "7 samples of the exposure"),
        ({"second_line": {"share": 0.3, "offset": "6 nm"}, "polarisation": {"share": 0.6}}, 0.28, "2 spectral lines ×"),
    ],
)
def test_a_field_that_is_one_sample_of_several_is_the_nominal_one_and_says_so(
    effects: dict[str, Any], share: float, words: str
) -> None:
    system, drive = _bench(), _drive(_bench())
    for laser in (0, 1):
        found = hv.field_at(system.edit({"effects": effects}), drive, stage="plane", laser=laser)
        plain = hv.field_at(system, drive, stage="plane", laser=laser)
        np.testing.assert_array_equal(found.values, plain.values)
        assert found.wavelength_m == plain.wavelength_m == system.wavelengths_m[laser]
        assert found.share == pytest.approx(share)
        assert words in found.note and (f"{100 * share:.2g} % of the light" in found.note or not words)


def test_the_line_of_a_laser_is_its_strongest_and_a_frame_and_a_direction_are_those_of_the_bench() -> None:
    system = _bench(frames=2, source={"directions": [[0.0, 0.0], ["8 mrad", 0.0]]})
    effects = {"bandwidth": {"sigma": "3 nm"}, "flicker": {"depth": 0.1}, "tilt": {"tilt_x": 0.002}}
    system = system.edit({"effects": effects})
    drive = _drive(system)
    for laser, direction, frame in np.ndindex(2, 2, 2):
        found = hv.field_at(system, drive, stage="slm1", laser=laser, source=direction, frame=frame)
        assert found.wavelength_m == pytest.approx(system.wavelengths_m[laser], abs=1e-15)
        light = hv.field_at(system, drive, stage="light", laser=laser, source=direction, frame=frame).values
        neighbours = (light[1:] / light[:-1]).mean(), (light[:, 1:] / light[:, :-1]).mean()
        sines = np.angle(neighbours) / (2 * np.pi) * found.wavelength_m / 4e-6
        assert sines.tolist() == pytest.approx([np.sin(0.008 * direction), np.sin(0.002)], abs=1e-9)
        turns = np.angle(found.values / light) / (2 * np.pi) * found.wavelength_m / system.modulators[0].stroke_m
        shown = np.kron(drive[frame, 0].astype(float), np.ones((2, 2)))
        assert "samples of the exposure" in found.note
        step = found.wavelength_m / system.modulators[0].stroke_m  # a wave of the phase, in strokes
        off = np.abs((turns - shown + step / 2) % step - step / 2)
        assert off.max() <= 0.1 * np.sqrt(2) * 0.3  # cos φ of the sample of the ripple that is nearest to none


@pytest.mark.parametrize("radius", ["0.2 mrad", "1 mrad", "3 mrad"])
def test_the_light_of_an_extended_source_is_that_of_its_middle(radius: str) -> None:
    system = _bench(source={"directions": [[0.0, 0.0], ["8 mrad", 0.0]]}, effects={"source_extent": {"radius": radius}})
    for direction in (0, 1):
        found = hv.field_at(system, _drive(system), stage="light", source=direction)
        sine = np.angle((found.values[1:] / found.values[:-1]).mean()) / (2 * np.pi) * found.wavelength_m / 4e-6
        assert sine == pytest.approx(np.sin(0.008 * direction), abs=1e-9)
        assert "points of the source" in found.note and found.share <= 1 / 9


def test_a_laser_that_is_off_has_fields_too() -> None:
    system = _bench(amplitudes=[[1.0, 0.0]], effects={"second_line": {"share": 0.3, "offset": "6 nm"}})
    assert hv.field_at(system, _drive(system), laser=1).share == 0.5
