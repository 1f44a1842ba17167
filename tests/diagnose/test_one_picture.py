"""A session of one picture: blocks of its pixels judge; copies of it end as one picture."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from holoview.bench.captures import Captures, read_captures
from holoview.bench.captures.predictor import SamplingConfig
from holoview.bench.captures.prepared_captures import prepare_captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.config import SearchConfig
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.bench.diagnose.single_capture import (
    config_for_one_picture,
    fair_blocks,
    held_out_blocks,
    speckle_width_px,
)
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import small_system
from tests.diagnose.independent import Faults, Laboratory, write_session

FEW = ("camera_blur", "distance", "gap", "stroke", "tilt")


def _picture(faults: Mapping[str, Mapping[str, float]] | None = None, seed: int = 2) -> Captures:
    """One capture of rough patterns."""
    settings = AcquisitionSettings(captures_per_condition=1, blur_sigmas_px=(0.0,), seed=seed)
    one_wavelength = dataclasses.replace(small_system(), wavelengths_m=np.array([600e-9]), amplitudes=np.ones((1, 1)))
    return make_captures(one_wavelength, faults or {}, settings)


def _diagnosed(captures: Captures, sampling: SamplingConfig | None = None, among: Sequence[str] = FEW) -> Diagnosis:
    effects = [listed_effects()[name] for name in among]
    return diagnose(captures, effects, free_maps=False, sampling=sampling or SamplingConfig())


def test_held_out_blocks_are_apart_from_what_is_fitted() -> None:
    """Blocks of 6 × 3 pixels, margins of 2 × 3."""
    held_out, fitted = held_out_blocks((100, 120), 3.0)
    assert not (held_out & fitted).any()
    y, x = np.nonzero(held_out)
    assert (y.min(), x.min()) == (18, 18) and held_out[18:36, 18:36].all() and not held_out[36:54].any()
    margin = ~held_out & ~fitted
    assert margin[12:18, 12:42].all() and fitted[11, :].all()
    assert 0.15 < held_out.mean() < 0.3 and 0.3 < fitted.mean() < 0.7


def test_a_small_picture_still_has_a_block_in_the_middle() -> None:
    held_out, fitted = held_out_blocks((30, 30), 50.0)
    assert held_out.sum() == 100 and fitted.any()


def test_margins_are_as_wide_on_large_pictures_of_large_speckles() -> None:
    """Speckles of 100 pixels: blocks of 398 pixels, a third of the picture's rows, and margins of a third of that."""
    held_out, fitted = held_out_blocks((1194, 1800), 100.0)
    assert held_out[398:796, 398:796].all() and held_out[398:796, 1194:1592].all() and held_out.sum() == 2 * 398**2
    assert not fitted[398 - 132 : 796 + 132, 398 - 132 : 796 + 132].any() and fitted[398 - 133, 500]


@pytest.mark.parametrize("width", [2.0, 5.0])
def test_the_width_of_a_speckle_is_that_of_the_autocorrelation(width: float) -> None:
    """Gaussian speckle of a field that is blurred by σ: the intensity's autocorrelation is exp(−r²/2σ²)."""
    rng, shape = np.random.default_rng(0), (256, 256)
    sigma = width / (2 * (2 * np.log(2)) ** 0.5)
    fy, fx = (np.fft.fftfreq(n) for n in shape)
    low_pass = np.exp(-2 * (np.pi * sigma) ** 2 * (fy[:, None] ** 2 + fx[None, :] ** 2))
    noise = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
    light = np.abs(np.fft.ifft2(np.fft.fft2(noise) * low_pass)) ** 2
    picture = _picture()
    images = (64 + 500 * light / light.mean()).clip(0, 4000).astype(np.uint16)[None]
    data = prepare_captures(Captures(**{**vars(picture), "images": images}))
    assert speckle_width_px(data) == pytest.approx(width, rel=0.2)


def test_an_explanation_needs_more() -> None:
    plain = SearchConfig()
    one = config_for_one_picture(plain, 3.0).verdict
    assert one.min_delta_chi2 == 9 * plain.verdict.min_delta_chi2 and one.explained_excess == 0.02
    assert config_for_one_picture(plain, 0.5).verdict.min_delta_chi2 == plain.verdict.min_delta_chi2


@pytest.mark.long
def test_one_good_picture_is_consistent_and_says_on_what_that_rests() -> None:
    found = _diagnosed(_picture())
    assert found.verdict is Verdict.CONSISTENT and not found.causes and not found.bad_captures
    assert any("rests on one picture" in note for note in found.notes)


@pytest.mark.parametrize(
    ("name", "parameter", "value"),
    [("gap", "gap_error", 1e-4), pytest.param("stroke", "stroke_error", 0.1, marks=pytest.mark.explores)],
)
def test_one_picture_names_a_fault(name: str, parameter: str, value: float) -> None:
    found = _diagnosed(_picture({name: {parameter: value}}))
    assert found.verdict is Verdict.EXPLAINED and [cause.effect for cause in found.causes] == [name]
    interval = found.causes[0].intervals[parameter]
    assert abs(interval.value - value) <= 3 * interval.half_width
    assert any("rests on one picture" in note for note in found.notes)


@pytest.mark.long
def test_a_fault_that_the_library_lacks_is_not_explained(tmp_path: Path) -> None:
    laboratory = Laboratory(wavelengths_m=(600e-9,), each=1, smoothness_px=(0.8,), faults=Faults(vortex=1.0), fine=2)
    found = _diagnosed(
        read_captures(write_session(tmp_path / "c.h5", laboratory)), SamplingConfig(padding=3), ("distance", "gap")
    )
    assert found.verdict in (Verdict.UNEXPLAINED, Verdict.PARTLY)


@pytest.mark.long
def test_the_same_picture_three_times_is_one_picture() -> None:
    found = _diagnosed(_picture().subset([0, 0, 0]))
    assert [sample.capture for sample in found.samples] == [0]
    assert found.verdict is Verdict.CONSISTENT and found.captures == 3
    assert [(bad.index, bad.why) for bad in found.bad_captures] == [(1, "duplicate"), (2, "duplicate")]
    assert any("rests on one picture" in note for note in found.notes)
    assert "The verdict speaks of 1 of 3 captures; the others are bad." in found.notes


@pytest.mark.parametrize("at", [(0.5, 0.5), (0.15, 0.15), (0.15, 0.5), (0.5, 0.15), (0.85, 0.85)])
def test_blocks_of_one_picture_share_its_light_wherever_that_is(at: tuple[float, float]) -> None:
    """Coarse speckle in a tenth of the picture, anywhere: fitted and held-out pixels both have a third of the light's
    evidence that is fair for their number, or as much as any of four choices of blocks gives them. At a corner the
    usual blocks give one side an eighth at most (25 draws), others a third."""
    picture, shape, rng = _picture(), (160, 200), np.random.default_rng(3)
    y, x = np.indices(shape) / np.array(shape)[:, None, None]
    near = np.exp(-((y - at[0]) ** 2 + (x - at[1]) ** 2) / (2 * 0.1**2))
    field = gaussian_filter(rng.standard_normal(shape), 4) + 1j * gaussian_filter(rng.standard_normal(shape), 4)
    light = np.abs(field) ** 2 * near
    images = (64 + 2000 * light / light.max()).astype(np.uint16)[None]
    data = prepare_captures(Captures(**{**vars(picture), "images": images}))
    seen = np.where(data.usable[0], data.light[0], 0.0).clip(0)
    evidence = seen**2 / data.camera.noise_variance(seen)
    width_px = speckle_width_px(data)
    choices = [held_out_blocks(shape, width_px, first) for first in ((1, 1), (0, 1), (1, 0), (0, 0))]
    found = fair_blocks(data, width_px)
    assert not (found[0] & found[1]).any()
    usual, *others, share = (
        min(evidence[part].sum() / evidence.sum() / part.mean() for part in pair) for pair in (*choices, found)
    )
    assert share == pytest.approx(usual if usual >= 0.3 else max(usual, *others))
    assert at != (0.15, 0.15) or share > 2 * usual
