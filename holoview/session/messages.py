"""What the user is told: short lines that a front end shows for a while, kept so that none is lost."""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from holoview.util.errors import UserError

MAX_MESSAGES = 200


@dataclass(frozen=True)
class Message:
    """A line, its kind ("info", "warning", "error"), details worth copying, and when, as `time.time` gives it."""

    text: str
    kind: str = "info"
    details: str = ""
    when: float = 0.0


class MessageLog:
    """The last messages, oldest first."""

    def __init__(self, changed: Callable[[], None] = lambda: None, clock: Callable[[], float] = time.time) -> None:
        self._kept: deque[Message] = deque(maxlen=MAX_MESSAGES)
        self._changed, self._clock = changed, clock

    @property
    def all(self) -> tuple[Message, ...]:
        """Every message that is kept."""
        return tuple(self._kept)

    def recent(self, seconds: float) -> tuple[Message, ...]:
        """Messages of the last seconds."""
        since = self._clock() - seconds
        return tuple(message for message in self._kept if message.when >= since)

    def post(self, text: str, kind: str = "info", details: str = "") -> None:
        """Adds a message."""
        self._kept.append(Message(text, kind, details, self._clock()))
        self._changed()

    def post_error(self, error: BaseException, where: str = "") -> None:
        """A user's mistake in its own words; anything else as a defect, with its traceback as details."""
        lead = f"{where}: " if where else ""
        if isinstance(error, UserError):
            self.post(f"{lead}{error}", "error")
            return
        details = "".join(traceback.format_exception(error))
        self.post(f"{lead}{type(error).__name__}: {error}", "error", details)
