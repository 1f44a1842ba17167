"""Perceptual scores by name: which are installed, the visual angle they are given, and how they are printed."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import holoview as hv
from holoview.metrics.perceptual import flip, measure_perceptual_scores, ms_ssim
from holoview.metrics.perceptual_scores import (
    PERCEPTUAL_SCORES,
    installed_scores,
    require_scores,
    usable_scores,
)
from holoview.model.eye import sample_degrees
from holoview.util.errors import UserError
from tests.speckled import PATTERNS, picture, speckled


def test_ms_ssim_rises_as_the_contrast_of_speckle_falls() -> None:
    target = picture(192, 256)
    found = [ms_ssim(speckled(target, n), target) for n in PATTERNS]
    assert {one.scales for one in found} == {5}
    assert all(more.mean > less.mean + 0.03 for less, more in pairwise(found)), found


def test_the_visual_angle_is_that_of_the_eyepiece_and_without_an_eye_that_of_40_mm() -> None:
    system = hv.load("holochrome-8").with_(shape=[16, 16])
    stack = np.full((1, 32, 32, 3), 0.5)
    without = hv.simulate(system, hv.random_drive(system), planes=["10 mm"], backend="torch")
    for eyepiece, density in ((None, 174.533), ("40 mm", 174.533), ("20 mm", 87.266)):  # π/180·f/(4 µm)
        angle = None if eyepiece is None else sample_degrees(without.pitch_m, hv.Eye(eyepiece_m=eyepiece).eyepiece_m)
        found = measure_perceptual_scores(replace(without, degrees_per_sample=angle), stack, ["ms_ssim", "flip"])
        assert found["flip"].mean == pytest.approx(flip(without.rgb, stack, density).mean, rel=1e-4)
        assert found["ms_ssim"] == ms_ssim(without.rgb, stack)


def test_a_score_whose_library_is_absent_is_not_installed_and_names_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    monkeypatch.setitem(sys.modules, "pycvvdp", None)
    assert installed_scores() == ("ms_ssim",)
    require_scores(["ms_ssim"])
    for name, title in (("flip", "FLIP"), ("jod", "ColorVideoVDP")):
        with pytest.raises(UserError, match=rf"{title}.*isn't installed.*holoview\[perceptual\]"):
            require_scores([name])


def test_a_library_that_does_not_load_is_reported_and_left_out(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "pycvvdp.py").write_text('raise RuntimeError("operator torchvision::nms does not exist")\n')
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pycvvdp", raising=False)
    assert "jod" in installed_scores()
    lines: list[str] = []
    assert "jod" not in usable_scores(lines.append)
    (line,) = lines
    assert "pycvvdp can't be loaded: operator torchvision::nms does not exist" in line


def test_a_score_is_printed_with_its_name_and_unit() -> None:
    texts = [score.format(value) for score, value in zip(PERCEPTUAL_SCORES.values(), (0.5634, 0.1, 7.456), strict=True)]
    assert texts == ["MS-SSIM 0.563", "FLIP 0.100", "ColorVideoVDP 7.46 JOD"]
