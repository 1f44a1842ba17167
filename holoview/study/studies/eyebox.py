"""Uniformity of the light in the eyebox against the number of wavelengths and frames."""

from __future__ import annotations

from holoview.study.hologram_study import SHOWN, HologramStudy, mean_number, result_table, scheme_jobs
from holoview.study.plots import line_plot
from holoview.study.study import Claim, Findings, Results, StudyFigure, StudyJob, StudyScale

_COUNTS, _FRAMES = (2, 4, 8, 16), (1, 3)


class _Eyebox(HologramStudy):
    name = "eyebox"
    title = "The eyebox against the number of wavelengths and frames"
    summary = (
        "Uniformity of the light over the modulator's first order for optimised holograms, by the number of "
        "wavelengths and of frames: how far the pupil may move."
    )

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        schemes = [_scheme(count, frames) for frames in _FRAMES for count in _COUNTS]
        return scheme_jobs(self, schemes, scale, seed)

    def analyse(self, results: Results) -> Findings:
        table = {
            frames: [mean_number(results, "eyebox_variation", scheme=_scheme(count, frames)) for count in _COUNTS]
            for frames in _FRAMES
        }
        curves = {f"{frames} frame{'s' if frames > 1 else ''}": (_COUNTS, table[frames]) for frames in _FRAMES}
        few, many = (table[frames][-1] for frames in _FRAMES)
        measured = ", ".join(f"{count} λ {value:.2f}" for count, value in zip(_COUNTS, table[1], strict=True))
        return Findings(
            rows=result_table(results),
            claims=[
                Claim("eyebox variation in one frame", "", measured, SHOWN),
                Claim("16 λ in 3 frames rather than one", "", f"{few:.2f} → {many:.2f}", SHOWN),
            ],
            plots=[
                StudyFigure(
                    "eyebox",
                    "Coefficient of variation of the eyebox's filling (block means); 0 is even",
                    line_plot(curves, "wavelengths", "variation of the eyebox's filling"),
                )
            ],
        )


def _scheme(count: int, frames: int) -> str:
    return f"holochrome-{count}x{frames}"


STUDIES = (_Eyebox(),)
