"""Compares a measured gain with the paper's and words the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from holoview.study.hologram_jobs import mean_number, paired_gains
from holoview.study.study import Claim, Results

REPRODUCES, LARGER, DIRECTION_ONLY, CONTRADICTS = "reproduces", "larger here", "direction only", "doesn't reproduce"
SHOWN = "shown"
"""The verdict on a measurement for which the paper has no number."""
_MIN_REPRODUCED_SHARE, _MAX_REPRODUCED_SHARE = 0.75, 1.5
"""Fractions of the claimed gain between which it is reproduced; targets and brightness differ from the paper's."""
_MAX_NO_GAIN_SHARE = 0.1
"""Fraction of the claimed gain up to which there is no gain."""
_EQUAL_WITHIN_DB = 0.5


def gain_claim(
    results: Results,
    what: str,
    paper_db: float | None,
    better: str | Mapping[str, Any],
    worse: str | Mapping[str, Any],
    key: str = "psnr_db",
    reason: str = "",
    unit: str = "dB",
) -> Claim:
    """The claim that one setting has a higher PSNR, or another score, than another, by the mean over targets and seeds.

    what: the statement. paper_db: the paper's gain; None if it has none. better, worse: settings of the jobs, or the
    names of schemes. key: the number that is compared. reason: why our gain is smaller, shown only if it is. unit: of
    the number.
    """
    first, second = ({"scheme": s} if isinstance(s, str) else dict(s) for s in (better, worse))
    gains = paired_gains(results, first, second, key)
    gain = float(gains.mean())
    spread = f" (spread {gains.max() - gains.min():.2f})" if len(gains) > 1 else ""
    measured = f"{gain:+.2f} {unit}{spread}, {_format_eyeboxes(results, first, second)}"
    if paper_db is None:
        return Claim(what, "", measured, SHOWN)
    too_small = gain < _MIN_REPRODUCED_SHARE * paper_db
    return Claim(what, f"{paper_db:+.1f} dB", measured, judge_gain(gain, paper_db), reason if too_small else "")


def equal_claim(results: Results, what: str, paper: str, one: str, other: str, reason: str = "") -> Claim:
    """The claim that two schemes have equal PSNR, within 0.5 dB. reason: why they haven't, shown only then."""
    first, second = {"scheme": one}, {"scheme": other}
    gain = float(paired_gains(results, first, second, "psnr_db").mean())
    holds = abs(gain) <= _EQUAL_WITHIN_DB
    measured = f"{gain:+.2f} dB, {_format_eyeboxes(results, first, second)}"
    return Claim(what, paper, measured, REPRODUCES if holds else CONTRADICTS, "" if holds else reason)


def judge_gain(found: float, claimed: float) -> str:
    """The verdict on a gain: as large as claimed, larger, smaller, or none."""
    if found >= _MIN_REPRODUCED_SHARE * claimed:
        return LARGER if found > _MAX_REPRODUCED_SHARE * claimed else REPRODUCES
    return DIRECTION_ONLY if found > _MAX_NO_GAIN_SHARE * claimed else CONTRADICTS


def _format_eyeboxes(results: Results, *settings: Mapping[str, Any]) -> str:
    """The variation of light in the eyebox of each setting, without which PSNR can't be compared."""
    return "eyebox variation " + " / ".join(f"{mean_number(results, 'eyebox_variation', **s):.2f}" for s in settings)
