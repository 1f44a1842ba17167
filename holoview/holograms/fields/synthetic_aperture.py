"""A hologram seen through a part of itself: the synthetic apertures and viewpoints of JPEG Pleno's test conditions.

A synthetic aperture is a rectangle of the hologram, the eye's or a camera's pupil; light from the rest is left out. Its
place is the viewpoint, its size the depth of field. It is given in samples, or in degrees as seen from the image at a
distance z: a size of α degrees is 2·|z|·tan(α/2), a place of β degrees z·tan β beside the axis (ISO/IEC 21794-5;
reconstruction after Appl. Opt. 62, 2462 (2023)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from holoview.holograms.fields.propagation import Method, PropagatedField, choose_method, propagate_field
from holoview.holograms.fields.wavefield import Wavefield, samples_of_degrees
from holoview.holograms.files.request import Viewpoint
from holoview.light.optics.free_space import SampleWindow
from holoview.util.errors import UserError

Pair = tuple[float, float]


@dataclass(frozen=True)
class SyntheticAperture:
    """A rectangle of a hologram's samples.

    first: its first row and column. shape: its rows and columns.
    """

    first: tuple[int, int]
    shape: tuple[int, int]

    @staticmethod
    def from_samples(field: Wavefield, shape: tuple[int, int], centre: Pair = (0.0, 0.0)) -> SyntheticAperture:
        """An aperture of so many rows and columns, its centre (y, x) in samples from that of the hologram.

        Raises UserError for one that isn't inside the hologram.
        """
        first = [round((n - size) / 2 + place) for n, size, place in zip(field.shape, shape, centre, strict=True)]
        inside = all(f >= 0 and s >= 1 and f + s <= n for f, s, n in zip(first, shape, field.shape, strict=True))
        if not inside:
            found = f"{shape[1]} × {shape[0]} samples at {centre[1]:g}, {centre[0]:g}"
            raise UserError("aperture", found, expected=f"a part of the {field.shape[1]} × {field.shape[0]} samples")
        return SyntheticAperture((first[0], first[1]), shape)

    @staticmethod
    def from_degrees(
        field: Wavefield, distance_m: float, size_deg: Pair, centre_deg: Pair = (0.0, 0.0)
    ) -> SyntheticAperture:
        """An aperture (y, x) in degrees as seen from the middle of the image at a distance.

        Raises UserError for angles beyond 90 degrees and for an aperture that isn't inside the hologram.
        """
        shape, centre = samples_of_degrees(distance_m, field.pitch_m, size_deg, centre_deg)
        return SyntheticAperture.from_samples(field, shape, centre)

    def centre_m(self, field: Wavefield) -> Pair:
        """Its centre (y, x) from that of the hologram."""
        y, x = (
            (first + (size - n) / 2) * pitch
            for first, size, n, pitch in zip(self.first, self.shape, field.shape, field.pitch_m, strict=True)
        )
        return y, x

    def cut(self, field: Wavefield) -> Wavefield:
        """The samples inside."""
        rows, columns = (slice(f, f + n) for f, n in zip(self.first, self.shape, strict=True))
        return replace(field, values=field.values[..., rows, columns])

    def alone(self, field: Wavefield) -> Wavefield:
        """The field, dark outside."""
        values = np.zeros_like(field.values)
        rows, columns = (slice(f, f + n) for f, n in zip(self.first, self.shape, strict=True))
        values[..., rows, columns] = field.values[..., rows, columns]
        return replace(field, values=values)


def viewpoints(field: Wavefield, shape: tuple[int, int], count: tuple[int, int]) -> list[SyntheticAperture]:
    """Apertures of a shape at count (y, x) places, evenly from edge to edge of a hologram, rows first.

    Raises UserError for apertures that are larger than the hologram and for no viewpoint.
    """
    if min(count) < 1:
        raise UserError("viewpoints", f"{count[1]} × {count[0]}", expected="one or more along each axis")
    places = [
        np.linspace(-(n - size) / 2, (n - size) / 2, k) if k > 1 else np.zeros(1)
        for n, size, k in zip(field.shape, shape, count, strict=True)
    ]
    return [SyntheticAperture.from_samples(field, shape, (float(y), float(x))) for y in places[0] for x in places[1]]


def seen_from(field: Wavefield, viewpoint: Viewpoint) -> Wavefield:
    """The field with the samples outside a viewpoint's aperture dark, so that its image stays where it is.

    Raises UserError for an aperture that is larger than the field, and for degrees without a distance.
    """
    return aperture_of(field, viewpoint, field.distance_m).alone(field)


def aperture_of(field: Wavefield, viewpoint: Viewpoint, distance_m: float) -> SyntheticAperture:
    """The aperture of a viewpoint, whose degrees are those seen from an image at a distance.

    Raises UserError as `seen_from` does.
    """
    shape = (round(viewpoint.size),) * 2
    if viewpoint.in_degrees:
        shape = samples_of_degrees(distance_m, field.pitch_m, (viewpoint.size,) * 2, (0.0, 0.0))[0]
    x, y = viewpoint.place
    places = [place * (n - size) / 2 for place, n, size in zip((y, x), field.shape, shape, strict=True)]
    return SyntheticAperture.from_samples(field, (shape[0], shape[1]), (places[0], places[1]))


def seen_through(
    field: Wavefield,
    aperture: SyntheticAperture,
    distance_m: float,
    method: Method = "auto",
    window: SampleWindow | None = None,
) -> PropagatedField:
    """The image at a distance of the light that passes an aperture, in the window in which the whole is seen.

    window: relative to the centre of the whole hologram; as of `choose_method` where it is None. Only the samples in
    the aperture are computed.

    A field with a spherical reference, whose centre is that of the hologram, keeps its samples outside, dark.

    Raises UserError as `choose_method` does.
    """
    choice = choose_method(field, distance_m, method, window)
    if choice.method == "fourier":
        return propagate_field(aperture.alone(field), distance_m, choice.method, choice.window)
    beside = aperture.centre_m(field)
    y, x = (c - b for c, b in zip(choice.window.centre_m, beside, strict=True))
    shifted = replace(choice.window, centre_m=(y, x))
    seen = propagate_field(aperture.cut(field), distance_m, choice.method, shifted)
    return PropagatedField(seen.values, choice)


def published_picture(
    amplitude: NDArray[np.floating],
    shape: tuple[int, int] | None = None,
    percentiles: Sequence[float] = (0.0, 100.0),
    *,
    like: NDArray[np.floating] | None = None,
) -> NDArray[np.uint8]:
    """An amplitude (y, x) or (y, x, colour) as an 8-bit picture: resized, clipped at two percentiles, then 0 … 255.

    shape: rows and columns, by cubic convolution with a = −1/2 (Keys, IEEE Trans. Acoust. Speech Signal Process. 29,
    1153 (1981)), widened where the picture becomes smaller. percentiles: of all colours together; the lower one becomes
    0 and the upper one 255. like: the amplitude, of the same shape, whose percentiles are taken; its own if None.

    Raises UserError for percentiles that aren't rising from 0 to 100.
    """
    low, high = percentiles
    if not 0 <= low < high <= 100:
        raise UserError("percentiles", f"{low:g}, {high:g}", expected="two rising ones between 0 and 100")
    values = _resized(amplitude, shape)
    black, white = np.percentile(values if like is None else _resized(like, shape), (low, high))
    span = float(white - black) or 1.0
    return np.rint(np.clip((values - black) / span, 0, 1) * 255).astype(np.uint8)


def _resized(amplitude: NDArray[np.floating], shape: tuple[int, int] | None) -> NDArray[np.float32]:
    """An amplitude (y, x) or (y, x, colour) with the rows and columns of a shape."""
    values = np.asarray(amplitude, np.float32)
    if shape is None or values.shape[:2] == shape:
        return values
    channels = values[..., None] if values.ndim == 2 else values
    resized = [
        np.asarray(Image.fromarray(channels[..., i]).resize((shape[1], shape[0]), Image.Resampling.BICUBIC))
        for i in range(channels.shape[-1])
    ]
    return resized[0] if values.ndim == 2 else np.stack(resized, axis=-1)
