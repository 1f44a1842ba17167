"""The complex field at each stage of a frame, and patterns saved as the field behind them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import holoview as hv
from holoview.model.plan import make_plan
from holoview.util.errors import UserError


def _bench(**changes: Any) -> hv.System:
    return hv.load("holochrome-8").edit(
        {"shape": [24, 32], "wavelengths": ["460 nm", "638 nm"], "amplitudes": [[1.0, 2.0]]} | changes
    )


def _drive(system: hv.System) -> NDArray[Any]:
    return hv.random_drive(system, seed=4)


def test_a_phase_modulator_changes_the_phase_of_the_light_and_nothing_else() -> None:
    system = _bench()
    drive = _drive(system)
    behind = hv.field_at(system, drive, stage="slm1", laser=1)
    turns = np.kron(drive[0, 0].astype(float), np.ones((2, 2))) * system.modulators[0].stroke_m / 638e-9
    # the drive is float32 and the rest is computed in float64: products of a few roundings
    np.testing.assert_allclose(behind.values, np.exp(2j * np.pi * turns), atol=1e-12)
    np.testing.assert_array_equal(hv.field_at(system, drive, stage="light").values, np.ones((48, 64)))


@pytest.mark.parametrize(
    "changes", [{}, {"eye": {}}, {"relay2.iris_na": 0.02, "source": {"directions": [[0.01, 0.0]]}}]
)
def test_the_intensity_is_the_square_of_the_field_in_the_plane_or_on_the_retina(changes: dict[str, Any]) -> None:
    system = _bench(**changes)
    drive, stage = _drive(system), "retina" if "eye" in changes else "plane"
    view = hv.simulate(system, drive, planes=["10 mm"], backend="torch64")
    for laser, power in enumerate([1.0, 2.0]):
        seen = hv.field_at(system, drive, stage=stage, plane="10 mm", laser=laser)
        np.testing.assert_allclose(power * np.abs(seen.values) ** 2, view.intensity[0, laser], rtol=1e-9, atol=1e-12)


def test_the_light_behind_the_stop_is_the_spectrum_of_the_field_that_passes_it() -> None:
    system = _bench(**{"relay2.iris_na": 0.02})
    drive = _drive(system)
    field, passed = (hv.field_at(system, drive, stage=stage) for stage in ("slm2", "stop"))
    padded = make_plan(system).grid.padded
    spectrum = np.fft.fftshift(np.fft.fft2(field.values, s=padded))
    step = 460e-9 / (np.array(padded) * 4e-6)
    assert passed.is_by_direction and passed.step == pytest.approx(tuple(step))
    rows, columns = passed.values.shape
    top, left = padded[0] // 2 - rows // 2, padded[1] // 2 - columns // 2
    inside = spectrum[top : top + rows, left : left + columns]
    sine = np.hypot(
        *np.meshgrid(
            *(np.arange(-(n // 2), n - n // 2) * s for n, s in zip((rows, columns), step, strict=True)), indexing="ij"
        )
    )
    expected = np.where(sine <= 0.02, inside, 0)
    # the grid's offset shifts the phase of the spectrum: moduli are compared
    np.testing.assert_allclose(np.abs(passed.values), np.abs(expected), atol=1e-9 * np.abs(spectrum).max())


def test_a_stage_that_a_bench_lacks_is_refused_with_those_it_has() -> None:
    system = _bench(gap=None, modulators=_bench().modulators[:1])
    with pytest.raises(UserError, match="light, slm1, stop, plane") as caught:
        hv.field_at(system, _drive(system), stage="slm2")
    assert caught.value.where == "stage"
    with pytest.raises(UserError, match="laser: 3; expected 1 to 2"):
        hv.field_at(system, _drive(system), laser=2)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"relay1.square": "first order", "relay2.square": "first order", "eye": {}},
        {"propagation": "compact", "relay2": {"iris_na": 0.02, "dc_block_na": 0.002}},
        {"amplitudes": [[1.0, 0.0], [0.0, 2.0]], "upsample": 3},
    ],
)
def test_the_field_behind_patterns_shows_what_they_show(changes: dict[str, Any]) -> None:
    system = _bench(**changes)
    hologram = hv.Hologram(_drive(system), system)
    field = hv.as_field(hologram)
    assert field.system.is_field and hv.as_field(field) is field
    shown, seen = (hv.simulate(h, backend="torch64") for h in (hologram, field))
    # the field is stored in complex64: 6e-8 of each sample, which averages over the many that interfere
    np.testing.assert_allclose(seen.intensity, shown.intensity, atol=5e-7 * shown.intensity.max())
    np.testing.assert_allclose(seen.xyz, shown.xyz, atol=5e-7 * shown.xyz.max())


def test_fields_of_several_directions_are_not_one_field() -> None:
    system = _bench(source={"directions": [[0.0, 0.0], [0.01, 0.0]]})
    with pytest.raises(UserError, match="2 directions"):
        hv.as_field(hv.Hologram(_drive(system), system))
