"""PSNR of a monochrome camera's picture against the number and the spacing of the wavelengths."""

from __future__ import annotations

import numpy as np

from holoview.study.claims import CONTRADICTS, DIRECTION_ONLY, REPRODUCES
from holoview.study.hologram_jobs import mean_number
from holoview.study.hologram_study import HologramStudy, result_table, targets_and_seeds
from holoview.study.laser_sets import row_of_lasers
from holoview.study.plots import heat_map
from holoview.study.scale import StudyScale
from holoview.study.study import Claim, Findings, Results, StudyFigure, StudyJob

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


STUDY = _Bandwidth()
