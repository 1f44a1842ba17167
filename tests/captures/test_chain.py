"""Captures of chains: the predictor is `simulate`, files hold every element's levels, and what can't be is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import holoview as hv
from holoview.bench.captures.capture_file import read_captures, write_captures
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.records.corrections import SlmExchange
from holoview.bench.captures.records.record_errors import find_record_errors
from holoview.bench.captures.validation import capture_sheet, summarise
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, blank_captures, make_captures
from holoview.light.model.effects.effect import Effect
from holoview.light.model.effects.registry import effects_of
from holoview.light.model.system import System

UM, MM, NM = 1e-6, 1e-3, 1e-9
PHASE = {"name": "slm", "kind": "phase", "pitch": 8 * UM, "shape": (18, 24), "stroke": 800 * NM}
WAY = {"name": "way", "kind": "space", "distance": 1 * MM, "iris_na": 0.03}
MASK = {"name": "mask", "kind": "mask", "pitch": 8 * UM, "shape": (18, 24), "pattern": "random", "stroke": 700 * NM}
COARSE = {"name": "coarse", "kind": "amplitude", "pitch": 24 * UM, "shape": (6, 8)}
LAST = {"name": "last", "kind": "space", "square": "first order of slm"}


def _chain(*elements: dict[str, Any], **keys: Any) -> System:
    shown = list(elements) or [PHASE, WAY, MASK, WAY | {"name": "to coarse"}, COARSE, LAST]
    keys = {"planes_m": [3 * MM, 4 * MM], "observer": "mono"} | keys
    return System([532 * NM, 580 * NM], [[1.0, 1.0]], elements=shown, **keys)


FOURIER = {"name": "lens", "kind": "fourier", "focal_length": 1.8 * MM}
IN_PLANE = {"name": "filter", "kind": "amplitude", "pitch": 8 * UM, "shape": (18, 24)}
FAR = (PHASE, WAY, FOURIER, IN_PLANE, {"name": "last", "kind": "space", "iris_na": 0.03})


def _blank(*elements: dict[str, Any]) -> Captures:
    return _blank_of(_chain(*elements))


def _blank_of(chain: System) -> Captures:
    return blank_captures(chain, AcquisitionSettings(captures_per_condition=2), np.random.default_rng(3))


def _deviation(captures: Captures, effects: dict[str, dict[str, Any]], k: int) -> float:
    """Of the prediction of capture k from what `simulate` shows of two frames, of which it is the second."""
    nominal = captures.nominal_system(planes_m=[captures.distance_m[k]])
    lit = np.where(nominal.wavelengths_m == captures.wavelength_m[k], captures.power[k], 0.0)
    bench = nominal.edit({"amplitudes": [[0.0, 0.0], lit.tolist()], "effects": effects})
    before, shown = (captures.patterns(captures.drive(n)) for n in (k - 1, k))
    drive = {name: np.stack([before[name], shown[name]]) for name in shown}
    expected = 2 * hv.simulate(bench, drive, backend="torch64").intensity[0].sum(axis=0)  # the mean over two frames
    found = Predictor(captures, double_precision=True)([k], effects).signal[0].numpy()
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def _seen(captures: Captures) -> list[Effect]:
    """The effects of which a simulation shows all that they do."""
    return [e for e in effects_of(captures.data_properties()) if "camera" not in e.acts_on and e.id != "gap@last"]


def _named(captures: Captures) -> list[str]:
    return ["", *(effect.id for effect in _seen(captures) if effect.id != "laser_power")]


@pytest.mark.parametrize(
    ("elements", "name"), [*(((), name) for name in _named(_blank())), *((FAR, name) for name in _named(_blank(*FAR)))]
)
def test_a_prediction_is_what_the_simulation_shows(elements: tuple[dict[str, Any], ...], name: str) -> None:
    captures = _blank(*elements)
    effects = {e.id: {p.name: p.nudged(0.5) for p in e.parameters} for e in _seen(captures) if e.id == name}
    # both in double precision; a broad line's band differs from a laser's, which changes only the order of sums
    assert _deviation(captures, effects, 5) < 1e-12


@pytest.mark.long
def test_each_result_that_is_kept_is_that_of_its_effects() -> None:
    """One predictor for all effects in turn gives what a new one gives, so that no key lacks a value. So it does where
    gradients are recorded, for which less is kept."""
    captures = _blank()
    kept = Predictor(captures)
    for effect in _seen(captures):
        effects = {effect.id: {p.name: p.nudged(0.5) for p in effect.parameters}}
        new = Predictor(captures)([3], effects).signal
        assert np.array_equal(kept([3], effects).signal, new), effect.id
        assert np.array_equal(kept([3], effects, grad=True).signal, new), effect.id


@pytest.fixture
def file(tmp_path: Path) -> Path:
    captures = make_captures(_chain(), {"leakage@coarse": {"amplitude": 0.2}}, AcquisitionSettings(2))
    write_captures(tmp_path / "chain.h5", captures)
    return tmp_path / "chain.h5"


def test_a_file_holds_the_levels_of_each_element_and_the_bench(file: Path) -> None:
    found = read_captures(file)
    captures = make_captures(_chain(), {"leakage@coarse": {"amplitude": 0.2}}, AcquisitionSettings(2))
    assert np.array_equal(found.levels, captures.levels) and np.array_equal(found.images, captures.images)
    assert found.slms == captures.slms and found.chain is not None
    assert found.chain.drive_shapes == {"slm": (1, 18, 24), "coarse": (1, 6, 8)}
    assert np.array_equal(Predictor(found)([2]).signal, Predictor(captures)([2]).signal)
    with h5py.File(file) as h5:
        assert h5["elements/coarse/levels"].shape == (8, 6, 8)
        assert "slm1" not in h5  # so that no reader takes it for a bench of the short form


def _changed(file: Path, change: Any) -> None:
    with h5py.File(file, "r+") as h5:
        change(h5)


WRONG: dict[str, tuple[Any, str]] = {
    "levels that are missing": (lambda h5: h5.pop("elements/coarse/levels"), "elements/coarse/levels: is missing"),
    "no TOML": (lambda h5: h5.attrs.__setitem__("chain", "[["), "attribute chain"),
    "a short form": (
        lambda h5: h5.attrs.__setitem__("chain", h5.attrs["chain"].split("[[elements]]")[0]),
        "attribute chain",
    ),
    "a file that would be read": (
        lambda h5: h5.attrs.__setitem__(
            "chain", h5.attrs["chain"].replace('pattern = "random"', 'file = "/etc/passwd"')
        ),
        "captures read no other files",
    ),
    "another shape": (
        lambda h5: h5.attrs.__setitem__(
            "chain", h5.attrs["chain"].replace("3,\n    4", "3,\n    3").replace("8,\n]", "9,\n]")
        ),
        "chain",
    ),
    "a level too high": (lambda h5: h5["elements/coarse/levels"].attrs.__setitem__("num_levels", 4), "elements/coarse"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_file_that_cannot_be_is_refused_in_a_sentence(file: Path, name: str) -> None:
    change, words = WRONG[name]
    _changed(file, change)
    with pytest.raises(hv.UserError, match=words) as caught:
        read_captures(file)
    assert str(file) in str(caught.value)


def test_what_a_capture_file_cannot_hold_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "mask.npy", np.full((18, 24), 0.5))
    own = {"name": "mask", "kind": "mask", "pitch": 8 * UM, "file": str(tmp_path / "mask.npy")}
    for elements, words in (
        ((PHASE, {"name": "wide", "kind": "complex", "pitch": 8 * UM, "shape": (18, 24)}), "a complex modulator"),
        ((PHASE, own), "a mask from a file"),
        ((PHASE | {"levels": [0, 0.3, 1]}, WAY, COARSE), "levels: aren't equal steps"),
    ):
        with pytest.raises(hv.UserError, match=words):
            make_captures(_chain(*elements))
    with pytest.raises(hv.UserError, match="focal length: with a chain"):
        make_captures(_chain(), settings=AcquisitionSettings(2, focal_length_m=0.1))


def test_the_levels_of_a_measured_table_are_those_of_an_effect(tmp_path: Path) -> None:
    """An amplitude modulator whose table is x^1.4, in the nominal bench or as what is hidden in one of equal steps."""
    table = (np.linspace(0, 1, 16) ** 1.4).tolist()
    settings = AcquisitionSettings(2)
    pair = [_chain(PHASE, WAY, COARSE | {"levels": levels}, LAST) for levels in (table, 16)]
    effect = {"amplitude_gamma@coarse": {"gamma": 1.4}}
    own, hidden = (make_captures(*made, settings) for made in zip(pair, ({}, effect), strict=True))
    assert np.array_equal(own.levels, hidden.levels)  # the levels that were sent
    np.testing.assert_array_equal(own.patterns(own.drive(3))["coarse"], np.array(table)[own.levels[3, 1, :6, :8]])
    before = own.levels[2, 1, :6, :8]
    np.testing.assert_array_equal(own.patterns(own.drive_before(3))["coarse"], np.array(table)[before])
    predicted = Predictor(own, double_precision=True)([3]).signal
    expected = Predictor(hidden, double_precision=True)([3], effect).signal
    np.testing.assert_allclose(predicted, expected, rtol=1e-9)
    assert not np.allclose(predicted, Predictor(hidden)([3]).signal, rtol=1e-2)  # of equal steps
    assert _deviation(replace(own, exposure_s=np.ones(len(own))), {}, 3) < 1e-12
    write_captures(tmp_path / "table.h5", own)
    read = read_captures(tmp_path / "table.h5")
    assert read.slms == own.slms and read.slms[1].shares == tuple(table)
    with h5py.File(tmp_path / "table.h5", "r+") as h5:
        h5["elements/coarse/levels"].attrs["num_levels"] = 17
    with pytest.raises(hv.UserError, match="num_levels: 17; expected 16, as the chain has"):
        read_captures(tmp_path / "table.h5")


def test_shares_are_sent_as_the_nearest_levels() -> None:
    table = np.linspace(0, 1, 16) ** 1.4
    chain = _chain(PHASE | {"levels": 16}, WAY, COARSE | {"levels": table.tolist()}, LAST)
    wanted = np.random.default_rng(5).uniform(0, 1, 200)
    for slm, shown in zip(_blank_of(chain).slms, (np.linspace(0, 1, 16), table), strict=True):
        sent = slm.levels_of(wanted)
        np.testing.assert_array_equal(np.abs(shown[sent.astype(int)] - wanted), np.abs(shown - wanted[:, None]).min(1))
        np.testing.assert_array_equal(slm.levels_of(slm.shares_of(np.arange(16))), np.arange(16))
        np.testing.assert_allclose(slm.shares_of(np.array([2.5])), shown[2:4].mean())


def test_captures_are_told_by_their_elements() -> None:
    """Their own sizes and levels; each in its column of the sheet, not padded to the largest."""
    chain = _chain(PHASE | {"levels": 16}, WAY, COARSE, LAST)
    told = summarise(make_captures(chain, settings=AcquisitionSettings(1)))
    assert told["geometry"] == "chain of elements" and told["levels"] == [16, 256]
    coarse = _chain(PHASE | {"shape": (6, 8)}, COARSE | {"pitch": 8 * UM})
    captures = make_captures(coarse, settings=AcquisitionSettings(1))
    wide = replace(captures, levels=np.pad(captures.levels, [(0, 0), (0, 0), (0, 12), (0, 16)]))
    assert np.array_equal(capture_sheet(wide), capture_sheet(captures))


def test_a_shared_pattern_is_the_same_in_all_captures() -> None:
    captures = blank_captures(
        _chain(PHASE, COARSE | {"shared": True}), AcquisitionSettings(3), np.random.default_rng(1)
    )
    assert (captures.levels[:, 1] == captures.levels[0, 1]).all()
    assert (captures.levels[:, 0] != captures.levels[0, 0]).any()


def _three() -> Captures:
    """Captures of three elements that show patterns, of different sizes."""
    last = PHASE | {"name": "last"}
    return make_captures(_chain(PHASE, WAY, COARSE, WAY | {"name": "on"}, last), settings=AcquisitionSettings(3))


def _with_inverted(captures: Captures, element: int) -> Captures:
    levels = captures.levels.copy()
    rows, columns = captures.chain.drive_shapes[NAMES[element]][1:]
    levels[:, element, :rows, :columns] = 255 - levels[:, element, :rows, :columns]
    return replace(captures, levels=levels)


def _with_late(captures: Captures, element: int) -> Captures:
    levels = captures.levels.copy()
    levels[:, element] = np.roll(levels[:, element], 1, axis=0)
    return replace(captures, levels=levels)


NAMES = ("slm", "coarse", "last")
MISTAKES = [
    ("", "", None, 0),
    ("inverted@last", "", _with_inverted, 2),
    ("capture_order", "offset:+1 of coarse", _with_late, 1),
]


@pytest.mark.long
@pytest.mark.parametrize(("effect", "choice", "change", "element"), MISTAKES)
def test_a_wrong_record_is_named_by_the_element(effect: str, choice: str, change: Any, element: int) -> None:
    right = _three()
    found = find_record_errors(right if change is None else change(right, element))
    assert [(one.effect, one.choice) for one in found.corrections] == ([(effect, choice)] if effect else [])
    for one in found.corrections:
        assert NAMES[element] in one.sentence and "modulator" not in one.sentence


def test_patterns_of_other_sizes_are_not_exchanged() -> None:
    for second, may in ((COARSE, False), (PHASE | {"name": "last"}, True)):
        captures = make_captures(_chain(PHASE, second, MASK), settings=AcquisitionSettings(1))
        assert SlmExchange().fits(captures) == may
