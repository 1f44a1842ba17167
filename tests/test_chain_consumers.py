"""What of holoview takes a chain of elements, and that all else says in a sentence that it doesn't yet."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.holograms.optimise.problem import Problem
from holoview.light.engine.light_budget import light_budget
from holoview.light.model.system import System

_PHASE = {"kind": "phase", "pitch": 8e-6, "shape": (12, 16), "stroke": 800e-9}
_COMPLEX = {"kind": "complex", "pitch": 16e-6, "shape": (6, 8), "name": "wide"}
_STACK = np.full((1, 24, 32, 3), 0.3, np.float32)
_SETTINGS = hv.Settings(iterations=1)


def _chain() -> System:
    return System([532e-9], [[1.0]], elements=[_PHASE, _COMPLEX], planes_m=[2e-3])


def _hologram() -> hv.Hologram:
    return hv.Hologram(hv.random_drive(_chain()), _chain())


REFUSING: dict[str, Callable[[], Any]] = {
    "the optimiser's problem": lambda: Problem(_chain(), _STACK, _SETTINGS),
    "the light budget": lambda: light_budget(hv.make_plan(_chain()), _hologram().drive),
    "the shape of one drive": lambda: _chain().drive_shape,
    "a modulator": lambda: _chain().modulators[-1],
}


@pytest.mark.parametrize("name", REFUSING)
def test_what_takes_no_chain_says_so(name: str) -> None:
    with pytest.raises(hv.UserError, match="one or two phase modulators") as caught:
        REFUSING[name]()
    assert "\n" not in str(caught.value)


def test_patterns_survive_a_file(tmp_path: Path) -> None:
    hologram = _hologram()
    hologram.save(tmp_path / "exact.safetensors")
    hologram.save(tmp_path / "coarse.safetensors", as_uint8=True)
    exact, coarse = (hv.load_hologram(tmp_path / f"{name}.safetensors") for name in ("exact", "coarse"))
    assert exact.system == coarse.system == hologram.system
    for name, drive in hologram.drive.items():
        assert np.array_equal(exact.drive[name], drive)
    assert np.abs(coarse.drive["phase"] - hologram.drive["phase"]).max() <= 0.5 / 255 + 1e-7
    assert np.array_equal(coarse.drive["wide"], hologram.drive["wide"])  # complex numbers aren't rounded


def test_the_field_behind_a_chain_shows_what_the_chain_shows() -> None:
    """Planes measured from an element before the last, and a first order of other pixels than the samples."""
    fine = {"kind": "mask", "pitch": 4e-6, "shape": (24, 32), "pattern": "random", "stroke": 3e-7}
    way, stops = {"kind": "space", "distance": 5e-4}, {"kind": "space", "square": "0.8 first order of phase"}
    system = System([532e-9, 600e-9], [[1.0, 0.5]], elements=[_PHASE, way, fine, stops], planes_m=[2e-3])
    system = system.with_(planes_from="phase")
    hologram = hv.Hologram(hv.random_drive(system), system)
    field = hv.as_field(hologram)
    assert field.system.is_field and not field.system.is_chain
    shown, seen = (hv.simulate(h, backend="torch64").intensity for h in (hologram, field))
    # the field is stored in complex64: 6e-8 of each sample, which averages over the many that interfere
    np.testing.assert_allclose(seen, shown, atol=5e-7 * shown.max())


def test_sections_pass_through_the_plane_that_a_simulation_shows() -> None:
    hologram = _hologram()
    found = hv.sections(hologram, planes=["1 mm", "2 mm"], at=(9, 20))
    view = hv.simulate(hologram, planes=["2 mm"], backend="torch64")
    assert np.allclose(found.xz[1], view.xyz[0, 9], rtol=1e-4, atol=1e-5 * view.xyz.max())
