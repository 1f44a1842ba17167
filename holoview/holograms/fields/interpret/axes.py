"""Which axes of an array are frames, colours, y and x."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from holoview.holograms.files.readers.contents import StoredArray
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError

_MOST_COLOURS = 4


@dataclass(frozen=True)
class Axes:
    """The number of each axis in the file's array; None for axes that it doesn't have. reason: why, in words.

    Axes that are none of these have the size 1.
    """

    y: int
    x: int
    colour: int | None = None
    frame: int | None = None
    reason: str = ""

    def sizes(self, shape: Sequence[int]) -> tuple[int, int, int, int]:
        """Numbers of frames, colours, rows and columns of an array of that shape."""
        frames = 1 if self.frame is None else shape[self.frame]
        colours = 1 if self.colour is None else shape[self.colour]
        return frames, colours, shape[self.y], shape[self.x]


def arrange(array: StoredArray, request: ReadRequest, wavelengths: int, where: str) -> Axes:
    """The meaning of each axis of an array, as its format says or by the sizes.

    Of three long axes, those of the picture are the last two, unless the last axis is as short as a number of colours.
    wavelengths: how many are known, 0 if unknown; an axis of that size is that of the colours.
    Raises UserError unless there are two to four axes beside those of size 1.
    """
    shape = array.shape
    if array.axes:
        places = {letter: axis for axis, letter in enumerate(array.axes)}
        axes = Axes(places["y"], places["x"], places.get("c"), places.get("f"))
        return replace(axes, y=axes.x, x=axes.y) if request.transposed else axes
    long = [axis for axis, size in enumerate(shape) if size > 1]
    if len(long) < 2:  # a picture of one row or column
        long = sorted(sorted(range(len(shape)), key=lambda axis: (shape[axis], axis))[-2:])
    if not 2 <= len(long) <= 4:
        raise UserError(where, f"an array of shape {tuple(shape)}", expected="(y, x), with frames and colours at most")
    axes = _arrange_long(shape, long, request, wavelengths)
    return replace(axes, y=axes.x, x=axes.y) if request.transposed else axes


def _arrange_long(shape: Sequence[int], long: list[int], request: ReadRequest, wavelengths: int) -> Axes:
    if len(long) == 2:
        return Axes(long[0], long[1])
    colour, reason = _colour_axis(shape, long, request, wavelengths)
    rest = [axis for axis in long if axis != colour]
    if len(rest) == 4:
        raise UserError(
            "axes", f"an array of shape {tuple(shape)}", expected="colours among them", remedy="state the wavelengths"
        )
    frame = rest[0] if len(rest) == 3 else None
    return Axes(rest[-2], rest[-1], colour, frame, reason)


def _colour_axis(
    shape: Sequence[int], long: list[int], request: ReadRequest, wavelengths: int
) -> tuple[int | None, str]:
    """The axis of the colours, None if all are frames; and why."""
    choices = [long[-1], long[0]] if len(long) == 3 else [long[1], long[-1], long[0]]
    if request.colour_axis is not None:
        return (long[0] if request.colour_axis == "first" else long[-1]), "the colour axis is given"
    if wavelengths > 1:
        for axis in choices:
            if shape[axis] == wavelengths:
                return axis, f"axis {axis} has the size {wavelengths}, as many as there are wavelengths"
    colours_last = shape[long[-1]] <= _MOST_COLOURS < min(shape[long[0]], shape[long[-2]])
    if wavelengths == 1 and len(long) == 3 and not colours_last:
        return None, f"one wavelength, so that the {shape[long[0]]} pictures are frames"
    for axis in choices:
        if shape[axis] <= _MOST_COLOURS and shape[axis] == min(shape[a] for a in long):
            return axis, f"axis {axis} has the size {shape[axis]}, as for colours"
    return None, f"{shape[long[0]]} is too many for colours: frames"
