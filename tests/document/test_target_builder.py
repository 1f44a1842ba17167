"""Targets that are built on a thread."""

from __future__ import annotations

from queue import SimpleQueue

import numpy as np

from holoview.light.model import preset
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.file_loader import target_from_pixels
from holoview.viewer.document.target_builder import TargetBuilder
from tests.patience import PATIENCE_S


def test_every_plane_of_a_long_stack_gets_its_target() -> None:
    """Also of one that is longer than what is kept of earlier requests."""
    planes = [f"{8 + 0.1 * i:.1f} mm" for i in range(40)]
    lasers = {"wavelengths": ["532 nm"], "amplitudes": [1.0]}
    session = EditingSession(preset.load("holochrome-8").edit({"shape": [12, 16], **lasers, "planes": planes}))
    session.edit("Target", target_spec=target_from_pixels(np.full((12, 16, 3), 128, np.uint8)))
    calls: SimpleQueue = SimpleQueue()
    builder, planes_m = TargetBuilder(calls.put, lambda: None, lambda error, where: None), session.system.planes_m
    try:
        assert builder.get(session.target_spec, session.system, float(planes_m[0])) is None
        calls.get(timeout=PATIENCE_S)()
        targets = [builder.get(session.target_spec, session.system, float(z)) for z in planes_m]
    finally:
        builder.close()
        session.close()
    assert len(targets) == 40
    assert all(target is not None for target in targets)


def test_a_built_stack_is_the_one_that_is_built_anew() -> None:
    """To the bit, so that an optimisation that takes it finds the same patterns; none for other planes."""
    session = EditingSession(preset.load("holochrome-8").edit({"shape": [12, 16]}))
    pixels = np.random.default_rng(len(__name__)).integers(0, 256, (12, 16, 3), np.uint8)
    session.edit("Target", target_spec=target_from_pixels(pixels))
    calls: SimpleQueue = SimpleQueue()
    builder = TargetBuilder(calls.put, lambda: None, lambda error, where: None)
    spec, system = session.target_spec, session.system
    try:
        assert spec is not None and builder.built_stack(spec, system) is None
        builder.get(spec, system, float(system.planes_m[0]))
        calls.get(timeout=PATIENCE_S)()
        built = builder.built_stack(spec, system)
    finally:
        builder.close()
        session.close()
    assert built is not None and np.array_equal(built, spec.stack_for(system))
    assert builder.built_stack(spec, system.with_(planes=["9 mm", "12 mm"])) is None
