"""The job that most studies share (optimise a hologram and measure it), and what such studies say of the results.

Settings of such a job are scheme, target, seed, shape, iterations and planes; optional ones are `set` (changes of the
bench), `range_mm` (first and last plane), `saturation` and `brightness` of the target, `depth` (false for a flat
picture at the middle plane), `eyebox` (weight of the penalty), `margin` (share of each side beside the region that
counts, which alone is optimised and measured) and `options` (of the optimiser's `Settings`). Everything
is optimised and measured on a periodic grid, so that all results can be compared.

`run_hologram_job`                the job
`mean_number`, `paired_gains` …   means over results
`write_live_page`                 a page on which a reader computes the holograms again
`HologramStudy`, `SchemeStudy`    base classes of studies, with their jobs, tables and pictures
`gain_claim`, `equal_claim`       a measured gain beside the paper's, and the verdict in words
`score_settings` …                perceptual scores in the table of a study
`row_of_lasers` …                 sets of lasers as changes of a bench
"""

from __future__ import annotations

import json
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.charts import bar_chart, bar_panels
from holoview.evidence.study.study import (
    QUICK,
    Claim,
    Findings,
    JobResult,
    Results,
    StatusCallback,
    Study,
    StudyFigure,
    StudyJob,
    StudyPicture,
    StudyScale,
    format_size,
)
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.fidelity import psnr, psnr_linear_srgb
from holoview.holograms.metrics.image_quality import (
    eyebox_uniformity_of,
    measure_image_quality,
    plane_midpoints,
)
from holoview.holograms.metrics.perceptual import measure_perceptual_scores
from holoview.holograms.metrics.perceptual_scores import (
    OPTIONAL_SCORES,
    PERCEPTUAL_SCORES,
    require_scores,
    usable_scores,
)
from holoview.holograms.optimise.checkpoint import IterationState
from holoview.holograms.optimise.parallel import resolve_torch_device
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.holograms.targets.focal_stack import Target
from holoview.holograms.targets.target import Placement, target_for
from holoview.holograms.view import View, simulate
from holoview.light.colour import to_srgb8
from holoview.light.model import preset
from holoview.light.model.plan import make_plan
from holoview.light.model.scheme import with_scheme
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region, central_region, region_slices
from holoview.util.errors import UserError
from holoview.util.files import data_dir
from holoview.viewer.page.page import export_html

_BASE = "holochrome-8"
_RANGE_MM = (9.0, 11.0)
_REPORT_EVERY = 10

METRIC_LABELS = {
    "psnr_db": "at the planes",
    "between_db": "halfway between them",
    "speckle_contrast": "speckle contrast σ/μ",
    "delta_e": "mean CIEDE2000",
    "eyebox_variation": "eyebox: variation",
    "eyebox_centre_share": "eyebox: centre",
}
"""Names of numbers in plots."""

JobSettings = Mapping[str, Any]


def job_system(settings: JobSettings) -> System:
    """The bench of a job, on a periodic grid."""
    first_m, last_m = (1e-3 * mm for mm in settings.get("range_mm", _RANGE_MM))
    count = settings["planes"]
    planes = np.linspace(first_m, last_m, count) if count > 1 else np.array([(first_m + last_m) / 2])
    base = preset.load(_BASE).with_(shape=settings["shape"], propagation="periodic", planes=planes)
    return with_scheme(base, settings["scheme"]).edit(settings.get("set", {}))


def job_target(system: System, settings: JobSettings, planes_m: NDArray[np.float64]) -> NDArray[np.float32]:
    """The focal stack (plane, y, x, 3) of a job's target at distances `planes_m`, linear sRGB."""
    name = settings["target"]
    picture = target_picture(name)
    depth = picture.with_name(f"{name}-depth.png")
    placement = Placement(depth=depth if settings.get("depth", True) and depth.is_file() else None)
    options = {"saturation": settings.get("saturation", 1.0), "planes": planes_m}
    brightness = settings.get("brightness", 1.0)
    return target_for(system, picture, placement, brightness, **options).stack


def target_picture(name: str) -> Path:
    """The file of a target that is part of holoview."""
    path = data_dir("assets") / f"{name}.png"
    return path if path.is_file() else path.with_suffix(".jpg")


def optimise_job(
    system: System, stack: NDArray[np.floating], settings: JobSettings, status: StatusCallback
) -> IterationState:
    """Optimises for a focal stack (plane, y, x, 3) and returns the last state."""
    region = _region(system, settings)
    options = Settings(iterations=settings["iterations"], seed=settings["seed"], region=region, **_options(settings))
    state: IterationState | None = None
    for state in iterate(system, stack, options, device=resolve_torch_device()):
        if state.iteration % _REPORT_EVERY == 0:
            status(f"{state.iteration}/{state.iterations}, {state.psnr_db:.1f} dB")
    assert state is not None
    return state


def _region(system: System, settings: JobSettings) -> Region | None:
    """The samples (x, y, width, height) that count, without the margin; None for all."""
    margin = settings.get("margin", 0.0)
    if not margin:
        return None
    rows, columns = make_plan(system).grid.shape
    y, x = round(margin * rows), round(margin * columns)
    return x, y, columns - 2 * x, rows - 2 * y


def run_hologram_job(settings: JobSettings, status: StatusCallback) -> JobResult:
    """Optimises a hologram and measures it at the planes and halfway between them.

    Pictures of the result: the middle plane as it is shown and as it should be ("wanted").
    """
    system = job_system(settings)
    count = len(system.planes_m)
    planes_m = np.concatenate([system.planes_m, plane_midpoints(system.planes_m)])
    target = job_target(system, settings, planes_m)
    state = optimise_job(system, target[:count], settings, status)
    view = simulate(state.best.system, state.best.drive, planes_m, backend="torch")
    if (region := _region(system, settings)) is not None:
        view, target = view.cropped(region), target[:, *region_slices(region)]
    numbers = hologram_metrics(state.best, view.at(range(count)), target[:count])
    between = [measure_image_quality(view.at([i]), target[i : i + 1]).psnr.mean_db for i in range(count, len(planes_m))]
    numbers |= {
        "between_db": float(np.mean(between)) if between else None,
        "seconds": state.seconds,
        "wavelengths_nm": (state.best.system.wavelengths_m * 1e9).round(3).tolist(),
    }
    middle = count // 2
    pictures = {"shown": view.srgb8[middle], "wanted": to_srgb8(np.asarray(target[middle]))}
    return JobResult(numbers, pictures, state.best)


def hologram_metrics(hologram: Hologram, view: View, target: NDArray[np.floating]) -> dict[str, Any]:
    """Fidelity, colour difference, speckle and eyebox of a hologram, by the names of a job's numbers.

    psnr_db: of linear sRGB. centre_db: of its central half. encoded_db: of 8-bit sRGB, as files hold it.
    """
    quality, eyebox = measure_image_quality(view, target), eyebox_uniformity_of(hologram)
    planes = zip(view.srgb8, np.asarray(target), strict=True)
    x, y, width, height = central_region(view.rgb.shape[1:])
    centre = np.s_[:, y : y + height, x : x + width]
    return {
        "psnr_db": quality.psnr.mean_db,
        "centre_db": psnr_linear_srgb(view.rgb[centre], target[centre]).mean_db,
        "encoded_db": float(np.mean([psnr(seen / 255, to_srgb8(wanted) / 255) for seen, wanted in planes])),
        "luminance_psnr_db": quality.psnr_luminance.mean_db,
        "delta_e": quality.delta_e,
        "speckle_contrast": quality.mean_speckle_contrast,
        "eyebox_variation": eyebox.coefficient_of_variation,
        "eyebox_uniformity": eyebox.uniformity,
        "eyebox_centre_share": eyebox.centre_share,
    }


def _options(settings: JobSettings) -> dict[str, Any]:
    """Options of the optimiser, with JSON's lists as tuples."""
    options = {key: settings[key] for key in ("eyebox",) if key in settings} | settings.get("options", {})
    return {key: tuple(value) if isinstance(value, list) else value for key, value in options.items()}


def mean_number(results: Results, key: str, **settings: Any) -> float:
    """The mean of a number over all jobs with these settings; NaN when there is none."""
    values = [result.numbers[key] for job, result in results if has_settings(job, **settings)]
    return float(np.mean(values)) if values else float("nan")


def mean_curve(results: Results, key: str, **settings: Any) -> NDArray[np.float64]:
    """The mean of a list of numbers, element by element, over all jobs with these settings."""
    curves = [result.numbers[key] for job, result in results if has_settings(job, **settings)]
    return np.asarray(np.mean(curves, axis=0), dtype=np.float64)


def has_settings(job: StudyJob, **settings: Any) -> bool:
    """Whether a job has these settings."""
    return all(job.settings.get(key) == value for key, value in settings.items())


def paired_gains(results: Results, better: JobSettings, worse: JobSettings, key: str) -> NDArray[np.float64]:
    """A number of the jobs with settings `better` minus that of `worse`, for each target and seed that both have."""
    first, second = (
        {
            (job.settings["target"], job.settings["seed"]): result.numbers[key]
            for job, result in results
            if has_settings(job, **settings)
        }
        for settings in (better, worse)
    )
    return np.array([first[case] - second[case] for case in sorted(set(first) & set(second))])


def case_table(results: Results, key: str, case: JobSettings) -> NDArray[np.float64]:
    """A number of the jobs of a case, (target, seed), in the order of their names."""
    found = {
        (job.settings["target"], job.settings["seed"]): result.numbers[key]
        for job, result in results
        if has_settings(job, **case)
    }
    targets, seeds = (sorted(set(names)) for names in zip(*found, strict=True))
    return np.array([[found[target, seed] for seed in seeds] for target in targets])


@dataclass(frozen=True)
class Spread:
    """A mean over scenes and seeds, and its standard errors.

    over_seeds: of the means over scenes, for other seeds. over_scenes: of the means over seeds, for other scenes. NaN
    where there is a single one.
    """

    mean: float
    over_seeds: float
    over_scenes: float

    @classmethod
    def of(cls, values: NDArray[np.float64]) -> Spread:
        """Of values (scene, seed)."""
        return cls(float(values.mean()), standard_error(values.mean(axis=0)), standard_error(values.mean(axis=1)))

    @classmethod
    def of_ratios(cls, values: NDArray[np.float64]) -> Spread:
        """Of positive values (scene, seed): the geometric mean, with the errors of the logarithm as shares of it."""
        logs = cls.of(np.log(values))
        mean = float(np.exp(logs.mean))
        return cls(mean, mean * logs.over_seeds, mean * logs.over_scenes)

    def __format__(self, spec: str) -> str:
        """The mean as `spec` says, and in brackets the errors over seeds and over scenes; a dash for an unknown one."""
        smallest = 1e-9 * abs(self.mean)  # what rounding leaves of equal numbers
        words = [
            ("–" if np.isnan(error) else "0" if error < smallest else f"{error:.1g}")
            for error in (self.over_seeds, self.over_scenes)
        ]
        return f"{self.mean:{spec}} ({'; '.join(words)})"


SPREAD_NOTE = "In brackets: standard errors over seeds, and over scenes."
"""How a report says what the format of `Spread` is."""


def standard_error(values: NDArray[np.float64]) -> float:
    """The standard error of the mean of independent values (n,); NaN of a single one."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("nan")


def table_row(job: StudyJob, result: JobResult, names: Sequence[str]) -> dict[str, Any]:
    """A row of the table of numbers: the named settings of the job, and its numbers without lists and tables."""
    scalars = {key: value for key, value in result.numbers.items() if not isinstance(value, list | dict)}
    settings = {name: job.settings.get(name) for name in names}  # lists and tables as JSON text
    return {k: json.dumps(v) if isinstance(v, list | dict) else v for k, v in settings.items()} | scalars


def mean_by_case(results: Results, keys: Sequence[str], cases: Sequence[JobSettings]) -> dict[str, list[float]]:
    """The means of numbers over the jobs of each case, by the names of the numbers in plots."""
    return {METRIC_LABELS[key]: [mean_number(results, key, **case) for case in cases] for key in keys}


# --- base classes, and the jobs, tables and pictures that they share ---


QUICK_SIZE = f"Quick: {format_size(QUICK.shape, 1)[0]}, {QUICK.planes} planes and {QUICK.iterations} iterations"


class HologramStudy(Study):
    """A study whose jobs are optimised holograms."""

    quick_note = f"{QUICK_SIZE}."
    kind = "hologram"
    revision = 5

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
    cases = {f"{scheme}{what and f', {what}'}": {"scheme": scheme, **settings} for scheme in schemes}
    return case_jobs(study, cases, scale, seed)


def case_jobs(study: Study, cases: Mapping[str, JobSettings], scale: StudyScale, seed: int) -> list[StudyJob]:
    """A job for each case, target and seed. cases: the settings of a job by the words that its label begins with."""
    return [
        study.make_job(f"{label}, {shared['target']}, seed {shared['seed']}", {**shared, **case})
        for label, case in cases.items()
        for shared in targets_and_seeds(scale, seed)
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


def first_results(results: Results) -> list[tuple[StudyJob, JobResult]]:
    """The results for the first target and seed."""
    target_and_seed = {key: results[0][0].settings[key] for key in ("target", "seed")}
    return [(job, result) for job, result in results if has_settings(job, **target_and_seed)]


def write_live_page(path: Path, title: str, results: Results) -> None:
    """Writes a page on which a reader's browser computes the holograms of the first target and seed beside the target.

    Of holograms with images of different shapes those of the first one's. Raises UserError when it can't be written.
    """
    chosen = [(job, result) for job, result in first_results(results) if result.hologram is not None]
    if not chosen:
        raise UserError("--live", "no job kept a hologram", expected="a study whose jobs optimise one hologram each")
    holograms: dict[str, Hologram] = {}
    for job, result in chosen:
        assert result.hologram is not None
        if result.hologram.drive.shape[2:] == next(iter(holograms.values()), result.hologram).drive.shape[2:]:
            holograms.setdefault(job.label, result.hologram)
    job, first = chosen[0][0], next(iter(holograms.values()))
    planes_m = first.system.planes_m
    target = Target.from_stack(job_target(first.system, job.settings, planes_m), planes_m, str(job.settings["target"]))
    export_html(path, holograms, target=target, title=title, backend="torch")


def result_pictures(results: Results) -> list[StudyPicture]:
    """The target and what each scheme shows at the middle plane, for the first target and seed."""
    chosen = [(job, result) for job, result in first_results(results) if result.pictures]
    pictures = [StudyPicture("wanted", "wanted", chosen[0][1].pictures["wanted"])] if chosen else []
    for number, (job, result) in enumerate(chosen):
        caption = f"{job.settings['scheme']}: {result.numbers['psnr_db']:.2f} dB"
        pictures.append(StudyPicture(f"shown-{number}", caption, result.pictures["shown"]))
    return pictures


def result_table(results: Results, *names: str) -> list[dict[str, Any]]:
    """The table of numbers: scheme, the settings `names`, target and seed of each job, and its numbers."""
    return [table_row(job, result, ("scheme", *names, "target", "seed")) for job, result in results]


# --- a measured gain beside the paper's ---


REPRODUCES, LARGER, DIRECTION_ONLY, CONTRADICTS = "reproduces", "larger here", "direction only", "doesn't reproduce"
SHOWN = "shown"
"""The verdict on a measurement for which the paper has no number."""
_MIN_REPRODUCED_SHARE, _MAX_REPRODUCED_SHARE = 0.75, 1.5
"""Fractions of the claimed gain between which it is reproduced; targets and brightness differ from the paper's."""
_MAX_NO_GAIN_SHARE = 0.1
"""Fraction of the claimed gain up to which there is no gain."""
_EQUAL_WITHIN_DB = 0.5


def gain_claim(
    results: Results,
    what: str,
    paper_db: float | None,
    better: str | Mapping[str, Any],
    worse: str | Mapping[str, Any],
    key: str = "psnr_db",
    reason: str = "",
    unit: str = "dB",
) -> Claim:
    """The claim that one setting has a higher PSNR, or another score, than another, by the mean over targets and seeds.

    what: the statement. paper_db: the paper's gain; None if it has none. better, worse: settings of the jobs, or the
    names of schemes. key: the number that is compared. reason: why our gain is smaller, shown only if it is. unit: of
    the number.
    """
    first, second = ({"scheme": s} if isinstance(s, str) else dict(s) for s in (better, worse))
    gains = paired_gains(results, first, second, key)
    gain = float(gains.mean())
    spread = f" (spread {gains.max() - gains.min():.2f})" if len(gains) > 1 else ""
    measured = f"{gain:+.2f} {unit}{spread}, {_format_eyeboxes(results, first, second)}"
    if paper_db is None:
        return Claim(what, "", measured, SHOWN)
    too_small = gain < _MIN_REPRODUCED_SHARE * paper_db
    return Claim(what, f"{paper_db:+.1f} dB", measured, judge_gain(gain, paper_db), reason if too_small else "")


def equal_claim(results: Results, what: str, paper: str, one: str, other: str, reason: str = "") -> Claim:
    """The claim that two schemes have equal PSNR, within 0.5 dB. reason: why they haven't, shown only then."""
    first, second = {"scheme": one}, {"scheme": other}
    gain = float(paired_gains(results, first, second, "psnr_db").mean())
    holds = abs(gain) <= _EQUAL_WITHIN_DB
    measured = f"{gain:+.2f} dB, {_format_eyeboxes(results, first, second)}"
    return Claim(what, paper, measured, REPRODUCES if holds else CONTRADICTS, "" if holds else reason)


def judge_gain(found: float, claimed: float) -> str:
    """The verdict on a gain: as large as claimed, larger, smaller, or none."""
    if found >= _MIN_REPRODUCED_SHARE * claimed:
        return LARGER if found > _MAX_REPRODUCED_SHARE * claimed else REPRODUCES
    return DIRECTION_ONLY if found > _MAX_NO_GAIN_SHARE * claimed else CONTRADICTS


def _format_eyeboxes(results: Results, *settings: Mapping[str, Any]) -> str:
    """The variation of light in the eyebox of each setting, without which PSNR can't be compared."""
    return "eyebox variation " + " / ".join(f"{mean_number(results, 'eyebox_variation', **s):.2f}" for s in settings)


# --- perceptual scores: MS-SSIM always, FLIP and ColorVideoVDP where they are installed ---
#
# The scores that a job computes are among its settings, so that a result with fewer isn't taken for one with all.


def score_settings(scale: StudyScale) -> dict[str, list[str]]:
    """The setting of a job that names the scores: the scale's, or else all that can be computed here.

    Raises UserError for a score whose library isn't installed or doesn't load.
    """
    if scale.scores is None:
        return {"scores": list(usable_scores(lambda problem: None))}
    require_scores(scale.scores)
    return {"scores": list(scale.scores)}


def score_numbers(view: View, target: NDArray[np.floating], settings: Mapping[str, Any]) -> dict[str, float]:
    """The scores that a job's settings name, means over the planes of a view with its target (plane, y, x, 3)."""
    scores = measure_perceptual_scores(view, target, settings["scores"])
    return {name: score.mean for name, score in scores.items()}


def score_names(results: Results) -> tuple[str, ...]:
    """The names of the scores that all jobs have computed."""
    return tuple(name for name in PERCEPTUAL_SCORES if all(name in job.settings["scores"] for job, _ in results))


def score_axis(name: str) -> str:
    """A score as the label of an axis."""
    score = PERCEPTUAL_SCORES[name]
    return f"{score.title} ({score.unit})" if score.unit else score.title


def notes_on_scores(results: Results) -> list[str]:
    """A note on the scores that are missing; none where all are there."""
    titles = [PERCEPTUAL_SCORES[name].title for name in OPTIONAL_SCORES if name not in score_names(results)]
    if not titles:
        return []
    verb = "isn't" if len(titles) == 1 else "aren't"
    return [
        f"{' and '.join(titles)} {verb} in the table: left out by --scores, or the extra perceptual is missing or "
        'doesn\'t load (pip install "holoview[perceptual]").'
    ]


# --- sets of lasers at a spacing ---


ROW_MIDDLE_NM = 550.0
PRIMARIES_NM = (460.0, 532.0, 638.0)
GROUP_SIZE = 3


def row_of_lasers(count: int, spacing_nm: float) -> dict[str, Any]:
    """Lasers spaced evenly about the middle wavelength, and a monochrome camera, for which all count alike."""
    return {**_lasers(ROW_MIDDLE_NM + _about_zero(count, spacing_nm)), "observer": "mono"}


def groups_of_lasers(spacing_nm: float) -> dict[str, Any]:
    """Three lasers spaced evenly about each primary, which show any colour that the primaries show."""
    return _lasers(np.concatenate([primary + _about_zero(GROUP_SIZE, spacing_nm) for primary in PRIMARIES_NM]))


def _lasers(wavelengths_nm: NDArray[np.float64]) -> dict[str, Any]:
    return {"wavelengths": (wavelengths_nm * 1e-9).tolist(), "amplitudes": [[1.0] * len(wavelengths_nm)]}


def _about_zero(count: int, spacing_nm: float) -> NDArray[np.float64]:
    return np.asarray(spacing_nm * (np.arange(count) - (count - 1) / 2), dtype=np.float64)
