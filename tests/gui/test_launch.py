"""How the viewer begins and ends: with damaged state, and by a signal."""

from __future__ import annotations

import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import tests.document.conftest as bench
from holoview.util.errors import UserError
from holoview.viewer.app import launch as launching
from holoview.viewer.app.launch import LaunchOptions, launch, open_session
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.session_store import SessionStore
from tests.gui.served import serving
from tests.patience import PATIENCE_S

OPTIONS = LaunchOptions(
    system=bench.small_system(),
    is_random=True,
    names=(),
    size=(640, 480),
    adapter=None,
    restores=True,
    serve=None,
    is_offscreen=False,
    script="",
    script_name="",
    screenshot=None,
)


def _closed_session(folder: Path) -> Path:
    """A store with a session that was edited and closed; the folder of that session."""
    store, session = SessionStore(folder), EditingSession(bench.small_system())
    autosave = store.start_autosave(session)
    session.change("Gap", {"gap": 2e-3})
    assert autosave.close() is None
    session.close()
    return autosave.folder


def test_the_first_picture_waits_for_neither_the_window_nor_pages_nor_other_files() -> None:
    late = [
        "imgui_bundle",
        "holoview.viewer.app.run",
        "holoview.viewer.document.file_loader",
        "holoview.viewer.page.page",
    ]
    code = f"import sys, holoview.viewer.app.launch; assert not set({late}) & sys.modules.keys()"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=PATIENCE_S)


@pytest.mark.parametrize("recovers", [None, 12345])
def test_without_a_device_a_crashed_session_stays_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, recovers: int | None
) -> None:
    taken: list[int] = []
    monkeypatch.setattr(launching, "SessionStore", lambda: SessionStore(tmp_path))
    monkeypatch.setattr(SessionStore, "take_over", lambda store, process: taken.append(process))

    def device() -> Any:
        raise UserError("graphics adapter", "none was found")

    options = replace(OPTIONS, recovers=recovers, adapter="none")
    with pytest.raises(UserError, match="none was found"):
        launch(options, SimpleNamespace(device=device), print)  # type: ignore[arg-type]
    assert taken == []


def test_the_last_session_is_opened(tmp_path: Path) -> None:
    _closed_session(tmp_path)
    session, notes = open_session(OPTIONS, SessionStore(tmp_path))
    assert session.system.gap_m == 2e-3 and notes == []


@pytest.mark.parametrize("damage", ["metadata", "position", "objects", "preferences"])
def test_damaged_state_is_a_line_and_something_is_opened(tmp_path: Path, damage: str) -> None:
    folder = _closed_session(tmp_path)
    if damage == "metadata":
        (folder / "session.json").write_text("{")
    elif damage == "position":
        text = (folder / "session.json").read_text()
        (folder / "session.json").write_text(text.replace('"position"', '"place"'))
    elif damage == "objects":
        for path in (folder / "objects").iterdir():
            path.write_bytes(b"damaged")
    else:
        (tmp_path / "preferences.json").write_text("[" * 100_000)
    session, notes = open_session(OPTIONS, SessionStore(tmp_path))
    (note,) = notes
    assert len(note.splitlines()) == 1 and "kept as" in note
    assert session.system.gap_m == (2e-3 if damage == "preferences" else 1e-3)
    assert open_session(OPTIONS, SessionStore(tmp_path))[1] == [], "it is told once"
    assert len(list(tmp_path.rglob("*.damaged"))) == 1


@pytest.mark.long
@pytest.mark.gpu
def test_the_served_viewer_saves_at_sigterm(tmp_path: Path) -> None:
    pytest.importorskip("uvicorn")
    with serving(tmp_path, end=signal.SIGTERM):
        pass
    assert SessionStore(tmp_path / "holoview").crashed_sessions() == []
