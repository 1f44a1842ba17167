"""An optimisation that runs when the viewer is killed goes on after its next start, with the iterations left."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from holoview.holograms.optimise.eyes import OptimisedEyes
from holoview.holograms.optimise.memory import with_compact_grid
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.util.errors import UserError
from holoview.viewer.document.archive import SESSION_FILE
from holoview.viewer.document.document import Document
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.file_loader import target_from_pixels
from holoview.viewer.document.optimisation_job import (
    OptimisationRequest,
    UnfinishedOptimisation,
    read_rest,
    running_optimisation,
    start_optimisation,
)
from holoview.viewer.document.session_store import SessionStore
from tests.child_process import child_process
from tests.document.conftest import small_system
from tests.patience import PATIENCE_S

ITERATIONS = 400
_PROGRAM = """
import sys, time
from pathlib import Path
import numpy as np
from holoview.holograms.optimise.settings import Settings
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.file_loader import target_from_pixels
from holoview.viewer.document.optimisation_job import OptimisationRequest, start_optimisation
from holoview.viewer.document.session_store import SessionStore
from tests.document.conftest import small_system
session = EditingSession(small_system(), seed=7)
autosave = SessionStore(Path(sys.argv[1])).start_autosave(session)
session.edit("Target", target_spec=target_from_pixels(np.full((4, 4, 3), 90, np.uint8)))
job = start_optimisation(session, OptimisationRequest(Settings(iterations=400, seed=3, loss="xyz"), preview_every=1))
while session.preview_document is None or session.preview_document.origin.startswith("optimised, 0 "):
    time.sleep(0.01)
    session.poll()
assert autosave.flush()
print("saved", flush=True)
time.sleep(600)
"""


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """The folder of the sessions of a program that was killed, and its process id."""
    folder = tmp_path_factory.mktemp("state")
    words = [sys.executable, "-c", _PROGRAM, str(folder)]
    with child_process(words, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None and program.stdout.readline() == "saved\n"
        os.kill(program.pid, signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)
    return folder, program.pid


def test_it_goes_on_from_the_best_patterns(killed: tuple[Path, int]) -> None:
    folder, pid = killed
    session = SessionStore(folder).take_over(pid)
    assert session is not None and running_optimisation(session) is None
    best = session.snapshots["Unfinished optimisation"]
    session.poll()
    job = running_optimisation(session)
    assert job is not None and job.request.start_patterns == "now"
    settings, done = job.request.settings, job.request.done
    assert 0 < done < ITERATIONS and settings == Settings(iterations=ITERATIONS, seed=3, loss="xyz")
    while not job.progress and job.is_active:
        assert session.wait_until_idle(0.05) or True
    first = job.progress[0]
    assert first.iteration == done and np.isfinite(first.loss) and best.origin.startswith("optimised")
    job.stop_and_keep()
    assert session.wait_until_idle(PATIENCE_S)
    assert session.history[-1].label.startswith("Optimise")
    assert session.drive.shape == best.drive.shape
    assert first.loss <= _loss_at(best) * (1 + 1e-5)  # float32: the same light
    session.close()


def _loss_at(document: Document) -> float:
    """The loss, in XYZ, of the patterns and the amplitudes of a document."""
    system, settings = with_compact_grid(document.system), Settings(iterations=1, loss="xyz", free=("patterns",))
    assert document.target_spec is not None
    return next(iterate(system, document.target_spec.stack_for(system), settings, document.drive)).loss


def test_a_damaged_rest_leaves_the_result(killed: tuple[Path, int]) -> None:
    folder, _ = killed
    (file,) = folder.rglob(SESSION_FILE)
    table = json.loads(file.read_text(encoding="utf-8"))
    assert read_rest(table["unfinished"]["rest"]) is not None
    for rest in (
        {},
        {"settings": 3},
        {"settings": "[]"},
        {"settings": '{"iterations": 0}'},
        {"settings": "{}", "x": 1},
        {"settings": "{}", "done": 60},
    ):
        with pytest.raises(UserError):
            read_rest(rest)
    table["unfinished"]["rest"] = {"settings": '{"iterations": -1}'}
    file.write_text(json.dumps(table), encoding="utf-8")
    (saved,) = SessionStore(folder).saved_sessions()
    session, unfinished = saved.restore_with_unfinished()
    assert unfinished is not None and unfinished.rest is None and "Unfinished optimisation" in session.snapshots
    assert any("unfinished optimisation" in message.text for message in session.messages.all)
    session.close()


@pytest.mark.parametrize("pupils", ["", "3x3:0.6 mm", "random:4:0.8 mm"])
def test_the_rest_of_an_optimisation_is_read_as_it_was_written(pupils: str, session: EditingSession) -> None:
    table = {"settings": '{"seed": 3}', "only_plane_m": 0.01, "device": "cpu", "compares_fields": True, "done": 7}
    rest = read_rest(table | {"pupils": pupils, "chromatic": "ignore"})
    assert rest is not None and rest.start_patterns == "now" and rest.settings == Settings(seed=3)
    assert (rest.only_plane_m, rest.device, rest.compares_fields, rest.done) == (0.01, "cpu", True, 7)
    assert rest.eyes == OptimisedEyes.from_text(pupils or None, "ignore")
    assert read_rest(UnfinishedOptimisation(session.document, rest).rest_table()) == rest


def test_a_window_that_is_closed_keeps_the_best_patterns_so_far(tmp_path: Path) -> None:
    """Also where the optimisation is all that was done: its session isn't deleted as one without edits is."""
    store = SessionStore(tmp_path)
    session = EditingSession(small_system(), seed=7, target_spec=target_from_pixels(np.full((4, 4, 3), 90, np.uint8)))
    autosave = store.start_autosave(session)
    job = start_optimisation(session, OptimisationRequest(Settings(iterations=100_000, seed=3), preview_every=1))
    while session.preview_document is None:
        assert job.is_active
        session.wait_until_idle(0.05)
    assert len(session.history) == 1 and not session.can_look_back
    best = session.preview_document
    assert autosave.close() is None
    session.close()
    saved = store.last_session()
    assert saved is not None
    kept = saved.restore().snapshots["Unfinished optimisation"]
    assert np.array_equal(np.asarray(kept.drive), np.asarray(best.drive))
