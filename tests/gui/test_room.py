"""In a small window nothing is cut off: no label, no tab, no button's text; and notes leave the buttons alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from imgui_bundle import imgui

from holoview.evidence.sweep.in_viewer import sweep_document
from holoview.light.model import preset
from tests.gui.conftest import Gui, small_bench

pytestmark = pytest.mark.gpu
_SLACK_PX = 1.0  # positions are rounded to whole pixels


def _shown(gui: Gui, title: str) -> tuple[Any, list[str]]:
    """The window of a panel once it is seen, and a line if what it holds is wider than its room."""
    gui.context.show_panel(title)
    for _ in range(3):  # a panel that measures grows, and then has a scroll bar
        gui.draw_frames()
        gui.draw_until_idle()
    window = imgui.internal.find_window_by_name(title)
    room = window.work_rect.max.x - window.work_rect.min.x
    is_wide = window.content_size.x > room + _SLACK_PX
    return window, [f"{title}: {window.content_size.x:.0f} of {room:.0f}"] * is_wide


@pytest.mark.long
@pytest.mark.parametrize("size", [(1024, 700), (1280, 800)])
def test_nothing_is_cut_off_in_a_small_window(make_gui: Callable[..., Gui], size: tuple[int, int]) -> None:
    gui = make_gui(size=size)
    gui.draw_until_idle()
    gui.press_chord("Y")  # an eye, whose panel has most
    gui.draw_until_idle()
    cut = []
    shown = [guarded.panel.title for guarded in gui.app.panels if guarded.panel.starts_open]
    for title in shown:
        window, wide = _shown(gui, title)
        cut += wide
        bar = window.dock_node.tab_bar
        tabs = bar.bar_rect.max.x - bar.bar_rect.min.x
        if bar.width_all_tabs_ideal > tabs + _SLACK_PX:
            cut.append(f"tabs beside {title}: {bar.width_all_tabs_ideal:.0f} of {tabs:.0f}")
    assert cut == []


@pytest.mark.long
def test_labels_are_seen_whole_in_text_of_twice_the_size(make_gui: Callable[..., Gui]) -> None:
    """Values may be shortened there; tabs that have no room scroll."""
    gui = make_gui(small_bench(frames=3), size=(1280, 800))
    gui.context.set_text_size(2.0)
    gui.draw_until_idle()
    cut = []
    for title in [guarded.panel.title for guarded in gui.app.panels if guarded.panel.starts_open]:
        window, wide = _shown(gui, title)
        cut += wide
        for tab in window.dock_node.tab_bar.tabs:
            if tab.width < tab.content_width - _SLACK_PX:
                cut.append(f"a tab beside {title}: {tab.width:.0f} of {tab.content_width:.0f}")
    assert cut == []


@pytest.mark.parametrize("theme", ["Dark", "Light"])
def test_all_focal_planes_are_seen_in_a_large_window(make_gui: Callable[..., Gui], theme: str) -> None:
    gui = make_gui(size=(1920, 1080))
    gui.context.set_theme(theme)
    window, _ = _shown(gui, "Focal plane")
    (strip,) = window.dc.child_windows
    assert (strip.scroll_max.x, strip.scroll_max.y) == (0, 0)


def test_a_tab_that_opens_where_tabs_scroll_is_seen_with_its_cross(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(size=(1024, 700))
    gui.session.sweeper = sweep_document
    for title in ("Eye", "Sweep"):  # the second of them has no room
        window, _ = _shown(gui, title)
    bar = window.dock_node.tab_bar
    tab = imgui.internal.tab_bar_find_tab_by_id(bar, window.tab_id)
    room = bar.bar_rect.max.x - bar.bar_rect.min.x
    assert bar.width_all_tabs > room
    assert tab.offset >= bar.scrolling_anim and tab.offset + tab.width - bar.scrolling_anim <= room + _SLACK_PX


def test_numbers_and_buttons_of_the_lasers_have_room(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(preset.load("holochrome-8").edit({"shape": [64, 96]}), (1024, 700))
    window, _ = _shown(gui, "Lasers")
    left, _, right, _ = gui.context.item_rects["nm 1"]
    assert imgui.calc_text_size("487.14").x <= right - left
    table = next(child for child in window.dc.child_windows if child.scroll_max.y > 0)
    assert gui.context.item_rects["remove 1"][2] <= table.inner_rect.max.x


def test_the_sheet_of_keys_holds_its_sentence(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(size=(1280, 800))
    gui.press_chord("?")
    gui.draw_frames(4)
    sheet = imgui.internal.find_window_by_name("Keys")
    assert sheet.content_size.x <= sheet.work_rect.max.x - sheet.work_rect.min.x + _SLACK_PX


def test_the_texts_of_the_buttons_for_files_have_room(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(size=(1024, 700))
    gui.context.show_panel("Files")
    gui.draw_frames(4)
    rects = {name: rect for name, rect in gui.context.item_rects.items() if name.startswith("file: Save ")}
    assert len(rects) > 10
    for name, (left, _, right, _) in rects.items():
        padding = 2 * imgui.get_style().frame_padding.x
        text = f"{name.removeprefix('file: Save ').capitalize()}…"
        assert imgui.calc_text_size(text).x + padding <= right - left, name


def test_notes_never_cover_a_button(make_gui: Callable[..., Gui]) -> None:
    """Notes lie on the picture, or, where none is shown, at the lower right."""
    gui = make_gui(size=(1024, 700))
    gui.draw_until_idle()
    for number in range(4):
        gui.session.messages.post(f"A note of some length, of which there are four at once, number {number}.")
    gui.draw_frames(3)
    left, top, right, bottom = gui.context.item_rects["image"]
    seen = [imgui.internal.find_window_by_name(f"##toast{number}") for number in range(4)]
    for toast in seen:
        low, high = toast.pos, (toast.pos.x + toast.size.x, toast.pos.y + toast.size.y)
        assert left <= low.x and high[0] <= right and top - 80 <= low.y and high[1] <= bottom


@pytest.fixture
def tight(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Buttons whose text had no room, as they are drawn."""
    found: list[str] = []
    draw = imgui.button

    def checked(label: str, *arguments: Any) -> bool:
        is_clicked, text = draw(label, *arguments), label.partition("##")[0]
        room = imgui.get_item_rect_size().x - 2 * imgui.get_style().frame_padding.x
        if imgui.calc_text_size(text).x > room + _SLACK_PX:
            found.append(f"{text}: {imgui.calc_text_size(text).x:.0f} of {room:.0f}")
        return bool(is_clicked)

    monkeypatch.setattr(imgui, "button", checked)
    return found


@pytest.mark.long
@pytest.mark.parametrize("size", [1.0, 2.0])
def test_texts_of_buttons_have_room(make_gui: Callable[..., Gui], tight: list[str], size: float) -> None:
    gui = make_gui(small_bench(frames=3), size=(1280, 800))
    gui.session.sweeper = sweep_document
    gui.context.set_text_size(size)
    gui.press_chord("Y")
    gui.draw_until_idle()
    found = {}
    for title in [guarded.panel.title for guarded in gui.app.panels]:
        _shown(gui, title)
        tight.clear()  # while a panel opens, it is small
        gui.draw_frames()
        found[title] = [*tight]
    gui.press_chord("Ctrl+O")
    gui.draw_frames(4)
    tight.clear()
    gui.draw_frames()
    found["Open"] = tight
    assert {title: texts for title, texts in found.items() if texts} == {}


def test_keys_stand_beside_their_commands_in_text_of_twice_the_size(
    make_gui: Callable[..., Gui], monkeypatch: pytest.MonkeyPatch
) -> None:
    gui, name, keys = make_gui(size=(1280, 800)), imgui.text, imgui.text_disabled
    gui.context.set_text_size(2.0)
    names: list[tuple[str, Any]] = []
    covered: list[str] = []

    def write_name(text: str) -> None:
        name(text)
        names.append((text, imgui.get_item_rect_max()))

    def write_keys(text: str) -> None:
        keys(text)
        low = imgui.get_item_rect_min()
        if names and low.y < names[-1][1].y and low.x < names[-1][1].x:  # on the same line
            covered.append(names[-1][0])

    gui.press_chord("?")
    gui.draw_frames(4)
    monkeypatch.setattr(imgui, "text", write_name)
    monkeypatch.setattr(imgui, "text_disabled", write_keys)
    gui.draw_frames()
    assert len(names) > 30 and covered == []


@pytest.mark.parametrize("title", ["Eye", "Sweep", "Regions"])
def test_no_label_of_an_open_section_is_cut(
    make_gui: Callable[..., Gui], monkeypatch: pytest.MonkeyPatch, title: str
) -> None:
    gui, header = make_gui(size=(1024, 700)), imgui.collapsing_header
    gui.session.sweeper = sweep_document
    monkeypatch.setattr(imgui, "collapsing_header", lambda *of: (imgui.set_next_item_open(True), header(*of))[1])
    gui.press_chord("Y")
    gui.session.edit_view("Line", profile=(10, 10, 60, 50))
    gui.draw_until_idle()
    for size in (1.0, 2.0) if title != "Eye" else (1.0,):
        gui.context.set_text_size(size)
        assert _shown(gui, title)[1] == [], size


def test_lasers_are_seen_in_text_of_twice_the_size(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(size=(1280, 800))
    gui.context.set_text_size(2.0)
    window, _ = _shown(gui, "Lasers")
    (table,) = [child for child in window.dc.child_windows if "lasers" in child.name]
    assert table.size.y >= 4 * imgui.get_frame_height_with_spacing()
