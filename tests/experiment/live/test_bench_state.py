"""Patterns for a rig: levels of drives, other shapes refused, files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from holoview.bench.experiment.rig_bench import system_of_rig
from holoview.bench.rig.description import RigDescription, read_rig
from holoview.holograms.hologram import Hologram
from holoview.util.errors import UserError
from holoview.viewer.document.rig_session import drive_pattern, file_pattern, flat_pattern, random_pattern
from tests.experiment.live.fake_bench import write_rig


@pytest.fixture
def rig(tmp_path: Path) -> RigDescription:
    return read_rig(write_rig(tmp_path))


def test_a_drive_is_rounded_to_the_nearest_levels(rig: RigDescription) -> None:
    drive = np.linspace(0.0, 1.0, 24 * 32).reshape(1, 24, 32)
    levels = drive_pattern(rig, drive[None], "ramp").levels
    assert levels.dtype == np.uint8 and levels.min() == 0 and levels.max() == 255
    assert np.abs(levels / 255 - drive).max() <= 0.5 / 255 + 1e-12


def test_a_drive_of_another_shape_is_refused_with_what_to_do(rig: RigDescription) -> None:
    with pytest.raises(UserError, match="bench of the rig"):
        drive_pattern(rig, np.zeros((1, 2, 24, 32)), "the viewer's")


def test_flat_and_random_patterns_have_the_modulators_shape(rig: RigDescription) -> None:
    assert np.unique(flat_pattern(rig, 0.5).levels).tolist() == [128]
    pattern = random_pattern(rig, 2.0, 5).levels
    assert pattern.shape == (1, 24, 32) and np.array_equal(pattern, random_pattern(rig, 2.0, 5).levels)


def test_a_hologram_file_is_sent_as_it_was_saved(rig: RigDescription, tmp_path: Path) -> None:
    system = system_of_rig(rig)
    drive = np.random.default_rng(0).random(system.drive_shape, dtype=np.float32)
    Hologram(drive, system).save(tmp_path / "h.safetensors")
    sent = file_pattern(rig, tmp_path / "h.safetensors")
    assert np.array_equal(sent.levels, np.rint(drive[0].astype(np.float64) * 255).astype(np.uint8))
