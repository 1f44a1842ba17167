"""What makes the viewer comfortable: theme, layout and recent files come back, hints come once, files are dropped."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from imgui_bundle import hello_imgui
from PIL import Image
from rendercanvas.offscreen import OffscreenRenderCanvas

from holoview.holograms.targets.picture import Picture
from holoview.light.gpu.device import Device
from holoview.viewer.app import run
from holoview.viewer.app.app import App
from holoview.viewer.app.desktop import connect_desktop, fit_text_size
from holoview.viewer.app.panels.files import FilesPanel
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.script import InputDriver
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.file_loader import NO_FILES
from holoview.viewer.document.session_store import SessionStore
from tests.gui.conftest import SIZE, Gui, small_bench
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu


@pytest.fixture
def start(device: Device, tmp_path: Path) -> Iterator[Callable[[], InputDriver]]:
    """Starts the viewer as `holoview view` does, with a folder of its own; the one before is closed."""
    opened: list[App] = []

    def started() -> InputDriver:
        for app in opened:
            app.close()
        opened.clear()
        canvas = OffscreenRenderCanvas(size=SIZE)
        app = run.open_app(EditingSession(small_bench()), device, canvas, SessionStore(tmp_path), NO_FILES)
        app.context.loader.optimises_new_targets = False
        opened.append(app)
        driver = InputDriver(app)
        driver.draw_frames(4)
        return driver

    yield started
    for app in opened:
        app.close()


def _is_visible(title: str) -> bool:
    return bool(hello_imgui.get_runner_params().docking_params.dockable_window_of_name(title).is_visible)


def test_theme_and_layout_come_back_and_hints_come_once(start: Callable[[], InputDriver]) -> None:
    driver = start()
    first = driver.app
    assert "? shows all keys" in first.session.messages.all[0].text
    first.context.set_theme("Light")
    hello_imgui.get_runner_params().docking_params.dockable_window_of_name("Gamut").is_visible = False
    driver.draw_frames(3)
    again = start().app
    assert again.context.theme == "Light" and not _is_visible("Gamut") and _is_visible("Lasers")
    assert list(again.session.messages.all) == []


def test_without_a_folder_that_can_be_written_to_it_starts_and_says_so(device: Device, tmp_path: Path) -> None:
    (tmp_path / "home").touch()  # no folder can be made inside a file, not even by root
    store = SessionStore(tmp_path / "home" / "state")
    app = run.open_app(EditingSession(small_bench()), device, OffscreenRenderCanvas(size=SIZE), store, NO_FILES)
    try:
        app.context.set_theme("Light")
        InputDriver(app).draw_frames(3)
        warnings = [message.text for message in app.session.messages.all if message.kind != "info"]
        assert len(warnings) == 2 and all("state: can't be made" in text for text in warnings), warnings
        assert app.context.theme == "Light" and list(tmp_path.iterdir()) == [tmp_path / "home"]
    finally:
        app.close()


def test_recent_files_are_in_the_menu(make_gui: Callable[..., Gui], tmp_path: Path) -> None:
    picture = tmp_path / "red.png"
    Image.fromarray(np.full((8, 8, 3), (200, 10, 10), np.uint8)).save(picture)
    store = SessionStore(tmp_path / "store")
    store.preferences.add_recent_file(picture)
    gui = make_gui(engine=True, panels=(ImagePanel, FilesPanel), store=store)
    gui.engine(lambda ctx: ctx.menu_click(f"//##MainMenuBar/File/Recent/1 {picture.name}"))
    assert gui.session.wait_until_idle(PATIENCE_S)
    assert gui.session.target_spec is not None and gui.session.target_spec.title == "red.png"


def test_recent_files_are_in_the_palette(make_gui: Callable[..., Gui], tmp_path: Path) -> None:
    """Also two of one name, which their folders tell apart."""
    store = SessionStore(tmp_path / "store")
    for number, folder in enumerate(("one", "two")):
        picture = tmp_path / folder / "red.png"
        picture.parent.mkdir()
        Image.fromarray(np.full((8, 8 + number, 3), (200, 10, 10), np.uint8)).save(picture)
        store.preferences.add_recent_file(picture)
    gui = make_gui(panels=(ImagePanel,), store=store)
    gui.press_chord("Ctrl+P")
    gui.draw_frames(2)
    gui.type_text("red.png one")
    assert [command.group for command in gui.context.help_overlay.matches()] == ["Recent"]
    gui.press_chord("Enter")
    assert gui.session.wait_until_idle(PATIENCE_S)
    gui.draw_until_idle()
    assert gui.session.target_spec is not None and gui.session.target_spec.title == "red.png"
    assert isinstance(gui.session.target_spec.source, Picture)
    assert gui.session.target_spec.source.rgb.shape == (8, 8, 3)


@pytest.mark.parametrize(("scale", "width_mm", "expected"), [(1.0, 597, 1.5), (2.0, 597, 1.0), (1.0, 1016, 1.0)])
def test_text_is_larger_on_a_dense_screen_of_which_no_scale_is_told(
    gui: Gui, scale: float, width_mm: int, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """4K at 27 inches, the same told by the desktop, and 4K at 46 inches."""
    monkeypatch.setattr("sys.platform", "linux")
    glfw = SimpleNamespace(
        get_primary_monitor=lambda: "monitor",
        get_window_content_scale=lambda window: (scale, scale),
        get_video_mode=lambda monitor: SimpleNamespace(size=SimpleNamespace(width=3840)),
        get_monitor_physical_size=lambda monitor: (width_mm, 1),
    )
    fit_text_size(gui.context, glfw, "window")
    assert gui.context.text_size == expected


def test_files_dropped_on_the_window_are_opened_and_text_goes_to_the_clipboard(gui: Gui, tmp_path: Path) -> None:
    picture = tmp_path / "red.png"
    Image.fromarray(np.full((8, 8, 3), (200, 10, 10), np.uint8)).save(picture)
    dropped: list[Callable[[Any, Sequence[str]], None]] = []
    held: list[str] = []
    glfw = SimpleNamespace(
        set_drop_callback=lambda window, call: dropped.append(call),
        set_clipboard_string=lambda window, text: held.append(text),
        get_clipboard_string=lambda window: held[-1].encode(),
    )
    connect_desktop(gui.context, glfw, window=None)
    dropped[0](None, [str(picture)])
    assert gui.session.wait_until_idle(PATIENCE_S)
    assert gui.session.target_spec is not None and gui.session.target_spec.title == "red.png"
    from imgui_bundle import imgui

    imgui.set_clipboard_text("λ")
    assert held == ["λ"] and imgui.get_clipboard_text() == "λ"


def test_the_window_redraws_only_when_something_happened(gui: Gui, monkeypatch: pytest.MonkeyPatch) -> None:
    gui.draw_until_idle()
    gui.draw_frames(6)
    asked: list[bool] = []
    monkeypatch.setattr(gui.canvas, "request_draw", lambda *_: asked.append(True))
    gui.draw_frames()
    assert not asked, "at rest"
    gui.session.change("Gap", {"gap": "3 mm"})
    assert asked, "an edit"
