"""Parameters that nearly do the same are told apart by scans of each."""

from __future__ import annotations

import pytest

from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.refine import refine_fit
from holoview.bench.diagnose.screening import fit_over_range
from tests.diagnose.conftest import make_context_of, small_system


@pytest.mark.parametrize("true", [{"sigma": 1.1, "coupling": 0.0}, {"sigma": 0.0, "coupling": 0.45}], ids=str)
def test_what_one_of_two_blurs_does_is_not_divided_between_them(true: dict[str, float]) -> None:
    """From the best two points of a scan, a fit of both ends at 0.27 and 0.64 instead of 1.1 and 0.

    The two change together along a valley: of 24 draws the coupling was off by 0.007 r.m.s., 0.024 at most.
    """
    settings = AcquisitionSettings(captures_per_condition=6, seed=6)
    context = make_context_of(make_captures(small_system(), {"crosstalk": true}, settings))
    fit = refine_fit(context, fit_over_range(context, {}, context.effects["crosstalk"], []))
    assert fit.values["crosstalk"]["coupling"] == pytest.approx(true["coupling"], abs=0.1)
    assert fit.values["crosstalk"]["sigma"] == pytest.approx(true["sigma"], abs=0.1)
