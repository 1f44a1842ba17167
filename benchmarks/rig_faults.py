"""Interrupts `holoview measure` at random moments, in every way that a laboratory knows, and lets it go on.

    python -m benchmarks.rig_faults --runs 200

A run measures a small session on a virtual bench. One to three times it is interrupted: by a fault of a device (none
or wrong pictures, a lost connection, a power cut), Ctrl-C, SIGTERM, `kill -9`, or a disk that is full. After each time,

- every capture that was on the disk before is still there, bit for bit;
- at most the capture in flight is missing: those that the program reported as taken are there;
- no file is half written, and none is left over, but for the one that `kill -9` ended the writing of, under a name
  of its own, which goes with the folder of captures;
- the bench's own log says that the lasers are off: because the program said so; after `kill -9` and where the program
  can't reach them any more, by the bench's interlock; or without power.

Then the same command runs to its end. Patterns, settings and their order must be those of a run that nothing
interrupted; so must the exposure times where the plan states them. The program is forked from this one rather than
started, so that a run takes a second; all else is the command itself.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from benchmarks.common import count_of
from holoview.bench.captures import Captures, read_captures
from holoview.bench.captures.validation import check_settings
from holoview.bench.rig.virtual import client, server
from holoview.commands import cli, console, measure

WAYS = ("device", "Ctrl-C", "SIGTERM", "kill -9", "full disk")
_SIGNALS = {"Ctrl-C": signal.SIGINT, "SIGTERM": signal.SIGTERM, "kill -9": signal.SIGKILL}
_FAULTS = {"timeout": 0.04, "short": 0.03, "torn": 0.03, "repeated": 0.03}  # shares of the pictures, in every run
_BREAKS = {"disconnect": 0.01, "power_off": 0.01}  # shares of the messages, where a device is what interrupts
_SMALL_FILE = 700  # bytes that a file may have on the full disk: fewer than a capture takes
_PATIENCE_S = 120.0
_STARTS = 5  # of the command at the end: pictures may be wrong as often in a row as it accepts, by chance
_SLM = {"device": "virtual", "shape": [12, 16], "pitch": "8 um", "num_levels": 256, "opd_range": "825 nm"}
RIG: dict[str, Any] = {
    "slm1": {**_SLM, "settle": 0.1},
    "slm2": {**_SLM, "settle": 0.1},
    "camera": {
        "device": "virtual",
        "shape": [24, 32],
        "pitch": "4 um",
        "bit_depth": 12,
        "electrons_per_count": 4.0,
        "read_noise": 6.0,
        "black_level": 64,
    },
    "lasers": {"device": "virtual", "wavelengths": ["450 nm", "638 nm"]},
    "stage": {"device": "virtual", "range": ["0 mm", "10 mm"]},
    "limits": {"power": 1.0, "exposure": [1e-5, 0.5]},
    "geometry": {"gap": "1 mm", "iris1_na": 0.03, "iris2_na": 0.03},
    "virtual": {"bench": "hidden.toml"},
}
PLANS = (
    {"each": 2, "distances": ["2 mm", "5 mm"]},
    {"each": 2, "distances": ["2 mm", "5 mm"], "exposure": 0.01},
)
"""With searched exposures, and with stated ones."""


@dataclass
class Outcome:
    """Of all runs. ways: interruptions by kind. off: by what the lasers went off. wrong: what should never be.

    given_up: starts at the end of a run that too many wrong pictures in a row ended, after which the command went on.
    """

    runs: int = 0
    ways: Counter[str] = field(default_factory=Counter)
    codes: Counter[str] = field(default_factory=Counter)
    off: Counter[str] = field(default_factory=Counter)
    taken_again: int = 0
    given_up: int = 0
    wrong: list[str] = field(default_factory=list)


class ForkedServer:
    """The process of a virtual bench, forked; has what `subprocess.Popen` has and `client` uses."""

    def __init__(self, rig_path: Path) -> None:
        (there, to_server), (from_server, back) = os.pipe(), os.pipe()
        self.pid = os.fork()
        if self.pid == 0:
            os.setsid()
            os.dup2(there, 0)
            os.dup2(back, 1)
            os.closerange(3, 256)
            sys.stdin, sys.stdout = os.fdopen(0, encoding="utf-8"), os.fdopen(1, "w", encoding="utf-8")
            sys.argv = ["server", str(rig_path)]
            os._exit(server.main())
        os.close(there)
        os.close(back)
        self.stdin = os.fdopen(to_server, "w", encoding="utf-8")
        self.stdout = os.fdopen(from_server, encoding="utf-8")
        self._has_ended = False

    def wait(self, timeout: float | None = None) -> int:
        """Until it has ended."""
        if not self._has_ended:
            os.waitpid(self.pid, 0)
            self._has_ended = True
        return 0

    def kill(self) -> None:
        """Ends it."""
        if not self._has_ended:
            os.kill(self.pid, signal.SIGKILL)


def start(folder: Path) -> int:
    """The process of `holoview measure` in a folder; what it says goes to said.txt."""
    (folder.parent / "said.txt").write_text("", encoding="utf-8")  # it may be killed before it opens it
    pid = os.fork()
    if pid:
        return pid
    os.setsid()
    os.chdir(folder)
    said = os.open("../said.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(said, 1)
    os.dup2(said, 2)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    console.LINE_INTERVAL_S = 0.0
    client.start_server = ForkedServer  # type: ignore[assignment]
    code = cli.main(["measure", "rig.toml", "--plan", "plan.toml", "-o", "out.h5"])
    sys.stdout.flush()
    os._exit(code)


def wait(pid: int, limit_s: float) -> int | None:
    """The exit code of a process, minus the signal that ended it; None if it still runs after some seconds."""
    end = time.monotonic() + limit_s
    while True:
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > end:
            return None
        time.sleep(0.002)


def prepare(folder: Path, plan: dict[str, Any], faults: dict[str, Any]) -> None:
    """Writes rig, plan and what is hidden; the faults of the bench may differ from start to start."""
    folder.mkdir(exist_ok=True)
    hidden = {"seed": 3, "settle": 0.02, "laser_log": "lasers.txt", "faults": faults}
    for name, table in (("rig", RIG), ("plan", plan), ("hidden", hidden)):
        (folder / f"{name}.toml").write_text(tomli_w.dumps(table), encoding="utf-8")


def interrupt(folder: Path, way: str, chance: random.Random, duration_s: float) -> int:
    """Starts the command and interrupts it at a random moment; returns its exit code."""
    pid = start(folder)
    if way != "device":
        code = wait(pid, chance.uniform(0.0, duration_s))
        if code is not None:
            return code
        if way == "full disk":
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (_SMALL_FILE, resource.RLIM_INFINITY))
        else:
            os.kill(pid, _SIGNALS[way])
    code = wait(pid, _PATIENCE_S)
    if code is None:
        os.kill(pid, signal.SIGKILL)
        raise RuntimeError(f"{way}: it didn't end")
    return code


def parts(folder: Path) -> dict[str, bytes]:
    """The captures that are on the disk one by one."""
    return {path.name: path.read_bytes() for path in (folder / "out.h5.captures").glob("0*.h5")}


def faults_of(folder: Path, before: dict[str, bytes], way: str) -> list[str]:
    """What is wrong in a folder after an interruption. way: the interruption."""
    wrong, now = [], parts(folder)
    if (folder / "out.h5").exists():  # interrupted while it cleared up
        return wrong
    wrong += [f"{name} was lost or changed" for name, data in before.items() if now.get(name) != data]
    for name in now:
        try:
            read_captures(folder / "out.h5.captures" / name, check_settings)
        except ValueError as error:
            wrong.append(f"{name}: {error}")
    reported = _reported_as_taken(folder)
    if reported is not None and len(now) - len(before) < reported:
        wrong.append(f"{reported} captures were taken, {len(now) - len(before)} are there")
    known = {*now, "session.json", "bench.h5"}
    stray = [path.name for path in (folder / "out.h5.captures").glob("*") if path.name not in known]
    if way == "kill -9":  # the file that it was writing beside; the folder goes when the session is complete
        stray = [name for name in stray if not (name.startswith(".holoview-") and name.endswith(".part"))]
    return wrong + [f"{name} is left over" for name in stray]


def _reported_as_taken(folder: Path) -> int | None:
    """How many captures the last start said that it had taken."""
    lines = (folder.parent / "said.txt").read_text(encoding="utf-8").splitlines()
    counts = [line.removeprefix("measuring: ").partition("/")[0] for line in lines if line.startswith("measuring: ")]
    return int(counts[-1]) if counts else None


def laser_state(folder: Path) -> str:
    """The last line of the bench's log of its lasers, once it says that they are off, or after some seconds."""
    log = folder / "lasers.txt"
    for _ in range(500):
        line = log.read_text(encoding="utf-8").splitlines()[-1] if log.exists() else "off: never on"
        if line.startswith("off"):
            return line
        time.sleep(0.01)
    return line


def run_once(number: int, root: Path, chance: random.Random, whole: Captures, duration_s: float, out: Outcome) -> None:
    """A session that is interrupted one to three times and then finished."""
    folder, plan = root / f"run{number}", PLANS[number % len(PLANS)]
    wanted = chance.randint(1, 3)
    done = 0
    while done < wanted:
        way = WAYS[(number + done) % len(WAYS)]
        faults = {"seed": chance.randrange(2**31), **_FAULTS, **(_BREAKS if way == "device" else {})}
        prepare(folder, plan, faults)
        (folder / "lasers.txt").unlink(missing_ok=True)
        before = parts(folder)
        code = interrupt(folder, way, chance, duration_s)
        if code == 0:  # it was faster
            (folder / "out.h5").unlink()
            continue
        if code == 2 and not (folder / "out.h5.captures").exists():  # killed before, while it cleared up
            break
        done += 1
        _judge(f"run {number}, {way}", way, folder, before, code, out)
        out.ways[way] += 1
    _finish(number, folder, plan, whole, out)
    shutil.rmtree(folder)


def _judge(where: str, way: str, folder: Path, before: dict[str, bytes], code: int, out: Outcome) -> None:
    """Notes what is there after an interruption."""
    out.codes[str(code)] += 1
    said = (folder.parent / "said.txt").read_text(encoding="utf-8")
    out.taken_again += said.count("; taken again")
    if "Traceback" in said:
        out.wrong.append(f"{where}: {said}")
    state = laser_state(folder)
    out.off[f"{way}: {state}"] += 1
    if not state.startswith("off") or (state == "off: interlock" and way not in ("device", "kill -9")):
        out.wrong.append(f"{where}: the lasers are {state}")
    out.wrong += [f"{where}: {wrong}" for wrong in faults_of(folder, before, way)]


def _finish(number: int, folder: Path, plan: dict[str, Any], whole: Captures, out: Outcome) -> None:
    """Lets the command run to its end and compares the session."""
    for again in range(_STARTS):
        if (folder / "out.h5").exists() and not (folder / "out.h5.captures").exists():
            break
        prepare(folder, plan, {"seed": _STARTS * number + again, **_FAULTS})
        wait(start(folder), _PATIENCE_S)
        said = (folder.parent / "said.txt").read_text(encoding="utf-8")
        out.taken_again += said.count("; taken again")
        out.given_up += "times in a row" in said
    else:
        out.wrong.append(f"run {number} didn't finish: {said}")
        return
    captures = read_captures(folder / "out.h5")
    names = ["levels", "wavelength_m", "distance_m", "power", *(["exposure_s"] if "exposure" in plan else [])]
    different = [name for name in names if not np.array_equal(getattr(captures, name), getattr(whole, name))]
    if different:
        out.wrong.append(f"run {number}: {', '.join(different)} differ")
    left = {path.name for path in folder.iterdir()} - {"out.h5", "rig.toml", "plan.toml", "hidden.toml", "lasers.txt"}
    if left - {"out.h5.finished"}:
        out.wrong.append(f"run {number}: {', '.join(left)} left over")


def run_all(runs: int, seed: int, root: Path) -> Outcome:
    """All runs, after one of each plan that nothing interrupts."""
    whole, durations = [], []
    for number, plan in enumerate(PLANS):
        folder = root / f"whole{number}"
        prepare(folder, plan, {})
        started = time.monotonic()
        code = wait(start(folder), _PATIENCE_S)
        durations.append(time.monotonic() - started)
        if code != 0:
            raise RuntimeError((root / "said.txt").read_text(encoding="utf-8"))
        whole.append(read_captures(folder / "out.h5"))
    chance, out = random.Random(seed), Outcome()
    for number in range(runs):
        plan_number = number % len(PLANS)
        run_once(number, root, chance, whole[plan_number], durations[plan_number], out)
        out.runs += 1
    return out


def main() -> int:
    """Prints the counts; returns 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=count_of, default=200)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    assert measure.run  # imported here, before the program is forked
    with tempfile.TemporaryDirectory() as root:
        out = run_all(args.runs, args.seed, Path(root))
    print(f"{out.runs} runs, {out.ways.total()} interruptions, {out.taken_again} pictures taken again")
    print(f"{out.given_up} times a session was given up for wrong pictures in a row, and went on")
    for title, counts in (("interrupted by", out.ways), ("exit code", out.codes), ("lasers", out.off)):
        print(f"{title}: " + ", ".join(f"{name} {count}" for name, count in sorted(counts.items())))
    print(f"wrong: {len(out.wrong)}", *out.wrong, sep="\n  ")
    return 1 if out.wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
