"""A file is read as a field or a recording, with what is known of it and why."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.holograms.fields.interpret import strips
from holoview.holograms.fields.interpret.candidates import name_role
from holoview.holograms.fields.interpret.remembered import read_notes
from holoview.holograms.fields.reading import Reading, ReadRequest, read_wavefield, remember
from holoview.holograms.files.request import BinaryLayout, Order
from holoview.util.errors import UserError

WAVES = (640e-9, 532e-9, 473e-9)
KNOWN = ReadRequest(pitch_m=(8e-6, 9e-6), wavelengths_m=WAVES)
GUESSED = ReadRequest(accept_guesses=True)


def _field(*shape: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


def _origins(reading: Reading) -> dict[str, tuple[str, str]]:
    return {p.key: (p.value, p.origin) for p in reading.provenance}


def test_a_field_of_three_colours_is_read_whichever_axis_they_are(tmp_path: Path) -> None:
    u = _field(3, 20, 30)
    np.save(tmp_path / "first.npy", u)
    np.save(tmp_path / "last.npy", np.moveaxis(u, 0, -1))
    np.save(tmp_path / "fortran.npy", np.asfortranarray(u))
    for name in ("first", "last", "fortran"):
        reading = read_wavefield(tmp_path / f"{name}.npy", KNOWN)
        assert reading.kind == "field"
        assert reading.wavefield is not None
        assert np.array_equal(reading.wavefield.values, u[None])
        assert reading.wavefield.pitch_m == (8e-6, 9e-6)


def test_a_region_is_read_and_decimated_by_means(tmp_path: Path) -> None:
    u = _field(3, 20, 30)
    np.save(tmp_path / "u.npy", u)
    request = ReadRequest(pitch_m=(8e-6, 8e-6), wavelengths_m=WAVES, region=(3, 5, 20, 11), decimate=2)
    field = read_wavefield(tmp_path / "u.npy", request).wavefield
    assert field is not None
    expected = u[:, 5:15, 3:23].reshape(3, 5, 2, 10, 2).mean((2, 4))
    # the mean of four numbers of size 1 in two orders: a few roundings of 2⁻²⁴
    np.testing.assert_allclose(field.values[0], expected, atol=8 * 2.0**-24 * 4)
    assert field.pitch_m == (16e-6, 16e-6)


def test_of_too_many_samples_the_middle_is_read_and_said(tmp_path: Path) -> None:
    np.save(tmp_path / "u.npy", np.zeros((1500, 1100), np.complex64))
    reading = read_wavefield([tmp_path / "u.npy"], ReadRequest((1e-6, 1e-6), (532e-9,), most_samples=1 << 20))
    assert reading.wavefield is not None and reading.wavefield.shape == (1024, 1024)
    assert any("--aperture" in note and "--decimate 2" in note for note in reading.notes)


def test_a_large_file_tells_how_much_of_it_is_read_and_can_be_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(strips, "_STRIP_BYTES", 8 * 16 * 32 * 3)  # eight rows of three colours
    np.save(tmp_path / "field.npy", _field(3, 20, 32))
    told: list[tuple[int, int]] = []
    read_wavefield(tmp_path / "field.npy", KNOWN, lambda done, total: told.append((done, total)))
    assert told == [(8, 20), (16, 20), (20, 20)]

    def cancel(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        read_wavefield(tmp_path / "field.npy", KNOWN, cancel)


def test_pitch_and_wavelengths_that_nothing_tells_are_asked_for_with_a_guess(tmp_path: Path) -> None:
    np.save(tmp_path / "u.npy", _field(20, 30))
    with pytest.raises(UserError, match=r"--pitch and --wavelength; e.g. --pitch 8um --wavelength 532nm"):
        read_wavefield(tmp_path / "u.npy")
    reading = read_wavefield(tmp_path / "u.npy", GUESSED)
    assert [question.key for question in reading.questions] == ["pitch", "wavelengths", "distance"]
    assert _origins(reading)["pitch"] == ("8 um", "guessed")


def test_what_is_given_comes_before_what_is_remembered_and_that_before_the_file(tmp_path: Path) -> None:
    path = tmp_path / "u.npz"
    np.savez(path, Hol=_field(20, 30), pp=1e-6, wlen=633e-9, z=0.1)
    assert _origins(read_wavefield(path))["pitch"] == ("1 um", "file")
    notes = remember(path, ReadRequest(pitch_m=(2e-6, 2e-6), conjugated=True))
    remember(path, ReadRequest(distance_m=-0.123))
    assert notes.name == "u.npz.holoview.toml"
    reading = read_wavefield(path)
    assert _origins(reading)["pitch"] == ("2 um", "remembered")
    assert _origins(reading)["distance"] == ("-123 mm", "remembered")
    assert any("contradict" in note for note in reading.notes)
    assert _origins(reading)["sign of the phase"] == ("exp(−iφ)", "remembered")
    reading = read_wavefield(path, ReadRequest(pitch_m=(3e-6, 3e-6)))
    assert _origins(reading)["pitch"] == ("3 um", "given")


def test_wavelengths_are_divided_by_the_index_of_refraction(tmp_path: Path) -> None:
    np.save(tmp_path / "u.npy", _field(20, 30))
    request = ReadRequest(pitch_m=(1e-6, 1e-6), wavelengths_m=(532e-9,), refractive_index=1.52)
    field = read_wavefield(tmp_path / "u.npy", request).wavefield
    assert field is not None
    assert field.wavelengths_m[0] == pytest.approx(350e-9)


def test_numbers_that_are_not_finite_are_refused_with_their_place(tmp_path: Path) -> None:
    u = _field(20, 30)
    u[7, 11] = np.nan
    np.save(tmp_path / "u.npy", u)
    with pytest.raises(UserError, match=r"nan.* at row 7, column 11"):
        read_wavefield(tmp_path / "u.npy", GUESSED)


def test_complex_numbers_are_of_no_other_quantity(tmp_path: Path) -> None:
    np.save(tmp_path / "u.npy", _field(20, 30))
    with pytest.raises(UserError, match="the numbers are complex, not of the quantity phase"):
        read_wavefield(tmp_path / "u.npy", replace(GUESSED, quantity="phase"))


def test_a_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in (tmp_path, "."):  # the second has no name that notes could stand beside
        with pytest.raises(UserError, match="is a folder"):
            read_wavefield(name)


def test_pickled_objects_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "u.npy", np.array([{"a": 1}, None]), allow_pickle=True)
    with pytest.raises(UserError, match="pickled"):
        read_wavefield(tmp_path / "u.npy", GUESSED)


@pytest.mark.parametrize(
    ("role", "names"),
    [
        ("real", "re u_re sampleComplexH_re holoReal realPart"),
        ("imaginary", "im u_imag imaginary sampleComplexH_im"),
        ("amplitude", "amp dice_ampli ampl fieldAmplitude example_amplitude"),
        ("phase", "phase phase_only_hologram_example sample_phase doll_phi POH bilevel_phase"),
        ("intensity", "intensity meanIntensity"),
        ("bilevel", "Hbin bilevel"),
        ("", "example sample resampling oversampled amplified camp image01 images imaging realistic realtime"),
        ("", "phase_shift_2 phase-step4 phase_from_intensity amp_and_phase hologram"),
    ],
)
def test_only_a_word_of_a_name_states_a_quantity(role: str, names: str) -> None:
    assert {name: name_role(name) for name in names.split()} == dict.fromkeys(names.split(), role)


def test_steps_and_orders_are_remembered_with_their_recording(tmp_path: Path) -> None:
    known = {"pitch_m": (8e-6, 8e-6), "wavelengths_m": (532e-9,), "recording": "phase-shifting"}
    pictures = np.random.default_rng(0).random((3, 24, 32)) + 1
    np.save(tmp_path / "set.npy", pictures)
    steps, order = (0.0, 1.0, 2.5), Order((0.1, -0.2), 0.05)
    remember(tmp_path / "set.npy", ReadRequest(**known, steps=steps))
    found = read_wavefield(tmp_path / "set.npy").recording
    assert found is not None and found.steps == pytest.approx(steps)
    unlike = read_wavefield(tmp_path / "set.npy", ReadRequest(recording="in-line")).recording
    assert unlike is not None and unlike.steps == "equal"
    remember(tmp_path / "set.npy", ReadRequest(recording="off-axis", orders=(order,)))
    found = read_wavefield(tmp_path / "set.npy").recording
    assert found is not None and found.orders == (order,) and found.kind == "off-axis"


def test_what_a_file_is_survives_its_notes_and_what_was_wanted_of_it_does_not(tmp_path: Path) -> None:
    known: dict[str, Any] = {
        "pitch_m": (8e-6, 7.1e-6),
        "wavelengths_m": (640e-9, 532e-9),
        "distance_m": -0.123,
        "reference_radius_m": 0.3,
        "quantity": "phase",
        "variable": "a,b",
        "parts": ("amplitude", "phase"),
        "recording": "off-axis",
        "orders": (Order((0.1, -0.2), 0.05), Order((0.3, 0.2), 0.07)),
        "dark_field": False,
        "refractive_index": 1.5,
        "conjugated": True,
        "checkerboard": False,
        "phase_levels": 255.0,
        "colour_axis": "last",
        "transposed": True,
        "colour_shifts_m": ((0.0, 0.0), (12e-6, -3.5e-6)),
        "binary": BinaryLayout("<f4", (20, 30), None, "F", ("real", "imaginary"), False),
    }
    wishes: dict[str, Any] = {"region": (1, 2, 3, 4), "decimate": 2, "accept_guesses": True, "propagation": "asm"}
    remember(tmp_path / "u.npy", ReadRequest(**known, **wishes))
    assert read_notes(tmp_path / "u.npy") == ReadRequest(**known)


def test_an_order_says_that_the_recording_is_off_axis(tmp_path: Path) -> None:
    np.save(tmp_path / "fringes.npy", np.random.default_rng(0).random((24, 32)))
    request = ReadRequest((8e-6, 8e-6), (532e-9,), orders=(Order((0.1, 0.2), 0.05),))
    found = read_wavefield(tmp_path / "fringes.npy", request).recording
    assert found is not None and found.kind == "off-axis"
    with pytest.raises(UserError, match="--order: with the recording in-line"):
        read_wavefield(tmp_path / "fringes.npy", replace(request, recording="in-line"))
    with pytest.raises(UserError, match="--dark-field: with the recording off-axis"):
        read_wavefield(tmp_path / "fringes.npy", replace(request, dark_field=True))
    with pytest.raises(UserError, match="--steps: with no recording"):
        read_wavefield(tmp_path / "fringes.npy", replace(request, orders=(), steps="unknown"))


def test_a_wavelength_in_the_unit_of_a_pitch_is_refused_as_a_wavelength() -> None:
    with pytest.raises(UserError, match="wavelength: 532000 nm"):
        ReadRequest(wavelengths_m=(532e-6,))
