"""A rig of a chain of elements beside the document that a viewer edits: patterns by element, pictures, a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from holoview.bench.experiment.rig_bench import system_of_rig
from holoview.bench.rig import RigDescription, read_rig
from holoview.holograms.hologram import Hologram
from holoview.holograms.view import random_drive
from holoview.util.errors import UserError
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.rig_session import MODELS, RigSession, drive_pattern, file_pattern, flat_pattern
from tests.patience import wait_until
from tests.rig.test_chain_rig import write_chain_rig

HIDDEN = {"leakage": {"element": "coarse", "amplitude": 0.2}}


class Opened:
    """A session with the virtual rig of a chain."""

    def __init__(self, path: Path) -> None:
        self.description = read_rig(path)
        self.session = EditingSession(system_of_rig(self.description))
        self.rig = RigSession(self.session)
        self.rig.open(path)
        self.settle()

    def wait(self, condition: Callable[[], object]) -> None:
        wait_until(condition, self.session.poll, 0.002)

    def settle(self) -> None:
        self.wait(lambda: not self.rig.is_busy)


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Opened]:
    made = Opened(write_chain_rig(tmp_path, {"virtual": {"seed": 5, "effects": HIDDEN}}))
    yield made
    made.rig.close()
    made.session.close()


@pytest.fixture(scope="module")
def described(tmp_path_factory: pytest.TempPathFactory) -> RigDescription:
    """The rig as its file tells it: nothing is opened."""
    return read_rig(write_chain_rig(tmp_path_factory.mktemp("chain")))


def test_the_documents_frame_is_sent_and_its_picture_judges_the_benchs_models(opened: Opened) -> None:
    rig = opened.rig
    rig.send(drive_pattern(opened.description, opened.session.document.drive, "frame 1"))
    rig.move_to(4e-3)
    rig.switch_on(638e-9, 1.0)
    opened.settle()
    found = rig.view.prediction
    assert found is not None and found.chi2 > 2  # the nominal bench doesn't leak
    opened.session.change("Leakage", {"effects": {"leakage@coarse": {"amplitude": 0.2}}})
    rig.choose_model(MODELS[1])
    opened.wait(lambda: (p := rig.view.prediction) is not None and p.model == MODELS[1])
    found = rig.view.prediction
    n = (48 - 2 * 10) * (64 - 2 * 10)  # without the border
    assert found is not None and abs(found.chi2 - 1) < 5 * np.sqrt(2 / n)
    rig.take_capture(searches_exposure=True)
    opened.settle()
    capture = rig.captures.all[0]
    assert capture.chain is not None and capture.levels.shape == (1, 2, 24, 32)


def test_patterns_are_rounded_to_each_elements_own_levels(described: RigDescription, tmp_path: Path) -> None:
    system = system_of_rig(described)
    drive = random_drive(system, 3)
    sent = drive_pattern(described, drive, "drawn").levels
    np.testing.assert_array_equal(sent[0], np.rint(drive["phase"][0].astype(np.float64) * 255))
    np.testing.assert_array_equal(sent[1, :12, :16], np.rint(drive["coarse"][0].astype(np.float64) * 63))
    assert not sent[1, 12:].any() and not sent[1, :, 16:].any()
    assert flat_pattern(described, 1.0).levels[1].max() == 63
    Hologram(drive, system).save(tmp_path / "h.safetensors")
    np.testing.assert_array_equal(file_pattern(described, tmp_path / "h.safetensors").levels, sent)


def test_one_pattern_of_all_frames_is_sent_in_each(described: RigDescription) -> None:
    drive = {"phase": np.zeros((2, 24, 32)), "coarse": np.ones((1, 12, 16))}
    assert drive_pattern(described, drive, "second", 1).levels[1, :12, :16].min() == 63


@pytest.mark.parametrize(
    "drive",
    [
        {"phase": np.zeros((1, 24, 32))},
        {"phase": np.zeros((1, 24, 32)), "coarse": np.zeros((1, 24, 32))},
        {"phase": np.zeros((1, 24, 32)), "coarse": np.zeros((1, 12, 16), complex)},
        np.zeros((1, 2, 24, 32)),
    ],
)
def test_patterns_of_another_bench_are_refused_with_what_to_do(described: RigDescription, drive: object) -> None:
    with pytest.raises(UserError, match=r"expected phase 24 × 32, coarse 12 × 16 as the rig has; take the bench"):
        drive_pattern(described, drive, "the viewer's")  # type: ignore[arg-type]
