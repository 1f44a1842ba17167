"""The drawing of a bench: all parts in the order of the light, no text over another, distances to scale."""

from __future__ import annotations

import io
import itertools
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from holoview.commands.cli import main
from holoview.light.model import preset
from holoview.light.model.bench_drawing import Part, draw_bench, draw_parts, parts_of_bench
from holoview.light.model.elements import Fourier, Lens, Pixels, Space
from holoview.light.model.fields import field_for
from holoview.light.model.system import System
from holoview.util.drawing import Box, Drawing, as_png, as_svg
from holoview.util.fonts import picture_font

EYE = {"eye.eyepiece": "40 mm", "eye.pupil": "4 mm", "eye.pupil_x": "1.25 mm"}
FULL = {"relay1.iris_na": 0.02, "relay2.iris_na": 0.021, "relay2.dc_block_na": 0.0008, "relay2.apodisation_na": 0.015}
BENCHES = {
    **{name: {} for name in preset.names()},
    "holochrome-16": {**EYE, **FULL, "observer": "age 60, field 4", "planes": np.linspace(1e-3, 0.9, 40)},
    "multisource-3x3": {**EYE, **FULL, "gap": "0.001 mm", "planes": ["0.01 mm"]},
}


def bench(name: str) -> System:
    return preset.load(name).edit(BENCHES[name])


def meet(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


@pytest.mark.parametrize("name", BENCHES)
def test_no_text_lies_over_another_or_beyond_the_page(name: str) -> None:
    drawing = draw_bench(bench(name))
    assert [(a.text, b.text) for a, b in itertools.combinations(drawing.labels, 2) if meet(a.box, b.box)] == []
    for label in drawing.labels:
        left, upper, right, lower = label.box
        assert left >= 0 and upper >= 0 and right <= drawing.width and lower <= drawing.height, label.text
        font = picture_font(label.size * 4)  # of the PNG; four times as large, so that hinting is small
        assert font.getlength(label.text) / 4 <= right - left, label.text
    for stroke in drawing.strokes:
        assert all(0 <= x <= drawing.width and 0 <= y <= drawing.height for x, y in stroke.points), stroke


@pytest.mark.parametrize("name", BENCHES)
def test_every_part_of_a_bench_is_drawn_with_its_key_and_its_distance(name: str) -> None:
    system = bench(name)
    parts = parts_of_bench(system)
    kinds = [part.kind for part in parts]
    patterned = [e for e in system.elements if isinstance(e, Pixels)]
    stops = [e.relay for e in system.elements if isinstance(e, Space)]
    assert kinds[0] == "laser" and kinds.count("modulator") == len(patterned)
    assert kinds.count("relay") == sum(not relay.is_clear for relay in stops)
    assert kinds[-1] == ("observer" if system.eye is None else "eye")
    lenses = sum(isinstance(e, Lens | Fourier) for e in system.elements) + (system.eye is not None)
    assert kinds.count("lens") == lenses
    drawing = draw_bench(system)
    keys = {part.key for part in parts} | {part.distance_key for part in parts if part.distance_m}
    assert {key for key, _ in drawing.areas} == keys
    for key in keys:  # each is a key of presets, so that a click finds what it edits
        field_for(System, key.partition(".")[0])
    distances = [part.distance_m for part in parts if part.distance_m]
    wanted = [(e.distance_m,) for e in system.elements if isinstance(e, Space) and e.distance_m]
    assert distances == [*wanted, tuple(sorted(system.planes_m.tolist()))]


def _room(drawing: Drawing, parts: tuple[Part, ...], place: int) -> float:
    """The length of the dimension line of a part."""
    strokes = [s for s in drawing.strokes if s.key == parts[place].distance_key and s.role == "distance"]
    (x0, _), (x1, _) = strokes[0].points
    return x1 - x0


def test_a_longer_distance_takes_more_room_and_a_click_finds_it() -> None:
    rooms = []
    for gap_m in (1e-3, 1e-2, 1e-1, 1.0):
        system = preset.load("simultaneous-open").with_(gap=gap_m)
        drawing, parts = draw_bench(system), parts_of_bench(system)
        place = next(n for n, part in enumerate(parts) if part.distance_key == "gap")
        rooms.append(_room(drawing, parts, place))
        label = next(label for label in drawing.labels if label.key == "gap")
        assert drawing.key_at(label.x, label.y) == "gap"
        modulator = next(label for label in drawing.labels if label.text == "modulator 2")
        assert drawing.key_at(modulator.x, modulator.y) == "modulators.1"
        assert drawing.key_at(-1.0, -1.0) == ""
    assert np.all(np.diff(rooms) > 0)


def test_parts_of_any_chain_are_drawn_in_their_order() -> None:
    """The layout knows parts only: a chain with a third modulator and two more lenses has its columns in order."""
    chain = (
        Part("laser", "lasers"),
        Part("modulator", "modulator 1", ("a" * 30,), "elements.1"),
        Part("modulator", "modulator 2", ("a" * 30,), "elements.2", (2e-3,), "elements.2"),
        Part("modulator", "modulator 3", ("a" * 30,), "elements.3", (4e-3,), "elements.3"),
        Part("lens", "lens"),
        Part("lens", "another lens", ("f = 100 mm",)),
        Part("plane", "planes", (), "planes", (0.0,), "planes"),
        Part("eye", "eye"),
    )  # fmt: skip
    drawing = draw_parts(chain, "chain")
    names = [label for label in drawing.labels if label.role == "name"]
    assert [label.text for label in names] == [part.name for part in chain]
    assert np.all(np.diff([label.x for label in names]) > 0)
    assert not any(meet(a.box, b.box) for a, b in itertools.combinations(drawing.labels, 2))


def test_planes_measured_from_an_element_before_the_last_one_stand_where_they_do() -> None:
    """22 mm from the phase modulator are 20 mm behind the amplitude modulator, which stands 2 mm behind it."""
    system = preset.load("high-contrast").edit({"planes_from": "phase", "planes": ["22 mm"]})
    *_, plane, _ = parts_of_bench(system)
    assert plane.distance_m == pytest.approx((20e-3,)) and "2 mm more from phase" in plane.details


@pytest.mark.long
def test_info_writes_the_drawing_as_svg_and_png(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    drawing = draw_bench(preset.load("holochrome-8"))
    for name in ("bench.svg", "bench.png"):
        assert main(["info", "holochrome-8", "--draw", name]) == 0
    root = ElementTree.fromstring(Path("bench.svg").read_text(encoding="utf-8"))
    texts = [node.text for node in root.iter("{http://www.w3.org/2000/svg}text")]
    assert texts == [label.text for label in drawing.labels]
    assert "8 µm pitch" in texts and "512 × 384" in texts
    picture = np.asarray(Image.open("bench.png"))
    assert picture.shape == (round(2 * drawing.height), round(2 * drawing.width), 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20
    capsys.readouterr()
    assert main(["info", "holochrome-8", "--draw", "bench.pdf"]) == 2
    assert 'the suffix ".pdf"; expected .svg or .png' in capsys.readouterr().err


def test_the_font_of_pictures_has_the_signs_of_drawings() -> None:
    """A sign that a font lacks is drawn as the same box as any other that it lacks."""
    font = picture_font(40)
    shapes = {sign: bytes(font.getmask(sign)) for sign in "\ufffe×µ°ΔλЖ"}
    assert len(set(shapes.values())) == len(shapes)


def test_hostile_names_are_text_in_an_svg() -> None:
    system = preset.load("simultaneous").with_(name='</svg><script>alert("1")</script>\n\x07', observer="person 17")
    root = ElementTree.fromstring(as_svg(draw_bench(system)))
    assert not list(root.iter("{http://www.w3.org/2000/svg}script"))
    assert Image.open(io.BytesIO(as_png(draw_bench(system)))).size[0] > 100


@pytest.mark.parametrize(("file", "changes"), [("bench-drawn", {"relay1.iris_na": 0.03}), ("bench-eye", {"eye": {}})])
def test_the_manual_shows_what_is_drawn_today(file: str, changes: dict[str, object]) -> None:
    shown = Path(__file__).parents[2] / "docs" / "images" / f"{file}.svg"
    assert shown.read_text(encoding="utf-8") == as_svg(draw_bench(preset.load("holochrome-8").edit(changes)))


def test_elements_side_by_side_say_so() -> None:
    arms = [part for part in parts_of_bench(preset.load("michelson-complex")) if part.kind == "modulator"]
    assert [part.name for part in arms] == ["arm 1", "arm 2"]
    assert "beside arm 1" in arms[1].details and not any("beside" in text for text in arms[0].details)
