"""Scale and displacement from probe pictures, on a bench as modelled, on a wrong one, and without any likeness."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from holoview.experiment.camera_loop.bench_camera import Picture, Shot
from holoview.experiment.camera_loop.camera_problem import (
    CameraCalibration,
    CameraProblem,
    calibrate_camera,
    probe_levels,
)
from holoview.experiment.rig_bench import lasers_of
from holoview.optimise.settings import Settings
from holoview.rig.description import RigDescription
from holoview.util.errors import UserError
from tests.experiment.camera_loop.conftest import PLANE_M, ModelCamera, system_on, target_on

MakeRig = Callable[..., RigDescription]
SCALE = 3e4
TWO = '["450 nm", "638 nm"]'


def _probes(rig: RigDescription, **options: object) -> tuple[torch.Tensor, list[list[Picture]]]:
    """The nominal prediction (wavelength, probe, y, x), and pictures of a bench; `bench`: its effects."""
    nominal = system_on(rig)
    bench = nominal.edit(options.pop("bench", {}))  # type: ignore[arg-type]
    camera = ModelCamera(bench, rig, scale=SCALE, **options)  # type: ignore[arg-type]
    levels = probe_levels(rig, 0)
    shots = [Shot(p, λ, PLANE_M) for λ in lasers_of(nominal, rig) for p in range(len(levels))]
    pictures = camera.record(levels, shots)
    problem = CameraProblem(nominal, target_on(nominal), Settings(), rig)
    strokes = torch.tensor([m.stroke_m for m in nominal.modulators])[:, None, None]
    paths = [torch.tensor(own / 255.0, dtype=torch.float32) * strokes for own in levels]
    predicted = torch.stack([problem.predict(path[None].float())[0] for path in paths], dim=1)
    return predicted, [pictures[i : i + len(levels)] for i in range(0, len(pictures), len(levels))]


def _calibrate(rig: RigDescription, **options: object) -> CameraCalibration:
    predicted, pictures = _probes(rig, **options)
    return calibrate_camera(rig, predicted[None], 4e-6, [pictures])


def test_of_a_bench_as_modelled_the_scale_is_exact_and_the_camera_stays(make_rig: MakeRig) -> None:
    found = _calibrate(make_rig(lasers=TWO))
    np.testing.assert_allclose(found.scale, SCALE, rtol=1e-5)
    assert not found.shift_m.any() and found.correlation == pytest.approx(1.0)
    assert found.notes(np.array([PLANE_M])) == []


@pytest.mark.parametrize("shift_um", [(6.0, -9.0), (-1.0, 0.5), (14.0, 3.0)])
def test_a_displaced_camera_is_found_to_a_tenth_of_a_pixel(make_rig: MakeRig, shift_um: tuple[float, float]) -> None:
    shift_m = (shift_um[0] * 1e-6, shift_um[1] * 1e-6)
    found = _calibrate(make_rig(), shift_m=shift_m)
    np.testing.assert_allclose(found.shift_m[0], shift_m, atol=0.4e-6)
    np.testing.assert_allclose(found.scale, SCALE, rtol=5e-3)


def test_a_wrong_bench_hardly_changes_the_scale(make_rig: MakeRig) -> None:
    """Modulators absorb nothing, so that a wrong gap only moves light: across edges and through the second iris."""
    found = _calibrate(make_rig(lasers=TWO), bench={"effects.gap.gap_error": 3e-4}, shift_m=(6e-6, -9e-6))
    np.testing.assert_allclose(found.scale, SCALE, rtol=0.05)
    np.testing.assert_allclose(found.shift_m[0], (6e-6, -9e-6), atol=2e-6)


def test_one_bad_probe_doesnt_move_the_scale(make_rig: MakeRig) -> None:
    rig = make_rig()
    predicted, pictures = _probes(rig)
    brighter = [[replace(pictures[0][0], light=pictures[0][0].light * 30), *pictures[0][1:]]]
    planes = [pictures, pictures, brighter]
    found = calibrate_camera(rig, torch.stack([predicted] * 3), 4e-6, planes)
    np.testing.assert_allclose(found.scale, SCALE, rtol=1e-5)


def test_saturated_pixels_dont_count(make_rig: MakeRig) -> None:
    rig = make_rig()
    predicted, pictures = _probes(rig)
    cut = []
    for picture in pictures[0]:
        saturated = picture.light > np.quantile(picture.light, 0.9)
        light = np.minimum(picture.light, np.quantile(picture.light, 0.9))
        cut.append(replace(picture, light=light, saturated=saturated))
    found = calibrate_camera(rig, predicted[None], 4e-6, [[cut]])
    np.testing.assert_allclose(found.scale, SCALE, rtol=1e-5)


def test_pictures_of_something_else_leave_the_camera_centred_and_say_so(make_rig: MakeRig) -> None:
    rig = make_rig()
    predicted, pictures = _probes(rig)
    rng = np.random.default_rng(5)
    other = [[replace(p, light=rng.random(p.light.shape)) for p in of_laser] for of_laser in pictures]
    found = calibrate_camera(rig, predicted[None], 4e-6, [other])
    assert not found.shift_m.any()
    assert "don't resemble" in found.notes(np.array([PLANE_M]))[0]


def test_a_laser_without_light_is_named(make_rig: MakeRig) -> None:
    rig = make_rig(lasers=TWO)
    predicted, pictures = _probes(rig)
    dark = [pictures[0], [replace(p, light=np.zeros_like(p.light)) for p in pictures[1]]]
    with pytest.raises(UserError, match="no light"):
        calibrate_camera(rig, predicted[None], 4e-6, [dark])
