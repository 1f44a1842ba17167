"""Limits of scalar diffraction, of the observer, of sampled lines and sources, and of the eye's pupil."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.colour import to_srgb8
from holoview.effects.source_extent import SourceExtent
from holoview.model import preset
from holoview.model.eye import Eye
from holoview.model.validity import (
    CONTINUUM,
    EVANESCENT,
    EYEBOX,
    LIMITS,
    NEAR_FIELD,
    OBSERVER,
    PIXEL_WAVELENGTHS,
    PIXELS,
    PUPIL_SAMPLES,
    Limit,
    Measured,
    check_plan,
    evanescent_share,
    exceeded_limits,
    pupil_share,
    read_limits,
)
from holoview.numerics.sampling import frequency_indices


def _bench(**changes: Any) -> hv.System:
    return hv.load("holochrome-8-open").edit({"shape": [64, 64], **changes})


def _measured(limit: Limit, **changes: Any) -> Measured:
    measured = limit.measure(hv.make_plan(_bench(**changes)))
    assert measured is not None
    return measured


def _is_kept(limit: Limit, **changes: Any) -> bool:
    return limit.is_kept_by(_measured(limit, **changes).value)


@pytest.mark.parametrize("name", preset.names())
def test_the_model_is_true_of_every_shipped_bench(name: str) -> None:
    for system in (hv.load(name), hv.load(name).with_(eye={})):
        assert exceeded_limits(check_plan(hv.make_plan(system))) == ()


def test_limits_have_names_of_their_own_one_threshold_and_a_reason() -> None:
    assert len({limit.name for limit in LIMITS}) == len(LIMITS)
    assert all((limit.at_least is None) != (limit.at_most is None) and limit.reason for limit in LIMITS)


def test_the_manual_states_every_limit_with_its_threshold() -> None:
    text = (Path(__file__).resolve().parents[3] / "docs" / "physics.md").read_text(encoding="utf-8")
    rows = {cells[1].strip(): cells for line in text.splitlines() if len(cells := line.split("|")) == 6}
    for limit in LIMITS:
        cells = rows[f"{limit.name} (*refused*)" if limit.refuses else limit.name]
        assert cells[3].strip() == limit.threshold.replace("3.14", "π"), limit.name


def test_a_picture_comes_with_what_isnt_true_of_it() -> None:
    system = _bench(upsample=1)
    view = hv.simulate(system, hv.random_drive(system), ["1 mm"], backend="torch")
    assert [note.split(":")[0] for note in view.notes] == ["samples a pixel"]
    assert view.at([0]).exposed(1).notes == view.notes


# --- scalar diffraction ---------------------------------------------------------------------------------------------


def test_pixels_near_the_wavelength_are_told() -> None:
    at_corner = 1 / (math.sqrt(2) * PIXEL_WAVELENGTHS)  # sin θ in the corner of the first order
    assert math.cos(math.asin(at_corner)) == pytest.approx(0.95, abs=1e-12)
    assert not _is_kept(PIXELS, pitch="1.4 um") and _is_kept(PIXELS, pitch="1.5 um")  # 650 nm · 2.26 = 1.47 µm
    assert "1.4 um are 2.2 wavelengths at 650 nm" in _measured(PIXELS, pitch="1.4 um").found


@pytest.mark.parametrize("half_side", [0.5, 0.75, 0.9, 1.0, 1.6])
def test_the_evanescent_share_is_that_of_the_frequencies_that_no_stop_passes(half_side: float) -> None:
    """Counted on the grid of a plan with one sample a pixel, which holds just the first order."""
    λ = 550e-9
    system = _bench(pitch=λ / (2 * half_side), upsample=1, wavelengths=[λ], amplitudes=[[1.0]], planes=["1 um"])
    plan = hv.make_plan(system.with_(gap="0 mm", shape=[128, 128]))
    rows, columns = plan.stop_rows(1, 0), frequency_indices(plan.grid.padded[1])
    passing = (columns >= rows[:, 1:2]) & (columns <= rows[:, 2:])
    # a frequency on the rim counts wholly or not at all: 2π·P·a⁻¹/2 of them in P², half of which are wrong at most
    assert evanescent_share(half_side) == pytest.approx(1 - passing.mean(), abs=4 / plan.grid.padded[0])


def test_evanescent_orders_are_told_at_the_longest_wavelength() -> None:
    assert _is_kept(EVANESCENT, pitch="0.47 um")  # 650 nm/√2 = 0.4596 µm
    assert not _is_kept(EVANESCENT, pitch="0.45 um")
    assert _measured(EVANESCENT, pitch="0.3 um").value == pytest.approx(1 - math.pi / 4 / (0.65 / 0.6) ** 2)


def test_within_a_wavelength_evanescent_waves_are_still_there() -> None:
    assert math.exp(-2 * math.pi * math.sqrt(2 - 1)) == pytest.approx(2e-3, rel=0.1)
    assert not _is_kept(NEAR_FIELD, planes=["0.6 um"]) and _is_kept(NEAR_FIELD, planes=["0.7 um"])
    assert not _is_kept(NEAR_FIELD, gap="0.1 um")
    assert _is_kept(NEAR_FIELD, planes=["0 mm", "1 mm"]), "at 0 it is the light of the modulator itself"
    assert NEAR_FIELD.measure(hv.make_plan(_bench(planes=["0 mm"], gap="0 mm"))) is None


# --- observer and sources -------------------------------------------------------------------------------------------


def test_a_laser_that_changes_no_pixel_of_eight_bits_is_told() -> None:
    bound = OBSERVER.at_least or 0.0
    levels = to_srgb8(np.array([[0.999 * bound] * 3, [1.001 * bound] * 3]))
    assert levels.tolist() == [[0, 0, 0], [1, 1, 1]]
    one = {"amplitudes": [[1.0]]}
    assert not _is_kept(OBSERVER, wavelengths=["780 nm"], **one)
    assert _is_kept(OBSERVER, wavelengths=["700 nm"], **one)
    assert _is_kept(OBSERVER, wavelengths=["780 nm", "550 nm"], amplitudes=[[0.0, 1.0]]), "it isn't lit"
    assert OBSERVER.measure(hv.make_plan(_bench(wavelengths=["980 nm"], observer="mono", **one))) is None


def test_samples_of_a_continuum_revive_beyond_the_limit() -> None:
    """The coherence of n equal samples of a phase range Φ, against sinc(Φ/2) of the continuum."""
    for step, is_near in ((0.5 * math.pi, True), (2 * math.pi, False)):
        phases = step * (np.arange(11) - 5)
        continuum = np.sinc(11 * step / (2 * math.pi))
        assert (abs(np.exp(1j * phases).mean() - continuum) < 0.05) == is_near
        assert (step <= (CONTINUUM.at_most or 0.0)) == is_near


def test_extended_sources_and_broad_lines_beyond_their_samples_are_told() -> None:
    near, far = {"planes": ["2 mm"], "gap": "1 mm"}, {"planes": ["100 mm"], "gap": "1 mm"}
    source, line = {"effects.source_extent.radius": "5 mrad"}, {"effects.bandwidth.sigma": "5 nm"}
    for effect in (source, line):
        assert _is_kept(CONTINUUM, **near, **effect) and not _is_kept(CONTINUUM, **far, **effect)
    assert "source_extent" in _measured(CONTINUUM, **far, **source).found
    assert CONTINUUM.measure(hv.make_plan(_bench())) is None


def test_the_phase_between_directions_is_that_of_their_shift() -> None:
    """A direction shifts the picture by z·θ, which turns the edge of the first order, 1/(2p), by 2π·z·θ/(2p)."""
    system = _bench(planes=["10 mm"], gap="2 mm")
    values = SourceExtent().parameter_values({"radius": 5e-3})
    step = 2 * 5e-3 / SourceExtent().directions_per_side(system, 5e-3)
    assert SourceExtent().sample_phase(system, values) == pytest.approx(2 * math.pi * 12e-3 * step / 16e-6)


# --- the eye --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("centre", "share"),
    [(0.0, 1.0), (0.03, 0.5), (0.05, 0.0), (0.035, (math.acos(0.5) - 0.5 * math.sqrt(0.75)) / math.pi)],
)
def test_the_share_of_a_pupil_in_a_square_is_that_of_a_segment(centre: float, share: float) -> None:
    eye = Eye(eyepiece_m=1.0, pupil_m=12e-3).moved_to((0.0, centre))
    assert pupil_share(eye, 0.01, 0.03) == pytest.approx(share, abs=2e-3)
    assert pupil_share(eye.moved_to((centre, 0.0)), 0.01, 0.03) == pytest.approx(share, abs=5e-3)


def test_a_pupil_beside_the_eyebox_or_beyond_the_samples_is_told() -> None:
    assert _is_kept(EYEBOX, eye={}) and _is_kept(PUPIL_SAMPLES, eye={})
    beside = {"eye": {"pupil": "1 mm", "pupil_x": "1.7 mm"}}  # the eyebox of 460 nm reaches 1.15 mm, of 650 nm 1.63 mm
    assert not _is_kept(EYEBOX, **beside) and _is_kept(PUPIL_SAMPLES, **beside)
    assert "460 nm" in _measured(EYEBOX, **beside).found
    far = {"eye": {"pupil": "1 mm", "pupil_x": "2.2 mm"}}  # the samples hold 2.3 mm at 460 nm
    assert not _is_kept(PUPIL_SAMPLES, **far) and _is_kept(PUPIL_SAMPLES, upsample=4, **far)
    assert EYEBOX.measure(hv.make_plan(_bench())) is None


def test_a_pupil_that_sees_nothing_shows_darkness_and_says_so() -> None:
    system = _bench(eye={"pupil": "0.5 mm", "pupil_x": "8 mm"})
    view = hv.simulate(system, hv.random_drive(system), backend="torch")
    assert not view.intensity.any()
    assert {"pupil beside the eyebox", "pupil beyond the samples"} <= {note.split(":")[0] for note in view.notes}


def test_each_reading_has_its_figure_and_says_in_a_sentence_what_to_do() -> None:
    system = _bench(upsample=1, eye={}, **{"relay2.iris_na": 0.02, "effects.bandwidth.sigma": "1 nm"})
    readings = read_limits(hv.make_plan(system))
    assert next(reading.limit.name for reading in readings if reading.is_exceeded) == "samples a pixel"
    assert all(np.isfinite(reading.measured.value) and ";" in reading.text for reading in readings)
