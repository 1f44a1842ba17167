"""PSNR of modulators with few levels, and of binary ones in many frames."""

from __future__ import annotations

from typing import Any

from holoview.model import preset
from holoview.study.hologram_study import METRIC_LABELS, SHOWN, HologramStudy, mean_by_case, result_table, scheme_jobs
from holoview.study.plots import bar_chart
from holoview.study.study import Claim, Findings, Results, StudyFigure, StudyJob, StudyScale

_SCHEME, _BINARY = "holochrome-8", "multiplexed-12"
_MEASURED = "16 levels of a real modulator"
_HALF_WAVE = "275 nm"  # a binary modulator's stroke: half a wave at 550 nm


class _Quantisation(HologramStudy):
    name = "quantisation"
    title = "Levels of the modulators"
    summary = (
        "PSNR of what is really shown against the number of levels: equal ones, the unequal ones measured on a phase "
        "light modulator, and binary modulators that show twelve frames of three lasers instead."
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


STUDIES = (_Quantisation(),)
