"""Light cones, their defocus blur kernels (square or disc), and FFT convolution without wrap-around.

In incoherent light, a point at distance d gives on the plane z the shape of the aperture, scaled to the half-width
|z − d|·tan θ with the half-angle θ of the light cone: a square for the eyebox of a pixelated modulator, a disc for a
round iris or for the pupil of an eye. A cone whose axis has the slope c, such as that of an eye off the axis, moves the
shape by (z − d)·c: points at different distances move against each other, which is parallax. Each sample of a kernel
is the fraction of the shape's area in that pixel, so that neither width nor shift need be a whole number of pixels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Aperture = Literal["square", "disc"]
_STRIPS_PER_PIXEL = 64


def diffraction_half_angle(wavelength_m: float, pitch_m: float) -> float:
    """Half-angle (rad) of the cone that a modulator of pixel pitch p diffracts into: θ = asin(λ / 2p).

    The grating equation for the finest grating that the pixels can show, of period 2p; it gives the half-width of the
    square eyebox. Arguments: wavelength and modulator pitch in metres.

    Raises ValueError when either isn't positive or λ > 2p, where no such angle exists.
    """
    if not (wavelength_m > 0 and pitch_m > 0 and wavelength_m <= 2 * pitch_m):
        raise ValueError(f"wavelength {wavelength_m} m, pitch {pitch_m} m: expected 0 < wavelength ≤ 2 · pitch")
    return math.asin(wavelength_m / (2 * pitch_m))


@dataclass(frozen=True)
class LightCone:
    """The directions from which light reaches an image point: a square or a disc of slopes dx/dz, perhaps off the axis.

    half_width: half the side of the square, or radius of the disc. centre: (y, x) of its middle; positive towards
    larger y and x as light goes on. Slopes are tangents of angles, for which the sines may stand: at 0.035, the first
    order of an 8 µm pixel, they differ by 0.06 %. offset_m: displacement (y, x) of all blurs, m.

    Raises ValueError for an unknown aperture, and for slopes that aren't finite or a half-width below 0.
    """

    half_width: float
    aperture: Aperture = "square"
    centre: tuple[float, float] = (0.0, 0.0)
    offset_m: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.aperture not in ("square", "disc"):
            raise ValueError(f"aperture {self.aperture!r}: expected 'square' or 'disc'")
        if not (0 <= self.half_width < math.inf and all(math.isfinite(slope) for slope in self.centre)):
            raise ValueError(f"light cone of half-width {self.half_width} about {self.centre}: expected finite slopes")

    def radius_px(self, distance_m: float, pitch_m: float) -> float:
        """Half-width of the blur, in pixels of `pitch_m`, at `distance_m` from focus: |Δz|·half_width / pitch."""
        return abs(distance_m) * self.half_width / pitch_m

    def shift_px(self, distance_m: float, pitch_m: float) -> tuple[float, float]:
        """Shift (y, x) of the blur's middle, in pixels, on a plane at Δz = `distance_m` behind the point."""
        (y, x), (offset_y, offset_x) = self.centre, self.offset_m
        return (distance_m * y + offset_y) / pitch_m, (distance_m * x + offset_x) / pitch_m

    def kernel(self, distance_m: float, pitch_m: float) -> NDArray[np.float64]:
        """The blur of a point on a plane at Δz = `distance_m` behind it, see `blur_kernel`."""
        return blur_kernel(self.radius_px(distance_m, pitch_m), self.aperture, self.shift_px(distance_m, pitch_m))


def blur_kernel(
    radius_px: float, aperture: Aperture, shift_px: tuple[float, float] = (0.0, 0.0)
) -> NDArray[np.float64]:
    """The blur of a point, shape (2r + 1, 2r + 1) with r = ceil(radius + greatest shift − ½) and sum 1.

    radius_px: half the side of the square, or radius of the disc. Below half a pixel it counts as half a pixel, so that
    the kernel of a point that isn't shifted is a single sample. shift_px: (y, x) of the shape's middle.
    The disc's area in a pixel is exact along one axis and a sum over 64 strips along the other; the average with the
    same along the other axis makes x and y equal.
    """
    (y, x), radius = shift_px, max(radius_px, 0.5)
    reach = max(math.ceil(radius + max(abs(y), abs(x)) - 0.5), 0)
    if reach == 0:
        return np.ones((1, 1))
    if aperture == "square":
        half = np.array([radius])
        shape = np.outer(_pixel_overlap(half, reach, y)[0], _pixel_overlap(half, reach, x)[0])
    else:
        shape = _disc_strips(radius, reach, y, x) + _disc_strips(radius, reach, x, y).T
    return np.asarray(shape / shape.sum())


def _disc_strips(radius: float, reach: int, across: float, along: float) -> NDArray[np.float64]:
    """A disc's area in each pixel (across, along), centred there: a sum over strips, each of them exact."""
    rows = (np.arange((2 * reach + 1) * _STRIPS_PER_PIXEL) + 0.5) / _STRIPS_PER_PIXEL - 0.5 - reach
    chords = np.sqrt(np.maximum(radius**2 - (rows - across) ** 2, 0))
    strips = _pixel_overlap(chords, reach, along).reshape(2 * reach + 1, _STRIPS_PER_PIXEL, -1)
    return np.asarray(strips.sum(axis=1))


def kernel_share_in_frame(
    blur: NDArray[np.float64], shape: tuple[int, int], window: tuple[slice, slice] = (slice(None), slice(None))
) -> NDArray[np.float32]:
    """Fraction of the blurred light at each pixel of `window` that an image of `shape` (y, x) gives; 1 far inside."""
    reach = blur.shape[0] // 2
    sums = np.zeros((blur.shape[0] + 1, blur.shape[1] + 1))
    sums[1:, 1:] = blur[::-1, ::-1].cumsum(axis=0).cumsum(axis=1)  # light comes from where the kernel doesn't point
    (top, bottom), (left, right) = (
        (np.clip(reach - index, 0, 2 * reach + 1), np.clip(reach + size - index, 0, 2 * reach + 1))
        for size, index in ((size, np.arange(size)[part]) for size, part in zip(shape, window, strict=True))
    )
    inside = sums[bottom][:, right] - sums[top][:, right] - sums[bottom][:, left] + sums[top][:, left]
    return np.asarray(inside, dtype=np.float32)


class FftConvolver:
    """Convolves one picture (channel, y, x) with many kernels; its spectrum is computed once.

    The picture is padded with zeros by `reach`, the largest radius of a kernel, so that nothing wraps around.
    """

    def __init__(self, picture: NDArray[np.float32], reach: int) -> None:
        from scipy import fft  # slow start: a picture needs it, and most programs that can open one don't

        self._picture = picture
        self._reach = reach
        self._size = [fft.next_fast_len(max(n, reach + 1) + reach, real=True) for n in picture.shape[1:]]
        self._spectrum: NDArray[np.complex64] | None = None

    def convolve(self, blur: NDArray[np.float64]) -> NDArray[np.float32]:
        """The picture convolved with `blur`, of the same shape. Raises ValueError for a kernel wider than `reach`."""
        from scipy import fft

        reach = blur.shape[0] // 2
        if reach == 0:
            return self._picture
        if reach > self._reach:
            raise ValueError(f"kernel reaches {reach} px: expected at most {self._reach}")
        if self._spectrum is None:
            self._spectrum = fft.rfft2(self._picture, s=self._size)
        centred = np.zeros(self._size, dtype=np.float32)
        centred[: blur.shape[0], : blur.shape[1]] = blur
        transfer = fft.rfft2(np.roll(centred, (-reach, -reach), axis=(0, 1)))
        full = fft.irfft2(self._spectrum * transfer, s=self._size)
        return np.asarray(full[:, : self._picture.shape[1], : self._picture.shape[2]], dtype=np.float32)


def _pixel_overlap(half_widths: NDArray[np.float64], reach: int, centre: float) -> NDArray[np.float64]:
    """Length of [c − h, c + h] inside each pixel [k − ½, k + ½], k = −reach … reach; shape (len(h), 2·reach + 1)."""
    k = np.arange(-reach, reach + 1)
    h = half_widths[:, None]
    length: NDArray[np.float64] = np.maximum(np.minimum(k + 0.5, centre + h) - np.maximum(k - 0.5, centre - h), 0)
    return length
