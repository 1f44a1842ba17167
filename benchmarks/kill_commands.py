"""The commands that `benchmarks.kills` kills: everything that writes a file."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from holoview.document.editing_session import EditingSession
from holoview.document.session_store import SessionStore
from holoview.model import preset
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
