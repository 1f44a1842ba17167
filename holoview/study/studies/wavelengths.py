"""Wavelengths as unknowns, against evenly spread ones."""

from __future__ import annotations

from typing import Any

from holoview.study.claims import gain_claim
from holoview.study.holograms import HologramStudy, Results, scheme_jobs, table_of
from holoview.study.plots import bars
from holoview.study.scale import Scale
from holoview.study.study import Findings, Job, Plot
from holoview.study.work import means

_SCHEMES = ("holochrome-4", "holochrome-8")
_FIXED: dict[str, Any] = {}
_FREE: dict[str, Any] = {"free": ["patterns", "amplitudes", "wavelengths"]}


class _Wavelengths(HologramStudy):
    name = "wavelengths"
    title = "Optimised against evenly spread wavelengths"
    shows = (
        "What tunable lasers would gain: wavelengths sought along their gradient in the first half of the iterations, "
        "at equal iterations in all. The paper finds at most 1 to 2 dB."
    )
    reduced = "Quick: 128 x 96 samples, 3 planes; 20 of 40 iterations are left for the patterns alone."

    def jobs(self, scale: Scale, seed: int) -> list[Job]:
        fixed, free = (scheme_jobs(self, _SCHEMES, scale, seed, options=options) for options in (_FIXED, _FREE))
        return fixed + free

    def findings(self, results: Results) -> Findings:
        cases = [{"scheme": scheme, "options": options} for scheme in _SCHEMES for options in (_FIXED, _FREE)]
        labels = [f"{scheme}{', free' if options else ''}" for scheme in _SCHEMES for options in (_FIXED, _FREE)]
        claims = [
            gain_claim(
                results,
                f"free wavelengths against fixed ones, {scheme}",
                1.0,
                {"scheme": scheme, "options": _FREE},
                {"scheme": scheme, "options": _FIXED},
                reason="the search costs half of the iterations",
            )
            for scheme in _SCHEMES
        ]
        found = [
            f"{job.label}: {', '.join(f'{nm:.1f}' for nm in outcome.numbers['wavelengths_nm'])} nm"
            for job, outcome in results
            if job.settings["options"] == _FREE
        ]
        plot = Plot("psnr", "PSNR of linear sRGB", bars(labels, means(results, ("psnr_db", "between_db"), cases), "dB"))
        return Findings(rows=table_of(results, "options"), claims=claims, plots=[plot], notes=found)


STUDY = _Wavelengths()
