"""Fidelity of pictures of more or less saturated colours with 3 and with 16 lasers."""

from __future__ import annotations

from typing import Any

import numpy as np

from holoview.colour import observer_weights
from holoview.metrics.gamut import SRGB_AREA, chromaticity, gamut_area
from holoview.model.scheme import with_scheme
from holoview.study.hologram_study import (
    CONTRADICTS,
    DIRECTION_ONLY,
    REPRODUCES,
    SHOWN,
    HologramStudy,
    gain_claim,
    job_system,
    judge_gain,
    mean_number,
    paired_gains,
    result_pictures,
    result_table,
    scheme_jobs,
)
from holoview.study.plots import line_plot
from holoview.study.study import Claim, Findings, Results, StudyFigure, StudyJob, StudyScale

_SATURATIONS = (0.0, 0.5, 1.0, 2.0)
_FEW, _MANY = "simultaneous", "holochrome-16"
_PAPER_DB = {0.0: 4.1, 1.0: 2.1}


class _Gamut(HologramStudy):
    name = "gamut"
    title = "Saturation of the picture, 3 lasers against 16"
    summary = (
        "The paper's gamut study: the target's chroma scaled in CIE LCHuv, shown by 3 and by 16 lasers in one frame; "
        "luminance PSNR and CIEDE2000. The less colour is asked for, the more freedom 16 lasers have left for speckle."
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
        areas = [_gamut_area_xy(with_scheme(base, scheme).wavelengths_m) / SRGB_AREA for scheme in (_FEW, _MANY)]
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


def _gamut_area_xy(wavelengths_m: np.ndarray) -> float:
    return gamut_area(chromaticity(observer_weights("cie1931", wavelengths_m)))


STUDIES = (_Gamut(),)
