"""One modulator or two, without and with a penalty on an unevenly lit eyebox, and what the gain depends on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from holoview.study.hologram_study import (
    CONTRADICTS,
    QUICK_SIZE,
    SHOWN,
    HologramStudy,
    gain_claim,
    judge_gain,
    mean_by_case,
    mean_number,
    paired_gains,
    psnr_plot,
    result_table,
    scheme_jobs,
    targets_and_seeds,
)
from holoview.study.plots import bar_chart, bar_panels
from holoview.study.study import QUICK, Claim, Findings, Results, StudyFigure, StudyJob, StudyScale

_SCHEMES = ("holochrome-8", "holochrome-8+1slm", "simultaneous", "simultaneous+1slm")
_NAMES = ("8 λ", "8 λ, one modulator", "3 λ", "3 λ, one modulator")
_FREE_EYEBOX: dict[str, Any] = {"eyebox": 0.0}
_EVEN_EYEBOX: dict[str, Any] = {"eyebox": 0.03}
_REASON = "PSNR rewards the single modulator's smooth phase, whose light crosses the eyebox as a small spot"


class _Modulators(HologramStudy):
    name = "modulators"
    title = "One phase modulator or two"
    summary = (
        "The paper's gain of a second modulator, optimised freely and at matched eyebox uniformity: without the latter "
        "a PSNR compares a display that can be looked into with one that can't."
    )
    quick_note = f"{QUICK_SIZE}; the eyebox penalty has less time to act."

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        free = scheme_jobs(self, _SCHEMES, scale, seed, **_FREE_EYEBOX)
        return free + scheme_jobs(self, _SCHEMES, scale, seed, "even eyebox", **_EVEN_EYEBOX)

    def analyse(self, results: Results) -> Findings:
        cases = [{"scheme": scheme, **eyebox} for scheme in _SCHEMES for eyebox in (_FREE_EYEBOX, _EVEN_EYEBOX)]
        labels = [f"{name}, {eyebox}" for name in _NAMES for eyebox in ("free", "even")]
        pairs = [
            ("two modulators against one, 8 wavelengths, eyebox left free", 5.3, _SCHEMES[:2], _FREE_EYEBOX),
            ("the same, eyebox evened out (weight 0.03)", 5.3, _SCHEMES[:2], _EVEN_EYEBOX),
            ("two against one, simultaneous colour, eyebox left free", None, _SCHEMES[2:], _FREE_EYEBOX),
            ("the same, eyebox evened out (weight 0.03)", None, _SCHEMES[2:], _EVEN_EYEBOX),
        ]
        return Findings(
            rows=result_table(results, "eyebox"),
            claims=[
                gain_claim(
                    results,
                    what,
                    paper_db,
                    {"scheme": schemes[0], **eyebox},
                    {"scheme": schemes[1], **eyebox},
                    reason=_REASON,
                )
                for what, paper_db, schemes, eyebox in pairs
            ],
            plots=[
                psnr_plot(results, labels, cases),
                StudyFigure(
                    "eyebox",
                    "Variation of the eyebox's filling (0 is even); light in its centre over the mean (1 is even)",
                    bar_panels(labels, mean_by_case(results, ("eyebox_variation", "eyebox_centre_share"), cases)),
                ),
            ],
        )


# --- one setting changed at a time, at a matched eyebox ---


_TWO, _ONE = "holochrome-8", "holochrome-8+1slm"
_PAPER_DB = 5.3
_WEIGHT = 0.03
_EVEN = 0.1  # variation of the eyebox up to which it counts as even

Change = Mapping[str, Any]


def _stops(square: str | float) -> Change:
    return {"stop": square}


_CASES: dict[str, tuple[Change, ...]] = {
    "as it is": ({},),
    "stop": tuple(map(_stops, ("0.5 first order", "0.7 first order", "1.4 first order", "none"))),
    "planes": tuple({"planes": count} for count in (1, 2, 9)),
    "stack": tuple({"range_mm": ends} for ends in ([9.9, 10.1], [9.5, 10.5], [8.0, 12.0], [6.0, 14.0])),
    "gap": tuple({"gap_mm": gap} for gap in (0.5, 1.0, 4.0, 8.0)),
    "first step": tuple({"options": {"step_rad": step}} for step in (0.9, 0.25, 0.1, 0.03)),
    "margin": tuple({"margin": share} for share in (0.1, 0.25)),
    "target": ({"depth": False}, {"planes": 1, "depth": False}),
    "eyebox weight": tuple({"eyebox": weight} for weight in (0.0, 0.01, 0.1, 0.3)),
    "start": ({"options": {"begin": "smooth"}},),
    "iterations": tuple({"times": factor} for factor in (0.3, 3.0)),
}
"""Keys of a job's settings with their values, `stop` for both relays, `gap_mm`, and `times` iterations."""


class _SecondModulator(HologramStudy):
    name = "second-modulator"
    title = "What the gain of a second modulator depends on"
    summary = (
        "The paper's second modulator gains 5.3 dB. Here one setting at a time is changed (stop, planes, stack, gap, "
        "steps from a random start, margin, target, weight of the eyebox) and the gain found again, with the eyebox of "
        "both displays beside it: gains count as matched where both eyeboxes vary by at most 0.1."
    )
    quick_note = f"{QUICK_SIZE}, and one value of each setting."

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return [
            self.make_job(
                f"{scheme}, {label}, {case['target']}, seed {case['seed']}",
                {"eyebox": _WEIGHT, **case, "scheme": scheme, **_settings(change, scheme, case["iterations"])},
            )
            for label, change in _labelled(is_short=scale.shape[0] <= QUICK.shape[0]).items()
            for scheme in (_TWO, _ONE)
            for case in targets_and_seeds(scale, seed)
        ]

    def analyse(self, results: Results) -> Findings:
        labels = dict.fromkeys(job.label.split(", ")[1] for job, _ in results)
        rows = [_row(results, label) for label in labels]
        even = [row for row in rows if max(row["eyebox, two"], row["eyebox, one"]) <= _EVEN]
        claims = [_claim("two modulators against one, as they are", rows[:1])]
        if even:
            best = max(even, key=lambda row: float(row["gain (dB)"]))
            claims.append(_claim(f"the largest gain at an even eyebox: {best['setting']}", [best]))
        free = max(rows, key=lambda row: float(row["gain (dB)"]))
        claims.append(_claim(f"the largest gain at any eyebox: {free['setting']}", [free]))
        gains = {"two modulators minus one": [float(row["gain (dB)"]) for row in rows]}
        eyeboxes = {name: [float(row[f"eyebox, {name}"]) for row in rows] for name in ("two", "one")}
        return Findings(
            rows=rows,
            claims=claims,
            plots=[
                StudyFigure("gain", "Gain in PSNR of linear sRGB", bar_chart(list(labels), gains, "gain (dB)")),
                StudyFigure("eyebox", "Variation of the eyebox (0 is even)", bar_panels(list(labels), eyeboxes)),
            ],
        )


def _labelled(is_short: bool) -> dict[str, Change]:
    """Every change under a label such as "gap 4"; the first of each setting only where the list is to be short."""
    count = 1 if is_short else None
    return {_label(name, change): change for name, changes in _CASES.items() for change in changes[:count]}


def _label(name: str, change: Change) -> str:
    words = []
    for key, value in change.items():
        if isinstance(value, Mapping):
            words += [f"{entry}" for entry in value.values()]
        elif key == "depth":
            words.append("flat")
        elif key == "range_mm":
            words.append(f"{value[0]:g}–{value[1]:g} mm")
        else:
            words.append(f"{value:g}" if isinstance(value, float) else f"{value}")
    return " ".join([name, *words])


def _settings(change: Change, scheme: str, iterations: int) -> dict[str, Any]:
    """The settings of a job for a change: what concerns the gap or relay 1 is left out with one modulator."""
    out, edits = {k: v for k, v in change.items() if k not in ("stop", "gap_mm", "times")}, {}
    if "stop" in change:
        relays = ("relay2",) if scheme == _ONE else ("relay1", "relay2")
        edits = {f"{relay}.square": change["stop"] for relay in relays}
    if "gap_mm" in change and scheme == _TWO:
        edits["gap"] = change["gap_mm"] * 1e-3
    if "times" in change:
        out["iterations"] = max(1, round(change["times"] * iterations))
    return out | ({"set": edits} if edits else {})


def _row(results: Results, label: str) -> dict[str, Any]:
    """Gain and eyebox of a setting, over targets and seeds."""
    two, one = (
        [(job, result) for job, result in results if job.label.startswith(f"{scheme}, {label}, ")]
        for scheme in (_TWO, _ONE)
    )
    gains = paired_gains([*two, *one], {"scheme": _TWO}, {"scheme": _ONE}, "psnr_db")
    has_between = two[0][1].numbers["between_db"] is not None
    return {
        "setting": label,
        "gain (dB)": float(np.mean(gains)),
        "spread (dB)": float(np.ptp(gains)),
        "two (dB)": mean_number(two, "psnr_db"),
        "one (dB)": mean_number(one, "psnr_db"),
        "gain between (dB)": mean_number(two, "between_db") - mean_number(one, "between_db") if has_between else None,
        "eyebox, two": mean_number(two, "eyebox_variation"),
        "eyebox, one": mean_number(one, "eyebox_variation"),
    }


def _claim(what: str, rows: list[dict[str, Any]]) -> Claim:
    row = rows[0]
    gain = float(row["gain (dB)"])
    measured = (
        f"{gain:+.2f} dB (spread {row['spread (dB)']:.2f}), "
        f"eyebox variation {row['eyebox, two']:.2f} / {row['eyebox, one']:.2f}"
    )
    is_even = max(row["eyebox, two"], row["eyebox, one"]) <= _EVEN
    if not is_even:
        return Claim(what, "", measured, SHOWN, "the eyeboxes differ, so that this is no gain at a matched eyebox")
    verdict = judge_gain(gain, _PAPER_DB)
    reason = "one modulator is as good at this eyebox" if verdict == CONTRADICTS else ""
    return Claim(what, f"{_PAPER_DB:+.1f} dB", measured, verdict, reason)


STUDIES = (_Modulators(), _SecondModulator())
