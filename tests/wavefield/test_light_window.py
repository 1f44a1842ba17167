"""The image of a field is shown in a window that holds its light; light at half a turn a sample isn't split."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import holoview as hv
from holoview.holograms.fields.imaging import image_field
from holoview.holograms.fields.propagation import propagate_field
from holoview.holograms.fields.wavefield import Wavefield
from holoview.holograms.files.request import ReadRequest, WindowRequest
from holoview.holograms.load_field import OpenedHologram, open_hologram
from holoview.light.optics.free_space import SampleWindow
from holoview.util.errors import UserError

λ, PITCH_M, N = 532e-9, 4e-6, 192


def _axes(pitch_m: float = PITCH_M) -> tuple[NDArray[Any], NDArray[Any]]:
    axis = (np.arange(N) - (N - 1) / 2) * pitch_m
    return axis[:, None], axis[None, :]


def _wavefield(values: NDArray[Any], distance_m: float, pitch_m: float = PITCH_M) -> Wavefield:
    return Wavefield(values[None, None].astype(np.complex64), (pitch_m, pitch_m), np.array([λ]), distance_m)


def _opened(folder: Path, values: NDArray[Any], distance_m: float, **known: Any) -> OpenedHologram:
    np.save(folder / "field.npy", values.astype(np.complex64))
    request = ReadRequest((PITCH_M, PITCH_M), (λ,), distance_m, **known)
    return open_hologram([folder / "field.npy"], request)


def _centre(intensity: NDArray[Any]) -> tuple[float, float]:
    """Centre of gravity (y, x) in samples from the middle."""
    return tuple(  # type: ignore[return-value]
        float(intensity.sum(axis=1 - axis) @ (np.arange(n) - (n - 1) / 2) / intensity.sum())
        for axis, n in enumerate(intensity.shape)
    )


@pytest.mark.parametrize("degrees", [10.0, 13.0])
def test_a_tilted_beam_is_seen_where_it_went(degrees: float) -> None:
    """At z·tan θ, within the shift of its centre by its spread of angles, 3/2·tan θ·σ²·z, far below a sample."""
    pitch_m, distance_m = 1e-6, 4e-3
    y, x = _axes(pitch_m)
    beam = np.exp(-(x**2 + y**2) / (40e-6) ** 2 + 2j * np.pi * math.sin(math.radians(degrees)) / λ * x)
    imaged = image_field(_wavefield(beam, distance_m, pitch_m))
    assert imaged.light > 0.98 and not imaged.is_far
    power = np.abs(imaged.field.values[0, 0]) ** 2
    row, column = _centre(power)
    moved_m = distance_m * math.tan(math.radians(degrees))
    assert f"x {moved_m * 1e3:.3g}"[:5] in imaged.note and "beside the axis" in imaged.note
    place = float(imaged.note.split("around x ")[1].split(" mm")[0]) * 1e-3
    assert place + column * pitch_m == pytest.approx(moved_m, abs=2 * pitch_m) and abs(row) < 1


def test_a_converging_wave_stays_in_its_own_window() -> None:
    y, x = _axes()
    lens = np.exp(-1j * np.pi * (x**2 + y**2) / (λ * 9e-3)) * (np.hypot(x, y) < 0.35e-3)
    imaged = image_field(_wavefield(lens, 9e-3))  # whose steepest light moves by half the field's side
    assert imaged.note == "" and imaged.light == 1.0


def _rough_object(side_m: float, distance_m: float, seed: int) -> NDArray[Any]:
    """The field of a diffuse square at a distance before the plane, by Fresnel's sum over its points."""
    points = 256
    at = (np.arange(points) - (points - 1) / 2) * side_m / points
    object_ = np.exp(2j * np.pi * np.random.default_rng(seed).random((points, points)))
    axis = _axes()[1][0]
    rows = np.exp(1j * np.pi * (axis[:, None] - at[None, :]) ** 2 / (λ * distance_m))
    return rows @ object_ @ rows.T


@pytest.mark.parametrize(("distance_m", "side_m"), [(20e-3, 1.0e-3), (40e-3, 2.0e-3), (0.1, 3.0e-3)])
def test_an_object_larger_than_the_sensor_is_seen_whole(distance_m: float, side_m: float) -> None:
    """Of a square of a side, whose own window is 0.77 mm wide; its even light has a standard deviation of side/√12.

    The speckles of about a hundred along a side scatter this by some per cent; diffraction at the sensor's edge blurs.
    """
    imaged = image_field(_wavefield(_rough_object(side_m, distance_m, 3), -distance_m))
    assert imaged.light > 0.97 and "own window" in imaged.note
    power = np.abs(imaged.field.values[0, 0]) ** 2
    for axis in (0, 1):
        along = power.sum(axis=1 - axis)
        place = (np.arange(len(along)) - (len(along) - 1) / 2) * imaged.field.pitch_m[axis]
        middle = np.abs(place) <= 0.6 * side_m
        width = math.sqrt(float(along[middle] @ place[middle] ** 2 / along[middle].sum()))
        assert width == pytest.approx(side_m / math.sqrt(12), rel=0.08)
        assert along[middle].sum() > 0.9 * along.sum()


@pytest.mark.parametrize("axis", [0, 1])
def test_light_of_half_a_turn_a_sample_stays_one(axis: int, tmp_path: Path) -> None:
    """A disc alternating along an axis: seen along its own direction it is the picture of the plain disc."""
    y, x = _axes()
    disc = (np.hypot(x, y) < 0.2e-3) + 0j
    alternating = disc * np.exp(1j * np.pi * np.arange(N)).reshape((-1, 1) if axis == 0 else (1, -1))
    plain, opened = _opened(tmp_path, disc, 10e-3), _opened(tmp_path, alternating, 10e-3)
    said = [note for note in opened.notes if "half a turn a sample" in note]
    assert len(said) == 1 and ("row to row" in said[0]) == (axis == 0)
    np.testing.assert_array_equal(np.abs(opened.hologram.drive), np.abs(plain.hologram.drive))
    seen, expected = (hv.simulate(o.hologram, backend="torch").intensity[0, 0] for o in (opened, plain))
    np.testing.assert_allclose(seen, expected, atol=1e-4 * expected.max())
    kept = _opened(tmp_path, alternating, 10e-3, checkerboard=False)
    assert not [note for note in kept.notes if "half a turn" in note]
    assert [
        note for note in kept.notes if note.startswith("band of the field: ")
    ]  # it is brought to where its light is


@pytest.mark.parametrize("turns", [0.3, 0.45])
def test_light_of_a_known_direction_keeps_it(turns: float, tmp_path: Path) -> None:
    """A beam below half a turn a sample isn't split: nothing is taken away, and it is seen where it went."""
    y, x = _axes()
    beam = np.exp(-(x**2 + y**2) / (0.15e-3) ** 2 + 2j * np.pi * turns * np.arange(N))
    opened = _opened(tmp_path, beam, 10e-3)
    assert not [note for note in opened.notes if "half a turn" in note and "alternat" in note]
    moved_m = 10e-3 * math.tan(math.asin(λ * turns / PITCH_M))
    place = next(note for note in opened.notes if "beside the axis" in note).split("around x ")[1]
    assert float(place.split(" mm")[0]) * 1e-3 == pytest.approx(moved_m, abs=0.05e-3)
    assert opened.light > 0.98


def test_a_pattern_of_phases_keeps_its_own_window() -> None:
    phases = np.exp(2j * np.pi * np.random.default_rng(1).random((N, N)))
    assert image_field(_wavefield(phases, 9e-3)).note == ""


def test_a_window_that_is_asked_for_is_that_of_the_exact_propagation() -> None:
    y, x = _axes()
    beam = np.exp(-(x**2 + y**2) / (0.1e-3) ** 2 + 2j * np.pi * 0.1 * np.arange(N))
    field = _wavefield(beam, 10e-3)
    asked = WindowRequest((0.02e-3, 0.1e-3), (0.1e-3, 0.15e-3), 2.5e-6)
    imaged = image_field(field, asked=asked)
    window = SampleWindow((40, 60), (2.5e-6, 2.5e-6), (0.02e-3, 0.1e-3))
    expected = propagate_field(field, 10e-3, "asm", window).values.numpy()
    np.testing.assert_allclose(imaged.field.values, expected, atol=1e-6 * np.abs(expected).max())
    whole = float(np.square(np.abs(field.values)).sum()) * PITCH_M**2
    held = float(np.square(np.abs(expected)).sum()) * 2.5e-6**2 / whole
    assert imaged.light == pytest.approx(held, rel=1e-5) and imaged.light < 0.9


def test_an_array_is_brought_to_its_image_where_that_is_asked_for() -> None:
    y, x = _axes()
    beam = np.exp(-(x**2 + y**2) / (0.1e-3) ** 2 + 2j * np.pi * 0.1 * np.arange(N))
    known: dict[str, Any] = {"pitch": PITCH_M, "wavelengths": [λ], "distance": 20e-3}
    moved = hv.load_field(beam, **known, propagation="auto")
    np.testing.assert_array_equal(moved.drive, image_field(_wavefield(beam, 20e-3)).field.values)
    window = WindowRequest(side_m=(0.2e-3, 0.2e-3))
    assert hv.load_field(beam, **known, window=window).drive.shape == (1, 1, 50, 50)
    assert hv.load_field(beam, **known).drive.shape == (1, 1, N, N)
    with pytest.raises(UserError, match="quantity"):
        hv.load_field(beam, **known, quantity="phase")


@pytest.mark.parametrize(
    ("asked", "distance_m"),
    [(WindowRequest(side_m=(1.0, 1.0)), 10e-3), (WindowRequest(pitch_m=1.0), 10e-3), (WindowRequest(), 0.0)],
)
def test_a_window_that_can_not_be_is_refused(asked: WindowRequest, distance_m: float) -> None:
    with pytest.raises(UserError, match="window"):
        image_field(_wavefield(np.ones((N, N)), distance_m), asked=asked)


@pytest.mark.parametrize("lengths", [{"pitch_m": 0.0}, {"side_m": (1e-3, -1.0)}, {"centre_m": (0.0, math.nan)}])
def test_lengths_of_a_window_that_can_not_be_are_refused(lengths: dict[str, Any]) -> None:
    with pytest.raises(UserError, match="window"):
        WindowRequest(**lengths)
