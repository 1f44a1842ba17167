"""Kills commands that write files, as `kill -9` does, at random moments; then looks at what is there, and goes on.

    python -m benchmarks.kills --kills 20

Each command is first run to its end, then started again and again in another folder and killed after a random time.
After each kill every file in the folder has to be whole, and no other file may be there. At last the command may end,
and its results have to be those of the run that nobody killed, bit for bit.
"""

from __future__ import annotations

import argparse
import hashlib
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image
from safetensors import safe_open

from holoview.calibrate.checkpoint import load_checkpoint as load_calibration_checkpoint
from holoview.captures import read_captures
from holoview.effects.calibration.calibration_file import read_calibration
from holoview.io.hologram import load_hologram
from holoview.model import preset
from holoview.optimise.checkpoint import load_checkpoint
from holoview.util.safetensors_file import format_of, metadata_of

SMALL = ("--set", "shape=[24,32]")
_MOMENTS = (0.2, 1.0)  # of a run's duration, whose first part is imports
_READERS: dict[str, Callable[[Path], object]] = {
    "holoview-hologram": load_hologram,
    "holoview-checkpoint": load_checkpoint,
    "holoview-calibration-checkpoint": load_calibration_checkpoint,
    "holoview-calibration": read_calibration,
}


@dataclass(frozen=True)
class Command:
    """A command line.

    checkpoint: the file from which it goes on by --resume, "" if it begins anew or goes on by itself. ignored: names of
    results that tell times.
    """

    name: str
    words: tuple[str, ...]
    checkpoint: str = ""
    ignored: frozenset[str] = frozenset()


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
    Command("captures make", ("captures", "make", "simultaneous", *SMALL, "--each", "30", "-o", "made.h5")),
    Command(
        "calibrate",
        ("calibrate", "captures.h5", "--epochs", "6", "--checkpoint", "c.safetensors", "-o", "o.toml"),
        "c.safetensors",
        frozenset(("c.safetensors",)),
    ),
    Command(
        "study",
        ("study", "gamut", "--quick", "--shape", "24x32", "--iterations", "3", "-o", "."),
        ignored=frozenset(("report.html", "numbers.parquet")),
    ),
    Command("render", ("render", "simultaneous", *SMALL, "--backend", "torch", "--plane", "all", "-o", "seen.png")),
)


@dataclass
class Outcome:
    """Of the kills of one command: how many, after how many of them something was written, and what was wrong."""

    kills: int = 0
    with_files: int = 0
    wrong: list[str] = field(default_factory=list)
    different: list[str] = field(default_factory=list)


def run(command: Command, folder: Path, limit_s: float | None = None) -> bool:
    """Runs a command in a folder, killed after some seconds; returns whether it ended by itself.

    Raises RuntimeError if it failed otherwise than by having nothing left to do.
    """
    words = [sys.executable, "-m", "holoview", *command.words]
    if command.checkpoint and (folder / command.checkpoint).exists():
        words += ["--resume", command.checkpoint]
    with (folder.parent / "said.txt").open("w+", encoding="utf-8") as said:
        process = subprocess.Popen(words, cwd=folder, stdout=said, stderr=said)
        try:
            code = process.wait(limit_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return False
        said.seek(0)
        text = said.read()
    if code != 0 and "of a finished" not in text:  # killed between the last checkpoint and the result
        raise RuntimeError(f"{command.name} failed: {text}")
    return code == 0


def check(folder: Path) -> list[str]:
    """What isn't a whole file in a folder."""
    wrong = []
    for path in folder.rglob("*"):
        try:
            if path.is_file():
                _read(path)
        except Exception as error:
            wrong.append(f"{path.relative_to(folder)}: {error}")
    return wrong


def _read(path: Path) -> None:
    if path.name.startswith("."):
        raise ValueError("is left over")
    if path.suffix == ".safetensors":
        _READERS[format_of(path)](path)
    elif path.suffix == ".h5":
        read_captures(path)
    elif path.suffix == ".png":
        with Image.open(path) as image:
            image.load()
    elif path.suffix == ".toml":
        preset.load(path)


def digests(command: Command, folder: Path) -> dict[str, str]:
    """A digest of each result."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(_content(path)).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in command.ignored and path.suffix != ".pdf"
    }


def _content(path: Path) -> bytes:
    """What a file says; the order of metadata in a safetensors file is random."""
    if path.suffix != ".safetensors":
        return path.read_bytes()
    with safe_open(path, framework="numpy") as file:
        tensors = {name: file.get_tensor(name).tobytes() for name in sorted(file.keys())}
    return repr((tensors, sorted(metadata_of(path).items()))).encode()


def try_out(command: Command, kills: int, root: Path, chance: random.Random) -> Outcome:
    """Runs a command once whole, then killed `kills` times, then to its end."""
    whole, killed = root / "whole" / command.name, root / "killed" / command.name
    for folder in (whole, killed):
        folder.mkdir(parents=True)
        _make_inputs(folder)
    started = time.monotonic()
    run(command, whole)
    duration_s = time.monotonic() - started
    inputs, outcome = set(killed.iterdir()), Outcome()
    while outcome.kills < kills:
        if run(command, killed, chance.uniform(*_MOMENTS) * duration_s):
            shutil.rmtree(killed)  # it was faster than the kill
            killed.mkdir()
            _make_inputs(killed)
            continue
        outcome.kills += 1
        outcome.with_files += set(killed.iterdir()) != inputs
        outcome.wrong += check(killed)
    while not run(command, killed):  # a checkpoint of a finished run: only its result is missing
        (killed / command.checkpoint).unlink()
    found, expected = digests(command, killed), digests(command, whole)
    outcome.different = [name for name in {**found, **expected} if found.get(name) != expected.get(name)]
    return outcome


def _make_inputs(folder: Path) -> None:
    ramp = np.random.default_rng(0).integers(0, 255, (24, 32, 3), dtype=np.uint8)
    Image.fromarray(ramp).save(folder / "picture.png")
    words = ["captures", "make", "simultaneous", *SMALL, "--each", "4", "-o", "captures.h5"]
    subprocess.run([sys.executable, "-m", "holoview", *words], cwd=folder, check=True, capture_output=True)


def main() -> None:
    """Prints a line for each command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20, help="of each command (20)")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--only", nargs="+", help="names of commands")
    args = parser.parse_args()
    print(f"{'command':<14} {'kills':>5} {'after something was written':>28} {'half or left over':>18}  same result")
    with tempfile.TemporaryDirectory() as root:
        for command in COMMANDS:
            if args.only is None or command.name in args.only:
                outcome = try_out(command, args.kills, Path(root), random.Random(args.seed))
                line = f"{command.name:<14} {outcome.kills:>5} {outcome.with_files:>28} {len(outcome.wrong):>18}"
                different = f"no: {', '.join(outcome.different)}" if outcome.different else "yes"
                print(f"{line}  {different}", *outcome.wrong, sep="\n  ", flush=True)


if __name__ == "__main__":
    main()
