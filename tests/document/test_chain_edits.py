"""Edits of a bench's elements: each is one step of undo, the model's own sentence refuses what can't be."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import holoview as hv
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.mailbox import are_same
from holoview.viewer.document import chain_edits
from holoview.viewer.document.archive import SessionArchive, SessionData, read_session
from holoview.viewer.document.document import drive_arrays
from holoview.viewer.document.editing_session import EditingSession

_PHASE = {"kind": "phase", "pitch": "8 um", "shape": [12, 16], "stroke": "700 nm"}
_STOPS = {"kind": "space", "distance": "2 mm", "square": "first order of phase"}
_COARSE = {"kind": "amplitude", "name": "coarse", "pitch": "32 um", "shape": [3, 4]}
_MASK = {**_PHASE, "kind": "mask", "pattern": "random"}


def chain(*elements: dict[str, object]) -> System:
    """A chain of two lasers, 10 mm before its plane."""
    return System(
        ["460 nm", "633 nm"], [[1.0, 1.0]] * 2, elements=elements or (_PHASE, _STOPS, _COARSE), planes_m=[10e-3]
    )


def two() -> System:
    """A bench of the short form with two modulators."""
    return hv.load("holochrome-8").with_(shape=[12, 16])


@pytest.fixture
def session(request: pytest.FixtureRequest) -> Iterator[EditingSession]:
    """A session of the system that a test names, else of the chain."""
    opened = EditingSession(getattr(request, "param", chain)())
    yield opened
    opened.close()


def picture(session: EditingSession) -> np.ndarray:
    """XYZ at the displayed plane, computed by the reference."""
    document = session.document
    drive = dict(document.drive) if document.system.is_chain else document.drive
    return hv.simulate(document.system, drive, planes=[document.view_settings.plane_m], backend="torch64").xyz[0]


BOTH = pytest.mark.parametrize("session", [chain, two], indirect=True)


@BOTH
def test_switching_off_and_on_is_as_before(session: EditingSession) -> None:
    """Of modulators by the patterns, of a space by its stops."""
    before, seen = session.document, picture(session)
    for name in session.system.element_names[:3]:
        chain_edits.switch_element(session, name)
        assert not chain_edits.is_on(session.document, name)
        assert not np.allclose(picture(session), seen)
        chain_edits.switch_element(session, name)
        assert chain_edits.is_on(session.document, name)
        assert np.array_equal(picture(session), seen), name
    assert all(map(np.array_equal, drive_arrays(session.drive), drive_arrays(before.drive)))


@BOTH
def test_a_modulator_that_is_off_leaves_the_light_behind_it_as_before_it(session: EditingSession) -> None:
    last = session.system.element_names[2]
    chain_edits.switch_element(session, last)
    system = session.system
    drive = dict(session.drive) if system.is_chain else session.drive
    at = system.stages.index(system.stage_behind(last))
    before, behind = (hv.field_at(system, drive, stage=system.stages[at - step]).values for step in (1, 0))
    assert np.allclose(before, behind, rtol=0, atol=1e-12 * abs(before).max())


def test_a_mask_that_is_off_leaves_the_planes_where_they_are_and_comes_back_at_its_place() -> None:
    session = EditingSession(chain(_PHASE, {"kind": "space", "distance": "2 mm"}, {**_MASK}))
    before, seen = session.system, picture(session)
    chain_edits.switch_element(session, "mask")
    assert not session.system.is_chain
    assert session.system.planes_m.tolist() == pytest.approx([12e-3])  # 2 mm that the space had
    assert session.view_settings.plane_m == pytest.approx(12e-3)
    chain_edits.switch_element(session, "mask")
    assert session.system.element_names[:3] == before.element_names
    assert session.system.planes_m.tolist() == pytest.approx([10e-3])
    assert np.allclose(picture(session), seen, rtol=1e-9, atol=1e-9 * seen.max())
    session.close()


@BOTH
@pytest.mark.parametrize("kind", [kind for kind in chain_edits.ADDED_KINDS if kind not in ("fourier", "lens", "mask")])
def test_a_new_element_changes_no_light_until_it_has_patterns(session: EditingSession, kind: str) -> None:
    """As it passes all light, also behind the last element, before which the planes are measured from then on.

    A space is as long as nothing but itself is: it changes the picture, unless it has no length.
    """
    seen = picture(session)
    names = session.system.element_names
    for behind in (names[0], names[2]):
        if kind == "space" and behind == names[2]:
            continue
        new = chain_edits.add_element(session, kind, behind)
        assert session.system.element_names[session.system.part(behind) + 1] == new
        if kind == "space":
            chain_edits.change_element(session, new, "distance", 0.0)
        assert np.allclose(picture(session), seen, rtol=1e-6, atol=1e-6 * seen.max()), behind
        while session.can_undo:
            session.undo()


def test_an_element_in_a_space_halves_it_and_keeps_its_stops(session: EditingSession) -> None:
    seen = picture(session)
    new = chain_edits.add_element(session, "phase", "space")
    assert session.system.element_names == ("phase", "space", new, "space2", "coarse")
    lengths = [getattr(e, "distance_m", None) for e in session.system.elements]
    assert lengths == [None, 1e-3, None, 1e-3, None]
    # the stops stand before it, and light that they cut off spreads as it did: what differs leaves the field between
    assert np.corrcoef(picture(session).ravel(), seen.ravel())[0, 1] > 0.9


@BOTH
def test_moving_exchanges_elements_and_keeps_their_patterns(session: EditingSession) -> None:
    first, _, last = session.system.element_names[:3]
    if session.system.is_chain:  # the coarse one can't be the first: its pitch would be the sample
        chain_edits.change_element(session, last, "pitch", 8e-6)
        chain_edits.switch_element(session, "space")  # whose stops are those of an element before it
    before = chain_edits.patterns_by_name(session.document)
    chain_edits.move_element(session, last, -1)
    assert session.system.element_names[:3:2] == (last, first)
    after = chain_edits.patterns_by_name(session.document)
    assert all(np.array_equal(after[name], before[name]) for name in (first, last))
    session.undo()
    assert session.system.element_names[:3:2] == (first, last)


def test_removing_the_last_element_leaves_the_picture_where_it_is() -> None:
    session = EditingSession(chain())
    chain_edits.switch_element(session, "space")  # its stops would have no space to be in
    patterns = session.drive["phase"]
    chain_edits.remove_element(session, "coarse")
    assert not session.system.is_chain  # one modulator and its planes are the short form
    assert session.view_settings.plane_m == pytest.approx(12e-3)
    alone = chain(_PHASE).with_(planes=["12 mm"])
    seen = hv.simulate(alone, patterns[:, None], backend="torch64").xyz[0]
    assert np.allclose(picture(session), seen, rtol=1e-9, atol=1e-9 * seen.max())
    session.close()


def test_a_length_is_one_step_of_undo_while_it_is_dragged(session: EditingSession) -> None:
    steps = len(session.history)
    for length_m in (2.1e-3, 2.4e-3, 3e-3):
        chain_edits.change_element(session, "space", "distance", length_m)
    assert len(session.history) == steps + 1
    session.undo()
    assert session.system.way.distances_m[0] == 2e-3


REFUSED = {
    "a space first": (chain, lambda s: chain_edits.remove_element(s, "phase"), "a space"),
    "a pitch that doesn't fit": (chain, lambda s: chain_edits.change_element(s, "coarse", "pitch", 9e-6), "9 um"),
    "coarse pixels first": (chain, lambda s: chain_edits.move_element(s, "coarse", -1), "whole multiple"),
    "beyond the ends": (chain, lambda s: chain_edits.move_element(s, "coarse", 1), "the last"),
    "a space that is moved": (chain, lambda s: chain_edits.move_element(s, "space", 1), "a space"),
    "a space behind the last": (two, lambda s: chain_edits.add_element(s, "space", "phase2"), "one space"),
    "a Fourier plane between": (two, lambda s: chain_edits.add_element(s, "fourier", "phase1"), "focal_length"),
    "the only modulator": (
        lambda: two().edit({"modulators": two().modulators[:1], "gap": None}),
        lambda s: chain_edits.remove_element(s, "phase"),
        "no modulator",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_can_not_be_is_refused_in_the_models_words_and_changes_nothing(name: str) -> None:
    make, edit, words = REFUSED[name]
    session = EditingSession(make())
    before = session.document
    with pytest.raises(UserError, match=words) as caught:
        edit(session)
    assert "\n" not in str(caught.value)
    assert session.document is before
    session.close()


def test_other_patterns_end_what_is_switched_off_and_another_bench_all_of_it(session: EditingSession) -> None:
    chain_edits.switch_element(session, "space")
    chain_edits.switch_element(session, "coarse")
    session.edit("Random patterns", drive=hv.random_drive(session.system, 3))
    assert [parked.name for parked in session.document.parked] == ["space"]
    other = two()
    session.edit("Open", system=other, drive=hv.random_drive(other))
    assert session.document.parked == ()


@BOTH
def test_a_saved_session_has_what_is_switched_off(session: EditingSession, tmp_path: Path) -> None:
    seen, names = picture(session), session.system.element_names
    for name in names[:3]:
        chain_edits.switch_element(session, name)
    SessionArchive(tmp_path).write(SessionData(session.history, session.history_position, {}), {})
    data, unreadable = read_session(tmp_path)
    assert not unreadable
    again = EditingSession(session.system)
    again.edit("Read", **{key: getattr(data.present, key) for key in ("system", "drive", "parked", "view_settings")})
    for name in names[:3]:
        assert not chain_edits.is_on(again.document, name)
        chain_edits.switch_element(again, name)
    assert np.array_equal(picture(again), seen)
    again.close()


def test_a_chain_with_complex_patterns_survives_a_saved_session(tmp_path: Path) -> None:
    session = EditingSession(chain({**_PHASE, "kind": "complex", "name": "arms"}))
    SessionArchive(tmp_path).write(SessionData(session.history, 0, {}), {})
    data, unreadable = read_session(tmp_path)
    assert not unreadable
    assert np.array_equal(data.present.drive["arms"], session.drive["arms"])
    session.close()


@BOTH
def test_a_renderer_and_a_worker_take_the_patterns_of_an_edit(session: EditingSession) -> None:
    """Inputs are compared by identity, and workers are other processes."""
    before = session.drive
    chain_edits.switch_element(session, session.system.element_names[2])
    assert not are_same((session.drive,), (before,))
    assert are_same((session.drive,), (session.drive,))
    copy = pickle.loads(pickle.dumps(session.drive))
    assert all(map(np.array_equal, drive_arrays(copy), drive_arrays(session.drive)))
