"""The tour: at the first start with the shipped picture only, five steps, left at any time, in the way of nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest
from imgui_bundle import imgui
from PIL import Image
from rendercanvas.offscreen import OffscreenRenderCanvas

from holoview.holograms.targets.picture import UnreadPicture
from holoview.light.gpu.device import Device
from holoview.light.model import preset
from holoview.viewer.app import run
from holoview.viewer.app.app import App
from holoview.viewer.app.panels.files import FilesPanel
from holoview.viewer.app.panels.focus import FocusPanel
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.example import EXAMPLE_PRESET, new_session
from holoview.viewer.document.file_loader import FilesToOpen
from holoview.viewer.document.optimisation_job import running_optimisation
from holoview.viewer.document.session_store import SessionStore
from holoview.viewer.document.target_builder import TargetSpec, example_target
from holoview.viewer.render.view_settings import NOW
from tests.gui.conftest import SIZE, Gui, small_bench

pytestmark = pytest.mark.gpu


@pytest.fixture
def start(device: Device, tmp_path: Path) -> Iterator[Callable[..., App]]:
    """Starts the viewer as `holoview view` does, with the user's folder `tmp_path`; the one before is closed."""
    opened: list[App] = []

    def started(session: EditingSession, names: tuple[str, ...] = ()) -> App:
        for app in opened:
            app.close()
        canvas, store = OffscreenRenderCanvas(size=SIZE), SessionStore(tmp_path)
        opened[:] = [run.open_app(session, device, canvas, store, FilesToOpen(names))]
        opened[0].context.loader.optimises_new_targets = False
        for _ in range(4):
            opened[0].window.canvas.draw()
        return opened[0]

    yield started
    for app in opened:
        app.close()


@pytest.fixture(scope="module")
def small_example(tmp_path_factory: pytest.TempPathFactory) -> TargetSpec:
    """The still life with its depth, of as many pixels as the small bench."""
    folder, example = tmp_path_factory.mktemp("example"), example_target()
    assert isinstance(example.source, UnreadPicture) and isinstance(example.placement.depth, Path)
    small = []
    for path in (Path(example.source.source), example.placement.depth):
        with Image.open(path) as picture:
            picture.resize((96, 64)).save(folder / path.name)
        small.append(folder / path.name)
    return replace(example, source=UnreadPicture(small[0]), placement=replace(example.placement, depth=small[1]))


@pytest.fixture
def gui(make_gui: Callable[..., Gui], small_example: TargetSpec) -> Gui:
    """A viewer of the small bench with the still life as target, in which the tour was started."""
    opened = make_gui(size=(800, 480), engine=True)
    opened.session.edit("Target", target_spec=small_example)
    opened.draw_until_idle()
    opened.context.commands.run("Tour")
    opened.draw_frames(3)
    return opened


def _click(gui: Gui, name: str) -> None:
    # a panel comes to the front in the frame after it was asked to, and the card moves out of its way
    gui.process_frames(4)
    gui.click(gui.item_position(name))


def _is_seen(title: str) -> bool:
    window = imgui.internal.find_window_by_name(title)
    return window is not None and window.active and not window.hidden


# --- when it opens --------------------------------------------------------------------------------------------------


def test_it_opens_at_the_first_start_and_never_again(start: Callable[..., App]) -> None:
    example = preset.load(EXAMPLE_PRESET)
    first = start(new_session(example))
    assert first.tour.step == 0 and first.session.messages.all == ()
    assert first.context.store is not None and first.context.store.preferences.get("has_seen_tour", False)
    again = start(new_session(example))
    assert again.tour.step is None and again.session.messages.all == ()
    again.context.commands.run("Tour")
    assert again.tour.step == 0


def test_who_opens_something_else_is_told_where_help_is(start: Callable[..., App]) -> None:
    other = start(EditingSession(small_bench()))
    assert other.tour.step is None and "? shows all keys" in other.session.messages.all[0].text
    assert start(new_session(preset.load(EXAMPLE_PRESET)), (EXAMPLE_PRESET,)).tour.step is None


def test_a_viewer_of_a_script_has_none(make_gui: Callable[..., Gui]) -> None:
    assert make_gui().app.tour.step is None


# --- its steps ------------------------------------------------------------------------------------------------------


def test_it_has_five_steps_and_each_shows_its_panel(gui: Gui) -> None:
    tour = gui.app.tour
    assert len(tour.steps) == 5
    for number, step in enumerate(tour.steps):
        gui.draw_frames(4)
        assert tour.step == number and _is_seen(step.panel), step.title
        _click(gui, "tour next")
    assert tour.step is None and not _is_seen("###tour")


def test_back_goes_back(gui: Gui) -> None:
    _click(gui, "tour back")
    assert gui.app.tour.step == 0, "there is nothing before the first"
    _click(gui, "tour next")
    _click(gui, "tour back")
    assert gui.app.tour.step == 0


@pytest.mark.long
def test_the_buttons_try_what_the_steps_say(gui: Gui) -> None:
    _click(gui, "tour try")
    assert gui.app.panel(FocusPanel).is_playing
    _click(gui, "tour try")
    assert not gui.app.panel(FocusPanel).is_playing
    _click(gui, "tour next")
    _click(gui, "tour try")
    assert gui.session.view_settings.solo == 0
    _click(gui, "tour try")
    assert gui.session.view_settings.solo is None
    _click(gui, "tour next")
    _click(gui, "tour try")
    assert gui.session.system.effects
    _click(gui, "tour try")
    assert not gui.session.system.effects
    _click(gui, "tour next")
    _click(gui, "tour try")
    job = running_optimisation(gui.session)
    assert job is not None
    job.cancel()
    _click(gui, "tour next")
    _click(gui, "tour try")
    assert gui.app.panel(FilesPanel).dialog.is_open


# --- leaving it -----------------------------------------------------------------------------------------------------


_WAYS_OUT: dict[str, Callable[[Gui], None]] = {
    "escape": lambda gui: gui.press_chord("Escape"),
    "button": lambda gui: _click(gui, "tour leave"),
    "cross": lambda gui: gui.engine(lambda ctx: ctx.window_close("//###tour")),
}


@pytest.mark.long
def test_it_can_be_left_at_any_step_and_begun_again(gui: Gui) -> None:
    for step, (name, leave) in product((0, 3), _WAYS_OUT.items()):
        gui.context.commands.run("Tour")
        gui.process_frames(3)
        for _ in range(step):
            _click(gui, "tour next")
        assert gui.app.tour.step == step and _is_seen("###tour")
        leave(gui)
        gui.process_frames(2)
        assert gui.app.tour.step is None and not _is_seen("###tour"), name


def test_escape_ends_what_lies_above_first(gui: Gui) -> None:
    gui.session.edit_view("Wipe", compare="wipe", b=NOW)
    gui.draw_frames(2)
    gui.press_chord("Escape")
    assert gui.session.view_settings.compare == "off" and gui.app.tour.step == 0
    gui.press_chord("?")
    gui.press_chord("Escape")
    assert not gui.context.help_overlay.page and gui.app.tour.step == 0
    gui.context.drag_tool = "line"
    gui.draw_frames(2)
    gui.press_chord("Escape")
    assert gui.context.drag_tool == "" and gui.app.tour.step == 0
    gui.press_chord("F6")
    gui.process_frames(6)
    gui.press_chord("Escape")
    assert not gui.app.keyboard_focus.is_on and gui.app.tour.step == 0
    gui.press_chord("Escape")
    assert gui.app.tour.step is None


# --- in the way of nothing ------------------------------------------------------------------------------------------


def test_everything_can_be_used_while_it_is_open(gui: Gui) -> None:
    before = gui.session.view_settings.plane_m
    gui.click(gui.item_position("plane", 0.9))
    assert gui.session.view_settings.plane_m > before and gui.app.tour.step == 0
    gui.press_chord("Alt+Z")
    assert gui.session.view_settings.plane_m == before


@pytest.mark.parametrize("size", [(320, 320), (640, 400), (1280, 800)], ids=str)
def test_the_card_lies_inside_the_window_with_all_its_buttons(
    make_gui: Callable[..., Gui], size: tuple[int, int]
) -> None:
    gui = make_gui(size=size)
    gui.app.tour.start()
    for step in gui.app.tour.steps:
        gui.draw_frames(4)
        card = gui.context.item_rects["tour"]
        assert 0 <= card[0] < card[2] <= size[0] and 0 <= card[1] < card[3] <= size[1], step.title
        for name in ("tour try", "tour leave", "tour back", "tour next"):
            rect = gui.context.item_rects[name]
            assert card[0] <= rect[0] and card[1] <= rect[1] and rect[2] <= card[2] and rect[3] <= card[3], name
        _click(gui, "tour next")


def test_in_a_window_of_usual_size_it_covers_nothing_that_it_points_at(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(size=(1280, 800))
    gui.app.tour.start()
    for step in gui.app.tour.steps:
        gui.draw_frames(4)
        panel, card = imgui.internal.find_window_by_name(step.panel), gui.context.item_rects["tour"]
        overlap = (
            min(card[2], panel.pos.x + panel.size.x) - max(card[0], panel.pos.x),
            min(card[3], panel.pos.y + panel.size.y) - max(card[1], panel.pos.y),
        )
        assert min(overlap) <= 0, step.title
        _click(gui, "tour next")


def test_it_waits_while_a_dialog_asks(gui: Gui) -> None:
    gui.press_chord("Ctrl+O")
    gui.draw_frames(3)
    assert not _is_seen("###tour") and gui.app.tour.step == 0
    gui.press_chord("Escape")
    gui.draw_frames(3)
    assert not gui.app.panel(FilesPanel).dialog.is_open
    assert _is_seen("###tour") and gui.app.tour.step == 0
