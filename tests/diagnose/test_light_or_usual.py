"""Which of two searches stands: by derivatives, or by the light that speckle finds, whichever comes first."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose import pipeline
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.light.model.effects.registry import listed_effects
from tests.diagnose.conftest import small_system

EFFECTS = [listed_effects()["tilt"]]


@pytest.fixture(scope="module")
def captures() -> Captures:
    """Of a bench whose second modulator's light is tilted."""
    settings = AcquisitionSettings(captures_per_condition=4, seed=1)
    return make_captures(small_system(1), {"tilt": {"tilt_y": 2e-4}}, settings)


@pytest.fixture(scope="module")
def diagnosed(captures: Captures) -> Diagnosis:
    """What both searches are made of."""
    found = pipeline.diagnose(captures, EFFECTS, free_maps=False)
    assert [cause.effect for cause in found.causes] == ["tilt"]
    return found


@pytest.mark.parametrize(
    ("first", "left_by_light", "light_explains", "stands"),
    [
        ("usual", 12.0, False, "light"),  # of 20
        ("usual", 18.0, False, "usual"),
        ("usual", 18.0, True, "light"),
        ("usual", 25.0, False, "usual"),
        ("light", 12.0, False, "light"),
        ("light", 22.0, False, "light"),
        ("light", 40.0, False, "usual"),
    ],
)
def test_a_later_search_stands_if_it_leaves_clearly_less(
    first: str,
    left_by_light: float,
    light_explains: bool,
    stands: str,
    captures: Captures,
    diagnosed: Diagnosis,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """χ²/n of the usual search is 20. What leaves about as much as an earlier search has nothing to add."""
    verdicts = {"usual": Verdict.PARTLY, "light": Verdict.EXPLAINED if light_explains else Verdict.PARTLY}
    found = {
        name: replace(
            diagnosed,
            verdict=verdicts[name],
            after=replace(diagnosed.after, chi2_per_pixel=left),
            unexplained=0.5,
            notes=(name,),
        )
        for name, left in (("usual", 20.0), ("light", left_by_light))
    }
    monkeypatch.setattr(pipeline, "window_for_light", lambda *_: SimpleNamespace(is_first=first == "light"))
    monkeypatch.setattr(pipeline, "_search_light", lambda *_: found["light"])
    monkeypatch.setattr(pipeline, "_search_causes", lambda *_: (found["usual"], ()))
    assert pipeline.diagnose(captures, EFFECTS, free_maps=False).notes == (stands,)
