"""A folder of views: what `views.toml` says, the order of the pictures, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.model.system import System
from holoview.targets.light_field import ViewGrid, is_light_field, read_light_field
from holoview.targets.moving_pupil import target_from_views

Bench = Callable[..., System]

GRID = 'rows = 2\ncolumns = 3\nspacing = "0.5 mm"\n'
EYE = {"pupil": "1 mm"}


def seen(bench: Bench, **eye: str) -> System:
    """A bench of two planes and 6 × 8 samples, which hold no walk-off, and its eye."""
    return bench(2).with_(propagation="periodic", eye=EYE | eye)


def folder(path: Path, text: str | None = GRID, names: str = "view-{row}-{column}.png") -> Path:
    """Six views (row, column), 8 × 6 pixels, whose red is 40·row and whose green is 40·column."""
    path.mkdir()
    for number, (row, column) in enumerate(np.ndindex(2, 3)):
        name = names.format(row=row + 1, column=column + 1, number=number + 7)
        Image.new("RGB", (8, 6), (40 * row, 40 * column, 100)).save(path / name)
    if text is not None:
        (path / "views.toml").write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("names", ["view-{row}-{column}.png", "{number}.png", "r{row}c{column}.png"])
def test_views_are_read_row_by_row_in_the_order_of_their_numbers(tmp_path: Path, bench: Bench, names: str) -> None:
    field = read_light_field(seen(bench), folder(tmp_path / "a", names=names))
    assert field.views.shape == (2, 3, 6, 8, 3)
    red, green = field.views[:, :, 0, 0, 0], field.views[:, :, 0, 0, 1]
    assert (np.diff(red, axis=0) > 0).all() and not np.diff(red, axis=1).any()
    assert (np.diff(green, axis=1) > 0).all() and not np.diff(green, axis=0).any()


def test_the_description_says_where_viewpoints_and_zero_disparity_are(tmp_path: Path, bench: Bench) -> None:
    system = seen(bench, eyepiece="25 mm")
    plain = read_light_field(system, folder(tmp_path / "plain"))
    assert (plain.spacing_m, plain.zero_m, plain.eyepiece_m, plain.centre_m) == (0.5e-3, 9.25e-3, 25e-3, (0, 0))
    more = 'zero_disparity = "0.2 D"\npupil_x = "1 mm"\npupil_y = "-0.5 mm"\n'
    moved = read_light_field(system, folder(tmp_path / "moved", GRID + more))
    assert moved.zero_m == pytest.approx(9e-3 + 0.2 * 25e-3**2) and moved.centre_m == (-0.5e-3, 1e-3)
    other = folder(tmp_path / "other", GRID + 'zero_disparity = "9.1 mm"\n')
    assert read_light_field(system, other, zero_m=1e-3).zero_m == 9.1e-3
    assert read_light_field(system, folder(tmp_path / "bare", None), ViewGrid(2, 3, 1e-3), 9.4e-3).zero_m == 9.4e-3


def test_only_a_folder_with_a_description_is_a_light_field(tmp_path: Path) -> None:
    assert is_light_field(folder(tmp_path / "a")) and not is_light_field(folder(tmp_path / "b", None))
    assert not is_light_field(tmp_path / "a" / "view-1-1.png") and not is_light_field(tmp_path / "nowhere")


def test_a_light_field_is_seen_by_the_eye_of_the_bench(tmp_path: Path, bench: Bench) -> None:
    """A pupil of 1 mm in the middle of 1 × 1 mm takes a half of each column, one of which is black."""
    (tmp_path / "views").mkdir()
    for number in range(4):
        Image.new("RGB", (8, 6), (255 if number in (1, 3) else 0,) * 3).save(tmp_path / "views" / f"{number}.png")
    (tmp_path / "views" / "views.toml").write_text('rows = 2\ncolumns = 2\nspacing = "0.5 mm"\n', encoding="utf-8")
    system = seen(bench).edit({"eye.chromatic": False})
    field = read_light_field(system, tmp_path / "views")
    assert target_from_views(system, field, 0.5).stack == pytest.approx(np.full((2, 6, 8, 3), 0.25), abs=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rows = 2\ncolumns = 3\n", "views.toml: no spacing; expected that of the viewpoints"),
        ('rows = 2\nspacing = "1 mm"\n', "views.toml: columns: is missing"),
        (GRID + "size = 3\n", "views.toml: size: unknown key"),
        (GRID.replace("0.5 mm", "0 mm"), "views.toml: spacing: 0 mm is out of range"),
        (GRID.replace("0.5 mm", "1 kg"), "views.toml: spacing: "),
        (GRID + 'zero_disparity = "-1 mm"\n', "views.toml: zero_disparity: .*before the last modulator"),
        ("rows =", "views.toml: isn't TOML"),
        (GRID.replace("3", "4"), r"holds 6 pictures and lacks those of row and column 1-4, 2-4; expected 8, one for"),
        (GRID.replace("2", "1"), "holds 6 pictures; expected 3"),
    ],
)
def test_a_wrong_description_is_refused(tmp_path: Path, bench: Bench, text: str, words: str) -> None:
    with pytest.raises(hv.UserError, match=words):
        read_light_field(seen(bench), folder(tmp_path / "views", text))


def test_what_is_missing_or_differs_is_named(tmp_path: Path, bench: Bench) -> None:
    system, path = seen(bench), folder(tmp_path / "views")
    (path / "view-2-1.png").unlink()
    with pytest.raises(hv.UserError, match=r"holds 5 pictures and lacks those of row and column 2-1; expected 6"):
        read_light_field(system, path)
    Image.new("RGB", (9, 6)).save(path / "view-2-1.png")
    with pytest.raises(hv.UserError, match=r"view-2-1\.png: is 9 × 6; expected 8 × 6 as view-1-1\.png; render all at"):
        read_light_field(system, path)
    with pytest.raises(hv.UserError, match=r"without an eye; expected a bench with an eye.*--set eye=\{\}"):
        read_light_field(bench(2), path)
    with pytest.raises(hv.UserError, match="is a file; expected a folder of views"):
        read_light_field(system, path / "view-1-1.png")
