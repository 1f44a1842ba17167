"""Pictures of the holograms that are open: each of its scene, within the memory that is allowed, errors told once."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.holograms.view import random_drive, simulate
from holoview.light.gpu.device import Device
from holoview.util.errors import UserError
from holoview.viewer.render import kept_pictures
from holoview.viewer.render.kept_pictures import KeptPictures
from holoview.viewer.render.scene import Scene
from holoview.viewer.render.view_settings import ComparisonSide
from tests.gui.conftest import small_bench

pytestmark = pytest.mark.gpu
A, B = ComparisonSide("snapshot", "a"), ComparisonSide("snapshot", "b")


def _scene(seed: int, **changes: object) -> Scene:
    system = small_bench(shape=[16, 24], **changes)
    drive = random_drive(system, seed=seed).astype(np.float32)
    return Scene(system, drive, 10e-3)


def _complete(kept: KeptPictures) -> None:
    for _ in range(10_000):
        if not kept.is_busy:
            return
        kept.compute_slice()
    raise AssertionError("it never ends")


def test_each_picture_is_that_of_its_scene(device: Device) -> None:
    scenes = {A: _scene(1), B: _scene(2, gap=4e-3)}
    kept = KeptPictures(device)
    kept.request(scenes)
    _complete(kept)
    for side, scene in scenes.items():
        expected = simulate(scene.system, scene.drive, planes=[scene.plane_m]).xyz[0]
        np.testing.assert_allclose(kept.xyz(side, scene), expected, atol=2e-4 * expected.max())
        assert kept.picture(side, scene) is not None
    moved = Scene(scenes[A].system, scenes[A].drive, 11e-3)
    assert kept.picture(A, moved) is None and kept.xyz(A, moved) is None, "of another plane"
    kept.request({A: moved})
    assert kept.is_busy and kept.picture(A) is not None, "the old one stays in the strip meanwhile"
    _complete(kept)
    assert kept.picture(A, moved) is not None and kept.picture(B) is None, "what isn't open any more is forgotten"
    kept.close()


def test_pictures_beyond_the_memory_are_left_out(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_pictures, "MOST_BYTES", 32 * 48 * 16)  # one of 16 × 24 pixels with two samples a pixel
    kept, scenes = KeptPictures(device), {A: _scene(1), B: _scene(2)}
    kept.request(scenes)
    _complete(kept)
    assert kept.picture(A, scenes[A]) is not None and kept.picture(B) is None
    kept.close()


def test_an_impossible_scene_is_told_once(device: Device) -> None:
    scene = _scene(1)
    wrong = Scene(scene.system, scene.drive[..., :-1], scene.plane_m)
    kept = KeptPictures(device)
    kept.request({A: wrong, B: scene})
    with pytest.raises(UserError):
        _complete(kept)
    _complete(kept)
    assert kept.picture(A) is None and kept.picture(B, scene) is not None
    kept.close()
