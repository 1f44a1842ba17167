"""Parts of a region that depart from their target: found where they are, and not where there is speckle alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from holoview.holograms.metrics.likeness import luminance_contrast
from holoview.holograms.metrics.local_misfit import local_misfit
from holoview.holograms.metrics.speckle import speckle_pattern
from tests.metrics.test_likeness import SIDE, WHOLE, _grey, _scene, _speckle

TOP, BOTTOM, LEFT, RIGHT = 40, 64, 30, 52


@pytest.mark.parametrize("patterns", [1, 4, 16])
def test_speckle_alone_departs_from_nothing(patterns: int) -> None:
    """By the bound one region in 1000 has a part that is found: two of 24 or more have in 3 of 10 000 runs."""
    found = [local_misfit(speckle_pattern(_speckle(200 + seed, patterns))) for seed in range(24)]
    assert sum(of is not None for of in found) <= 1


@pytest.mark.parametrize(("patterns", "by"), [(1, 6.0), (4, 2.5), (16, 0.5), (64, 1.4)])
def test_an_object_is_found_and_the_contrast_of_the_rest_is_that_of_the_speckle(patterns: int, by: float) -> None:
    """An object of 24 × 22 samples, 33 grains, is off by two standard deviations of the speckle or more.

    So nearly all windows inside it are found, whose sides are 16 at most; one that reaches out of it by half is, too.
    """
    for seed in range(3):
        speckle = _speckle(300 + seed, patterns)
        picture = speckle.copy()
        picture[TOP:BOTTOM, LEFT:RIGHT] *= by
        found = local_misfit(speckle_pattern(picture))
        assert found is not None
        x, y, width, height = found.box
        assert x < LEFT + 8 and y < TOP + 8 and x + width > RIGHT - 8 and y + height > BOTTOM - 8
        assert 0.02 < found.share < 0.3
        assert found.contrast == pytest.approx(speckle.std() / speckle.mean(), rel=0.1)


def test_only_the_order_of_the_values_tells_where() -> None:
    """Neither gain nor any rising curve of the values changes the part that is found; equal values have no order."""
    picture = _speckle(9, patterns=4)
    picture[TOP:BOTTOM, LEFT:RIGHT] *= 3
    first, *others = (local_misfit(speckle_pattern(of)) for of in (picture, 7 * picture, picture**2, np.log1p(picture)))
    assert first is not None
    assert all(of is not None and (of.box, of.share) == (first.box, first.share) for of in others)
    assert local_misfit(speckle_pattern(np.ones((64, 64)))) is None


@pytest.mark.parametrize("shape", [(1, 2), (3, 40), (8, 8), (20, 20)])
def test_a_region_of_few_grains_is_not_judged(shape: tuple[int, int]) -> None:
    assert local_misfit(speckle_pattern(_speckle(1)[: shape[0], : shape[1]])) is None


def test_beside_a_target_without_an_object_that_is_shown_the_contrast_is_withheld_with_its_place() -> None:
    """An object of 2 % of the samples that is 1.9 times as bright raises C of 0.125 to √(0.125² + 0.02·0.9²) = 0.18.

    It lies where four of the 8 × 8 blocks meet, whose means have too little of it to tell.
    """
    for seed in range(4):
        scene = ndimage.gaussian_filter(_scene(seed), 1.0)
        shown = scene.copy()
        shown[55:73, 71:89] *= 1.9
        speckle = _speckle(400 + seed, patterns=64)
        right, wrong = (luminance_contrast(shown * speckle, WHOLE, _grey(of)) for of in (shown, scene))
        assert not right.withheld and right.misfit is None
        assert right.estimate.contrast == pytest.approx(speckle.std(), rel=0.02)
        assert "depart from the target further than speckle does" in wrong.withheld and wrong.misfit is not None
        x, y, width, height = wrong.misfit.box
        assert f"{width} × {height} from ({x}, {y})" in wrong.withheld
        assert x < 89 and x + width > 71 and y < 73 and y + height > 55
        assert wrong.misfit.contrast == pytest.approx(right.estimate.contrast, rel=0.1)
        assert wrong.estimate.contrast == wrong.raw.contrast
        part = luminance_contrast(shown * speckle, (30, 40, SIDE - 40, SIDE - 50), _grey(scene))
        if part.misfit is not None:
            assert f"from ({30 + part.misfit.box[0]}, {40 + part.misfit.box[1]})" in part.withheld


def test_a_part_that_raises_the_contrast_by_a_tenth_to_a_fifth_is_said_beside_it() -> None:
    """An object of 2 % that is twice as bright raises C of 0.25 to √(0.25² + 0.02) = 0.29: 1.15 times on average."""
    said = []
    for seed in range(8):
        scene = ndimage.gaussian_filter(_scene(seed), 1.0)
        shown = scene.copy()
        shown[55:73, 71:89] *= 2.0
        found = luminance_contrast(shown * _speckle(400 + seed, patterns=16), WHOLE, _grey(scene))
        if found.withheld or found.misfit is None:
            continue
        above = found.estimate.contrast / found.misfit.contrast
        assert above < 1.2 and bool(found.doubt) == (above > 1.1)
        said.append(found.doubt)
    assert any("depart from the target further than speckle does; without them" in doubt for doubt in said)
