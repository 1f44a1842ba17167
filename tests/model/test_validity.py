"""What the grid can't hold, against finer and larger grids and against closed forms."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.light.colour import to_srgb8
from holoview.light.effects.illumination import SourceExtent, directions_per_side
from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.model import preset
from holoview.light.model.eye import Eye
from holoview.light.model.passband import band_limit, frequencies_left
from holoview.light.model.validity import (
    LIMITS,
    PIXEL_WAVELENGTHS,
    Measured,
    check_plan,
    envelope_excess,
    evanescent_share,
    exceeded_limits,
    pupil_share,
    read_limits,
)
from holoview.light.numerics.sampling import frequency_indices
from holoview.light.optics.frame_inputs import FrameInputs

_GREEN = {"wavelengths": ["550 nm"], "amplitudes": [[1.0]], "observer": "mono"}


def _bench(shape: tuple[int, int] = (32, 32), **changes: Any) -> hv.System:
    return hv.load("holochrome-8-open").edit({**_GREEN, "shape": shape, "planes": ["3 mm"], "gap": "1 mm", **changes})


def _value(limit: str, system: hv.System) -> float:
    measured = LIMITS[limit].measure(hv.make_plan(system))
    assert measured is not None
    return measured.value


def _is_kept(limit: str, system: hv.System) -> bool:
    return LIMITS[limit].is_kept_by(_value(limit, system))


def _intensity(system: hv.System) -> np.ndarray:
    """The intensity of random patterns, whatever the limits say."""
    plan = hv.make_plan(system)
    executor = TorchExecutor(plan, FrameInputs(plan, hv.random_drive(system, 1)), double=True)
    return np.asarray(compute_focal_stack(executor)[0][0, 0])


def _error(system: hv.System, reference: hv.System) -> float:
    right = _intensity(reference)
    return float(np.linalg.norm(_intensity(system) - right) / np.linalg.norm(right))


# --- band limit -----------------------------------------------------------------------------------------------------


def test_far_away_the_frequencies_left_are_a_fresnel_number() -> None:
    side, far = 512 * 4e-6, 0.7  # (P·dx)²/(2λz), to the order (P·dx/2z)² of the square root
    left = frequencies_left((400, 512), 4e-6, 550e-9, far)
    assert left == pytest.approx(side**2 / (2 * 550e-9 * far), rel=(side / far) ** 2)


@pytest.mark.parametrize("pitch", ["0.1 um", "0.3 um"])
def test_pixels_of_which_only_the_zero_order_is_left_are_refused(pitch: str) -> None:
    system = _bench((96, 128), pitch=pitch, planes=["10 mm"])
    with pytest.raises(hv.UserError, match="nothing but light that goes straight on") as error:
        hv.simulate(system, hv.random_drive(system), backend="torch")
    assert error.value.where == "planes" and "padding" in error.value.remedy


def test_below_one_frequency_every_pattern_gives_a_uniform_picture_and_above_it_does_not() -> None:
    for pitch, is_uniform in (("1 um", True), ("2 um", False)):  # 0.37 and 1.5 frequencies
        system = _bench((32, 32), pitch=pitch, planes=["10 mm"], gap="0 mm")
        picture = _intensity(system)
        assert _is_kept("band left", system) != is_uniform
        assert (picture.std() < 1e-9 * picture.mean()) == is_uniform


def test_a_gap_that_leaves_nothing_is_refused_too() -> None:
    with pytest.raises(hv.UserError, match="gap: light goes on") as error:
        check_plan(hv.make_plan(_bench((32, 32), pitch="1 um", planes=["1 mm"], gap="10 mm")))
    assert "10 mm" in error.value.found


def test_a_periodic_grid_has_no_band_limit() -> None:
    plan = hv.make_plan(_bench(pitch="1 um", planes=["100 mm"], propagation="periodic"))
    assert LIMITS["band left"].measure(plan) is None and LIMITS["band limit"].measure(plan) is None
    check_plan(plan)


@pytest.mark.parametrize(("plane", "is_kept"), [("1 mm", True), ("10 mm", False), ("30 mm", False)])
def test_where_the_band_limit_cuts_the_first_order_eightfold_padding_shows_another_picture(
    plane: str, is_kept: bool
) -> None:
    """Against 8-fold padding, which cuts nothing here: 0.86 ± 0.03 %, 19 ± 1.5 % and 35 ± 6 % (10 seeds); the rest of a
    kept limit is from the tails of the kernel, which fall with the number of frequencies. A tenth is 6 σ below 19 %;
    the 35 % are skew, and the least of ten was 27 %."""
    system = _bench(planes=[plane])
    assert _is_kept("band limit", system) == is_kept
    error = _error(system, system.with_(padding=8))
    assert error < 0.05 if is_kept else error > 0.1


def test_the_band_limit_is_stated_in_half_widths_of_the_first_order() -> None:
    plan = hv.make_plan(_bench(planes=["30 mm"], **{"relay2.square": "0.5 first order"}))
    limit = band_limit(plan.grid.padded[0], plan.grid.pitch_m, 550e-9, 30e-3)
    assert _value("band limit", _bench(planes=["30 mm"])) == pytest.approx(limit * 2 * 8e-6, rel=1e-12)
    measured = LIMITS["band limit"].measure(plan)
    assert measured is not None
    assert measured.value == pytest.approx(limit * 4 * 8e-6, rel=1e-12), "a stop of half the width is cut half as much"


# --- wrap-around ----------------------------------------------------------------------------------------------------


def test_light_that_wraps_around_makes_another_picture() -> None:
    """Measured: an error of 1.9 times the intensity, in L2: nearly all light of so small a modulator leaves it."""
    system = _bench(planes=["3 mm"], propagation="periodic")
    assert _value("wrap-around", system) > 0.5
    assert _error(system, _bench(planes=["3 mm"])) > 0.3
    assert LIMITS["wrap-around"].measure(hv.make_plan(_bench())) is None
    assert _is_kept("wrap-around", _bench(planes=["0 mm"], gap="0 mm", propagation="periodic"))


# --- samples a pixel ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("upsample", [1, 2, 4])
@pytest.mark.parametrize("cycles", [0.1, 0.5])
def test_the_envelope_of_a_sampled_pixel_is_that_of_its_transform(upsample: int, cycles: float) -> None:
    sampled = np.exp(-2j * np.pi * cycles * np.arange(upsample) / upsample).mean()
    fine = np.exp(-2j * np.pi * cycles * (np.arange(4096) + 0.5) / 4096).mean()
    assert envelope_excess(upsample, cycles) == pytest.approx(abs(sampled / fine) ** 2 - 1, abs=1e-6)


def test_one_sample_a_pixel_is_told_and_two_are_not() -> None:
    assert not _is_kept("samples a pixel", _bench(upsample=1)) and _is_kept("samples a pixel", _bench(upsample=2))
    narrow = {"relay1.square": "0.5 first order", "relay2.square": "0.5 first order"}
    assert _is_kept("samples a pixel", _bench(upsample=1, **narrow)), "the edge isn't seen: 1/sinc²(1/4) − 1 = 23 %"


def test_one_sample_a_pixel_is_worse_than_two() -> None:
    """Intensity of whole pixels against eight samples a pixel, in L2: measured 105 % and 32 %."""
    pictures = {u: _intensity(_bench(upsample=u, planes=["0.5 mm"])) for u in (1, 2, 8)}
    blocks = {u: p.reshape(32, u, 32, u).mean(axis=(1, 3)) for u, p in pictures.items()}
    errors = {u: np.linalg.norm(blocks[u] - blocks[8]) / np.linalg.norm(blocks[8]) for u in (1, 2)}
    assert errors[1] > 1.5 * errors[2]


# --- stops and oblique light ----------------------------------------------------------------------------------------


def test_stops_may_reach_as_far_as_the_samples_hold_light() -> None:
    edge = 550e-9 / (2 * 4e-6)
    assert _value("stops beyond the samples", _bench(**{"relay2.iris_na": 2 * edge})) == pytest.approx(2.0)
    assert _is_kept("stops beyond the samples", _bench(**{"relay2.iris_na": 0.99 * edge}))
    assert not _is_kept(
        "stops beyond the samples",
        _bench(**{"relay2.iris_na": 0.99 * edge, "relay2.centre_na": [0.0, 0.02 * edge]}),
    )
    assert LIMITS["stops beyond the samples"].measure(hv.make_plan(_bench())) is None, (
        "a bench without stops has none beyond the samples"
    )


def test_light_of_more_than_half_a_turn_a_sample_is_that_of_another_direction() -> None:
    """550 nm/4 µm is a turn a sample: from an angle of 0.75 turns it is the light of −0.25 turns."""
    turn = 550e-9 / 4e-6
    steep, gentle = (_bench(**{"source.directions": [[0.0, float(np.arcsin(t * turn))]]}) for t in (0.75, -0.25))
    assert not _is_kept("oblique light", steep) and _is_kept("oblique light", gentle)
    assert _error(steep, gentle) < 1e-9


@pytest.mark.parametrize(
    ("stops", "words"),
    [
        ({"relay2.iris_na": 0.01, "relay2.centre_na": [0.3, 0.0]}, "relay2: no light passes its stops"),
        ({"relay2.iris_na": 1.5e-3, "relay2.dc_block_na": 1.4e-3}, "relay2: no light passes its stops"),
    ],
)
def test_stops_that_leave_nothing_are_refused(stops: dict[str, Any], words: str) -> None:
    system = _bench(**stops)
    assert not _is_kept("light left", system)
    with pytest.raises(hv.UserError, match=words):
        hv.simulate(system, hv.random_drive(system), backend="torch")


def test_one_frequency_is_a_uniform_picture_and_two_are_not() -> None:
    """A step of frequency is 550 nm/512 µm = 1.07e-3 as a direction sine."""
    for na, is_uniform in ((1e-3, True), (1.1e-3, False)):
        system = _bench(**{"relay2.iris_na": na})
        picture = _intensity(system)
        assert _is_kept("light left", system)
        assert _is_kept("stops on the grid", system) != is_uniform
        assert (picture.std() < 1e-9 * picture.mean()) == is_uniform


# --- single precision -----------------------------------------------------------------------------------------------


@pytest.mark.gpu
def test_single_precision_loses_what_the_limit_says() -> None:
    """The worst phase of the steepest light bounds the error: the intensity of an interference changes by 2 of it."""
    near = _bench(planes=["3 mm"], propagation="periodic")
    far = _bench(planes=["800 mm"], pitch="1 um", propagation="periodic", gap="0 mm")
    for system, is_kept in ((near, True), (far, False)):
        drive = hv.random_drive(system, 1)
        right = hv.simulate(system, drive, backend="torch64").intensity
        error = np.linalg.norm(hv.simulate(system, drive, backend="wgpu").intensity - right) / np.linalg.norm(right)
        limit = _value("single precision", system)
        assert _is_kept("single precision", system) == is_kept
        assert error < 2 * limit + 2e-6
        assert is_kept or error > limit / 100, "the limit isn't far from what happens"


def _broad_bench(**changes: Any) -> hv.System:
    return hv.load("holochrome-8-open").edit({"shape": [64, 64], **changes})


def _measured(limit: str, **changes: Any) -> Measured:
    measured = LIMITS[limit].measure(hv.make_plan(_broad_bench(**changes)))
    assert measured is not None
    return measured


def _is_kept_of_a_broad_bench(limit: str, **changes: Any) -> bool:
    return LIMITS[limit].is_kept_by(_measured(limit, **changes).value)


@pytest.mark.parametrize("name", preset.names())
def test_the_model_is_true_of_every_shipped_bench(name: str) -> None:
    for system in (hv.load(name), hv.load(name).with_(eye={})):
        assert exceeded_limits(check_plan(hv.make_plan(system))) == ()


def test_limits_have_names_of_their_own_one_threshold_and_a_reason() -> None:
    assert len({limit.name for limit in LIMITS.values()}) == len(LIMITS)
    assert all((limit.at_least is None) != (limit.at_most is None) and limit.reason for limit in LIMITS.values())


def test_the_manual_states_every_limit_with_its_threshold() -> None:
    text = (Path(__file__).resolve().parents[2] / "docs" / "physics.md").read_text(encoding="utf-8")
    rows = {cells[1].strip(): cells for line in text.splitlines() if len(cells := line.split("|")) == 6}
    for limit in LIMITS.values():
        cells = rows[f"{limit.name} (*refused*)" if limit.refuses else limit.name]
        assert cells[3].strip() == limit.threshold.replace("3.14", "π"), limit.name


def test_a_picture_comes_with_what_isnt_true_of_it() -> None:
    system = _broad_bench(upsample=1)
    view = hv.simulate(system, hv.random_drive(system), ["1 mm"], backend="torch")
    assert [note.split(":")[0] for note in view.notes] == ["samples a pixel"]
    assert view.at([0]).exposed(1).notes == view.notes


# --- scalar diffraction ---------------------------------------------------------------------------------------------


def test_pixels_near_the_wavelength_are_told() -> None:
    at_corner = 1 / (math.sqrt(2) * PIXEL_WAVELENGTHS)  # sin θ in the corner of the first order
    assert math.cos(math.asin(at_corner)) == pytest.approx(0.95, abs=1e-12)
    assert not _is_kept_of_a_broad_bench("pixels near the wavelength", pitch="1.4 um") and _is_kept_of_a_broad_bench(
        "pixels near the wavelength", pitch="1.5 um"
    )  # 650 nm · 2.26 = 1.47 µm
    assert "1.4 um are 2.2 wavelengths at 650 nm" in _measured("pixels near the wavelength", pitch="1.4 um").found


@pytest.mark.parametrize("half_side", [0.5, 0.75, 0.9, 1.0, 1.6])
def test_the_evanescent_share_is_that_of_the_frequencies_that_no_stop_passes(half_side: float) -> None:
    """Counted on the grid of a plan with one sample a pixel, which holds just the first order."""
    λ = 550e-9
    system = _broad_bench(pitch=λ / (2 * half_side), upsample=1, wavelengths=[λ], amplitudes=[[1.0]], planes=["1 um"])
    plan = hv.make_plan(system.with_(gap="0 mm", shape=[128, 128]))
    rows, columns = plan.stop_rows(1, 0), frequency_indices(plan.grid.padded[1])
    passing = (columns >= rows[:, 1:2]) & (columns <= rows[:, 2:])
    # a frequency on the rim counts wholly or not at all: 2π·P·a⁻¹/2 of them in P², half of which are wrong at most
    assert evanescent_share(half_side) == pytest.approx(1 - passing.mean(), abs=4 / plan.grid.padded[0])


def test_evanescent_orders_are_told_at_the_longest_wavelength() -> None:
    assert _is_kept_of_a_broad_bench("evanescent orders", pitch="0.47 um")  # 650 nm/√2 = 0.4596 µm
    assert not _is_kept_of_a_broad_bench("evanescent orders", pitch="0.45 um")
    assert _measured("evanescent orders", pitch="0.3 um").value == pytest.approx(1 - math.pi / 4 / (0.65 / 0.6) ** 2)


def test_within_a_wavelength_evanescent_waves_are_still_there() -> None:
    assert math.exp(-2 * math.pi * math.sqrt(2 - 1)) == pytest.approx(2e-3, rel=0.1)
    assert not _is_kept_of_a_broad_bench("near field", planes=["0.6 um"]) and _is_kept_of_a_broad_bench(
        "near field", planes=["0.7 um"]
    )
    assert not _is_kept_of_a_broad_bench("near field", gap="0.1 um")
    assert _is_kept_of_a_broad_bench("near field", planes=["0 mm", "1 mm"]), (
        "at 0 it is the light of the modulator itself"
    )
    assert LIMITS["near field"].measure(hv.make_plan(_broad_bench(planes=["0 mm"], gap="0 mm"))) is None


# --- observer and sources -------------------------------------------------------------------------------------------


def test_a_laser_that_changes_no_pixel_of_eight_bits_is_told() -> None:
    bound = LIMITS["observer's response"].at_least or 0.0
    levels = to_srgb8(np.array([[0.999 * bound] * 3, [1.001 * bound] * 3]))
    assert levels.tolist() == [[0, 0, 0], [1, 1, 1]]
    one = {"amplitudes": [[1.0]]}
    assert not _is_kept_of_a_broad_bench("observer's response", wavelengths=["780 nm"], **one)
    assert _is_kept_of_a_broad_bench("observer's response", wavelengths=["700 nm"], **one)
    assert _is_kept_of_a_broad_bench(
        "observer's response", wavelengths=["780 nm", "550 nm"], amplitudes=[[0.0, 1.0]]
    ), "it isn't lit"
    assert (
        LIMITS["observer's response"].measure(
            hv.make_plan(_broad_bench(wavelengths=["980 nm"], observer="mono", **one))
        )
        is None
    )


def test_samples_of_a_continuum_revive_beyond_the_limit() -> None:
    """The coherence of n equal samples of a phase range Φ, against sinc(Φ/2) of the continuum."""
    for step, is_near in ((0.5 * math.pi, True), (2 * math.pi, False)):
        phases = step * (np.arange(11) - 5)
        continuum = np.sinc(11 * step / (2 * math.pi))
        assert (abs(np.exp(1j * phases).mean() - continuum) < 0.05) == is_near
        assert (step <= (LIMITS["samples of lines and sources"].at_most or 0.0)) == is_near


def test_extended_sources_and_broad_lines_beyond_their_samples_are_told() -> None:
    near, far = {"planes": ["2 mm"], "gap": "1 mm"}, {"planes": ["100 mm"], "gap": "1 mm"}
    source, line = {"effects.source_extent.radius": "5 mrad"}, {"effects.bandwidth.sigma": "5 nm"}
    for effect in (source, line):
        assert _is_kept_of_a_broad_bench(
            "samples of lines and sources", **near, **effect
        ) and not _is_kept_of_a_broad_bench("samples of lines and sources", **far, **effect)
    assert "source_extent" in _measured("samples of lines and sources", **far, **source).found
    assert LIMITS["samples of lines and sources"].measure(hv.make_plan(_broad_bench())) is None


def test_samples_of_a_line_are_judged_at_the_planes_that_are_asked_for() -> None:
    """The phase between the samples of a line grows with the distance, whichever planes the bench has."""
    system = _broad_bench(**{"planes": ["2 mm"], "gap": "1 mm", "effects.bandwidth.sigma": "5 nm"})
    limit = LIMITS["samples of lines and sources"]
    near, far = (limit.measure(hv.make_plan(system, planes)) for planes in (None, ["2 mm", "100 mm"]))
    assert near is not None and far is not None
    assert far.value == pytest.approx(limit_of(system.edit({"planes": ["2 mm", "100 mm"]})), rel=1e-12)
    assert far.value > 10 * near.value


def limit_of(system: hv.System) -> float:
    """The phase between samples of lines and sources at a bench's own planes."""
    return _value("samples of lines and sources", system)


def test_the_phase_between_directions_is_that_of_their_shift() -> None:
    """A direction shifts the picture by z·θ, which turns the edge of the first order, 1/(2p), by 2π·z·θ/(2p)."""
    system = _broad_bench(planes=["10 mm"], gap="2 mm")
    values = SourceExtent().parameter_values({"radius": 5e-3})
    step = 2 * 5e-3 / directions_per_side(system, 5e-3)
    assert SourceExtent().sample_phase(system, values) == pytest.approx(2 * math.pi * 12e-3 * step / 16e-6)


@pytest.mark.parametrize("effect", ["effects.source_extent.radius", "effects.bandwidth.sigma"])
def test_the_phase_between_samples_is_the_same_on_both_sides_of_a_field(effect: str) -> None:
    """The phase grows with the way that light goes, forth or back; planes further away on either side count."""
    plane = hv.Modulator("8 um", (64, 64), content="field")
    value = "5 mrad" if "radius" in effect else "5 nm"
    field = hv.System(
        ["520 nm"], [[1.0]], [plane], planes_m=["3 mm"], observer="mono", sampling=hv.Sampling(upsample=1)
    )
    field = field.edit({effect: value})
    phases = [limit_of(field.edit({"planes": planes})) for planes in (["20 mm"], ["-20 mm"], ["-20 mm", "1 mm"])]
    assert phases[0] > 0
    assert phases[1:] == pytest.approx([phases[0]] * 2, rel=1e-12)


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
    assert _is_kept_of_a_broad_bench("pupil beside the eyebox", eye={}) and _is_kept_of_a_broad_bench(
        "pupil beyond the samples", eye={}
    )
    beside = {"eye": {"pupil": "1 mm", "pupil_x": "1.7 mm"}}  # the eyebox of 460 nm reaches 1.15 mm, of 650 nm 1.63 mm
    assert not _is_kept_of_a_broad_bench("pupil beside the eyebox", **beside) and _is_kept_of_a_broad_bench(
        "pupil beyond the samples", **beside
    )
    assert "460 nm" in _measured("pupil beside the eyebox", **beside).found
    far = {"eye": {"pupil": "1 mm", "pupil_x": "2.2 mm"}}  # the samples hold 2.3 mm at 460 nm
    assert not _is_kept_of_a_broad_bench("pupil beyond the samples", **far) and _is_kept_of_a_broad_bench(
        "pupil beyond the samples", upsample=4, **far
    )
    assert LIMITS["pupil beside the eyebox"].measure(hv.make_plan(_broad_bench())) is None


def test_a_pupil_that_sees_nothing_shows_darkness_and_says_so() -> None:
    system = _broad_bench(eye={"pupil": "0.5 mm", "pupil_x": "8 mm"})
    view = hv.simulate(system, hv.random_drive(system), backend="torch")
    assert not view.intensity.any()
    assert {"pupil beside the eyebox", "pupil beyond the samples"} <= {note.split(":")[0] for note in view.notes}


def test_each_reading_has_its_figure_and_says_in_a_sentence_what_to_do() -> None:
    system = _broad_bench(upsample=1, eye={}, **{"relay2.iris_na": 0.02, "effects.bandwidth.sigma": "1 nm"})
    readings = read_limits(hv.make_plan(system))
    assert next(reading.limit.name for reading in readings if reading.is_exceeded) == "samples a pixel"
    assert all(np.isfinite(reading.measured.value) and ";" in reading.text for reading in readings)
