"""Views from a grid of viewpoints: parallax, occlusion, and what a pupil sees of them when it is focused somewhere."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import holoview as hv
from holoview.holograms.targets.defocus import LightCone
from holoview.holograms.targets.light_field import (
    LightField,
    ViewGrid,
    colour_shares,
    is_light_field,
    read_light_field,
    refocus,
    render_views,
    view_weights,
)
from holoview.holograms.targets.moving_pupil import moving_target_from_views, target_from_views, views_of_picture
from holoview.holograms.targets.picture import Picture
from holoview.holograms.targets.target import Placement, target_for
from holoview.light.colour import xyz_to_linear_srgb
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System

Bench = Callable[..., System]

PITCH, F = 4e-6, 40e-3
ZERO = 10e-3
FLOAT32 = 1e-5


def views(
    picture: NDArray[np.float32], depth_m: float | NDArray[np.floating], grid: tuple[int, int], spacing_m: float
) -> LightField:
    return render_views(picture, depth_m, PITCH, grid, spacing_m, (0.0, 0.0), ZERO, F)


def point(row: int, column: int, shape: tuple[int, int] = (41, 61)) -> NDArray[np.float32]:
    picture = np.zeros((*shape, 3), dtype=np.float32)
    picture[row, column] = 1
    return picture


def middle(image: NDArray[np.float32]) -> tuple[float, float]:
    """The centre of gravity (y, x) of an image's light."""
    y, x = (float((image[..., 1] * k).sum() / image[..., 1].sum()) for k in np.indices(image.shape[:2]))
    return y, x


def wave(shape: tuple[int, int], period: float) -> NDArray[np.float32]:
    """A grey wave along x."""
    x = np.arange(shape[1]) - shape[1] // 2
    return np.repeat(np.broadcast_to(0.5 + 0.5 * np.cos(2 * np.pi * x / period), shape)[..., None], 3, axis=2).astype(
        np.float32
    )


def test_a_point_before_zero_disparity_moves_against_the_viewpoint() -> None:
    """By p·(z₀ − z)/f: from 0.8 mm to the right, a point 1 mm nearer than z₀ is 20 µm, 5 samples, to the left."""
    field = views(point(20, 30), ZERO + 1e-3, (3, 3), 0.8e-3)
    for row, column in np.ndindex(3, 3):
        expected = (20 - 5 * (row - 1), 30 - 5 * (column - 1))
        assert middle(field.views[row, column]) == pytest.approx(expected, abs=FLOAT32)


def test_a_point_at_zero_disparity_is_in_the_same_place_in_all_views() -> None:
    field = views(point(20, 30), ZERO, (3, 3), 0.8e-3)
    assert (field.views == point(20, 30)).all()


def test_refocusing_brings_the_views_of_a_point_together() -> None:
    """Shifts are whole samples: 0.8 mm · 1 mm/40 mm = 5 samples; out of focus, each view has its own place."""
    field = views(point(20, 30), ZERO + 1e-3, (3, 3), 0.8e-3)
    cone = LightCone(1.2e-3 / F, "disc")
    sharp, blurred = refocus(field, [ZERO + 1e-3, ZERO], PITCH, cone)
    assert sharp == pytest.approx(point(20, 30), abs=FLOAT32)
    weights = view_weights(field, cone)
    spots = blurred[15:26:5, 25:36:5, 1][::-1, ::-1]  # a point behind the plane z₀ is seen upside down
    assert spots == pytest.approx(weights, abs=FLOAT32)


def test_weights_are_the_pupils_share_of_the_square_around_each_viewpoint() -> None:
    """A pupil of three squares across: the whole middle, the corners cut; off the grid's middle, moved with it."""
    field = views(point(0, 0, (3, 3)), ZERO, (5, 5), 1e-3)
    weights = view_weights(field, LightCone(1.5e-3 / F, "disc"))
    area = math.pi * 1.5**2
    assert weights[2, 2] == pytest.approx(1 / area, rel=1e-3)
    assert weights.sum() == pytest.approx(1, abs=1e-6) and not weights[0].any() and not weights[:, 4].any()
    moved = view_weights(field, LightCone(1.5e-3 / F, "disc", (1e-3 / F, -1e-3 / F)))
    assert moved[1:, :4] == pytest.approx(weights[:4, 1:], abs=1e-6)
    y, x = (weights.sum(axis=axis) @ np.arange(5) for axis in (1, 0))
    partly = view_weights(field, LightCone(1.5e-3 / F, "disc", (0.3e-3 / F, -0.4e-3 / F)))
    gravity = [partly.sum(axis=axis) @ np.arange(5) for axis in (1, 0)]
    # the gravity of a disc cut into squares differs from its own by the rim's parts that aren't seen: h²/12R
    assert gravity == pytest.approx([y + 0.3, x - 0.4], abs=1 / (12 * 1.5) + 0.02)


def test_a_grid_of_an_even_number_has_its_middle_between_viewpoints() -> None:
    field = views(point(0, 0, (3, 3)), ZERO, (4, 4), 1e-3)
    weights = view_weights(field, LightCone(2e-3 / F, "disc"))
    assert weights == pytest.approx(weights[::-1, ::-1], abs=1e-6) and weights.sum() == pytest.approx(1, abs=1e-6)


def contrast_error(period: float, across: float, count: int) -> float:
    """How much the contrast of a wave may differ between `count` views across a disc of `across` samples, and the disc.

    With q = 2π/T and squares of h = across/count samples: whole squares are replaced by their middle, (qh)²/24. The rim
    cuts 4·count squares, of each a half on average, (8/π)/count of the light, displaced by up to h/2: qh/2 of it. A
    view that is moved by half a sample costs q²/8, the area of a sample in the disc q²/24.
    """
    q, h = 2 * math.pi / period, across / count
    return (q * h) ** 2 / 24 + (8 / math.pi) / count * q * h / 2 + q**2 / 8 + q**2 / 24


def test_a_flat_picture_is_blurred_as_by_natural_defocus(bench: Bench) -> None:
    """A wave keeps the contrast that the disc of the pupil leaves it, 0.59 of it here."""
    period, defocus_m, count = 24.0, 1.6e-3, 15
    system = bench(2, (40, 120)).with_(
        planes=[ZERO, ZERO + defocus_m], eye={"eyepiece": F, "pupil": 3e-3, "chromatic": False}
    )
    picture = Picture(wave((40, 120), period), "wave")
    field = views_of_picture(system, picture, Placement(at_m=ZERO), ViewGrid(count, count, 3e-3 / count))
    found, expected = target_from_views(system, field).stack, target_for(system, picture, Placement(at_m=ZERO)).stack
    bound = contrast_error(period, 3e-3 / F * defocus_m / make_plan(system).grid.pitch_m, count)
    inside = slice(20, -20)  # borders continue differently
    assert bound < 0.05 < 0.35 < np.ptp(expected[0][:, inside]) - np.ptp(expected[1][:, inside])
    assert np.abs(found - expected)[:, :, inside].max() <= 0.5 * bound, "half the bound: the wave's amplitude"


def test_a_near_edge_hides_what_is_behind_it_and_more_from_one_side() -> None:
    """A black card at z₀ before a bright wall 1 mm behind, of which a view from the right shows the right side less.

    The wall's stripe is 4 samples from the card's edge; the wall moves by p·Δz/f = ±5 samples.
    """
    card = np.arange(61) < 30
    stripe = (np.arange(61) >= 34) & (np.arange(61) < 37)
    picture = np.broadcast_to(np.where(card, 0.0, np.where(stripe, 1.0, 0.2))[None, :, None], (21, 61, 3))
    depth = np.broadcast_to(np.where(card, ZERO, ZERO - 1e-3), (21, 61))
    left, centre, right = views(picture.astype(np.float32), depth, (1, 3), 0.8e-3).views[0][:, 10, :, 1]
    assert centre[:30].max() < FLOAT32 and centre[34:37] == pytest.approx(1, abs=FLOAT32)
    assert left[:30].max() < FLOAT32 and left[30:32] == pytest.approx(1, abs=FLOAT32), "two of three samples are left"
    assert left[32:50] == pytest.approx(0.2, abs=FLOAT32)
    assert right[:30].max() < FLOAT32 and right[39:42] == pytest.approx(1, abs=FLOAT32)


def test_each_wavelength_is_refocused_where_the_eye_is_focused(bench: Bench) -> None:
    """A flat picture, a human eye beside the axis: the light field agrees with natural defocus at every wavelength.

    The parts of the wavelengths add up with the signs that colours have; so may their errors.
    """
    eye = {"eyepiece": F, "pupil": 2e-3, "pupil_x": 0.5e-3, "accommodation": [0.0]}
    system, placement, period = bench(2, (40, 96)).with_(eye=eye), Placement(at_m=9.2e-3), 32.0
    picture, grid = Picture(wave((40, 96), period), "wave"), ViewGrid(9, 9, 2e-3 / 9, 0.0, 0.5e-3)
    assert system.eye is not None
    defocus_m = np.abs(9e-3 + system.eye.focus_shift_m(system.wavelengths_m) - 9.2e-3)
    plan = make_plan(system)
    shares = np.abs(colour_shares(xyz_to_linear_srgb(plan.colour_weights)).sum(axis=2))
    errors = [contrast_error(period, 2e-3 / F * float(z) / plan.grid.pitch_m, 9) for z in defocus_m]
    bound, inside = 0.5 * float((shares * np.array(errors)[:, None]).sum(axis=0).max()), slice(24, -24)
    for axis in ("eyepiece", "pupil"):
        moved = system.edit({"eye.chromatic_axis": axis})
        found = target_from_views(moved, views_of_picture(moved, picture, placement, grid)).stack
        expected = target_for(moved, picture, placement).stack
        unmoved = target_for(moved.edit({"eye.pupil_x": 0.0}), picture, placement).stack
        error = np.abs(found - expected)[:, :, inside].max()
        assert error <= bound < np.abs(unmoved - expected)[:, :, inside].max()


def test_a_pupil_that_moves_is_one_of_the_places(bench: Bench) -> None:
    system = bench(2, (16, 20)).with_(eye={"pupil": 2e-3})
    picture = Picture(np.random.default_rng(0).random((16, 20, 3), dtype=np.float32), "noise")
    field = views_of_picture(system, picture, Placement(), ViewGrid(7, 7, 0.5e-3))
    places = [(0.0, 0.0), (0.2e-3, -0.3e-3)]
    stacks = moving_target_from_views(system, field, 0.5)(places)
    assert system.eye is not None
    for place, stack in zip(places, stacks.reshape(2, 2, 16, 20, 3), strict=True):
        moved = system.with_(eye=system.eye.moved_to(place))
        assert (stack == target_from_views(moved, field, 0.5).stack).all()


def test_what_the_views_cant_show_is_refused(bench: Bench) -> None:
    system = bench(2, (16, 20)).with_(eye={"pupil": 3e-3})
    picture = Picture(np.ones((16, 20, 3), np.float32), "white")
    field = views_of_picture(system, picture, Placement(), ViewGrid(3, 3, 1e-3))
    assert target_from_views(system, field).stack == pytest.approx(np.ones((2, 16, 20, 3)), abs=FLOAT32)
    with pytest.raises(hv.UserError, match=r"at x, y = 0\.5 mm, 0 mm reaches beyond the views, which stand for 3 mm"):
        target_from_views(system.edit({"eye.pupil_x": 0.5e-3}), field)
    with pytest.raises(hv.UserError, match=r"views are 1 mm apart, the pupil 1\.5 mm wide; expected at least 2 views"):
        target_from_views(system.edit({"eye.pupil": 1.5e-3}), field)
    with pytest.raises(hv.UserError, match="without an eye"):
        target_from_views(system.with_(eye=None), field)
    with pytest.raises(ValueError, match="expected the grid's"):
        target_from_views(system.edit({"shape": [8, 8]}), field)
    for change in ({"spacing_m": 0.0}, {"zero_m": math.nan}, {"views": field.views[0]}):
        with pytest.raises(ValueError, match="expected"):
            replace(field, **change)  # type: ignore[arg-type]


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


@pytest.mark.long
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
