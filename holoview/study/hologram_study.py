"""What studies of optimised holograms have in common: their jobs, their table, their pictures."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

from holoview.study.hologram_jobs import mean_by_case, run_hologram_job, table_row
from holoview.study.plots import bar_chart, bar_panels
from holoview.study.scale import StudyScale
from holoview.study.study import Claim, Findings, JobResult, StatusCallback, Study, StudyFigure, StudyJob, StudyPicture

Results = Sequence[tuple[StudyJob, JobResult]]


class HologramStudy(Study):
    """A study whose jobs are optimised holograms."""

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        return run_hologram_job(settings, status)


class SchemeStudy(HologramStudy):
    """A study that does the same with several schemes. labels: what they are called in plots."""

    schemes: Sequence[str]
    labels: Sequence[str]
    notes: Sequence[str] = ()

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return scheme_jobs(self, self.schemes, scale, seed)

    @abstractmethod
    def claims(self, results: Results) -> list[Claim]:
        """What is claimed of them."""

    def analyse(self, results: Results) -> Findings:
        cases = [{"scheme": scheme} for scheme in self.schemes]
        others = mean_by_case(results, ("speckle_contrast", "eyebox_variation", "delta_e"), cases)
        return Findings(
            rows=result_table(results),
            claims=self.claims(results),
            plots=[
                psnr_plot(results, self.labels, cases),
                StudyFigure("others", "Speckle, eyebox and colour; small is good", bar_panels(self.labels, others)),
            ],
            pictures=result_pictures(results),
            notes=self.notes,
        )


def psnr_plot(results: Results, labels: Sequence[str], cases: Sequence[Mapping[str, Any]]) -> StudyFigure:
    """PSNR at the planes and between them, a pair of bars a case."""
    found = mean_by_case(results, ("psnr_db", "between_db"), cases)
    return StudyFigure(
        "psnr", "PSNR of linear sRGB, mean over targets and seeds", bar_chart(labels, found, "PSNR (dB)")
    )


def targets_and_seeds(scale: StudyScale, seed: int) -> list[dict[str, Any]]:
    """What every job of an optimised hologram has: the scale's settings, each target, each seed."""
    return [
        {**scale.job_settings, "target": target, "seed": number}
        for target in scale.targets
        for number in range(seed, seed + scale.seeds)
    ]


def scheme_jobs(
    study: Study, schemes: Sequence[str], scale: StudyScale, seed: int, what: str = "", **settings: Any
) -> list[StudyJob]:
    """A hologram for each scheme, target and seed. what: what tells these from others of the study, for labels."""
    return [
        study.make_job(
            f"{scheme}{what and f', {what}'}, {case['target']}, seed {case['seed']}",
            {**case, "scheme": scheme, **settings},
        )
        for scheme in schemes
        for case in targets_and_seeds(scale, seed)
    ]


def result_pictures(results: Results) -> list[StudyPicture]:
    """What is wanted, and what each scheme shows of it at the middle plane: first target, first seed."""
    first = results[0][0].settings
    same = [(j, o) for j, o in results if all(j.settings[k] == first[k] for k in ("target", "seed")) and o.pictures]
    found = [StudyPicture("wanted", "wanted", same[0][1].pictures["wanted"])] if same else []
    for number, (job, outcome) in enumerate(same):
        caption = f"{job.settings['scheme']}: {outcome.numbers['psnr_db']:.2f} dB"
        found.append(StudyPicture(f"shown-{number}", caption, outcome.pictures["shown"]))
    return found


def result_table(results: Results, *names: str) -> list[dict[str, Any]]:
    """The raw table: scheme, target and seed of each job, other settings by name, and its numbers."""
    return [table_row(job, outcome, ("scheme", *names, "target", "seed")) for job, outcome in results]
