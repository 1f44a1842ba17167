"""Faults of a virtual bench at random moments: what the devices of a laboratory do on a bad day.

[faults]                # shares of the pictures, or of the messages
seed = 7
timeout = 0.02          # no picture comes
short = 0.01            # a picture without the lower half of its rows
torn = 0.01             # the lower part is that of the picture before
repeated = 0.01         # the picture before, again: a trigger was dropped
disconnect = 0.001      # of all messages: the connection is cut
power_off = 0.001       # of all messages: everything goes dark at once
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from holoview.model.fields import Integer, Number
from holoview.rig.devices import Counts
from holoview.rig.virtual.wire import Disconnected, Message
from holoview.util.errors import UserError, suggest_matches

PICTURE_FAULTS, MESSAGE_FAULTS = ("timeout", "short", "torn", "repeated"), ("disconnect", "power_off")
_KEYS = ("seed", *PICTURE_FAULTS, *MESSAGE_FAULTS)
_TIMEOUT_S = 1.0


@dataclass(frozen=True)
class FaultSettings:
    """shares: how often each fault happens, of pictures or of messages; those that are missing never do."""

    seed: int = 0
    shares: Mapping[str, float] = field(default_factory=dict)


class FaultTable:
    """Field type of the table [faults]."""

    def parse(self, value: Any, where: str) -> FaultSettings:
        if not isinstance(value, Mapping):
            raise UserError(where, f"{value!r}", expected="a table such as [faults] timeout = 0.01")
        for key in value:
            if key not in _KEYS:
                raise UserError(f"{where}.{key}", "unknown key", remedy=suggest_matches(key, _KEYS))
        share = Number(low=0.0, high=1.0)
        shares = {name: share.parse(value[name], f"{where}.{name}") or 0.0 for name in _KEYS[1:] if name in value}
        return FaultSettings(Integer(low=0, high=2**31).parse(value.get("seed", 0), f"{where}.seed"), shares)

    def to_toml(self, value: FaultSettings) -> dict[str, Any]:
        return {"seed": value.seed, **value.shares}


class FaultInjector:
    """Answers messages as devices with faults would. power_off: ends the process at once."""

    def __init__(self, settings: FaultSettings, power_off: Callable[[], None]) -> None:
        self._settings, self._power_off = settings, power_off
        self._chance = random.Random(settings.seed)
        self._before: Counts | None = None

    def answer(self, message: Message, answer: Callable[[Message], Message]) -> Message:
        """The answer of `answer`, unless a fault happens. Raises Disconnected for one of the connection."""
        is_late = self._chance.random() < 0.5  # a fault comes before what was asked is done, or after it
        found = answer(message) if is_late else None
        if self._happens("power_off"):
            self._power_off()
        if self._happens("disconnect"):
            raise Disconnected("a fault")
        found = found or answer(message)
        if message.table.get("do") != "take" or found.array is None:
            return found
        fault = next((name for name in PICTURE_FAULTS if self._happens(name)), None)
        if fault == "timeout":
            answer(Message({"do": "wait", "seconds": _TIMEOUT_S}))
            return Message({"error": f"no picture within {_TIMEOUT_S:g} s"})
        self._before = self._spoilt(found.array, fault)
        return Message(found.table, self._before)

    def _happens(self, fault: str) -> bool:
        share = self._settings.shares.get(fault, 0.0)
        return share > 0 and self._chance.random() < share

    def _spoilt(self, picture: Counts, fault: str | None) -> Counts:
        rows = len(picture)
        if fault == "short":
            return picture[: rows // 2]
        if self._before is None or self._before.shape != picture.shape:
            return picture
        if fault == "torn":
            tear = self._chance.randint(rows // 4, rows - max(rows // 8, 1))
            return np.concatenate([picture[:tear], self._before[tear:]])
        return self._before if fault == "repeated" else picture
