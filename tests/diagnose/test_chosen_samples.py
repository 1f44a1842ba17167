"""What samples may leave that the captures chose: near a nominal bench it is no cause's evidence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.plain_light import Beam
from benchmarks.real_benches import draw, measure
from holoview.bench.captures.capture_file import read_captures
from holoview.bench.captures.predictor import SamplingConfig
from holoview.bench.captures.prepared_captures import prepare_captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.extended_model import PredictorWithKnownEffects
from holoview.bench.diagnose.fit import CandidateFit, local_fit
from holoview.bench.diagnose.judge import Decision, Verdict, rank_on_held_out
from holoview.bench.diagnose.likelihood import Comparison
from holoview.bench.diagnose.nuisances import drop_sampling_artefacts, samples_that_explain
from holoview.bench.diagnose.sampling_choice import choose_sampling, finer_samples, further_samples
from holoview.bench.diagnose.search import find_causes
from holoview.light.numerics.sampling import AREA
from tests.diagnose.conftest import make_context_of, small_system
from tests.diagnose.independent import Faults, Laboratory, write_session
from tests.diagnose.independent_modulators import LightFaults
from tests.explored import explored

TILTED = {"tilt": {"tilt_y": 2e-4}}
FURTHER = {"camera_alignment": {"magnification": -1e-3}, "motion_blur": {"length_y": 0.7}}


@pytest.mark.parametrize("may_leave", ["nothing", "as much", "less"])
def test_a_cause_that_takes_no_more_than_chosen_samples_may_leave_is_not_named(may_leave: str) -> None:
    context = make_context_of(
        make_captures(small_system(1), TILTED, AcquisitionSettings(captures_per_condition=6, seed=3))
    )
    result = rank_on_held_out(context, [CandidateFit(("tilt",), TILTED, 0.0)])
    excess = result.nominal.excess
    assert excess > 0.1  # the tilt is seen
    left = {"nothing": 0.0, "as much": excess, "less": 0.5 * excess}[may_leave]
    decision, notes, better = drop_sampling_artefacts(
        replace(context, left_by_samples=left, has_open_sampling=True), result, Decision(Verdict.EXPLAINED, result.best)
    )
    if may_leave == "as much":
        assert decision.verdict is Verdict.CONSISTENT and decision.best is None and better is None
        assert "still finer ones may take" in notes[0]
    else:
        assert decision.best is not None and decision.best.causes == ("tilt",)


@pytest.mark.parametrize(("is_weighted", "share"), [(True, 1 / 15), (False, 1 / 5)])
def test_finer_samples_may_leave_a_share_of_what_they_took(is_weighted: bool, share: float) -> None:
    captures = make_captures(small_system(1), {}, AcquisitionSettings(captures_per_condition=1))

    def measured(sampling: SamplingConfig) -> float:
        kind = 1.0 if sampling.has_weighted_stops == is_weighted else 5.0
        return 1.0 + kind * 160.0 / (sampling.finer * sampling.padding) ** 4

    chosen = finer_samples(captures, 100.0, 1e6, measured)
    assert chosen is not None and chosen.sampling == SamplingConfig(2, 4, AREA, is_weighted)
    assert chosen.may_leave == pytest.approx(
        share * (measured(replace(chosen.sampling, finer=1, padding=2)) - chosen.chi2)
    )


@pytest.mark.parametrize(("of_cause", "is_taken"), [(0.0, True), (1.0, True), (3.0, True), (8.0, False), (1e3, False)])
def test_finer_samples_are_taken_where_they_explain_most_of_what_is_left(of_cause: float, is_taken: bool) -> None:
    """A cause's excess χ²/n beside that of the samples, 10, of which a step twice as fine leaves a sixteenth."""
    captures = make_captures(small_system(1), {}, AcquisitionSettings(captures_per_condition=1))

    def measured(sampling: SamplingConfig) -> float:
        return 1.0 + of_cause + 10.0 / sampling.padding**4

    chosen = finer_samples(captures, 1.0 + of_cause + 10.0, 1e4, measured)
    assert (chosen is not None) == is_taken
    assert chosen is None or (chosen.sampling.points == AREA and chosen.chi2 < 1.0 + of_cause + 1.0)


@pytest.mark.long
@pytest.mark.parametrize("beside", [None, "camera_alignment", "motion_blur"])
@pytest.mark.parametrize("size", [1.0, 1.05])
def test_finer_samples_are_tried_beside_causes_before_further_ones(
    size: float, beside: str | None, tmp_path: Path
) -> None:
    """A beam, whose light an independent program computed with finer samples, is right but for them (no fit, and no
    further cause, hides it); a beam of another size isn't, whatever the samples."""
    drawn = replace(draw(5, "none", "near", 64), pictures=2)
    half_px = max(drawn.bench.shape) / 2
    drawn = replace(drawn, bench=replace(drawn.bench, beam=Beam(0.6 * half_px, 2.0)))
    captures = read_captures(measure(drawn, tmp_path, 3).with_suffix(".h5"))
    values = {"beam": {"size": size / 0.6}} | ({beside: FURTHER[beside]} if beside else {})
    context = replace(make_context_of(captures), has_open_sampling=True)
    result = rank_on_held_out(context, [CandidateFit(tuple(values), values, 0.0)])
    found = samples_that_explain(context, result)
    assert (found is not None) == (size == 1.0)
    assert found is None or (found.points == AREA and (found.finer > 1 or found.has_weighted_stops))
    assert samples_that_explain(replace(context, has_open_sampling=False), result) is None  # the captures state them
    assert samples_that_explain(replace(context, sampling=SamplingConfig(padding=3)), result) is None  # of no ladder


@pytest.mark.parametrize("seed", explored([0, 1, 2], 0))
def test_stops_by_shares_are_nearer_to_a_wider_window_and_are_chosen(seed: int, tmp_path: Path) -> None:
    """Another program's window is five times as wide, so that less of the light that stops diffract comes in again."""
    captures = read_captures(write_session(tmp_path / "c.h5", Laboratory(seed=seed, each=2, window=5)))
    data, indices = prepare_captures(captures), np.arange(len(captures))
    variance = captures.camera.noise_variance(np.maximum(data.light, 0.0))

    def excess(is_weighted: bool) -> float:
        sampling = SamplingConfig(2, 2, 2, is_weighted)
        predictor = PredictorWithKnownEffects(captures, {}, **sampling.keywords)
        return Comparison(predictor, data, indices, variance).chi2_per_pixel({}) - 1

    assert excess(True) < 0.5 * excess(False)
    chosen = choose_sampling(captures, [], {})
    assert chosen is not None and chosen.sampling.has_weighted_stops and chosen.may_leave > 0


@pytest.mark.long
@pytest.mark.parametrize("is_alone", [True, False])
def test_a_source_is_fitted_again_before_finer_samples_are_refused(is_alone: bool, tmp_path: Path) -> None:
    """Pixels that integrate take detail away as a source does, which is fitted too large without them. Samples don't
    explain what a gap of another length leaves beside it."""
    faults = Faults(light=LightFaults(source_rad=1.2e-3), gap_m=0.0 if is_alone else 1.5e-4)
    laboratory = Laboratory(each=3, window=5, faults=faults)
    captures = read_captures(write_session(tmp_path / "c.h5", laboratory))
    context = replace(make_context_of(captures), has_open_sampling=True)
    source = context.effects["source_extent"]
    start = {"source_extent": {"radius": 1.2e-3, "outline": 0.0}}
    fit = local_fit([source], start, context.tolerant_comparison(context.split.coarse, 0.1))
    assert fit.values["source_extent"]["radius"] > 1.2e-3
    found = samples_that_explain(context, rank_on_held_out(context, [fit]))
    assert (found is not None) == is_alone and (found is None or found.has_weighted_stops)


@pytest.mark.parametrize("of_cause", [0.0, 0.02, 1.0])
def test_further_samples_are_taken_where_causes_leave_what_they_take(of_cause: float) -> None:
    captures = make_captures(small_system(1), {}, AcquisitionSettings(captures_per_condition=1))
    own = SamplingConfig(2, 2, AREA, has_weighted_stops=True)

    def left(sampling: SamplingConfig) -> float:
        return 1.0 + of_cause + 10.0 / (sampling.finer * sampling.padding) ** 4

    found = further_samples(captures, own, left(own), 1e5, left)
    assert found == (None if of_cause == 1.0 else replace(own, padding=3 if of_cause else 4))
    assert further_samples(captures, SamplingConfig(padding=3), 9.0, 1e5, left) is None


def test_what_samples_may_leave_is_not_searched_for_causes() -> None:
    captures = make_captures(small_system(1), TILTED, AcquisitionSettings(captures_per_condition=6, seed=3))
    context = make_context_of(captures)
    nominal = rank_on_held_out(context, []).nominal.excess
    asked: list[str] = []
    for share in (1.0, 0.5):
        limited = replace(context, left_by_samples=share * nominal, effects={"tilt": context.effects["tilt"]})
        _, result = find_causes(limited, lambda done, total, what: asked.append(what))
        assert bool(asked) == (share < 1) and result.best.causes == (("tilt",) if asked else ())
