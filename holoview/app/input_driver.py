"""Sends synthetic pointer and key events to a viewer that draws off screen, for scripts and tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.app.app import App
from holoview.app.input_steps import WHEEL_NOTCH
from holoview.app.keys import Chord
from holoview.util.errors import UserError, suggest_matches

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
        image: Any = None
        for _ in range(count):
            self.canvas._process_events()  # drawing alone leaves submitted events waiting
            image = self.canvas.draw()
            if self.app.window.error is not None:
                raise self.app.window.error
        return np.asarray(image)[..., :3].copy()

    def draw_until_idle(self, timeout_s: float = 120.0) -> NDArray[np.uint8]:
        """Draws until everything that is shown is computed; returns the last frame as `draw_frames` does.

        What never rests, such as a pupil that moves along its path, isn't waited for.
        """
        self.draw_frames(2)
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
        self.draw_frames()

    def press_button(self, button: int = 1) -> None:
        """Presses a button: 1 left, 2 right, 3 middle."""
        self._buttons = (button,)
        self._pointer("pointer_down", button)
        self.draw_frames()

    def release_button(self, button: int = 1) -> None:
        """Releases a button."""
        self._buttons = ()
        self._pointer("pointer_up", button)
        self.draw_frames(_SETTLING_FRAMES)

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
        self.draw_frames(2)
        self._modifiers(modifiers, "key_up")
        self.draw_frames()

    # --- keys -------------------------------------------------------------------------------------------------------

    def press_chord(self, chord: str) -> None:
        """Presses and releases a chord such as "Ctrl+Shift+Z"."""
        modifiers, name = Chord(chord).parts
        modifiers = ("Shift", *modifiers) if name == "?" else modifiers
        self.hold_keys(modifiers)
        self.submit_event("key_down", key=name, modifiers=modifiers)
        self.draw_frames()
        self.submit_event("key_up", key=name, modifiers=modifiers)
        self.release_keys(modifiers)

    def hold_keys(self, names: tuple[str, ...]) -> None:
        """Presses keys, given by their names in events, and keeps them down."""
        self._modifiers(names, "key_down")
        self.draw_frames()

    def release_keys(self, names: tuple[str, ...]) -> None:
        """Releases keys."""
        self._modifiers(names, "key_up")
        self.draw_frames(_SETTLING_FRAMES)

    def type_text(self, text: str) -> None:
        """Types text into the widget that has the focus."""
        for letter in text:
            self.submit_event("char", data=letter, is_composing=False, input_type="insertText")
            self.draw_frames()

    def _modifiers(self, names: tuple[str, ...], kind: str) -> None:
        for name in names:
            self.submit_event(kind, key=name, modifiers=())

    def _pointer(self, kind: str, button: int = 0) -> None:
        x, y = self._position
        self.submit_event(kind, x=x, y=y, button=button, buttons=self._buttons, modifiers=(), ntouches=0, touches={})

    def submit_event(self, kind: str, **details: Any) -> None:
        """Sends an event to the canvas; it takes effect when the next frame is drawn."""
        self.canvas.submit_event({"event_type": kind, **details})
