"""The nominal bench of a rig as the system that a viewer edits."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from holoview.captures.dataset import Captures
from holoview.model.system import System
from holoview.rig.description import RigDescription, read_rig


def read_rig_system(path: Path) -> System:
    """The bench of rig.toml. Raises UserError for a wrong description."""
    return rig_system(read_rig(path))


def rig_system(rig: RigDescription) -> System:
    """The bench with all its lasers, in white, and focal planes over the range of the stage.

    On a Fourier bench the lens isn't part of it: what is seen there is the plane next to the last modulator's.
    """
    empty = Captures(
        levels=np.zeros((1, len(rig.bench.slms), *rig.slm_shape), np.uint8),
        images=np.zeros((1, *rig.camera_shape), np.uint16),
        wavelength_m=np.array([rig.wavelengths_m[0]]),
        distance_m=np.array([rig.limits.stage_m[0]]),
        power=np.ones(1),
        exposure_s=np.ones(1),
        **rig.bench.as_fields(),
    )
    low, high = rig.limits.stage_m
    planes = np.unique(np.linspace(max(low, 0.0), max(high, 0.0), 3)).tolist()
    nominal = empty.nominal_system(rig.wavelengths_m, planes)
    return nominal.with_(name=rig.name, observer="eye").edit({"amplitudes": "white"})
