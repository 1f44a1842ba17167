"""A field is a document: opened, focused on either side, saved with its session, and refused what needs a modulator."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import holoview as hv
from holoview.holograms.fields.interpret import strips
from holoview.holograms.files.request import Order, ReadRequest
from holoview.holograms.targets.target import Placement
from holoview.light.engine.wgpu_executor import WgpuExecutor
from holoview.light.gpu.adapter import MIB
from holoview.light.gpu.device import Device
from holoview.light.model.plan import make_plan
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.errors import UserError
from holoview.viewer.document.archive import SessionArchive, SessionData, read_session
from holoview.viewer.document.editing_session import EditingSession, OptimisationChoices
from holoview.viewer.document.file_loader import FileLoader, most_samples_for, read_content
from holoview.viewer.document.focus_edits import focus_at, focus_range_m, look_on_other_side
from holoview.viewer.document.optimisation_job import chosen_optimisation, read_rest, start_optimisation
from holoview.viewer.document.target_builder import TargetSpec, example_target
from holoview.viewer.render.page_images import phase_turns
from tests.document.conftest import small_system
from tests.patience import PATIENCE_S

REQUEST = ReadRequest(pitch_m=(8e-6, 8e-6), wavelengths_m=(638e-9, 532e-9), distance_m=2e-3)


def _values() -> NDArray[np.complex64]:
    return np.exp(2j * np.pi * np.random.default_rng(0).random((2, 24, 32))).astype(np.complex64)


@pytest.fixture
def shown(tmp_path: Path) -> Iterator[EditingSession]:
    """A session of a bench of two modulators, in which the file of a field was opened."""
    np.save(tmp_path / "field.npy", _values())
    session = EditingSession(small_system())
    loader = FileLoader(session, quick=True)
    loader.apply(read_content(tmp_path / "field.npy", session.system, REQUEST))
    yield session
    loader.close()
    session.close()


def test_a_file_of_another_program_takes_the_place_of_the_bench(shown: EditingSession) -> None:
    assert shown.system.is_field and shown.document.origin == "field field.npy"
    np.testing.assert_array_equal(shown.drive[0], _values())
    assert shown.view_settings.plane_m == 2e-3
    turns = phase_turns(shown.system, shown.drive, 0, 0)
    np.testing.assert_allclose(np.exp(2j * np.pi * turns), _values()[0], atol=1e-6)
    shown.undo()
    assert not shown.system.is_field and shown.drive.dtype == np.float32


def test_a_file_that_is_being_read_can_be_cancelled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The job is cancelled after the first strip; the others aren't read, and the document stays."""
    monkeypatch.setattr(strips, "_STRIP_BYTES", 4 * 16 * 32 * 2)  # four rows of two colours
    np.save(tmp_path / "field.npy", _values())
    session = EditingSession(small_system())
    loader = FileLoader(session, quick=False)
    before, read = session.document, []
    mean = strips._mean

    def cancelled(values: NDArray[Any], decimate: int) -> NDArray[Any]:
        read.append(values)
        if len(read) == 1:
            session.jobs.active[0].cancel()
        return mean(values, decimate)

    monkeypatch.setattr(strips, "_mean", cancelled)
    loader.open(tmp_path / "field.npy", REQUEST)
    assert loader.is_opening and session.wait_until_idle(PATIENCE_S)
    assert len(read) == 1 and not loader.is_opening and session.document is before
    loader.close()
    session.close()


@pytest.mark.gpu
@pytest.mark.parametrize("mib", [1, 4])
def test_of_a_field_that_a_device_cannot_hold_the_middle_is_shown(device: Device, tmp_path: Path, mib: int) -> None:
    """The largest field that is read as a whole fits a device which binds so little; a larger one is cut."""
    limits = device.limits | {"max-storage-buffer-binding-size": mib * MIB}
    small = Device(device.raw, device.info, limits)
    side = math.isqrt(most_samples_for(mib * MIB))
    plan = make_plan(hv.load_field(np.ones((side, side), np.complex64), pitch="8um", wavelengths="532nm").system)
    WgpuExecutor(plan, FrameInputs(plan, np.ones(plan.system.drive_shape, np.complex64)), small)
    np.save(tmp_path / "field.npy", np.ones((1400, 1100), np.complex64))
    request = replace(REQUEST, wavelengths_m=(532e-9,))
    content = read_content(tmp_path / "field.npy", small_system(), request, most_samples=most_samples_for(mib * MIB))
    assert content.system is not None and content.system.modulators[0].shape == (1024, 1024)
    assert any("--decimate 2" in note for note in content.notes)
    assert most_samples_for(128 * MIB) > 1920 * 1080


def test_what_nothing_tells_is_guessed_and_said(tmp_path: Path) -> None:
    np.save(tmp_path / "field.npy", _values())
    content = read_content(tmp_path / "field.npy", small_system())
    assert content.kind == "field" and any("pitch" in note and "guessed" in note for note in content.notes)


def test_the_other_side_of_a_field_can_be_focused_at(shown: EditingSession) -> None:
    low, high = focus_range_m(shown.system)
    assert (low, high) == pytest.approx((1e-3, 3e-3))
    focus_at(shown, 2.5e-3)
    look_on_other_side(shown)
    assert shown.view_settings.plane_m == -2.5e-3 and focus_range_m(shown.system) == pytest.approx((-3e-3, -1e-3))
    shown.undo()
    assert shown.view_settings.plane_m == 2.5e-3


def test_a_field_whose_image_lies_in_its_plane_is_looked_at_on_both_sides(shown: EditingSession) -> None:
    low, high = focus_range_m(shown.system.with_(planes=[0.0]))
    # the finest detail, a line pair of two samples, walks off by the height of 24 samples over N·dx²/λ
    assert high == -low == pytest.approx(24 * (8e-6) ** 2 / 638e-9)


def test_a_session_with_a_field_comes_back_from_its_archive(shown: EditingSession, tmp_path: Path) -> None:
    data = SessionData(shown.history, shown.history_position, {"field": shown.document})
    SessionArchive(tmp_path / "session").write(data, {})
    again, unreadable = read_session(tmp_path / "session")
    assert unreadable == []
    assert again.present.system == shown.system
    np.testing.assert_array_equal(again.present.drive, shown.drive)
    assert again.present.drive is again.snapshots["field"].drive  # steps share what is stored once


def test_a_field_can_be_the_target_and_is_read_again_with_the_session(tmp_path: Path) -> None:
    session = EditingSession(small_system())
    field = hv.load_field(_values(), pitch="8 um", wavelengths=["638 nm", "532 nm"])
    field.save(tmp_path / "light.safetensors")
    loader = FileLoader(session, quick=False)
    loader.open_field_as_target(tmp_path / "light.safetensors")
    spec = session.target_spec
    assert spec is not None and not spec.is_stack
    expected = field.scene().images(session.system, session.system.planes_m)
    np.testing.assert_array_equal(spec.build(session.system).stack, expected)
    data = SessionData(session.history, session.history_position, {})
    SessionArchive(tmp_path / "session").write(data, {})
    again = read_session(tmp_path / "session")[0].present.target_spec
    assert again is not None
    np.testing.assert_array_equal(again.build(session.system).stack, expected)
    with pytest.raises(UserError, match="isn't a complex field"):
        loader.open_field_as_target(next((tmp_path / "session").glob("*.json")))
    loader.close()
    session.close()


@pytest.mark.parametrize(
    "changes", [{"wavelengths": ["532 nm"], "amplitudes": [[1.0]]}, {"shape": [12, 12]}, {"frames": 2}]
)
def test_the_samples_of_a_field_are_not_made_up(shown: EditingSession, changes: dict[str, Any]) -> None:
    with pytest.raises(UserError, match="2 wavelengths, 32 x 24 samples"):
        shown.change("Bench", changes)
    assert shown.drive.shape == (1, 2, 24, 32)


def test_a_field_has_nothing_to_optimise(shown: EditingSession) -> None:
    with pytest.raises(UserError, match="no patterns"):
        start_optimisation(shown)


def test_a_recording_is_saved_with_its_session_and_its_order_can_be_moved_again(tmp_path: Path) -> None:
    y, x = np.mgrid[:48, :64]
    fringes = np.abs(1 + np.exp(2j * np.pi * (0.12 * y + 0.2 * x)) * np.exp(1j * np.hypot(y - 24, x - 32) / 9)) ** 2
    np.save(tmp_path / "fringes.npy", fringes)
    session = EditingSession(small_system())
    request = replace(REQUEST, wavelengths_m=(532e-9,), recording="off-axis")
    loader = FileLoader(session, quick=True)
    loader.apply(read_content(tmp_path / "fringes.npy", session.system, request))
    first = session.document.recorded
    assert first is not None
    moved = first.with_order(0, Order((0.1, 0.2), 0.08))
    session.edit("Order", drive=moved.hologram().drive, recorded=moved)
    folder = tmp_path / "saved"
    SessionArchive(folder).write(SessionData(session.history, session.history_position, {}), {"title": "", "when": 0.0})
    data, unreadable = read_session(folder)
    assert not unreadable
    one, other = (step.document.recorded for step in data.steps[-2:])
    assert one is not None and other is not None and one.recording.pictures is other.recording.pictures
    assert (one.recording.orders, other.recording.orders) == (first.recording.orders, moved.recording.orders)
    assert other.recording.kind == "off-axis" and other.recording.name == "fringes.npy"
    np.testing.assert_array_equal(other.hologram().drive, data.present.drive)
    loader.close()
    session.close()


@pytest.mark.parametrize(("kind", "count"), [("in-line", 1), ("in-line", 2), ("phase-shifting", 4)])
def test_recordings_of_other_kinds_are_saved_with_their_session_too(tmp_path: Path, kind: str, count: int) -> None:
    y, x = np.mgrid[:48, :64]
    wave = np.exp(1j * np.hypot(y - 24, x - 32) ** 2 / 90)
    pictures = np.stack([np.abs(2 + wave * np.exp(-2j * np.pi * n / 4)) ** 2 for n in range(count)])
    np.save(tmp_path / "pictures.npy", np.rint(20 * pictures))
    session = EditingSession(small_system())
    loader = FileLoader(session, quick=True)
    request = replace(
        REQUEST, wavelengths_m=(532e-9,), conjugated=True, recording="in-line" if kind == "in-line" else None
    )
    loader.apply(read_content(tmp_path / "pictures.npy", session.system, request))
    opened = session.document.recorded
    assert opened is not None and opened.recording.kind == kind and opened.recording.conjugated
    other = opened.conjugate()
    session.edit("Recording", drive=other.hologram().drive, recorded=other)
    SessionArchive(tmp_path / "s").write(
        SessionData(session.history, session.history_position, {}), {"title": "", "when": 0}
    )
    data, unreadable = read_session(tmp_path / "s")
    assert not unreadable
    for step in data.steps[-2:]:
        assert step.document.recorded is not None and step.document.recorded.recording.kind == kind
        np.testing.assert_array_equal(step.document.recorded.hologram().drive, step.document.drive)
    is_equal = np.array_equal(data.steps[-1].document.drive, data.steps[-2].document.drive)
    assert is_equal == (kind == "in-line")  # its twin is of the same numbers
    session.undo()
    assert session.document.recorded is opened
    loader.close()
    session.close()


def test_the_complex_field_of_a_target_is_found_in_the_background(tmp_path: Path) -> None:
    """The wanted field is the bench's own with other patterns, so that the loss can fall to 0."""
    session = EditingSession(small_system())
    wanted = hv.Hologram(hv.random_drive(session.system, 7), session.system)
    hv.as_field(wanted).save(tmp_path / "wanted.safetensors")
    loader = FileLoader(session, quick=False)
    loader.open_field_as_target(tmp_path / "wanted.safetensors")
    assert session.target_spec is not None and session.target_spec.is_field
    session.choose_optimisation(OptimisationChoices(loss="field", iterations=12))
    job = start_optimisation(session, chosen_optimisation(session.optimisation_choices, session.system))
    assert session.wait_until_idle(PATIENCE_S)
    losses = [progress.loss for progress in job.progress]
    # of independent speckle 1 − |⟨T, E⟩|²/… is 1 but for 1/n of n modes; each step follows the gradient
    assert losses[0] > 0.9 and losses[-1] < 0.9 * losses[0]
    assert "optimised, 12 iterations" in session.document.origin
    rest = read_rest({"settings": json.dumps(dataclasses.asdict(job.request.settings)), "compares_fields": True})
    assert rest is not None and rest.compares_fields and rest.settings == job.request.settings
    session.edit("Picture", target_spec=example_target())
    with pytest.raises(UserError, match='"field" with still life'):
        start_optimisation(session, chosen_optimisation(session.optimisation_choices, session.system))
    loader.close()
    session.close()


def test_a_target_from_a_field_stands_where_it_is_placed(tmp_path: Path) -> None:
    system = small_system()
    field = hv.as_field(hv.Hologram(hv.random_drive(system, 7), system))
    field.save(tmp_path / "wanted.safetensors")
    spec = TargetSpec(tmp_path / "wanted.safetensors", "wanted", Placement(at_m=1e-3))
    near = TargetSpec(tmp_path / "wanted.safetensors", "wanted").stack_for(system.with_(planes=[2e-3, 3e-3]))
    # 1 mm further back, the same light reaches the planes that lie 1 mm further back; float32 pictures
    np.testing.assert_allclose(spec.stack_for(system), near, atol=1e-5 * near.max())
