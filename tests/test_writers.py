"""All that writes files, on a disk that fills: one kind of error, the old or the new file, and nothing beside it."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import holoview as hv
from holoview.bench.captures import read_captures, write_captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.evidence.study.runner import ResultStore
from holoview.evidence.study.study import JobResult, StudyJob
from holoview.holograms.files.pictures import write_png
from holoview.holograms.hologram import Hologram, load_hologram
from holoview.holograms.optimise.checkpoint import Checkpoint, CheckpointProgress, load_checkpoint
from holoview.light.model import preset
from holoview.util.figures import png_figure
from holoview.util.file_writer import WriteError
from holoview.viewer.document.archive import SessionArchive, SessionData, read_session
from holoview.viewer.document.editing_session import EditingSession
from tests.file_limits import limit_of_file_size
from tests.pattern_file import write_pattern

PACKAGE = Path(hv.__file__).resolve().parent
SYSTEM = hv.load("simultaneous").edit({"shape": [24, 32]})
DRIVE = hv.random_drive(SYSTEM)
CAPTURES = make_captures(SYSTEM.edit({"planes": ["10 mm"]}), settings=AcquisitionSettings(captures_per_condition=1))
PICTURE = np.random.default_rng(0).integers(0, 255, (24, 32, 3), dtype=np.uint8)
JOB = StudyJob("gamut", "label", {"a": 1})


def _checkpoint(path: Path) -> None:
    moments = dict.fromkeys(("drive", "first", "second", "best_drive"), DRIVE)
    amplitudes = dict.fromkeys(("amplitudes", "best_amplitudes"), SYSTEM.amplitudes)
    amplitudes |= {"amplitude_moments": np.stack([SYSTEM.amplitudes] * 2)}
    waves = dict.fromkeys(("wavelengths", "best_wavelengths", "steps"), SYSTEM.wavelengths_m)
    waves |= {"wavelength_moments": np.stack([SYSTEM.wavelengths_m] * 2)}
    Checkpoint(SYSTEM, hv.Settings(), "", CheckpointProgress(1, 1.0, 1.0, 1.0, 1.0), moments | amplitudes | waves).save(
        path
    )


def _figure(path: Path) -> None:
    with png_figure(path, (1, 1)) as figure:
        figure.suptitle("a")


def _session(path: Path) -> None:
    session = EditingSession(SYSTEM, DRIVE)
    SessionArchive(path).write(SessionData(session.history, 0, {}), {"title": "a", "when": 0.0})
    session.close()


WRITERS: dict[str, tuple[Callable[[Path], object], Callable[[Path], object]]] = {
    "h.safetensors": (Hologram(DRIVE, SYSTEM).save, load_hologram),
    "c.safetensors": (_checkpoint, load_checkpoint),
    "c.h5": (lambda path: write_captures(path, CAPTURES), read_captures),
    "p.toml": (lambda path: preset.save(SYSTEM, path), preset.load),
    "v.png": (lambda path: write_png(path, PICTURE, {}), lambda path: path.read_bytes()),
    "s.png": (lambda path: write_pattern(path, DRIVE[0, 0]), lambda path: path.read_bytes()),
    "f.png": (_figure, lambda path: path.read_bytes()),
    "jobs": (
        lambda path: ResultStore(path).save(JOB, JobResult({"a": 1.0}, {"p": PICTURE})),
        lambda path: ResultStore(path).load(JOB),
    ),
    "session": (_session, read_session),
}
"""By the file or folder that is written: what writes it, and what reads it back."""


def _state(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX limits")
@pytest.mark.parametrize("name", WRITERS)
@given(st.floats(0, 1))
@settings(
    deadline=None,
    derandomize=True,
    database=None,
    max_examples=12,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_on_a_disk_that_fills_a_file_is_whole_or_as_it_was(tmp_path: Path, name: str, share: float) -> None:
    write, read = WRITERS[name]
    path = tmp_path / name
    if not path.exists():
        write(path)
        assert read(path) is not None
    before = _state(tmp_path)
    largest = max(map(len, before.values()))
    for old in [path] if path.is_file() else []:
        old.write_bytes(b"old")
    before = _state(tmp_path)
    if path.is_dir():
        for part in path.rglob("*.*"):
            part.unlink()
    with limit_of_file_size(round(share * 1.2 * largest)):
        try:
            write(path)
            is_written = True
        except WriteError as error:
            is_written = False
            assert "can't be written: File too large; free " in str(error)
    after = _state(tmp_path)
    assert not [part for part in after if ".part" in part]
    if is_written:
        assert read(path) is not None
    elif path.is_file():
        assert after == before
    else:
        assert all(before[part] == content for part, content in after.items()), "each part is whole"
    if path.is_dir():
        write(path)
        assert read(path) is not None, "once there is space, all of it is there"


# --- no library sees the disk -----------------------------------------------------------------------------------------

_WRITES = {"write_text", "write_bytes", "savefig", "save_file", "imwrite", "mkstemp", "NamedTemporaryFile", "tofile"}
_ALLOWED = {
    "util/file_writer.py",  # the one that does
    "util/figures.py",  # into memory
    "holograms/files/pictures.py",  # into memory
    "bench/diagnose/worker_pool.py",  # memory that processes share, or a temporary file
    "viewer/app/desktop.py",  # a file for another program, in a folder for temporary files
    "evidence/benchmark/frame_benchmark.py",  # in a folder for temporary files
}


@pytest.mark.long
def test_every_file_is_written_by_the_one_function() -> None:
    """An exception of a library's own, a crash at a full disk or a half file can't come from anywhere else."""
    found = set()
    for module in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
                modes = [a.value for a in node.args[-1:] if isinstance(a, ast.Constant) and isinstance(a.value, str)]
                opens = name == "open" and any(set(mode) & set("wax+") and len(mode) < 4 for mode in modes)
                if name in _WRITES or opens:
                    found.add(str(module.relative_to(PACKAGE)))
    assert found == _ALLOWED
