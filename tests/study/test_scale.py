"""Scales with sizes, seeds, targets and eyebox changed, and what the changes do to jobs."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from holoview.commands.cli import main
from holoview.evidence.study.hologram_study import job_system, job_target, run_hologram_job, target_picture
from holoview.evidence.study.studies import studies_by_name
from holoview.evidence.study.study import MIDDLE, QUICK, TARGETS

TINY = {"scheme": "simultaneous", "target": "still-life", "seed": 0, "shape": [12, 16], "iterations": 2, "planes": 2}


def test_what_isnt_given_stays() -> None:
    assert MIDDLE.with_changes(seeds=None, eyebox=None) == MIDDLE
    changed = MIDDLE.with_changes(seeds=1, targets=("night",), eyebox=0.03)
    assert (changed.seeds, changed.targets, changed.iterations) == (1, ("night",), MIDDLE.iterations)
    assert changed.job_settings["eyebox"] == 0.03
    assert "eyebox" not in MIDDLE.job_settings
    assert changed.description.endswith("5 focal planes, eyebox penalty 0.03")


@pytest.mark.parametrize("name", TARGETS)
def test_every_target_is_a_picture_with_or_without_depth(name: str) -> None:
    path = target_picture(name)
    with Image.open(path) as picture:
        size = picture.size
    depth = path.with_name(f"{name}-depth.png")
    if depth.is_file():
        with Image.open(depth) as map_:
            assert map_.size == size


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--seeds", "0"], "--seeds: '0'; expected a whole number of at least 1"),
        (["--iterations", "-3"], "--iterations: '-3'; expected a whole number of at least 1"),
        (["--targets", "still-lif"], "did you mean still-life?"),
        (["--eyebox", "nan"], "--eyebox: 'nan'; expected a finite number"),
        (["--eyebox", "-1"], "--eyebox: -1.0; expected a weight of 0 or more"),
        (["--shape", "96"], '--shape: "96"; expected rows and columns'),
        (["--shape", "1x16"], "--shape"),
        (
            ["--pupils", "3mm"],
            "--pupils: the study schemes doesn't have it; expected one of eye, pupil, retinal-",
        ),
        (["--scores", "flip"], "--scores: the study schemes doesn't have it; expected one of eye, pupil"),
    ],
    ids=lambda value: str(value[0]) if isinstance(value, list) else "",
)
def test_impossible_changes_are_named(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: list[str], words: str
) -> None:
    assert main(["study", "schemes", *arguments, "-o", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        ("eye", ["--pupils", "2,0mm"], "--pupils: 0 mm is out of range; expected between 0.5 mm and 12 mm"),
        ("eye", ["--pupils", "wide"], '--pupils: "wide'),
        ("eyebox", ["--pupils", "3mm"], "--pupils: the study eyebox doesn't have it"),
    ],
)
def test_impossible_pupils_are_named(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str, arguments: list[str], words: str
) -> None:
    assert main(["study", name, *arguments, "-o", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_pupils_and_scores_are_chosen() -> None:
    eye, pupil, speckle = (studies_by_name()[name] for name in ("eye", "pupil", "retinal-speckle"))
    chosen = QUICK.with_changes(pupils_m=(3e-3, 4e-3), scores=("ms_ssim",))
    for job in (*eye.jobs(chosen, 0), *pupil.jobs(chosen, 0)):
        assert job.settings["pupils_mm"] == [3.0, 4.0] and job.settings["scores"] == ["ms_ssim"]
    assert {job.settings["pupil_mm"] for job in speckle.jobs(chosen, 0)} == {3.0, 4.0}


def test_studies_share_the_jobs_that_they_have_in_common() -> None:
    keys = {
        name: {job.key for job in studies_by_name()[name].jobs(QUICK, 0)} for name in ("schemes", "wavelength-count")
    }
    assert len(keys["schemes"] & keys["wavelength-count"]) == 2  # simultaneous and holochrome-8


@pytest.mark.long
def test_a_margin_is_neither_optimised_nor_measured() -> None:
    """Outside the region the loss has no say: what is measured there doesn't enter the numbers."""
    whole, inner = (run_hologram_job({**TINY, **extra}, lambda _: None) for extra in ({}, {"margin": 0.25}))
    assert inner.numbers["psnr_db"] != whole.numbers["psnr_db"]
    assert whole.pictures["shown"].shape == (24, 32, 3)
    assert inner.pictures["wanted"].shape == inner.pictures["shown"].shape == (12, 16, 3)


def test_a_flat_target_is_sharp_at_the_middle_plane_only() -> None:
    system = job_system({**TINY, "planes": 3})
    flat, deep = (job_target(system, {**TINY, "depth": depth}, system.planes_m) for depth in (False, True))
    detail = [float(abs(plane[1:] - plane[:-1]).mean()) for plane in flat]
    assert detail[1] > detail[0] == pytest.approx(detail[2], rel=1e-5)
    assert (flat != deep).any()


def test_the_stack_can_be_deeper() -> None:
    assert job_system({**TINY, "range_mm": [6.0, 14.0]}).planes_m.tolist() == [6e-3, 14e-3]
    assert job_system({**TINY, "range_mm": [6.0, 14.0], "planes": 1}).planes_m.tolist() == [10e-3]
