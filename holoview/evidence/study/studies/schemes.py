"""Comparisons of colour schemes: in turn or together, by the number of wavelengths, and beside source directions.

Also optimised wavelengths beside evenly spaced ones, the number and spacing of the latter, and the fidelity of more or
less saturated colours with 3 and with 16 lasers.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from holoview.evidence.study.charts import heat_map, line_plot
from holoview.evidence.study.hologram_study import (
    CONTRADICTS,
    DIRECTION_ONLY,
    LARGER,
    QUICK_SIZE,
    REPRODUCES,
    SHOWN,
    HologramStudy,
    SchemeStudy,
    case_jobs,
    equal_claim,
    gain_claim,
    job_system,
    judge_gain,
    mean_number,
    paired_gains,
    psnr_plot,
    result_pictures,
    result_table,
    row_of_lasers,
    scheme_jobs,
)
from holoview.evidence.study.study import Claim, Findings, Results, StudyFigure, StudyJob, StudyScale
from holoview.holograms.metrics.gamut import SRGB_AREA, chromaticity, gamut_area
from holoview.light.colour import observer_weights
from holoview.light.model.scheme import with_scheme

_CLAIMS = (
    ("HoloChrome 8 λ, 1 frame, against simultaneous", 3.6, "holochrome-8", "simultaneous"),
    ("HoloChrome 8 λ, 3 frames, against multiplexed", 3.5, "holochrome-8x3", "multiplexed"),
    ("HoloChrome 8 λ, 3 frames, against simultaneous", 6.7, "holochrome-8x3", "simultaneous"),
    ("HoloChrome 8 λ, 3 frames, against time-sequential", 6.0, "holochrome-8x3", "time-sequential"),
)


class _Schemes(SchemeStudy):
    name = "schemes"
    title = "Colour schemes of a dual-modulator display"
    summary = (
        "The paper's main comparison: a focal stack in simultaneous, time-sequential and multiplexed colour, and by "
        "HoloChrome in one and three frames."
    )
    quick_note = f"{QUICK_SIZE}; gains scatter by about 0.3 dB."
    schemes = ("simultaneous", "time-sequential", "multiplexed", "holochrome-8", "holochrome-8x3")
    labels = schemes

    def claims(self, results: Results) -> list[Claim]:
        return [gain_claim(results, *claim) for claim in _CLAIMS]


# --- the number of wavelengths in one frame ---


class _WavelengthCount(SchemeStudy):
    name = "wavelength-count"
    title = "The number of wavelengths in one frame"
    summary = (
        "The paper's ablation over the number of wavelengths: more lasers average more speckle, and each adds a "
        "degree of freedom in colour."
    )
    schemes = ("simultaneous", "holochrome-8", "holochrome-16")
    labels = ("3 wavelengths", "8 wavelengths", "16 wavelengths")

    def claims(self, results: Results) -> list[Claim]:
        return [
            gain_claim(results, "8 wavelengths against 3", 3.6, "holochrome-8", "simultaneous"),
            gain_claim(results, "16 wavelengths against 3", 4.3, "holochrome-16", "simultaneous"),
        ]


# --- source directions, wavelengths, and both together ---


_SOURCES, _COLOURS = "time-sequential+multisource-3x3", "holochrome-9x3"
_BOTH = "holochrome-9x3+multisource-3x3"
_REASON = "here HoloChrome is ahead: it has nine lasers to mix colours from, the sources have three"


class _Multisource(SchemeStudy):
    name = "multisource"
    title = "Source directions against wavelengths"
    summary = (
        "Nine mutually incoherent source directions in three colours, nine wavelengths from one direction, and both "
        "together, three frames each."
    )
    schemes = (_SOURCES, _COLOURS, _BOTH)
    labels = ("3 x 3 sources", "9 wavelengths", "both")
    notes = (
        "How alike the speckle of two directions or two wavelengths is, is the memory effect: `holoview study "
        "memory-effect` has it by angle and by wavelength, for several gaps. Sources 8.6 mrad apart count as "
        "independent where its curves have fallen to nothing, and wavelengths likewise.",
    )

    def claims(self, results: Results) -> list[Claim]:
        return [
            equal_claim(results, "9 wavelengths and 3 x 3 sources are equal", "equal", _COLOURS, _SOURCES, _REASON),
            gain_claim(results, "both against 9 wavelengths", None, _BOTH, _COLOURS),
            gain_claim(results, "both against 3 x 3 sources", None, _BOTH, _SOURCES),
        ]


# --- wavelengths ------------------------------------------------------------------------------------------------------


_SCHEMES = ("holochrome-4", "holochrome-8")
_FIXED: dict[str, Any] = {}
_PAPER_LIMIT_DB = 2.0
_FREE: dict[str, Any] = {"free": ["patterns", "amplitudes", "wavelengths"]}


class _WavelengthChoice(HologramStudy):
    name = "wavelengths"
    title = "Optimised against evenly spread wavelengths"
    summary = (
        "The gain of tunable lasers: wavelengths sought along their gradient in the first half of the iterations. "
        "The paper finds at most 1 to 2 dB."
    )
    quick_note = "Quick: 128 x 96 samples, 3 planes; 20 of 40 iterations are left for the patterns alone."

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        fixed = scheme_jobs(self, _SCHEMES, scale, seed, options=_FIXED)
        return fixed + scheme_jobs(self, _SCHEMES, scale, seed, "free wavelengths", options=_FREE)

    def analyse(self, results: Results) -> Findings:
        cases = [{"scheme": scheme, "options": options} for scheme in _SCHEMES for options in (_FIXED, _FREE)]
        labels = [f"{scheme}{', free' if options else ''}" for scheme in _SCHEMES for options in (_FIXED, _FREE)]
        claims = [_claim(results, scheme) for scheme in _SCHEMES]
        notes = [
            f"{job.label}: {', '.join(f'{nm:.1f}' for nm in outcome.numbers['wavelengths_nm'])} nm"
            for job, outcome in results
            if job.settings["options"] == _FREE
        ]
        plot = psnr_plot(results, labels, cases)
        return Findings(rows=result_table(results, "options"), claims=claims, plots=[plot], notes=notes)


def _claim(results: Results, scheme: str) -> Claim:
    """The paper states an upper limit: any positive gain below it reproduces the claim."""
    free, fixed = ({"scheme": scheme, "options": options} for options in (_FREE, _FIXED))
    gain = float(paired_gains(results, free, fixed, "psnr_db").mean())
    verdict = CONTRADICTS if gain <= 0 else REPRODUCES if gain <= _PAPER_LIMIT_DB else LARGER
    reason = "the search takes half of the iterations from the patterns" if gain <= 0 else ""
    return Claim(
        f"free wavelengths against fixed ones, {scheme}", "1 to 2 dB at most", f"{gain:+.2f} dB", verdict, reason
    )


# --- number and spacing, for a monochrome camera ---


_COUNTS = (2, 4, 8, 16)
_SPACINGS_NM = (2, 4, 8, 16)


class _Bandwidth(HologramStudy):
    name = "bandwidth"
    title = "Number and spacing of wavelengths"
    summary = (
        "The paper's heat map: PSNR of a monochrome camera's picture against number and spacing of wavelengths about "
        "550 nm. Closer lasers share more of their speckle; farther lasers ask more of one pattern."
    )

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        cases = {
            f"{count} wavelengths {spacing} nm apart": {"count": count, "spacing_nm": spacing}
            | {"scheme": "simultaneous", "set": row_of_lasers(count, spacing)}
            for count, spacing in product(_COUNTS, _SPACINGS_NM)
        }
        return case_jobs(self, cases, scale, seed)

    def analyse(self, results: Results) -> Findings:
        table = np.array(
            [[mean_number(results, "luminance_psnr_db", count=n, spacing_nm=s) for s in _SPACINGS_NM] for n in _COUNTS]
        )
        best = _SPACINGS_NM[int(np.argmax(table[-1]))]
        verdict = REPRODUCES if best == 16 else DIRECTION_ONLY if best == 8 else CONTRADICTS
        values = ", ".join(f"{s} nm {psnr_db:.1f}" for s, psnr_db in zip(_SPACINGS_NM, table[-1], strict=True))
        draw = heat_map(
            table, ("wavelengths", [str(n) for n in _COUNTS]), ("spacing (nm)", [str(s) for s in _SPACINGS_NM]), "dB"
        )
        return Findings(
            rows=result_table(results, "count", "spacing_nm"),
            claims=[Claim("best spacing of 16 wavelengths", "16 nm", f"{best} nm ({values} dB)", verdict)],
            plots=[StudyFigure("bandwidth", "PSNR of a monochrome camera's picture", draw)],
        )


# --- saturated colours ------------------------------------------------------------------------------------------------


_SATURATIONS = (0.0, 0.5, 1.0, 2.0)
_FEW, _MANY = "simultaneous", "holochrome-16"
_PAPER_DB = {0.0: 4.1, 1.0: 2.1}


class _Gamut(HologramStudy):
    name = "gamut"
    title = "Saturation of the picture, 3 lasers against 16"
    summary = (
        "The paper's gamut study: the target's chroma scaled in CIE LCHuv, shown by 3 and by 16 lasers in one frame. "
        "The less colour is asked for, the more freedom 16 lasers have left for speckle."
    )

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return [
            job
            for saturation in _SATURATIONS
            for job in scheme_jobs(
                self, (_FEW, _MANY), scale, seed, f"saturation {saturation:g}", saturation=saturation
            )
        ]

    def analyse(self, results: Results) -> Findings:
        claims = [
            gain_claim(
                results,
                f"luminance PSNR, 16 lasers against 3, saturation {saturation:g}",
                paper_db,
                *_many_and_few(saturation),
                key="luminance_psnr_db",
            )
            for saturation, paper_db in _PAPER_DB.items()
        ]
        claims.append(_falling_gain_claim(results))
        for saturation in _SATURATIONS:
            change = float(paired_gains(results, *_many_and_few(saturation), "delta_e").mean())
            verdict = REPRODUCES if change < 0 else CONTRADICTS
            measured = f"{change:+.1f} (mean CIEDE2000)"
            claims.append(Claim(f"colour difference, saturation {saturation:g}", "lower", measured, verdict))
        base = job_system(results[0][0].settings)
        areas = [
            gamut_area(chromaticity(observer_weights("cie1931", with_scheme(base, scheme).wavelengths_m))) / SRGB_AREA
            for scheme in (_FEW, _MANY)
        ]
        claims.append(
            Claim("gamut's area in xy, 3 and 16 lasers, of sRGB's", "", f"{areas[0]:.2f}, {areas[1]:.2f}", SHOWN)
        )
        return Findings(
            rows=result_table(results, "saturation"),
            claims=claims,
            plots=[
                StudyFigure(
                    name,
                    caption,
                    line_plot({s: (_SATURATIONS, _curve(results, key, s)) for s in (_FEW, _MANY)}, "saturation", axis),
                )
                for name, caption, key, axis in (
                    ("luminance", "PSNR of the luminance", "luminance_psnr_db", "PSNR (dB)"),
                    ("colour", "Mean CIEDE2000", "delta_e", "CIEDE2000"),
                )
            ],
            pictures=result_pictures([(j, o) for j, o in results if j.settings["saturation"] == 1.0]),
        )


def _curve(results: Results, key: str, scheme: str) -> list[float]:
    return [mean_number(results, key, scheme=scheme, saturation=saturation) for saturation in _SATURATIONS]


def _falling_gain_claim(results: Results) -> Claim:
    """The claim that the gain of 16 lasers over 3 is smaller for the saturated picture than for the grey one."""
    gains = {s: float(paired_gains(results, *_many_and_few(s), "luminance_psnr_db").mean()) for s in _SATURATIONS}
    (grey, full), (paper_grey, paper_full), most = (gains[s] for s in _PAPER_DB), _PAPER_DB.values(), max(_SATURATIONS)
    verdict = judge_gain(grey - full, paper_grey - paper_full)
    falls_beyond = verdict in (DIRECTION_ONLY, CONTRADICTS) and gains[most] < min(grey, full)
    reason = f"it falls mostly beyond the colours of this scene: {gains[most]:+.2f} dB at saturation {most:g}"
    return Claim(
        "that gain falls with saturation",
        f"{paper_grey:+.1f} → {paper_full:+.1f} dB",
        f"{grey:+.2f} → {full:+.2f} dB",
        verdict,
        reason if falls_beyond else "",
    )


def _many_and_few(saturation: float) -> tuple[dict[str, Any], dict[str, Any]]:
    return {"scheme": _MANY, "saturation": saturation}, {"scheme": _FEW, "saturation": saturation}


STUDIES = (_Schemes(), _WavelengthCount(), _Multisource(), _WavelengthChoice(), _Bandwidth(), _Gamut())
