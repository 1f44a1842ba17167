"""Defocus kernels of the aperture's shape: width, unit sum, and convolution without wrap-around."""

from __future__ import annotations

import math

import numpy as np
import pytest

from holoview.holograms.targets.defocus import (
    Aperture,
    FftConvolver,
    LightCone,
    blur_kernel,
    diffraction_half_angle,
    kernel_share_in_frame,
)

FLOAT32_FFT = 2e-6  # rounding of a float32 transform pair on values up to 1
APERTURES: tuple[Aperture, ...] = ("square", "disc")


def test_half_angle_obeys_the_grating_equation() -> None:
    assert math.sin(diffraction_half_angle(550e-9, 8e-6)) == pytest.approx(550e-9 / 16e-6, rel=1e-12)
    assert diffraction_half_angle(1e-6, 0.5e-6) == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(("wavelength", "pitch"), [(0, 1e-6), (1e-6, 0), (2.1e-6, 1e-6), (math.nan, 1e-6)])
def test_half_angle_refuses_what_diffracts_nowhere(wavelength: float, pitch: float) -> None:
    with pytest.raises(ValueError, match="0 < wavelength ≤ 2 · pitch"):
        diffraction_half_angle(wavelength, pitch)


def test_blur_grows_with_distance_on_both_sides_of_focus() -> None:
    cone = LightCone(0.05)
    assert cone.radius_px(2e-3, 4e-6) == pytest.approx(25)
    assert cone.radius_px(-2e-3, 4e-6) == pytest.approx(25)


@pytest.mark.parametrize("aperture", APERTURES)
@pytest.mark.parametrize("radius", [0, 0.3, 0.5, 0.51, 1, 1.5, 2.25, 7.9, 20.5])
def test_a_kernel_sums_to_one_and_is_symmetric(aperture: Aperture, radius: float) -> None:
    blur = blur_kernel(radius, aperture)
    assert blur.sum() == pytest.approx(1, abs=1e-12)
    assert blur.min() >= 0
    for turned in (blur[::-1], blur[:, ::-1], blur.T):
        assert blur == pytest.approx(turned, abs=1e-15)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.0, -5.0), (-2.3, 6.8), (0.4, 0.0)])
@pytest.mark.parametrize("radius", [0.2, 2.5, 7.9, 20.5])
def test_a_pupils_blur_has_its_diameter_and_is_moved_by_its_decentre(radius: float, shift: tuple[float, float]) -> None:
    """Of NA and decentre c at Δz: a disc of diameter 2·NA·Δz whose middle lies at Δz·c, with opposite sign at −Δz."""
    pitch, distance = 4e-6, 0.5e-3
    cone = LightCone(radius * pitch / distance, "disc", (shift[0] * pitch / distance, shift[1] * pitch / distance))
    width = max(radius, 0.5)
    for sign in (1, -1):
        blur = cone.kernel(sign * distance, pitch)
        y, x = np.indices(blur.shape) - len(blur) // 2
        # Each end of a chord lies in a pixel whose light counts at its middle: at most 1/8 pixel off, of 2·width.
        for axis, k in enumerate((y, x)):
            assert (blur * k).sum() == pytest.approx(sign * shift[axis], abs=1 / (8 * width))
        distances = np.hypot(y - sign * shift[0], x - sign * shift[1])
        assert (blur[distances > width + 0.71] == 0).all()
        assert blur[distances < width - 0.71] == pytest.approx(1 / (math.pi * width**2), rel=2e-4)
        assert blur.sum() == pytest.approx(1, abs=1e-12) and blur.min() >= 0


def test_a_shift_by_whole_pixels_moves_the_kernel() -> None:
    for aperture in APERTURES:
        centred, moved = blur_kernel(4.3, aperture), blur_kernel(4.3, aperture, (2.0, -3.0))
        middle = len(moved) // 2
        found = moved[middle + 2 - 4 : middle + 2 + 5, middle - 3 - 4 : middle - 3 + 5]
        assert found == pytest.approx(centred, abs=1e-12)


@pytest.mark.parametrize("aperture", APERTURES)
def test_light_that_comes_from_outside_is_missing_in_the_share(aperture: Aperture) -> None:
    blur = blur_kernel(3.2, aperture, (1.5, -2.0))
    even = FftConvolver(np.ones((1, 20, 31), dtype=np.float32), len(blur) // 2).convolve(blur)[0]
    assert kernel_share_in_frame(blur, (20, 31)) == pytest.approx(even, abs=FLOAT32_FFT)


@pytest.mark.parametrize(
    ("cone", "words"),
    [
        ({"half_width": math.nan}, "finite slopes"),
        ({"half_width": -0.1}, "finite slopes"),
        ({"half_width": 0.1, "centre": (0.0, math.inf)}, "finite slopes"),
        ({"half_width": 0.1, "aperture": "hexagon"}, "'square' or 'disc'"),
    ],
)
def test_light_cones_that_make_no_sense_are_refused(cone: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        LightCone(**cone)  # type: ignore[arg-type]


def test_below_half_a_pixel_nothing_is_blurred() -> None:
    for aperture in APERTURES:
        assert blur_kernel(0.5, aperture).tolist() == [[1.0]]


def test_a_square_of_whole_pixels_is_even() -> None:
    assert blur_kernel(2.5, "square") == pytest.approx(np.full((5, 5), 1 / 25))


def test_the_rim_of_a_square_holds_the_share_of_its_pixels() -> None:
    middle = blur_kernel(1.75, "square")[2]
    assert middle / middle[2] == pytest.approx(np.array([0.25, 1, 1, 1, 0.25]))


@pytest.mark.parametrize("radius", [3.0, 5.4, 12.7])
def test_second_moments_are_those_of_the_shape(radius: float) -> None:
    for aperture, moment in (("square", radius**2 / 3), ("disc", radius**2 / 4)):
        blur = blur_kernel(radius, aperture)  # type: ignore[arg-type]
        k = np.arange(len(blur)) - len(blur) // 2
        for axis in (0, 1):
            assert (blur.sum(axis=axis) * k**2).sum() == pytest.approx(
                moment, abs=0.17
            )  # a pixel adds 1/12, its sampling ± as much


def test_inside_a_disc_every_pixel_has_one_over_its_area() -> None:
    radius = 10.3
    blur = blur_kernel(radius, "disc")
    y, x = np.indices(blur.shape) - len(blur) // 2
    inside, outside = np.hypot(x, y) < radius - 0.71, np.hypot(x, y) > radius + 0.71
    assert blur[inside] == pytest.approx(np.full(inside.sum(), 1 / (math.pi * radius**2)), rel=1e-4)
    assert (blur[outside] == 0).all()


@pytest.mark.parametrize("aperture", APERTURES)
def test_a_blurred_point_is_the_kernel_at_the_point(aperture: Aperture) -> None:
    point = np.zeros((2, 40, 33), dtype=np.float32)
    point[0, 18, 15] = 1
    blur = blur_kernel(6.3, aperture)
    image = FftConvolver(point, 6).convolve(blur)
    assert image[0, 12:25, 9:22] == pytest.approx(blur, abs=FLOAT32_FFT)
    assert image[0].sum() == pytest.approx(1, abs=1e-5)
    assert np.abs(image[1]).max() == 0


def test_light_leaves_at_the_border_and_does_not_come_back_on_the_other_side() -> None:
    point = np.zeros((1, 30, 30), dtype=np.float32)
    point[0, 0, 29] = 1
    image = FftConvolver(point, 9).convolve(blur_kernel(9, "square"))
    assert np.abs(image[0, 15:]).max() < FLOAT32_FFT and np.abs(image[0, :, :15]).max() < FLOAT32_FFT


def test_a_kernel_larger_than_announced_is_refused() -> None:
    with pytest.raises(ValueError, match="reaches 9 px"):
        FftConvolver(np.zeros((1, 30, 30), dtype=np.float32), 8).convolve(blur_kernel(9, "square"))


@pytest.mark.parametrize("shift", [(0.0, 0.0), (4.5, -3.25)])
@pytest.mark.parametrize("aperture", APERTURES)
def test_a_blur_wider_than_the_picture_is_cut_to_what_acts_on_it(
    aperture: Aperture, shift: tuple[float, float]
) -> None:
    """Pixels of 12 × 9 are at most 11 apart; what is left is the middle of the whole blur, whose area is that of its
    shape to 1/64 of a pixel's strip along the rim."""
    whole, cut = blur_kernel(40.0, aperture, shift), blur_kernel(40.0, aperture, shift, most=11)
    middle = len(whole) // 2
    assert cut.shape == (23, 23) and cut.sum() < 0.2
    assert cut == pytest.approx(whole[middle - 11 : middle + 12, middle - 11 : middle + 12], rel=1e-4)
    assert (blur_kernel(3.0, aperture, shift, most=50) == blur_kernel(3.0, aperture, shift)).all()
    picture = np.random.default_rng(0).random((1, 12, 9)).astype(np.float32)
    blurred = [FftConvolver(picture, len(of) // 2).convolve(of) for of in (whole, cut)]
    assert blurred[0] == pytest.approx(blurred[1], rel=1e-4)


@pytest.mark.parametrize("aperture", APERTURES)
@pytest.mark.parametrize("shape", [(40, 31), (9, 12), (1, 5)])
def test_the_share_inside_the_frame_is_what_blurring_an_even_frame_leaves(
    aperture: Aperture, shape: tuple[int, int]
) -> None:
    blur = blur_kernel(7.2, aperture)
    even = FftConvolver(np.ones((1, *shape), dtype=np.float32), 7).convolve(blur)[0]
    assert kernel_share_in_frame(blur, shape) == pytest.approx(even, abs=FLOAT32_FFT)
    window = (slice(0, 4), slice(2, 5))
    assert (kernel_share_in_frame(blur, shape, window) == kernel_share_in_frame(blur, shape)[window]).all()
