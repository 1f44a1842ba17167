"""The report holds what the diagnosis says, escaped, and its pictures."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.prepared_captures import FitQuality
from holoview.bench.diagnose.correct.bad_captures import BadCapture
from holoview.bench.diagnose.intervals import Interval
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.report.diagnosis import Cause, Diagnosis
from holoview.bench.diagnose.report.display_gain import DisplayGain
from holoview.bench.diagnose.report.error_places import FreeMapFit, PixelMap, ShownMap
from holoview.bench.diagnose.report.html_report import write_report
from holoview.light.model.effects.registry import listed_effects
from tests.chromium import check_document, needs_chromium

QUALITY = FitQuality(1.25, 40.0)
CAUSE = Cause(
    effect="gap",
    sentence="The gap is <wide> & long.",
    intervals={"gap_error": Interval(1.08e-4, 6e-7, 1.2e-6)},
    units={"gap_error": "m"},
    excess_explained=0.987,
    gain_db=3.21,
    before=QUALITY,
    after=QUALITY,
    confounded_with={"aberration1": 1.0, "distance": 0.5},
    separate_by="a capture in another plane",
)

MAPS = (
    ShownMap("amplitude", np.linspace(-0.1, 0.1, 64).reshape(8, 8), "1", (-1.0, 1.0, 1.0, -1.0), "pupil radii"),
    ShownMap("path", np.zeros((8, 8)), "m"),
    ShownMap("curve", np.linspace(0, 0.02, 9), "1"),
)


@pytest.fixture(scope="module")
def found(nominal: Captures) -> Diagnosis:
    """A diagnosis of a bench without faults, with every part that a report can have filled in."""
    plain = diagnose(nominal, [listed_effects()["gap"]], free_maps=False)
    return dataclasses.replace(
        plain,
        verdict=Verdict.PARTLY,
        causes=(CAUSE,),
        rivals=(("stroke", "tilt"),),
        unexplained=0.3,
        free_maps=(FreeMapFit("relay 1", 0.96, MAPS),),
        pixel_maps=(PixelMap(0, np.eye(6, 8), np.arange(8.0), np.arange(6.0), (2, 3)),),
        bad_captures=(BadCapture(3, "exchanged with 9", "Its picture shows <that> of 9."),),
        fixed_pattern=0.01,
        notes=("1 < 2",),
    )


def _text(folder: Path, found: Diagnosis, gain: DisplayGain | None = None) -> str:
    """The report's text without tags and pictures, entities replaced."""
    page = write_report(folder, "<captures>.h5", found, gain).read_text(encoding="utf-8")
    assert "<captures>" not in page and "<wide>" not in page
    text = re.sub(r"<(style|title)>.*?</\1>|<[^>]*>", " ", page, flags=re.DOTALL)
    for entity, character in (("&lt;", "<"), ("&gt;", ">"), ("&#39;", "'"), ("&amp;", "&")):
        text = text.replace(entity, character)
    return " ".join(text.split())


@pytest.mark.long
def test_it_says_all_that_was_found(tmp_path: Path, found: Diagnosis) -> None:
    text = _text(tmp_path, found)
    for words in (
        "Diagnosis of <captures>.h5 partly-explained",
        "The causes below explain a good part; something else is wrong too.",
        "The gap is <wide> & long. gap: 98.7% of the excess, +3.2 dB",
        "gap_error 0.1080 ± 0.0012 mm",
        "Looks much like: aberration1 (1.00), distance (0.50) (correlation of what they change).",
        "To separate them: a capture in another plane.",
        "Can't be excluded stroke and tilt",
        "Single pixels, columns and rows By how much the captures would rather have a pixel",
        "relay 1: 96% of what is left. Write an effect that overrides `pupil` for relay 1",
        "This speaks of 11 of 12 captures.",
        "3 exchanged with 9 Its picture shows <that> of 9.",
        "Pixels differ in sensitivity by 1.00%.",
        "1 < 2",
    ):
        assert words in text


def test_what_a_diagnosis_lacks_has_no_heading(tmp_path: Path, found: Diagnosis) -> None:
    text = _text(
        tmp_path, dataclasses.replace(found, rivals=(), free_maps=(), pixel_maps=(), fixed_pattern=0.0, bad_captures=())
    )
    for words in (
        "Captures that were left out",
        "This speaks of",
        "Can't be excluded",
        "What is left lives in",
        "Single pixels",
        "sensitivity",
        "on the display",
    ):
        assert words not in text


@pytest.mark.long
def test_the_gain_on_the_display_is_shown_with_its_picture(tmp_path: Path, found: Diagnosis) -> None:
    text = _text(tmp_path, found, DisplayGain(20.0, 23.5, 40, b"sheet"))
    assert (
        "reaches 20.0 dB on the bench as it is; with the extended model 23.5 dB , +3.5 dB (40 iterations each" in text
    )
    assert (tmp_path / "display.png").read_bytes() == b"sheet"


@needs_chromium
@pytest.mark.explores
def test_a_browser_shows_it_without_an_error(tmp_path: Path, found: Diagnosis) -> None:
    check_document(write_report(tmp_path, "captures.h5", found))
