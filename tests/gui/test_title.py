"""The window is named after the file and tells unsaved work; files are proposed the picture's name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from holoview.viewer.app.panels.files import FilesPanel
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.document.exports import save_hologram
from holoview.viewer.document.session_store import SessionStore
from tests.gui.conftest import Gui
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu


@pytest.fixture
def gui(make_gui: Callable[..., Gui]) -> Gui:
    return make_gui(engine=True, panels=(ImagePanel, FilesPanel))


def test_the_title_is_the_files_name_with_a_star_for_unsaved_work(gui: Gui, tmp_path: Path) -> None:
    gui.draw_frames(2)
    assert gui.app.window.title == "holochrome-8 – holoview"
    gui.session.change("Gap", {"gap": "3 mm"})
    gui.draw_frames(2)
    assert gui.app.window.title == "*holochrome-8 – holoview"
    gui.app.panel(FilesPanel).dialog.folder = tmp_path
    gui.press_chord("Ctrl+S")
    gui.draw_frames(2)
    gui.press_chord("Ctrl+A")
    gui.type_text("mine")
    gui.press_chord("Enter")
    gui.draw_frames(2)
    assert (tmp_path / "mine.safetensors").is_file()
    assert gui.app.window.title == "mine.safetensors – holoview"
    gui.session.edit_view("Exposure", exposure_stops=1.0)
    gui.draw_frames(2)
    assert gui.app.window.title == "mine.safetensors – holoview", "a look is no work"
    gui.press_chord("Ctrl+Z")
    gui.draw_frames(2)
    assert gui.app.window.title.startswith("*"), "the file has another gap"
    gui.press_chord("Ctrl+Y")
    gui.draw_frames(2)
    assert gui.app.window.title == "mine.safetensors – holoview"


def test_a_further_window_on_a_file_has_a_number(gui: Gui, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    store = SessionStore(tmp_path)
    monkeypatch.setattr(store, "windows_before", lambda title: int(title == "mine.safetensors"))
    gui.context.store = store
    gui.draw_frames(2)
    assert gui.app.window.title == "holochrome-8 – holoview"
    save_hologram(gui.session, tmp_path / "mine.safetensors")
    gui.draw_frames(2)
    assert gui.app.window.title == "mine.safetensors (2) – holoview"


def test_an_opened_file_is_no_unsaved_work_and_a_picture_names_what_is_saved(gui: Gui, tmp_path: Path) -> None:
    picture = tmp_path / "red fox.png"
    Image.fromarray(np.full((8, 8, 3), (200, 10, 10), np.uint8)).save(picture)
    gui.context.loader.open(picture)
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_frames(2)
    assert gui.app.window.title == "red fox.png – holoview"
    gui.press_chord("Ctrl+S")
    gui.draw_frames(2)
    assert gui.app.panel(FilesPanel).dialog.name == "red fox.safetensors"
    gui.press_chord("Escape")
    gui.context.commands.run("Save preset…")
    gui.draw_frames(2)
    assert gui.app.panel(FilesPanel).dialog.name == "holochrome-8.toml", "a bench has its own name"


def test_the_file_menu_has_the_order_of_other_programs(gui: Gui) -> None:
    def choose(ctx: Any) -> None:
        for item, dialog in (
            ("Open…", "Open"),
            ("Save hologram…", "Save hologram"),
            ("Export/Save page…", "Save page"),
            ("Light from a field…", "Light from a field"),
        ):
            ctx.menu_click(f"//##MainMenuBar/File/{item}")
            ctx.item_click(f"//{dialog}/Cancel##file")

    gui.engine(choose)
