"""Drives a viewer that draws off screen: text scripts, synthetic pointer and key events, and its frame rate.

open still-life.png          a preset, file or picture, as the window opens it
set gap = "3 mm"             a key of the bench, as --set takes it
look exposure_stops = 1      a field of the look
command Pin a snapshot       a command by its name
show Gamut                   a panel by its title
key Ctrl+Z                   keys
type 550                     text, into what has the focus
click image 0.5 0.5          a marked item, and where in it; 0.5 0.5 if absent
drag image 0.2 0.2 0.8 0.8   from there to there
wheel image 0.5 0.5 2        the wheel, by notches
wait                         until everything is computed, all jobs have ended, and a rig has obeyed
screenshot FILE.png          the whole window
"""

from __future__ import annotations

import shlex
import statistics
import time
from collections.abc import Callable
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.pictures import write_png
from holoview.light.gpu.device import Device
from holoview.light.model.system import System
from holoview.util.errors import UserError, suggest_matches
from holoview.util.tables import parse_toml_value
from holoview.viewer.app.app import App
from holoview.viewer.app.user_input import WHEEL_NOTCH, Chord
from holoview.viewer.document.document import middle_plane
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.render.view_settings import ViewSettings

_TIMEOUT_S = 600.0
_POLL_S = 0.02


def run_script(driver: InputDriver, text: str, where: str = "script") -> None:
    """Runs the lines of a script. Raises UserError that names the line which is wrong or fails."""
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.strip()
        if not words or words.startswith("#"):
            continue
        try:
            _run(driver, words)
        except UserError as error:
            raise error.inside(f"{where}:{number}: ") from error


def _run(driver: InputDriver, line: str) -> None:
    verb, _, rest = line.partition(" ")
    verbs: dict[str, Callable[[InputDriver, str], None]] = {
        "open": _open,
        "set": _set,
        "look": _look,
        "command": lambda driver, name: driver.context.commands.run(name),
        "show": _show,
        "key": lambda driver, chord: driver.press_chord(chord),
        "type": lambda driver, text: driver.type_text(text),
        "click": _click,
        "drag": _drag,
        "wheel": _wheel,
        "wait": lambda driver, _: wait_until_idle(driver),
        "screenshot": lambda driver, path: screenshot(driver, Path(path)),
    }
    if verb not in verbs:
        raise UserError(f'"{verb}"', "unknown", remedy=suggest_matches(verb, verbs))
    verbs[verb](driver, rest.strip())
    driver.process_frames(2)
    _raise_errors(driver)


def wait_until_idle(driver: InputDriver) -> None:
    """Draws until everything is computed and all jobs have ended."""
    driver.draw_until_idle(_TIMEOUT_S)
    if not driver.app.session.wait_until_idle(_TIMEOUT_S):
        raise UserError("wait", f"jobs still run after {_TIMEOUT_S:g} s")
    _wait_for_rig(driver)
    driver.draw_until_idle(_TIMEOUT_S)


def _wait_for_rig(driver: InputDriver) -> None:
    """Draws until the devices of a rig have done what they were asked for, and the picture is of that."""
    until = time.monotonic() + _TIMEOUT_S
    while (rig := driver.context.opened_rig) is not None and rig.is_busy:
        if time.monotonic() > until:
            raise UserError("wait", rig.waiting or "the rig is busy")
        time.sleep(_POLL_S)
        driver.process_frames()


def screenshot(driver: InputDriver, path: Path) -> None:
    """Writes the whole window as PNG."""
    write_png(path, driver.draw_frames(2), {})


def _raise_errors(driver: InputDriver) -> None:
    """Raises the failure of a panel, or a UserError for an error message: nobody reads messages of a script."""
    for guarded in driver.app.panels:
        if guarded.failure is not None:
            raise guarded.failure
    wrong = [message for message in driver.app.session.messages.all if message.kind == "error"]
    if wrong:
        raise UserError("the viewer", wrong[-1].text)


def _open(driver: InputDriver, names: str) -> None:
    driver.context.loader.open(shlex.split(names))
    wait_until_idle(driver)


def _set(driver: InputDriver, text: str) -> None:
    for key, value in _parse_assignment(text).items():
        driver.app.session.change(f"Set {key}", {key: value})


def _look(driver: InputDriver, text: str) -> None:
    driver.app.session.edit_view("Look", **_parse_assignment(text))


def _parse_assignment(text: str) -> dict[str, Any]:
    """Parses KEY = VALUE with a TOML value, else a plain string; dots are part of the key."""
    key, equals, value = text.partition("=")
    if not equals:
        raise UserError(text, "isn't KEY = VALUE")
    return {key.strip(): parse_toml_value(value, key.strip())}


def _split_numbers(text: str, count: int, default: tuple[float, ...]) -> tuple[str, list[float]]:
    """Splits the name of an item from `count` numbers after it; with fewer numbers, all words are the name."""
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise UserError(text, "a quotation mark that isn't closed") from error
    last = words[-count:]
    if len(words) <= count or not all(map(_is_number, last)):
        return " ".join(words), list(default)
    return " ".join(words[:-count]), [float(word) for word in last]


def _is_number(word: str) -> bool:
    return word.lstrip("-").replace(".", "", 1).isdigit()


def _show(driver: InputDriver, title: str) -> None:
    titles = [guarded.panel.title for guarded in driver.app.panels]
    if title not in titles:
        raise UserError(f"show {title}", "there is no such panel", remedy=suggest_matches(title, titles))
    driver.context.show_panel(title)


def _click(driver: InputDriver, text: str) -> None:
    name, (x, y) = _split_numbers(text, 2, (0.5, 0.5))
    driver.click(driver.item_position(name, x, y))


def _drag(driver: InputDriver, text: str) -> None:
    name, numbers = _split_numbers(text, 4, ())
    if len(numbers) != 4:
        raise UserError(f"drag {text}", "isn't ITEM X0 Y0 X1 Y1")
    x0, y0, x1, y1 = numbers
    driver.drag(driver.item_position(name, x0, y0), driver.item_position(name, x1, y1), steps=6)


def _wheel(driver: InputDriver, text: str) -> None:
    name, numbers = _split_numbers(text, 3, ())
    if len(numbers) != 3:
        raise UserError(f"wheel {text}", "isn't ITEM X Y NOTCHES")
    driver.wheel(driver.item_position(name, *numbers[:2]), float(np.clip(numbers[2], -100, 100)))


# --- Sends synthetic pointer and key events to a viewer that draws off screen, for scripts and tests ---


_SETTLING_FRAMES = 3
_MOST_ROUNDS = 20
Point = tuple[float, float]


class InputDriver:
    """Moves the pointer, presses keys, and draws frames. Positions (x, y) are in logical pixels of the window."""

    def __init__(self, app: App) -> None:
        self.app, self.context, self.canvas = app, app.context, app.window.canvas
        self._position: Point = (0.0, 0.0)
        self._buttons: tuple[int, ...] = ()

    def draw_frames(self, count: int = 1) -> NDArray[np.uint8]:
        """Draws frames and returns the last one in 8-bit sRGB (y, x, 3). Raises an exception that ended a frame."""
        self.process_frames(count - 1)
        return np.asarray(self._complete_frame(self.canvas.draw))[..., :3].copy()

    def process_frames(self, count: int = 1) -> None:
        """Has the panels respond to input in frames that nobody sees, which take a fraction of the time."""
        for _ in range(count):
            self._complete_frame(partial(self.app.window.draw, is_seen=False))

    def _complete_frame(self, draw: Callable[[], Any]) -> Any:
        """Draws a frame, and more of them where frames are slow, until all input has been processed."""
        window = self.app.window
        self.canvas._process_events()  # drawing alone leaves submitted events waiting
        while True:
            image = draw()
            if window.error is not None:
                raise window.error
            if window.closed or not window.has_pending_input:
                return image

    def draw_until_idle(self, timeout_s: float = 120.0) -> NDArray[np.uint8]:
        """Draws until everything that is shown is computed; returns the last frame as `draw_frames` does.

        Endless motions, such as that of a pupil along its path, aren't waited for.
        """
        self.process_frames(2)
        for _ in range(_MOST_ROUNDS):  # what a frame shows for the first time, such as a score, is computed after it
            self.app.compute_until_idle(timeout_s)
            image = self.draw_frames(2)
            if not self.app.is_busy:
                break
        return image

    def item_position(self, name: str, x: float = 0.5, y: float = 0.5) -> Point:
        """A position in a recorded item, (x, y) as fractions of its size. Raises UserError for an unknown name."""
        if name not in self.context.item_rects:
            raise UserError(
                "script", f'no item is called "{name}"', remedy=suggest_matches(name, self.context.item_rects)
            )
        left, top, right, bottom = self.context.item_rects[name]
        return left + x * (right - left), top + y * (bottom - top)

    # --- the pointer ------------------------------------------------------------------------------------------------

    def move(self, to: Point) -> None:
        """Moves the pointer."""
        self._position = to
        self._pointer("pointer_move")
        self.process_frames()

    def press_button(self, button: int = 1) -> None:
        """Presses a button: 1 left, 2 right, 3 middle."""
        self._buttons = (button,)
        self._pointer("pointer_down", button)
        self.process_frames()

    def release_button(self, button: int = 1) -> None:
        """Releases a button."""
        self._buttons = ()
        self._pointer("pointer_up", button)
        self.process_frames(_SETTLING_FRAMES)

    def click(self, position: Point, button: int = 1) -> None:
        """Moves to a position and clicks."""
        self.move(position)
        self.move(position)
        self.press_button(button)
        self.release_button(button)

    def drag(self, start: Point, end: Point, steps: int = 4) -> None:
        """Presses the left button at `start`, moves to `end` in some steps, and releases it."""
        self.move(start)
        self.move(start)
        self.press_button()
        for step in range(1, steps + 1):
            share = step / steps
            self.move((start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])))
        self.release_button()

    def wheel(self, position: Point, notches: float, *modifiers: str) -> None:
        """Turns the wheel by some notches, positive away from the user, while modifiers are held."""
        self.move(position)
        self._modifiers(modifiers, "key_down")
        x, y = position
        self.submit_event("wheel", x=x, y=y, dx=0.0, dy=-WHEEL_NOTCH * notches, buttons=(), modifiers=modifiers)
        self.process_frames(2)
        self._modifiers(modifiers, "key_up")
        self.process_frames()

    # --- keys -------------------------------------------------------------------------------------------------------

    def press_chord(self, chord: str) -> None:
        """Presses and releases a chord such as "Ctrl+Shift+Z"."""
        modifiers, name = Chord(chord).parts
        modifiers = ("Shift", *modifiers) if name == "?" else modifiers
        self.hold_keys(modifiers)
        self.submit_event("key_down", key=name, modifiers=modifiers)
        self.process_frames()
        self.submit_event("key_up", key=name, modifiers=modifiers)
        self.release_keys(modifiers)

    def hold_keys(self, names: tuple[str, ...]) -> None:
        """Presses keys, given by their names in events, and keeps them down."""
        self._modifiers(names, "key_down")
        self.process_frames()

    def release_keys(self, names: tuple[str, ...]) -> None:
        """Releases keys."""
        self._modifiers(names, "key_up")
        self.process_frames(_SETTLING_FRAMES)

    def type_text(self, text: str) -> None:
        """Types text into the widget that has the focus."""
        for letter in text:
            self.submit_event("char", data=letter, is_composing=False, input_type="insertText")
            self.process_frames()

    def _modifiers(self, names: tuple[str, ...], kind: str) -> None:
        for name in names:
            self.submit_event(kind, key=name, modifiers=())

    def _pointer(self, kind: str, button: int = 0) -> None:
        x, y = self._position
        self.submit_event(kind, x=x, y=y, button=button, buttons=self._buttons, modifiers=(), ntouches=0, touches={})

    def submit_event(self, kind: str, **details: Any) -> None:
        """Sends an event to the canvas; it takes effect when the next frame is drawn."""
        self.canvas.submit_event({"event_type": kind, **details})


# --- Measures how many images a second the viewer shows while a focal plane is scrubbed, in a window off screen ---
#
# An image counts when it is computed, drawn with all panels, and read back to the host, as a canvas off screen does. A
# window on a screen isn't read back, but waits for the screen.


_FRAME_S = 1 / 60
_NEAR, _FAR = 0.99, 1.01
_FRAME_TIMEOUT_S = 60.0


def measure_frame_rate(
    system: System, device: Device, size: tuple[int, int], rounds: int, limit_s: float
) -> dict[str, Any]:
    """Times of an image in the viewer as JSON values, ms: of its window alone, of a scrub, and until its full frame.

    size: of the window (x, y) in pixels. rounds: images of each kind, fewer if they take more than `limit_s`.
    """
    from rendercanvas.offscreen import OffscreenRenderCanvas

    plane_m = middle_plane(system)
    session = EditingSession(system, view_settings=ViewSettings(plane_m=plane_m))
    app = App(session, device, OffscreenRenderCanvas(size=size), frame_s=_FRAME_S)
    try:
        driver = InputDriver(app)
        driver.draw_until_idle(max(limit_s, _FRAME_TIMEOUT_S))
        planes_m = cycle([_NEAR * plane_m, plane_m, _FAR * plane_m])
        window_s = _repeat(driver.draw_frames, rounds, limit_s)
        scrub_s = _repeat(lambda: _scrub(driver, next(planes_m)), rounds, limit_s)
        driver.draw_until_idle(max(limit_s, _FRAME_TIMEOUT_S))
        full_s = _repeat(lambda: _full(driver, next(planes_m)), rounds, limit_s)
    finally:
        app.close()
    rows, columns = system.way.shape
    return {
        "window": list(size),
        "size": [columns, rows],
        "wavelengths": len(system.wavelengths_m),
        "window_ms": 1e3 * statistics.median(window_s),
        "scrub_ms": 1e3 * statistics.median(scrub_s),
        "full_ms": 1e3 * statistics.median(full_s),
        "scrub_images_per_s": len(scrub_s) / sum(scrub_s),
        "rounds": len(scrub_s),
    }


def _scrub(driver: InputDriver, plane_m: float) -> None:
    """Change the focal plane, and draw its first image, which may be a quick one."""
    version = driver.context.side_renderers.now.picture
    driver.app.session.edit_view("Plane", plane_m=plane_m)
    while driver.context.side_renderers.now.picture is version:
        driver.app.compute_slice()
    driver.draw_frames()


def _full(driver: InputDriver, plane_m: float) -> None:
    """Change the focal plane, and draw its full frame, which may follow a quick one and a pause."""
    driver.app.session.edit_view("Plane", plane_m=plane_m)
    driver.app.compute_slice()
    while driver.context.side_renderers.is_busy:
        driver.app.compute_slice()
    driver.draw_frames()


def _repeat(job: Callable[[], object], rounds: int, limit_s: float) -> list[float]:
    """Seconds of each run of a job, after one that isn't timed; at least one."""
    job()
    seconds: list[float] = []
    while len(seconds) < rounds and (not seconds or sum(seconds) < limit_s):
        start = time.perf_counter()
        job()
        seconds.append(time.perf_counter() - start)
    return seconds
