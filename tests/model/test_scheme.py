"""Colour schemes: each turns one bench into the paper's displays, and says what it doesn't understand."""

from __future__ import annotations

import numpy as np
import pytest

import holoview as hv
from holoview.light.model.scheme import with_scheme
from holoview.light.model.system import System
from holoview.util.errors import UserError

PRESETS = {
    "simultaneous": "simultaneous",
    "time-sequential": "time-sequential",
    "multiplexed": "multiplexed",
    "holochrome-8": "holochrome-8",
    "holochrome-8x3": "holochrome-8x3",
    "holochrome-16": "holochrome-16",
    "time-sequential+multisource-3x3": "multisource-3x3",
    "holochrome-9x3+multisource-3x3": "holochrome-multisource",
    "holochrome-8+1slm": "holochrome-8-1slm",
    "time-sequential+1slm": "time-sequential-1slm",
}


def _nameless(system: System) -> System:
    return system.edit({"name": "", "description": ""})


@pytest.mark.parametrize("scheme", PRESETS)
def test_a_scheme_on_the_paper_s_bench_is_the_paper_s_preset(scheme: str) -> None:
    found = with_scheme(hv.load("holochrome-8"), scheme)
    assert _nameless(found) == _nameless(hv.load(PRESETS[scheme]))


@pytest.mark.parametrize("scheme", ["simultaneous", "holochrome-5x2", "multiplexed-4", "time-sequential"])
def test_every_scheme_is_white_on_a_bench_and_leaves_its_optics(scheme: str) -> None:
    bench = hv.load("bench-plm")
    found = with_scheme(bench, scheme)
    plan = hv.make_plan(found.with_(shape=(8, 8)))
    white = plan.weights.sum(axis=0) @ plan.colour_weights
    np.testing.assert_allclose(white, [0.3127 / 0.329, 1, (1 - 0.3127 - 0.329) / 0.329], rtol=1e-6)
    assert found.modulators == bench.modulators
    assert found.relay2 == bench.relay2


def test_numbers_of_wavelengths_and_frames_are_what_was_asked() -> None:
    found = with_scheme(hv.load("holochrome-8"), "holochrome-5x2")
    assert found.amplitudes.shape == (2, 5)
    assert (found.amplitudes > 0).all()
    assert with_scheme(found, "multisource-2x3").source.directions_rad.shape == (6, 2)


@pytest.mark.parametrize(
    ("scheme", "words"),
    [
        ("sequential", 'scheme: "sequential"; expected simultaneous, time-sequential'),
        ("holochrome", 'scheme: "holochrome"'),
        ("holochrome-0", "expected numbers from 1 to 64"),
        ("holochrome-999999999", "expected numbers from 1 to 64"),
        (f"holochrome-{'9' * 5000}", "holochrome-NxT"),
        ("holochrome-8+multisource-3", "multisource-RxC"),
        ("", 'scheme: ""'),
    ],
)
def test_other_names_are_refused(scheme: str, words: str) -> None:
    with pytest.raises(UserError) as caught:
        with_scheme(hv.load("holochrome-8"), scheme)
    assert words in str(caught.value)
