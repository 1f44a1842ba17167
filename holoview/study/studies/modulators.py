"""One modulator or two, without and with a penalty on an unevenly lit eyebox."""

from __future__ import annotations

from typing import Any

from holoview.study.claims import gain_claim
from holoview.study.hologram_jobs import mean_by_case
from holoview.study.hologram_study import QUICK_SIZE, HologramStudy, psnr_plot, result_table, scheme_jobs
from holoview.study.plots import bar_panels
from holoview.study.scale import StudyScale
from holoview.study.study import Findings, Results, StudyFigure, StudyJob

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


STUDY = _Modulators()
