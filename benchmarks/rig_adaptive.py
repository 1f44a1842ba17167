"""Measures how many captures a closed loop needs until it names the causes that a virtual bench hides.

    python -m benchmarks.rig_adaptive --first 0 --count 12 -o out/rig_adaptive.jsonl
    python -m benchmarks.rig_adaptive --summary out/rig_adaptive.jsonl

Each bench is drawn from a seed and sealed behind the devices, from which counts alone come; every listed effect is a
candidate. It is measured by the closed loop (`informed`), by captures drawn as the loop's proposals are (`random`), by
a loop that chooses with the truth in place of its leading hypothesis (`oracle`), and by the default plan of `holoview
measure` in its order (`fixed`). All end by the same rule, from the second capture on: the posterior probability of the
leader reaches 0.99, every effect shows that the rig can show, and the diagnosis of the captures is sure of the same
causes. Kinds: one effect (single), two (pair), effects that look alike on a bench with one plane or one laser (alike),
none (nothing). A run that the file already holds isn't repeated.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from benchmarks.common import append_line, count_of, lines_or_summary, read_lines
from benchmarks.diagnosis import bench
from holoview.bench.diagnose.fit import free_parameters_of, has_list
from holoview.bench.diagnose.power_law import changes_only_power
from holoview.bench.experiment.capture_choice import NextCapture, Proposal, draw_proposals
from holoview.bench.experiment.closed_loop import (
    ClosedLoop,
    InformedPlanner,
    LoopSettings,
    Planner,
    PlannerState,
)
from holoview.bench.experiment.hypotheses import Hypothesis, with_probabilities
from holoview.bench.rig.capture_plan import default_plan
from holoview.bench.rig.description import RigDescription, read_rig
from holoview.light.model.effects.registry import get_effect, listed_effects
from tests.diagnose.effect_sampling import sample_effect
from tests.experiment.next_capture.benches import BenchInProcess

ALIKE = ("gap", "distance", "wavelength_offset", "stage", "dispersion")
SIZES = (0.03, 0.1, 0.3)  # of the edge of the range that a diagnosis scans
PLANNERS = ("informed", "random", "oracle", "fixed")
MAX_CAPTURES = 8
BENCH = """
[slm1]
device = "virtual"
shape = [48, 64]
pitch = "8 um"
num_levels = 256
opd_range = "825 nm"
settle = 0.1
[slm2]
device = "virtual"
shape = [48, 64]
pitch = "8 um"
num_levels = 256
opd_range = "825 nm"
settle = 0.1
[camera]
device = "virtual"
shape = [48, 64]
pitch = "8 um"
bit_depth = 12
electrons_per_count = 4.0
read_noise = 3.0
black_level = 64
[lasers]
device = "virtual"
wavelengths = {wavelengths}
[stage]
device = "virtual"
range = {range}
[limits]
power = 1.0
exposure = [1e-5, 0.5]
[geometry]
gap = "1 mm"
iris1_na = 0.03
iris2_na = 0.03
[virtual]
bench = "hidden.toml"
"""


class RandomPlanner:
    """Captures drawn as the proposals are, whatever is known."""

    def __init__(self, rig: RigDescription, seed: int = 0) -> None:
        self._rig, self._rng = rig, np.random.default_rng((seed, 2))

    def next(self, state: PlannerState) -> NextCapture | None:
        """A random one."""
        return NextCapture(draw_proposals(self._rig, self._rng, 1)[0], "drawn by chance")


class OraclePlanner(InformedPlanner):
    """Chooses as the loop does, but with the truth as its leading hypothesis, which leaves the others to exclude."""

    def __init__(self, rig: RigDescription, truth: dict[str, dict[str, Any]]) -> None:
        super().__init__(rig)
        self._truth = truth

    def next(self, state: PlannerState) -> NextCapture | None:
        """The capture that promises most where the truth is as probable as the loop's leader."""
        belief = state.belief
        if belief is None or any(name not in belief.context.effects for name in self._truth):
            return super().next(state)
        effects = [belief.context.effects[name] for name in self._truth]
        free = free_parameters_of(effects, self._truth)
        weight = belief.leader.log_weight
        known = Hypothesis(tuple(self._truth), self._truth, free, np.zeros((len(free), len(free))), weight)
        rivals = [h for h in belief.hypotheses if {*h.causes} != {*self._truth}]
        ordered, p = with_probabilities([known, *rivals])
        return super().next(replace(state, belief=replace(belief, hypotheses=ordered, probabilities=p)))


class FixedPlanner:
    """The default plan of `holoview measure`, in its order."""

    def __init__(self, rig: RigDescription) -> None:
        self._rig, self._requests = rig, default_plan(rig).requests

    def next(self, state: PlannerState) -> NextCapture | None:
        """The next one of the plan; None at its end."""
        if state.count >= len(self._requests):
            return None
        request = self._requests[state.count]
        words = f"noise blurred by {request.sigma_px:g} px"
        levels = request.levels(self._rig)
        proposal = Proposal(request.wavelength_m, request.distance_m, request.power, levels, words)
        return NextCapture(proposal, "next of the plan")


def hidden_candidates() -> list[str]:
    """Effects that pictures show at any plane, without lists of pixels, and whose predictions add few fields."""
    costly = {"bandwidth", "flicker", "plane_errors", "source_extent"}
    return [
        name
        for name, effect in listed_effects().items()
        if not (changes_only_power(effect) or has_list(effect) or name in costly)
    ]


def draw_case(seed: int) -> dict[str, Any]:
    """Kind and hidden effects of a bench: of four benches two with one effect, one with a pair, one of look-alikes."""
    rng = np.random.default_rng(seed)
    kind = "nothing" if seed % 16 == 15 else ("single", "alike", "single", "pair")[seed % 4]
    size = SIZES[int(rng.integers(len(SIZES)))]
    one_plane = kind == "alike" and bool(rng.random() < 0.5)
    among = [n for n in ALIKE if not one_plane or n != "stage"] if kind == "alike" else hidden_candidates()
    count = {"nothing": 0, "pair": 2}.get(kind, 1)
    names = sorted(rng.choice(among, size=count, replace=False).tolist())
    return {"seed": seed, "kind": kind, "size": size, "one_plane": one_plane, "truth": sample_effects(names, size, rng)}


def sample_effects(names: Sequence[str], size: float, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """Values of hidden effects of such a size."""
    system = replace(bench(48, 64), wavelengths_m=np.array([450e-9, 638e-9]), amplitudes=np.ones((1, 2)))
    return {name: sample_effect(get_effect(name), system, size, rng) for name in names}


def make_rig(case: dict[str, Any], folder: Path) -> RigDescription:
    """The rig of a case, with what is hidden in a file that the bench alone reads."""
    ends = '["5 mm", "5 mm"]' if case["one_plane"] else '["0 mm", "10 mm"]'
    hidden = {"seed": case["seed"], "settle": 0.005, "prnu": 0.005, "effects": case["truth"]}
    (folder / "hidden.toml").write_text(tomli_w.dumps(hidden), encoding="utf-8")
    text = BENCH.format(wavelengths='["450 nm", "638 nm"]', range=ends)
    (folder / "rig.toml").write_text(text, encoding="utf-8")
    return read_rig(folder / "rig.toml")


def run_case(case: dict[str, Any], name: str, most: int) -> dict[str, Any]:
    """One bench measured by one planner in at most so many captures."""
    marks = [time.process_time()]
    with tempfile.TemporaryDirectory() as folder:
        rig = make_rig(case, Path(folder))
        planner = _planner(name, rig, case)
        with BenchInProcess(rig).devices() as devices:
            effects, settings = list(listed_effects().values()), LoopSettings(max_captures=most)

            def tell(sentence: str) -> None:
                marks.append(time.process_time())

            result = ClosedLoop(rig, devices, effects, planner, settings, tell=tell, free_maps=False).run()
            seconds = devices.clock.now()
    marks.append(time.process_time())
    named = sorted(result.diagnosis.values)
    return case | {
        "planner": name,
        "named": named,
        "verdict": str(result.diagnosis.verdict),
        "rivals": [list(causes) for causes in result.diagnosis.rivals],
        "certain": result.is_certain,
        "right": are_same(named, list(case["truth"])),
        "captures": len(result.parts),
        "bench_seconds": round(seconds, 3),
        "processor_seconds": round(marks[-1] - marks[0], 1),
        "thinking_seconds": [round(after - before, 1) for before, after in itertools.pairwise(marks)],
        "fields": [step.fields for step in result.steps],
        "reasons": [step.sentence for step in result.steps],
    }


def _planner(name: str, rig: RigDescription, case: dict[str, Any]) -> Planner:
    if name == "random":
        return RandomPlanner(rig, case["seed"])
    if name == "oracle":
        return OraclePlanner(rig, case["truth"])
    return FixedPlanner(rig) if name == "fixed" else InformedPlanner(rig)


def are_same(named: Sequence[str], truth: Sequence[str]) -> bool:
    """Whether these are the same causes, or the same physics under other names."""

    def are_equal(a: str, b: str) -> bool:
        return a == b or a in get_effect(b).degenerate_with or b in get_effect(a).degenerate_with

    return len(named) == len(truth) and all(any(are_equal(a, b) for a in named) for b in truth)


def summarise(file: Path) -> None:
    """Prints a table: for each kind and planner how often the right causes were named, and at what price.

    Captures: of all benches, and the median. Seconds of thinking: of the processor before each capture and after the
    last, with the final diagnosis; median (most)."""
    rows = read_lines(file)
    groups: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row["kind"], row["planner"]].append(row)
        groups["all", row["planner"]].append(row)
    print("| benches | captures by | certain and right | and wrong | captures | median | bench s | s of thinking |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for (kind, planner), own in sorted(groups.items()):
        right = sum(r["certain"] and r["right"] for r in own)
        wrong = sum(r["certain"] and not r["right"] for r in own)
        counts, seconds = [r["captures"] for r in own], statistics.median(r["bench_seconds"] for r in own)
        thinking = [s for r in own for s in r["thinking_seconds"]]
        cells = f"{sum(counts)} | {statistics.median(counts):g} | {seconds:.3g}"
        times = f"{statistics.median(thinking):.3g} ({max(thinking):.3g})"
        print(f"| {kind} | {planner} | {right} of {len(own)} | {wrong} | {cells} | {times} |")


def main() -> None:
    """Measures, or prints a summary of what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0, help="seed of the first bench")
    parser.add_argument("--count", type=int, default=12, help="benches")
    parser.add_argument("--step", type=int, default=1, help="between two seeds, for several processes side by side")
    parser.add_argument("--captures", type=count_of, default=MAX_CAPTURES, help=f"at most ({MAX_CAPTURES})")
    parser.add_argument("--planners", nargs="+", choices=PLANNERS, default=list(PLANNERS))
    args = lines_or_summary(parser, "rig_adaptive", summarise)
    before = read_lines(args.output) if args.output.exists() else []
    done = {(row["seed"], row["planner"]) for row in before}
    for seed in range(args.first, args.first + args.count * args.step, args.step):
        for planner in args.planners:
            if (seed, planner) in done:
                continue
            row = run_case(draw_case(seed), planner, args.captures)
            append_line(args.output, row)
            print({key: value for key, value in row.items() if key != "reasons"}, flush=True)


if __name__ == "__main__":
    main()
