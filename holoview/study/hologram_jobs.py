"""The job that most studies share (optimise a hologram and measure it), and means over results.

Settings of such a job are scheme, target, seed, shape, iterations and planes; optional ones are `set` (changes of the
bench), `range_mm` (first and last plane), `saturation` and `brightness` of the target, `depth` (false for a flat
picture at the middle plane), `eyebox` (weight of the penalty), `margin` (share of each side beside the region that
counts, which alone is optimised and measured) and `options` (of the optimiser's `Settings`). Everything
is optimised and measured on a periodic grid, so that all results can be compared.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.colour import to_srgb8
from holoview.io.hologram import Hologram
from holoview.metrics.image_quality import (
    central_region,
    eyebox_uniformity_of,
    measure_image_quality,
    plane_midpoints,
)
from holoview.metrics.psnr import psnr, psnr_linear_srgb
from holoview.model import preset
from holoview.model.plan import make_plan
from holoview.model.scheme import with_scheme
from holoview.model.system import System
from holoview.numerics.image_region import Region, region_slices
from holoview.optimise.checkpoint import IterationState
from holoview.optimise.parallel import resolve_torch_device
from holoview.optimise.settings import Settings
from holoview.optimise.solve import iterate
from holoview.study.study import JobResult, Results, StatusCallback, StudyJob
from holoview.targets.target import Placement, target_for
from holoview.util.files import data_dir
from holoview.view import View, simulate

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
    system: System, stack: NDArray[np.floating], settings: JobSettings, status: StatusCallback, label: str = ""
) -> IterationState:
    """Optimises for a focal stack (plane, y, x, 3) and returns the last state."""
    region = _region(system, settings)
    options = Settings(iterations=settings["iterations"], seed=settings["seed"], region=region, **_options(settings))
    state: IterationState | None = None
    for state in iterate(system, stack, options, device=resolve_torch_device()):
        if state.iteration % _REPORT_EVERY == 0:
            status(f"{label}{state.iteration}/{state.iterations}, {state.psnr_db:.1f} dB")
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
    return JobResult(numbers, pictures)


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


def table_row(job: StudyJob, result: JobResult, names: Sequence[str]) -> dict[str, Any]:
    """A row of the table of numbers: the named settings of the job, and its numbers without lists and tables."""
    scalars = {key: value for key, value in result.numbers.items() if not isinstance(value, list | dict)}
    return {name: _table_cell(job.settings.get(name)) for name in names} | scalars


def _table_cell(setting: Any) -> Any:
    """A setting as a cell: lists and tables as JSON text."""
    return json.dumps(setting) if isinstance(setting, list | dict) else setting


def mean_by_case(results: Results, keys: Sequence[str], cases: Sequence[JobSettings]) -> dict[str, list[float]]:
    """The means of numbers over the jobs of each case, by the names of the numbers in plots."""
    return {METRIC_LABELS[key]: [mean_number(results, key, **case) for case in cases] for key in keys}
