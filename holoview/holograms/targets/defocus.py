"""Light cones, their defocus blur kernels (square or disc), and FFT convolution without wrap-around.

In incoherent light, a point at distance d gives on the plane z the shape of the aperture, scaled to the half-width
|z − d|·tan θ with the half-angle θ of the light cone: a square for the eyebox of a pixelated modulator, a disc for a
round iris or for the pupil of an eye. A cone whose axis has the slope c, such as that of an eye off the axis, moves the
shape by (z − d)·c: points at different distances move against each other, which is parallax. Each sample of a kernel
is the fraction of the shape's area in that pixel, so that neither width nor shift need be a whole number of pixels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Aperture = Literal["square", "disc"]
_STRIPS_PER_PIXEL = 64


def diffraction_half_angle(wavelength_m: float, pitch_m: float) -> float:
    """Half-angle (rad) of the cone that a modulator of pixel pitch p diffracts into: θ = asin(λ / 2p).

    The grating equation for the finest grating that the pixels can show, of period 2p. The angle is also half the width
    of the square eyebox. Arguments: wavelength and modulator pitch in metres.

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

    def kernel(self, distance_m: float, pitch_m: float, most: int | None = None) -> NDArray[np.float64]:
        """The blur of a point on a plane at Δz = `distance_m` behind it. most: as of `blur_kernel`."""
        shift_px = self.shift_px(distance_m, pitch_m)
        return blur_kernel(self.radius_px(distance_m, pitch_m), self.aperture, shift_px, most)


def blur_kernel(
    radius_px: float, aperture: Aperture, shift_px: tuple[float, float] = (0.0, 0.0), most: int | None = None
) -> NDArray[np.float64]:
    """The blur of a point, shape (2r + 1, 2r + 1) with r = ceil(radius + greatest shift − ½) and sum 1.

    most: greatest r, beyond which the blur is cut off, as no two pixels of a picture are further apart; its sum is then
    the share that is left.

    radius_px: half the side of the square, or radius of the disc. Below half a pixel it counts as half a pixel, so that
    the kernel of a point that isn't shifted is a single sample. shift_px: (y, x) of the shape's middle.
    The disc's area in a pixel is exact along one axis and a sum over 64 strips along the other; the average with the
    same along the other axis makes x and y equal.
    """
    (y, x), radius = shift_px, max(radius_px, 0.5)
    reach = max(math.ceil(radius + max(abs(y), abs(x)) - 0.5), 0)
    if reach == 0:
        return np.ones((1, 1))
    is_cut = most is not None and most < reach
    reach = min(reach, most) if most is not None else reach
    if aperture == "square":
        half = np.array([radius])
        shape = np.outer(_pixel_overlap(half, reach, y)[0], _pixel_overlap(half, reach, x)[0])
        area = 4 * radius**2
    else:
        strips = _disc_strips(radius, reach, y, x)
        shape = (strips + (strips if x == y else _disc_strips(radius, reach, x, y)).T) / 2
        area = math.pi * radius**2
    return np.asarray(shape / (area if is_cut else shape.sum()))


def _disc_strips(radius: float, reach: int, across: float, along: float) -> NDArray[np.float64]:
    """A disc's area in each pixel (across, along), centred there: a sum over strips, each of them exact."""
    offsets = (np.arange(_STRIPS_PER_PIXEL) + 0.5) / _STRIPS_PER_PIXEL - 0.5
    found = np.empty((2 * reach + 1, 2 * reach + 1))
    for row, middle in enumerate(range(-reach, reach + 1)):  # all rows at once would take 64 times the kernel
        chords = np.sqrt(np.maximum(radius**2 - (middle + offsets - across) ** 2, 0))
        found[row] = _pixel_overlap(chords, reach, along).sum(axis=0) / _STRIPS_PER_PIXEL
    return found


def kernel_share_in_frame(
    blur: NDArray[np.float64], shape: tuple[int, int], window: tuple[slice, slice] = (slice(None), slice(None))
) -> NDArray[np.float32]:
    """Fraction of the blurred light at each pixel of `window` that an image of `shape` (y, x) gives; 1 far inside."""
    reach = blur.shape[0] // 2
    sums = np.zeros((blur.shape[0] + 1, blur.shape[1] + 1))
    sums[1:, 1:] = blur[::-1, ::-1].cumsum(axis=0).cumsum(axis=1)  # light comes from where the kernel doesn't point
    (top, bottom, rows), (left, right, columns) = (
        _kernel_limits(np.arange(size)[part], size, reach) for size, part in zip(shape, window, strict=True)
    )
    inside = sums[bottom][:, right] - sums[top][:, right] - sums[bottom][:, left] + sums[top][:, left]
    return np.asarray(inside.astype(np.float32)[rows][:, columns])


def _kernel_limits(index: NDArray[np.int64], size: int, reach: int) -> tuple[NDArray[np.int64], ...]:
    """The different parts of a kernel inside an axis: where they begin, end, and which one each pixel `index` has."""
    limits = [np.clip(edge - index, 0, 2 * reach + 1) for edge in (reach, reach + size)]
    (begin, end), chosen = np.unique(limits, axis=1, return_inverse=True)
    return begin, end, chosen.ravel()


class FftConvolver:
    """Convolves one picture (channel, y, x) with many kernels; its spectrum is computed once.

    The picture is padded with zeros by `reach`, the largest radius of a kernel, so that nothing wraps around.
    """

    def __init__(self, picture: NDArray[np.float32], reach: int) -> None:
        from scipy import fft  # slow start: a picture needs it, and most programs that can open one don't

        self._picture = picture
        self._reach = reach
        self._size = [fft.next_fast_len(max(n, reach + 1) + reach, real=True) for n in picture.shape[1:]]
        self._spectrum = fft.rfft2(picture, s=self._size) if reach > 0 else None

    def convolve(self, blur: NDArray[np.float64]) -> NDArray[np.float32]:
        """The picture convolved with `blur`, of the same shape. Raises ValueError for a kernel wider than `reach`."""
        from scipy import fft

        reach = blur.shape[0] // 2
        if reach == 0:
            return self._picture.copy()
        if reach > self._reach:
            raise ValueError(f"kernel reaches {reach} px: expected at most {self._reach}")
        centred = np.zeros(self._size, dtype=np.float32)
        centred[: blur.shape[0], : blur.shape[1]] = blur
        spectrum = self._spectrum * fft.rfft2(np.roll(centred, (-reach, -reach), axis=(0, 1)))
        full = fft.irfft2(spectrum, s=self._size, overwrite_x=True)
        return np.asarray(full[:, : self._picture.shape[1], : self._picture.shape[2]], dtype=np.float32)


def _pixel_overlap(half_widths: NDArray[np.float64], reach: int, centre: float) -> NDArray[np.float64]:
    """Length of [c − h, c + h] inside each pixel [k − ½, k + ½], k = −reach … reach; shape (len(h), 2·reach + 1)."""
    k = np.arange(-reach, reach + 1)
    h = half_widths[:, None]
    length: NDArray[np.float64] = np.maximum(np.minimum(k + 0.5, centre + h) - np.maximum(k - 0.5, centre - h), 0)
    return length


# --- layers of a scene ------------------------------------------------------------------------------------------------


MAX_LAYERS = 24
_LAYER_STEP_PX = (
    1.0  # change of blur radius, or of shift, from layer to layer: finer layers only add errors at their seams
)
_LEAST_SHARE = np.float32(1e-3)  # less occurs only in the margin of a cone off the axis, which is cut off

Window = tuple[slice, slice]
Pixels = tuple[NDArray[np.int64], ...]


def checked_depth(
    rgb: NDArray[np.float32],
    depth_m: float | NDArray[np.floating],
    planes_m: Sequence[float] | NDArray[np.floating],
    pitch_m: float,
) -> NDArray[np.float64]:
    """The depth of each pixel (y, x). Raises ValueError for arguments that `render_focal_stack` refuses."""
    if rgb.ndim != 3 or rgb.shape[-1] != 3 or rgb.size == 0:
        raise ValueError(f"picture {rgb.shape}: expected (y, x, 3)")
    depth = np.asarray(depth_m, dtype=np.float64)
    if depth.shape not in ((), rgb.shape[:2]):
        raise ValueError(f"depth {depth.shape}: expected one number or {rgb.shape[:2]} as the picture")
    planes = np.asarray(planes_m, dtype=np.float64)
    if planes.ndim != 1 or planes.size == 0 or not (np.isfinite(planes).all() and np.isfinite(depth).all()):
        raise ValueError("planes and depths: expected finite distances in metres, at least one plane")
    if not pitch_m > 0:
        raise ValueError(f"pitch {pitch_m} m: expected > 0")
    return np.broadcast_to(depth, rgb.shape[:2])


def layer_count(depth: NDArray[np.float64], cone: LightCone, pitch_m: float) -> int:
    """Layers that keep blur radius and shift of each depth (y, x) within half a sample of its layer's, at most 24."""
    range_m = float(np.ptp(depth))
    range_px = max(cone.radius_px(range_m, pitch_m), *map(abs, cone.shift_px(range_m, pitch_m)))
    return min(max(math.ceil(range_px / _LAYER_STEP_PX), 1), MAX_LAYERS)


def split_layers(depth: NDArray[np.float64], count: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The layer of each pixel (y, x), 0 nearest (largest z), and each layer's mean depth; empty ones are left out."""
    nearest, depth_range = float(depth.max()), float(np.ptp(depth))
    if depth_range == 0:
        return np.zeros(depth.shape, dtype=np.int64), np.array([nearest])
    bins = np.minimum(((nearest - depth) * (count / depth_range)).astype(np.int64), count - 1)
    used, labels = np.unique(bins, return_inverse=True)
    labels = labels.reshape(depth.shape)
    sums = np.bincount(labels.ravel(), weights=depth.ravel(), minlength=len(used))
    return labels, sums / np.bincount(labels.ravel(), minlength=len(used))


class LayerBlur:
    """The light and coverage of a layer of a picture, to be blurred by any kernels, in several threads at a time.

    rgb: (y, x, 3). labels: (y, x) the layer of each pixel. reach: the largest radius of all layers' kernels.
    window: where the blurred layer lies (y, x).
    """

    def __init__(self, rgb: NDArray[np.float32], labels: NDArray[np.int64], layer: int, reach: int) -> None:
        self.window = _bounding_window(labels == layer, 2 * reach + 2)
        content = _inpaint_occluded(rgb[self.window], labels[self.window], layer, 2 * reach + 1)
        self._picture, self._shape = FftConvolver(content, reach), (labels.shape[0], labels.shape[1])

    def put_over(self, light: NDArray[np.float32], kernel: NDArray[np.float64], window: Window) -> None:
        """Covers light (4, y, x) in `window`, which holds that of this layer, with the layer blurred by a kernel."""
        share = kernel_share_in_frame(kernel, self._shape, self.window)
        blurred = self._picture.convolve(kernel)
        over = np.divide(blurred, np.maximum(share, _LEAST_SHARE), out=blurred)
        inner = (slice(a.start - b.start, a.stop - b.start) for a, b in zip(self.window, window, strict=True))
        part = light[:, *inner]
        uncovered = np.clip(over[-1], 0, 1)
        part *= np.subtract(1, uncovered, out=uncovered)
        part += over


def _bounding_window(mask: NDArray[np.bool_], margin: int) -> Window:
    """The bounding box of the mask, widened by `margin` but not beyond the image."""
    spans = []
    for axis, size in enumerate(mask.shape):
        occupied = np.flatnonzero(mask.any(axis=1 - axis))
        spans.append(slice(max(int(occupied[0]) - margin, 0), min(int(occupied[-1]) + 1 + margin, size)))
    return spans[0], spans[1]


def _inpaint_occluded(
    rgb: NDArray[np.float32], labels: NDArray[np.int64], layer: int, reach: int
) -> NDArray[np.float32]:
    """The layer's light and mask (4, y, x), continued by up to `reach` pixels beneath the nearer layers.

    An occluded pixel takes the colour of the nearest visible pixel of this or a farther layer, and belongs to the
    layer of that pixel. Visible pixels next to a much nearer layer aren't used as sources, because antialiasing has
    mixed the nearer colour into them.
    """
    from scipy import ndimage  # slow start: a picture needs it, and most programs that can open one don't

    visible, nearer = labels == layer, labels < layer
    content = np.zeros((4, *labels.shape), dtype=np.float32)
    _copy_pixels(content, np.nonzero(visible), rgb, np.nonzero(visible))
    if nearer.any():
        mixed = ndimage.binary_dilation(labels < layer - 1, np.ones((3, 3), dtype=bool))
        usable = ~(nearer | mixed) if (visible & ~mixed).any() else ~nearer
        nearest = ndimage.distance_transform_edt(~usable, return_distances=False, return_indices=True)
        places, sources = np.stack(np.nonzero(nearer)), nearest[:, nearer]
        continued = (labels[tuple(sources)] == layer) & (((sources - places) ** 2).sum(axis=0) <= reach**2)
        _copy_pixels(content, tuple(places[:, continued]), rgb, tuple(sources[:, continued]))
    return content


def _copy_pixels(content: NDArray[np.float32], places: Pixels, rgb: NDArray[np.float32], sources: Pixels) -> None:
    """Gives pixels of `content` (4, y, x) the light of pixels of `rgb` (y, x, 3), and the mask 1."""
    for channel in range(3):
        content[channel][places] = rgb[..., channel][sources]
    content[3][places] = 1
