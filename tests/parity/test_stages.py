"""Stage by stage, the shaders compute what torch computes in complex128.

Isolated: both executors are given the same input. Cumulative: each goes on with its own output, so that a mismatch is
blamed on the first stage that is off.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest

from holoview.evidence.benchmark.report_run import (
    CHANGES,
    SOURCES,
    TOLERANCES,
    ExecutorPair,
    Step,
    composite_error,
    lit_rounds,
    relative_error,
    stage_errors,
    steps_to_planes,
    worst_by_stage,
)

pytestmark = pytest.mark.gpu

Opened = Callable[..., Any]

CUMULATIVE_MARGIN = 1.2
"""Roundings are nearly independent, so they add in quadrature, and no stage but the intensity enlarges them."""
INTENSITY_GAIN = math.sqrt(2)
"""I = |E|² has the relative error 2·Re(E*·dE)/|E|²: of independent dE with equal parts, √2 times the field's own."""

# --- isolated -------------------------------------------------------------------------------------------------------


def _stage(step: str) -> str:
    """The stage of a step that is named as in `stage_errors`."""
    return step.rpartition(": ")[2].split()[0].replace("last", "spectrum")


@pytest.mark.parametrize("case", CHANGES)
def test_each_stage_alone_gives_what_torch_gives_for_the_same_input(both: Opened, bench: Opened, case: str) -> None:
    errors = stage_errors(both(bench(**CHANGES[case])))
    assert {_stage(name) for name in errors} == TOLERANCES.keys()
    assert not {name: error for name, error in errors.items() if error > TOLERANCES[_stage(name)]}


def test_the_worst_of_each_stage_is_what_a_report_shows(both: Opened, bench: Opened) -> None:
    pair = both(bench(source=SOURCES))
    errors, worst = stage_errors(pair), worst_by_stage(pair)
    assert worst == {stage: max(e for name, e in errors.items() if _stage(name) == stage) for stage in TOLERANCES}


def test_the_observer_sees_the_same_of_the_same_intensity(both: Opened, bench: Opened) -> None:
    assert composite_error(both(bench())) <= TOLERANCES["composite"]


# --- cumulative -----------------------------------------------------------------------------------------------------


def _walk(both: ExecutorPair) -> Iterator[tuple[str, float, float]]:
    """Every step of an image in both executors: its name, its error, and the error allowed by then."""
    for executor in (both.reference, both.shaders):
        executor.clear_xyz()
    for wavelength in range(len(both.plan.system.wavelengths_m)):
        both.clear()
        variance = 0.0
        for frame, source in lit_rounds(both.plan, wavelength):
            where = f"wavelength {wavelength}, frame {frame}, source {source}: "
            variances: dict[str | None, float] = {None: 0.0}
            exact: dict[str, Any] = {}
            on_device: dict[str, Any] = {}
            for step in steps_to_planes(both.plan, wavelength, frame, source):
                exact[step.name] = step.run(both.reference, exact)
                on_device[step.name] = step.run(both.shaders, on_device)
                expected = step.seen(both.reference, exact[step.name])
                error = relative_error(step.seen(both.shaders, on_device[step.name]), expected)
                inherited = variances[step.after] * (INTENSITY_GAIN**2 if step.stage == "accumulate" else 1.0)
                variance = variances[step.name] = inherited + TOLERANCES[step.stage] ** 2
                yield where + step.name, error, CUMULATIVE_MARGIN * math.sqrt(variance)
        composite = Step("composite", "composite", None, (wavelength,))
        expected, found = (composite.seen(e, composite.run(e, {})) for e in (both.reference, both.shaders))
        allowed = CUMULATIVE_MARGIN * math.sqrt(variance + TOLERANCES["composite"] ** 2)
        yield f"wavelength {wavelength}: composite", relative_error(found, expected), allowed


def _first_mismatch(both: ExecutorPair) -> str:
    """The first step in which the executors disagree, in words; empty when they agree to the end."""
    for name, error, allowed in _walk(both):
        if error > allowed:
            return f"{name} is off by {error:.1e}, allowed {allowed:.1e}"
    return ""


@pytest.mark.parametrize("case", CHANGES)
def test_no_stage_of_a_whole_image_leaves_torchs_path(both: Opened, bench: Opened, case: str) -> None:
    assert not _first_mismatch(both(bench(**CHANGES[case])))


FAULTS: dict[str, Callable[[Any], None]] = {
    "source 1: illuminate": lambda e: _replace(e, "illuminate", lambda stage, w, source: stage(w, 0)),
    "source 0: modulate 1": lambda e: _replace(e, "modulate", lambda stage, f, t, m, w: stage(f, t, 1 - m, w)),
    "source 0: modulate 2": lambda e: _replace(e, "modulate", lambda stage, f, t, m, w: stage(f, t, 0, w)),
    "source 0: spectrum of the gap": lambda e: _replace(
        e, "spectrum", lambda stage, f, m: e.upload_field(e.download_field(stage(f, m)) * (1 + 2e-6), relay=m)
    ),
    "source 0: transmit the gap": lambda e: _lengthen_gap(e, 1e-8),
    "transmit to plane 1": lambda e: _replace(e, "transmit", lambda stage, f, r, w, plane=0: stage(f, r, w, 0)),
    "field behind the gap": lambda e: _replace(
        e, "field", lambda stage, f, relay: e.upload_field(e.download_field(stage(f, relay)).conj())
    ),
    "accumulate plane 0": lambda e: _replace(
        e, "accumulate", lambda stage, f, plane, weight: stage(f, plane, weight * (1 + 1e-5))
    ),
    "wavelength 1: composite": lambda e: _replace(e, "composite", lambda stage, w: stage(0)),
}


def _replace(executor: Any, name: str, stage: Callable[..., Any]) -> None:
    """Puts a faulty stage, which is handed the good one, into one executor."""
    good = getattr(executor, name)
    setattr(executor, name, lambda *arguments: stage(good, *arguments))


def _lengthen_gap(executor: Any, by_m: float) -> None:
    """Gives one executor a plan with a longer gap."""
    plan = executor.plan
    executor.plan = replace(plan, system=plan.system.with_(gap=plan.system.gap_m + by_m), _transfers={})


@pytest.mark.parametrize("name", FAULTS)
def test_a_mismatch_names_the_first_stage_that_is_off(both: Opened, bench: Opened, name: str) -> None:
    pair = both(bench(source=SOURCES))
    FAULTS[name](pair.shaders)
    assert f"{name} is off by" in _first_mismatch(pair)
