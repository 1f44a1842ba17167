"""How much of the light is in the picture: against closed forms and sums by numpy's FFT, on all backends."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import holoview as hv
from holoview.light.engine.backend import open_executor
from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.light_behind import power_behind
from holoview.light.engine.light_share import light_shares, luminance_share
from holoview.light.engine.wgpu_executor import WgpuExecutor
from holoview.light.gpu.device import Device
from holoview.light.gpu.line_fft import STRATEGIES, Strategy, supported_strategies
from holoview.light.model.effects.registry import listed_effects
from holoview.light.model.field_band import edge_power
from holoview.light.model.plan import make_plan
from holoview.light.optics.frame_inputs import FrameInputs
from tests.explored import explored

λ, PITCH_M, N = 532e-9, 4e-6, 192
HALF_M = N * PITCH_M / 2
BACKENDS = ["torch64", "torch", pytest.param("wgpu", marks=pytest.mark.gpu)]
F32 = 2e-5  # sums of 1e5 squares that each have a few roundings of 6e-8, through FFTs: measured 1e-6
PHASES_ALONE = ("stroke", "lut", "slm_flatness", "dispersion", "slm1_fringes")


def _grid() -> tuple[NDArray[Any], NDArray[Any]]:
    axis = (np.arange(N) - (N - 1) / 2) * PITCH_M
    return axis[:, None], axis[None, :]


def _field(values: NDArray[Any]) -> hv.Hologram:
    return hv.load_field(values, pitch=PITCH_M, wavelengths=[λ])


def _small(**changes: Any) -> hv.System:
    return hv.load("holochrome-8").edit(
        {"shape": [24, 32], "wavelengths": ["460 nm", "638 nm"], "amplitudes": [[1.0, 2.0]]} | changes
    )


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("distance_m", "degrees"), [(5e-3, 0.0), (15e-3, 1.5), (20e-3, 1.0)])
def test_a_tilted_gaussian_beam_leaves_the_window_by_the_error_function(
    distance_m: float, degrees: float, backend: str
) -> None:
    """Along each axis ½·[erf(√2(h − c)/w) + erf(√2(h + c)/w)], w of the beam at z, c = z·tan θ; over that at z = 0.

    The tilt widens the diffraction part of the beam along x by 1/cos³θ − 1 = 1e-3, which changes w by up to 5e-5 and
    the share by a third of this.
    """
    waist_m, angle = 80e-6, math.radians(degrees)
    y, x = _grid()
    beam = np.exp(-(x**2 + y**2) / waist_m**2 + 2j * np.pi * math.sin(angle) / λ * x)
    view = hv.simulate(_field(beam), planes=[distance_m], backend=backend)
    wide_m = waist_m * math.hypot(1, λ * distance_m / (math.pi * waist_m**2))

    def inside(centre_m: float, radius_m: float) -> float:
        return sum(math.erf(math.sqrt(2) * (HALF_M + s * centre_m) / radius_m) for s in (-1, 1)) / 2

    expected = inside(distance_m * math.tan(angle), wide_m) * inside(0, wide_m) / inside(0, waist_m) ** 2
    assert view.light_in_picture.shape == (1, 1)
    assert float(view.light_in_picture[0, 0]) == pytest.approx(expected, abs=5e-5)
    assert any(note.startswith("light in the picture: ") for note in view.notes) == (expected < 0.9)


@pytest.mark.parametrize("degrees", [1.5, 2.5])
def test_light_through_an_opening_is_displaced_with_it(degrees: float) -> None:
    """Of an opening of half side a, displaced by c, the window of half side h holds (h + a − c)/2a.

    Of the light of an edge, λz/(2π²d) (a length along the edge's normal) has gone by diffraction beyond the distance d,
    the leading term of Fresnel's integrals; d is the distance of the window's edge from an edge of the shadow.
    """
    distance_m, opening_m, angle = 8e-3, 0.25e-3, math.radians(degrees)
    y, x = _grid()
    wave = (np.abs(x) < opening_m) * (np.abs(y) < opening_m) * np.exp(2j * np.pi * math.sin(angle) / λ * x)
    share = float(hv.simulate(_field(wave), planes=[distance_m], backend="torch64").light_in_picture[0, 0])
    moved_m = distance_m * math.tan(angle)
    apart = [abs(HALF_M - opening_m - moved_m), HALF_M - opening_m + moved_m, *[HALF_M - opening_m] * 2]
    diffracted = sum(λ * distance_m / (2 * math.pi**2 * d) for d in apart) / (2 * opening_m)
    assert diffracted < 0.02
    assert share == pytest.approx((HALF_M + opening_m - moved_m) / (2 * opening_m), abs=diffracted)


@pytest.mark.parametrize(
    "changes",
    [{}, {"relay2.square": "first order"}, {"relay2.iris_na": 0.01, "relay2.centre_na": [0.0, 0.004]}, {"eye": {}}],
)
def test_the_light_behind_is_that_of_the_spectrum_which_passes(changes: dict[str, Any]) -> None:
    """Against numpy's FFT of the field behind the last modulator, in the directions that pass."""
    system = _small(**{"relay2.square": "none"} | changes)
    drive = hv.random_drive(system, seed=2)
    plan = make_plan(system, ["10 mm"])
    found = power_behind(plan, drive)
    for laser, power in enumerate([1.0, 2.0]):
        behind = hv.field_at(system, drive, stage="slm2", laser=laser).values
        spectrum = np.abs(np.fft.fft2(behind, s=plan.grid.padded)) ** 2
        wavelength_m = float(system.wavelengths_m[laser])
        sine_y, sine_x = np.meshgrid(
            *(wavelength_m * np.fft.fftfreq(n, plan.grid.pitch_m) for n in plan.grid.padded), indexing="ij"
        )
        passes = np.ones(sine_y.shape, bool)
        if "relay2.square" in changes:
            edge = wavelength_m / (2 * system.modulators[0].pitch_m) * (1 - 1e-9)
            passes = np.maximum(np.abs(sine_y), np.abs(sine_x)) < edge
        if "relay2.iris_na" in changes:
            passes = np.hypot(sine_y, sine_x - 0.004) <= 0.01
        if "eye" in changes:
            assert system.eye is not None
            passes = np.hypot(sine_y, sine_x) <= system.eye.pupil_na(system.field_m)
        expected = power * spectrum[passes].sum() / spectrum.size
        assert found[laser] == pytest.approx(expected, rel=F32)


def test_without_stops_no_transform_is_needed() -> None:
    system = hv.load("holochrome-8-1slm-open").with_(shape=[24, 32], frames=2)
    plan, drive = make_plan(system), hv.random_drive(system, seed=3)
    shares = light_shares(plan, drive, np.zeros((len(plan.planes_m), 8, *plan.grid.shape), np.float32))
    np.testing.assert_allclose(shares.behind, power_behind(plan, drive), rtol=F32)
    assert shares.plain_behind is not None and shares.by_plane.max() == 0.0
    field = _field(np.random.default_rng(0).normal(size=(N, N)) + 1j)
    plan = make_plan(field.system)
    plain = light_shares(plan, field.drive, np.zeros((1, 1, N, N))).behind
    np.testing.assert_allclose(plain, power_behind(plan, field.drive), rtol=F32)


@pytest.mark.parametrize(
    "changes", [{}, {"relay2.iris_na": 0.02}, {"eye": {}, "planes": ["9 mm"]}, {"effects.aberration2.z5": "300 nm"}]
)
def test_the_power_that_an_executor_measures_beside_a_frame_is_that_of_the_spectrum(changes: dict[str, Any]) -> None:
    system = _small(**changes)
    plan, drive = make_plan(system), hv.random_drive(system, seed=5)
    executor, _ = open_executor(plan, drive, "torch", measures_power=True)
    compute_focal_stack(executor)
    assert executor.power_behind is not None
    np.testing.assert_allclose(executor.power_behind, power_behind(plan, drive), rtol=F32)
    assert open_executor(plan, drive, "torch")[0].power_behind is None


@pytest.mark.gpu
@pytest.mark.parametrize(
    "changes", [{}, {"relay2.iris_na": 0.02}, {"frames": 2, "source": {"directions": [[0, 0.01]]}}]
)
def test_both_backends_find_the_same_shares(changes: dict[str, Any]) -> None:
    system = _small(**changes) if "frames" not in changes else hv.load("holochrome-8x3").with_(shape=[24, 32])
    drive = hv.random_drive(system, seed=5)
    one, other = (
        hv.simulate(system, drive, ["1 mm", "20 mm"], backend=backend).light_in_picture for backend in ("torch", "wgpu")
    )
    np.testing.assert_allclose(one, other, rtol=F32)
    assert np.all(one[0] > one[1])  # the farther plane has lost more


@pytest.mark.gpu
@pytest.mark.parametrize("strategy", explored(STRATEGIES, 1))
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"relay2.iris_na": 0.02},
        {"eye": {}, "planes": ["9 mm"]},
        {"effects.aberration2.z5": "300 nm", "relay2.apodisation_na": 0.05},
        {"source": {"directions": [[0, 0.01], [0.01, 0]]}},
    ],
)
def test_shaders_measure_the_power_behind_the_last_modulator_as_pytorch_does(
    device: Device, strategy: Strategy, changes: dict[str, Any]
) -> None:
    """In every order in which the strategies leave the spectrum."""
    plan, drive = make_plan(_small(**changes), ["20 mm"]), hv.random_drive(_small(**changes), seed=5)
    if strategy not in supported_strategies(device, plan.grid.padded):
        pytest.skip("not on this adapter")
    executor = WgpuExecutor(plan, FrameInputs(plan, drive), device, measures_power=True)
    executor.fused.use_strategy(strategy)
    compute_focal_stack(executor)
    assert executor.power_behind is not None
    np.testing.assert_allclose(executor.power_behind, power_behind(plan, drive), rtol=F32)


@pytest.mark.long
@pytest.mark.gpu
def test_a_render_of_light_that_leaves_the_picture_loads_no_pytorch(tmp_path: Path) -> None:
    code = "import sys\nfrom holoview.commands.cli import main\nassert main() == 0 and 'torch' not in sys.modules"
    command = ["render", "holochrome-8", "--set", "shape=[48, 64]", "--random", "0", "--plane", "20mm", "-o", "it.png"]
    result = subprocess.run([sys.executable, "-c", code, *command], cwd=tmp_path, capture_output=True, text=True)
    assert "light in the picture: " in result.stdout + result.stderr, result.stderr
    assert result.returncode == 0


@pytest.mark.parametrize("name", list(listed_effects()))
def test_no_effect_makes_light_that_is_not_there(name: str) -> None:
    """With every effect at its usual size."""
    values = {p.name: p.nudged(1.0) for p in listed_effects()[name].parameters}
    system = _small(**{f"effects.{name}": values})
    view = hv.simulate(system, hv.random_drive(system, seed=1), ["5 mm"], backend="torch")
    assert np.all((view.light_in_picture > 0) & (view.light_in_picture <= 1))


@pytest.mark.parametrize("effect", PHASES_ALONE)
def test_effects_on_phases_change_no_power_behind_the_modulator(effect: str) -> None:
    system = hv.load("holochrome-8-1slm-open").with_(shape=[24, 32])
    drive = hv.random_drive(system, seed=1)
    values = {"slm_flatness": {"z5_1": "200 nm"}, "stroke": {"stroke_error": 0.05}}.get(effect, {})
    plain, changed = (power_behind(make_plan(s), drive) for s in (system, system.edit({"effects": {effect: values}})))
    np.testing.assert_allclose(changed, plain, rtol=F32)


def test_a_share_is_of_the_whole_picture_and_of_no_exposure() -> None:
    field = _field(np.exp(-sum(axis**2 for axis in _grid()) / (80e-6) ** 2) + 0j)
    view = hv.simulate(field, planes=["1 mm", "40 mm"], backend="torch")
    for changed in (view.exposed(3.0), view.cropped((5, 5, 20, 20))):
        np.testing.assert_array_equal(changed.light_in_picture, view.light_in_picture)
    np.testing.assert_array_equal(view.at([1]).light_in_picture, view.light_in_picture[1:])
    luminance = luminance_share(make_plan(field.system, ["40 mm"]), field.drive, view.xyz[1])
    assert luminance == pytest.approx(float(view.light_in_picture[1, 0]), rel=F32)
    dark = _field(np.zeros((16, 16), complex))
    assert np.isnan(hv.simulate(dark, backend="torch").light_in_picture).all()


@pytest.mark.parametrize(("steepest", "is_told"), [(0.3, False), (0.5, False), (0.7, True)])
def test_a_field_that_reaches_the_edge_of_its_band_is_told(steepest: float, is_told: bool) -> None:
    """A lens whose fringes have so many cycles a sample at the edges of its round aperture: up to ½ they are sampled.

    The spectrum is a picture of the disc, of which 2/π·(acos 0.9 − 0.9·√0.19) = 3.7 % lie beyond 0.9 of the radius
    along an axis. Of 0.7, the outer ring, half of the light, is aliased into the band.
    """
    y, x = (np.arange(N) - (N - 1) / 2 for _ in range(2))
    square = y[:, None] ** 2 + x**2
    lens = np.exp(-1j * np.pi * square * steepest / (N / 2)) * (square <= (N / 2) ** 2)
    field = _field(lens)
    share = edge_power(field.drive)
    assert share is not None
    notes = hv.simulate(field, planes=["2 mm"], backend="torch").notes
    assert any(note.startswith("band of the field: ") for note in notes) == is_told == (share > 0.05)
    assert not any(note.startswith("band of") for note in hv.simulate(field, planes=[0.0], backend="torch").notes)


def test_the_share_at_the_edge_is_that_of_the_spectrum() -> None:
    """Of light at 0.2 and, with a fifth of the power, 0.48 cycles a sample along y: whole periods of 200 samples."""
    y = np.arange(200)[:, None]
    wave = 2 * np.exp(2j * np.pi * 0.2 * y) + np.exp(2j * np.pi * 0.48 * y)
    assert edge_power(np.broadcast_to(wave, (1, 1, 200, 300))) == pytest.approx(0.2, rel=1e-6)
    assert edge_power(np.exp(2j * np.pi * 0.5 * np.broadcast_to(y, (1, 1, 200, 8)))) is None  # phases alone
    assert edge_power(np.zeros((1, 1, 8, 8), complex)) is None
