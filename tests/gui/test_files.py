"""Opening, saving, exporting through the app's own dialog; the list of edits; the offer to recover."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from holoview import load
from holoview.holograms.hologram import Hologram, load_hologram
from holoview.holograms.view import random_drive
from holoview.light.model import preset
from holoview.util.errors import UserError
from holoview.viewer.app import desktop
from holoview.viewer.app.panels import files
from holoview.viewer.app.panels.files import FilesPanel, HistoryPanel
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.document.session_store import SessionStore
from holoview.viewer.render.tone_mapping import tone_map
from holoview.viewer.render.view_settings import NOW
from tests.gui.conftest import Gui, leave_crashed_session, small_bench
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu

PANELS = (ImagePanel, FilesPanel, HistoryPanel)


@pytest.fixture
def gui(make_gui: Callable[..., Gui], tmp_path: Path) -> Gui:
    opened = make_gui(size=(800, 480), engine=True, panels=PANELS)
    opened.draw_until_idle()
    opened.app.panel(FilesPanel).dialog.folder = tmp_path
    return opened


def _dialog(gui: Gui) -> Any:
    return gui.app.panel(FilesPanel).dialog


def _save_as(gui: Gui, command: str, name: str) -> None:
    """Runs a command that asks for a file, types its name and presses Enter."""
    gui.context.commands.run(command)
    gui.draw_frames(2)
    assert _dialog(gui).is_open
    gui.press_chord("Ctrl+A")
    gui.type_text(name)
    gui.press_chord("Enter")
    gui.draw_frames(2)
    assert not _dialog(gui).is_open
    assert gui.session.wait_until_idle(PATIENCE_S)


def test_a_hologram_is_saved_by_keys_and_opened_again(gui: Gui, tmp_path: Path) -> None:
    gui.press_chord("Ctrl+S")
    gui.draw_frames(2)
    gui.press_chord("Ctrl+A")
    gui.type_text("mine")
    gui.press_chord("Enter")
    saved = tmp_path / "mine.safetensors"
    assert np.array_equal(load_hologram(saved).drive, gui.session.drive)
    assert "mine.safetensors" in gui.last_message()
    other = Hologram(random_drive(gui.session.system, 5), gui.session.system)
    other.save(tmp_path / "other.safetensors")

    def choose(ctx: Any) -> None:
        ctx.item_click("Files/Open…")
        ctx.item_click("//Open/**/other.safetensors")
        ctx.item_click("//Open/Open##file")

    gui.engine(choose)
    assert gui.session.wait_until_idle(PATIENCE_S)
    assert np.array_equal(gui.session.drive, other.drive) and gui.session.undo() == "Open other.safetensors"


def test_the_view_is_saved_as_it_is_seen(gui: Gui, tmp_path: Path) -> None:
    gui.session.edit_view("Exposure", exposure_stops=-1.0)
    gui.draw_until_idle()
    _save_as(gui, "Save view…", "view")
    with Image.open(tmp_path / "view.png") as picture:
        assert np.array_equal(
            np.asarray(picture), tone_map(gui.context.side_renderers.xyz(NOW), gui.session.view_settings)
        )


@pytest.mark.parametrize(
    ("command", "name", "written"),
    [
        ("Save preset…", "bench.toml", ["bench.toml"]),
        ("Save page…", "page.html", ["page.html"]),
        ("Save figure…", "figure.pdf", ["figure.pdf"]),
        ("Save focal sweep…", "sweep.gif", ["sweep.gif"]),
        ("Save all planes…", "all", [f"all-{z}mm.png" for z in ("10.5", "10", "11", "9.5", "9")]),
    ],
)
def test_everything_that_can_be_saved_is_written(
    gui: Gui, tmp_path: Path, command: str, name: str, written: list[str]
) -> None:
    gui.app.panel(FilesPanel).frames = 2
    _save_as(gui, command, name)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(written), gui.last_message()


def test_a_name_that_is_not_there_is_told_in_the_dialog_and_escape_closes_it(gui: Gui) -> None:
    gui.press_chord("Ctrl+O")
    gui.draw_frames(2)
    gui.type_text("missing.png")
    gui.press_chord("Enter")
    gui.draw_frames(2)
    assert _dialog(gui).is_open and "isn't there" in _dialog(gui).problem
    gui.press_chord("Escape")
    gui.draw_frames(2)
    assert not _dialog(gui).is_open


def test_a_click_selects_and_a_double_click_opens_folders_and_files_alike(gui: Gui, tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    bench = 'base = "holochrome-8"\ngap = "5 mm"\n'
    (tmp_path / "inner" / "mine.toml").write_text(bench, encoding="utf-8")
    gui.press_chord("Ctrl+O")
    gui.engine(lambda ctx: ctx.item_click("//Open/**/inner\\/"))
    assert (_dialog(gui).name, _dialog(gui).folder) == ("inner", tmp_path)
    gui.engine(lambda ctx: ctx.item_double_click("//Open/**/inner\\/"))
    assert (_dialog(gui).name, _dialog(gui).folder) == ("", tmp_path / "inner")
    gui.engine(lambda ctx: ctx.item_click("//Open/**/mine.toml"))
    assert _dialog(gui).is_open and _dialog(gui).name == "mine.toml"
    gui.engine(lambda ctx: ctx.item_double_click("//Open/**/mine.toml"))
    assert gui.session.wait_until_idle(PATIENCE_S)
    assert not _dialog(gui).is_open
    assert gui.session.system.gap_m == 5e-3, gui.session.messages.all


def test_names_that_imgui_would_cut_or_refuse_are_listed_and_opened(gui: Gui, tmp_path: Path) -> None:
    """Two number signs end a label of ImGui; names of files on Linux needn't be UTF-8."""
    names = ("gap##2.toml", os.fsdecode(b"gap\xff.toml"))
    for millimetres, name in enumerate(names, start=5):
        try:
            preset.save(small_bench(gap=1e-3 * millimetres), tmp_path / "bench.toml")
            (tmp_path / "bench.toml").rename(tmp_path / name)
        except OSError:
            pytest.skip("this file system refuses such names")
    gui.press_chord("Ctrl+O")
    gui.engine(lambda ctx: ctx.item_double_click("//Open/**/gap# #2.toml"))
    assert gui.session.wait_until_idle(PATIENCE_S)
    assert gui.session.system.gap_m == 5e-3, gui.session.messages.all
    gui.press_chord("Ctrl+O")
    gui.draw_frames(3)
    gui.type_text(r"gap\udcff.toml")  # as it is listed
    gui.press_chord("Enter")
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()
    assert gui.session.system.gap_m == 6e-3, gui.session.messages.all
    assert [message.text for message in gui.session.messages.all if message.kind == "error"] == []


@pytest.mark.parametrize("key", ["E", "G", "Ctrl+Z", "P", "W", "Space"])
def test_no_key_passes_an_open_dialog(gui: Gui, key: str) -> None:
    gui.session.change("Gap", {"gap": 5e-3})
    before = gui.session.document
    gui.press_chord("Ctrl+O")
    gui.draw_frames(3)
    gui.click((5.0, 5.0))  # beside its field for a name, which would take the key as text
    gui.press_chord(key)
    assert gui.session.document is before and not gui.session.snapshots
    gui.press_chord("Escape")
    gui.draw_frames(2)
    assert not _dialog(gui).is_open


def test_a_file_that_is_there_is_replaced_only_when_asked_twice(gui: Gui, tmp_path: Path) -> None:
    there = tmp_path / "mine.toml"
    there.write_text("precious")
    gui.context.commands.run("Save preset…")
    gui.draw_frames(2)
    gui.press_chord("Ctrl+A")
    gui.type_text("mine.toml")
    gui.press_chord("Enter")
    gui.draw_frames(2)
    assert _dialog(gui).is_open and "once more" in _dialog(gui).problem
    assert there.read_text() == "precious"
    gui.press_chord("Enter")
    gui.draw_frames(2)
    assert not _dialog(gui).is_open and load(there) == gui.session.system


def test_a_folder_of_patterns_is_opened(gui: Gui, tmp_path: Path) -> None:
    drive = random_drive(gui.session.system, 7)
    for number in (1, 2):
        levels = np.rint(255 * drive[0, number - 1]).astype(np.uint8)
        Image.fromarray(levels).save(tmp_path / f"slm{number}.png")
    gui.press_chord("Ctrl+O")
    gui.draw_frames(2)
    gui.engine(lambda ctx: ctx.item_click("//Open/This folder"))
    assert gui.session.wait_until_idle(PATIENCE_S)
    assert np.abs(gui.session.drive - drive).max() < 0.003


def test_a_folder_that_is_typed_is_shown(gui: Gui, tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    gui.press_chord("Ctrl+O")
    gui.draw_frames(2)
    gui.type_text("inner")
    gui.press_chord("Enter")
    gui.draw_frames(2)
    assert _dialog(gui).is_open and _dialog(gui).folder == tmp_path / "inner"


def test_a_mistake_in_saving_is_told(gui: Gui, tmp_path: Path) -> None:
    _save_as(gui, "Save preset…", str(tmp_path / "no" / "folder.toml"))
    message = gui.session.messages.all[-1]
    assert message.kind == "error" and "doesn't exist" in message.text


def test_the_image_is_copied_and_a_picture_pasted(gui: Gui, monkeypatch: pytest.MonkeyPatch) -> None:
    copied: list[np.ndarray] = []
    monkeypatch.setattr(files, "copy_picture", copied.append)
    gui.press_chord("Ctrl+Shift+C")
    assert np.array_equal(copied[0], tone_map(gui.context.side_renderers.xyz(NOW), gui.session.view_settings))
    monkeypatch.setattr(files, "paste_picture", lambda: copied[0])
    gui.press_chord("Ctrl+V")
    assert gui.session.target_spec is not None and gui.session.target_spec.title == "pasted picture"
    monkeypatch.setattr(files, "paste_picture", lambda: None)
    gui.press_chord("Ctrl+V")
    assert "holds no picture" in gui.last_message()


def test_without_a_clipboard_the_remedy_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(desktop.sys, "platform", "linux")
    with pytest.raises(UserError, match="xclip"):
        desktop.copy_picture(np.zeros((2, 2, 3), np.uint8))


def test_the_list_of_edits_goes_anywhere(gui: Gui) -> None:
    gui.session.change("Gap", {"gap": 3e-3})
    gui.session.change("Planes", {"planes": [5e-3]})
    gui.context.show_panel("History")
    gui.draw_frames(3)
    gui.engine(lambda ctx: ctx.item_click("History/**/Start##0"))
    assert gui.session.history_position == 0 and gui.session.can_redo
    gui.engine(lambda ctx: ctx.item_click("History/Redo"))
    assert gui.session.system.gap_m == 3e-3
    gui.engine(lambda ctx: ctx.item_click("History/**/Planes##2"))
    assert len(gui.session.system.planes_m) == 1


# --- after a crash --------------------------------------------------------------------------------------------------


@pytest.fixture
def crashed(make_gui: Callable[..., Gui], tmp_path: Path) -> Gui:
    """A viewer that starts beside a session whose program is gone."""
    store = SessionStore(tmp_path)
    leave_crashed_session(store)
    opened = make_gui(size=(800, 480), engine=True, panels=PANELS, store=store)
    opened.draw_until_idle()
    return opened


def test_work_that_a_crash_left_is_offered_and_recovered(crashed: Gui) -> None:
    offer = crashed.app.panel(FilesPanel).recovery
    assert offer.is_open
    crashed.engine(lambda ctx: ctx.item_click("//Recover your work/**/Recover"))
    assert not offer.is_open and crashed.session.system.gap_m == 4e-3
    assert crashed.session.undo() == "Gap" and crashed.context.store.crashed_sessions() == []


def test_what_is_discarded_is_gone_and_later_keeps_it(crashed: Gui) -> None:
    offer = crashed.app.panel(FilesPanel).recovery
    crashed.engine(lambda ctx: ctx.item_click("//Recover your work/Later"))
    assert not offer.is_open and len(crashed.context.store.crashed_sessions()) == 1
    offer.discard(crashed.context.store.crashed_sessions()[0])
    assert crashed.context.store.crashed_sessions() == []
