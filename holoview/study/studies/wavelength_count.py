"""How many wavelengths: 3, 8 and 16 lasers in a single frame."""

from __future__ import annotations

from holoview.study.claims import gain_claim
from holoview.study.holograms import HologramStudy, Results, pictures_of, scheme_jobs, table_of
from holoview.study.plots import bars, panels
from holoview.study.scale import Scale
from holoview.study.study import Findings, Job, Plot
from holoview.study.work import means

_SCHEMES = ("simultaneous", "holochrome-8", "holochrome-16")
_LABELS = ("3 wavelengths", "8 wavelengths", "16 wavelengths")


class _WavelengthCount(HologramStudy):
    name = "wavelength-count"
    title = "The number of wavelengths in one frame"
    shows = (
        "The paper's ablation over the number of wavelengths at equal frames: more lasers average more speckle, and "
        "each adds a degree of freedom in colour."
    )
    reduced = "Quick: 128 x 96 samples, 3 planes and 40 iterations."

    def jobs(self, scale: Scale, seed: int) -> list[Job]:
        return scheme_jobs(self, _SCHEMES, scale, seed)

    def findings(self, results: Results) -> Findings:
        cases = [{"scheme": scheme} for scheme in _SCHEMES]
        keys = ("speckle_contrast", "eyebox_variation", "delta_e")
        return Findings(
            rows=table_of(results),
            claims=[
                gain_claim(results, "8 wavelengths against 3", 3.6, "holochrome-8", "simultaneous"),
                gain_claim(results, "16 wavelengths against 3", 4.3, "holochrome-16", "simultaneous"),
            ],
            plots=[
                Plot(
                    "psnr",
                    "PSNR of linear sRGB",
                    bars(_LABELS, means(results, ("psnr_db", "between_db"), cases), "PSNR (dB)"),
                ),
                Plot(
                    "others", "Speckle, eyebox and colour; small is good", panels(_LABELS, means(results, keys, cases))
                ),
            ],
            pictures=pictures_of(results),
        )


STUDY = _WavelengthCount()
