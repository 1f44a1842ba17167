"""What samples may leave that the captures chose: near a nominal bench it is no cause's evidence."""

from __future__ import annotations

from dataclasses import replace

import pytest

from holoview.bench.captures.predictor import SamplingConfig
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.fit import CandidateFit
from holoview.bench.diagnose.judge import Decision, Verdict, rank_on_held_out
from holoview.bench.diagnose.nuisances import drop_sampling_artefacts
from holoview.bench.diagnose.sampling_choice import ChosenSampling
from holoview.light.numerics.sampling import AREA
from tests.diagnose.conftest import make_context_of, small_system

TILTED = {"tilt": {"tilt_y": 2e-4}}


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


def test_finer_samples_may_leave_a_fifteenth_of_what_they_took_and_kinds_of_pixels_nothing() -> None:
    assert ChosenSampling(SamplingConfig(2, 3, AREA), 1.04, 1.79).may_leave == pytest.approx(0.05)
    assert ChosenSampling(SamplingConfig(points=AREA), 1.04, 1.79).may_leave == 0
