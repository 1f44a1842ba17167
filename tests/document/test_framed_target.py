"""The framing of a target is saved with the session, also that of the shipped picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from holoview.holograms.targets.framing import FILL, Framing
from holoview.viewer.document.archive import SessionArchive, SessionData
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.file_loader import target_from_pixels
from holoview.viewer.document.session_store import SavedSession
from holoview.viewer.document.target_builder import example_target, thumbnail_xyz
from tests.document.conftest import small_system


@pytest.mark.parametrize("is_example", [True, False])
def test_a_framing_outlives_the_program(tmp_path: Path, is_example: bool) -> None:
    spec = example_target() if is_example else target_from_pixels(np.full((90, 30, 3), 200, np.uint8))
    framing = Framing("crop", (0.5, 0.25), 0.5)
    session = EditingSession(small_system(), target_spec=spec)
    session.edit("Framing", target_spec=spec.with_framing(framing))
    SessionArchive(tmp_path).write(
        SessionData(session.history, session.history_position, {}), {"title": "", "when": 0.0}
    )
    again = SavedSession(tmp_path, "", 0.0, 1).restore()
    assert again.target_spec is not None and again.target_spec.placement.framing == framing
    assert again.undo() == "Framing" and again.target_spec is not None
    assert again.target_spec.placement.framing == FILL and again.target_spec.placement.depth == spec.placement.depth
    session.close()
    again.close()


def test_the_small_picture_shows_all_of_it_in_its_aspect() -> None:
    pixels = np.zeros((900, 300, 3), np.uint8)
    pixels[:, 150:] = 255
    xyz = thumbnail_xyz(target_from_pixels(pixels))
    assert xyz.shape == (320, 107, 3)
    assert xyz[:, :50, 1].max() < 1e-6 and xyz[:, 60:, 1] == pytest.approx(1.0, abs=1e-3)
