"""Many source directions against many wavelengths, and both."""

from __future__ import annotations

from holoview.study.claims import equal_claim, gain_claim
from holoview.study.holograms import HologramStudy, Results, pictures_of, scheme_jobs, table_of
from holoview.study.plots import bars, panels
from holoview.study.scale import Scale
from holoview.study.study import Findings, Job, Plot
from holoview.study.work import means

_SOURCES, _COLOURS = "time-sequential+multisource-3x3", "holochrome-9x3"
_BOTH = "holochrome-9x3+multisource-3x3"
_SCHEMES = (_SOURCES, _COLOURS, _BOTH)
_REASON = "here HoloChrome is ahead: it has nine lasers to mix colours from, the sources have three"
_MEMORY = (
    "How alike the speckle of two directions or two wavelengths is, is the memory effect: `holoview study "
    "memory-effect` has it by angle and by wavelength, for several gaps. Sources 8.6 mrad apart count as independent "
    "where its curves have fallen to nothing, and wavelengths likewise."
)
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
        keys = ("speckle_contrast", "eyebox_variation", "delta_e")
        claims = [
            equal_claim(results, "9 wavelengths and 3 x 3 sources are equal", "equal", _COLOURS, _SOURCES, _REASON),
            gain_claim(results, "both against 9 wavelengths", None, _BOTH, _COLOURS),
            gain_claim(results, "both against 3 x 3 sources", None, _BOTH, _SOURCES),
        ]
        return Findings(
            rows=table_of(results),
            claims=claims,
            plots=[
                Plot(
                    "psnr",
                    "PSNR of linear sRGB",
                    bars(_LABELS, means(results, ("psnr_db", "between_db"), cases), "PSNR (dB)"),
                ),
                Plot(
                    "speckle", "Speckle, eyebox and colour; small is good", panels(_LABELS, means(results, keys, cases))
                ),
            ],
            pictures=pictures_of(results),
            notes=[_MEMORY],
        )


STUDY = _Multisource()
