"""Base classes of studies that compare optimised holograms, and the jobs, tables and pictures that they share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

from holoview.study.hologram_jobs import has_settings, mean_by_case, run_hologram_job, table_row
from holoview.study.plots import bar_chart, bar_panels
from holoview.study.scale import QUICK, StudyScale, format_size
from holoview.study.study import (
    Claim,
    Findings,
    JobResult,
    Results,
    StatusCallback,
    Study,
    StudyFigure,
    StudyJob,
    StudyPicture,
)

QUICK_SIZE = f"Quick: {format_size(QUICK.shape, 1)[0]}, {QUICK.planes} planes and {QUICK.iterations} iterations"


class HologramStudy(Study):
    """A study whose jobs are optimised holograms."""

    quick_note = f"{QUICK_SIZE}."
    kind = "hologram"
    revision = 4

    def run_job(self, settings: Mapping[str, Any], status: StatusCallback) -> JobResult:
        return run_hologram_job(settings, status)


class SchemeStudy(HologramStudy):
    """A study that optimises the same targets with several schemes. labels: names of the schemes in plots."""

    schemes: Sequence[str]
    labels: Sequence[str]
    notes: Sequence[str] = ()

    def jobs(self, scale: StudyScale, seed: int) -> list[StudyJob]:
        return scheme_jobs(self, self.schemes, scale, seed)

    @abstractmethod
    def claims(self, results: Results) -> list[Claim]:
        """The paper's statements on the schemes."""

    def analyse(self, results: Results) -> Findings:
        cases = [{"scheme": scheme} for scheme in self.schemes]
        means = mean_by_case(results, ("speckle_contrast", "eyebox_variation", "delta_e"), cases)
        return Findings(
            rows=result_table(results),
            claims=self.claims(results),
            plots=[
                psnr_plot(results, self.labels, cases),
                StudyFigure("others", "Speckle, eyebox and colour; small is good", bar_panels(self.labels, means)),
            ],
            pictures=result_pictures(results),
            notes=self.notes,
        )


def psnr_plot(results: Results, labels: Sequence[str], cases: Sequence[Mapping[str, Any]]) -> StudyFigure:
    """PSNR at the planes and halfway between them, a pair of bars for each case."""
    means = mean_by_case(results, ("psnr_db", "between_db"), cases)
    caption = "PSNR of linear sRGB, mean over targets and seeds"
    return StudyFigure("psnr", caption, bar_chart(labels, means, "PSNR (dB)"))


def targets_and_seeds(scale: StudyScale, seed: int) -> list[dict[str, Any]]:
    """The settings that all jobs share, for each target and seed of the scale."""
    return [
        {**scale.job_settings, "target": target, "seed": number}
        for target in scale.targets
        for number in range(seed, seed + scale.seeds)
    ]


def scheme_jobs(
    study: Study, schemes: Sequence[str], scale: StudyScale, seed: int, what: str = "", **settings: Any
) -> list[StudyJob]:
    """A job for each scheme, target and seed, with further settings. what: addition to the labels."""
    return [
        study.make_job(
            f"{scheme}{what and f', {what}'}, {case['target']}, seed {case['seed']}",
            {**case, "scheme": scheme, **settings},
        )
        for scheme in schemes
        for case in targets_and_seeds(scale, seed)
    ]


def aimed_jobs(
    study: Study, schemes: Sequence[str], scale: StudyScale, seed: int, aims: Mapping[str, str], **settings: Any
) -> list[StudyJob]:
    """The `scheme_jobs` of each aim, which becomes the setting `optimised_for`. aims: settings, and their words."""
    return [
        job
        for aim, what in aims.items()
        for job in scheme_jobs(study, schemes, scale, seed, f"for {what}", optimised_for=aim, **settings)
    ]


def result_pictures(results: Results) -> list[StudyPicture]:
    """The target and what each scheme shows at the middle plane, for the first target and seed."""
    target_and_seed = {key: results[0][0].settings[key] for key in ("target", "seed")}
    chosen = [(job, result) for job, result in results if has_settings(job, **target_and_seed) and result.pictures]
    pictures = [StudyPicture("wanted", "wanted", chosen[0][1].pictures["wanted"])] if chosen else []
    for number, (job, result) in enumerate(chosen):
        caption = f"{job.settings['scheme']}: {result.numbers['psnr_db']:.2f} dB"
        pictures.append(StudyPicture(f"shown-{number}", caption, result.pictures["shown"]))
    return pictures


def result_table(results: Results, *names: str) -> list[dict[str, Any]]:
    """The table of numbers: scheme, the settings `names`, target and seed of each job, and its numbers."""
    return [table_row(job, result, ("scheme", *names, "target", "seed")) for job, result in results]
