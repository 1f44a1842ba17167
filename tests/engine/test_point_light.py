"""The light of a point is that of the image; its contributions, orders and directions add up to it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import holoview as hv
from holoview.light.engine.point_light import (
    BeamAtPoint,
    beam_at_point,
    local_spectrum,
    point_steps,
    section_steps,
)
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs

PLANE_M, PLACE = 6e-3, (17, 40)
ROUNDING = 1e-12  # of sums of 1e5 numbers in float64, relative to the largest of them


def _bench(**changes: Any) -> System:
    lasers = {"wavelengths": ["450 nm", "530 nm", "620 nm"], "amplitudes": "white"}
    return hv.load("holochrome-8").edit({"shape": [20, 28], "planes": ["4 mm", "6 mm"], **lasers, **changes})


SEVERAL = {
    "frames": 2,
    "source": {"grid": [1, 2], "spacing": "3 mrad"},
    "effects": {"source_profile": {"fall": 0.5}, "bandwidth": {"sigma": "1 nm"}},
}
BENCHES = {
    "two modulators": _bench(),
    "one modulator, all orders": _bench().with_(modulators=_bench().modulators[:1], gap=None, relay1={}, relay2={}),
    "frames, directions and effects": _bench(**SEVERAL),
    "an eye": _bench(eye={}),
    "a field": hv.load_field(
        np.ones((2, 24, 44), np.complex64), pitch="8 um", wavelengths=["530 nm", "620 nm"], distance="6 mm"
    ).system,
    "a chain": _bench().edit(
        {
            "amplitudes": [[1.0, 1.0, 1.0]],
            "elements": [
                {"kind": "phase", "pitch": "8 um", "shape": [20, 28], "stroke": "800 nm", "name": "first"},
                {"kind": "space", "distance": "2 mm", "iris_na": 0.03},
                {"kind": "mask", "pitch": "4 um", "shape": [40, 56], "pattern": "random", "stroke": "300 nm"},
                {"kind": "lens", "focal_length": "20 mm", "abbe": 30.0},
                {"kind": "fourier", "focal_length": "2 mm"},
                {"kind": "complex", "pitch": "16 um", "shape": [10, 14], "name": "second"},
                {"kind": "amplitude", "pitch": "8 um", "shape": [20, 28], "name": "third"},
            ],
        }
    ),
}


@pytest.fixture(params=BENCHES)
def system(request: pytest.FixtureRequest) -> System:
    return BENCHES[request.param]


def _lasers(system: System) -> range:
    return range(len(system.wavelengths_m))


def _beams(system: System, drive: NDArray[Any]) -> list[BeamAtPoint]:
    plan = make_plan(system, [PLANE_M])
    executor = TorchExecutor(plan, FrameInputs(plan, drive), double=True)
    return [beam_at_point(executor, beam, 0, PLACE) for beam in plan.beams(_lasers(system))]


def test_contributions_and_orders_add_up_to_the_field(system: System) -> None:
    for beam in _beams(system, hv.random_drive(system)):
        assert len(beam.contributions) == (3 if system.is_chain else 1 if system.is_field else len(system.modulators))
        for parts in beam.contributions:
            assert abs(parts.sum() - beam.field) <= ROUNDING * parts.size * np.abs(parts).max()
        assert abs(sum(beam.orders.values()) - beam.field) <= ROUNDING * 1e4


def test_a_sample_contributes_the_field_that_it_alone_would_send() -> None:
    """Of light that is 0 but for one sample, all of the field comes from that sample."""
    system = BENCHES["a field"]
    drive = np.zeros(system.drive_shape, np.complex64)
    drive[..., 10, 30] = 0.5 - 2j
    for beam in _beams(system, drive):
        (parts,) = beam.contributions
        assert parts[10, 30] == pytest.approx(beam.field, rel=1e-10)
        assert np.count_nonzero(parts) == 1


def test_the_light_of_a_point_is_that_of_the_image(system: System) -> None:
    drive = hv.random_drive(system)
    *_, point = point_steps(system, drive, PLANE_M, PLACE, _lasers(system))
    view = hv.simulate(system, drive, [*system.planes_m, PLANE_M], backend="torch64").at([-1])
    by_laser = view.intensity[0, :, *PLACE].reshape(len(system.wavelengths_m), -1).sum(axis=1)
    np.testing.assert_allclose(point.intensities, by_laser, rtol=1e-9)
    np.testing.assert_allclose(point.xyz, view.xyz[0][PLACE], rtol=1e-9)
    assert sum(point.orders.values()) == pytest.approx(1.0, abs=1e-9)
    is_one_order = not (system.is_chain or system.relay2.is_clear) and len(system.source.directions_rad) == 1
    assert set(point.orders) == {(0, 0)} or not is_one_order or system.is_field
    assert point.share == 1.0


def test_sections_are_lines_of_images(system: System) -> None:
    drive, planes_m = hv.random_drive(system), np.linspace(4e-3, 8e-3, 6)
    steps = list(section_steps(system, drive, planes_m, PLACE, _lasers(system)))
    assert [step.share for step in steps if step.share] == pytest.approx([(n + 1) / 6 for n in range(6)])
    xyz = hv.simulate(system, drive, planes_m, backend="torch64").xyz
    # complex64: 2⁻²⁴ for each of some 50 operations of the transforms
    np.testing.assert_allclose(steps[-1].xz, xyz[:, PLACE[0]], atol=50 * 2**-24 * xyz.max())
    np.testing.assert_allclose(steps[-1].yz, xyz[:, :, PLACE[1]], atol=50 * 2**-24 * xyz.max())


def test_lasers_that_are_off_add_nothing() -> None:
    system = BENCHES["two modulators"]
    *_, point = point_steps(system, hv.random_drive(system), PLANE_M, PLACE, [1])
    assert np.flatnonzero(point.intensities).tolist() == [1]


def test_a_plane_wave_is_one_direction() -> None:
    """Its spectrum in a Hann window is that of the window: 1/4, 1/2, 1/4 in amplitude along each axis."""
    y, x = np.mgrid[0:60, 0:80]
    wave = np.exp(2j * np.pi * (5 * x - 3 * y) / 32)
    power = np.abs(local_spectrum(wave, (30, 41), 32)) ** 2
    assert np.unravel_index(power.argmax(), power.shape) == (16 - 3, 16 + 5)
    shape = np.outer([0.25, 0.5, 0.25], [0.25, 0.5, 0.25]) ** 2
    np.testing.assert_allclose(power[12:15, 20:23] / power.sum(), shape / shape.sum(), atol=1e-12)
    hann = np.square(np.cos(np.pi * (np.arange(32) - 16) / 32))
    assert power.sum() == pytest.approx(np.square(hann).sum() ** 2)  # Parseval


def test_beyond_the_edge_of_the_field_it_is_dark() -> None:
    """At the first corner, along each axis, a Hann window of sum 8 holds half of its samples with the middle: 4.5."""
    wave = np.ones((20, 20), complex)
    middle, corner = (np.abs(local_spectrum(wave, place, 16)).max() for place in ((10, 10), (0, 0)))
    assert corner / middle == pytest.approx((4.5 / 8) ** 2)
