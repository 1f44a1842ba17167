"""What files are is told by their content, what is wrong with them to the user; rewritten ones are read again."""

from __future__ import annotations

import io
import time
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from PIL import Image

import tests.document.conftest as bench
from holoview.holograms.hologram import Hologram
from holoview.holograms.view import random_drive
from holoview.light.model import preset
from holoview.util.errors import UserError
from holoview.viewer.document import file_loader
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.file_loader import (
    FileLoader,
    FileWatcher,
    read_content,
    target_from_image_bytes,
    target_from_pixels,
)
from holoview.viewer.page.page import export_html
from tests.patience import PATIENCE_S, wait_until
from tests.pattern_file import write_pattern

SYSTEM = bench.small_system()


def _hologram(path: Path, seed: int) -> Hologram:
    hologram = Hologram(random_drive(SYSTEM, seed), SYSTEM)
    hologram.save(path)
    return hologram


def _picture(path: Path, mode: str = "RGB", size: tuple[int, int] = (40, 30)) -> Path:
    Image.new(mode, size, 128 if mode == "L" else (200, 100, 50)).save(path)
    return path


def test_kinds_are_told_by_content_whatever_the_name(tmp_path: Path) -> None:
    hologram, picture, toml = tmp_path / "a.dat", tmp_path / "b.dat", tmp_path / "c.toml"
    written = _hologram(tmp_path / "a.safetensors", seed=3)
    (tmp_path / "a.safetensors").rename(hologram)
    _picture(tmp_path / "b.png").rename(picture)
    preset.save(SYSTEM, toml)
    opened = read_content(hologram, SYSTEM)
    assert opened.kind == "hologram" and opened.drive is not None and np.array_equal(opened.drive, written.drive)
    assert read_content(picture, SYSTEM).kind == "picture"
    bench_file = read_content(toml, SYSTEM)
    assert bench_file.kind == "preset" and bench_file.system == SYSTEM
    assert read_content("simultaneous", SYSTEM).system == preset.load("simultaneous")


def test_patterns_are_told_apart_from_pictures(tmp_path: Path) -> None:
    drive = random_drive(SYSTEM, 5)
    paths = [tmp_path / "slm1.png", tmp_path / "slm2.png"]
    for path, pattern in zip(paths, drive[0], strict=True):
        write_pattern(path, pattern, bits=16)
    assert read_content(paths[::-1], SYSTEM).kind == "patterns", "named patterns in any order"
    found = read_content(tmp_path, SYSTEM).drive
    assert found is not None and np.abs(found - drive).max() < 2**-16
    grey = _picture(tmp_path / "grey.png", "L", (32, 24))
    with pytest.raises(UserError, match="1 files; expected 2"):
        read_content(grey, SYSTEM)
    assert read_content(_picture(tmp_path / "photo.png", "L"), SYSTEM).kind == "picture", "grey, but of another size"


def test_a_folder_of_pictures_is_a_focal_stack(tmp_path: Path) -> None:
    for number in range(2):
        _picture(tmp_path / f"{number}.png")
    opened = read_content(tmp_path, SYSTEM)
    assert opened.kind == "stack" and opened.target_spec is not None
    assert opened.target_spec.build(SYSTEM).stack.shape == (2, 48, 64, 3)


@pytest.mark.parametrize("content", [b"", b"hello", b"\x89PNG\r\n\x1a\nbroken", b"name = "])
def test_what_cannot_be_opened_is_a_users_mistake(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "file"
    path.write_bytes(content)
    with pytest.raises(UserError):
        read_content(path, SYSTEM)
    with pytest.raises(UserError):
        read_content(tmp_path / "missing", SYSTEM)
    with pytest.raises(UserError):
        read_content("~no-such-user/picture.png", SYSTEM)


def test_a_pasted_picture_is_linear_light_over_black() -> None:
    pixels = np.zeros((2, 2, 4), np.uint8)
    pixels[0, 0] = (255, 188, 0, 255)
    pixels[0, 1] = (255, 255, 255, 128)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG")
    for target_spec in (target_from_pixels(pixels), target_from_image_bytes(buffer.getvalue())):
        rgb = target_spec.source.rgb  # type: ignore[union-attr]
        assert rgb[0, 0] == pytest.approx([1.0, 0.503, 0.0], abs=1e-3), "188 is half of linear light"
        assert rgb[0, 1] == pytest.approx(128 / 255)
    with pytest.raises(UserError):
        target_from_image_bytes(b"no picture")


def test_opening_is_an_edit_a_message_and_a_recent_file(session: EditingSession, tmp_path: Path) -> None:
    remembered: list[Path] = []
    loader = FileLoader(session, remember=remembered.append, quick=False)
    written = _hologram(tmp_path / "a.safetensors", seed=4)
    loader.open(tmp_path / "a.safetensors")
    loader.open(tmp_path / "missing.png")
    assert session.wait_until_idle(PATIENCE_S)
    assert np.array_equal(session.drive, written.drive) and session.undo() == "Open a.safetensors"
    assert remembered == [tmp_path / "a.safetensors"]
    assert [message.kind for message in session.messages.all] == ["error"]
    loader.close()


def test_a_picture_becomes_the_target_and_is_seen_within_a_quick_look(session: EditingSession, tmp_path: Path) -> None:
    loader, old = FileLoader(session), session.drive
    loader.open(_picture(tmp_path / "photo.png"))
    assert session.wait_until_idle(PATIENCE_S)
    assert session.target_spec is not None and session.target_spec.title == "photo.png"
    assert session.drive is not old and "optimised" in session.document.origin
    loader.close()


@pytest.mark.long
def test_a_rewritten_hologram_is_read_again_even_if_it_was_half_there(session: EditingSession, tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    _hologram(path, seed=1)
    loader = FileLoader(session)
    loader.open(path)
    assert session.wait_until_idle(PATIENCE_S) and loader.watched_path == path
    again = Hologram(random_drive(SYSTEM, 2), SYSTEM)
    again.save(tmp_path / "b.safetensors")
    whole = (tmp_path / "b.safetensors").read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    time.sleep(1.0)
    path.write_bytes(whole)
    wait_until(lambda: np.array_equal(session.drive, again.drive), session.poll)
    assert not [message for message in session.messages.all if message.kind == "error"]
    loader.set_watching(False)
    assert loader.watched_path is None
    loader.close()


def test_a_watch_waits_until_writing_has_stopped(tmp_path: Path) -> None:
    path, seen, moments = tmp_path / "file", list[str](), list[float]()
    path.write_text("0")
    watch = FileWatcher(path, lambda: seen.append(path.read_text()), interval_s=0.1)
    for number in range(5):
        moments.append(time.monotonic())
        path.write_text(str(number))
        moments.append(time.monotonic())
        time.sleep(0.04)
    wait_until(lambda: "4" in seen)
    watch.close()
    # On a busy machine the writer itself may stop for an interval: from a write's beginning to the end of the next.
    stops = sum(after - before >= 0.1 for before, after in zip(moments[:-3:2], moments[3::2], strict=True))
    assert seen[-1] == "4" and len(seen) <= 1 + stops


def test_a_folder_of_views_is_seen_by_the_eye_of_the_bench(tmp_path: Path) -> None:
    for number in range(4):
        Image.new("RGB", (8, 6), "white").save(tmp_path / f"{number}.png")
    (tmp_path / "views.toml").write_text('rows = 2\ncolumns = 2\nspacing = "0.5 mm"\n', encoding="utf-8")
    spec = read_content(tmp_path, SYSTEM).target_spec
    assert spec is not None and not spec.is_stack
    seeing = SYSTEM.with_(eye={"pupil": "1 mm", "infinity": float(SYSTEM.planes_m.min()), "chromatic": False})
    stack = spec.build(seeing, SYSTEM.planes_m[:1] * 1.1).stack
    assert stack == pytest.approx(np.ones_like(stack), abs=1e-5)
    with pytest.raises(UserError, match="without an eye"):
        spec.build(SYSTEM)
    with pytest.raises(UserError, match="pictures without depth"):
        spec.depth_at(seeing, 0, 0)


def test_a_page_is_a_hologram_with_the_state_of_its_link(tmp_path: Path) -> None:
    hologram = _hologram(tmp_path / "a.safetensors", 3)
    export_html(tmp_path / "a.html", {"first": hologram, "second": hologram}, backend="torch")
    content = read_content(tmp_path / "a.html", SYSTEM)
    assert (content.kind, content.plane_m) == ("page", None)
    assert content.system == SYSTEM and content.drive is not None and np.array_equal(content.drive, hologram.drive)
    assert content.notes == ("first, the first of 2 holograms",)
    shown = read_content(f"{tmp_path / 'a.html'}#plane=3.2mm&laser1=off", SYSTEM)
    assert shown.plane_m == pytest.approx(3.2e-3)
    assert shown.system is not None and not shown.system.amplitudes[:, 0].any()


def test_a_page_that_is_opened_is_not_saved_over(session: EditingSession, tmp_path: Path) -> None:
    hologram = _hologram(tmp_path / "a.safetensors", 3)
    export_html(tmp_path / "a.html", hologram, backend="torch")
    FileLoader(session).open(f"{tmp_path / 'a.html'}#plane=3.5mm")
    wait_until(lambda: np.array_equal(session.drive, hologram.drive), session.poll)
    assert session.document.path is None
    assert session.view_settings.plane_m == pytest.approx(3.5e-3)


@pytest.mark.parametrize("overtake", ["open", "paste"])
def test_an_overtaken_opening_is_cancelled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, session: EditingSession, overtake: str
) -> None:
    """The first file takes longer to read than the second, and would replace it."""
    slow, quick = tmp_path / "slow.safetensors", tmp_path / "quick.safetensors"
    for seed, file in enumerate((slow, quick), start=7):
        _hologram(file, seed=seed)
    may_go_on, read = Event(), file_loader.load_hologram

    def load(path: Path) -> Hologram:
        if path == slow:
            assert may_go_on.wait(PATIENCE_S)
        return read(path)

    monkeypatch.setattr(file_loader, "load_hologram", load)
    loader = FileLoader(session, quick=False)
    first = loader.open(slow)
    if overtake == "open":
        second = loader.open(quick)
        assert second.join(PATIENCE_S)
    else:
        loader.paste(np.zeros((8, 8, 3), np.uint8))
    session.poll()
    may_go_on.set()
    assert session.wait_until_idle(PATIENCE_S)
    assert first.status == "cancelled"
    assert session.document.origin != f"hologram {slow.name}"
    assert session.document.path == (quick if overtake == "open" else None)
    loader.close()


def test_an_ignored_colour_profile_is_told(tmp_path: Path, session: EditingSession) -> None:
    """In the sentence that the command line prints."""
    Image.new("RGB", (40, 30), "red").save(tmp_path / "a.png", icc_profile=b"damaged" * 40)
    loader = FileLoader(session, quick=False)
    assert loader.open(tmp_path / "a.png").join(PATIENCE_S)
    assert session.wait_until_idle(PATIENCE_S)
    said = [message.text for message in session.messages.all]
    assert said.count("a.png: embedded colour profile ignored: taken as sRGB") == 1
    loader.close()
