"""Optimised wavelengths in comparison with evenly spaced ones."""

from __future__ import annotations

from typing import Any

from holoview.study.claims import CONTRADICTS, LARGER, REPRODUCES
from holoview.study.hologram_jobs import paired_gains
from holoview.study.hologram_study import HologramStudy, psnr_plot, result_table, scheme_jobs
from holoview.study.scale import StudyScale
from holoview.study.study import Claim, Findings, Results, StudyJob

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


STUDY = _Wavelengths()
