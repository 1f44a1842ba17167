"""What a sequence of events does, doesn't depend on the frames on which they fall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rendercanvas.offscreen import OffscreenRenderCanvas

from holoview.light.gpu.device import Device
from holoview.light.model.system import System
from holoview.viewer.app.app import App
from holoview.viewer.app.panels.files import FilesPanel
from holoview.viewer.app.script import InputDriver
from holoview.viewer.app.user_input import Chord
from holoview.viewer.app.window import Window
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.render.view_settings import ViewSettings
from tests.gui.conftest import small_bench

pytestmark = pytest.mark.gpu

Event = dict[str, Any]
SIZE = (900, 700)
FRAMES_OF_A_PATIENT_USER = 8
FRAME_S = 1e-3  # so short that neither repeats a held key, whose repetitions depend on time
CHORDS = ("E", "Shift+E", "R", "C", "K", "G", "S", "W", "D", "X", "F", "=", "-", ".", "PageDown", "1", "F1", "?")
OPENING = ("Ctrl+P", "Ctrl+S", "Ctrl+Z", "Ctrl+Shift+Z", "Shift+R", "Escape", "Enter", "Down")
WORDS = ("wipe", "solo", "Zs", "nextpage", "12.5")
ITEMS = (
    "gap",
    "exposure",
    "gamma",
    "laser 1",
    "plane",
    "plane 10.5 mm",
    "nm 1",
    "image",
    "page",
    "channel",
    "remove 0",
)


@dataclass(frozen=True)
class Outcome:
    """What was done, and what is shown."""

    history: tuple[str, ...]
    system: System
    view: ViewSettings
    centre: tuple[float, float]
    help: tuple[str, str]
    file_name: str | None
    messages: tuple[str, ...]


def click(item: str, x: float, y: float) -> list[Event]:
    """Moves there and clicks."""
    return [_pointer("pointer_move", item, x, y), *_press(item, x, y)]


def double_click(item: str) -> list[Event]:
    """Two clicks at once."""
    return [_pointer("pointer_move", item, 0.5, 0.5), *_press(item, 0.5, 0.5), *_press(item, 0.5, 0.5)]


def drag(item: str, ends: tuple[float, float, float, float], modifier: str) -> list[Event]:
    """Presses, moves in three steps, releases; a modifier is held meanwhile, unless it is ""."""
    x0, y0, x1, y1 = ends
    steps = [(x0 + (x1 - x0) * share, y0 + (y1 - y0) * share) for share in (0.3, 0.7, 1.0)]
    return _held(
        modifier,
        [
            _pointer("pointer_move", item, x0, y0),
            _pointer("pointer_down", item, x0, y0, 1),
            *(_pointer("pointer_move", item, *place, held=True) for place in steps),
            _pointer("pointer_up", item, x1, y1, 1),
        ],
    )


def wheel(item: str, notches: Sequence[int], modifier: str) -> list[Event]:
    """Turns the wheel in a burst."""
    turns = [{**_pointer("wheel", item, 0.4, 0.6), "dx": 0.0, "dy": -100.0 * notch} for notch in notches]
    return _held(modifier, [_pointer("pointer_move", item, 0.4, 0.6), *turns])


def chord(text: str) -> list[Event]:
    """Presses keys as a keyboard does; a character follows its key."""
    modifiers, name = Chord(text).parts
    modifiers = ("Shift", *modifiers) if name == "?" else modifiers
    down: list[Event] = [{"event_type": "key_down", "key": name}]
    if len(name) == 1 and not {"Control", "Alt"} & set(modifiers):
        letter = name.upper() if "Shift" in modifiers else name.lower()
        down.append({"event_type": "char", "data": letter})
    events = [*down, {"event_type": "key_up", "key": name}]
    for modifier in reversed(modifiers):
        events = _held(modifier, events)
    return events


def type_text(text: str) -> list[Event]:
    """Types letters; the next key goes down before the last one is up."""
    events: list[Event] = []
    for number, letter in enumerate(text):
        events += [{"event_type": "key_down", "key": letter}, {"event_type": "char", "data": letter}]
        events += [{"event_type": "key_up", "key": text[number - 1]}] if number else []
    return [*events, {"event_type": "key_up", "key": text[-1]}]


def _held(modifier: str, events: list[Event]) -> list[Event]:
    if not modifier:
        return events
    return [{"event_type": "key_down", "key": modifier}, *events, {"event_type": "key_up", "key": modifier}]


def _pointer(kind: str, item: str, x: float, y: float, button: int = 0, *, held: bool = False) -> Event:
    buttons = (1,) if held or kind == "pointer_down" else ()
    return {"event_type": kind, "item": item, "at": (x, y), "button": button, "buttons": buttons}


def _press(item: str, x: float, y: float) -> list[Event]:
    return [_pointer("pointer_down", item, x, y, 1), _pointer("pointer_up", item, x, y, 1)]


_share = st.sampled_from([0.1, 0.3, 0.5, 0.8])
_modifier = st.sampled_from(["", "Shift", "Control"])
_gestures = st.one_of(
    st.builds(click, st.sampled_from(ITEMS), _share, _share),
    st.builds(drag, st.sampled_from(ITEMS[:8]), st.tuples(_share, _share, _share, _share), _modifier),
    st.builds(wheel, st.just("image"), st.lists(st.sampled_from([1, 2]), min_size=1, max_size=4), _modifier),
    st.builds(chord, st.sampled_from(CHORDS)),
    st.builds(chord, st.sampled_from(OPENING)),
    st.builds(type_text, st.sampled_from(WORDS)),
)


class Canvas(OffscreenRenderCanvas):  # type: ignore[misc]
    """A canvas that needn't show its frames. is_shown: whether it does."""

    is_shown = True


def _play(device: Device, events: Sequence[Event], frames_after: Sequence[int]) -> Outcome:
    """Sends events to a new viewer, which processes so many frames after each, and at the end all that it asks for."""
    canvas = Canvas(size=SIZE)
    app = App(EditingSession(small_bench()), device, canvas, frame_s=FRAME_S)
    try:
        driver = InputDriver(app)
        driver.draw_until_idle()
        placed = [_placed(driver, event) for event in events]
        canvas.is_shown = False
        for event, count in zip(placed, frames_after, strict=True):
            canvas.submit_event(event)
            _frames(app, count)
        _frames(app, 1)
        while app.window.has_pending_input:
            _frames(app, 1)
        _frames(app, FRAMES_OF_A_PATIENT_USER)
        return _outcome(app)
    finally:
        app.close()


def _frames(app: App, count: int) -> None:
    for _ in range(count):
        app.window.canvas._process_events()
        app.window.draw()


def _placed(driver: InputDriver, event: Event) -> Event:
    if "item" not in event:
        return dict(event)
    x, y = driver.item_position(event["item"], *event["at"])
    return {**event, "x": x, "y": y, "modifiers": (), "ntouches": 0, "touches": {}}


def _outcome(app: App) -> Outcome:
    session, dialog = app.session, app.panel(FilesPanel).dialog
    view = session.view_settings
    return Outcome(
        tuple(step.label for step in session.history),
        session.system,
        replace(view, centre=(0.5, 0.5), zoom=round(view.zoom, 6)),
        view.centre,
        (app.context.help_overlay.page, app.context.help_overlay.query),
        dialog.name if dialog.is_open else None,
        tuple(message.text for message in session.messages.all),
    )


@pytest.fixture
def unseen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames process input but aren't drawn in viewers whose window says so, which saves most of the time."""
    present = Window._present
    monkeypatch.setattr(Window, "_present", lambda window: present(window) if window.canvas.is_shown else None)


@pytest.mark.explores
@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)
@given(st.lists(_gestures, min_size=1, max_size=5), st.data())
def test_however_events_fall_on_frames_they_do_the_same(
    device: Device, unseen: None, gestures: list[list[Event]], data: st.DataObject
) -> None:
    events = [event for gesture in gestures for event in gesture]
    counts = data.draw(st.lists(st.sampled_from([0, 0, 0, 1, 2]), min_size=len(events), max_size=len(events)))
    patient = _play(device, events, [FRAMES_OF_A_PATIENT_USER] * len(events))
    quick = _play(device, events, counts)
    turns = sum(event["event_type"] == "wheel" for event in events)
    # each turn rounds the image's corner to a pixel of the screen; with five "-" the image is still 47 pixels high
    assert quick.centre == pytest.approx(patient.centre, abs=0.5 / 47 * turns + 1e-9)
    assert replace(quick, centre=patient.centre) == patient
