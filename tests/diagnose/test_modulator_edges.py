"""Edges smeared in one direction, and amplitudes that follow the phase: named with their signs among look-alikes."""

from __future__ import annotations

import pytest

from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import NOISE_CHI2, small_system
from tests.explored import explored

AMONG = ["crosstalk", "fringing", "lut", "stroke", "stroke_map", "twisted_nematic", "undiffracted"]
HALF_WIDTHS = 3.0  # of the 95 % interval: 5.9 standard deviations


HIDDEN = [{"twisted_nematic": {"slope": 0.2, "bow": -0.1}}, *({"fringing": {"width_x": x}} for x in (0.4, -0.4))]


@pytest.mark.long
@pytest.mark.parametrize("hidden", explored(HIDDEN, 1))
def test_it_is_named_with_its_sign(hidden: dict[str, dict[str, float]]) -> None:
    captures = make_captures(small_system(), hidden, AcquisitionSettings(captures_per_condition=4, seed=3))
    library = listed_effects()
    found = diagnose(captures, [library[name] for name in AMONG], workers=1, free_maps=False)
    assert found.verdict is Verdict.EXPLAINED and [cause.effect for cause in found.causes] == list(hidden)
    (values,) = hidden.values()
    for name, true in values.items():
        interval = found.causes[0].intervals[name]
        assert abs(interval.value - true) <= HALF_WIDTHS * interval.half_width
    without = [library[name] for name in AMONG if name not in hidden]
    lacking = diagnose(captures, without, workers=1, free_maps=False)
    assert lacking.verdict is not Verdict.EXPLAINED and lacking.after.chi2_per_pixel > NOISE_CHI2
