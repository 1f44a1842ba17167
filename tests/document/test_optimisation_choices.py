"""What is chosen for the next optimisation: it is saved with the session, and decides for which eyes is optimised."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.holograms.optimise.eyes import OptimisedEyes
from holoview.util.errors import UserError
from holoview.util.tables import record_from_table
from holoview.viewer.document.archive import SessionArchive, SessionData, read_session
from holoview.viewer.document.editing_session import EditingSession, OptimisationChoices
from holoview.viewer.document.file_loader import target_from_pixels
from holoview.viewer.document.focus_edits import toggle_eye
from holoview.viewer.document.optimisation_job import OptimisationRequest, chosen_optimisation, start_optimisation
from holoview.viewer.document.session_store import SessionStore

CHOSEN = OptimisationChoices("holochrome-8", "xyz", "smooth", 7, 0.03, "random:4:0.8mm", "ignore")


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"scheme": "holochrome-7"}, 'scheme: "holochrome-7"'),
        ({"loss": "beauty"}, 'loss: "beauty"'),
        ({"start_patterns": "old"}, 'start_patterns: "old"'),
        ({"iterations": 0}, "iterations: 0"),
        ({"eyebox": -1.0}, "eyebox: -1"),
        ({"pupils": "3x3"}, '"3x3"; expected rows x columns:spacing'),
        ({"chromatic": "maybe"}, 'chromatic: "maybe"'),
    ],
)
def test_what_cant_be_chosen_is_refused(fields: dict[str, Any], words: str) -> None:
    with pytest.raises(UserError, match=words):
        OptimisationChoices(**fields)


def test_choices_are_saved_with_the_session(session: EditingSession, tmp_path: Path) -> None:
    store = SessionStore(tmp_path)
    autosave = store.start_autosave(session)
    steps = len(session.history)
    session.choose_optimisation(CHOSEN)
    assert len(session.history) == steps, "choosing isn't a step of undo"
    assert autosave.flush()
    read, unreadable = read_session(autosave.folder)
    assert read.choices == CHOSEN and not unreadable
    session.edit_view("Exposure", exposure_stops=1.0)
    assert autosave.close() is None
    restored = store.saved_sessions()[0].restore()
    assert restored.optimisation_choices == CHOSEN
    restored.close()


def test_a_session_without_choices_has_the_usual_ones_and_damaged_ones_are_told(
    session: EditingSession, tmp_path: Path
) -> None:
    SessionArchive(tmp_path).write(SessionData(session.history, 0, {}), {})
    path = tmp_path / "session.json"
    table = json.loads(path.read_text())
    del table["choices"]
    path.write_text(json.dumps(table))
    assert read_session(tmp_path)[0].choices == OptimisationChoices() and not read_session(tmp_path)[1]
    for damaged in ({"iterations": "many"}, {"iterations": True}, {"pupils": "anywhere"}, 3):
        path.write_text(json.dumps(table | {"choices": damaged}))
        data, unreadable = read_session(tmp_path)
        assert data.choices == OptimisationChoices()
        assert len(unreadable) == 1 and unreadable[0].startswith("choices for the next optimisation: ")
    assert record_from_table(OptimisationChoices, {"eyebox": 1}).eyebox == 1.0


def test_the_eyes_that_are_chosen_are_those_of_the_request(session: EditingSession) -> None:
    assert chosen_optimisation(CHOSEN, session.system).eyes == OptimisedEyes(), "without an eye"
    toggle_eye(session)
    request = chosen_optimisation(CHOSEN, session.system)
    assert request.eyes == OptimisedEyes.from_text("random:4:0.8mm", "ignore")
    assert (request.scheme, request.settings.loss, request.start_patterns) == ("holochrome-8", "xyz", "smooth")
    assert (request.settings.iterations, request.settings.eyebox) == (7, 0.03)


def test_places_without_an_eye_are_refused_before_the_job_begins(session: EditingSession) -> None:
    session.edit("Target", target_spec=target_from_pixels(np.full((8, 12, 3), 90, np.uint8), "grey"))
    with pytest.raises(UserError, match="--pupils: without an eye"):
        start_optimisation(session, OptimisationRequest(eyes=OptimisedEyes.from_text("1x3:0.3mm", "compensate")))
    assert not session.jobs.active
