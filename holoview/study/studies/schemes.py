"""Comparison of colour schemes: simultaneous, time-sequential, multiplexed; HoloChrome in one frame and in three."""

from __future__ import annotations

from holoview.study.claims import gain_claim
from holoview.study.hologram_study import QUICK_SIZE, SchemeStudy
from holoview.study.study import Claim, Results

_CLAIMS = (
    ("HoloChrome 8 λ, 1 frame, against simultaneous", 3.6, "holochrome-8", "simultaneous"),
    ("HoloChrome 8 λ, 3 frames, against multiplexed", 3.5, "holochrome-8x3", "multiplexed"),
    ("HoloChrome 8 λ, 3 frames, against simultaneous", 6.7, "holochrome-8x3", "simultaneous"),
    ("HoloChrome 8 λ, 3 frames, against time-sequential", 6.0, "holochrome-8x3", "time-sequential"),
)


class _Schemes(SchemeStudy):
    name = "schemes"
    title = "Colour schemes of a dual-modulator display"
    summary = (
        "The paper's main comparison: a focal stack shown by simultaneous, time-sequential and multiplexed colour, and "
        "by HoloChrome in one and three frames; PSNR, CIEDE2000 and speckle contrast, with the eyebox beside each."
    )
    quick_note = f"{QUICK_SIZE}; gains scatter by about 0.3 dB."
    schemes = ("simultaneous", "time-sequential", "multiplexed", "holochrome-8", "holochrome-8x3")
    labels = schemes

    def claims(self, results: Results) -> list[Claim]:
        return [gain_claim(results, *claim) for claim in _CLAIMS]


STUDY = _Schemes()
