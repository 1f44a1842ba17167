"""slmsuite's own code on the virtual bench: its Fourier, settling and wavefront calibrations find what is hidden there.

Time on the bench is simulated: what slmsuite sleeps passes on the bench, so that no result depends on the machine.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import slmsuite
from numpy.typing import NDArray
from scipy.optimize import curve_fit
from slmsuite.hardware.cameraslms import FourierSLM
from slmsuite.holography.toolbox.phase import blaze

from holoview.bench.rig import open_rig, read_rig
from holoview.bench.rig.devices import DeviceError
from holoview.bench.rig.virtual.client import VirtualBenchProcess
from holoview.bench.rig.virtual.slmsuite_devices import VirtualCamera, VirtualSLM
from holoview.util.errors import UserError
from tests.rig.test_chain_rig import write_chain_rig

WAVELENGTH_M, FOCAL_LENGTH_M, SIDE, PITCH_M = 520e-9, 60e-3, 128, 16e-6
TIME_CONSTANT_S = 0.05
RIG = """
[slm1]
device = "virtual"
shape = [128, 128]
pitch = "8 um"
num_levels = 256
opd_range = "517.96875 nm"          # 255/256 of the wavelength
[camera]
device = "virtual"
shape = [{camera}, {camera}]
pitch = "{pitch} um"
bit_depth = 12
electrons_per_count = 4.0
read_noise = 3.0
black_level = 0
[lasers]
device = "virtual"
wavelengths = ["520 nm"]
[stage]
device = "virtual"
range = ["-1 mm", "1 mm"]
[limits]
power = 1.0
exposure = [1e-7, 0.5]
[geometry]
focal_length = "60 mm"
[virtual]
bench = "hidden.toml"
"""
REST = """
class Lasers:
    wavelengths_m = (520e-9,)
    def switch_on(self, wavelength_m, power): pass
    def switch_off(self): pass
    def close(self): pass

class Stage:
    range_m = (-1e-3, 1e-3)
    def move_to(self, distance_m): return distance_m
    def close(self): pass
"""


@contextmanager
def _open_bench(folder: Path, hidden: str) -> Iterator[FourierSLM]:
    """A bench on which this is hidden, Fourier calibrated by slmsuite; what slmsuite sleeps passes on the bench."""
    slmsuite.configure_logging("ERROR")
    np.random.seed(1)  # noqa: NPY002 - slmsuite draws from numpy's global generator
    file = folder / "rig.toml"
    file.write_text(RIG.format(camera=256, pitch=16), encoding="utf-8")
    (folder / "hidden.toml").write_text(f"seed = 3\n{hidden}", encoding="utf-8")
    slm = VirtualSLM(file, live=False)
    camera = VirtualCamera(file, address=slm.address, token=slm.token, live=False)
    with closing(slm), closing(camera):
        fourier = FourierSLM(camera, slm)
        slm.settle_time_s = 10 * TIME_CONSTANT_S
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(time, "sleep", slm.wait)
            fourier.fourier_calibrate(array_shape=8, array_pitch=8, autoexpose=True, verbose=False)
        yield fourier


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FourierSLM]:
    """A bench whose camera stands where it shouldn't, and whose modulator takes time to settle."""
    hidden = (
        f"settle = {TIME_CONSTANT_S}\n[effects.camera_alignment]\n"
        'shift_y = "80 um"\nshift_x = "-48 um"\nrotation = "30 mrad"\nmagnification = 0.02'
    )
    with _open_bench(tmp_path_factory.mktemp("calibrated"), hidden) as fourier:
        yield fourier


def _tilt_free(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """A map without its mean and its tilt."""
    y, x = np.mgrid[: len(phase), : len(phase)]
    design = np.stack([np.ones(phase.size), x.ravel(), y.ravel()], axis=1)
    return phase - (design @ np.linalg.lstsq(design, phase.ravel(), rcond=None)[0]).reshape(phase.shape)


def _wavefront_nm(terms: Mapping[int, float]) -> NDArray[np.float64]:
    """Defocus, astigmatism and coma (Noll 4, 5, 7) over the circle around the modulator."""
    y, x = (np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2) / (SIDE / math.sqrt(2))
    r, angle = np.hypot(x, y), np.arctan2(y, x)
    polynomials = {
        4: math.sqrt(3) * (2 * r**2 - 1),
        5: math.sqrt(6) * r**2 * np.sin(2 * angle),
        7: math.sqrt(8) * (3 * r**3 - 2 * r) * np.sin(angle),
    }
    return sum((nm * polynomials[noll] for noll, nm in terms.items()), np.zeros((SIDE, SIDE)))


def test_its_fourier_calibration_finds_where_the_camera_is(calibrated: FourierSLM) -> None:
    """ij = (1 + m)·f/p·R(θ)·k + centre + shift/p, from θ, m and the shift that are hidden.

    slmsuite fits the centroids of 8 × 8 spots, 15.6 pixels apart. Light between them, which interferes with a spot's
    own, moves each by some tenths of a pixel, which is less than 1 % of the slope over 109 pixels.
    """
    scale, (c, s) = 1.02 * FOCAL_LENGTH_M / PITCH_M, (math.cos(30e-3), math.sin(30e-3))
    found = np.array(calibrated.calibrations["fourier"]["M"])
    np.testing.assert_allclose(found, scale * np.array([[c, -s], [s, c]]), atol=0.01 * scale)
    np.testing.assert_allclose(np.ravel(calibrated.kxyslm_to_ijcam([0, 0])), (127.5 - 3, 127.5 + 5), atol=0.5)


def test_its_settling_calibration_finds_what_a_path_that_relaxes_exponentially_gives(
    calibrated: FourierSLM, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Path = (1 − e^(−t/τ))·sawtooth: the first order of such a blaze has the efficiency sinc²(e^(−t/τ)).

    slmsuite fits an exponential to its power, in a window that sidelobes of the zeroth order reach, with about 2 %. The
    same fit to the curve in closed form is what it must find.
    """
    τ = TIME_CONSTANT_S
    times = np.linspace(0.0, 8 * τ, 17)
    monkeypatch.setattr(time, "sleep", calibrated.slm.wait)
    found = calibrated.settle_calibrate(vector=(0.01, 0.01), times=times, plot=-1)
    efficiency = np.sinc(np.exp(-times / τ)) ** 2

    def curve(t: NDArray[np.float64], t0: float, a: float, b: float, c: float) -> NDArray[np.float64]:
        return np.where(t < t0, c - a, c - a * np.exp(-(t - t0) / b))

    bounds = ((0.0, 0.0, 1e-6, 0.0), (times[-1], np.inf, times[-1], np.inf))
    start = (0.0, 1.0, times[-1] / 10, 1.0)
    delay_s, _, relaxation_s, _ = curve_fit(curve, times, efficiency, p0=start, bounds=bounds)[0]
    np.testing.assert_allclose(found["data"] / np.max(found["data"]), efficiency, atol=0.03)
    assert found["relax_time"] == pytest.approx(relaxation_s, rel=0.1)
    assert found["settle_time"] == pytest.approx(delay_s + 4 * relaxation_s, rel=0.1)


@pytest.mark.slow
def test_its_wavefront_calibration_finds_that_the_modulator_is_not_flat(tmp_path: Path) -> None:
    """With 8 × 8 superpixels. What is left after its correction, without tilt, is below a fifth of what is hidden.

    Between the middles of superpixels, 1/8 of the width apart, slmsuite interpolates and smooths: of a wavefront that
    is quadratic over the width, and at the edge, that costs about a tenth (0.12 was measured).
    """
    hidden_nm = {4: 60.0, 5: -50.0, 7: 30.0}
    terms = "\n".join(f'z{noll}_1 = "{value} nm"' for noll, value in hidden_nm.items())
    with _open_bench(tmp_path, f"[effects.slm_flatness]\n{terms}") as fourier:
        _check_wavefront(fourier, _tilt_free(2 * np.pi / (1e9 * WAVELENGTH_M) * _wavefront_nm(hidden_nm)))


def _check_wavefront(fourier: FourierSLM, hidden: NDArray[np.float64]) -> None:
    """Calibrates the wavefront at one point; hidden: the modulator's, rad."""
    slm, camera = fourier.slm, fourier.cam
    vector = (0.018, 0.006)
    slm.set_phase(blaze(slm, vector))
    exposure_s = camera.autoexpose(set_fraction=0.4)
    before = int(camera.get_image().max())
    camera.set_exposure(200 * exposure_s)  # a superpixel is 1/64 of the modulator
    point = fourier.kxyslm_to_ijcam(vector)
    fourier.wavefront_calibrate_superpixel(point, superpixel_size=16, field_point=(-0.02, 0.0), plot=-1)
    fourier.wavefront_calibration_superpixel_process(r2_threshold=0.5)
    correction = _tilt_free(np.asarray(slm.source["phase"], np.float64))
    assert np.std(hidden) > 0.7
    assert np.std(hidden + correction) < 0.2 * np.std(hidden)
    camera.set_exposure(exposure_s)
    slm.set_phase(blaze(slm, vector), phase_correct=True)
    strehl = abs(np.mean(np.exp(1j * hidden))) ** 2
    assert camera.get_image().max() / before == pytest.approx(1 / strehl, rel=0.1)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, VirtualBenchProcess]]:
    """A bench that runs, and its rig.toml."""
    file = tmp_path_factory.mktemp("bench") / "rig.toml"
    file.write_text(RIG.format(camera=128, pitch=16), encoding="utf-8")
    (file.parent / "hidden.toml").write_text("seed = 3\n", encoding="utf-8")
    process = VirtualBenchProcess(file)
    yield file, process
    process.close()


def test_a_blaze_goes_where_its_vector_points_and_the_laser_is_off_when_the_modulator_is_closed(
    bench: tuple[Path, VirtualBenchProcess],
) -> None:
    """A blaze of k, in units of sines, puts the spot at f·k behind the lens: here 10 pixels in x and −5 in y."""
    file, process = bench
    there: dict[str, Any] = {"address": process.address, "token": process.token}
    slm, camera = VirtualSLM(file, power=0.5, **there), VirtualCamera(file, **there)
    slm.set_phase(blaze(slm, (10.5 * PITCH_M / FOCAL_LENGTH_M, -5.5 * PITCH_M / FOCAL_LENGTH_M)))
    camera.autoexpose()
    lit = camera.get_image()
    assert np.unravel_index(int(lit.argmax()), lit.shape) == (64 - 6, 64 + 10)
    slm.close()
    assert camera.get_image().max() < 20 < lit.max()  # read noise is 3 electrons, less than a count
    camera.close()


def test_slmsuites_own_checks_of_hardware_pass(bench: tuple[Path, VirtualBenchProcess]) -> None:
    file, process = bench
    there: dict[str, Any] = {"address": process.address, "token": process.token}
    with closing(VirtualSLM(file, **there)) as slm, closing(VirtualCamera(file, **there)) as camera:
        camera.set_exposure(1e-5)  # so that it isn't saturated
        assert slm.test() and camera.test()


def test_raw_levels_are_shown_as_they_are(bench: tuple[Path, VirtualBenchProcess]) -> None:
    """Through the kind "slmsuite": a grating of levels 0 and 128, half a wave, has no zeroth order."""
    file, process = bench
    arguments = f'{{ rig = "{file}", address = ["127.0.0.1", {process.address[1]}], token = "{process.token}" }}'
    text = file.read_text(encoding="utf-8")
    for name, kind in (("slm1", "VirtualSLM"), ("camera", "VirtualCamera")):
        place = f"holoview.bench.rig.virtual.slmsuite_devices.{kind}"
        own = f'device = "slmsuite"\nclass = "{place}"\narguments = {arguments}'
        text = text.replace(f'[{name}]\ndevice = "virtual"', f"[{name}]\n{own}")
    for name in ("lasers", "stage"):
        own = f'device = "python"\nfile = "rest.py"\nclass = "{name.title()}"'
        text = text.replace(f'[{name}]\ndevice = "virtual"', f"[{name}]\n{own}")
    (file.parent / "rest.py").write_text(REST, encoding="utf-8")
    other = file.parent / "through-slmsuite.toml"
    other.write_text(text, encoding="utf-8")
    grating = np.zeros((SIDE, SIDE), np.uint8)
    with open_rig(read_rig(other)) as devices:
        devices.camera.set_exposure(1e-4)
        devices.modulators[0].show(grating)
        flat = devices.camera.take().astype(np.int64)
        grating[:, 1::2] = 128
        devices.modulators[0].show(grating)
        split = devices.camera.take().astype(np.int64)
    assert flat[62:66, 62:66].sum() > 1000
    assert split[62:66, 62:66].sum() < 0.02 * flat[62:66, 62:66].sum()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"wavelength_nm": 633.0}, "wavelength_nm: 633; expected one of 520, the lasers of"),
        ({"number": 2}, "number: 2; expected 1 … 1"),
        ({"power": 1.5}, r"power: 1\.5; expected 0 … 1"),
    ],
)
def test_what_the_bench_does_not_have_or_allow_is_refused(
    bench: tuple[Path, VirtualBenchProcess], arguments: dict[str, Any], message: str
) -> None:
    file, process = bench
    with pytest.raises(UserError, match=message):
        VirtualSLM(file, address=process.address, token=process.token, **arguments)


def test_a_wrong_token_is_refused(bench: tuple[Path, VirtualBenchProcess]) -> None:
    file, process = bench
    with pytest.raises(DeviceError, match="virtual bench: is gone"):
        VirtualCamera(file, address=process.address, token="guessed")
    with pytest.raises(UserError, match="virtual bench: address or token alone"):
        VirtualCamera(file, address=process.address)


def test_exposures_stay_within_the_safety_limits(bench: tuple[Path, VirtualBenchProcess]) -> None:
    file, process = bench
    camera = VirtualCamera(file, address=process.address, token=process.token)
    assert camera.set_exposure(3.0) == 0.5  # slmsuite clips to the bounds
    with pytest.raises(UserError, match="exposure: 3 s"):
        camera._set_exposure_hw(3.0)
    camera.close()


@pytest.mark.long
def test_phase_modulators_of_a_chain_are_slmsuites_and_those_of_amplitude_are_not(tmp_path: Path) -> None:
    file = write_chain_rig(tmp_path, {"virtual": {"seed": 3}})
    slm = VirtualSLM(file, live=False)
    camera = VirtualCamera(file, address=slm.address, token=slm.token, live=False)
    with closing(slm), closing(camera):
        assert tuple(slm.shape) == (24, 32) and slm.name == "virtual phase"
        camera.set_exposure(1e-3)
        slm.set_phase(np.linspace(0, np.pi, 32)[None, :] * np.ones((24, 1)))
        slm.wait(1.0)
        assert camera.get_image().max() > 100
    with pytest.raises(UserError, match="coarse: an amplitude modulator; expected a phase modulator"):
        VirtualSLM(file, number=2, live=False)
