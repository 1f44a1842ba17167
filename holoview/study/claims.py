"""A claim of the paper beside what was found: how large a gain is, and what that says of the claim."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from holoview.study.study import Claim, Job, Outcome
from holoview.study.work import gains, mean_of

REPRODUCES, LARGER, DIRECTION, FAILS = "reproduces", "larger here", "direction only", "doesn't reproduce"
SHOWN = "shown"
"""Where the paper has no number."""
_ENOUGH, _MORE = 0.75, 1.5
"""Shares of the claimed gain between which it counts as reproduced: targets and brightness differ from the paper's."""
_NONE = 0.1
"""Share of the claimed gain up to which there is none."""

_EQUAL_DB = 0.5

Results = Sequence[tuple[Job, Outcome]]


def gain_claim(
    results: Results,
    what: str,
    paper_db: float | None,
    better: str | Mapping[str, Any],
    worse: str | Mapping[str, Any],
    key: str = "psnr_db",
    reason: str = "",
) -> Claim:
    """The gain of one setting (a scheme's name, or settings) over another, mean over targets and seeds.

    paper_db: the paper's; None where it has none. reason: why ours is smaller, where it is.
    """
    first, second = ({"scheme": s} if isinstance(s, str) else dict(s) for s in (better, worse))
    found = gains(results, first, second, key)
    gain = float(found.mean())
    boxes = " / ".join(f"{mean_of(results, 'eyebox_variation', **settings):.2f}" for settings in (first, second))
    spread = f" (spread {found.max() - found.min():.2f})" if len(found) > 1 else ""
    here = f"{gain:+.2f} dB{spread}, eyebox variation {boxes}"
    if paper_db is None:
        return Claim(what, "", here, SHOWN)
    too_small = gain < _ENOUGH * paper_db
    return Claim(what, f"{paper_db:+.1f} dB", here, verdict_of(gain, paper_db), reason if too_small else "")


def equal_claim(results: Results, what: str, paper: str, one: str, other: str, reason: str = "") -> Claim:
    """That two schemes show pictures of equal PSNR, within `_EQUAL_DB`."""
    gain = float(gains(results, {"scheme": one}, {"scheme": other}, "psnr_db").mean())
    boxes = " / ".join(f"{mean_of(results, 'eyebox_variation', scheme=scheme):.2f}" for scheme in (one, other))
    holds = abs(gain) <= _EQUAL_DB
    here = f"{gain:+.2f} dB, eyebox variation {boxes}"
    return Claim(what, paper, here, REPRODUCES if holds else FAILS, "" if holds else reason)


def verdict_of(found: float, claimed: float) -> str:
    """Whether a gain is as large as claimed, larger, smaller, or none."""
    if found >= _ENOUGH * claimed:
        return LARGER if found > _MORE * claimed else REPRODUCES
    return DIRECTION if found > _NONE * claimed else FAILS
