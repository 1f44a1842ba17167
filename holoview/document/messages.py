"""A log of messages to the user, which a front end shows for a while."""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from holoview.util.errors import UserError
from holoview.util.text import printable

MAX_MESSAGES = 200


@dataclass(frozen=True)
class Message:
    """A line of text, its kind ("info", "warning", "error"), details such as a traceback, and when it was posted."""

    text: str
    kind: str = "info"
    details: str = ""
    when: float = 0.0


class MessageLog:
    """The last MAX_MESSAGES messages. on_change: called after each new message."""

    def __init__(self, on_change: Callable[[], None] = lambda: None, clock: Callable[[], float] = time.time) -> None:
        self._messages: deque[Message] = deque(maxlen=MAX_MESSAGES)
        self._on_change, self._clock = on_change, clock

    @property
    def all(self) -> tuple[Message, ...]:
        """All messages that are stored, oldest first."""
        return tuple(self._messages)

    def recent(self, seconds: float) -> tuple[Message, ...]:
        """Messages of the last seconds, oldest first."""
        since = self._clock() - seconds
        return tuple(message for message in self._messages if message.when >= since)

    def post(self, text: str, kind: str = "info", details: str = "") -> None:
        """Adds a message; its text may quote a file."""
        self._messages.append(Message(printable(text), kind, details, self._clock()))
        self._on_change()

    def post_error(self, error: BaseException, where: str = "") -> None:
        """Adds an error: a UserError by its text, any other exception with its traceback as details."""
        prefix = f"{where}: " if where else ""
        if isinstance(error, UserError):
            self.post(f"{prefix}{error}", "error")
            return
        details = "".join(traceback.format_exception(error))
        self.post(f"{prefix}{type(error).__name__}: {error}", "error", details)
