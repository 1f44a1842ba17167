"""Kills commands that write files, as `kill -9` does, at random moments; then looks at what is there, and goes on.

    python -m benchmarks.kills --kills 20
    python -m benchmarks.kills --kills 100 --only optimise measure

Each command is first run to its end, then started again and again in another folder and killed after a random time.
After each kill every file in the folder has to be whole, no other file may be there, and no process of the command may
go on. At last the command may end, and its results have to be those of the run that nobody killed, bit for bit.

The commands run in processes that are forked from one that has imported everything: a kill falls into their work.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil
from PIL import Image
from safetensors import safe_open

from holoview.bench.calibrate.train import load_checkpoint as load_calibration_checkpoint
from holoview.bench.captures import read_captures
from holoview.bench.experiment.camera_loop import load_loop_checkpoint
from holoview.bench.rig import read_rig
from holoview.commands.cli import main as holoview
from holoview.holograms.hologram import load_hologram
from holoview.holograms.optimise.checkpoint import load_checkpoint
from holoview.light.model import preset
from holoview.light.model.effects.learned_maps import read_calibration
from holoview.util.safetensors_file import format_of, metadata_of
from holoview.util.tables import parse_toml
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.session_store import SessionStore
from tests.fuzz.trial import preload
from tests.fuzz.valid_files import valid, write
from tests.rig.align.hidden_bench import Hidden
from tests.rig.conftest import write_rig

SMALL = ("--set", "shape=[24,32]")
_NOISE = frozenset(("X.h5", "X.json", "X.toml"))
"""What is measured anew, with other noise, whenever it is measured."""


@dataclass(frozen=True)
class Command:
    """A command line, or a function that works in the present folder.

    checkpoint: the file from which it goes on by --resume, "" if it begins anew or goes on by itself. ignored: names of
    results that differ from run to run. call: in place of a command line; whether it ends by itself: `ends`.
    """

    name: str
    words: tuple[str, ...] = ()
    checkpoint: str = ""
    ignored: frozenset[str] = frozenset()
    call: Callable[[], object] | None = None
    ends: bool = True


def make_inputs(folder: Path) -> None:
    """Writes what the commands read into a folder."""
    ramp = np.random.default_rng(0).integers(0, 255, (24, 32, 3), dtype=np.uint8)
    Image.fromarray(ramp).save(folder / "picture.png")
    write(folder, valid("captures") | valid("sweep") | valid("hologram"))
    write(folder / "folder", valid("folder"))
    (folder / "path.csv").write_text("time (s),y (mm),x (mm)\n0,0,-0.4\n1,0.1,0.4\n", encoding="utf-8")
    (folder / "plan.toml").write_text('each = 6\ndistances = ["3 mm"]\n', encoding="utf-8")
    effects = {"gap": {"gap_error": 0.2e-3}}
    write_rig(folder / "rig.toml", {"virtual": {"seed": 3, "effects": effects}})
    (folder / "placed").mkdir()
    Hidden("one", (40, 40)).write(folder / "placed")


def edit_for_ever() -> None:
    """Edits a session that is saved by itself, as a person does who never rests, for at most a minute."""
    session = EditingSession(preset.load("simultaneous").with_(shape=(24, 32)), seed=7)
    SessionStore(Path("state")).start_autosave(session)
    for n in range(600):
        session.edit_view("Wipe", wipe=(n % 100) / 100, merge_key="wipe")
        session.edit("Pattern", drive=np.full(session.drive.shape, (n % 7) / 7, np.float32))
        time.sleep(0.1)


def restored_sessions(folder: Path) -> int:
    """How many sessions of killed programs can be restored, all of which are; then they are discarded."""
    store = SessionStore(folder)
    sessions = store.crashed_sessions()
    for saved in sessions:
        restored = saved.restore()
        lost = [message.text for message in restored.messages.all if message.text.startswith("not restored")]
        restored.close()
        store.discard(saved)
        if lost:
            raise ValueError(f"lost: {lost}")
    return len(sessions)


COMMANDS = (
    Command(
        "optimise",
        (
            *("optimise", "simultaneous", "picture.png", *SMALL, "--iterations", "60", "--preview", "preview.png"),
            *("--checkpoint", "c.safetensors", "--checkpoint-every", "0.01s", "-o", "o.safetensors"),
        ),
        "c.safetensors",
        frozenset(("c.safetensors",)),
    ),
    Command(
        "optimise --rig",
        (
            *("optimise", "rig.toml", "picture.png", "--rig", "rig.toml", "--iterations", "4"),
            *("--checkpoint", "c.safetensors", "--checkpoint-every", "0.01s", "-o", "o.safetensors"),
        ),
        "c.safetensors",
        frozenset(("c.safetensors", "o.safetensors")),
    ),
    Command("render", ("render", "simultaneous", *SMALL, "--backend", "torch", "--plane", "all", "-o", "seen.png")),
    Command(
        "render, animated",
        (
            *("render", "simultaneous", *SMALL, "--set", "eye={}", "--backend", "torch", "--plane", "10mm"),
            *("--pupil-path", "path.csv", "--frames", "6", "-o", "moving.png"),
        ),
    ),
    Command("export", ("export", "hologram.safetensors", "--png", "patterns")),
    Command("captures make", ("captures", "make", "simultaneous", *SMALL, "--each", "30", "-o", "made.h5")),
    Command("captures import", ("captures", "import", "folder", "-o", "imported.h5")),
    Command("captures show", ("captures", "show", "captures.h5", "-o", "sheet.png")),
    Command(
        "calibrate",
        (
            *("calibrate", "captures.h5", "--epochs", "6", "--checkpoint", "c.safetensors", "-o", "o.toml"),
            *("--pictures", "pictures"),
        ),
        "c.safetensors",
        frozenset(("c.safetensors",)),
    ),
    Command("calibrate lut", ("calibrate", "lut", "sweep.csv", "-o", "table.toml", "--plot", "sweep.png")),
    Command(
        "diagnose",
        (
            *("diagnose", "captures.h5", "--workers", "1", "--time", "1s", "--report", "report", "--no-display"),
            *("--json", "X.json", "--save-preset", "X.toml", "--save-corrected", "corrected.h5"),
        ),
        ignored=_NOISE | {"report.html"},
    ),
    Command(
        "diagnose --rig",
        (
            *("diagnose", "--rig", "rig.toml", "-o", "X.h5", "--captures", "8", "--workers", "1", "--time", "1s"),
            *("--json", "X.json"),
        ),
        ignored=_NOISE,
    ),
    Command("measure", ("measure", "rig.toml", "--plan", "plan.toml", "-o", "X.h5"), ignored=_NOISE),
    Command("rig align", ("rig", "align", "placed/rig.toml"), ignored=frozenset(("rig.placement.toml",))),
    Command(
        "study",
        ("study", "gamut", "--quick", "--shape", "24x32", "--iterations", "3", "-o", "."),
        ignored=frozenset(("report.html", "numbers.parquet", "numbers.csv")),
    ),
    Command(
        "demo",
        ("demo", "-o", "demo", "--iterations", "3", "--shape", "24", "32", "--backend", "torch"),
        ignored=frozenset(("report.html",)),
    ),
    Command(
        "contrast",
        ("contrast", "simultaneous", "--set", "shape=[96,128]", "--plot", "speckle.png"),
    ),
    Command("viewer's autosave", call=edit_for_ever, ends=False),
)


# --- killing them ---


_FINISHED = ("of a finished", "is there already")
"""What a command says that has nothing left to do: it was killed after it had written its result."""
_LONGEST_S = 60.0  # that processes of a killed command may live on
_READERS = {
    "holoview-hologram": load_hologram,
    "holoview-checkpoint": load_checkpoint,
    "holoview-camera-loop": load_loop_checkpoint,
    "holoview-calibration-checkpoint": load_calibration_checkpoint,
    "holoview-calibration": read_calibration,
}


@dataclass
class Outcome:
    """Of the kills of one command: how many, after how many of them something was written, and what was wrong."""

    kills: int = 0
    with_files: int = 0
    wrong: list[str] = field(default_factory=list)
    different: list[str] = field(default_factory=list)


def run(command: Command, folder: Path, limit_s: float | None = None) -> str:
    """Runs a command in a folder, killed after some seconds: "killed", "ended", or "finished": nothing was left.

    Raises RuntimeError if it failed, or if a process of it lives on.
    """
    words = list(command.words)
    if command.checkpoint and (folder / command.checkpoint).exists():
        words += ["--resume", command.checkpoint]
    said = folder.parent / f"{folder.name}.txt"
    child = os.fork()
    if child == 0:
        _run_in_child(command, words, folder, said)
    code = _wait(child, limit_s)
    _wait_for_group(child, command)
    text = said.read_text(encoding="utf-8", errors="replace")
    if code == -signal.SIGKILL:
        return "killed"
    if code != 0 and not any(phrase in text for phrase in _FINISHED):
        raise RuntimeError(f"{command.name} failed: {text}")
    return "ended" if code == 0 else "finished"


def _run_in_child(command: Command, words: list[str], folder: Path, said: Path) -> None:
    """Runs the command with its streams in a file, and ends this process with its exit code."""
    code = 70
    try:
        os.setsid()
        os.chdir(folder)
        file = os.open(said, os.O_CREAT | os.O_TRUNC | os.O_WRONLY, 0o600)
        for number in (1, 2):
            os.dup2(file, number)
        code = holoview(words) if command.call is None else (command.call(), 0)[1]
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


def _wait(child: int, limit_s: float | None) -> int:
    """The exit code of a child, which is killed after some seconds."""
    until = time.monotonic() + (float("inf") if limit_s is None else limit_s)
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > until:
            os.kill(child, signal.SIGKILL)
            until = float("inf")
        time.sleep(0.005)


def _wait_for_group(leader: int, command: Command) -> None:
    """Waits until the processes that a command has started are gone, as they have to be."""
    until = time.monotonic() + _LONGEST_S
    while left := [process for process in psutil.process_iter() if _session_of(process.pid) == leader]:
        if time.monotonic() > until:
            names = [" ".join(process.cmdline()) for process in left]
            raise RuntimeError(f"{command.name}: {_LONGEST_S:g} s after its end, processes of it live on: {names}")
        time.sleep(0.05)


def _session_of(pid: int) -> int:
    try:
        return os.getsid(pid) if psutil.Process(pid).status() != psutil.STATUS_ZOMBIE else -1
    except (OSError, psutil.Error):
        return -1


def check(folder: Path) -> list[str]:
    """What isn't a whole file in a folder."""
    wrong = []
    for path in folder.rglob("*"):
        try:
            if path.is_file() and "state" not in path.relative_to(folder).parts:
                _read(path)
        except Exception as error:
            wrong.append(f"{path.relative_to(folder)}: {error}")
    try:
        restored_sessions(folder / "state")
    except Exception as error:
        wrong.append(f"saved session: {error}")
    return wrong


def _read(path: Path) -> None:
    if path.name.startswith("."):
        raise ValueError("is left over")
    if path.suffix == ".safetensors":
        _READERS[format_of(path)](path)
    elif path.suffix == ".h5" and not path.parent.name.endswith(".captures"):
        read_captures(path)
    elif path.suffix == ".png":
        with Image.open(path) as image:
            image.load()
    elif path.suffix == ".json":
        json.loads(path.read_text(encoding="utf-8"))
    elif path.suffix == ".csv":
        list(csv.reader(path.read_text(encoding="utf-8").splitlines(), strict=True))
    elif path.suffix == ".html" and not path.read_text(encoding="utf-8").rstrip().endswith("</html>"):
        raise ValueError("isn't whole")
    elif path.name == "rig.toml":
        read_rig(path)
    elif path.suffix == ".toml":
        table = parse_toml(path.read_text(encoding="utf-8"), str(path), "a table")
        if "modulators" in table or "base" in table:
            preset.load(path)


def digests(command: Command, folder: Path) -> dict[str, str]:
    """A digest of each result."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(_content(path)).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in command.ignored and path.suffix != ".pdf"
    }


def _content(path: Path) -> bytes:
    """What a file says, without how long it took; the order of metadata in a safetensors file is random."""
    if path.suffix == ".json":
        lines = path.read_text(encoding="utf-8").splitlines()
        return "\n".join(line for line in lines if '"seconds"' not in line).encode()
    if path.suffix != ".safetensors":
        return path.read_bytes()
    with safe_open(path, framework="numpy") as file:
        tensors = {name: file.get_tensor(name).tobytes() for name in sorted(file.keys())}
    return repr((tensors, sorted(metadata_of(path).items()))).encode()


def try_out(command: Command, kills: int, root: Path, chance: random.Random) -> Outcome:
    """Runs a command once whole, then killed `kills` times, then to its end."""
    whole, killed = root / "whole" / command.name.replace(" ", "_"), root / "killed" / command.name.replace(" ", "_")
    for folder in (whole, killed):
        _renew(folder)
    started = time.monotonic()
    run(command, whole, None if command.ends else 8.0)
    duration_s = time.monotonic() - started
    inputs, outcome = _names(killed), Outcome()
    while outcome.kills < kills:
        if run(command, killed, chance.uniform(0.0, 1.0) * duration_s) != "killed":
            _renew(killed)  # it was faster than the kill
            continue
        outcome.kills += 1
        outcome.with_files += _names(killed) != inputs
        outcome.wrong += check(killed)
    if command.ends:
        while run(command, killed) == "finished" and command.checkpoint:  # only its result is missing
            (killed / command.checkpoint).unlink()
        found, expected = digests(command, killed), digests(command, whole)
        outcome.different = [name for name in {**found, **expected} if found.get(name) != expected.get(name)]
    return outcome


def _names(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if path.is_file()}


def _renew(folder: Path) -> None:
    """An empty folder with the inputs."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    make_inputs(folder)


def main() -> None:
    """Prints a line for each command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20, help="of each command (20)")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--only", nargs="+", help="names of commands")
    args = parser.parse_args()
    preload()
    print(f"{'command':<18} {'kills':>5} {'after something was written':>28} {'half or left over':>18}  same result")
    with tempfile.TemporaryDirectory() as root:
        for command in COMMANDS:
            if args.only is None or command.name in args.only:
                try:
                    outcome = try_out(command, args.kills, Path(root), random.Random(args.seed))
                except RuntimeError as error:
                    print(f"{command.name:<18} {error}", flush=True)
                    continue
                line = f"{command.name:<18} {outcome.kills:>5} {outcome.with_files:>28} {len(outcome.wrong):>18}"
                different = f"no: {', '.join(outcome.different)}" if outcome.different else "yes"
                print(f"{line}  {different if command.ends else '-'}", *outcome.wrong, sep="\n  ", flush=True)


if __name__ == "__main__":
    main()
