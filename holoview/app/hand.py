"""A hand without a screen: synthetic events into an app that draws off screen, for scripts and tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.app.app import App
from holoview.app.keys import Chord
from holoview.errors import UserError, near_matches

_SETTLING = 3
_NOTCH = 100.0
Place = tuple[float, float]


class Hand:
    """Moves the pointer, presses keys, and draws frames. Places are in logical pixels."""

    def __init__(self, app: App) -> None:
        self.app, self.canvas = app, app.window.canvas
        self._at: Place = (0.0, 0.0)
        self._buttons: tuple[int, ...] = ()

    def frames(self, count: int = 1) -> NDArray[np.uint8]:
        """Draws frames; the last as 8-bit sRGB (y, x, 3). What failed while drawing is raised."""
        image: Any = None
        for _ in range(count):
            self.canvas._process_events()  # drawing alone leaves submitted events waiting
            image = self.canvas.draw()
            if self.app.window.failed is not None:
                raise self.app.window.failed
        return np.asarray(image)[..., :3].copy()

    def settle(self, timeout_s: float = 120.0) -> NDArray[np.uint8]:
        """Draws until all that is shown is computed."""
        self.frames(2)
        for _ in range(4):
            self.app.settle(timeout_s)
            image = self.frames(2)
            if not self.app.is_busy:
                return image
        return image

    def where(self, name: str, x: float = 0.5, y: float = 0.5) -> Place:
        """A place in the rectangle of a marked item, in shares of it. Raises UserError for an unknown name."""
        if name not in self.app.rects:
            raise UserError("script", f'no item is called "{name}"', remedy=near_matches(name, self.app.rects))
        left, top, right, bottom = self.app.rects[name]
        return left + x * (right - left), top + y * (bottom - top)

    # --- the pointer ------------------------------------------------------------------------------------------------

    def move(self, to: Place) -> None:
        """Moves the pointer."""
        self._at = to
        self._pointer("pointer_move")
        self.frames()

    def press(self, button: int = 1) -> None:
        """Presses a button: 1 left, 2 right, 3 middle."""
        self._buttons = (button,)
        self._pointer("pointer_down", button)
        self.frames()

    def release(self, button: int = 1) -> None:
        """Lets a button go."""
        self._buttons = ()
        self._pointer("pointer_up", button)
        self.frames(_SETTLING)

    def click(self, at: Place, button: int = 1) -> None:
        """Moves there and clicks."""
        self.move(at)
        self.move(at)
        self.press(button)
        self.release(button)

    def drag(self, start: Place, end: Place, steps: int = 4) -> None:
        """Presses at one place, moves to another and lets go."""
        self.move(start)
        self.move(start)
        self.press()
        for step in range(1, steps + 1):
            share = step / steps
            self.move((start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])))
        self.release()

    def wheel(self, at: Place, notches: float, *modifiers: str) -> None:
        """Turns the wheel away from the hand by so many notches."""
        self.move(at)
        self._modifiers(modifiers, "key_down")
        x, y = at
        self._submit("wheel", x=x, y=y, dx=0.0, dy=-_NOTCH * notches, buttons=(), modifiers=modifiers)
        self.frames(2)
        self._modifiers(modifiers, "key_up")
        self.frames()

    # --- keys -------------------------------------------------------------------------------------------------------

    def key(self, chord: str) -> None:
        """Presses and releases keys that are written like "Ctrl+Shift+Z"."""
        modifiers, name = Chord(chord).parts
        modifiers = ("Shift", *modifiers) if name == "?" else modifiers
        self.hold(modifiers)
        self._submit("key_down", key=name, modifiers=modifiers)
        self.frames()
        self._submit("key_up", key=name, modifiers=modifiers)
        self.let_go(modifiers)

    def hold(self, names: tuple[str, ...]) -> None:
        """Holds keys down, by the names that events have."""
        self._modifiers(names, "key_down")
        self.frames()

    def let_go(self, names: tuple[str, ...]) -> None:
        """Releases keys."""
        self._modifiers(names, "key_up")
        self.frames(_SETTLING)

    def type(self, text: str) -> None:
        """Types text into what has the focus."""
        for letter in text:
            self._submit("char", data=letter, is_composing=False, input_type="insertText")
            self.frames()

    def _modifiers(self, names: tuple[str, ...], kind: str) -> None:
        for name in names:
            self._submit(kind, key=name, modifiers=())

    def _pointer(self, kind: str, button: int = 0) -> None:
        x, y = self._at
        self._submit(kind, x=x, y=y, button=button, buttons=self._buttons, modifiers=(), ntouches=0, touches={})

    def _submit(self, kind: str, **details: Any) -> None:
        self.canvas.submit_event({"event_type": kind, **details})
