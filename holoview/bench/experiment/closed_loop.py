"""Takes captures until the cause is certain: each is chosen by the questions that the captures before it left open.

ClosedLoop   takes captures, judges them, and ends when the cause is certain or a budget is spent
Planner      chooses the next capture: by the information that it promises (`InformedPlanner`)
diagnose_rig opens a rig and runs a loop with it
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from holoview.bench.captures.dataset import Captures, join_captures
from holoview.bench.captures.predictor import check_known_effects, check_user_effects
from holoview.bench.diagnose.config import SearchConfig
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.diagnose.power_law import changes_only_power
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.bench.diagnose.search_context import SearchEnd, SearchEnded
from holoview.bench.experiment.capture_choice import (
    START_COUNT,
    BenchTime,
    CaptureChooser,
    NextCapture,
    Proposal,
    draw_proposals,
    planes_of,
    starting_proposals,
)
from holoview.bench.experiment.hypotheses import Belief, HypothesisFits, loop_context
from holoview.bench.experiment.rig_bench import KnownEffects, diagnosis_options
from holoview.bench.rig.capture_folder import loop_captures
from holoview.bench.rig.description import RigDescription, read_rig
from holoview.bench.rig.devices import Devices
from holoview.bench.rig.measurement import Measurement
from holoview.bench.rig.open_rig import open_rig
from holoview.light.model.effects.effect import Effect
from holoview.light.model.effects.registry import effects_of, get_effect
from holoview.light.model.fields import Duration, Integer, Number, described_field, with_field_docs
from holoview.util.errors import UserError
from holoview.util.files import read_text
from holoview.util.progress import no_progress

_SETTLED = (Verdict.EXPLAINED, Verdict.CONSISTENT)
# After a diagnosis that named other causes than the leading hypothesis, the next one waits for so many more captures,
# and for a third more at least.
_BETWEEN_CHECKS, _CHECK_SHARE = 1, 3
_CHECK_FIELDS = 0.25  # of the fields of a diagnosis, for those that the loop asks for before its end
_EVERY_FROM = 12  # captures; from here the hypotheses are fitted after every fourth one
_EVERY = 4
_PROPOSALS = 20
_SPREAD = "no proposed capture is expected to separate the remaining causes; captures of every kind follow"


@with_field_docs
@dataclass(frozen=True)
class LoopSettings:
    """When a loop ends. The ranges are those of a user's choice.

    Fields:
    """

    certainty: float = described_field(
        Number(low=0.5, high=np.nextafter(1, 0), words="0.5 or more, below 1"),
        "Probability of the cause at which to stop, if the diagnosis agrees.",
        default=0.99,
    )
    max_captures: int = described_field(Integer(1, 1_000_000), "Take at most so many.", flag="captures", default=40)
    bench_time_s: float = described_field(
        Duration(), "Take captures for at most so long, by the bench's clock.", default=math.inf
    )


_CONFIG = SearchConfig()  # of fits and diagnosis


@dataclass(frozen=True)
class LoopCapture:
    """A capture of the loop. number: from 1. reason: why it was taken. seconds: on the bench. believed: the most
    probable cause afterwards, in words, with its probability; None while there are too few captures. fields: computed
    for its choice and for the belief afterwards, without those of a diagnosis."""

    number: int
    choice: NextCapture
    seconds: float
    believed: tuple[str, float] | None = None
    fields: int = 0

    @property
    def sentence(self) -> str:
        """Such as "capture 7: 638 nm at 9 mm, white pattern on …: separates gap from aberration1 (…)"."""
        return f"capture {self.number}: {self.choice.proposal.place}: {self.choice.reason}"

    def as_json(self) -> dict[str, Any]:
        """For programs; SI units."""
        proposal = self.choice.proposal
        return {
            "number": self.number,
            "wavelength": proposal.wavelength_m,
            "distance": proposal.distance_m,
            "power": proposal.power,
            "pattern": proposal.words,
            "reason": self.choice.reason,
            "expected_information": round(self.choice.information, 6),
            "expected_delta_chi2": float(f"{self.choice.delta_chi2:.6g}"),
            "expected_seconds": float(f"{self.choice.seconds:.6g}"),
            "seconds": float(f"{self.seconds:.6g}"),
            "believed": None if self.believed is None else self.believed[0],
            "probability": None if self.believed is None else round(self.believed[1], 6),
            "fields": self.fields,
        }


@dataclass(frozen=True, eq=False)
class LoopResult:
    """The captures of a loop, their reasons and diagnosis, and why the loop ended. parts: the captures one by one."""

    parts: list[Captures]
    steps: tuple[LoopCapture, ...]
    diagnosis: Diagnosis
    ended: str
    is_certain: bool

    @property
    def sentence(self) -> str:
        """How the loop ended."""
        seconds = math.fsum(step.seconds for step in self.steps)
        return f"{len(self.parts)} captures, {seconds:.3g} s on the bench: {self.ended}"

    def as_json(self) -> dict[str, Any]:
        """For programs; SI units."""
        steps = [step.as_json() for step in self.steps]
        return {"ended": self.ended, "certain": self.is_certain, "captures": steps}


class ClosedLoop:
    """A loop. devices: open ones, which the caller closes. effects: the candidates. options: of `diagnose`; known
    effects among them replace those of the rig's placement."""

    def __init__(
        self,
        rig: RigDescription,
        devices: Devices,
        effects: Sequence[Effect],
        planner: Planner,
        settings: LoopSettings,
        *,
        keep: Callable[[int, Captures], None] = lambda number, capture: None,
        tell: Callable[[str], None] = lambda sentence: None,
        is_asked_to_end: Callable[[], bool] = lambda: False,
        **options: Any,
    ) -> None:
        self._rig, self._devices, self._effects, self._planner = rig, devices, list(effects), planner
        self._settings, self._keep, self._tell, self._is_asked = settings, keep, tell, is_asked_to_end
        self._options: dict[str, Any] = {**diagnosis_options(rig.registration), **options}
        self._measurement, self._time = Measurement(rig, devices), BenchTime.of(devices)
        self._fits, self._here_m, self._next_check = HypothesisFits(), rig.stage_m[0], START_COUNT
        self._belief: Belief | None = None
        self._fields = 0  # computed since the last step

    def run(self, before: Sequence[Captures] = ()) -> LoopResult:
        """Takes captures and diagnoses them. before: captures of a loop that this one goes on with.

        Raises UserError where no capture shows anything.
        """
        parts, steps, began = list(before), list[LoopCapture](), self._devices.clock.now()
        ended, diagnosis = "", None
        while not ended:
            ended = self._budget_end(len(parts), began)
            if ended:
                break
            try:
                choice = self._choose(parts)
            except SearchEnded:
                continue  # the next round says why
            if choice is None:
                ended = "the plan is at its end"
                break
            step, capture = self._take(len(parts) + 1, choice)
            parts.append(capture)
            self._keep(len(parts) - 1, capture)
            self._tell(step.sentence)
            diagnosis = self._judge(parts)
            belief = self._belief
            believed = None if belief is None else (belief.leader.name, belief.certainty)
            steps.append(dataclasses.replace(step, believed=believed, fields=self._fields))
            self._fields = 0
            if diagnosis is not None:
                ended = f"{believed[0] if believed else 'the cause'} is certain"
        if diagnosis is None:
            diagnosis = self._last_diagnosis(parts)
            return LoopResult(parts, tuple(steps), diagnosis, ended, False)
        return LoopResult(parts, tuple(steps), diagnosis, ended, True)

    def _budget_end(self, count: int, began: float) -> str:
        """Why no further capture is taken; empty while one may be."""
        settings = self._settings
        if self._is_asked():
            return "it was interrupted"
        if count >= settings.max_captures:
            return f"{count} captures are taken, as many as allowed"
        if self._devices.clock.now() - began >= settings.bench_time_s:
            return "the time on the bench is spent"
        return ""

    def _choose(self, parts: Sequence[Captures]) -> NextCapture | None:
        taken, belief = join_captures(parts) if parts else None, self._belief
        before = 0 if belief is None else belief.fields
        choice = self._planner.next(PlannerState(taken, len(parts), belief, self._here_m, self._time))
        self._fields += 0 if belief is None else belief.fields - before
        return choice

    def _take(self, number: int, choice: NextCapture) -> tuple[LoopCapture, Captures]:
        """One capture; the lasers are off afterwards, while the next capture is chosen."""
        clock, proposal = self._devices.clock, choice.proposal
        start = clock.now()
        try:
            capture = self._measurement.take(proposal.request, proposal.levels)
        finally:
            self._devices.lasers.switch_off()
        seconds = clock.now() - start
        self._time.note(proposal.distance_m - self._here_m, float(capture.exposure_s[0]), seconds)
        self._here_m = proposal.distance_m
        return LoopCapture(number, choice, seconds), capture

    def _judge(self, parts: Sequence[Captures]) -> Diagnosis | None:
        """Updates the belief; the diagnosis, if it ends the loop."""
        count = len(parts)
        if count < START_COUNT or (count > _EVERY_FROM and count % _EVERY and count < self._settings.max_captures):
            return None
        end = SearchEnd(is_asked=self._is_asked)
        try:
            context = loop_context(join_captures(parts), self._effects, _CONFIG, end, self._options["known"])
            self._belief = belief = self._fits.update(context, self._options.get("progress") or no_progress)
            self._fields += belief.fields
            is_certain = belief.explains and belief.certainty >= self._settings.certainty
            if not is_certain or count < self._next_check or self._can_show_more(belief):
                return None
            self._next_check = count + max(_BETWEEN_CHECKS, count // _CHECK_SHARE)
            diagnosis = self._diagnose(parts, self._effects, config=_with_fields(_CHECK_FIELDS))
            if self._agrees(diagnosis, belief):
                return diagnosis
            self._fits.include(context, [found for found in (_searched(diagnosis.values), *diagnosis.rivals) if found])
        except SearchEnded:
            pass
        return None

    def _can_show_more(self, belief: Belief) -> bool:
        """Whether further wavelengths or planes of this rig would show effects that the captures so far can't."""
        shown, lasers, planes = (
            belief.context.kept_captures.data_properties(),
            self._rig.wavelengths_m,
            planes_of(self._rig),
        )
        all_shown = dataclasses.replace(shown, wavelengths=len(lasers), planes=max(len(planes), shown.planes))
        return any(not effect.needs.unmet_by(all_shown) for effect in belief.context.unseen.values())

    def _agrees(self, diagnosis: Diagnosis, belief: Belief) -> bool:
        """Whether the diagnosis is sure of the cause that leads, by its own rules."""
        if diagnosis.verdict not in _SETTLED:
            return False
        equal = belief.context.equivalents
        named, led = _searched(diagnosis.values), belief.leader.causes
        return len(named) == len(led) and all(n in led or equal.get(n, frozenset()) & {*led} for n in named)

    def _diagnose(self, parts: Sequence[Captures], effects: Sequence[Effect], **options: Any) -> Diagnosis:
        """A diagnosis, which also corrects the placement of an aligned rig."""
        options = {"config": _CONFIG, **self._options, **options}
        found = diagnose(join_captures(parts), effects, **options)
        self._options["known"] = found.known
        return found

    def _last_diagnosis(self, parts: Sequence[Captures]) -> Diagnosis:
        """The diagnosis at the end of a budget; after an interruption, of the hypotheses that are left alone."""
        if not parts:
            raise UserError("captures", "none was taken", expected="at least one")
        if not self._is_asked():
            return self._diagnose(parts, self._effects, forecast=self._tell)
        left = set() if self._belief is None else {name for h in self._belief.hypotheses for name in h.causes}
        effects = [effect for effect in self._effects if effect.id in left]
        found = self._diagnose(parts, effects, free_maps=False)
        note = "The loop was interrupted; only the causes that were left were searched."
        return dataclasses.replace(found, notes=(*found.notes, note))


def _with_fields(share: float) -> SearchConfig:
    """The configuration with a share of the budget of fields."""
    budget = dataclasses.replace(_CONFIG.budget, max_fields=round(share * _CONFIG.budget.max_fields))
    return dataclasses.replace(_CONFIG, budget=budget)


def _searched(values: Any) -> tuple[str, ...]:
    """The causes of a diagnosis that the hypotheses can hold: pictures show them, not the gains alone."""
    return tuple(name for name in values if not changes_only_power(get_effect(name)))


@dataclass(frozen=True)
class PlannerState:
    """The knowledge of a planner. taken: the captures so far, None before the first. count: how many.

    belief: drawn from the captures; None while there are too few. here_m: where the stage is. time: of captures on this
    bench.
    """

    taken: Captures | None
    count: int
    belief: Belief | None
    here_m: float
    time: BenchTime


class Planner(Protocol):
    """Chooses the next capture."""

    def next(self, state: PlannerState) -> NextCapture | None:
        """The next capture; None where there is no further one."""


class InformedPlanner:
    """A few captures to begin with, then those that promise most information per second."""

    def __init__(self, rig: RigDescription) -> None:
        self._rig, self._rng = rig, np.random.default_rng((0, 1))
        self._start = starting_proposals(rig, seed=0)

    def next(self, state: PlannerState) -> NextCapture | None:
        """One of the captures to begin with, or the best of random proposals."""
        if state.count < START_COUNT:
            return NextCapture(self._start[state.count], f"one of {START_COUNT} to begin with")
        proposals = draw_proposals(self._rig, self._rng, _PROPOSALS)
        if state.belief is None or state.taken is None:
            return NextCapture(proposals[0], _SPREAD)
        chooser = CaptureChooser(state.belief, state.taken, self._rig.limits, state.time, state.here_m)
        choice = chooser.choose(proposals)
        if choice.promises_something:
            return choice
        return NextCapture(chooser.sharpest(self._rarest(proposals, state.taken)), _SPREAD)

    def _rarest(self, proposals: list[Proposal], taken: Captures) -> list[Proposal]:
        """The bright proposals whose wavelength, then whose plane, has been taken least often."""
        bright = [p for p in proposals if p.brightness == 1.0] or proposals

        def times(proposal: Proposal) -> tuple[int, int]:
            of_wavelength = int((taken.wavelength_m == proposal.wavelength_m).sum())
            return of_wavelength, int((taken.distance_m == proposal.distance_m).sum())

        fewest = min(times(proposal) for proposal in bright)
        return [proposal for proposal in bright if times(proposal) == fewest]


# --- the whole experiment ---------------------------------------------------------------------------------------------


def diagnose_rig(
    file: Path,
    known: KnownEffects,
    settings: LoopSettings,
    user_effects: Sequence[Effect],
    save: Path | None,
    *,
    tell: Callable[[str], None],
    is_asked_to_end: Callable[[], bool],
    **options: Any,
) -> tuple[Captures, LoopResult]:
    """Takes captures with the rig of rig.toml until the cause is certain; returns them, and what the loop found.

    known: effects of the bench, beside the placement of an aligned rig. user_effects: are evaluated once with the first
    capture. save: the file of the captures; the folder beside it keeps the captures of an interrupted loop, which goes
    on. options: of the diagnosis. Raises UserError for a wrong description, device or capture.
    """
    rig = read_rig(file)
    known = known.with_placement(rig.registration)
    stated = known.added_to({})
    folder = None if save is None else loop_captures(save, read_text(file, "a rig"))
    before = [] if folder is None else folder.resume()
    effects, planner = effects_of(rig.blank_capture().data_properties()), InformedPlanner(rig)
    options |= {"known": stated, "uncertain": known.uncertain, "tell": tell, "is_asked_to_end": is_asked_to_end}

    def keep(number: int, capture: Captures) -> None:
        if folder is not None:
            folder.write(number, capture)
        if number == 0:
            check_user_effects(capture, user_effects)
            check_known_effects(capture, stated)

    try:
        with open_rig(rig) as devices:
            result = ClosedLoop(rig, devices, effects, planner, settings, keep=keep, **options).run(before)
    except (UserError, KeyboardInterrupt):
        if folder is not None:
            tell(f"the captures are in {folder.folder}; the same command goes on")
        raise
    if folder is None or save is None:
        return join_captures(result.parts), result
    return folder.join_into(save, result.parts), result
