"""How many wavelengths: 3, 8 and 16 lasers in a single frame."""

from __future__ import annotations

from holoview.study.claims import gain_claim
from holoview.study.hologram_study import Results, SchemeStudy
from holoview.study.study import Claim


class _WavelengthCount(SchemeStudy):
    name = "wavelength-count"
    title = "The number of wavelengths in one frame"
    summary = (
        "The paper's ablation over the number of wavelengths at equal frames: more lasers average more speckle, and "
        "each adds a degree of freedom in colour."
    )
    quick_note = "Quick: 128 x 96 samples, 3 planes and 40 iterations."
    schemes = ("simultaneous", "holochrome-8", "holochrome-16")
    labels = ("3 wavelengths", "8 wavelengths", "16 wavelengths")

    def claims(self, results: Results) -> list[Claim]:
        return [
            gain_claim(results, "8 wavelengths against 3", 3.6, "holochrome-8", "simultaneous"),
            gain_claim(results, "16 wavelengths against 3", 4.3, "holochrome-16", "simultaneous"),
        ]


STUDY = _WavelengthCount()
