"""A claim of the paper beside what was found: how large a gain is, and what that says of the claim."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from holoview.study.hologram_jobs import mean_number, paired_gains
from holoview.study.study import Claim, JobResult, StudyJob

REPRODUCES, LARGER, DIRECTION_ONLY, CONTRADICTS = "reproduces", "larger here", "direction only", "doesn't reproduce"
SHOWN = "shown"
"""Where the paper has no number."""
_MIN_REPRODUCED_SHARE, _MAX_REPRODUCED_SHARE = 0.75, 1.5
"""Shares of the claimed gain between which it counts as reproduced: targets and brightness differ from the paper's."""
_MAX_NO_GAIN_SHARE = 0.1
"""Share of the claimed gain up to which there is none."""

_EQUAL_WITHIN_DB = 0.5

Results = Sequence[tuple[StudyJob, JobResult]]


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
    found = paired_gains(results, first, second, key)
    gain = float(found.mean())
    boxes = " / ".join(f"{mean_number(results, 'eyebox_variation', **settings):.2f}" for settings in (first, second))
    spread = f" (spread {found.max() - found.min():.2f})" if len(found) > 1 else ""
    here = f"{gain:+.2f} dB{spread}, eyebox variation {boxes}"
    if paper_db is None:
        return Claim(what, "", here, SHOWN)
    too_small = gain < _MIN_REPRODUCED_SHARE * paper_db
    return Claim(what, f"{paper_db:+.1f} dB", here, judge_gain(gain, paper_db), reason if too_small else "")


def equal_claim(results: Results, what: str, paper: str, one: str, other: str, reason: str = "") -> Claim:
    """That two schemes show pictures of equal PSNR, within `_EQUAL_DB`."""
    gain = float(paired_gains(results, {"scheme": one}, {"scheme": other}, "psnr_db").mean())
    boxes = " / ".join(f"{mean_number(results, 'eyebox_variation', scheme=scheme):.2f}" for scheme in (one, other))
    holds = abs(gain) <= _EQUAL_WITHIN_DB
    here = f"{gain:+.2f} dB, eyebox variation {boxes}"
    return Claim(what, paper, here, REPRODUCES if holds else CONTRADICTS, "" if holds else reason)


def judge_gain(found: float, claimed: float) -> str:
    """Whether a gain is as large as claimed, larger, smaller, or none."""
    if found >= _MIN_REPRODUCED_SHARE * claimed:
        return LARGER if found > _MAX_REPRODUCED_SHARE * claimed else REPRODUCES
    return DIRECTION_ONLY if found > _MAX_NO_GAIN_SHARE * claimed else CONTRADICTS
