"""Which captures the records are checked on: those with the smoothest pictures.

What is recorded may be wrong, so the pictures decide, not the patterns. Smooth pictures come from smooth patterns,
whose speckle an error of the bench decorrelates last. But smooth patterns hardly show which modulator they are on, and
an error of the bench can look like a wrong record in them; so the choice is confirmed on pictures of all kinds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from holoview.captures.dataset import Captures
from holoview.captures.records.settings import RecordSettings


@dataclass(frozen=True)
class ChosenCaptures:
    """Indices of captures. screened: a part of tested. confirmed: the others, from smooth to rough, or some of them."""

    screened: list[int]
    tested: list[int]
    confirmed: list[int]


def choose_captures(captures: Captures, coarseness: Callable[[int], float], settings: RecordSettings) -> ChosenCaptures:
    """The smoothest pictures, at least one of each recorded wavelength and distance among those tested."""
    order = sorted(range(len(captures)), key=coarseness)
    tested: list[int] = []
    for values in (captures.wavelength_m, captures.distance_m):
        covered = {float(values[k]) for k in tested}
        for k in order:
            if float(values[k]) not in covered:
                covered.add(float(values[k]))
                tested.append(k)
    most = min(settings.tested, len(captures) - len(captures) // 3)
    tested += [k for k in order if k not in tested][: max(0, most - len(tested))]
    tested.sort(key=order.index)
    other_settings = [k for k in tested if _setting(captures, k) != _setting(captures, tested[0])]
    screened = [tested[0], *(other_settings or tested[1:])[: settings.screened - 1]]
    rest = [k for k in order if k not in tested]
    evenly = np.unique(np.linspace(0, len(rest) - 1, min(settings.confirmed, len(rest))).round().astype(int))
    confirmed = [rest[n] for n in evenly.tolist()]
    return ChosenCaptures(screened, tested, confirmed)


def _setting(captures: Captures, k: int) -> tuple[float, float]:
    return float(captures.wavelength_m[k]), float(captures.distance_m[k])
