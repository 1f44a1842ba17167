"""Files that a session writes are read back; jobs that write them can be cancelled and leave nothing behind."""

from __future__ import annotations

import sys
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest
from PIL import Image

from holoview.holograms.files.light_file import SUFFIXES, read_light
from holoview.holograms.hologram import load_hologram
from holoview.holograms.view import simulate
from holoview.light.colour import D65_WHITE, srgb_encode, to_srgb8
from holoview.light.model import preset
from holoview.util.errors import UserError
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.exports import (
    png_bytes,
    save_figure,
    save_hologram,
    save_light,
    save_page,
    save_planes,
    save_preset,
    save_pupil_sheet,
    save_sweep,
    save_view,
)
from holoview.viewer.document.file_loader import target_from_image_bytes
from holoview.viewer.document.legend import scale_bar_length
from holoview.viewer.document.optimisation_job import NAMES as SIDES
from holoview.viewer.document.optimisation_job import start_scheme_comparison
from holoview.viewer.document.target_builder import TargetSpec
from holoview.viewer.page.page import read_page
from holoview.viewer.render.planes import render_planes
from holoview.viewer.render.tone_mapping import NAMES, colour_map, compose_comparison, tone_map
from holoview.viewer.render.view_settings import ViewSettings
from tests.document.conftest import small_system
from tests.patience import PATIENCE_S


def test_rendering_agrees_with_the_reference(session: EditingSession) -> None:
    system = session.system
    found = np.stack(list(render_planes(system, session.drive, system.planes_m.tolist())))
    known = simulate(system, session.drive, backend="torch64").xyz
    assert np.abs(found - known).max() < 1e-4 * known.max()


def test_the_plain_look_is_the_plain_picture_and_exposure_doubles() -> None:
    xyz = np.random.default_rng(0).random((6, 8, 3))
    look = ViewSettings(plane_m=0.01)
    rgb = simulate(small_system(), EditingSession(small_system()).drive, [3e-3], "torch")
    for keeps_hue, gamut in ((False, "clip"), (True, "hue")):
        shown = tone_map(rgb.xyz[0], look.with_(keeps_hue=keeps_hue))
        differences = np.abs(shown.astype(int) - to_srgb8(rgb.rgb[0], gamut))
        assert differences.max() <= 1 and differences.sum() <= 5, "float32 rounds one code in 10⁵ the other way"
    half = tone_map(xyz / 2, look.with_(exposure_stops=1.0, channel="luminance"))
    assert np.array_equal(half, tone_map(xyz, look.with_(channel="luminance")))
    codes = np.rint(255 * srgb_encode(np.clip((xyz[..., 1] - 0.2) / 0.5, 0, 1)) ** 0.5)
    shown = tone_map(xyz, look.with_(channel="Y", low=0.2, high=0.7, gamma=2.0))
    assert np.abs(shown[..., 1] - codes).max() <= 1, "float32 may round the other way"
    coloured = tone_map(xyz, look.with_(channel="Y", false_colour="cubehelix"))
    assert (coloured[..., 0] != coloured[..., 1]).any()


def test_sides_are_compared_as_on_the_screen() -> None:
    a, b = (np.full((4, 8, 3), 1.0) * value * D65_WHITE for value in (0.1, 0.6))
    look = ViewSettings(plane_m=0.01)
    left, right = tone_map(a, look), tone_map(b, look)
    assert np.array_equal(compose_comparison(a, b, look), left), "nothing is compared"
    beside = compose_comparison(a, b, look.with_(compare="side-by-side"))
    assert beside.shape == (4, 16, 3) and np.array_equal(beside[:, 8:], right)
    wiped = compose_comparison(a, b, look.with_(compare="wipe", wipe=0.25))
    assert np.array_equal(wiped[:, :2], left[:, :2]) and np.array_equal(wiped[:, 2:], right[:, 2:])
    same = compose_comparison(a, a, look.with_(compare="difference"))
    assert (same == 0).all(), "no difference is black"
    brighter = compose_comparison(a, b, look.with_(compare="difference", channel="luminance"))
    assert (brighter[..., 2] > brighter[..., 0]).all(), "a below b is blue"
    assert np.array_equal(compose_comparison(a, b[:2], look.with_(compare="wipe")), left), "of another size"


def test_palettes_begin_and_end_where_they_should() -> None:
    tables = {name: colour_map(name).astype(int) for name in NAMES}
    assert tables["cubehelix"][0].tolist() == [0, 0, 0] and tables["cubehelix"][-1].tolist() == [255, 255, 255]
    brightness = tables["cubehelix"] @ [0.30, 0.59, 0.11]
    assert (np.diff(brightness) > -1.5).all(), "rises evenly, but for rounding and clipping"
    assert np.abs(tables["hue"][0] - tables["hue"][-1]).max() < 8, "a cycle closes"
    assert (tables["signed"][127:129] > 250).all()


def test_a_hologram_and_a_preset_are_saved_and_read_back(session: EditingSession, tmp_path: Path) -> None:
    save_hologram(session, tmp_path / "mine")
    save_preset(session, tmp_path / "bench.toml")
    again = load_hologram(tmp_path / "mine.safetensors")
    assert np.array_equal(again.drive, session.drive) and again.system == session.system
    assert preset.load(tmp_path / "bench.toml") == session.system
    assert session.document.path == tmp_path / "mine.safetensors" and not session.can_undo
    with pytest.raises(UserError):
        save_hologram(session, tmp_path / "no" / "folder.safetensors")


def test_what_is_seen_is_saved_with_how_it_was_made(session: EditingSession, tmp_path: Path) -> None:
    seen = np.random.default_rng(1).integers(0, 255, (48, 64, 3), np.uint8)
    save_view(session, tmp_path / "view.png", seen)
    with Image.open(tmp_path / "view.png") as picture:
        assert np.array_equal(np.asarray(picture), seen)
        assert picture.text["holoview.plane"] == "4 mm"  # type: ignore[attr-defined]
    assert target_from_image_bytes(png_bytes(seen)).source.rgb.shape == (48, 64, 3)  # type: ignore[union-attr]


def test_every_plane_is_saved_toned_as_it_is_seen(session: EditingSession, tmp_path: Path) -> None:
    session.edit_view("Exposure", exposure_stops=1.0)
    save_planes(session, tmp_path / "all.png")
    assert session.wait_until_idle(PATIENCE_S)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["all-3mm.png", "all-4mm.png"]
    (xyz,) = render_planes(session.system, session.drive, [3e-3])
    with Image.open(tmp_path / "all-3mm.png") as picture:
        assert np.array_equal(np.asarray(picture), tone_map(xyz, session.view_settings))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_light_is_saved_to_the_last_bit_whatever_the_look(session: EditingSession, tmp_path: Path, suffix: str) -> None:
    session.edit_view("Exposure", exposure_stops=3.0, channel="Y")
    save_light(session, tmp_path / f"light{suffix}")
    assert session.wait_until_idle(PATIENCE_S)
    assert [m.kind for m in session.messages.all] == ["info"], session.messages.all
    found, known = read_light(tmp_path / f"light{suffix}"), simulate(session.system, session.drive, backend="torch")
    assert len(found.xyz) == len(session.system.planes_m)
    for name in found.stored:
        assert np.array_equal(getattr(found, name), getattr(known, name).astype(np.float32)), name
    assert set(found.stored) == ({"rgb"} if suffix.startswith(".tif") else {"xyz", "rgb", "intensity"})


def test_light_of_another_format_is_refused_before_it_is_computed(session: EditingSession, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"\.npz"):
        save_light(session, tmp_path / "light.jpg")
    assert session.wait_until_idle(PATIENCE_S) and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_a_sweep_goes_there_and_back(session: EditingSession, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"sweep{suffix}"
    save_sweep(session, path, frames=4, seconds=1.0)
    assert session.wait_until_idle(PATIENCE_S)
    assert [m.kind for m in session.messages.all] == ["info"], session.messages.all
    frames = imageio.imread(path, plugin="pyav") if suffix == ".mp4" else imageio.imread(path)
    assert frames.shape[:3] == (6, 48, 64)


def test_a_cancelled_export_leaves_nothing_behind(session: EditingSession, tmp_path: Path) -> None:
    job = save_sweep(session, tmp_path / "sweep.gif", frames=600)
    job.cancel()
    assert session.wait_until_idle(PATIENCE_S) and job.status == "cancelled"
    assert list(tmp_path.iterdir()) == []


def test_a_page_holds_the_hologram_and_opens_at_the_present_plane(session: EditingSession, tmp_path: Path) -> None:
    session.edit_view("Plane", plane_m=3.5e-3)
    save_page(session, tmp_path / "page")
    assert session.wait_until_idle(PATIENCE_S)
    assert session.messages.all[-1].text == f"page written to {tmp_path / 'page.html'}"
    (hologram,) = read_page(tmp_path / "page.html").values()
    assert hologram.system == session.system and np.array_equal(hologram.drive, session.drive)
    assert '"plane_m":0.0035' in (tmp_path / "page.html").read_text(encoding="utf-8")
    with pytest.raises(UserError, match="suffix"):
        save_page(session, tmp_path / "page.png")


def test_a_missing_library_is_named_with_how_to_install_it(
    session: EditingSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("av", "matplotlib.figure"):
        monkeypatch.setitem(sys.modules, module, None)
    for save, name in ((save_sweep, "a.mp4"), (save_figure, "a.pdf")):
        with pytest.raises(UserError, match="pip install"):
            save(session, tmp_path / name)
    with pytest.raises(UserError, match="suffix"):
        save_sweep(session, tmp_path / "a.avi")
    with pytest.raises(UserError, match="frames"):
        save_sweep(session, tmp_path / "a.gif", frames=1)


@pytest.mark.parametrize("suffix", [".png", ".pdf"])
def test_a_figure_is_labelled_and_whole(session: EditingSession, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"figure{suffix}"
    save_figure(session, path)
    assert session.wait_until_idle(PATIENCE_S)
    assert [m.kind for m in session.messages.all] == ["info"], session.messages.all
    data = path.read_bytes()
    assert data.startswith(b"%PDF" if suffix == ".pdf" else b"\x89PNG") and len(data) > 5000


@pytest.mark.parametrize(("most", "length"), [(1.9e-3, 1e-3), (2e-3, 2e-3), (7e-3, 5e-3), (9.99e-5, 5e-5)])
def test_scale_bars_have_round_lengths(most: float, length: float) -> None:
    assert scale_bar_length(most) == pytest.approx(length)


@pytest.mark.long
def test_the_showcase_shows_less_speckle_with_more_wavelengths(session: EditingSession) -> None:
    job = start_scheme_comparison(session)
    assert session.wait_until_idle(PATIENCE_S) and job.status == "done", session.messages.all
    result = job.result
    assert result is not None and result.method == "random patterns"
    assert result.right.contrast < result.left.contrast < 1.0
    pinned = [
        f"{name}: contrast {side.contrast:.2f}" for name, side in zip(SIDES, (result.left, result.right), strict=True)
    ]
    assert list(session.snapshots) == pinned and session.view_settings.compare == "side-by-side"
    scenes = [session.scene_for(side) for side in (session.view_settings.a, session.view_settings.b)]
    assert [len(scene.system.wavelengths_m) for scene in scenes if scene] == [3, 8]
    assert session.look_back() == "Compare schemes" and session.view_settings.compare == "off"
    start_scheme_comparison(session)
    assert session.wait_until_idle(PATIENCE_S) and len(session.snapshots) == 2, "the two before are replaced"


@pytest.mark.long
def test_the_showcase_optimises_both_alike_and_says_so(session: EditingSession, target_spec: TargetSpec) -> None:
    session.edit("Target", target_spec=target_spec)
    session.target_at()
    assert session.wait_until_idle(PATIENCE_S)
    job = start_scheme_comparison(session, iterations=2)
    assert session.wait_until_idle(PATIENCE_S) and job.result is not None
    assert "2 iterations each" in job.result.summary and "PSNR" in job.result.left.document.origin


def test_a_sheet_shows_what_the_pupil_sees_from_nine_places(session: EditingSession, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="eye: there is none"):
        save_pupil_sheet(session, tmp_path / "sheet")
    session.change("Eye", {"eye": {"pupil": "1 mm", "infinity": "0 mm", "pupil_x": "0.2 mm"}})
    save_pupil_sheet(session, tmp_path / "sheet")
    assert session.wait_until_idle(PATIENCE_S)
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.width > 3 * 480 and sheet.height > 3 * 100
        assert len({sheet.crop((16 + 496 * i, 120, 496 + 496 * i, 400)).tobytes() for i in range(3)}) == 3
