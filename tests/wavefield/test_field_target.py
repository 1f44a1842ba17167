"""A field as a target: its light on a display's planes and samples, and holograms that are optimised to show it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import holoview as hv
from holoview.commands.cli import main
from holoview.light.colour import xyz_to_linear_srgb
from holoview.light.model import preset
from holoview.light.model.system import System
from holoview.util.errors import UserError


@pytest.fixture
def system() -> System:
    lasers = {"wavelengths": ["450 nm", "530 nm", "620 nm"], "amplitudes": "white"}
    two = hv.load("holochrome-8").edit({"shape": [24, 32], "planes": ["3 mm", "6 mm"], **lasers})
    return two.with_(modulators=two.modulators[:1], gap=None, relay2={}, relay1={})


def test_the_light_is_that_of_the_bench_whose_field_it_is(system: System) -> None:
    hologram = hv.Hologram(hv.random_drive(system), system.edit({"padding": 8}))
    expected = xyz_to_linear_srgb(hv.simulate(hologram, backend="torch64").xyz)
    found = hv.as_field(hologram).scene().images(system, system.planes_m)
    # light that walks off by more than the padding is left out by one and faded out by the other: 1e-3 of it here
    np.testing.assert_allclose(found, expected, atol=3e-3 * expected.max())


def test_an_eye_sees_the_light_of_the_bench_whose_field_it_is(system: System) -> None:
    """Through a pupil aside, with chromatic aberration: an independent path through the executor's stages."""
    eye = {"eye": {"pupil": "1 mm", "pupil_x": "0.3 mm"}}
    hologram = hv.Hologram(hv.random_drive(system), system.edit({"padding": 8}))
    expected = xyz_to_linear_srgb(hv.simulate(hologram.system.edit(eye), hologram.drive, backend="torch64").xyz)
    found = hv.as_field(hologram).scene().images(system.edit({"padding": 8, **eye}), system.planes_m)
    np.testing.assert_allclose(found, expected, atol=1e-5 * expected.max())  # the field is stored in complex64


def test_its_plane_and_pitch_may_be_any(system: System) -> None:
    """A Gaussian beam is widest by √(1 + (z/z_R)²) at a distance z from its waist, wherever its samples are."""
    waist, pitch_m, λ = 40e-6, 5e-6, 530e-9
    y, x = np.mgrid[-64:64, -64:64] * pitch_m + pitch_m / 2
    beam = np.exp(-(y**2 + x**2) / waist**2).astype(np.complex64)
    scene = hv.load_field(beam, pitch=pitch_m, wavelengths=[λ]).scene("5 mm")
    stack = scene.images(system.edit({"observer": "mono"}), np.array([3e-3, 5e-3, 9e-3]))
    v, u = ((np.arange(n) - (n - 1) / 2) * 4e-6 for n in stack.shape[1:3])
    for image, z in zip(stack[..., 0], (-2e-3, 0.0, 4e-3), strict=True):
        growth = 1 + (z * λ / (np.pi * waist**2)) ** 2
        expected = np.exp(-2 * (v[:, None] ** 2 + u**2) / (waist**2 * growth)) / growth
        np.testing.assert_allclose(image / stack[1].max(), expected / expected.max() / growth, atol=2e-3)


def test_a_hologram_is_optimised_for_it(system: System, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The light of a hologram can be shown by a hologram: the bench's own is as far from the target as rounding."""
    hv.as_field(hv.Hologram(hv.random_drive(system), system)).save(tmp_path / "field.safetensors")
    found, bench = tmp_path / "found.safetensors", tmp_path / "bench.toml"
    hv.Hologram(hv.random_drive(system, seed=1), system).save(tmp_path / "start.safetensors")
    bench.write_text(preset.dumps(system))
    arguments = ["optimise", str(bench), str(tmp_path / "field.safetensors"), "--iterations", "40", "-o", str(found)]
    assert main([*arguments, "--device", "cpu"]) == 0
    capsys.readouterr()
    target = hv.load_field(tmp_path / "field.safetensors").scene().images(system, system.planes_m)

    def psnr_db(hologram: hv.Hologram) -> float:
        light = xyz_to_linear_srgb(hv.simulate(hologram, backend="torch").xyz)
        return float(-10 * np.log10(np.mean((light.clip(0, 1) - target.clip(0, 1)) ** 2)))

    random = psnr_db(hv.load_hologram(tmp_path / "start.safetensors"))
    assert psnr_db(hv.load_hologram(found)) > random + 3


def test_what_cannot_be_shown_is_said(system: System) -> None:
    scene = hv.load_field(np.ones((8, 8), np.complex64), pitch="8 um", wavelengths=["530 nm"]).scene()
    with pytest.raises(UserError, match="fields: with an eye"):
        scene.fields(system.edit({"eye": {}}), 3e-3)
    with pytest.raises(UserError, match="patterns of a modulator"):
        hv.Hologram(hv.random_drive(system), system).scene()
