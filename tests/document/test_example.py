"""What a new session shows: the shipped hologram of the still life, or speckle with the same target."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from holoview.holograms.hologram import Hologram
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.view import random_drive
from holoview.light.model import preset
from holoview.light.model.system import System
from holoview.util.files import data_dir
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.example import EXAMPLE_PRESET, new_session, show_example, shows_example
from holoview.viewer.document.file_loader import FileLoader, target_from_pixels
from holoview.viewer.document.optimisation_job import OptimisationRequest, start_optimisation
from holoview.viewer.document.session_store import SessionStore
from holoview.viewer.render import remembered_brightness
from holoview.viewer.render.view_settings import SPECKLE_EXPOSURE_STOPS
from tests.patience import PATIENCE_S

FILE = data_dir("assets") / "still-life.safetensors"
LIMIT_BYTES = 1_000_000


@pytest.fixture
def bench() -> System:
    """The bench of the shipped hologram."""
    return preset.load(EXAMPLE_PRESET)


@pytest.fixture
def session(bench: System) -> Iterator[EditingSession]:
    """A new session of that bench."""
    made = new_session(bench)
    yield made
    made.close()


def _open(session: EditingSession, name: str | Path) -> None:
    loader = FileLoader(session, quick=False)
    loader.open(name)
    assert session.wait_until_idle(PATIENCE_S)
    loader.close()


def test_the_shipped_hologram_is_small_and_of_its_preset(session: EditingSession, bench: System) -> None:
    """Only the optimised amplitudes differ; `make still-life` makes the file again when the preset has changed."""
    assert FILE.stat().st_size <= LIMIT_BYTES
    assert len(bench.wavelengths_m) == 8
    assert session.system == bench.edit({"amplitudes": session.system.amplitudes})


def test_a_new_session_shows_a_picture_and_can_be_optimised(session: EditingSession) -> None:
    assert shows_example(session) and session.view_settings.exposure_stops == 0 and not session.can_undo
    assert session.document.path is None, "the shipped file isn't watched, nor written to"
    target = session.target_spec
    assert target is not None and target.is_example
    far, near = target.build(session.system.edit({"shape": [48, 64]})).stack[[0, -1]]
    assert np.abs(near - far).mean() > 0.005, "it has depth"


def test_the_brightness_of_its_first_image_is_known_of_an_installation(
    session: EditingSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And of no scene that differs from it, be it in one level of one pixel."""
    monkeypatch.setattr(remembered_brightness, "cache_dir", lambda: tmp_path)
    scene = session.document.scene
    with np.printoptions(precision=2, floatmode="fixed"):  # as a library may set them
        assert remembered_brightness.remembered_gain(scene) is not None
    drive = scene.drive.copy()
    drive[0, 1, 5, 7] = 1 - drive[0, 1, 5, 7]
    brighter = scene.system.with_(amplitudes=scene.system.amplitudes * 1.01)
    for other in (replace(scene, drive=drive), replace(scene, plane_m=0.011), replace(scene, system=brighter)):
        assert remembered_brightness.remembered_gain(other) is None


def test_another_bench_shows_speckle_with_the_target_and_a_hint(bench: System) -> None:
    for system in (preset.load("simultaneous"), bench.edit({"gap": "3 mm"})):
        session = new_session(system)
        assert session.system == system and not shows_example(session)
        assert np.array_equal(session.drive, random_drive(system))
        assert session.view_settings.exposure_stops == SPECKLE_EXPOSURE_STOPS
        assert session.target_spec is not None and session.target_spec.is_example
        assert "Ctrl+Enter" in session.messages.all[0].text
        session.close()


def test_random_patterns_have_no_target(bench: System) -> None:
    session = new_session(bench, is_random=True)
    assert session.target_spec is None and np.array_equal(session.drive, random_drive(bench))
    assert session.view_settings.exposure_stops == SPECKLE_EXPOSURE_STOPS
    session.close()


def test_the_example_comes_back_in_one_step(bench: System) -> None:
    session = new_session(bench.edit({"shape": [16, 24]}), is_random=True)
    show_example(session)
    assert shows_example(session) and session.system.modulators[0].shape == bench.modulators[0].shape
    assert session.undo() == "Open the still life" and session.target_spec is None
    session.close()


def test_a_preset_keeps_the_target_and_its_own_hologram_is_shown(session: EditingSession) -> None:
    _open(session, "simultaneous")
    assert session.target_spec is not None and session.target_spec.is_example and not shows_example(session)
    assert "Ctrl+Enter" in session.messages.all[-1].text
    _open(session, EXAMPLE_PRESET)
    assert shows_example(session)
    session.edit("Target", target_spec=target_from_pixels(np.full((8, 8, 3), 200, np.uint8)))
    _open(session, EXAMPLE_PRESET)
    assert not shows_example(session) and "random patterns" in session.document.origin


def test_a_hologram_that_is_opened_removes_the_example_but_no_chosen_target(
    session: EditingSession, tmp_path: Path
) -> None:
    small = session.system.edit({"shape": [16, 24]})
    Hologram(random_drive(small), small).save(tmp_path / "mine.safetensors")
    _open(session, tmp_path / "mine.safetensors")
    assert session.target_spec is None
    session.undo()
    chosen = target_from_pixels(np.full((8, 8, 3), 200, np.uint8))
    session.edit("Target", target_spec=chosen)
    _open(session, tmp_path / "mine.safetensors")
    assert session.target_spec is chosen


@pytest.mark.long
def test_the_low_exposure_of_speckle_ends_with_an_optimisation(bench: System) -> None:
    session = new_session(bench.edit({"shape": [16, 24]}))
    start_optimisation(session, OptimisationRequest(Settings(iterations=1)))
    assert session.wait_until_idle(PATIENCE_S) and "optimised" in session.document.origin
    assert session.view_settings.exposure_stops == 0
    session.close()


def test_a_saved_session_finds_the_target_in_this_installation(session: EditingSession, tmp_path: Path) -> None:
    """Only that it is the example is stored, since another installation has the shipped files elsewhere."""
    session.edit_view("Exposure", exposure_stops=1.0)  # a session without edits isn't kept
    store = SessionStore(tmp_path)
    store.start_autosave(session).close()
    assert str(data_dir("assets")) not in "".join(p.read_text() for p in tmp_path.rglob("session.json"))
    last = store.last_session()
    assert last is not None
    restored = last.restore()
    assert shows_example(restored) and np.array_equal(restored.drive, session.drive)
    assert restored.target_spec is not None and session.target_spec is not None
    assert np.array_equal(restored.target_spec.source.rgb, session.target_spec.source.rgb)  # type: ignore[union-attr]
    assert restored.target_spec.placement == session.target_spec.placement
    restored.close()
