"""Colour schemes side by side: three lasers at once, in turn, multiplexed; HoloChrome in one frame and in three."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from holoview.study.claims import gain_claim
from holoview.study.plots import bars
from holoview.study.scale import Scale
from holoview.study.study import Findings, Job, Outcome, Picture, Plot, Report, Study
from holoview.study.work import mean_of, row, scored_hologram

_SCHEMES = ("simultaneous", "time-sequential", "multiplexed", "holochrome-8", "holochrome-8x3")
_CLAIMS = (
    ("HoloChrome 8 λ, 1 frame, against simultaneous", 3.6, "holochrome-8", "simultaneous"),
    ("HoloChrome 8 λ, 3 frames, against multiplexed", 3.5, "holochrome-8x3", "multiplexed"),
    ("HoloChrome 8 λ, 3 frames, against simultaneous", 6.7, "holochrome-8x3", "simultaneous"),
    ("HoloChrome 8 λ, 3 frames, against time-sequential", 6.0, "holochrome-8x3", "time-sequential"),
)


class _Schemes(Study):
    name = "schemes"
    title = "Colour schemes of a dual-modulator display"
    shows = (
        "The paper's main comparison: a focal stack shown by simultaneous, time-sequential and multiplexed colour, and "
        "by HoloChrome in one and three frames; PSNR, CIEDE2000 and speckle contrast, with the eyebox beside each."
    )
    reduced = "Quick: 128 x 96 samples, 3 planes and 40 iterations; gains are smaller and scatter by about 0.3 dB."

    def jobs(self, scale: Scale, seed: int) -> list[Job]:
        return scheme_jobs(self.name, _SCHEMES, scale, seed)

    def work(self, settings: Mapping[str, Any], report: Report) -> Outcome:
        return scored_hologram(settings, report)

    def findings(self, results: Sequence[tuple[Job, Outcome]]) -> Findings:
        values = {key: [mean_of(results, key, scheme=s) for s in _SCHEMES] for key in ("psnr_db", "between_db")}
        boxes = {
            key: [mean_of(results, key, scheme=s) for s in _SCHEMES] for key in ("speckle_contrast", "eyebox_variation")
        }
        return Findings(
            rows=[row(job, outcome, ("scheme", "target", "seed")) for job, outcome in results],
            claims=[gain_claim(results, what, paper, better, worse) for what, paper, better, worse in _CLAIMS],
            plots=[
                Plot(
                    "psnr",
                    "PSNR of linear sRGB at the planes and between them, mean over targets and seeds",
                    bars(_SCHEMES, {"at the planes": values["psnr_db"], "between": values["between_db"]}, "PSNR (dB)"),
                ),
                Plot(
                    "speckle",
                    "Speckle contrast, and variation of the eyebox's filling",
                    bars(
                        _SCHEMES,
                        {"speckle contrast": boxes["speckle_contrast"], "eyebox variation": boxes["eyebox_variation"]},
                        "",
                    ),
                ),
            ],
            pictures=pictures_of(results),
        )


def scheme_jobs(study: str, schemes: Sequence[str], scale: Scale, seed: int, **settings: Any) -> list[Job]:
    """A hologram for each scheme, target and seed."""
    return [
        Job(
            study,
            f"{scheme}, {target}, seed {number}",
            {**scale.settings, "scheme": scheme, "target": target, "seed": number, **settings},
        )
        for scheme in schemes
        for target in scale.targets
        for number in range(seed, seed + scale.seeds)
    ]


def pictures_of(results: Sequence[tuple[Job, Outcome]]) -> list[Picture]:
    """What is wanted, and what each scheme shows of it at the middle plane: first target, first seed."""
    first = results[0][0].settings
    same = [(j, o) for j, o in results if all(j.settings[k] == first[k] for k in ("target", "seed")) and o.pictures]
    found = [Picture("wanted", "wanted", same[0][1].pictures["wanted"])] if same else []
    for number, (job, outcome) in enumerate(same):
        caption = f"{job.settings['scheme']}: {outcome.numbers['psnr_db']:.2f} dB"
        found.append(Picture(f"shown-{number}", caption, outcome.pictures["shown"]))
    return found


STUDY = _Schemes()
