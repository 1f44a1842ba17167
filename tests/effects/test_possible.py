"""An effect that a bench can't have is refused everywhere with the same sentence, and one that it can have nowhere."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor, check_known_effects, check_user_effects
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.bench.diagnose.fit import free_parameters_of
from holoview.commands.cli import main
from holoview.light.model.effects.effect import CAMERA_HOOKS, Effect, ListParameter, Parameter
from holoview.light.model.effects.hook_contexts import RelayContext
from holoview.light.model.effects.registry import (
    ActiveEffects,
    bench_properties,
    effect_on_bench,
    get_effect,
    listed_effects,
    parameter_unmet_by_bench,
    unmet_by_bench,
    unmet_by_data,
)
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.viewer.document.editing_session import EditingSession
from tests.explored import one_of_each

Make = Callable[..., Captures]
Values = Mapping[str, Mapping[str, Any]]
IDS = list(listed_effects())
SEEN = [name for name, effect in listed_effects().items() if not set(effect.hooks) <= set(CAMERA_HOOKS)]
SENTENCE = re.compile(r"effects\.[\w.]+: (it needs|it doesn't act|relay|acts on).*; switch it off, or describe")
FOURIER = AcquisitionSettings(1, focal_length_m=0.1)


def _bench(kind: str) -> System:
    modulator = hv.Modulator("8 um", (8, 8), "800 nm")
    if kind == "field":
        plane = hv.Modulator("8 um", (16, 16), content="field")
        sampling = hv.Sampling(upsample=1)
        return hv.System(["520 nm"], [[1.0]], [plane], planes_m=["3 mm"], observer="mono", sampling=sampling)
    two = kind == "two modulators"
    stops = {"relay2": {"iris_na": 0.03}} | ({"relay1": {"iris_na": 0.03}} if two else {})
    gap = "1 mm" if two else None
    plain = hv.System(["520 nm"], [[1.0]], [modulator] * (1 + two), gap_m=gap, planes_m=["3 mm"], observer="mono")
    return plain if kind == "without stops" else plain.edit(stops)


def _values(name: str) -> dict[str, Any]:
    """A tenth of the usual size."""
    return {p.name: p.nudged(0.1) for p in listed_effects()[name].parameters}


def _possible_values(name: str, system: System) -> dict[str, Any]:
    """The same of the parameters whose part the bench has."""
    bench = bench_properties(system)
    return {p.name: p.nudged(0.1) for p in get_effect(name).parameters if not parameter_unmet_by_bench(p, bench)}


def _answers(system: System, name: str, values: Mapping[str, Any]) -> Iterator[tuple[str, Callable[[], object]]]:
    """Everything that takes effects, by name."""
    effects = {name: values}

    def with_effects() -> System:
        return system.edit({"effects": effects})

    def drive() -> Any:
        rng = np.random.default_rng(2)
        noise = rng.random(system.drive_shape)
        return np.exp(2j * np.pi * noise) if system.is_field else noise

    yield "simulate", lambda: hv.simulate(with_effects(), drive(), backend="torch")
    yield "field_at", lambda: hv.field_at(with_effects(), drive())
    yield "the bench as it is built", lambda: ActiveEffects(effects).as_built(system)
    if not system.is_field:
        yield "an edit of the viewer", lambda: EditingSession(system).change("On", {"effects": effects})
        target = np.full((1, *(2 * np.array(system.modulators[0].shape)), 3), 0.1, np.float32)
        yield "captures", lambda: make_captures(system, effects, AcquisitionSettings(1))
        yield "optimise", lambda: next(hv.iterate(with_effects(), target, hv.Settings(iterations=1)))


@pytest.mark.parametrize(
    ("name", "kind"), one_of_each(product(IDS, ["one modulator", "two modulators", "without stops", "field"]))
)
def test_all_that_take_effects_accept_one_or_refuse_it_alike(name: str, kind: str) -> None:
    system = _bench(kind)
    for values in (_values(name), _possible_values(name, system)):
        sentences = {what: _refusal(act) for what, act in _answers(system, name, values)}
        assert len(set(sentences.values())) == 1, sentences


@pytest.mark.parametrize("name", IDS)
def test_so_do_all_that_take_effects_of_captures(name: str, make_session: Make, make_fourier: Make) -> None:
    """Without iris, and on a Fourier bench."""
    for captures in (make_session(1, 1, relay2=hv.Relay()), make_fourier(1)):
        effects = {name: _values(name)}
        predict = Predictor(captures)
        answers: dict[str, Callable[[], object]] = {
            "predict": lambda predict=predict, effects=effects: predict([0], effects),
            "without lasers": lambda predict=predict, effects=effects: predict.without_lasers([0], effects),
            "known effects": lambda captures=captures, effects=effects: check_known_effects(captures, effects),
        }
        if captures.is_fourier:
            bench = _bench("without stops")
            answers["virtual captures"] = lambda effects=effects, bench=bench: make_captures(bench, effects, FOURIER)
        sentences = {what: _refusal(act) for what, act in answers.items()}
        assert len(set(sentences.values())) == 1, sentences


@pytest.mark.parametrize(
    ("kind", "name", "sentence"),
    [
        ("one modulator", "gap", "it needs 2 modulators, there are 1"),
        ("one modulator", "slm2_stuck", "it needs 2 modulators, there are 1"),
        ("without stops", "iris2", "relay 2 has neither an iris nor a square stop"),
        ("field", "stroke", "acts on a modulator, and a field has none"),
        ("field", "flicker", "acts on a modulator, and a field has none"),
        ("field", "source_profile", "acts on a modulator, and a field has none"),
    ],
)
def test_the_sentence_says_what_the_bench_lacks(kind: str, name: str, sentence: str) -> None:
    with pytest.raises(UserError, match=f"effects.{name}: {sentence}"):
        _bench(kind).edit({"effects": {name: _values(name)}})


@pytest.mark.parametrize(
    ("name", "parameter"),
    [
        ("lut", "gamma2"),
        ("lut", "level2_05"),
        ("lut_dispersion", "slope2"),
        ("slm_flatness", "z5_2"),
        ("stroke", "difference"),
        ("stroke_map", "z2_2"),
        ("undiffracted", "difference"),
        ("settling", "share2"),
    ],
)
def test_a_parameter_of_a_part_that_the_bench_lacks_is_refused_and_no_fit_varies_it(
    name: str, parameter: str, make_session: Make
) -> None:
    values = {p.name: p.nudged(0.1) for p in get_effect(name).parameters if p.name == parameter}
    sentences = {what: _refusal(act) for what, act in _answers(_bench("one modulator"), name, values)}
    words = f"effects.{name}.{parameter}: acts on modulator 2, which this bench doesn't have; switch it off"
    assert all(sentence.startswith(words) for sentence in sentences.values()), sentences
    assert {_refusal(act) for _, act in _answers(_bench("two modulators"), name, values)} == {""}
    captures = make_session(1, 1)
    with pytest.raises(UserError, match=words):
        check_known_effects(captures, {name: values})
    varied = effect_on_bench(get_effect(name), captures.data_properties())
    free = [p.name for _, p in free_parameters_of([varied], include_fine=True).entries]
    assert parameter not in free and len(free) == len(set(free))
    assert all("2" not in start or "2_" not in start for start in varied.starting_points(captures.nominal_system()))


@pytest.mark.parametrize(("name", "kind"), one_of_each(product(SEEN, ["one modulator", "two modulators"])))
def test_a_parameter_that_is_set_changes_the_picture_or_is_refused_or_told(name: str, kind: str) -> None:
    """Each alone, at its usual size, hard edges at four times it: the grid is coarse. A billionth is no change."""
    system = _bench(kind).edit({"frames": 2, "planes": ["1 mm"], "amplitudes": [[0.5], [0.5]]})
    effect, rng = get_effect(name), np.random.default_rng(5)
    if unmet_by_bench(effect, bench_properties(system)):
        return
    drive = rng.random(system.drive_shape)
    plain = hv.simulate(system, drive, backend="torch64")
    for p in effect.parameters:
        if isinstance(p, ListParameter):
            continue
        value = p.nudged(4.0 if p.non_smooth else 1.0)
        try:
            view = hv.simulate(system.edit({"effects": {name: {p.name: value}}}), drive, backend="torch64")
        except UserError as error:
            assert SENTENCE.match(str(error)), p.name
            continue
        is_told = any(f"effects.{name}.{p.name} " in note for note in view.notes)
        changed = view.intensity.sum(axis=1) - plain.intensity.sum(axis=1)
        assert is_told != (np.abs(changed).max() > 1e-9 * plain.intensity.max()), p.name


def test_parameters_of_lasers_that_are_left_out_and_of_nothing_are_told() -> None:
    system = _bench("one modulator")
    for name, values, words in (
        ("slm1_fringes", {"cos1": 0.1, "cos2": 0.1}, "effects.slm1_fringes.cos2 acts on laser 2, and there are 1"),
        ("bandwidth", {"top": 0.5}, "effects.bandwidth.top changes nothing without sigma"),
        ("second_line", {"offset": 1e-9}, "effects.second_line.offset changes nothing without share"),
        ("settling", {"share1": 0.2}, "effects.settling changes nothing of one frame"),
    ):
        noted = hv.simulate(system.edit({"effects": {name: values}}), np.zeros(system.drive_shape), backend="torch")
        assert any(words in note for note in noted.notes)


def test_the_command_line_refuses_it_and_an_effect_may_act_on_what_the_same_command_sets(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = ["holochrome-8-1slm-open", "--set", "shape=[8,8]", "--effects", "iris2.radius_error=0.1"]
    out = ["-o", str(tmp_path / "a.png"), "--backend", "torch"]
    assert main(["render", *small, *out]) == 2
    assert SENTENCE.search(capsys.readouterr().err)
    assert main(["render", *small, "--set", "relay2.iris_na=0.02", *out]) == 0
    made = ["captures", "make", "holochrome-8-1slm-open", *small[1:], "--each", "1", "-o", str(tmp_path / "a.h5")]
    assert main(made) == 2
    assert SENTENCE.search(capsys.readouterr().err)


def _refusal(act: Callable[[], object]) -> str:
    """The sentence with which something refuses an effect that the bench can't have; empty where it takes it."""
    try:
        act()
    except UserError as error:
        return str(error) if SENTENCE.match(str(error)) else ""
    return ""


class _Dust(Effect):
    """Of a user, who states no `needs`."""

    id, cause, finding = "dust", "There is dust between the modulators.", "Dust takes {share} of the light."
    parameters = (Parameter("share", "Share of the light.", low=0.0, high=0.9, prior=0.1),)
    acts_on = ("relay 1",)

    def pupil(self, pupil: Any, context: RelayContext, v: Any) -> Any:
        return pupil * (1 - v["share"])


class _DustBehind(_Dust):
    acts_on = ("relay 2",)


def test_an_effect_whose_place_a_bench_lacks_is_refused_and_no_candidate_there(
    make_session: Make, make_fourier: Make
) -> None:
    """It would change nothing without a word: with one modulator, and the pupil of a relay on a Fourier bench."""
    for effect, captures, words in (
        (_Dust(), make_session(1, 1), "acts on relay 1, and this bench has camera, modulator 1, relay 2, source only"),
        (_DustBehind(), make_fourier(1), "acts on the pupil of a relay, and a Fourier bench has none"),
    ):
        with pytest.raises(UserError, match=f"effects.dust: {words}; switch it off"):
            Predictor(captures, (effect,))([0], {"dust": {"share": 0.1}})
        assert unmet_by_data(effect, captures.data_properties()) == words
        check_user_effects(captures, [effect])  # passes it over
    near = make_session(1)
    assert not unmet_by_data(_Dust(), near.data_properties())
    assert Predictor(near, (_Dust(),))([0], {"dust": {"share": 0.1}}).signal.isfinite().all()
