"""PSNR of a single frame with 3, 8 and 16 lasers."""

from __future__ import annotations

from holoview.study.claims import gain_claim
from holoview.study.hologram_study import SchemeStudy
from holoview.study.study import Claim, Results


class _WavelengthCount(SchemeStudy):
    name = "wavelength-count"
    title = "The number of wavelengths in one frame"
    summary = (
        "The paper's ablation over the number of wavelengths at equal frames: more lasers average more speckle, and "
        "each adds a degree of freedom in colour."
    )
    schemes = ("simultaneous", "holochrome-8", "holochrome-16")
    labels = ("3 wavelengths", "8 wavelengths", "16 wavelengths")

    def claims(self, results: Results) -> list[Claim]:
        return [
            gain_claim(results, "8 wavelengths against 3", 3.6, "holochrome-8", "simultaneous"),
            gain_claim(results, "16 wavelengths against 3", 4.3, "holochrome-16", "simultaneous"),
        ]


STUDY = _WavelengthCount()
