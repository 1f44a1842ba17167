"""Many source directions, many wavelengths, and both together."""

from __future__ import annotations

from holoview.study.claims import equal_claim, gain_claim
from holoview.study.hologram_study import SchemeStudy
from holoview.study.study import Claim, Results

_SOURCES, _COLOURS = "time-sequential+multisource-3x3", "holochrome-9x3"
_BOTH = "holochrome-9x3+multisource-3x3"
_REASON = "here HoloChrome is ahead: it has nine lasers to mix colours from, the sources have three"


class _Multisource(SchemeStudy):
    name = "multisource"
    title = "Source directions against wavelengths"
    summary = (
        "Nine mutually incoherent source directions in three colours, nine wavelengths from one direction, and both "
        "together, three frames each. How fast speckle decorrelates with either is the study memory-effect."
    )
    schemes = (_SOURCES, _COLOURS, _BOTH)
    labels = ("3 x 3 sources", "9 wavelengths", "both")
    notes = (
        "How alike the speckle of two directions or two wavelengths is, is the memory effect: `holoview study "
        "memory-effect` has it by angle and by wavelength, for several gaps. Sources 8.6 mrad apart count as "
        "independent where its curves have fallen to nothing, and wavelengths likewise.",
    )

    def claims(self, results: Results) -> list[Claim]:
        return [
            equal_claim(results, "9 wavelengths and 3 x 3 sources are equal", "equal", _COLOURS, _SOURCES, _REASON),
            gain_claim(results, "both against 9 wavelengths", None, _BOTH, _COLOURS),
            gain_claim(results, "both against 3 x 3 sources", None, _BOTH, _SOURCES),
        ]


STUDY = _Multisource()
