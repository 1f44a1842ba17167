"""Tells, before time is spent, where the model isn't true of a bench."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from holoview.commands.console import print_stderr
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.model.validity.checks import check_plan, exceeded_limits


def warn_of_limits(system: System, planes_m: Sequence[float] | NDArray[np.float64] | None = None) -> tuple[str, ...]:
    """Prints a note for each limit of the model that a bench exceeds at some planes, its own when None; returns them.

    Raises UserError where nothing of the patterns is left to see, and as `make_plan` does.
    """
    notes = exceeded_limits(check_plan(make_plan(system, planes_m)))
    for note in notes:
        print_stderr(f"note: {note}")
    return notes
