"""The panel of the eye and the page of the eyebox: a pupil that follows the pointer, focus in dioptres, keys."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from imgui_bundle import imgui

import holoview as hv
from holoview.holograms.targets.picture import Picture
from holoview.holograms.targets.target import Placement
from holoview.holograms.view import simulate
from holoview.light.model.focus import PupilPath
from holoview.light.model.system import System
from holoview.viewer.app.panels import ALL
from holoview.viewer.app.panels.eye import EyePanel
from holoview.viewer.app.panels.files import FilesPanel
from holoview.viewer.app.panels.focus import FocusPanel
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.document.focus_edits import dioptres_of, dioptres_text, eyebox_half_m, focus_at, move_pupil
from holoview.viewer.document.target_builder import TargetSpec
from holoview.viewer.render.page_images import eyebox_xyz
from holoview.viewer.render.view_settings import ACHROMATIC, NOW, TARGET
from tests.gui.conftest import Gui, small_bench
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu

PANELS = (ImagePanel, EyePanel, FocusPanel)


@pytest.fixture
def eye_gui(make_gui: Callable[..., Gui]) -> Gui:
    assert set(PANELS) <= set(ALL)
    gui = make_gui(small_bench(eye={"pupil": "2 mm"}), panels=PANELS, size=(900, 700))
    gui.context.show_panel("Eye")
    gui.draw_frames(3)
    return gui


def test_a_key_puts_the_eye_in_place_and_another_switches_its_colour_error(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(panels=PANELS)
    gui.press_chord("Y")
    assert gui.session.system.eye is not None and gui.session.system.eye.chromatic
    gui.press_chord("Shift+Y")
    assert gui.session.system.eye is not None and not gui.session.system.eye.chromatic
    gui.press_chord("Y")
    assert gui.session.system.eye is None


def test_a_drag_in_the_map_moves_the_pupil_in_one_step_of_undo(eye_gui: Gui) -> None:
    steps = len(eye_gui.session.history)
    eye_gui.drag(eye_gui.item_position("pupil map", 0.5, 0.5), eye_gui.item_position("pupil map", 0.5, 0.25), steps=6)
    eye = eye_gui.session.system.eye
    assert eye is not None
    assert eye.pupil_y_m == pytest.approx(-0.75 * eyebox_half_m(eye_gui.session.system), rel=0.05)
    assert eye.pupil_x_m == pytest.approx(0.0, abs=3e-5)
    assert len(eye_gui.session.history) == steps + 1


def test_the_wheel_changes_the_diameter(eye_gui: Gui) -> None:
    eye_gui.wheel(eye_gui.item_position("pupil map", 0.5, 0.5), -3)
    eye = eye_gui.session.system.eye
    assert eye is not None and eye.pupil_m == pytest.approx(2e-3 / 1.08**3, rel=0.01)


def test_accommodation_moves_the_focal_plane(eye_gui: Gui) -> None:
    eye_gui.drag(eye_gui.item_position("accommodation", 0.5), eye_gui.item_position("accommodation", 0.7))
    plane_m = eye_gui.session.view_settings.plane_m
    assert dioptres_of(eye_gui.session.system, plane_m) > 0.625
    assert plane_m > 10e-3  # nearer to the viewer


def test_a_long_tooltip_is_wrapped_and_all_of_it_in_the_window(eye_gui: Gui) -> None:
    place = eye_gui.item_position("accommodation", 0.9)
    eye_gui.move(place)
    eye_gui.move(place)
    eye_gui.draw_frames(60)  # a second, after which tooltips have come
    window = imgui.internal.find_window_by_name("##Tooltip_00")
    assert window is not None and window.was_active
    sentence = "Dioptres at which the eye is focused at its reference wavelength: 0 is infinity, 4 is 25 cm."
    assert window.size.x < 0.9 * imgui.calc_text_size(sentence).x
    assert window.pos.x >= 0 and window.pos.x + window.size.x <= 900


def test_a_plane_reads_alike_however_it_was_reached(eye_gui: Gui) -> None:
    system = eye_gui.session.system
    texts = {dioptres_text(system, 10e-3 + change) for change in (-1e-18, 0.0, 1e-18)}
    assert texts == {"0.62 D"}  # 0.625, of which rounding takes the even digit
    assert dioptres_text(system, float(system.planes_m.min()) - 1e-9) == "0.00 D"


def test_the_pupil_is_dragged_over_the_eyebox(eye_gui: Gui) -> None:
    eye_gui.context.commands.run("Eyebox")
    eye_gui.draw_until_idle()
    eye_gui.drag(eye_gui.item_position("image", 0.5, 0.5), eye_gui.item_position("image", 0.6, 0.5), steps=6)
    eye = eye_gui.session.system.eye
    assert eye is not None and eye.pupil_x_m > 1e-4 and abs(eye.pupil_y_m) < 5e-5


def test_no_plane_before_the_modulator_can_be_focused(eye_gui: Gui) -> None:
    focus_at(eye_gui.session, 0.0)
    system, plane_m = eye_gui.session.system, eye_gui.session.view_settings.plane_m
    assert system.eye is not None
    assert plane_m + system.eye.focus_shift_m(system.wavelengths_m).min() >= 0


def test_the_eyebox_by_place_holds_as_much_light_and_is_smaller_at_short_wavelengths() -> None:
    system = small_bench(wavelengths=["460 nm", "620 nm"], amplitudes=[[1.0, 0.0]], shape=[32, 48])
    drive = np.random.default_rng(0).random(system.drive_shape, dtype=np.float32)
    xyz = eyebox_xyz(system, drive, True)
    assert xyz.shape == (48, 48, 3)
    lit = np.flatnonzero(xyz[..., 1].sum(axis=0) > 1e-3 * xyz[..., 1].sum(axis=0).max())
    assert len(lit) == pytest.approx(48 * 460 / 620, abs=2)
    assert xyz[..., 1].mean() == pytest.approx(0.25, rel=1e-5)


def _of_shared_phases(is_shared: bool) -> System:
    """Two phase modulators with stops; of one frame, a pattern that all frames share is the same bench as a chain."""
    phase = {"kind": "phase", "pitch": 8e-6, "shape": (24, 32), "stroke": 7e-7, "shared": is_shared}
    spaces = {"kind": "space", "distance": 2e-3}, {"kind": "space", "iris_na": 0.02}
    elements = ({**phase, "name": "phase1"}, spaces[0], {**phase, "name": "phase2"}, spaces[1])
    return System([460e-9, 620e-9], [[1.0, 0.7]], elements=elements, planes_m=[5e-3])


@pytest.mark.parametrize("by_place", [False, True])
def test_the_eyebox_of_a_chain_is_that_of_the_same_short_form(by_place: bool) -> None:
    chain, short = _of_shared_phases(True), _of_shared_phases(False)
    assert chain.is_chain and not short.is_chain
    drives = hv.random_drive(chain, seed=2)
    together = np.stack([drives["phase1"], drives["phase2"]], axis=1)
    found, expected = eyebox_xyz(chain, drives, by_place), eyebox_xyz(short, together, by_place)
    np.testing.assert_allclose(found, expected, atol=1e-5 * expected.max())  # complex64: 6e-8 of each of 1e4 samples


def test_the_eyebox_shows_the_orders_of_a_grating_in_the_chain() -> None:
    """Lines of half a period of four pixels make the orders 0 and ±1, in the middle and at half the way to the edge."""
    phase = {"kind": "phase", "pitch": 8e-6, "shape": (32, 32), "stroke": 7e-7}
    lines = {"kind": "mask", "pitch": 8e-6, "shape": (32, 32), "pattern": "grating", "period": 32e-6}
    system = System([532e-9], [[1.0]], elements=[phase, lines], planes_m=[5e-3])
    xyz = eyebox_xyz(system, {"phase": np.zeros((1, 32, 32), np.float32)})
    bright = np.argwhere(xyz[..., 1] > 0.05 * xyz[..., 1].max()).tolist()
    assert bright == [[16, 8], [16, 16], [16, 24]]


def test_behind_a_fourier_plane_the_eyebox_is_the_image_of_what_stands_before_it() -> None:
    """A point x in the front focal plane sends light in the direction −x/f."""
    n, pitch_m, λ = 24, 8e-6, 532e-9
    amplitude = {"kind": "amplitude", "pitch": pitch_m, "shape": (n, n)}
    fourier = {"kind": "fourier", "focal_length": 0.95 * n * pitch_m**2 / λ}  # the image fills 1/0.95 of the eyebox
    elements = [{**amplitude, "name": "front"}, fourier, {**amplitude, "name": "back"}]
    system = System([λ], [[1.0]], elements=elements, planes_m=[5e-3])
    lit = np.zeros((1, n, n), np.float32)
    lit[:, :, n // 2 + 2 :] = 1.0  # two pixels off the axis: what stops cut makes edges a pixel wide
    xyz = eyebox_xyz(system, {"front": lit, "back": np.ones((1, n, n), np.float32)})
    columns = xyz[..., 1].sum(axis=0)
    assert columns[: len(columns) // 2].sum() > 0.97 * columns.sum()


def test_alt_and_a_click_focus_on_what_the_picture_shows_there(make_gui: Callable[..., Gui], tmp_path: Path) -> None:
    depth = np.zeros((128, 192))
    depth[:, 96:] = 1.0  # far on the right
    np.save(tmp_path / "depth.npy", depth)
    picture = Picture(np.full((128, 192, 3), 0.4, dtype=np.float32), "made up")
    gui = make_gui(small_bench(), panels=PANELS, size=(900, 700))
    gui.session.edit("Target", target_spec=TargetSpec(picture, "made up", Placement(depth=tmp_path / "depth.npy")))
    gui.draw_until_idle()
    planes_m = gui.session.system.planes_m
    for x, expected in ((0.2, planes_m.max()), (0.8, planes_m.min())):
        gui.context.edit_view("Plane", plane_m=10e-3)
        gui.hold_keys(("Alt",))
        gui.click(gui.item_position("image", x, 0.5))
        gui.release_keys(("Alt",))
        assert gui.session.view_settings.plane_m == pytest.approx(expected)


@pytest.mark.long
def test_the_path_of_a_drag_is_recorded_drawn_played_and_forgotten(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(small_bench(eye={"pupil": "2 mm"}), panels=(*PANELS, FilesPanel), size=(900, 900))
    gui.context.show_panel("Eye")
    gui.draw_until_idle()
    before = gui.draw_frames(2)
    gui.click(gui.item_position("Record the pupil"))
    assert gui.context.pupil_motion.state == "recording"
    start, end = gui.item_position("pupil map", 0.4), gui.item_position("pupil map", 0.55, 0.3)
    gui.drag(start, end, steps=6)
    gui.click(gui.item_position("Record the pupil"))
    path = gui.session.view_settings.pupil_path
    assert path is not None and len(path.times_s) >= 7
    assert (path.y_m[0], path.x_m[0]) == (0.0, 0.0) and path.y_m[-1] < -5e-4
    last = gui.session.system.eye
    assert last is not None and (path.y_m[-1], path.x_m[-1]) == (last.pupil_y_m, last.pupil_x_m)
    move_pupil(gui.session, (0.0, 0.0))
    gui.draw_until_idle()
    left, top, right, bottom = (round(edge) for edge in gui.context.item_rects["pupil map"])
    drawn = gui.draw_frames(2)[top:bottom, left:right].astype(int)
    assert np.count_nonzero((drawn[..., 0] > 150) & (drawn[..., 2] < 100)) > 50, "an amber line"
    gui.click(gui.item_position("Play the path"))
    for _ in range(300):
        gui.draw_frames()
        gui.app.compute_slice()
        if not gui.context.pupil_motion.state:
            break
    assert gui.context.pupil_motion.state == ""
    played = gui.session.system.eye
    assert played is not None and (played.pupil_y_m, played.pupil_x_m) == (last.pupil_y_m, last.pupil_x_m)
    gui.click(gui.item_position("Forget the path"))
    assert gui.session.view_settings.pupil_path is None
    assert before.shape == gui.draw_frames().shape and not gui.session.messages.all


def test_the_pupil_that_is_taken_by_hand_leaves_its_path(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(small_bench(eye={"pupil": "2 mm"}), panels=(*PANELS, FilesPanel), size=(900, 900))
    gui.context.show_panel("Eye")
    gui.session.edit_view("Path", pupil_path=PupilPath((0.0, 1000.0), (0.0, 1e-3), (0.0, 0.0)))
    gui.draw_frames(3)
    gui.click(gui.item_position("Play the path"))
    assert gui.context.pupil_motion.state == "playing"
    gui.click(gui.item_position("pupil map", 0.6))
    eye = gui.session.system.eye
    assert gui.context.pupil_motion.state == "" and eye is not None and eye.pupil_x_m > 1e-4


def test_a_path_is_saved_and_opened_by_the_dialog(make_gui: Callable[..., Gui], tmp_path: Path) -> None:
    gui = make_gui(small_bench(eye={"pupil": "2 mm"}), panels=(*PANELS, FilesPanel), size=(900, 900))
    gui.context.show_panel("Eye")
    path = PupilPath((0.0, 1.0), (0.0, 1e-3), (0.0, 0.0))
    gui.session.edit_view("Path", pupil_path=path)
    gui.draw_frames(3)
    dialog = gui.app.panel(FilesPanel).dialog
    dialog.list_folder(tmp_path)
    gui.click(gui.item_position("Save pupil path…"))
    assert dialog.is_open
    dialog.name = "path.csv"
    dialog.accept()
    gui.draw_frames(3)
    gui.context.loader.open(tmp_path / "path.csv")
    assert gui.session.wait_until_idle(PATIENCE_S)
    assert gui.session.view_settings.pupil_path == path
    assert [message.kind for message in gui.session.messages.all] == ["info", "info"]


def test_a_key_compares_with_an_eye_without_colour_error_that_sees_through_the_same_pupil(eye_gui: Gui) -> None:
    eye_gui.press_chord("A")
    view = eye_gui.session.view_settings
    assert (view.compare, view.a, view.b) == ("wipe", NOW, ACHROMATIC)
    move_pupil(eye_gui.session, (0.0, 3e-4))
    eye_gui.draw_until_idle()
    system = eye_gui.session.system
    assert system.eye is not None
    known = simulate(
        system.edit({"eye.chromatic": False}), eye_gui.session.drive, [view.plane_m], backend="torch64"
    ).xyz[0]
    found = eye_gui.context.side_renderers.xyz(ACHROMATIC)
    assert found is not None and np.abs(found - known).max() < 1e-4 * known.max()
    now = eye_gui.context.side_renderers.xyz(NOW)
    assert now is not None and np.abs(now - known).max() > 0.1 * known.max()
    eye_gui.press_chord("A")
    assert eye_gui.session.view_settings.compare == "off"


def test_a_drag_builds_no_targets_and_the_one_before_stays_beside_it(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(small_bench(eye={"pupil": "2 mm"}), panels=PANELS, size=(900, 700))
    picture = Picture(np.full((128, 192, 3), 0.4, dtype=np.float32), "made up")
    gui.session.edit("Target", target_spec=TargetSpec(picture, "made up"))
    gui.session.edit_view("Compare", b=TARGET, compare="wipe")
    gui.context.show_panel("Eye")
    gui.draw_until_idle()
    before = gui.context.side_renderers.picture(TARGET)
    assert before is not None
    x, y = gui.item_position("pupil map")
    gui.move((x, y))
    gui.move((x, y))
    gui.press_button()
    for step in range(1, 6):
        gui.move((x + 3 * step, y))
        assert gui.context.side_renderers.picture(TARGET) is before
        assert not gui.session.target_builder.is_building
    gui.release_button()
    assert gui.session.system.eye is not None and gui.session.system.eye.pupil_x_m > 1e-4
    gui.draw_until_idle()
    assert gui.session.wait_until_idle(PATIENCE_S)  # takes the target that was built during the last frame
    after = gui.context.side_renderers.picture(TARGET)
    assert after is not None and after is not before, "the target as the eye sees it from there"
