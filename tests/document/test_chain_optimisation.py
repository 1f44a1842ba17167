"""Optimisations of chains of elements in a session: as of other benches, and as `holoview optimise` makes them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from holoview.holograms.optimise.eyes import OptimisedEyes, target_at_places
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.light.model.drives import drive_fits
from holoview.light.model.system import System
from holoview.viewer.document.document import drive_arrays
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.file_loader import read_content
from holoview.viewer.document.optimisation_job import (
    OptimisationRequest,
    running_optimisation,
    start_optimisation,
    start_quick_optimisation,
)
from holoview.viewer.document.target_builder import TargetSpec
from holoview.viewer.render.scene import image_shape
from holoview.viewer.render.view_settings import ComparisonSide
from tests.document.test_chain_edits import chain
from tests.patience import PATIENCE_S

PHASE = {"kind": "phase", "pitch": "8 um", "shape": [12, 16], "stroke": "700 nm"}
SPACE = {"kind": "space", "distance": "2 mm"}
CHAINS = {
    "coarse amplitude": lambda: chain(),
    "static mask": lambda: chain(PHASE, SPACE, {**PHASE, "kind": "mask", "pattern": "random"}),
    "learned mask": lambda: chain(PHASE, SPACE, {**PHASE, "name": "learned", "shared": True}),
    "binary amplitude": lambda: chain({"kind": "amplitude", "pitch": "8 um", "shape": [12, 16], "levels": 2}),
    "complex": lambda: chain({"kind": "complex", "pitch": "8 um", "shape": [12, 16], "stroke": "600 nm"}),
    "Fourier plane": lambda: chain(
        PHASE, {"kind": "fourier", "focal_length": "1.15 mm"}, {"kind": "amplitude", "pitch": "8 um", "shape": [12, 16]}
    ),
    "arms": lambda: chain({**PHASE, "name": "one"}, {**PHASE, "name": "two", "beside": "one"}),
}
REQUEST = OptimisationRequest(Settings(iterations=3), preview_every=1, device="cpu")


@pytest.fixture(params=CHAINS)
def opened(request: pytest.FixtureRequest, target_spec: TargetSpec) -> Iterator[EditingSession]:
    """A session of a chain with a target."""
    session = EditingSession(CHAINS[request.param]())
    session.edit("Target", target_spec=target_spec)
    yield session
    session.close()


def _are_equal(one: object, other: object) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(drive_arrays(one), drive_arrays(other), strict=True))


def test_it_gives_what_the_optimiser_gives_and_undo_takes_it_back(
    opened: EditingSession, target_spec: TargetSpec
) -> None:
    before: System = opened.system
    old = opened.drive
    *_, expected = iterate(before, target_spec.stack_for(before), REQUEST.settings)
    job = start_optimisation(opened, REQUEST)
    assert opened.wait_until_idle(PATIENCE_S)
    assert job.status == "done" and running_optimisation(opened) is None
    assert job.latest is not None and job.latest.loss == pytest.approx(expected.loss, rel=1e-6)
    assert drive_fits(opened.system, opened.drive) and _are_equal(opened.drive, expected.best.drive)
    assert 0 < job.latest.light <= 1 and job.latest.light == pytest.approx(expected.light, rel=1e-5)
    label = opened.undo()
    assert (
        label is not None
        and label.startswith("Optimise")
        and label.endswith("% of the light")
        and _are_equal(opened.drive, old)
    )
    assert opened.system == before


@pytest.mark.parametrize("pupils", ["1x2:0.2mm", "random:2:0.2mm"])
def test_places_of_the_pupil_count(target_spec: TargetSpec, pupils: str) -> None:
    """As in the optimiser, for the stacks that are seen from there."""
    session = EditingSession(CHAINS["coarse amplitude"]().with_(eye={"eyepiece": "5 mm", "pupil": "0.5 mm"}))
    session.edit("Target", target_spec=target_spec)
    eyes = OptimisedEyes.from_text(pupils, "compensate")
    places = eyes.places_in(session.system)
    stack = target_at_places(target_spec, session.system, places)
    *_, expected = iterate(session.system, stack, places.in_settings(REQUEST.settings))
    start_optimisation(session, replace(REQUEST, eyes=eyes))
    assert session.wait_until_idle(PATIENCE_S)
    assert _are_equal(session.drive, expected.best.drive)
    session.close()


def test_a_quick_one_goes_on_from_its_patterns_and_may_be_cancelled(opened: EditingSession) -> None:
    start_quick_optimisation(opened, 2)
    assert opened.wait_until_idle(PATIENCE_S)
    assert "2 iterations" in opened.document.origin
    kept = opened.drive
    job = start_optimisation(opened, OptimisationRequest(Settings(iterations=100_000), start_patterns="now"))
    job.cancel()
    assert opened.wait_until_idle(PATIENCE_S)
    assert job.status == "cancelled" and opened.drive is kept


def test_a_checkpoint_opens_as_its_best_hologram(
    opened: EditingSession, target_spec: TargetSpec, tmp_path: Path
) -> None:
    *_, last = iterate(opened.system, target_spec.stack_for(opened.system), REQUEST.settings)
    last.checkpoint().save(tmp_path / "checkpoint.safetensors")
    content = read_content(tmp_path / "checkpoint.safetensors", opened.system)
    assert content.kind == "hologram" and content.system == last.best.system
    assert drive_fits(content.system, content.drive) and _are_equal(content.drive, last.best.drive)


def test_a_preset_beside_a_chain_has_its_size(opened: EditingSession) -> None:
    scene = opened.scene_for(ComparisonSide("preset", "simultaneous"))
    assert scene is not None and scene.system.name == "simultaneous"
    assert image_shape(scene.system) == image_shape(opened.system)
