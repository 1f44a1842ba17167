"""Several named regions: which is chosen, the table of their figures, lines, and the notes on pictures."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from holoview.light.colour import D65_WHITE, xyz_to_linear_srgb
from holoview.util.errors import UserError
from holoview.viewer.document.archive import view_settings_from_table, view_settings_table
from holoview.viewer.document.document import Document
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.legend import channel_colours, legend_lines, scale_bar, with_notes
from holoview.viewer.document.measurements import ShownImage, measure_image, measure_region
from holoview.viewer.document.region_table import HEADINGS, region_rows, save_profile, save_regions, table_text
from holoview.viewer.render.tone_mapping import tone_map
from holoview.viewer.render.view_settings import NamedRegion, ViewSettings

A, B, C = (8, 8, 16, 16), (30, 8, 16, 16), (8, 28, 20, 12)


@pytest.fixture
def view() -> ViewSettings:
    empty = ViewSettings(plane_m=0.01)
    return empty.with_new_region(A).with_new_region(B).with_new_region(C)


def _speckle(session: EditingSession, seed: int) -> np.ndarray:
    rows, columns = session.document.image_shape
    return np.random.default_rng(seed).exponential(size=(rows, columns))[..., None] * D65_WHITE


def test_each_new_region_has_the_next_letter_and_is_chosen(view: ViewSettings) -> None:
    assert view.regions == (NamedRegion("A", A), NamedRegion("B", B), NamedRegion("C", C))
    assert (view.region_name, view.region) == ("C", C)
    again = view.without_region("A").with_new_region(A)
    assert again.region_name == "A", "a letter that is free again"


def test_choosing_renaming_and_forgetting_keep_the_others(view: ViewSettings) -> None:
    chosen = view.with_region_chosen("A")
    assert chosen.region == A and chosen.regions == view.regions
    renamed = chosen.with_region_renamed("A", "sky").with_region_renamed("B", "grass")
    assert {of.name: of.region for of in renamed.regions} == {"C": C, "grass": B, "sky": A}
    assert renamed.region_name == "sky"
    left = renamed.without_region("sky")
    assert left.region is not None and {of.name for of in left.regions} == {"C", "grass"}
    none = left.without_region("C").without_region("grass")
    assert none.region is None and none.regions == ()


@pytest.mark.parametrize("name", ["B", "", "  "])
def test_names_are_unique_and_not_empty(view: ViewSettings, name: str) -> None:
    for taken in ("A", "C"):  # one of the others, and the chosen one
        with pytest.raises(UserError):
            view.with_region_renamed(taken, name)
    with pytest.raises(UserError, match="region"):
        view.with_region_chosen("D")


def test_regions_outlive_the_program_and_are_cut_to_the_image(view: ViewSettings) -> None:
    view = view.with_(has_legend=True)
    saved = json.loads(json.dumps(view_settings_table(view)))
    assert view_settings_from_table(saved) == view
    clamped = view.clamped_to(3, (26, 40), 1, 2)
    assert {of.name: of.region for of in clamped.regions} == {"A": A, "B": (30, 8, 10, 16)}, "C lies outside"


def test_drawing_a_region_is_a_look(session: EditingSession) -> None:
    session.change("Gap", {"gap": 3e-3})
    session.undo()
    session.edit("Region", view_settings=session.view_settings.with_new_region(A))
    session.edit("Region", view_settings=session.view_settings.with_new_region(B))
    assert session.can_redo
    session.look_back()
    assert [of.name for of in session.view_settings.regions] == ["A"]


def test_the_table_has_every_region_of_every_image_by_one_function(session: EditingSession, view: ViewSettings) -> None:
    session.edit("Regions", view_settings=view)
    images = [ShownImage("now", _speckle(session, 1), np.ones((*session.document.image_shape, 3), np.float32))]
    images.append(ShownImage("kept, earlier", 3 * _speckle(session, 2)))
    rows = region_rows(session, images)
    assert [(row.image, row.name) for row in rows] == [(of.name, name) for of in images for name in "ABC"]
    for row, image in zip(rows, [images[0]] * 3 + [images[1]] * 3, strict=True):
        expected = measure_region(image.xyz, row.region, image.target)
        assert row.metrics is not None and row.metrics.contrast == expected.contrast
        assert (row.metrics.psnr_db, row.metrics.mean) == (expected.psnr_db, expected.mean)
    live = measure_image(session.document, images[0].xyz, images[0].target, None, images[1:])
    assert [row.metrics and row.metrics.contrast for row in live.rows] == [row.metrics.contrast for row in rows]  # type: ignore[union-attr]
    assert live.region is not None and live.region.contrast == rows[2].metrics.contrast, "C is the chosen one"  # type: ignore[union-attr]


def test_text_and_csv_have_the_same_cells(session: EditingSession, view: ViewSettings, tmp_path: Path) -> None:
    session.edit("Regions", view_settings=view.with_region_renamed("A", 'the "sky", left'))
    images = [ShownImage("now", _speckle(session, 1))]
    save_regions(session, tmp_path / "table", images)
    with (tmp_path / "table.csv").open(newline="", encoding="utf-8") as file:
        cells = list(csv.reader(file))
    assert cells == [line.split("\t") for line in table_text(region_rows(session, images)).splitlines()]
    first = dict(zip(HEADINGS, next(line for line in cells if line[1].startswith("the")), strict=True))
    assert first["region"] == 'the "sky", left' and [int(first[key]) for key in ("x", "y", "width", "height")] == [*A]
    assert float(first["contrast"]) == pytest.approx(measure_region(images[0].xyz, A).contrast, rel=1e-5)
    assert first["psnr_db"] == "", "there is no target"


def test_what_cant_be_measured_has_its_reason(session: EditingSession, view: ViewSettings) -> None:
    """A dark region, a picture that doesn't show the target, and an image of another size."""
    session.edit("Regions", view_settings=view)
    xyz = _speckle(session, 1)
    xyz[8:24, 8:24] = 0
    rows, columns = session.document.image_shape
    y, x = np.mgrid[:rows, :columns]
    checks = np.repeat(((x // 4 + y // 4) % 2)[..., None], 3, axis=2).astype(np.float32)
    dark, unlike, _, small, *_ = region_rows(
        session, [ShownImage("now", xyz, checks), ShownImage("small", xyz[:16, :16])]
    )
    assert dark.metrics is None and "light" in dark.problem
    assert unlike.metrics is not None and unlike.metrics.contrast is None and "target" in unlike.metrics.withheld
    assert small.metrics is None and "16 × 16" in small.problem
    text = table_text([dark, unlike, small])
    assert all(reason in text for reason in (dark.problem, unlike.metrics.withheld, small.problem))
    with pytest.raises(UserError, match="being computed"):
        region_rows(session, [])


def test_a_profile_has_luminance_and_colours_of_every_image(session: EditingSession, tmp_path: Path) -> None:
    images = [ShownImage(f"image {seed}", _speckle(session, seed)) for seed in (1, 2)]
    with pytest.raises(UserError, match="line"):
        save_profile(session, tmp_path / "profile.csv", images)
    session.edit_view("Line", profile=(3.0, 5.0, 13.0, 5.0))
    save_profile(session, tmp_path / "profile.csv", images)
    lines = list(csv.DictReader(io.StringIO((tmp_path / "profile.csv").read_text())))
    assert [line["image"] for line in lines] == ["image 1"] * 11 + ["image 2"] * 11
    pitch_mm = session.document.sample_pitch_m * 1e3
    for number, line in enumerate(lines):
        value = images[number // 11].xyz[5, 3 + number % 11]
        assert float(line["distance_mm"]) == pytest.approx(number % 11 * pitch_mm, rel=1e-5)
        assert float(line["luminance"]) == pytest.approx(value[1], rel=1e-5)
        seen = [float(line[name]) for name in "RGB"]
        assert seen == pytest.approx(xyz_to_linear_srgb(value), rel=1e-4, abs=1e-5)  # six digits


# --- scale bar and legend ---------------------------------------------------------------------------------------------


def _with_look(session: EditingSession, **look: object) -> Document:
    return replace(session.document, view_settings=session.view_settings.with_(**look))


def test_the_bar_is_as_long_as_it_says(session: EditingSession) -> None:
    document = session.document
    bar = scale_bar(document, 30.0)
    assert bar.samples <= 30
    assert float(bar.text.split()[0]) == pytest.approx(bar.samples * document.sample_pitch_m * 1e3)


def test_a_saved_picture_keeps_all_its_samples_above_its_notes(session: EditingSession) -> None:
    """The bar is counted in pixels of the picture that is written."""
    pixels = tone_map(_speckle(session, 1), session.view_settings)
    rows, columns = pixels.shape[:2]
    assert with_notes(pixels, session.document) is pixels, "only where it is asked for"
    document = _with_look(session, has_scale_bar=True)
    noted = with_notes(pixels, document)
    assert np.array_equal(noted[:rows, :columns], pixels)
    below = np.all(noted[rows:] == 255, axis=2)
    longest = max(len(run) for line in below for run in "".join("#" if on else " " for on in line).split() or [""])
    assert longest == round(scale_bar(document, 0.2 * document.image_shape[1]).samples)
    both = with_notes(pixels, _with_look(session, has_scale_bar=True, has_legend=True, channel="Y"))
    assert both.shape[0] > noted.shape[0]


def test_a_legend_says_what_is_seen(session: EditingSession) -> None:
    document = _with_look(session, plane_m=0.0125, solo=1, exposure_stops=-1.5)
    nm = session.system.wavelengths_m[1] * 1e9
    assert legend_lines(document) == ["plane 12.5 mm", f"lasers {nm:.4g} nm", "exposure -1.5 stops"]


@pytest.mark.parametrize("false_colour", ["", "cubehelix"])
def test_the_colours_of_the_legend_are_those_of_the_values(session: EditingSession, false_colour: str) -> None:
    view = session.view_settings.with_(
        channel="Y", false_colour=false_colour, exposure_stops=1.0, low=0.1, high=0.6, gamma=1.5
    )
    bar = channel_colours(view)
    assert bar is not None and (bar.low, bar.high) == pytest.approx((0.05, 0.3))
    values = np.linspace(bar.low, bar.high, len(bar.colours))
    shown = tone_map(values[None, :, None] * np.ones(3), view)[0]
    assert np.abs(shown.astype(int) - bar.colours).max() <= 8, "rounding of a level at most: steps of the map"
    assert np.mean(np.any(shown != bar.colours, axis=1)) < 0.1
    assert channel_colours(view.with_(channel="colour")) is None
