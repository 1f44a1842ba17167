"""A rig whose devices are fakes in a Python file, except for those that a test replaces."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest

from holoview.bench.rig.description import RigDescription, read_rig

SHAPE, CAMERA_SHAPE = (6, 8), (10, 12)
FAKES = """
import numpy as np

class Slm:
    shape, settle_s = (6, 8), 0.01
    def show(self, levels): self.levels = levels
    def close(self): pass

class Camera:
    shape, exposures_s = (10, 12), (1e-6, 10.0)
    def set_exposure(self, exposure_s): return exposure_s
    def take(self): return np.full(self.shape, 100, np.uint16)
    def close(self): pass

class Lasers:
    wavelengths_m = (450e-9, 638e-9)
    def switch_on(self, wavelength_m, power): pass
    def switch_off(self): pass
    def close(self): pass

class Stage:
    range_m = (0.0, 20e-3)
    def move_to(self, distance_m): return distance_m
    def close(self): pass
"""
FACTS = {
    "slm1": 'shape = [6, 8]\npitch = "8 um"\nnum_levels = 16\nopd_range = "638 nm"',
    "camera": 'shape = [10, 12]\npitch = "4 um"\nbit_depth = 12\nelectrons_per_count = 4.0\nread_noise = 3.0\n'
    "black_level = 64",
    "lasers": 'wavelengths = ["450 nm", "638 nm"]',
    "stage": 'range = ["0 mm", "20 mm"]',
}
CLASSES = {"slm1": "Slm", "camera": "Camera", "lasers": "Lasers", "stage": "Stage"}
REST = '[limits]\npower = 0.8\nexposure = [1e-5, 0.5]\nstage = ["1 mm", "15 mm"]\n[geometry]\nfocal_length = "100 mm"\n'

WriteRig = Callable[..., RigDescription]


@pytest.fixture(autouse=True)
def _no_guard(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the process that guards lasers, which takes half a second to start: `test_laser_guard` has it."""
    monkeypatch.setattr(import_module("holoview.bench.rig.open_rig"), "GuardedLasers", lambda lasers, rig_path: lasers)


@pytest.fixture
def write_rig(tmp_path: Path) -> WriteRig:
    """Writes rig.toml and reads it. Its arguments are the options of devices by their tables, in TOML."""

    def write(**options: str) -> RigDescription:
        (tmp_path / "fakes.py").write_text(FAKES, encoding="utf-8")
        texts = []
        for name, facts in FACTS.items():
            own = options.get(name, f'device = "python"\nfile = "fakes.py"\nclass = "{CLASSES[name]}"')
            texts.append(f"[{name}]\n{facts}\n{own}\n")
        file = tmp_path / "rig.toml"
        file.write_text("\n".join(texts) + REST, encoding="utf-8")
        return read_rig(file)

    return write
