"""Stage by stage, the shaders compute what torch computes in complex128.

Isolated: both executors are given the same input. Cumulative: each goes on with its own output, so that a mismatch is
blamed on the first stage that is off.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from holoview.model.plan import Plan

pytestmark = pytest.mark.gpu

Array = NDArray[Any]
Opened = Callable[..., Any]

TOLERANCES = {
    "illuminate": 7e-8,  # 5.6e-8: a polynomial for sine and cosine, of a phase that is exact
    "modulate": 2.1e-7,  # 1.8e-7 at 460 nm: f32 of stroke/λ and of its product with the drive, up to 1.8 turns
    "spectrum": 2.6e-7,  # 2.3e-7 at 250 × 384, the largest grid here
    "transmit": 1.3e-7,  # 1.1e-7 at 50 mm, else 1.0e-7
    "field": 2.6e-7,  # 2.3e-7 at 250 × 384
    "accumulate": 6.5e-8,  # 5.5e-8
    "composite": 5e-8,  # 4.1e-8
}
"""Relative L2 error of a stage by itself: the worst seen, over all cases and four drives each, plus a little."""
CUMULATIVE_MARGIN = 1.2
"""Roundings are nearly independent, so they add in quadrature, and no stage but the intensity enlarges them."""
INTENSITY_GAIN = math.sqrt(2)
"""I = |E|² has the relative error 2·Re(E*·dE)/|E|²: of independent dE with equal parts, √2 times the field's own."""

P67 = [0, 0.0107, 0.0219, 0.045, 0.0598, 0.0775, 0.1206, 0.185, 0.3655, 0.3955, 0.451, 0.5244, 0.6393, 0.7116, 0.8502]
SOURCES = {"directions": [[0.0, 0.0], [0.01, -0.02], [-0.03, 0.005]]}
CASES: dict[str, dict[str, Any]] = {
    "two modulators": {},
    "one modulator": {"modulators": [{"pitch": "8 um", "shape": [25, 32], "stroke": "825 nm"}], "gap": None},
    "tilted sources": {"source": SOURCES},
    "a tilt for each wavelength": {"source": SOURCES | {"tilts": [[0.002, 0.0], [-0.001, 0.004]]}},
    "irises and a DC block": {"relay1.iris_na": 0.025, "relay2.iris_na": 0.02, "relay2.dc_block_na": 0.003},
    "glass in both relays": {
        "relay1": {"iris_na": 0.03, "aberration": {"Z5": "40 nm", "Z8": "-60 nm"}},
        "relay2": {"iris_na": 0.025, "apodisation_na": 0.02, "aberration": {"Z4": "70 nm"}},
    },
    "sixteen uneven levels": {"levels": [*P67, 1]},
    "lasers in turn": {"amplitudes": [[2.0, 0.0], [0.0, 4.0], [0.5, 1.5]]},
    "one sample a pixel, periodic": {"upsample": 1, "propagation": "periodic"},
    "nine samples a pixel": {"upsample": 3},
    "250 x 384 samples, periodic": {"shape": [125, 192], "propagation": "periodic"},
    "compact": {"shape": [27, 45], "upsample": 3, "propagation": "compact", "relay2.iris_na": 0.01},
    "no gap, planes at zero and far": {"gap": 0.0, "planes": [0.0, "50 mm"], "propagation": "periodic"},
}


@dataclass(frozen=True)
class Step:
    """A stage on the way of the light, the step whose field it takes, and its other arguments."""

    name: str
    stage: str
    after: str | None
    arguments: tuple[Any, ...]

    def run(self, executor: Any, fields: dict[str, Any]) -> Any:
        """The field that the stage gives."""
        given = [] if self.after is None else [fields[self.after]]
        return getattr(executor, self.stage)(*given, *self.arguments)

    def seen(self, executor: Any, out: Any) -> Array:
        """What can be compared of the result: the field, or the intensity or XYZ that it went into."""
        if self.stage == "accumulate":
            return executor.intensity(self.arguments[0])
        if self.stage == "composite":
            return executor.xyz()
        return out.numpy() if isinstance(out, torch.Tensor) else executor.download_field(out)


def _steps(plan: Plan, wavelength: int, frame: int, source: int) -> Iterator[Step]:
    """The way of the light through a bench, to the intensity at each plane."""
    yield Step("illuminate", "illuminate", None, (wavelength, source))
    yield Step("modulate 1", "modulate", "illuminate", (frame, 0, wavelength))
    last = "modulate 1"
    if plan.system.gap_m is not None:
        yield Step("spectrum of the gap", "spectrum", last, ())
        yield Step("transmit the gap", "transmit", "spectrum of the gap", (0, wavelength, plan.system.gap_m))
        yield Step("field behind the gap", "field", "transmit the gap", ())
        yield Step("modulate 2", "modulate", "field behind the gap", (frame, 1, wavelength))
        last = "modulate 2"
    yield Step("last spectrum", "spectrum", last, ())
    for plane, distance_m in enumerate(plan.planes_m.tolist()):
        yield Step(f"transmit to plane {plane}", "transmit", "last spectrum", (1, wavelength, distance_m))
        yield Step(f"field at plane {plane}", "field", f"transmit to plane {plane}", ())
        weight = float(plan.weights[frame, wavelength])
        yield Step(f"accumulate plane {plane}", "accumulate", f"field at plane {plane}", (plane, weight))


def _rounds(plan: Plan, wavelength: int) -> Iterator[tuple[int, int]]:
    """Frame and source of all that adds up to the intensity at a wavelength."""
    for frame in plan.lit(wavelength):
        for source in range(len(plan.slopes)):
            yield frame, source


def _clear(both: Any) -> None:
    for executor in (both.reference, both.shaders):
        for plane in range(len(both.plan.planes_m)):
            executor.clear(plane)


def _error(found: Array, expected: Array) -> float:
    """Relative L2; infinite for what isn't finite."""
    error = float(np.linalg.norm(found - expected) / np.linalg.norm(expected))
    return error if math.isfinite(error) else math.inf


# --- isolated -------------------------------------------------------------------------------------------------------


def _isolated(both: Any, step: Step, given: torch.Tensor | None) -> float:
    """Error of one step whose input is `given`, rounded to what both executors can hold."""
    _clear(both)
    exact: dict[str, Any] = {}
    on_device: dict[str, Any] = {}
    if step.after is not None and given is not None:
        rounded = given.to(torch.complex64)
        exact[step.after] = rounded.to(torch.complex128)
        is_spectrum = step.stage in ("transmit", "field")
        on_device[step.after] = both.shaders.upload_field(rounded.numpy(), is_spectrum=is_spectrum)
    expected = step.seen(both.reference, step.run(both.reference, exact))
    found = step.seen(both.shaders, step.run(both.shaders, on_device))
    assert found.shape == expected.shape
    return _error(found, expected)


@pytest.mark.parametrize("case", CASES)
def test_each_stage_alone_gives_what_torch_gives_for_the_same_input(both: Opened, bench: Opened, case: str) -> None:
    pair, off = both(bench(**CASES[case])), {}
    for wavelength in (0, 1):
        for frame, source in _rounds(pair.plan, wavelength):
            fields: dict[str, Any] = {}
            for step in _steps(pair.plan, wavelength, frame, source):
                error = _isolated(pair, step, fields.get(step.after or ""))
                if error > TOLERANCES[step.stage]:
                    off[wavelength, frame, source, step.name] = error
                fields[step.name] = step.run(pair.reference, fields)
    assert not off


def test_the_observer_sees_the_same_of_the_same_intensity(both: Opened, bench: Opened) -> None:
    pair = both(bench())
    _clear(pair)
    for plane, weight in ((0, 0.25), (1, 3.0)):
        pair.shaders.accumulate(pair.shaders.modulate(pair.shaders.illuminate(0, 0), 0, 0, 0), plane, weight)
        shown = torch.from_numpy(pair.shaders.intensity(plane).astype(np.complex128))
        pair.reference.accumulate(shown.sqrt(), plane, 1.0)
    for executor in (pair.reference, pair.shaders):
        executor.clear_xyz()
        for wavelength in (0, 1):
            executor.composite(wavelength)
    assert _error(pair.shaders.xyz(), pair.reference.xyz()) <= TOLERANCES["composite"]


# --- cumulative -----------------------------------------------------------------------------------------------------


def _walk(both: Any) -> Iterator[tuple[str, float, float]]:
    """Every step of an image in both executors: its name, its error, and the error allowed by then."""
    for executor in (both.reference, both.shaders):
        executor.clear_xyz()
    for wavelength in range(len(both.plan.system.wavelengths_m)):
        _clear(both)
        variance = 0.0
        for frame, source in _rounds(both.plan, wavelength):
            where = f"wavelength {wavelength}, frame {frame}, source {source}: "
            variances: dict[str | None, float] = {None: 0.0}
            exact: dict[str, Any] = {}
            on_device: dict[str, Any] = {}
            for step in _steps(both.plan, wavelength, frame, source):
                exact[step.name] = step.run(both.reference, exact)
                on_device[step.name] = step.run(both.shaders, on_device)
                expected = step.seen(both.reference, exact[step.name])
                error = _error(step.seen(both.shaders, on_device[step.name]), expected)
                inherited = variances[step.after] * (INTENSITY_GAIN**2 if step.stage == "accumulate" else 1.0)
                variance = variances[step.name] = inherited + TOLERANCES[step.stage] ** 2
                yield where + step.name, error, CUMULATIVE_MARGIN * math.sqrt(variance)
        composite = Step("composite", "composite", None, (wavelength,))
        expected, found = (composite.seen(e, composite.run(e, {})) for e in (both.reference, both.shaders))
        allowed = CUMULATIVE_MARGIN * math.sqrt(variance + TOLERANCES["composite"] ** 2)
        yield f"wavelength {wavelength}: composite", _error(found, expected), allowed


def _first_mismatch(both: Any) -> str:
    """The first step in which the executors disagree, in words; empty when they agree to the end."""
    for name, error, allowed in _walk(both):
        if error > allowed:
            return f"{name} is off by {error:.1e}, allowed {allowed:.1e}"
    return ""


@pytest.mark.parametrize("case", CASES)
def test_no_stage_of_a_whole_image_leaves_torchs_path(both: Opened, bench: Opened, case: str) -> None:
    assert not _first_mismatch(both(bench(**CASES[case])))


FAULTS: dict[str, Callable[[Any], None]] = {
    "source 1: illuminate": lambda e: _replace(e, "illuminate", lambda stage, w, source: stage(w, 0)),
    "source 0: modulate 1": lambda e: _replace(e, "modulate", lambda stage, f, t, m, w: stage(f, t, 1 - m, w)),
    "source 0: modulate 2": lambda e: _replace(e, "modulate", lambda stage, f, t, m, w: stage(f, t, 0, w)),
    "source 0: spectrum of the gap": lambda e: _replace(
        e, "spectrum", lambda stage, f: e.upload_field(e.download_field(stage(f)) * (1 + 2e-6), is_spectrum=True)
    ),
    "source 0: transmit the gap": lambda e: _replace(
        e, "transmit", lambda stage, f, r, w, z: stage(f, r, w, z + (1 - r) * 1e-8)
    ),
    "transmit to plane 1": lambda e: _replace(e, "transmit", lambda stage, f, r, w, z: stage(f, r, w, min(z, 3e-3))),
    "field behind the gap": lambda e: _replace(
        e, "field", lambda stage, f: e.upload_field(e.download_field(stage(f)).conj())
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


@pytest.mark.parametrize("name", FAULTS)
def test_a_mismatch_names_the_first_stage_that_is_off(both: Opened, bench: Opened, name: str) -> None:
    pair = both(bench(source=SOURCES))
    FAULTS[name](pair.shaders)
    assert f"{name} is off by" in _first_mismatch(pair)
