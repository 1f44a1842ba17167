"""Optimised wavelengths beside evenly spaced ones, and the number and spacing of the latter."""

from __future__ import annotations

from typing import Any

import numpy as np

from holoview.study.hologram_study import (
    CONTRADICTS,
    DIRECTION_ONLY,
    LARGER,
    REPRODUCES,
    HologramStudy,
    mean_number,
    paired_gains,
    psnr_plot,
    result_table,
    row_of_lasers,
    scheme_jobs,
    targets_and_seeds,
)
from holoview.study.plots import heat_map
from holoview.study.study import Claim, Findings, Results, StudyFigure, StudyJob, StudyScale

_SCHEMES = ("holochrome-4", "holochrome-8")
_FIXED: dict[str, Any] = {}
_PAPER_LIMIT_DB = 2.0
_FREE: dict[str, Any] = {"free": ["patterns", "amplitudes", "wavelengths"]}


class _Wavelengths(HologramStudy):
    name = "wavelengths"
    title = "Optimised against evenly spread wavelengths"
    summary = (
        "What tunable lasers would gain: wavelengths sought along their gradient in the first half of the iterations, "
        "at equal iterations in all. The paper finds at most 1 to 2 dB."
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
        "The paper's heat map: PSNR of a monochrome camera's picture against the number of wavelengths and their "
        "spacing about 550 nm. Closer lasers share more of their speckle; farther ones ask more of one pattern."
    )

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return [
            self.make_job(
                f"{count} wavelengths {spacing} nm apart, {case['target']}, seed {case['seed']}",
                {
                    **case,
                    "scheme": "simultaneous",
                    "set": row_of_lasers(count, spacing),
                    "count": count,
                    "spacing_nm": spacing,
                },
            )
            for count in _COUNTS
            for spacing in _SPACINGS_NM
            for case in targets_and_seeds(scale, seed)
        ]

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


STUDIES = (_Wavelengths(), _Bandwidth())
