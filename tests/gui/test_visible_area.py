"""The part of an image that a panel shows: pans of whole pixels move it by as many."""

from __future__ import annotations

import pytest

from holoview.viewer.app.viewport import VisibleArea, visible_area_of
from holoview.viewer.render.view_settings import ViewSettings

SHAPE = (64, 96)


def _area(zoom: float, centre: tuple[float, float], size: tuple[int, int]) -> VisibleArea:
    return visible_area_of(ViewSettings(plane_m=0.0, zoom=zoom, centre=centre), size, SHAPE)


@pytest.mark.parametrize("size", [(313, 326), (312, 325), (640, 401)], ids=str)
@pytest.mark.parametrize("zoom", [1.0, 4.0, 7.3])
@pytest.mark.parametrize("step_count", [1, 5, 7])
def test_a_pan_by_whole_pixels_moves_the_image_by_as_many(size: tuple[int, int], zoom: float, step_count: int) -> None:
    """From a centre whose corner lies on half a pixel where the size is odd; the pan is a sum of parts, as a drag's."""
    before, u, v = _area(zoom, (0.5, 0.5), size), 0.5, 0.5
    for _ in range(step_count):
        u, v = u - 31 / step_count / (zoom * SHAPE[1]), v + 17 / step_count / (zoom * SHAPE[0])
    after = _area(zoom, (u, v), size)
    x, y = before.to_pixel(0.0, 0.0)
    assert after.to_pixel(0.0, 0.0) == pytest.approx((x + 31, y - 17), abs=1e-6)


def test_the_corner_of_the_image_lies_on_the_nearest_corner_of_a_pixel() -> None:
    for share in (0.3, 0.42, 0.5, 0.61):
        x, y = _area(3.0, (share, share), (300, 200)).to_pixel(0.0, 0.0)
        assert (x, y) == pytest.approx((round(x), round(y)), abs=1e-9)
        assert abs(x - (150 - share * 3 * 96)) <= 0.51 and abs(y - (100 - share * 3 * 64)) <= 0.51
