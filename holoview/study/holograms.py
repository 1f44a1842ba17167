"""What studies of optimised holograms have in common: their jobs, their table, their pictures."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

from holoview.study.plots import bars, panels
from holoview.study.scale import Scale
from holoview.study.study import Claim, Findings, Job, Outcome, Picture, Plot, Report, Study
from holoview.study.work import means, row, scored_hologram

Results = Sequence[tuple[Job, Outcome]]


class HologramStudy(Study):
    """A study whose jobs are optimised holograms."""

    def work(self, settings: Mapping[str, Any], report: Report) -> Outcome:
        return scored_hologram(settings, report)


class SchemeStudy(HologramStudy):
    """A study that does the same with several schemes. labels: what they are called in plots."""

    schemes: Sequence[str]
    labels: Sequence[str]
    notes: Sequence[str] = ()

    def jobs(self, scale: Scale, seed: int) -> list[Job]:
        return scheme_jobs(self, self.schemes, scale, seed)

    @abstractmethod
    def claims(self, results: Results) -> list[Claim]:
        """What is claimed of them."""

    def findings(self, results: Results) -> Findings:
        cases = [{"scheme": scheme} for scheme in self.schemes]
        others = means(results, ("speckle_contrast", "eyebox_variation", "delta_e"), cases)
        return Findings(
            rows=table_of(results),
            claims=self.claims(results),
            plots=[
                psnr_plot(results, self.labels, cases),
                Plot("others", "Speckle, eyebox and colour; small is good", panels(self.labels, others)),
            ],
            pictures=pictures_of(results),
            notes=self.notes,
        )


def psnr_plot(results: Results, labels: Sequence[str], cases: Sequence[Mapping[str, Any]]) -> Plot:
    """PSNR at the planes and between them, a pair of bars a case."""
    found = means(results, ("psnr_db", "between_db"), cases)
    return Plot("psnr", "PSNR of linear sRGB, mean over targets and seeds", bars(labels, found, "PSNR (dB)"))


def targets_and_seeds(scale: Scale, seed: int) -> list[dict[str, Any]]:
    """What every job of an optimised hologram has: the scale's settings, each target, each seed."""
    return [
        {**scale.settings, "target": target, "seed": number}
        for target in scale.targets
        for number in range(seed, seed + scale.seeds)
    ]


def scheme_jobs(
    study: Study, schemes: Sequence[str], scale: Scale, seed: int, what: str = "", **settings: Any
) -> list[Job]:
    """A hologram for each scheme, target and seed. what: what tells these from others of the study, for labels."""
    return [
        study.job(
            f"{scheme}{what and f', {what}'}, {case['target']}, seed {case['seed']}",
            {**case, "scheme": scheme, **settings},
        )
        for scheme in schemes
        for case in targets_and_seeds(scale, seed)
    ]


def pictures_of(results: Results) -> list[Picture]:
    """What is wanted, and what each scheme shows of it at the middle plane: first target, first seed."""
    first = results[0][0].settings
    same = [(j, o) for j, o in results if all(j.settings[k] == first[k] for k in ("target", "seed")) and o.pictures]
    found = [Picture("wanted", "wanted", same[0][1].pictures["wanted"])] if same else []
    for number, (job, outcome) in enumerate(same):
        caption = f"{job.settings['scheme']}: {outcome.numbers['psnr_db']:.2f} dB"
        found.append(Picture(f"shown-{number}", caption, outcome.pictures["shown"]))
    return found


def table_of(results: Results, *names: str) -> list[dict[str, Any]]:
    """The raw table: scheme, target and seed of each job, other settings by name, and its numbers."""
    return [row(job, outcome, ("scheme", *names, "target", "seed")) for job, outcome in results]
