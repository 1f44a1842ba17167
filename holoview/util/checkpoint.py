"""Comparison of a checkpoint with the run that is to continue from it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from holoview.util.errors import UserError


def differing_fields(stored: Any, given: Any) -> list[str]:
    """The names of the fields in which two instances of one dataclass differ."""
    stored_values, given_values = dataclasses.asdict(stored), dataclasses.asdict(given)
    return [name for name, value in stored_values.items() if value != given_values[name]]


def refuse_differences(differing: Sequence[str], where: str, run: str, inputs: str) -> None:
    """Raises UserError that names what differs, located at `where`, unless nothing does.

    run: the kind of run in words ("optimisation"). inputs: what must be the same as when it was begun.
    """
    if differing:
        raise UserError(
            where,
            f"is of another {run}: {', '.join(differing)} differ",
            expected=f"the same {inputs} as when it was begun",
        )
