"""Edits, undo, snapshots, sides: what a session is when something is done to it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.util.errors import UserError
from holoview.viewer.document.document import (
    MAX_STEPS,
    MERGE_WITHIN_S,
    Document,
    Gesture,
    History,
    HistoryStep,
    fit_drive,
)
from holoview.viewer.document.editing_session import Change, EditingSession
from holoview.viewer.document.target_builder import TargetSpec
from holoview.viewer.render.view_settings import TARGET, ComparisonSide, ViewSettings
from tests.document.conftest import small_system
from tests.patience import PATIENCE_S


def test_every_edit_is_a_step_that_undo_and_redo_walk(session: EditingSession) -> None:
    session.change("Gap", {"gap": 2e-3})
    session.change("Planes", {"planes": [5e-3]})
    assert [step.label for step in session.history] == ["Start", "Gap", "Planes"]
    assert session.undo() == "Planes"
    assert (len(session.system.planes_m), session.system.gap_m) == (2, 2e-3)
    assert session.undo() == "Gap" and session.system.gap_m == 1e-3
    assert session.undo() is None
    assert session.redo() == "Gap" and session.redo() == "Planes" and session.redo() is None
    assert (len(session.system.planes_m), session.system.gap_m) == (1, 2e-3)


LOOKS: list[dict[str, Any]] = [
    {"compare": "wipe"},
    {"exposure_stops": 1.0},
    {"region": (4, 4, 10, 10)},
    {"page": "phase"},
    {"plane_m": 3.5e-3},
    {"solo": 1},
]


@pytest.mark.parametrize("look", LOOKS, ids=lambda look: next(iter(look)))
def test_a_look_is_no_edit_and_forgets_nothing_that_was_undone(session: EditingSession, look: dict[str, Any]) -> None:
    session.change("Gap", {"gap": 2e-3})
    session.undo()
    before = session.view_settings
    session.edit_view("Look", **look)
    assert len(session.history) == 2 and not session.can_undo
    assert session.redo() == "Gap" and session.system.gap_m == 2e-3
    assert session.view_settings == before.with_(**look), "the look stays when edits are walked"
    assert session.undo() == "Gap" and session.view_settings == before.with_(**look)
    assert session.look_back() == "Look" and session.view_settings == before and session.look_back() is None
    assert session.look_forward() == "Look" and session.view_settings == before.with_(**look)
    assert session.look_forward() is None and session.redo() == "Gap"


def test_a_new_look_forgets_those_that_were_gone_back_from(session: EditingSession) -> None:
    session.edit_view("Exposure", exposure_stops=1.0)
    session.look_back()
    session.edit_view("Page", page="phase")
    assert not session.can_look_forward and session.look_back() == "Page" and not session.can_look_back


def test_a_drag_of_a_look_is_one_step(session: EditingSession) -> None:
    for wipe in (0.4, 0.3, 0.2):
        session.edit_view("Wipe", merge_key="wipe", wipe=wipe)
    session.end_gesture()
    session.edit_view("Wipe", merge_key="wipe", wipe=0.1)
    assert session.look_back() == "Wipe" and session.view_settings.wipe == 0.2
    assert session.look_back() == "Wipe" and session.view_settings.wipe == 0.5 and not session.can_look_back


def test_an_edit_that_chooses_a_look_takes_it_back_with_it(session: EditingSession) -> None:
    session.edit_view("Exposure", exposure_stops=1.0)
    session.edit("Open", drive=1 - session.drive, view_settings=session.view_settings.with_(exposure_stops=-3.0))
    session.edit_view("Zoom", zoom=2.0, undoable=False)
    session.undo()
    assert (session.view_settings.exposure_stops, session.view_settings.zoom) == (1.0, 2.0)
    session.redo()
    assert (session.view_settings.exposure_stops, session.view_settings.zoom) == (-3.0, 2.0)


def test_undo_of_the_lasers_leaves_one_on(session: EditingSession) -> None:
    session.change("One laser", {"amplitudes": [[0.0, 1.0, 0.0]]})
    session.undo()
    session.edit_view("Mute", muted=frozenset({1}))
    session.redo()
    assert session.displayed_document.system.amplitudes[0, 1] == 1.0 and not session.view_settings.muted


def test_the_end_of_a_comparison_brings_back_what_its_beginning_chose(session: EditingSession) -> None:
    before = session.view_settings
    session.edit_view("Schemes", a=TARGET, b=TARGET, compare="side-by-side", page="image", exposure_stops=-4.0)
    session.edit_view("Zoom", zoom=3.0, undoable=False)
    session.end_comparison()
    assert session.view_settings == before.with_(zoom=3.0)
    session.edit_view("Schemes", compare="wipe", exposure_stops=-4.0)
    session.edit_view("Exposure", exposure_stops=2.0)
    session.edit_view("Mode", compare="difference")
    session.end_comparison()
    assert session.view_settings == before.with_(zoom=3.0, exposure_stops=2.0), "what was chosen since stays"
    assert session.look_back() == "No comparison" and session.view_settings.compare == "difference"


def test_a_new_edit_forgets_what_was_undone(session: EditingSession) -> None:
    session.change("Gap", {"gap": 2e-3})
    session.undo()
    session.change("Gap", {"gap": 3e-3})
    assert not session.can_redo and len(session.history) == 2


def test_a_drag_is_one_step_until_the_hand_lets_go(session: EditingSession) -> None:
    for gap in (1.1e-3, 1.2e-3, 1.3e-3):
        session.change("Gap", {"gap": gap}, merge_key="gap")
    session.end_gesture()
    session.change("Gap", {"gap": 1.4e-3}, merge_key="gap")
    assert len(session.history) == 3
    session.undo()
    assert session.system.gap_m == 1.3e-3
    session.undo()
    assert session.system.gap_m == 1e-3


def test_edits_with_one_key_are_steps_apart_when_time_lies_between(session: EditingSession) -> None:
    now = 0.0
    history = History(HistoryStep("Start", session.document, now), clock=lambda: now)
    for when in (1.0, 1.5, 1.5 + 2 * MERGE_WITHIN_S):
        now = when
        history.add("Wheel", session.document, merge_key="wheel")
    assert [step.when for step in history.steps] == [0.0, 1.5, 3.5]


def test_edits_while_a_button_is_held_are_one_step_however_slow_the_frames_are(session: EditingSession) -> None:
    now = 0.0
    history = History(HistoryStep("Start", session.document, now), clock=lambda: now)
    for when, is_held in ((1.0, False), (10.0, True), (20.0, True), (30.0, True), (40.0, False)):
        now = when
        history.hold(is_held)
        history.add("Focal plane", session.document, merge_key="plane")
    assert [step.when for step in history.steps] == [0.0, 1.0, 30.0, 40.0]


def test_edits_of_one_gesture_are_one_step_at_any_time(session: EditingSession) -> None:
    now = 0.0
    history = History(HistoryStep("Start", session.document, now), clock=lambda: now)
    first, second = Gesture(), Gesture()
    for when, gesture in ((10.0, first), (20.0, first), (20.0, second), (30.0, second)):
        now = when
        history.add("Play", session.document, merge_key=gesture)
    assert [step.when for step in history.steps] == [0.0, 20.0, 30.0]


def test_the_history_is_bounded_and_keeps_the_present(session: EditingSession) -> None:
    for number in range(MAX_STEPS + 10):
        session.edit("Name", origin=f"{number}")
        session.edit_view("Wipe", wipe=(number + 1) / 1000)
    assert len(session.history) == MAX_STEPS and session.history_position == MAX_STEPS - 1
    assert session.document.origin == f"{MAX_STEPS + 9}"
    assert sum(1 for _ in iter(session.look_back, None)) == MAX_STEPS
    assert session.view_settings.wipe == pytest.approx(10 / 1000)


def test_an_edit_that_changes_nothing_is_no_step(session: EditingSession) -> None:
    session.change("Gap", {"gap": 1e-3})
    session.edit_view("Exposure", exposure_stops=0.0)
    assert not session.can_undo


def test_an_impossible_edit_leaves_everything_as_it_was(session: EditingSession) -> None:
    before = session.document
    for changes in ({"gap": -1.0}, {"wavelengths": ["460 nm"], "amplitudes": [[0.0]]}):
        with pytest.raises(UserError):
            session.change("Wrong", changes)
    with pytest.raises(UserError, match="unknown field"):
        session.edit_view("Wrong", exposuer=1.0)
    assert session.document is before and not session.can_undo


def test_zoom_is_no_step_and_undo_leaves_it_alone(session: EditingSession) -> None:
    session.edit_view("Exposure", exposure_stops=1.0)
    session.edit_view("Zoom", zoom=4.0, undoable=False)
    session.look_back()
    assert (session.view_settings.zoom, session.view_settings.exposure_stops) == (4.0, 0.0)


def test_listeners_hear_which_kinds_changed(session: EditingSession, target_spec: TargetSpec) -> None:
    heard: list[Change] = []
    stop = session.add_listener(heard.append)
    session.change("Gap", {"gap": 2e-3})
    session.edit_view("Exposure", exposure_stops=1.0)
    session.edit("Target", target_spec=target_spec)
    stop()
    session.undo()
    assert [change.kinds for change in heard] == [
        {"system", "target", "history"},
        {"look", "history"},
        {"target", "history"},
    ]


def test_patterns_are_read_only_and_copied_from_the_caller() -> None:
    drive = np.zeros(small_system().drive_shape, np.float32)
    session = EditingSession(small_system(), drive)
    drive[:] = 1.0
    assert session.drive.max() == 0.0
    with pytest.raises(ValueError, match="read-only"):
        session.drive[:] = 1.0


@pytest.mark.parametrize(
    ("shape", "note"),
    [
        ((3, 2, 24, 32), "repeated to 3 frames"),
        ((1, 1, 24, 32), "the first modulator's patterns"),
        ((1, 2, 12, 16), "random patterns of the new size"),
    ],
)
def test_patterns_are_made_to_fit_a_changed_bench(shape: tuple[int, int, int, int], note: str) -> None:
    drive = EditingSession(small_system()).drive
    made, words = fit_drive(drive, shape)
    assert made.shape == shape and words == note
    if shape[2:] == drive.shape[2:]:
        assert np.array_equal(made[0, 0], drive[0, 0]), "what fits is kept"


def test_more_frames_keep_the_session_whole_and_undo_brings_the_patterns_back(session: EditingSession) -> None:
    drive = session.drive
    session.change("Frames", {"frames": 3})
    assert session.drive.shape[0] == 3 and "repeated" in session.document.origin
    session.undo()
    assert session.drive is drive


def test_solo_and_mute_switch_lasers_off_without_touching_the_bench(session: EditingSession) -> None:
    session.edit_view("Mute", muted=frozenset({1}))
    assert session.displayed_document.system.amplitudes.tolist() == [[1.0, 0.0, 1.0]]
    session.edit_view("Solo", solo=1)
    assert session.displayed_document.system.amplitudes.tolist() == [[0.0, 1.0, 0.0]]
    assert session.system.amplitudes.tolist() == [[1.0, 1.0, 1.0]]
    with pytest.raises(UserError, match="none is left on"):
        session.edit("Dark", system=session.system.edit({"amplitudes": [[1.0, 0.0, 1.0]]}))


def test_a_look_that_points_outside_a_smaller_bench_is_brought_inside(session: EditingSession) -> None:
    session.edit_view("Region", region=(40, 30, 20, 10), solo=2, modulator=1)
    system = session.system.edit({"wavelengths": ["532 nm"], "amplitudes": [[1.0]], "shape": [20, 24]})
    session.edit("Smaller", system=system)
    assert session.view_settings.region == (40, 30, 8, 10) and session.view_settings.solo is None
    assert session.document.measured_region == (40, 30, 8, 10)


def test_without_a_drawn_region_the_central_half_is_measured(session: EditingSession) -> None:
    assert session.document.measured_region == (16, 12, 32, 24)


def test_snapshots_are_pinned_renamed_and_forgotten(session: EditingSession) -> None:
    assert session.pin() == "Snapshot 1" and session.pin("mine") == "mine"
    session.change("Gap", {"gap": 2e-3})
    session.edit_view("Compare", a=ComparisonSide("snapshot", "mine"), b=TARGET)
    scene = session.scene_for(session.view_settings.a)
    assert scene is not None and scene.system.gap_m == 1e-3
    session.rename_snapshot("mine", "yours")
    assert list(session.snapshots) == ["Snapshot 1", "yours"] and session.view_settings.a.name == "yours"
    with pytest.raises(UserError, match="isn't taken"):
        session.rename_snapshot("yours", "Snapshot 1")
    session.unpin("yours")
    assert session.view_settings.a.kind == "now" and list(session.snapshots) == ["Snapshot 1"]


def test_looks_before_and_after_and_undone_steps_know_a_snapshot_by_its_new_name(session: EditingSession) -> None:
    session.edit_view("Compare", b=ComparisonSide("snapshot", session.pin("mine")))
    session.edit("Pattern", drive=1 - session.drive)
    session.edit_view("Compare", b=TARGET)
    session.edit_view("Swap", a=ComparisonSide("snapshot", "mine"))
    assert session.look_back() == "Swap"
    session.rename_snapshot("mine", "yours")
    assert session.look_back() == "Compare" and session.view_settings.b.name == "yours"
    assert session.look_forward() == "Compare" and session.look_forward() == "Swap"
    assert session.view_settings.a.name == "yours" and session.scene_for(session.view_settings.a) is not None
    session.unpin("yours")
    looks = [step.document.view_settings for step in session.history]
    while session.look_back() is not None:
        looks.append(session.view_settings)
    assert len(looks) == 5 and all(side.kind != "snapshot" for look in looks for side in (look.a, look.b))


def test_another_preset_is_a_side_at_this_benchs_pixel_count(session: EditingSession) -> None:
    scene = session.scene_for(ComparisonSide("preset", "simultaneous"))
    assert scene is not None and scene.drive.shape[2:] == (24, 32)
    assert session.scene_for(TARGET) is None


def test_targets_are_built_in_the_background_and_heard_of(session: EditingSession, target_spec: TargetSpec) -> None:
    session.edit("Target", target_spec=target_spec)
    assert session.target_at() is None
    assert session.wait_until_idle(PATIENCE_S)
    image = session.target_at()
    assert image is not None and image.shape == (48, 64, 3)
    assert image[24, 32, 1] == pytest.approx(((230 / 255 + 0.055) / 1.055) ** 2.4, rel=1e-4)
    assert session.target_at(3.5e-3) is None and session.wait_until_idle(PATIENCE_S)
    assert session.target_at(3.5e-3) is not None, "planes between those of the bench have a target too"


def test_a_target_that_cannot_be_built_is_told_once(session: EditingSession, tmp_path: Path) -> None:
    session.edit("Target", target_spec=TargetSpec(tmp_path / "gone", "gone"))
    session.target_at()
    session.wait_until_idle(PATIENCE_S)
    assert session.target_at() is None
    assert [message.kind for message in session.messages.all] == ["error"]


def test_a_failing_delivery_becomes_a_message_and_the_rest_is_still_made(session: EditingSession) -> None:
    done: list[int] = []
    session.call_on_owner(lambda: done.append(1 // 0))
    session.call_on_owner(lambda: done.append(2))
    session.poll()
    (message,) = session.messages.all
    assert done == [2] and message.kind == "error"
    assert "ZeroDivisionError" in message.text and "Traceback" in message.details


def test_looks_refuse_what_makes_no_sense() -> None:
    look = ViewSettings(plane_m=0.01)
    for field, value in (
        ("exposure_stops", 1e9),
        ("gamma", 0.0),
        ("channel", "infrared"),
        ("low", 1.0),
        ("region", (0, 0, 0, 5)),
        ("plane_m", float("inf")),
        ("wipe", 2.0),
    ):
        with pytest.raises(UserError):
            look.with_(**{field: value})
    with pytest.raises(UserError, match="name"):
        ComparisonSide("snapshot")


def test_a_state_refuses_patterns_of_another_shape() -> None:
    with pytest.raises(UserError, match="patterns"):
        Document(small_system(), np.zeros((1, 1, 2, 2), np.float32), ViewSettings(plane_m=0.01))


def test_a_snapshot_named_by_a_file_has_a_name_that_can_be_shown(session: EditingSession) -> None:
    """Of a file whose name isn't UTF-8."""
    assert session.pin_beside("gap\udcff.toml", session.document) == r"gap\udcff.toml"
    assert session.pin_beside("gap\udcff.toml", session.document) == r"gap\udcff.toml (2)"
