"""Many source directions against many wavelengths, and both."""

from __future__ import annotations

from holoview.study.claims import equal_claim, gain_claim
from holoview.study.holograms import HologramStudy, Results, pictures_of, scheme_jobs, table_of
from holoview.study.plots import bars
from holoview.study.scale import Scale
from holoview.study.study import Findings, Job, Plot
from holoview.study.work import means

_SOURCES, _COLOURS = "time-sequential+multisource-3x3", "holochrome-9x3"
_BOTH = "holochrome-9x3+multisource-3x3"
_SCHEMES = (_SOURCES, _COLOURS, _BOTH)
_REASON = "here HoloChrome is ahead: it has nine lasers to mix colours from, the sources have three"
_LABELS = ("3 x 3 sources", "9 wavelengths", "both")


class _Multisource(HologramStudy):
    name = "multisource"
    title = "Source directions against wavelengths"
    shows = (
        "Nine mutually incoherent source directions in three colours, nine wavelengths from one direction, and both "
        "together, three frames each. How fast speckle decorrelates with either is the study memory-effect."
    )
    reduced = "Quick: 128 x 96 samples, 3 planes and 40 iterations."

    def jobs(self, scale: Scale, seed: int) -> list[Job]:
        return scheme_jobs(self, _SCHEMES, scale, seed)

    def findings(self, results: Results) -> Findings:
        cases = [{"scheme": scheme} for scheme in _SCHEMES]
        keys = ("speckle_contrast", "eyebox_variation")
        claims = [
            equal_claim(results, "9 wavelengths and 3 x 3 sources are equal", "equal", _COLOURS, _SOURCES, _REASON),
            equal_claim(results, "both and 9 wavelengths are equal", "", _BOTH, _COLOURS),
            gain_claim(results, "both against 3 x 3 sources", 0.0, _BOTH, _SOURCES),
        ]
        return Findings(
            rows=table_of(results),
            claims=claims,
            plots=[
                Plot(
                    "psnr", "PSNR of linear sRGB", bars(_LABELS, means(results, ("psnr_db", "between_db"), cases), "dB")
                ),
                Plot(
                    "speckle", "Speckle contrast; eyebox variation", bars(_LABELS, means(results, keys, cases), "σ/μ")
                ),
            ],
            pictures=pictures_of(results),
        )


STUDY = _Multisource()
