"""Comparisons of colour schemes: in turn or together, by the number of wavelengths, and beside source directions."""

from __future__ import annotations

from holoview.study.hologram_study import QUICK_SIZE, SchemeStudy, equal_claim, gain_claim
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


# --- the number of wavelengths in one frame ---


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


# --- source directions, wavelengths, and both together ---


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


STUDIES = (_Schemes(), _WavelengthCount(), _Multisource())
