"""A claim of the paper beside what was found: how large a gain is, and what that says of the claim."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from holoview.study.study import Claim, Job, Outcome
from holoview.study.work import gains, mean_of

REPRODUCES, DIRECTION, FAILS, SHOWN = "reproduces", "direction only", "doesn't reproduce", "shown"
_ENOUGH = 0.75
"""Share of the claimed gain from which on it counts as reproduced: targets and brightness differ from the paper's."""

_EQUAL_DB = 0.5

Results = Sequence[tuple[Job, Outcome]]


def gain_claim(
    results: Results,
    what: str,
    paper_db: float,
    better: str | Mapping[str, Any],
    worse: str | Mapping[str, Any],
    key: str = "psnr_db",
    reason: str = "",
) -> Claim:
    """The gain of one setting (a scheme's name, or settings) over another, mean over targets and seeds."""
    first, second = ({"scheme": s} if isinstance(s, str) else dict(s) for s in (better, worse))
    found = gains(results, first, second, key)
    gain = float(found.mean())
    boxes = " / ".join(f"{mean_of(results, 'eyebox_variation', **settings):.2f}" for settings in (first, second))
    spread = f" (spread {found.max() - found.min():.2f})" if len(found) > 1 else ""
    here = f"{gain:+.2f} dB{spread}, eyebox variation {boxes}"
    return Claim(
        what, f"{paper_db:+.1f} dB", here, verdict_of(gain, paper_db), reason if gain < _ENOUGH * paper_db else ""
    )


def equal_claim(results: Results, what: str, paper: str, one: str, other: str, reason: str = "") -> Claim:
    """That two schemes show pictures of equal PSNR, within `_EQUAL_DB`."""
    gain = float(gains(results, {"scheme": one}, {"scheme": other}, "psnr_db").mean())
    boxes = " / ".join(f"{mean_of(results, 'eyebox_variation', scheme=scheme):.2f}" for scheme in (one, other))
    holds = abs(gain) <= _EQUAL_DB
    here = f"{gain:+.2f} dB, eyebox variation {boxes}"
    return Claim(what, paper, here, REPRODUCES if holds else FAILS, "" if holds else reason)


def verdict_of(found: float, claimed: float) -> str:
    """Whether a gain is as large as claimed, smaller, or none."""
    if found >= _ENOUGH * claimed:
        return REPRODUCES
    return DIRECTION if found > 0.1 * claimed else FAILS
