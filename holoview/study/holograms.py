"""What studies of optimised holograms have in common: their jobs, their table, their pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from holoview.study.scale import Scale
from holoview.study.study import Job, Outcome, Picture, Report, Study
from holoview.study.work import row, scored_hologram

Results = Sequence[tuple[Job, Outcome]]


class HologramStudy(Study):
    """A study whose jobs are optimised holograms."""

    def work(self, settings: Mapping[str, Any], report: Report) -> Outcome:
        return scored_hologram(settings, report)


def scheme_jobs(
    study: Study, schemes: Sequence[str], scale: Scale, seed: int, what: str = "", **settings: Any
) -> list[Job]:
    """A hologram for each scheme, target and seed. what: what tells these from others of the study, for labels."""
    return [
        study.job(
            f"{scheme}{what and f', {what}'}, {target}, seed {number}",
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


def table_of(results: Results, *names: str) -> list[dict[str, Any]]:
    """The raw table: scheme, target and seed of each job, other settings by name, and its numbers."""
    return [row(job, outcome, ("scheme", *names, "target", "seed")) for job, outcome in results]
