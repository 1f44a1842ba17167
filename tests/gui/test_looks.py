"""How the window looks: kept pictures on lavapipe, contrast of texts, high resolution, nothing clipped or missing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from imgui_bundle import imgui
from numpy.typing import NDArray
from PIL import Image

import holoview
from holoview.commands import cli
from holoview.util.errors import UserError
from holoview.viewer.app import plots, theme
from holoview.viewer.app.fonts import advice, fonts_of_scripts, missing_packages
from holoview.viewer.app.panels import gamut, lasers, speckle
from holoview.viewer.app.panels.files import FilesPanel
from holoview.viewer.app.script import run_script
from holoview.viewer.document.session_store import SessionStore
from tests.gui.conftest import Gui
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu

STATUS = 30  # pixels of the status bar, whose times differ from run to run
READABLE = 4.5  # contrast of texts, WCAG 2.2, 1.4.3


DARK = {"exposure_stops": -30.0}  # speckle makes large files


def _drawn(gui: Gui) -> NDArray[np.uint8]:
    gui.move((2, 60))
    gui.draw_until_idle()
    return gui.draw_frames(3)[:-STATUS]


@pytest.mark.parametrize(
    ("name", "prepare"),
    [
        ("start", lambda gui: None),
        ("keys", lambda gui: (gui.session.edit_view("Dark", **DARK), gui.press_chord("?"))),
        ("light", lambda gui: (gui.session.edit_view("Dark", **DARK), gui.context.set_theme("Light"))),
        ("gamut", lambda gui: (gui.session.edit_view("Look", solo=1), gui.context.show_panel("Gamut"))),
        (
            "wipe",
            lambda gui: gui.session.edit_view(
                "Wipe", compare="wipe", b=gui.session.view_settings.a, region=(40, 30, 60, 40)
            ),
        ),
        ("zoomed", lambda gui: gui.session.edit_view("Zoom", zoom=24.0, channel="luminance", false_colour="cubehelix")),
    ],
)
def test_the_window_looks_as_it_did(
    gui: Gui, golden: Callable[..., None], name: str, prepare: Callable[..., None]
) -> None:
    prepare(gui)
    golden(name, _drawn(gui), is_dark=name in ("keys", "light"))


def test_every_sign_that_is_written_has_a_glyph(gui: Gui) -> None:
    """Of the texts in panels, and of docstrings and sentences that panels show."""
    package = Path(holoview.__file__).parent
    files = [
        *package.glob("viewer/app/**/*.py"),
        *package.glob("viewer/document/**/*.py"),
        *package.glob("viewer/render/**/*.py"),
        *package.glob("light/effects/*.py"),
    ]
    signs = {sign for file in files for sign in file.read_text(encoding="utf-8") if ord(sign) > 127}
    font = imgui.get_io().fonts.fonts[0]
    missing = {sign for sign in signs if not font.is_glyph_in_font(ord(sign))}
    assert {"λ", "Δ", "→"} <= signs and missing <= set("─▶"), missing


@pytest.mark.parametrize("name", theme.THEMES)
def test_signals_and_borders_have_the_contrast_that_wcag_asks_for(gui: Gui, name: str) -> None:
    """4.5 for text (1.4.3), 3 for the borders of what is operated (1.4.11), which the dark theme shows by fields."""
    gui.context.set_theme(name)
    for ground in (imgui.Col_.window_bg, imgui.Col_.popup_bg):
        for signal in ("accent", "warning", "error"):
            colour = theme.signal_colour(signal)
            assert _contrast(np.array([colour.x, colour.y, colour.z]), _colour(ground)) >= READABLE, (signal, ground)
        assert name == "Dark" or _contrast(_colour(imgui.Col_.border), _colour(ground)) >= 3
    style = imgui.get_style()
    assert min(style.window_border_size, style.frame_border_size, style.popup_border_size) == 1


def test_curves_and_their_names_are_read_on_the_light_ground(gui: Gui) -> None:
    gui.context.set_theme("Light")
    bright = [*dict(lasers._CONES).values(), *speckle._PROFILE_COLOURS.values(), *gamut._TRIANGLE_COLOURS.values()]
    for colour in (*bright, gamut._LASER_LINE, gamut._OUTLINE, plots.GREY, plots._CONES):
        drawn = theme.curve_colour(colour)
        assert _contrast(np.array([drawn.x, drawn.y, drawn.z]), _colour(imgui.Col_.window_bg)) >= READABLE, colour
        assert drawn.w == 1.0


def test_names_are_drawn_by_the_fonts_that_the_machine_has(tmp_path: Path) -> None:
    for name in ("wqy-zenhei.ttc", "NotoSansCJK-Regular.ttc", "DejaVuSans.ttf", "Comic.ttf"):
        (tmp_path / "truetype").mkdir(exist_ok=True)
        (tmp_path / "truetype" / name).write_bytes(b"ttcf")
    (tmp_path / "truetype" / "Symbola.ttf").write_bytes(b"no font")
    folders = [tmp_path / "missing", tmp_path]
    assert [path.name for path in fonts_of_scripts(folders)] == ["NotoSansCJK-Regular.ttc", "DejaVuSans.ttf"]
    assert missing_packages(folders) == ["fonts-symbola"], "its file is no font"
    assert missing_packages([tmp_path / "missing"]) == ["fonts-wqy-microhei", "fonts-symbola"]


def test_what_to_install_is_said_for_the_scripts_of_a_name() -> None:
    assert advice("ԱႠא") == advice("") == ""
    names = (("日本語", "wqy", "symbola"), ("한국어", "wqy", "symbola"), ("🦊", "symbola", "wqy"))
    for name, package, other in names:
        assert f"fonts-{package}" in advice(name) and other not in advice(name)
    assert "fonts-wqy-microhei fonts-symbola" in advice("🦊 全息图 한국어")
    assert "Chinese or Japanese and Korean and emoji signs" in advice("🦊全한")


def test_a_font_without_korean_leaves_korean_to_another(tmp_path: Path) -> None:
    for name in ("DroidSansFallbackFull.ttf", "Symbola.ttf"):
        (tmp_path / name).write_bytes(b"ttcf")
    assert missing_packages([tmp_path]) == ["fonts-wqy-microhei"]
    (tmp_path / "NanumGothic.ttf").write_bytes(b"ttcf")
    assert missing_packages([tmp_path]) == []
    assert [path.name for path in fonts_of_scripts([tmp_path])] == [
        "DroidSansFallbackFull.ttf",
        "NanumGothic.ttf",
        "Symbola.ttf",
    ]


def test_the_viewer_says_once_what_to_install_for_a_name_that_it_cant_draw(
    make_gui: Callable[..., Gui], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(theme, "fonts_of_scripts", list)
    gui = make_gui()
    system = gui.session.system
    for name in ("全息图.safetensors", "ホログラム.safetensors"):
        holoview.Hologram(holoview.random_drive(system), system).save(tmp_path / name)
        gui.context.loader.open(tmp_path / name)
        assert gui.session.wait_until_idle(PATIENCE_S)
        gui.draw_until_idle()
    told = [message.text for message in gui.session.messages.all if "fonts-wqy-microhei" in message.text]
    assert len(told) == 1 and "fonts-symbola" not in told[0]
    dialog = gui.app.panel(FilesPanel).dialog
    dialog.list_folder(tmp_path)
    assert dialog.advice == told[0]


def test_names_that_are_drawn_need_no_advice(gui: Gui, tmp_path: Path) -> None:
    dialog = gui.app.panel(FilesPanel).dialog
    (tmp_path / "Größe µ ελλ Привет.png").touch()
    dialog.list_folder(tmp_path)
    assert dialog.advice == ""


def test_a_script_that_a_font_of_the_machine_has_is_drawn(gui: Gui) -> None:
    if not any(path.name == "DejaVuSans.ttf" for path in fonts_of_scripts()):
        pytest.skip("this machine has no DejaVu Sans")
    font = imgui.get_io().fonts.fonts[0]
    assert all(font.is_glyph_in_font(ord(sign)) for sign in "ԱႠא")


def test_the_size_of_text_is_chosen_and_remembered(make_gui: Callable[..., Gui], tmp_path: Path) -> None:
    gui = make_gui(store=SessionStore(tmp_path))

    def height(shown: Gui) -> float:
        """Of a field: the text and the padding above and below it."""
        shown.draw_frames(3)
        _, top, _, bottom = shown.context.item_rects["gap"]
        return bottom - top - 2 * imgui.get_style().frame_padding.y

    assert height(gui) == pytest.approx(theme.FONT_PIXELS)
    gui.context.set_text_size(1.5)
    gui.context.set_theme("Light")
    assert height(gui) == pytest.approx(1.5 * theme.FONT_PIXELS, abs=0.5)  # heights are whole pixels
    gui.app.close()
    again = make_gui(store=SessionStore(tmp_path))
    assert height(again) == pytest.approx(1.5 * theme.FONT_PIXELS, abs=0.5)
    assert again.context.text_size == 1.5 and again.context.theme == "Light"


def test_frames_of_the_same_state_are_identical(gui: Gui) -> None:
    assert np.array_equal(_drawn(gui), _drawn(gui))


@pytest.mark.parametrize("name", theme.THEMES)
def test_texts_can_be_read_in_every_theme(gui: Gui, name: str) -> None:
    gui.context.set_theme(name)
    gui.draw_frames(2)
    colours = imgui.Col_
    for text in (colours.text, colours.text_disabled):
        for ground in (
            colours.window_bg,
            colours.popup_bg,
            colours.frame_bg,
            colours.title_bg_active,
            colours.tab_selected,
            colours.slider_grab,
            colours.slider_grab_active,
        ):
            if text == colours.text_disabled and ground not in (colours.window_bg, colours.popup_bg):
                continue
            assert _contrast(_colour(text), _colour(ground)) >= READABLE, (text, ground)


def _colour(index: int) -> NDArray[np.float64]:
    colour, ground = imgui.get_style_color_vec4(index), imgui.get_style_color_vec4(imgui.Col_.window_bg)
    over = np.array([colour.x, colour.y, colour.z]), np.array([ground.x, ground.y, ground.z])
    return colour.w * over[0] + (1 - colour.w) * over[1]


def _contrast(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Relative luminances' ratio, WCAG 2.2."""
    linear = [np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) for c in (one, other)]
    dark, bright = sorted(float(c @ [0.2126, 0.7152, 0.0722]) + 0.05 for c in linear)
    return bright / dark


def test_a_screen_of_high_resolution_is_drawn_in_its_pixels(make_gui: Callable[..., Gui]) -> None:
    gui = make_gui(size=(640, 400), pixel_ratio=2.0)
    image = gui.draw_until_idle()
    assert image.shape == (800, 1280, 3)
    x0, y0, x1, y1 = (round(2 * value) for value in gui.context.item_rects["image"])
    seen = gui.context.displayed_pixels()
    assert seen.shape[:2] == (y1 - y0, x1 - x0)
    assert np.array_equal(image[y0 + 40 : y1 - 40, x0 + 40 : x1 - 40], seen[40:-40, 40:-40])


def test_the_manual_names_every_key(gui: Gui) -> None:
    manual = (Path(__file__).parents[2] / "docs" / "viewer.md").read_text(encoding="utf-8")
    lines = manual.splitlines()
    for command in gui.context.commands:
        if command.keys:
            assert any(f"`{command.keys[0].text}`" in line and command.name in line for line in lines), command.name


# --- the command ----------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_script_draws_off_screen_and_writes_what_is_seen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script, picture = tmp_path / "script.txt", tmp_path / "out.png"
    script.write_text(
        '# a comment\nset gap = "2.5 mm"\nlook exposure_stops = -1\nwheel image 0.5 0.5 2\nclick plane 0.7 0.5\n'
        "drag image 0.5 0.5 0.6 0.5\ncommand Pin a snapshot\nkey W\nshow Gamut\nwait\n"
    )
    small = ["--set", "shape=[32, 48]", "--size", "640x400", "--offscreen"]
    assert cli.main(["view", "holochrome-8", *small, "--script", str(script), "--screenshot", str(picture)]) == 0
    image = np.asarray(Image.open(picture))
    assert image.shape == (400, 640, 3)
    assert image.std() > 20
    assert capsys.readouterr().err == ""


_WRONG_LINES = {
    "fly away": "did you mean|known",
    "set gap 3": "KEY = VALUE",
    "set gap = -1": "out of range|3 m|between",
    "click nothing": "no item is called",
    "click nothing 1": "no item is called",
    'click "nothing': "quotation mark",
    "command Nothing": "known|did you mean",
    "show Light of a point": "there is no such panel",
    "drag image 1 2": "ITEM X0 Y0 X1 Y1",
}


def test_a_wrong_line_is_named(gui: Gui) -> None:
    for line, complaint in _WRONG_LINES.items():
        with pytest.raises(UserError, match=f"^script.txt:2: .*({complaint})"):
            run_script(gui, f"\n{line}\n", "script.txt")


@pytest.mark.long
def test_a_wrong_line_ends_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script = tmp_path / "script.txt"
    script.write_text("\nopen nowhere.png\n")
    small = ["--set", "shape=[16, 16]", "--size", "640x400", "--offscreen"]
    assert cli.main(["view", "holochrome-8", *small, "--script", str(script)]) == 2
    error = capsys.readouterr().err
    assert f"{script}:2: " in error and error.count("nowhere.png") and error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["nonsense"], "nonsense"),
        (["holochrome-8", "simultaneous", "--set", "gap=3 mm"], "second preset"),
        (["--size", "10x10", "--offscreen"], "--size"),
        (["--script", "x"], "without --offscreen"),
        (["--offscreen"], "--screenshot"),
        (["--offscreen", "--screenshot", "out.jpg"], ".png"),
        (["--serve", "nowhere"], "HOST:PORT"),
    ],
)
def test_wrong_arguments_are_refused_in_a_line(
    arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["view", *arguments]) == 2
    error = capsys.readouterr().err
    assert complaint in error and error.count("\n") == 1


def test_off_the_screen_a_file_that_cant_be_opened_ends_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong, picture = tmp_path / "wrong.dat", tmp_path / "seen.png"
    wrong.write_text("no hologram")
    small = ["--set", "shape=[16, 16]", "--size", "640x400", "--offscreen"]
    assert cli.main(["view", "holochrome-8", str(wrong), *small, "--screenshot", str(picture)]) == 2
    assert "wrong.dat: isn't a file that can be opened" in capsys.readouterr().err and not picture.exists()
    assert cli.main(["view", str(wrong), "--size", "640x400", "--offscreen", "--until-image"]) == 2
    assert "wrong.dat: isn't a file that can be opened" in capsys.readouterr().err
