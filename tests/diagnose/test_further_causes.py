"""A further cause is looked for in captures that show what the present causes leave."""

from __future__ import annotations

from dataclasses import replace

from holoview.bench.captures.virtual_measurement import AcquisitionSettings
from holoview.bench.captures.virtual_measurement import make_captures as measure
from holoview.bench.diagnose.fit import CandidateFit
from holoview.bench.diagnose.judge import FLOOR_CHI2
from holoview.bench.diagnose.search import with_captures_that_show
from holoview.bench.diagnose.search_context import SearchContext
from holoview.light.model.bench_parts import Modulator
from tests.diagnose.conftest import MakeContext, make_context_of, small_system

STOP = {"radius_error": 0.12}


def test_a_second_line_that_smooth_captures_hide_is_looked_for_in_rough_ones() -> None:
    """Smooth patterns send little light to the edges of a stop, where the two lines differ.

    χ²/n of 24 576 pixels scatters by 0.009; the limit is 1.05.
    """
    panel = Modulator(pitch_m=8e-6, shape=(96, 128), stroke_m=825e-9, levels=16)
    hidden = {"iris2": STOP, "second_line": {"share": 0.2, "offset": -1.5e-9}}
    settings = AcquisitionSettings(captures_per_condition=6, seed=5)
    context = make_context_of(measure(replace(small_system(), modulators=(panel, panel)), hidden, settings))
    base = CandidateFit(("iris2",), {"iris2": STOP}, 0.0)
    shown = with_captures_that_show(context, base)
    assert _smooth_chi2(context, base) < FLOOR_CHI2 < _smooth_chi2(shown, base)
    assert set(shown.split.coarse).isdisjoint({*context.split.fine, *context.split.held_out})


def test_a_cause_that_leaves_much_in_smooth_captures_is_searched_there(make_context: MakeContext) -> None:
    context = make_context({"iris2": STOP, "gap": {"gap_error": 1e-4}})
    assert with_captures_that_show(context, CandidateFit(("iris2",), {"iris2": STOP}, 0.0)) is context


def _smooth_chi2(context: SearchContext, base: CandidateFit) -> float:
    return context.data_weighted_comparison(context.split.coarse, 0.0).chi2_per_pixel(base.values)
