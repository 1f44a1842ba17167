"""One modulator or two, without and with a penalty on an unevenly lit eyebox, and what the gain depends on.

Also modulators with few levels, binary modulators in many frames, and colour multiplexing in its smallest case: two
frames of two lasers, one laser a frame or both in both.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from holoview.evidence.study.charts import bar_chart, bar_panels, line_plot
from holoview.evidence.study.hologram_study import (
    CONTRADICTS,
    METRIC_LABELS,
    QUICK_SIZE,
    REPRODUCES,
    SHOWN,
    HologramStudy,
    case_jobs,
    gain_claim,
    hologram_metrics,
    job_system,
    job_target,
    judge_gain,
    mean_by_case,
    mean_number,
    optimise_job,
    paired_gains,
    psnr_plot,
    result_table,
    scheme_jobs,
    table_row,
)
from holoview.evidence.study.study import (
    QUICK,
    Claim,
    Findings,
    JobResult,
    Results,
    StatusCallback,
    Study,
    StudyFigure,
    StudyJob,
    StudyScale,
)
from holoview.holograms.metrics.fidelity import psnr_xyz
from holoview.holograms.metrics.gamut import chromaticity
from holoview.holograms.view import simulate
from holoview.light.colour import SRGB_TO_XYZ, XYZ_TO_SRGB, observer_weights
from holoview.light.model import preset

_SCHEMES = ("holochrome-8", "holochrome-8+1slm", "simultaneous", "simultaneous+1slm")
_NAMES = ("8 λ", "8 λ, one modulator", "3 λ", "3 λ, one modulator")
_FREE_EYEBOX: dict[str, Any] = {"eyebox": 0.0}
_EVEN_EYEBOX: dict[str, Any] = {"eyebox": 0.03}
_REASON = "PSNR rewards the single modulator's smooth phase, whose light crosses the eyebox as a small spot"


class _Modulators(HologramStudy):
    name = "modulators"
    title = "One phase modulator or two"
    summary = (
        "The paper's gain of a second modulator, optimised freely and at matched uniformity of the eyebox, without "
        "which a PSNR compares a display that can be looked into with a display that can't."
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
                    results, what, paper_db, {"scheme": two, **eyebox}, {"scheme": one, **eyebox}, reason=_REASON
                )
                for what, paper_db, (two, one), eyebox in pairs
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
        "The paper's second modulator gains 5.3 dB. Here one setting at a time is changed and the gain found again; "
        "gains count as matched where the eyeboxes of both displays vary by at most 0.1."
    )
    quick_note = f"{QUICK_SIZE}, and one value of each setting."

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        shared = {"eyebox": scale.eyebox or _WEIGHT}
        cases = {
            f"{scheme}, {label}": {**shared, "scheme": scheme, **_settings(change, scheme, scale.iterations)}
            for label, change in _labelled(is_short=scale.shape[0] <= QUICK.shape[0]).items()
            for scheme in (_TWO, _ONE)
        }
        return case_jobs(self, cases, scale, seed)

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
    """The settings of a job for a change: changes of the gap or of relay 1 are left out with one modulator."""
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


# --- levels -----------------------------------------------------------------------------------------------------------


_SCHEME, _BINARY = "holochrome-8", "multiplexed-12"
_MEASURED = "16 levels of a real modulator"
_HALF_WAVE = "275 nm"  # a binary modulator's stroke: half a wave at 550 nm


class _Quantisation(HologramStudy):
    name = "quantisation"
    title = "Levels of the modulators"
    summary = (
        "PSNR of the shown picture against the number of levels: equal levels, the levels measured on a phase light "
        "modulator, and binary modulators with twelve frames of three lasers."
    )

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        jobs: list[StudyJob] = []
        for name, change in _cases().items():
            jobs += scheme_jobs(self, [_SCHEME], scale, seed, name, set=change)
        return jobs + scheme_jobs(self, [_BINARY], scale, seed, "binary", set={"levels": 2, "stroke": _HALF_WAVE})

    def analyse(self, results: Results) -> Findings:
        names = [*_cases(), "binary, 12 frames of 3 lasers"]
        cases = [{"scheme": _SCHEME, "set": change} for change in _cases().values()] + [{"scheme": _BINARY}]
        means = mean_by_case(results, ("psnr_db", "between_db"), cases)
        psnr = dict(zip(names, means[METRIC_LABELS["psnr_db"]], strict=True))
        lost = ", ".join(f"{name} {psnr[name] - psnr['continuous']:+.2f}" for name in names if name != "continuous")
        return Findings(
            rows=result_table(results, "set"),
            claims=[Claim("PSNR against continuous modulators (dB)", "", lost, SHOWN)],
            plots=[
                StudyFigure(
                    "levels",
                    "PSNR of linear sRGB of what the modulators can show",
                    bar_chart(names, means, "PSNR (dB)"),
                )
            ],
        )


def _cases() -> dict[str, dict[str, Any]]:
    """Changes of the bench, by name."""
    measured = preset.load("bench-plm").modulators[0].levels
    assert measured is not None
    equal = {f"{count} levels": {"levels": count} for count in (2, 4, 8, 16)}
    return {**equal, _MEASURED: {"levels": measured.tolist()}, "continuous": {}}


# --- frames -----------------------------------------------------------------------------------------------------------


_LASERS_M = (532e-9, 638e-9)
_MIXES = (0.0, 0.17, 0.33, 0.5, 0.67, 0.83, 1.0)
_DRIVES = {"sequential": [[1.0, 0.0], [0.0, 1.0]], "multiplexed": [[1.0, 1.0], [1.0, 1.0]]}


class _Multiplexing(Study):
    name = "multiplexing"
    title = "Two frames of two lasers, in turn or together"
    summary = (
        "The smallest case of colour multiplexing: a picture tinted along the line between two lasers in xyY, shown "
        "in two frames by one laser each or by both in both; PSNR of XYZ, unclipped."
    )
    quick_note = f"{QUICK_SIZE}."
    revision = 4

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        shared = {"scheme": "simultaneous", "options": {"loss": "xyz"}}
        cases = {
            f"{drive}, {mix:.0%} of the longer wavelength": {**shared, "drive": drive, "mix": mix}
            | {"set": {"wavelengths": list(_LASERS_M), "amplitudes": amplitudes}}
            for mix in _MIXES
            for drive, amplitudes in _DRIVES.items()
        }
        return case_jobs(self, cases, scale, seed)

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        system = job_system(settings)
        target = tinted(job_target(system, settings, system.planes_m), settings["mix"])
        state = optimise_job(system, target, settings, status)
        view = simulate(state.best.system, state.best.drive, backend="torch")
        xyz_quality = {"psnr_xyz_db": psnr_xyz(view.xyz, target @ SRGB_TO_XYZ.T).mean_db}
        return JobResult(hologram_metrics(state.best, view, target) | xyz_quality)

    def analyse(self, results: Results) -> Findings:
        curves = {
            drive: [mean_number(results, "psnr_xyz_db", drive=drive, mix=mix) for mix in _MIXES] for drive in _DRIVES
        }
        gains = np.array(curves["multiplexed"]) - np.array(curves["sequential"])
        measured = f"{gains.min():+.1f} to {gains.max():+.1f} dB"
        return Findings(
            rows=[table_row(job, outcome, ("drive", "mix", "target", "seed")) for job, outcome in results],
            claims=[
                Claim(
                    "multiplexed against sequential, at every mix",
                    "better",
                    measured,
                    REPRODUCES if gains.min() > 0 else CONTRADICTS,
                )
            ],
            plots=[
                StudyFigure(
                    "mixes",
                    "PSNR of XYZ along the line between the lasers in xyY",
                    line_plot(
                        {d: (_MIXES, c) for d, c in curves.items()}, "way from 532 nm to 638 nm in xy", "PSNR (dB)"
                    ),
                )
            ],
        )


def tinted(stack: np.ndarray, mix: float) -> np.ndarray:
    """The luminance of a stack (…, 3) in linear sRGB with a single chromaticity, between those of the lasers in xy.

    mix: 0 for the chromaticity of the shorter wavelength, 1 for that of the longer one.
    """
    first, second = chromaticity(observer_weights("eye", np.array(_LASERS_M)))
    x, y = (1 - mix) * first + mix * second
    colour = np.array([x / y, 1.0, (1 - x - y) / y])
    luminance = stack @ SRGB_TO_XYZ[1]
    return np.asarray(luminance[..., None] * colour @ XYZ_TO_SRGB.T, dtype=np.float32)


STUDIES = (_Modulators(), _SecondModulator(), _Quantisation(), _Multiplexing())
