"""Colour schemes side by side: three lasers at once, in turn, multiplexed; HoloChrome in one frame and in three."""

from __future__ import annotations

from holoview.study.claims import gain_claim
from holoview.study.holograms import HologramStudy, Results, pictures_of, scheme_jobs, table_of
from holoview.study.plots import bars, panels
from holoview.study.scale import Scale
from holoview.study.study import Findings, Job, Plot
from holoview.study.work import means

_SCHEMES = ("simultaneous", "time-sequential", "multiplexed", "holochrome-8", "holochrome-8x3")
_CLAIMS = (
    ("HoloChrome 8 λ, 1 frame, against simultaneous", 3.6, "holochrome-8", "simultaneous"),
    ("HoloChrome 8 λ, 3 frames, against multiplexed", 3.5, "holochrome-8x3", "multiplexed"),
    ("HoloChrome 8 λ, 3 frames, against simultaneous", 6.7, "holochrome-8x3", "simultaneous"),
    ("HoloChrome 8 λ, 3 frames, against time-sequential", 6.0, "holochrome-8x3", "time-sequential"),
)


class _Schemes(HologramStudy):
    name = "schemes"
    title = "Colour schemes of a dual-modulator display"
    shows = (
        "The paper's main comparison: a focal stack shown by simultaneous, time-sequential and multiplexed colour, and "
        "by HoloChrome in one and three frames; PSNR, CIEDE2000 and speckle contrast, with the eyebox beside each."
    )
    reduced = "Quick: 128 x 96 samples, 3 planes and 40 iterations; gains scatter by about 0.3 dB."

    def jobs(self, scale: Scale, seed: int) -> list[Job]:
        return scheme_jobs(self, _SCHEMES, scale, seed)

    def findings(self, results: Results) -> Findings:
        levels = means(results, ("psnr_db", "between_db"), [{"scheme": scheme} for scheme in _SCHEMES])
        keys = ("speckle_contrast", "eyebox_variation", "delta_e")
        others = means(results, keys, [{"scheme": scheme} for scheme in _SCHEMES])
        return Findings(
            rows=table_of(results),
            claims=[gain_claim(results, *claim) for claim in _CLAIMS],
            plots=[
                Plot("psnr", "PSNR of linear sRGB, mean over targets and seeds", bars(_SCHEMES, levels, "PSNR (dB)")),
                Plot("others", "Speckle, eyebox and colour of the same; small is good", panels(_SCHEMES, others)),
            ],
            pictures=pictures_of(results),
        )


STUDY = _Schemes()
