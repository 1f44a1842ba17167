"""The strip of elements, of a chain and of the short form: chosen, edited, added, and the light behind them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from imgui_bundle import hello_imgui

import holoview as hv
from holoview.light.model.bench_drawing import draw_bench
from holoview.light.model.system import System
from holoview.viewer.app.panels.drawing import DrawingPanel, element_of
from holoview.viewer.app.panels.element import ElementPanel
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.panels.parameters import BenchPanel, EffectsPanel
from holoview.viewer.app.panels.point import PointPanel
from holoview.viewer.app.panels.view_settings import ViewPanel
from tests.gui.conftest import Gui, small_bench

pytestmark = pytest.mark.gpu

_PANELS = (DrawingPanel, ElementPanel, ImagePanel, BenchPanel, EffectsPanel, ViewPanel, PointPanel)


def chain() -> System:
    """A phase modulator of 64 × 96 pixels, 2 mm before a coarse amplitude modulator."""
    phase = {"kind": "phase", "pitch": "8 um", "shape": [64, 96], "stroke": "700 nm"}
    coarse = {"kind": "amplitude", "name": "coarse", "pitch": "128 um", "shape": [4, 6]}
    return System(
        ["460 nm", "530 nm", "620 nm"],
        [[0.4, 0.4, 0.4]],
        elements=[phase, {"kind": "space", "distance": "2 mm"}, coarse],
        planes_m=[10e-3],
    )


@pytest.fixture(params=[chain, small_bench], ids=["chain", "short form"])
def gui(make_gui: Callable[..., Gui], request: pytest.FixtureRequest) -> Gui:
    opened = make_gui(request.param(), (1500, 800), panels=_PANELS)
    opened.context.commands.run("Draw the bench")
    opened.draw_until_idle()
    return opened


def place(gui: Gui, name: str, role: str = "name") -> tuple[float, float]:
    """Where the first label of an element is on the screen; role "distance": that of its length."""
    system = gui.session.system
    drawing = draw_bench(system)
    label = next(label for label in drawing.labels if element_of(system, label.key) == name and label.role == role)
    return gui.item_position("bench drawing", label.x / drawing.width, label.y / drawing.height)


def names(gui: Gui) -> tuple[str, ...]:
    return gui.session.system.element_names


def press(gui: Gui, item: str) -> None:
    gui.click(gui.item_position(item))
    gui.draw_until_idle()


def test_an_element_is_chosen_by_a_click_and_its_keys_are_edited_with_undo(gui: Gui) -> None:
    name = names(gui)[2]
    gui.click(place(gui, name))
    gui.draw_until_idle()
    assert gui.context.chosen_element == name
    before = gui.session.system
    gui.click(gui.item_position(f"elements.{name}.levels"))
    gui.draw_until_idle()
    gui.press_chord("Down")
    gui.press_chord("Enter")
    gui.draw_until_idle()
    if gui.session.system == before:  # where the list takes the pointer alone
        gui.context.change("Levels", f"elements.{name}.levels", 2)
    assert gui.session.system.elements[2].levels.tolist() == [0.0, 1.0]
    gui.session.undo()
    assert gui.session.system == before


@pytest.mark.long
def test_the_range_of_an_amplitude_modulator_is_typed(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(chain(), (1500, 800), panels=_PANELS)
    gui.context.commands.run("Draw the bench")
    gui.draw_until_idle()
    gui.click(place(gui, "coarse"))
    gui.draw_until_idle()
    for typed, found in (("0.1, 0.9", (0.1, 0.9)), ("0.9, 0.1", (0.1, 0.9)), ("x", (0.1, 0.9))):
        gui.click(gui.item_position("elements.coarse.range"))
        gui.press_chord("Ctrl+A")
        gui.type_text(typed)
        gui.press_chord("Enter")
        gui.draw_until_idle()
        assert gui.session.system.elements[2].range == found
    assert "elements.coarse.range" in gui.session.messages.all[-1].text


def test_a_length_is_dragged_in_one_step_of_undo(gui: Gui) -> None:
    name = names(gui)[1]
    before = gui.session.system
    x, y = place(gui, name, "distance")
    gui.drag((x, y), (x + 60, y))
    gui.draw_until_idle()
    # 300 pixels are a factor of ten; a drag begins after the pixels that tell it from a click, and is rounded to pixels
    assert gui.session.system.elements[1].distance_m == pytest.approx(2e-3 * 10**0.2, rel=0.1)
    gui.session.undo()
    assert gui.session.system == before


def test_a_modulator_is_switched_off_and_on(gui: Gui) -> None:
    gui.context.chosen_element = names(gui)[2]
    gui.draw_until_idle()
    seen = gui.context.side_renderers.now.xyz()
    press(gui, "switch element")
    assert [parked.name for parked in gui.session.document.parked] == [names(gui)[2]]
    assert not np.array_equal(gui.context.side_renderers.now.xyz(), seen)
    press(gui, "switch element")
    assert np.array_equal(gui.context.side_renderers.now.xyz(), seen)


def test_what_is_refused_is_told_and_changes_nothing(gui: Gui) -> None:
    before = gui.session.document
    gui.context.chosen_element = names(gui)[1]
    gui.draw_until_idle()
    press(gui, "move behind")
    assert gui.session.document is before
    assert "a space; expected an element between spaces" in gui.last_message()


def test_an_element_is_added_moved_and_removed(gui: Gui) -> None:
    panel, before = gui.app.panel(ElementPanel), gui.session.system
    gui.context.attempt(panel.add, gui.context, "amplitude")
    gui.draw_until_idle()
    assert gui.context.chosen_element == names(gui)[1] and gui.session.system.elements[1].kind == "amplitude"
    press(gui, "move before")
    assert names(gui)[0] == gui.context.chosen_element
    press(gui, "remove element")
    assert gui.session.system.elements[0].kind == "phase"
    assert len(names(gui)) == len(before.element_names)
    for _ in range(3):
        gui.session.undo()
    assert gui.session.system == before


def test_the_image_shows_the_light_behind_an_element_until_escape(gui: Gui) -> None:
    """Behind the last element as `field_at` has it: the sum over lasers of |field|², which are in one frame."""
    system, name = gui.session.system, names(gui)[2]
    gui.context.chosen_element = name
    gui.draw_until_idle()
    press(gui, "light behind")
    view, seen = gui.session.view_settings, gui.context.page_images.seen_field
    assert (view.page, view.quantity, view.stage) == ("field", "intensity", system.stage_behind(name))
    assert seen is not None
    drive = dict(gui.session.drive) if system.is_chain else gui.session.drive
    plan, stage = hv.make_plan(system), system.stage_behind(name)
    expected = sum(
        plan.weights[0, laser] * weight * abs(hv.field_at(system, drive, stage=stage, laser=laser).values) ** 2
        for laser, weight in enumerate(plan.colour_weights[:, 1])
    )
    # complex64 on the way: 2⁻²⁴ for each of the operations of two transforms, measured 3e-6 of the largest
    assert np.abs(seen.values - expected).max() < 1e-5 * expected.max()
    gui.press_chord("Escape")
    gui.draw_until_idle()
    assert gui.session.view_settings.page == "image"


def test_keys_choose_the_next_element(gui: Gui) -> None:
    gui.context.chosen_element = names(gui)[0]
    for _ in range(len(_PANELS)):
        gui.press_chord("F6")
        gui.process_frames(8)
        if gui.app.keyboard_focus.panel == "Drawing":
            break
    gui.press_chord("Right")
    gui.process_frames(4)
    assert gui.context.chosen_element == names(gui)[1]
    gui.press_chord("Left")
    gui.process_frames(4)
    assert gui.context.chosen_element == names(gui)[0]


def test_no_panel_fails_on_a_chain(gui: Gui) -> None:
    """`make_gui` fails if a panel did."""
    for panel in _PANELS:
        gui.context.show_panel(panel.title)
        gui.draw_until_idle()
    for message in gui.session.messages.all:
        assert message.kind != "error"


@pytest.mark.parametrize("size", [(1280, 800), (1024, 700)])
def test_the_image_and_the_whole_height_of_the_strip_are_in_view(
    make_gui: Callable[..., Gui], size: tuple[int, int]
) -> None:
    """The middle of all other docks keeps at least a third of the height; a closed drawing gives back what it took."""
    gui = make_gui(small_bench(), size)
    gui.draw_until_idle()
    left, upper, right, lower = gui.context.item_rects["image"]
    gui.context.commands.run("Draw the bench")
    gui.draw_until_idle()
    now, strip = gui.context.item_rects["image"], gui.context.item_rects["bench drawing"]
    assert now[:3] == (left, upper, right) and size[1] / 3 < now[3] - upper < lower - upper
    assert now[3] < strip[1] and strip[3] < size[1]
    window = hello_imgui.get_runner_params().docking_params.dockable_window_of_name("Drawing")
    window.is_visible = False
    gui.process_frames(4)
    assert gui.context.item_rects["image"] == (left, upper, right, lower)
