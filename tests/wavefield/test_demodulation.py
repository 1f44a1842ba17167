"""Fields from recordings that a straightforward float64 simulation made, with a camera's noise and levels."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.ndimage
import scipy.special

from holoview.holograms.fields.demodulation import (
    field_of_recording,
    find_order,
    frame_fringes,
    in_line_field,
    off_axis_field,
    phase_shifting_field,
    shifted_steps,
    unwrapped_phase,
)
from holoview.holograms.fields.propagation import propagate_field
from holoview.holograms.fields.reading import Recording
from holoview.holograms.files.request import Order
from holoview.util.errors import UserError

SHAPE = (240, 320)
PITCH_M, WAVELENGTH = 3.45e-6, 633e-9
REFERENCE = 10.0  # amplitude


def _object(seed: int, unscattered: float, band: float = 0.05) -> np.ndarray:
    """A wave of light scattered up to `band` cycles a sample, of mean power 1, on top of unscattered light."""
    rng = np.random.default_rng(seed)
    spectrum = rng.normal(size=SHAPE) + 1j * rng.normal(size=SHAPE)
    fy, fx = np.meshgrid(*(np.fft.fftfreq(n) for n in SHAPE), indexing="ij")
    scattered = np.fft.ifft2(spectrum * (np.hypot(fy, fx) < band))
    return scattered / np.sqrt(np.mean(np.abs(scattered) ** 2)) + unscattered


def _wave(carrier: tuple[float, float]) -> np.ndarray:
    y, x = np.meshgrid(*(np.arange(n) - (n - 1) / 2 for n in SHAPE), indexing="ij")
    return np.exp(2j * math.pi * (carrier[0] * y + carrier[1] * x))


def _record(light: np.ndarray, seed: int, noise: float = 0.0) -> np.ndarray:
    intensity = np.abs(light) ** 2
    return np.rint(intensity + noise * np.random.default_rng(seed).normal(size=SHAPE))


def _recording(pictures: list[np.ndarray], kind: str) -> Recording:
    values = np.stack(pictures).astype(np.float32)[:, None]
    return Recording(values, (PITCH_M, PITCH_M), np.array([WAVELENGTH]), 0.1, kind, "made")


def _difference(found: np.ndarray, expected: np.ndarray) -> float:
    """R.m.s. difference inside the rim, after the best complex factor, which a recording doesn't know."""
    inside = (slice(20, -20), slice(20, -20))
    found, expected = found[inside], expected[inside]
    factor = np.vdot(found, expected) / np.vdot(found, found)
    return float(np.sqrt(np.mean(np.abs(found * factor - expected) ** 2)))


# --- off-axis ---------------------------------------------------------------------------------------------------------

# Scattered light near the peak moves it: of 600 scattered modes of power 1 in all, beside unscattered light of power 9,
# one has an amplitude of √(1/600/9) = 0.014 of the peak, which shifts its maximum by about as many bins.
#
# Noise of σ levels and rounding of 1/12 level² leave, within a disc of radius r of the spectrum, π·r² of their
# variance; divided by |R|, that is the field's. A camera's picture ends sharply, so that the other order, of amplitude
# 3 and 0.46 cycles a sample away, leaks in as 3/(2π·0.46·d) at d samples from an edge: 0.02 r.m.s. in the middle 200
# rows.


@pytest.mark.parametrize("noise", [0.0, 2.0])
@pytest.mark.parametrize("carrier", [(0.1613, 0.2071), (-0.1837, 0.1492), (0.013, -0.2713)], ids=str)
def test_an_off_axis_recording_gives_the_object_wave_down_to_the_cameras_noise(carrier, noise: float) -> None:
    wave = _object(1, unscattered=3.0)
    recording = _recording([_record(wave + REFERENCE * _wave(carrier), 2, noise)], "off-axis")
    found = off_axis_field(recording).orders[0]
    side = 1 if carrier[1] > 0 else -1  # the order with f_x > 0 holds O*·R of a reference with f_x > 0
    assert found.origin == "peak"
    assert np.abs(np.multiply(SHAPE, np.subtract(found.carrier, np.multiply(side, carrier)))).max() < 5 * 0.014
    assert 0.05 <= found.radius <= math.hypot(*carrier) / 2
    exact = Order((side * carrier[0], side * carrier[1]), found.radius)
    seen = off_axis_field(recording, [exact]).field.values[0, 0]
    sigma = math.sqrt((noise**2 + 1 / 12) * math.pi * found.radius**2) / REFERENCE
    assert _difference(seen, np.conj(wave) if side == 1 else wave) < 1.1 * math.hypot(sigma, 0.02)


def test_the_conjugate_order_is_the_conjugate_field() -> None:
    recording = _recording([_record(_object(3, 2.0) + REFERENCE * _wave((0.12, 0.2)), 4)], "off-axis")
    found = off_axis_field(recording)
    other = off_axis_field(recording, [found.orders[0].conjugate()])
    np.testing.assert_allclose(other.field.values, np.conj(found.field.values), atol=1e-4 * REFERENCE)


def test_an_order_without_a_peak_is_centred_on_its_light() -> None:
    wave = _object(5, unscattered=0.0)
    order = find_order(_record(wave * 2 + REFERENCE * _wave((-0.15, -0.22)), 6))
    assert order.origin == "gravity"
    # the centre of gravity of about π·(0.05)²·76 800 = 600 speckles of random power in a disc of r.m.s. radius 0.035
    assert np.hypot(order.carrier[0] - 0.15, order.carrier[1] - 0.22) < 5 * 0.035 / math.sqrt(600)


@pytest.mark.parametrize("carrier", [(0.02, 0.25), (-0.21, 0.19), (0.24, 0.0), (0.0, 0.31)], ids=str)
def test_an_order_that_fills_its_half_of_the_spectrum_is_taken_whole(carrier: tuple[float, float]) -> None:
    """A diffuse object that fills the camera's angles, as the dice of many demonstrations do."""
    band = 0.17
    order = find_order(_record(_object(6, 0.0, band) + REFERENCE * _wave(carrier), 9))
    side = 1 if order.carrier[0] * carrier[0] + order.carrier[1] * carrier[1] > 0 else -1
    # 7 000 speckles in a disc of r.m.s. radius 0.12; |O|² beside it has 1/200 of its light, over a disc twice as wide
    assert math.dist(np.multiply(side, order.carrier), carrier) < 5 * 0.12 / math.sqrt(7000) + 0.12 / 200
    assert 0.98 * band < order.radius < math.hypot(*carrier) - 0.03  # to the valley


def test_an_order_is_found_beside_brighter_light_of_the_object_with_itself() -> None:
    """A bright diffuse object: |O|² is a halo, brighter near the middle than the order is."""
    wave = _object(7, unscattered=0.0, band=0.08)
    carrier = (0.2, 0.27)
    found = find_order(_record(4 * wave + 1.2 * _wave(carrier), 8))
    assert math.hypot(found.carrier[0] - carrier[0], found.carrier[1] - carrier[1]) < 0.02


def test_a_picture_without_fringes_has_no_order() -> None:
    with pytest.raises(UserError, match="no order"):
        find_order(np.random.default_rng(7).normal(100, 3, SHAPE))
    with pytest.raises(UserError, match="no order"):
        find_order(np.full(SHAPE, 7.0))
    y, x = np.mgrid[:256, :256]
    disc = np.hypot(y - 90, x - 90) < 30
    frame = (np.maximum(abs(y - 150) / 30, abs(x - 170) / 30) < 1) & (np.maximum(abs(y - 150), abs(x - 170)) >= 24)
    with pytest.raises(UserError, match="no order"):  # though its spectrum isn't falling everywhere
        find_order(255.0 * disc + 200.0 * frame)


def test_an_order_that_holds_little_of_the_picture_is_doubted_unless_it_is_given() -> None:
    wave = 0.1 * _object(1, unscattered=3.0)  # of mean power 0.1, so that the order holds 0.1·|R|² of the variance
    picture = np.abs(wave + REFERENCE * _wave((0.16, 0.2))) ** 2
    x = np.arange(SHAPE[1]) / SHAPE[1]
    shaded = picture + 40 * np.cos(2 * math.pi * 3 * x)  # a variance of 800
    plain, doubted = (off_axis_field(_recording([p], "off-axis")) for p in (picture, shaded))
    assert "variance" not in " ".join(plain.report)
    assert "1% of the picture's variance" in doubted.report[0] and "in-line" in doubted.report[0]
    assert doubted.conjugate("").report[0] == doubted.report[0]
    given = off_axis_field(_recording([shaded], "off-axis"), doubted.orders)
    assert "variance" not in " ".join(given.report)


def test_an_order_beyond_the_samples_is_refused() -> None:
    with pytest.raises(UserError):
        off_axis_field(_recording([np.ones(SHAPE)], "off-axis"), [Order((0.7, 0.0), 0.1)])


@pytest.mark.long
def test_the_kind_of_a_recording_is_guessed_from_its_spectrum_and_said() -> None:
    fringes = _record(_object(3, 2.0) + REFERENCE * _wave((0.12, 0.2)), 4)
    plain = 1000 * np.ones(SHAPE) + np.random.default_rng(5).normal(size=SHAPE)
    for pictures, words in (([fringes], "off-axis"), ([plain], "in-line"), ([plain, plain + 1], "in-line")):
        found = field_of_recording(_recording(pictures, None))  # type: ignore[arg-type]
        assert words in found.report[0]
        assert found.field.frames == 1
    x = np.arange(SHAPE[1]) / SHAPE[1]
    faint = np.round(np.abs(0.1 * _object(3, 3.0) + REFERENCE * _wave((0.16, 0.2))) ** 2 + 40 * np.cos(6 * math.pi * x))
    for picture, words in ((faint, "off-axis"), (faint / 3, "in-line")):  # a camera counts, a table of numbers doesn't
        assert words in field_of_recording(_recording([picture], None)).report[0]
    assert field_of_recording(_recording([fringes] * 2, "off-axis")).field.frames == 2


# --- in-line ----------------------------------------------------------------------------------------------------------


def test_an_in_line_recording_is_one_plus_the_object_and_its_twin() -> None:
    weak = 0.01 * _object(8, 0.0)
    lamp = 1e6 * (1 + 0.3 * np.sin(np.arange(SHAPE[1]) / 40))
    picture, background = np.abs(1 + weak) ** 2 * lamp, np.broadcast_to(lamp, SHAPE)
    recording = replace(_recording([picture], "in-line"), dark_field=False)
    found = in_line_field(recording, background).field.values[0, 0]
    # |O|² is 1e-4 in the mean and exponentially distributed: 20 times that happens once in 2e8 samples
    np.testing.assert_allclose(found, 1 + 2 * weak.real, atol=20e-4)
    plain = in_line_field(replace(recording, pictures=recording.pictures / 1e6)).field.values
    assert plain.mean() == pytest.approx(1.0, abs=1e-6)


def test_negative_values_mean_that_the_background_is_gone() -> None:
    found = in_line_field(_recording([np.array([[-2.0, 4.0]])], "in-line"))
    np.testing.assert_allclose(found.field.values[0, 0], [[-0.5, 1.0]])
    assert "taken off" in found.report[0]


def _half_plane(x: np.ndarray) -> np.ndarray:
    """Intensity behind a half plane at x·√(λz) inside its shadow's edge (Born & Wolf, Principles of Optics, 8.7)."""
    s, c = scipy.special.fresnel(x * math.sqrt(2))
    return ((c + 0.5) ** 2 + (s + 0.5) ** 2) / 2


@pytest.mark.parametrize("grains", [20, 60])
def test_fringes_of_the_frame_are_those_of_a_half_plane(grains: float) -> None:
    """R.m.s. over two fringes about a quarter of the shorter side, which is `grains` times √(λz) wide. The asymptotic
    amplitude 1/(2π·x) is right to 1/(π·x²)² of itself, and changes by less than 4 % over these fringes."""
    x = grains / 4
    fringe = 1 / x  # of a phase π·x²
    near = np.linspace(x - fringe, x + fringe, 4001)
    distance_m = (SHAPE[0] * PITCH_M / grains) ** 2 / WAVELENGTH
    recording = replace(_recording([np.ones(SHAPE)], "in-line"), distance_m=distance_m)
    assert frame_fringes(recording) == pytest.approx(float(np.std(_half_plane(near))), rel=0.06)


def _phase_objects(radians: float, places: list[tuple[int, int]], distance_m: float) -> np.ndarray:
    """The intensity behind transparent discs of four pixels' radius, on a grid twice as wide as the picture."""
    shape = tuple(2 * n for n in SHAPE)
    y, x = (np.arange(n) - n // 4 for n in shape)
    discs = sum(np.hypot(y[:, None] - row, x[None, :] - column) < 4 for row, column in places)
    fy, fx = (np.fft.fftfreq(n, PITCH_M)[:, None] for n in shape)
    turns = distance_m * np.sqrt(1 / WAVELENGTH**2 - fy**2 - fx.T**2)
    wave = np.fft.ifft2(np.fft.fft2(np.exp(1j * radians * discs)) * np.exp(2j * np.pi * turns))
    return np.abs(wave[SHAPE[0] // 2 : SHAPE[0] * 3 // 2, SHAPE[1] // 2 : SHAPE[1] * 3 // 2]) ** 2


@pytest.mark.parametrize("seed", [30, 31])
def test_transparent_objects_stand_in_a_dark_field(seed: int) -> None:
    """Brightest at the objects' distance, where their places are, though they change some per cent of the light."""
    rng = np.random.default_rng(seed)
    places = [(int(rng.integers(60, 100)), 90), (int(rng.integers(120, 180)), 220)]
    distance_m = 5e-3
    picture = _phase_objects(0.5, places, distance_m)
    found = in_line_field(replace(_recording([picture], "in-line"), distance_m=-distance_m))
    assert found.recording.dark_field and "--no-dark-field" in found.report[1]
    seen = np.abs(propagate_field(found.field, -distance_m, "asm").values.numpy()[0, 0]) ** 2
    blurred = scipy.ndimage.gaussian_filter(seen, 2)
    for row, column in places:
        around = blurred[row - 25 : row + 26, column - 25 : column + 26]
        peak = np.unravel_index(np.argmax(around), around.shape)
        assert np.hypot(peak[0] - 25, peak[1] - 25) <= 4
    middle = blurred[60:180, 60:260]
    assert middle.max() > 10 * np.median(middle)
    kept = in_line_field(replace(found.recording, dark_field=False))
    np.testing.assert_allclose(kept.field.values - found.field.values, 1, atol=1e-5)


def test_objects_that_hide_much_of_the_light_keep_their_beam() -> None:
    picture = np.ones(SHAPE)
    picture[::8] = 0.2
    found = in_line_field(replace(_recording([picture], "in-line"), distance_m=1e-3))
    assert found.recording.dark_field is False and len(found.report) == 1


@pytest.mark.parametrize("background", [np.ones((3, 3)), np.zeros(SHAPE)], ids=["shape", "dark"])
def test_an_impossible_background_is_refused(background: np.ndarray) -> None:
    with pytest.raises(UserError) as error:
        in_line_field(_recording([np.ones(SHAPE)], "in-line"), background)
    assert error.value.where == "background"


# --- phase shifting ---------------------------------------------------------------------------------------------------

# The least-squares weights of N equal steps have a variance of 2/N each of cosine and sine, halved in the field: the
# field's noise is σ·√(1/N)/|R|. Rounding is 1/12 level².


@pytest.mark.parametrize("count", [3, 4, 5])
@pytest.mark.parametrize("steps", ["equal", "given"])
def test_a_phase_shifting_set_gives_the_object_wave_down_to_the_cameras_noise(steps: str, count: int) -> None:
    wave, noise = _object(9, 1.0), 1.5
    shifts = np.arange(count) * (2 * math.pi / count)
    if steps == "given":
        shifts = shifts + np.random.default_rng(10).uniform(-0.2, 0.2, count)
    pictures = [_record(wave + REFERENCE * np.exp(1j * d), 20 + n, noise) for n, d in enumerate(shifts)]
    found = phase_shifting_field(_recording(pictures, "phase-shifting"), "equal" if steps == "equal" else shifts)
    variance = np.abs(np.linalg.pinv(np.stack([np.ones(count), np.cos(shifts), np.sin(shifts)], 1))[1:] ** 2).sum() / 4
    sigma = math.sqrt((noise**2 + 1 / 12) * variance) / REFERENCE
    assert _difference(found.field.values[0, 0], wave) == pytest.approx(sigma, rel=0.05)  # of 56 000 samples: ±0.3 %


# The method takes the object's cosine and sine for uncorrelated. Of n = π·0.2²·76 800 = 9 650 modes of random phase
# they are correlated by ρ = |Σu²|/Σ|u|² = √(2/n) = 0.014 r.m.s., which shears the circle of the pictures by ρ. Phases
# that go all around it are off by about as much, and the field with them; 5 of these allow for any seed.
@pytest.mark.parametrize("shifts", [(0, 1.9, 4.1), (0, 1.4, 2.9, 4.4), (0, 1.9, 1.1, 4.5, 5.3)], ids=len)
def test_unknown_steps_are_found(shifts: tuple[float, ...]) -> None:
    wave = _object(11, 0.0, band=0.2)
    pictures = [_record(wave + REFERENCE * np.exp(1j * d), 30 + n, 0.5) for n, d in enumerate(shifts)]
    found = phase_shifting_field(_recording(pictures, "phase-shifting"), "unknown")
    assert found.steps_rad is not None
    np.testing.assert_allclose(found.steps_rad[0], shifts, atol=5 * 0.014)
    assert _difference(found.field.values[0, 0], wave) < 5 * 0.014 + 0.5 / REFERENCE


@pytest.mark.parametrize(
    ("pictures", "steps"),
    [(2, "equal"), (4, (0.0, 1.0, 2.0)), (3, (0.0, 0.001, 0.002)), (3, "unknown")],
    ids=["two", "another number", "one phase", "equal pictures"],
)
def test_sets_that_tell_no_phase_are_refused(pictures: int, steps) -> None:
    with pytest.raises(UserError):
        phase_shifting_field(_recording([np.ones(SHAPE)] * pictures, "phase-shifting"), steps)


# docs/fields-evidence.md has a study of 1 900 drawn sets. The objects here scatter all of their light: the mean wave
# of a drawn one, beside a reference as bright as the object, has means of three pictures √3·√(1/n) apart in the
# r.m.s., of n ≥ π·0.05²·76 800 = 600 modes 0.07, and those of one set in eight more than the tenth that three
# pictures allow.
@pytest.mark.parametrize("count", [3, 4, 5])
def test_a_phase_shifting_set_is_recognised_unasked(count: int) -> None:
    rng = np.random.default_rng(40 + count)
    for quarter, reference in ((False, 1.0), (False, REFERENCE), (True, 2.0)):
        step = math.pi / 2 if quarter else 2 * math.pi / count
        wave = _object(int(rng.integers(1 << 30)), 0.0, band=float(rng.uniform(0.05, 0.2)))
        wave -= wave.mean()
        pictures = [_record(10 * (wave + reference * np.exp(1j * step * n)), 50 + n, 3.0) for n in range(count)]
        found = field_of_recording(_recording(pictures, None))  # type: ignore[arg-type]
        assert found.recording.kind == "phase-shifting"
        assert f"phase-shifting in steps of {round(math.degrees(step))}°" in found.report[0]
        assert _difference(found.field.values[0, 0], 100 * reference * wave) < 5 * reference


@pytest.mark.parametrize("count", [3, 4])
def test_steps_that_are_far_from_equal_are_found_where_the_set_is_recognised(count: int) -> None:
    """Of an object of small phase beside a tilted reference, as in a slightly off-axis microscope: the steps of its
    principal components are right to the correlation of 8 fringes with an object of some modes, a few degrees; of four
    pictures they are recognised near the quarter turns that were meant."""
    rng = np.random.default_rng(45 + count)
    shifts = np.deg2rad([0.0, 90.0, 266.0]) if count == 3 else np.deg2rad([0.0, 78.0, 172.0, 281.0])
    wave = np.exp(0.3j * _object(int(rng.integers(1 << 30)), 0.0).real)
    tilted = 1.2 * _wave((0.02, 0.03))
    pictures = [_record(9 * (wave + tilted * np.exp(1j * d)), 70 + n, 1.0) for n, d in enumerate(shifts)]
    found = field_of_recording(_recording(pictures, None))  # type: ignore[arg-type]
    assert found.recording.kind == "phase-shifting" and "found from the pictures" in found.report[0]
    assert found.steps_rad is not None
    away = np.angle(np.exp(1j * (np.sign(np.sin(found.steps_rad[0, 1])) * found.steps_rad[0] - shifts)))
    assert np.abs(away).max() < math.radians(8)


def _different_pictures(kind: str, rng: np.random.Generator, count: int) -> list[np.ndarray]:
    waves = [_object(int(rng.integers(1 << 30)), 0.0, band=0.1) for _ in range(count)]
    if kind == "particles that moved":
        strength = rng.uniform(0.02, 0.3)
        return [np.abs(1 + strength * wave) ** 2 for wave in waves]
    if kind == "one that drifts":
        step = int(rng.integers(1, 9))
        return [np.abs(1 + 0.4 * np.roll(waves[0], (step * n, step * n), (0, 1))) ** 2 for n in range(count)]
    if kind == "a lamp that flickers":
        return [np.abs(1 + 0.3 * waves[0]) ** 2 * rng.normal(1, 0.02) for _ in range(count)]
    return [np.abs(1 + 0.4 * waves[0]) ** 2 for _ in range(count)]


@pytest.mark.parametrize(
    "kind", ["particles that moved", "one that drifts", "a lamp that flickers", "one object and noise"]
)
def test_different_in_line_pictures_stay_in_line(kind: str) -> None:
    rng = np.random.default_rng(60)
    for count in (3, 4, 5):
        pictures = np.stack(_different_pictures(kind, rng, count)) * 80
        pictures = np.rint(pictures + rng.normal(size=pictures.shape))
        assert shifted_steps(pictures[:, None]) is None


def test_a_settled_recording_gives_its_field_again() -> None:
    """As sessions keep it: of each kind, on the side that was taken."""
    wave = _object(13, 2.0)
    shifted = [_record(10 * (wave + 4 * np.exp(1j * d)), 50) for d in (0, 2.1, 4.0)]
    fringes = [_record(wave + REFERENCE * _wave((0.12, 0.2)), 4)]
    lamp = [np.abs(1 + 0.1 * wave) ** 2, np.full(SHAPE, 1.1)]
    for pictures, kind, steps in (
        (shifted, "phase-shifting", (0.0, 2.1, 4.0)),
        (shifted, "phase-shifting", "unknown"),
        (fringes, "off-axis", "equal"),
        (lamp, "in-line", "equal"),
    ):
        for conjugated in (False, True):
            asked = replace(_recording(pictures, kind), steps=steps, conjugated=conjugated)
            found = field_of_recording(asked)
            again = field_of_recording(found.recording)
            np.testing.assert_allclose(again.field.values, found.field.values, atol=1e-6 * np.abs(pictures).max())
            assert again.recording.kind == kind and again.orders == found.orders


def test_phases_are_unwrapped() -> None:
    pytest.importorskip("skimage")
    y, x = np.mgrid[-1:1:64j, -1:1:64j]
    phase = 20 * np.exp(-3 * (x**2 + y**2))
    found = unwrapped_phase(np.exp(1j * phase))
    np.testing.assert_allclose(found - found[0, 0], phase - phase[0, 0], atol=1e-9)
