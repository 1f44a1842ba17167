"""Measures how many bad captures a diagnosis finds, how many good ones it blames, and its wrong all-clears.

    python -m benchmarks.bad_captures --sessions 60 -o out/bad-captures.jsonl
    python -m benchmarks.bad_captures --sessions 200 --known

Each session is measured by the tests' independent program (`tests/diagnose/independent.py`), on a bench that is as
recorded or has one fault, drawn from its seed. Sessions with a mishap have one or two bad captures of one kind; every
fourth has none. With --known the fault counts as known, so that nothing is searched for and only captures are judged. A
wrong all-clear is `consistent` without all bad captures named, or with a fault of the bench.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import Counter, defaultdict
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from holoview.bench.captures import read_captures
from holoview.bench.captures.predictor import SamplingConfig
from holoview.bench.diagnose.pipeline import diagnose
from tests.diagnose.independent import Faults, Laboratory, Mishaps, write_session

KINDS = ("exchanged", "other pattern", "dark", "saturated", "moved", "out of focus", "noisy", "duplicate")
EFFECTS = {
    "gap_m": ("gap", ("gap_error",)),
    "distance_m": ("distance", ("distance_error",)),
    "stroke": ("stroke", ("stroke_error",)),
    "tilt_rad": ("tilt", ("tilt_y", "tilt_x")),
    "black": ("camera_black", ("black",)),
}
WHY = {"exchanged": "exchanged with", "other pattern": "another pattern"}


@dataclass
class Session:
    """What was drawn, and what the diagnosis said."""

    seed: int
    kind: str
    fault: dict[str, object]
    bad: list[int]
    named: dict[int, str] = field(default_factory=dict)
    captures: int = 0
    verdict: str = ""
    causes: list[str] = field(default_factory=list)
    seconds: float = 0.0


def draw(seed: int) -> tuple[Session, Laboratory]:
    """A session of 12 to 32 captures of one to four wavelengths."""
    rng = np.random.default_rng(seed)
    wavelengths = ((600e-9,), (450e-9, 600e-9), (450e-9, 520e-9, 580e-9, 638e-9))[seed % 3]
    each = {1: 12, 2: int(rng.integers(6, 12)), 4: int(rng.integers(4, 9))}[len(wavelengths)]
    count = each * len(wavelengths)
    kind = KINDS[seed // 4 % len(KINDS)] if seed % 4 else "none"
    bad = sorted(int(k) for k in rng.choice(count, 2 if kind == "exchanged" or seed % 2 else 1, replace=False))
    faults, told = _fault(rng) if rng.random() < 0.5 else (Faults(), {})
    mishaps = _mishaps(rng, kind, bad, count)
    bad = [] if kind == "none" else bad
    laboratory = Laboratory(wavelengths_m=wavelengths, each=each, fine=2, seed=seed, faults=faults, mishaps=mishaps)
    return Session(seed, kind, told, bad, captures=count), laboratory


def _fault(rng: np.random.Generator) -> tuple[Faults, dict[str, object]]:
    """One fault of the bench, from small to large."""
    size, sign = float(rng.uniform(0.1, 1.0)), float(rng.choice([-1.0, 1.0]))
    told: dict[str, object] = [
        {"gap_m": sign * size * 4e-4},
        {"distance_m": sign * size * 6e-4},
        {"stroke": sign * size * 0.3},
        {"tilt_rad": (sign * size * 4e-3, -size * 2e-3)},
        {"black": sign * size * 30},
    ][int(rng.integers(5))]
    return Faults(**told), told  # type: ignore[arg-type]


def _mishaps(rng: np.random.Generator, kind: str, bad: list[int], count: int) -> Mishaps:
    """What goes wrong with the bad captures."""
    others = [k for k in range(count) if k not in bad]
    if kind == "exchanged":
        return Mishaps(exchanged=((bad[0], bad[1]),))
    if kind == "other pattern":
        return Mishaps(other_pattern=tuple(bad))
    if kind == "dark":
        return Mishaps(dark=tuple(bad))
    if kind == "saturated":
        return Mishaps(overexposed={k: float(rng.uniform(4, 20)) for k in bad})
    if kind == "moved":
        return Mishaps(moved={k: (float(rng.uniform(0.5, 4)), float(rng.uniform(-4, -0.5))) for k in bad})
    if kind == "out of focus":
        return Mishaps(defocused={k: float(rng.choice([-1, 1]) * rng.uniform(1e-4, 1.2e-3)) for k in bad})
    if kind == "noisy":
        return Mishaps(noisy={k: float(rng.uniform(20, 100)) for k in bad})
    if kind == "duplicate":
        return Mishaps(repeated={k: int(rng.choice(others)) for k in bad})
    return Mishaps()


def solve(seed: int, folder: Path, is_known: bool) -> Session:
    """One session, diagnosed with the whole library, or with the fault known and without candidates."""
    session, laboratory = draw(seed)
    captures = read_captures(write_session(folder / "c.h5", laboratory))
    known = {
        EFFECTS[k][0]: dict(zip(EFFECTS[k][1], np.atleast_1d(v).tolist(), strict=True))
        for k, v in session.fault.items()
    }
    began = time.monotonic()
    found = diagnose(
        captures,
        [] if is_known else None,
        known=known if is_known else None,
        workers=1,
        free_maps=False,
        sampling=SamplingConfig(padding=3),
    )
    session.seconds = time.monotonic() - began
    session.named = {b.index: b.why for b in found.bad_captures}
    session.fault = {} if is_known else session.fault
    session.verdict, session.causes = str(found.verdict), [c.effect for c in found.causes]
    return session


def is_wrong_all_clear(session: Session) -> bool:
    """Whether a session with something wrong is called consistent without it being told."""
    unnamed = not set(session.bad) <= {int(k) for k in session.named}
    return session.verdict == "consistent" and (unnamed or bool(session.fault))


def summary(sessions: list[Session]) -> str:
    """Rates by kind."""
    kinds: dict[str, list[Session]] = defaultdict(list)
    for session in sessions:
        kinds[session.kind].append(session)
    lines = []
    for kind, some in kinds.items():
        named = [{int(k): why for k, why in s.named.items()} for s in some]
        found = sum(k in n for s, n in zip(some, named, strict=True) for k in s.bad)
        right = sum(
            n.get(k, "").startswith(WHY.get(kind, kind)) for s, n in zip(some, named, strict=True) for k in s.bad
        )
        blamed = sum(k not in s.bad for s, n in zip(some, named, strict=True) for k in n)
        good = sum(s.captures - len(s.bad) for s in some)
        verdicts = ", ".join(f"{k} {v}" for k, v in Counter(s.verdict for s in some).most_common())
        lines.append(
            f"{kind:14s} found {found}/{sum(len(s.bad) for s in some)}, reason right {right}, "
            f"good ones blamed {blamed}/{good}, wrong all-clears {sum(map(is_wrong_all_clear, some))}/{len(some)}, "
            f"{np.median([s.seconds for s in some]):.1f} s (most {max(s.seconds for s in some):.0f}); {verdicts}"
        )
    return "\n".join(lines)


def main() -> None:
    """Runs the sessions, or summarises files of results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0, help="of the first one")
    parser.add_argument("--known", action="store_true", help="the fault counts as known: nothing is searched for")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--summary", type=Path, nargs="+")
    args = parser.parse_args()
    if args.summary:
        lines = [line for path in args.summary for line in path.read_text(encoding="utf-8").splitlines()]
        print(summary([Session(**json.loads(line)) for line in lines]))
        return
    done = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(args.seed, args.seed + args.sessions):
            done.append(solve(seed, Path(folder), args.known))
            line = json.dumps(asdict(done[-1]))
            print(line, flush=True)
            if args.output:
                with args.output.open("a", encoding="utf-8") as file:
                    file.write(line + "\n")
    print(summary(done))


if __name__ == "__main__":
    main()
