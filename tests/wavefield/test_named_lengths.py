"""Lengths by the names of variables: stems, units, axes, colours, and numbers without a unit."""

from __future__ import annotations

import pytest

from holoview.holograms.fields.interpret.named_lengths import LengthKey, find_named_lengths


@pytest.mark.parametrize(
    ("name", "number", "key", "metres"),
    [
        ("illum_wavelen", 0.66, "wavelengths_m", 0.66e-6),
        ("lambda_nm", 532.0, "wavelengths_m", 532e-9),
        ("wvl", 5.32e-7, "wavelengths_m", 532e-9),
        ("lambda", 6328.0, "wavelengths_m", 632.8e-9),
        ("holo.laserWavelengthUm", 0.4, "wavelengths_m", 0.4e-6),
        ("lambda0", 5.32e-4, "wavelengths_m", 532e-9),
        ("pitch_um", 3.74, "pitch_m", 3.74e-6),
        ("pixelSizeUm", 0.02, "pitch_m", 0.02e-6),
        ("params.pixel_size", 6.5e-6, "pitch_m", 6.5e-6),
        ("spacing", 0.0851, "pitch_m", 0.0851e-6),
        ("PhysicalSizeX", 0.25, "pitch_m", 0.25e-6),
        ("dx", 0.008, "pitch_m", 8e-6),
        ("z_mm", 120.0, "distance_m", 0.12),
        ("prop.dist_cm", 10.0, "distance_m", 0.1),
        ("recDist", 350.0, "distance_m", 0.35),
    ],
)
def test_a_name_and_its_number_are_a_length(name: str, number: float, key: LengthKey, metres: float) -> None:
    found = find_named_lengths({name: (number,)}, {})
    assert [key] == list(found.lengths)
    assert found.lengths[key][0].metres == pytest.approx((metres,), rel=1e-12)


@pytest.mark.parametrize("name", ["dz", "px_count", "n", "radius_mm", "hologram", "lambda_max_iterations", "slm"])
def test_other_names_are_none(name: str) -> None:
    assert not find_named_lengths({name: (5.0,)}, {}).lengths


def test_a_number_that_may_have_two_units_is_a_guess() -> None:
    (length,) = find_named_lengths({"pp": (0.02,)}, {}).lengths["pitch_m"]
    assert not length.is_sure
    assert "taken as mm; in um it would be 20 nm" in length.reason
    (sure,) = find_named_lengths({"pp": (8.0,)}, {}).lengths["pitch_m"]
    assert sure.is_sure


def test_distances_have_the_unit_of_the_other_lengths() -> None:
    for number, unit in ((5.32e-7, 1.0), (5.32e-4, 1e-3)):
        lengths = find_named_lengths({"lambda": (number,), "z": (0.3,)}, {}).lengths
        assert lengths["distance_m"][0].metres == pytest.approx((0.3 * unit,))
        assert lengths["distance_m"][0].is_sure


def test_both_axes_and_all_colours_are_put_together() -> None:
    numbers = {"dx": (8e-6,), "dy": (4e-6,), "lambda_b": (450.0,), "lambda_r": (638.0,), "lambda_g": (520.0,)}
    lengths = find_named_lengths(numbers, {}).lengths
    assert lengths["pitch_m"][0].metres == (4e-6, 8e-6)
    assert lengths["wavelengths_m"][0].metres == pytest.approx((638e-9, 520e-9, 450e-9))


def test_texts_and_attributes_state_units() -> None:
    found = find_named_lengths({"wavelength": (0.633,)}, {"wavelength.units": "um", "holo.pitch": "3.45 um"})
    assert found.lengths["wavelengths_m"][0].metres == pytest.approx((633e-9,))
    assert found.lengths["pitch_m"][0].metres == (3.45e-6,)


def test_a_number_that_contradicts_its_unit_and_an_index_are_told() -> None:
    found = find_named_lengths({"lambda_nm": (5.32e-7,), "medium_index": (1.33,)}, {})
    assert not found.lengths
    assert any("lambda_nm = 5.32e-07" in note and "left out" in note for note in found.notes)
    assert any("--index 1.33" in note for note in found.notes)
