"""Whatever has happened to the stored state, the program begins: with what can be read, and nothing is thrown away."""

from __future__ import annotations

import copy
import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import tests.document.conftest as bench
from holoview.light.model.focus import PupilPath
from holoview.util.errors import UserError
from holoview.util.tables import record_from_table
from holoview.viewer.document.archive import view_settings_from_table, view_settings_table
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.file_loader import target_from_pixels
from holoview.viewer.document.session_store import Preferences, SessionStore
from holoview.viewer.render.view_settings import ViewSettings

_SETTINGS = settings(
    deadline=None,
    max_examples=40,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
_MANY = settings(_SETTINGS, max_examples=400)
DEEP = "[" * 100_000
VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**70), 2**70),
    st.floats(),
    st.text(max_size=8),
    st.just([]),
    st.just({}),
    st.lists(st.integers(-3, 3), max_size=4),
)


@pytest.fixture(scope="module")
def saved_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with a session that was closed in good order: three steps, a snapshot, a target."""
    import numpy as np

    folder = tmp_path_factory.mktemp("store")
    session = EditingSession(bench.small_system(), seed=7)
    autosave = SessionStore(folder).start_autosave(session)
    session.edit("Target", target_spec=target_from_pixels(np.full((4, 4, 3), 90, np.uint8)))
    session.pin("mine")
    session.change("Gap", {"gap": 2e-3})
    assert autosave.close() is None
    return folder


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Where something is in a tree of JSON, all of it."""
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(place for key, child in children for place in _places(child, (*path, key)))]


@pytest.mark.long
@given(st.data())
@_SETTINGS
def test_a_session_of_which_anything_changed_is_restored_in_part_or_kept_aside(
    saved_folder: Path, tmp_path: Path, data: st.DataObject
) -> None:
    _begin_after_a_change(saved_folder, tmp_path, data)


@pytest.mark.explores
@given(st.data())
@_MANY
def test_many_changes_of_a_session(saved_folder: Path, tmp_path: Path, data: st.DataObject) -> None:
    _begin_after_a_change(saved_folder, tmp_path, data)


def _begin_after_a_change(saved_folder: Path, tmp_path: Path, data: st.DataObject) -> None:
    folder = tmp_path / "store"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(saved_folder, folder)
    (path,) = folder.glob("sessions/*/session.json")
    table = json.loads(path.read_text())
    changed = copy.deepcopy(table)
    place = data.draw(st.sampled_from([place for place in _places(table) if place]))
    parent = changed
    for key in place[:-1]:
        parent = parent[key]
    if data.draw(st.booleans()):
        del parent[place[-1]]
    else:
        parent[place[-1]] = data.draw(VALUES)
    path.write_text(json.dumps(changed))
    _assert_begins(folder)


@pytest.mark.parametrize("content", ["", "{", "null", "[]", "3", '"x"', DEEP, '{"a": ' * 3000, "\0", "\ud800"])
def test_a_session_that_is_no_table_is_kept_aside(saved_folder: Path, tmp_path: Path, content: str) -> None:
    folder = tmp_path / "store"
    shutil.copytree(saved_folder, folder)
    (path,) = folder.glob("sessions/*/session.json")
    path.write_bytes(content.encode("utf-8", "surrogatepass"))
    store = SessionStore(folder)
    (line,) = store.set_damaged_aside()
    assert "is damaged, and kept as" in line and len(line.splitlines()) == 1
    assert store.saved_sessions() == [] and store.set_damaged_aside() == []
    assert len(list(folder.glob("sessions/*.damaged/session.json"))) == 1


def test_patterns_that_are_all_damaged_are_kept_aside(saved_folder: Path, tmp_path: Path) -> None:
    folder = tmp_path / "store"
    shutil.copytree(saved_folder, folder)
    for path in folder.glob("sessions/*/objects/*"):
        path.write_bytes(b"damaged")
    store = SessionStore(folder)
    last = store.last_session()
    assert store.set_damaged_aside() == [] and last is not None
    with pytest.raises(UserError, match="no step of it can be read"):
        last.restore()
    assert "kept as" in store.set_aside(last.folder) and store.last_session() is None


def test_a_session_of_another_version_is_left_alone(saved_folder: Path, tmp_path: Path) -> None:
    folder = tmp_path / "store"
    shutil.copytree(saved_folder, folder)
    (path,) = folder.glob("sessions/*/session.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"version": 99}))
    store = SessionStore(folder)
    assert store.set_damaged_aside() == [] and store.last_session() is None and path.exists()


def _assert_begins(folder: Path) -> None:
    """As the viewer does at its start; what is restored can be shown and saved again."""
    store = SessionStore(folder)
    store.set_damaged_aside()
    store.crashed_sessions()
    last = store.last_session()
    if last is None:
        return
    try:
        session = last.restore()
    except UserError as error:
        assert len(str(error).splitlines()) == 1
        assert "kept as" in store.set_aside(last.folder)
        return
    assert session.document.drive.shape == session.system.drive_shape
    session.undo()
    session.redo()
    assert session.displayed_document.origin is not None
    autosave = store.start_autosave(session)
    session.change("Gap", {"gap": 3e-3})
    assert autosave.close() is None


def test_every_view_setting_is_read_back() -> None:
    plain = ViewSettings(plane_m=1e-3)
    table = json.loads(json.dumps(view_settings_table(plain)))
    assert view_settings_from_table(table) == plain
    for field in dataclasses.fields(plain):
        if field.name == "pupil_path":  # several share it: it has a table of its own
            continue
        with pytest.raises(UserError):
            view_settings_from_table(table | {field.name: {"x": []}})


@pytest.mark.parametrize("column", [None, 3, {"a": 1}, ["x"], [0.0, float("nan")], [0.0], [0.0, 1e9]])
def test_a_damaged_path_of_the_pupil_is_noticed(column: Any) -> None:
    path = PupilPath(times_s=(0.0, 1.0), y_m=(0.0, 1e-3), x_m=(0.0, 0.0), pupil_m=(2e-3, 3e-3))
    table = json.loads(json.dumps(dataclasses.asdict(path)))
    assert record_from_table(PupilPath, table) == path
    with pytest.raises(UserError):
        record_from_table(PupilPath, table | {"y_m": column})


@given(st.dictionaries(st.sampled_from(["theme", "recent", "has_begun", "x"]), VALUES | st.lists(VALUES, max_size=3)))
@example({"recent": [None]})
@_SETTINGS
def test_preferences_of_any_values_have_the_right_types(tmp_path: Path, values: dict[str, Any]) -> None:
    path = tmp_path / "preferences.json"
    path.write_text(json.dumps(values))
    preferences = Preferences(path)
    assert preferences.problem == ""
    assert isinstance(preferences.get("theme", ""), str) and isinstance(preferences.get("has_begun", False), bool)
    assert all(isinstance(file, Path) for file in preferences.recent_files)
    preferences.add_recent_file(tmp_path)
    assert preferences.recent_files[0] == tmp_path


@pytest.mark.parametrize("content", ["", "{", "3", '["a"]', "[[1]]", DEEP, '{"a": ' * 3000, "\0"])
def test_damaged_preferences_are_kept_aside(tmp_path: Path, content: str) -> None:
    path = tmp_path / "preferences.json"
    path.write_text(content)
    problem = Preferences(path).problem
    assert "is damaged, and kept as" in problem and len(problem.splitlines()) == 1
    assert [file.name for file in tmp_path.iterdir()] == ["preferences.json.damaged"]


def test_preferences_that_are_a_folder_are_told(tmp_path: Path) -> None:
    (tmp_path / "preferences.json").mkdir()
    assert "can't be read" in Preferences(tmp_path / "preferences.json").problem


@pytest.mark.parametrize(
    "lock", ["", "{}", DEEP, '{"pid": 1e300, "since": 0}', '{"pid": 1' + 80 * "0" + ', "since": 0}', "[]"]
)
def test_a_damaged_lock_is_of_a_program_that_has_ended(saved_folder: Path, tmp_path: Path, lock: str) -> None:
    folder = tmp_path / "store"
    shutil.copytree(saved_folder, folder)
    (session,) = folder.glob("sessions/*")
    (session / "lock.json").write_text(lock)
    (crashed,) = SessionStore(folder).crashed_sessions()
    assert crashed.restore().system.gap_m == 2e-3
