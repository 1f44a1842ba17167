"""Pictures of another aspect: fill, fit and crop; what is cut off or black in words; depth maps go with the picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.holograms.targets.framing import FILL, Framing
from holoview.holograms.targets.picture import Picture, resize_to_cover
from holoview.holograms.targets.target import scene_depth
from holoview.util.errors import UserError

GRID = (40, 60)
SHAPES = [(120, 60), (60, 120), (90, 90), (40, 60), (33, 47)]


def _ramps(shape: tuple[int, int]) -> np.ndarray:
    """Red rises from left to right, green from above to below, each from 0 to 1 over the picture."""
    y, x = ((np.arange(size) + 0.5) / size for size in shape)
    return np.stack(np.broadcast_arrays(x[None], y[:, None], 1.0), axis=-1).astype(np.float32)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    "framing", [FILL, Framing("crop", (0.5, 0.5), 0.5), Framing("crop", (0.1, 0.9), 0.7), Framing("crop", (1.0, 0.0))]
)
def test_every_sample_is_that_of_its_place(shape: tuple[int, int], framing: Framing) -> None:
    """Of ramps, each sample is the place of its middle in the picture, within a pixel of the picture or of the grid."""
    left, top, width, height = framing.window(shape, GRID)
    assert width / height == pytest.approx(GRID[1] / GRID[0])
    assert left >= -1e-9 and top >= -1e-9 and left + width <= shape[1] + 1e-9 and top + height <= shape[0] + 1e-9
    found = resize_to_cover(_ramps(shape), GRID, framing)
    y, x = ((np.arange(size) + 0.5) / size for size in GRID)
    most = 1.0 / min(*shape, *GRID)
    assert found.shape == (*GRID, 3)
    assert np.abs(found[..., 0] - (left + x * width) / shape[1]).max() < most
    assert np.abs(found[..., 1] - ((top + y * height) / shape[0])[:, None]).max() < most


@pytest.mark.parametrize("shape", SHAPES)
def test_fit_shows_all_of_a_picture_and_black_beside_it(shape: tuple[int, int]) -> None:
    found = resize_to_cover(_ramps(shape), GRID, Framing("fit"))
    lit = found[..., 2] > 0.5
    rows, columns = np.flatnonzero(lit.any(axis=1)), np.flatnonzero(lit.any(axis=0))
    box = found[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    assert len(rows) == GRID[0] or len(columns) == GRID[1]
    assert len(columns) / len(rows) == pytest.approx(shape[1] / shape[0], rel=1.5 / min(len(rows), len(columns)))
    assert np.all(box[..., 2] > 0.99) and not np.any(found[~lit])
    assert abs(rows[0] - (GRID[0] - 1 - rows[-1])) <= 1 and abs(columns[0] - (GRID[1] - 1 - columns[-1])) <= 1
    most = 2.0 / min(box.shape[:2])
    assert box[0, 0, 0] < most and box[0, -1, 0] > 1 - most and box[-1, 0, 1] > 1 - most, "nothing is cut off"


@pytest.mark.parametrize(
    ("framing", "shape", "said"),
    [
        (FILL, (40, 60), ""),
        (FILL, (120, 60), "cut off: 33 % above, 33 % below"),
        (FILL, (40, 120), "cut off: 25 % left, 25 % right"),
        (Framing("fit"), (40, 120), "black: 25 % above, 25 % below"),
        (Framing("fit"), (40, 20), "black: 33 % left, 33 % right"),
        (Framing("crop", (0.0, 0.5), 0.5), (40, 60), "cut off: 50 % right, 25 % above, 25 % below"),
    ],
)
def test_it_is_said_what_is_cut_off_or_black(framing: Framing, shape: tuple[int, int], said: str) -> None:
    assert framing.describe(shape, GRID) == said


@pytest.mark.parametrize("shape", SHAPES)
def test_what_is_said_is_what_is_missing(shape: tuple[int, int]) -> None:
    """The shares in the sentence are those of the window."""
    for framing in (FILL, Framing("crop", (0.3, 0.8), 0.6)):
        _, _, width, height = framing.window(shape, GRID)
        kept = width / shape[1] * height / shape[0]
        shares = {"left": 0.0, "right": 0.0, "above": 0.0, "below": 0.0}
        said = framing.describe(shape, GRID).removeprefix("cut off: ")
        shares |= {part.split()[2]: float(part.split()[0]) / 100 for part in said.split(", ") if part}
        seen = (1 - shares["left"] - shares["right"]) * (1 - shares["above"] - shares["below"])
        assert seen == pytest.approx(kept, abs=0.02)  # each share is rounded to a hundredth


@pytest.mark.parametrize("wrong", [{"kind": "stretch"}, {"share": 0.0}, {"share": 1.5}, {"centre": (0.5, 1.2)}])
def test_impossible_framings_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(UserError, match="framing"):
        Framing(**wrong)  # type: ignore[arg-type]


def test_a_depth_map_is_framed_as_its_picture(tmp_path: Path) -> None:
    """The depth rises from left to right as red does: each sample's depth follows from its colour."""
    shape = (90, 90)
    ramps = _ramps(shape)
    depth = tmp_path / "depth.png"
    Image.fromarray(np.rint(255 * ramps[..., 0]).astype(np.uint8)).save(depth)
    system = hv.load("holochrome-8").with_(shape=[20, 30], planes=["5 mm", "10 mm"])
    placement = hv.Placement(depth=depth, framing=Framing("crop", (0.2, 0.5), 0.5))
    grid = hv.target_for(system, Picture(ramps, "ramps"), placement).stack.shape[1:3]
    red = resize_to_cover(ramps, (grid[0], grid[1]), placement.framing)[..., 0]
    depth_m = scene_depth(system, placement, Picture(ramps, "ramps"), (grid[0], grid[1]))
    share = (10e-3 - np.asarray(depth_m)) / 5e-3
    assert np.abs(share - red).max() < 1.5 / 90 + 1 / 255
    plain = hv.target_for(system, Picture(ramps, "ramps"), hv.Placement(at_m=5e-3)).stack
    framed = hv.target_for(system, Picture(ramps, "ramps"), hv.Placement(at_m=5e-3, framing=placement.framing)).stack
    assert not np.allclose(plain, framed)


@pytest.mark.parametrize(
    ("text", "framing"),
    [
        ("fill", FILL),
        ("fit", Framing("fit")),
        ("crop", Framing("crop")),
        ("crop:0.25,1", Framing("crop", (0.25, 1.0))),
        ("crop:0.25,1,0.5", Framing("crop", (0.25, 1.0), 0.5)),
    ],
)
def test_a_framing_is_read_from_text(text: str, framing: Framing) -> None:
    assert Framing.parse(text) == framing


@pytest.mark.parametrize("text", ["", "stretch", "fit:1,1", "crop:", "crop:1", "crop:a,b", "crop:0,0,3", "crop:nan,0"])
def test_another_text_is_refused(text: str) -> None:
    with pytest.raises(UserError):
        Framing.parse(text)


def test_the_target_says_how_its_picture_was_placed(tmp_path: Path) -> None:
    """A square picture on a bench twice as wide: a half is cut off, or as much is black as it takes."""
    Image.new("RGB", (40, 40), "white").save(tmp_path / "square.png")
    system = hv.load("simultaneous").with_(shape=[16, 32])
    for framing, said in (
        (FILL, "cut off: 25 % above, 25 % below"),
        (Framing("fit"), "black: 25 % left, 25 % right"),
    ):
        target = hv.target_for(system, tmp_path / "square.png", hv.Placement(framing=framing))
        assert any(said in note for note in target.notes)
    wide = tmp_path / "wide.png"
    Image.new("RGB", (80, 40), "white").save(wide)
    assert not any("aspect" in note for note in hv.target_for(system, wide).notes)
