"""A bench as a chain of elements: which orders are possible, and the way of the light that follows.

The short form of a bench, one or two equal phase modulators with a gap and two relays, is a chain, too:

    phase ─▶ space (gap, relay 1) ─▶ phase ─▶ space (relay 2, to the planes)

and a chain of this form is such a bench, computed in the same way to the last bit. `Way` is what light does on either,
as a list of steps, which `engine.frame` follows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.bench_parts import Modulator, Relay, Sampling
from holoview.light.model.elements import (
    Element,
    FieldPlane,
    Fourier,
    Lens,
    Mask,
    Pixels,
    Space,
    element_names,
    element_of,
    modulator_of,
)
from holoview.light.model.masks import mask_values
from holoview.util import units
from holoview.util.errors import UserError

ONLY_SHORT_FORM = "one or two phase modulators of equal pitch and shape"
_REMEDY = (
    "of a chain there are `holoview info`, `render`, `contrast`, `report`, `point`, `optimise`, `sweep`, `captures`, "
    "`diagnose`, `calibrate`, `rig`, `measure`, `bench`, pages, the window; all else takes the field of its hologram, "
    "which `holoview export --field` writes"
)
_WHOLE = 1e-6  # of a sample: what is a whole multiple of it
_MOST_UPSAMPLE = 16
_MOST_ELEMENTS = 64


class NoModulators(tuple[Modulator, ...]):
    """The modulators of a chain that isn't of the short form: none; asking for one raises UserError that says so."""

    def __getitem__(self, index: Any) -> NoReturn:
        raise needs_short_form()


def needs_short_form(what: str = "") -> UserError:
    """The error of something, in words, that knows only benches of the short form."""
    found = f"{what}, of a chain of elements" if what else "a chain of elements, which isn't known here yet"
    return UserError("elements", found, expected=ONLY_SHORT_FORM, remedy=_REMEDY)


# --- the short form ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ShortForm:
    """A chain as one or two modulators, and its relays."""

    modulators: tuple[Modulator, ...]
    gap_m: float | None
    relay1: Relay
    relay2: Relay


@lru_cache(maxsize=256)
def elements_of(short: ShortForm, names: tuple[str, ...] = ()) -> tuple[Element, ...]:
    """The elements of a short form: modulators and the spaces between and behind them, with names if they fit."""
    count = len(short.modulators)
    own = names if len(names) == 2 * count else ("",) * 2 * count
    last = [element_of(short.modulators[-1], own[-2]), Space.over(None, short.relay2, own[-1])]
    if count == 1:
        return tuple(last)
    return (element_of(short.modulators[0], own[0]), Space.over(short.gap_m, short.relay1, own[1]), *last)


def short_form(elements: Sequence[Element], planes_from: str) -> ShortForm | None:
    """The short form of a chain; None if it has none."""
    names = element_names(elements)
    parts = list(elements)
    if not parts or not isinstance(parts[-1], Space):
        parts.append(Space())
    kinds = [isinstance(part, Space) for part in parts]
    if kinds not in ([False, True], [False, True, False, True]) or parts[-1].distance_m is not None:  # type: ignore[attr-defined]
        return None
    modulators = [modulator_of(part) for part in parts[::2]]
    first = modulators[0]
    if first is None or any(m is None or m.pitch_m != first.pitch_m or m.shape != first.shape for m in modulators):
        return None
    spaces = [part for part in parts if isinstance(part, Space)]
    if planes_from not in ("", names[len(parts) - 2]) or (len(spaces) == 2 and spaces[0].distance_m is None):
        return None
    if len(modulators) == 2 and any(m is not None and m.is_field for m in modulators):
        return None
    if any(s.square is not None and s.square.of not in ("", *names[: len(parts) : 2]) for s in spaces):
        return None
    relays = [s.relay if s.square is None else replace(s.relay, square=replace(s.square, of="")) for s in spaces]
    gap_m = spaces[0].distance_m if len(spaces) == 2 else None
    found = tuple(m for m in modulators if m is not None)
    return ShortForm(found, gap_m, relays[0] if len(spaces) == 2 else Relay(), relays[-1])


def focal_lengths_m(
    shape: tuple[int, int], sample_m: float, pitch_m: float, wavelengths_m: NDArray[np.float64]
) -> tuple[float, float]:
    """The shortest focal length that samples hold at all wavelengths, W·dx/λ; the longest of a Fourier plane, W·p/λ.

    shape, sample_m: of the field, its samples (y, x) and their pitch. pitch_m: of the pixels, whose first order the
    Fourier plane holds.
    """
    least_m = max(shape) * sample_m**2 / float(wavelengths_m.min())
    return least_m, min(shape) * sample_m * max(pitch_m, sample_m) / float(wavelengths_m.max())


# --- the way of the light ---------------------------------------------------------------------------------------------


def way_words(names: Sequence[str]) -> str:
    """Words for a relay by the names of the elements that it is."""
    return " and ".join(names) or "the way to the planes"


@dataclass(frozen=True)
class Modulate:
    """The light is multiplied by the transmission of a number; landmark: the name of its place, "" for none."""

    number: int
    landmark: str = ""


@dataclass(frozen=True)
class Travel:
    """The light goes through a relay to the next element. landmark: where it arrives, "" for none."""

    relay: int
    landmark: str = ""


@dataclass(frozen=True)
class Transmission:
    """What a chain multiplies light by: an element, or of a Fourier element the chirp before or behind its kernel.

    beside: further elements in its place, to whose transmissions its own adds: the mean of all of them counts.
    """

    element: Element
    place: str = ""
    beside: tuple[Element, ...] = ()


@dataclass(frozen=True, eq=False)
class Way:
    """What light does from the source to the spectrum behind the last element.

    steps: in order. relays, distances_m, orders_m: of the relays that `Travel` names: their stops, how far, and the
    pitch whose first order their stops name. last: the relay to the planes.
    transmissions: of a chain, what `Modulate` names; empty for the short form, whose modulators it names.
    kernels: Fourier elements by the relays that are their kernels.
    finest_m: the pitch of the finest pixels, whose first order is the eyebox.
    relay_names: of each relay the names of the spaces or the Fourier element that it is; of a short form its place.
    sample_m, shape: of the field: its pitch, and its samples (y, x). behind_m: from where planes are measured to the
    last element.
    """

    steps: tuple[Modulate | Travel, ...]
    relays: tuple[Relay, ...]
    distances_m: tuple[float, ...]
    orders_m: tuple[float, ...]
    last: int
    finest_m: float
    sample_m: float
    shape: tuple[int, int]
    upsample: int
    transmissions: tuple[Transmission, ...] = ()
    kernels: tuple[tuple[int, Fourier], ...] = ()
    behind_m: float = 0.0
    relay_names: tuple[tuple[str, ...], ...] = (("relay 1",), ("relay 2",))

    @property
    def is_chain(self) -> bool:
        """Whether it is that of a chain without a short form."""
        return bool(self.transmissions)

    @property
    def places(self) -> tuple[tuple[int, ...], ...]:
        """The numbers of what multiplies light at each place where elements stand; a relay leads on from each."""
        found: list[list[int]] = [[]]
        for step in self.steps:
            if isinstance(step, Modulate):
                found[-1].append(step.number)
            else:
                found.append([])
        return tuple(map(tuple, found))

    def relay_words(self, relay: int) -> str:
        """Words for a relay: the elements that it is, by their names; its place in a short form."""
        return way_words(self.relay_names[relay])

    def kernel(self, relay: int) -> Fourier | None:
        """The Fourier element whose kernel a relay is; None for free space."""
        return dict(self.kernels).get(relay)


def short_way(short: ShortForm, sampling: Sampling) -> Way:
    """The way of the light through one or two modulators."""
    first, u = short.modulators[0], sampling.upsample
    steps: tuple[Modulate | Travel, ...] = (Modulate(0, "slm1"),)
    if len(short.modulators) == 2:
        steps = (*steps, Travel(0, "gap"), Modulate(1, "slm2"))
    return Way(
        steps=steps,
        relays=(short.relay1, short.relay2),
        distances_m=(short.gap_m or 0.0, 0.0),
        orders_m=(first.pitch_m, first.pitch_m),
        last=1,
        finest_m=first.pitch_m,
        sample_m=first.pitch_m / u,
        shape=(first.shape[0] * u, first.shape[1] * u),
        upsample=u,
    )


def chain_way(
    elements: tuple[Element, ...], planes_from: str, sampling: Sampling, wavelengths_m: NDArray[np.float64]
) -> Way:
    """The way of the light through a chain. Raises UserError, with the element, for a chain that can't be."""
    joined = _joined(elements)
    names = element_names(elements)
    _check_order(joined, names, elements)
    sample_m = _sample(joined, elements, names, sampling)
    shape = _window(joined, elements, names, sample_m)
    return _Walk(elements, names, sample_m, shape, wavelengths_m, sampling).way(joined, planes_from)


def _check_order(joined: Sequence[Element], names: tuple[str, ...], elements: tuple[Element, ...]) -> None:
    """Raises UserError for elements that can't stand in this order, and for names given twice."""
    if len(elements) > _MOST_ELEMENTS:
        raise UserError("elements", f"{len(elements)} of them", expected=f"at most {_MOST_ELEMENTS}")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise UserError("elements", f'"{twice[0]}" is the name of several', expected="names that differ")
    if not any(isinstance(e, Pixels) and e.is_driven for e in joined):
        raise UserError("elements", "no modulator", expected="at least one: phase, amplitude or complex")
    if isinstance(joined[0], Space):
        raise UserError("elements[0]", "a space", expected="an element that the light of the source falls on")
    if any(isinstance(e, FieldPlane) for e in joined):
        raise UserError(
            "elements", "a field beside other elements", expected="a field alone, with the space to its planes"
        )
    if isinstance(joined[-1], Space) and joined[-1].distance_m is not None:
        raise UserError(
            f"elements[{len(elements) - 1}].distance",
            f"{units.format_rounded(joined[-1].distance_m, 'mm')} behind the last element",
            expected="none there: the planes tell how far the light goes",
        )
    for index, element in enumerate(joined):
        if isinstance(element, Pixels) and element.beside:
            _check_beside(element, joined[:index], names, elements)
    for element in joined[:-1]:
        if isinstance(element, Space) and element.distance_m is None:
            name = _name(element, elements, names)
            raise UserError(f"elements.{name}.distance", "is missing", expected='e.g. "2 mm"')


def _check_beside(
    element: Pixels, before: Sequence[Element], names: tuple[str, ...], elements: tuple[Element, ...]
) -> None:
    """Raises UserError unless an element stands right behind the one that it is beside, or others beside that."""
    others = [*before]
    while others and isinstance(others[-1], Pixels) and others[-1].beside == element.beside:
        others.pop()
    first = others[-1] if others else None
    if isinstance(first, Pixels) and _name(first, elements, names) == element.beside:
        return
    where = f"elements.{_name(element, elements, names)}.beside"
    near = f'"{_name(first, elements, names)}"' if isinstance(first, Pixels) else "no element with pixels"
    raise UserError(where, f'"{element.beside}"', expected=f"the element right before it, {near}")


def _name(element: Element, elements: Sequence[Element], names: Sequence[str]) -> str:
    """The name of an element among others; of one that was joined its own, or its kind."""
    return next((n for e, n in zip(elements, names, strict=True) if e is element), element.name or element.kind)


def _joined(elements: Sequence[Element]) -> list[Element]:
    """The elements with neighbouring spaces as one. Raises UserError for two whose stops differ."""
    out: list[Element] = []
    for index, element in enumerate(elements):
        before = out[-1] if out else None
        if not (isinstance(element, Space) and isinstance(before, Space)):
            out.append(element)
            continue
        if not (element.relay.is_clear or before.relay.is_clear or element.relay == before.relay):
            raise UserError(
                f"elements[{index}]",
                "a space behind a space with other stops",
                expected="one space",
                remedy="write all stops of the way to the next element in one",
            )
        relay = before.relay if element.relay.is_clear else element.relay
        ends = element.distance_m is None or before.distance_m is None
        if ends:
            raise UserError(
                f"elements[{index}]", "a space behind a space, one without a distance", expected="one space"
            )
        total_m = (element.distance_m or 0.0) + (before.distance_m or 0.0)
        out[-1] = Space.over(total_m, relay, before.name)
    return out


def _sample(joined: Sequence[Element], elements: Sequence[Element], names: Sequence[str], sampling: Sampling) -> float:
    """The pitch of the samples: that of the first modulator divided by `upsample`."""
    pixels = [e for e in joined if isinstance(e, Pixels)]
    first = next(e for e in pixels if e.is_driven)
    sample_m = first.pitch_m / sampling.upsample
    for element in pixels:
        if _is_whole(element.pitch_m / sample_m):
            continue
        name = _name(element, elements, names)
        fitting = [
            u for u in range(1, _MOST_UPSAMPLE + 1) if all(_is_whole(e.pitch_m * u / first.pitch_m) for e in pixels)
        ]
        near = max(1, round(element.pitch_m / sample_m)) * sample_m
        remedy = f"upsample = {fitting[0]} would fit" if fitting else f"{units.format_rounded(near, 'um')} would fit"
        raise UserError(
            f"elements.{name}.pitch",
            units.format_rounded(element.pitch_m, "um"),
            expected=f"a whole multiple of the sample, {units.format_rounded(sample_m, 'um')}",
            remedy=remedy,
        )
    return sample_m


def _is_whole(number: float) -> bool:
    return round(number) >= 1 and abs(number - round(number)) < _WHOLE


def pixel_shape(element: Pixels) -> tuple[int, int]:
    """Rows and columns of an element; a mask without a shape has those of its file."""
    if isinstance(element, Mask) and element.shape is None:
        return mask_values(element).shape
    return element.shape


def _window(
    joined: Sequence[Element], elements: Sequence[Element], names: Sequence[str], sample_m: float
) -> tuple[int, int]:
    """Samples (y, x) of the smallest field around the axis that holds all elements. Raises UserError off samples."""
    pixels = [e for e in joined if isinstance(e, Pixels)]
    widths = []
    for axis in (0, 1):
        reach = {id(e): _extent(e, axis, sample_m) for e in pixels}
        width = max(n + 2 * abs(off) for n, off in reach.values())
        whole = round(width)
        for element in pixels:
            n, off = reach[id(element)]
            start = (whole - n) / 2 + off
            if abs(start - round(start)) < _WHOLE and abs(width - whole) < _WHOLE:
                continue
            name = _name(element, elements, names)
            near_m = (off + 0.5) * sample_m if abs(2 * off - round(2 * off)) < _WHOLE else round(off) * sample_m
            raise UserError(
                f"elements.{name}.offset",
                f"the edges of its {n} samples lie between those of the field's {whole}",
                expected="edges on samples",
                remedy=f"an offset of {units.format_rounded(near_m, 'um')} along {'yx'[axis]} would fit",
            )
        widths.append(whole)
    return widths[0], widths[1]


def _relay_names(elements: Sequence[Element], names: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """The names of the elements that each relay of a chain is; none of the way to planes behind the last element."""
    found, before = list[tuple[str, ...]](), None
    for element, name in zip(elements, names, strict=True):
        if isinstance(element, Space) and isinstance(before, Space):
            found[-1] = (*found[-1], name)
        elif isinstance(element, Space | Fourier):
            found.append((name,))
        before = element
    return tuple(found) if isinstance(before, Space) else (*found, ())


def place_of(index: int, count: int) -> str:
    """The place, "modulator 1" or "relay 2", of an element of a short form of `count` elements."""
    kind, number = ("relay" if index % 2 else "modulator"), index // 2 + 1
    return "relay 2" if (index, count) == (1, 2) else f"{kind} {number}"


def _extent(element: Pixels, axis: int, sample_m: float) -> tuple[int, float]:
    """Samples of an element along an axis, and how many its centre is off the axis."""
    return pixel_shape(element)[axis] * round(element.pitch_m / sample_m), element.offset_m[axis] / sample_m


@dataclass
class _Walk:
    """Makes the way of a chain of checked order."""

    elements: tuple[Element, ...]
    names: tuple[str, ...]
    sample_m: float
    shape: tuple[int, int]
    wavelengths_m: NDArray[np.float64]
    sampling: Sampling

    def way(self, joined: list[Element], planes_from: str) -> Way:
        """The way of the light, after the checks of each element."""
        steps: list[Modulate | Travel] = []
        relays, distances, orders = list[Relay](), list[float](), list[float]()
        transmissions, kernels = list[Transmission](), list[tuple[int, Fourier]]()

        def modulate(element: Element, place: str, landmark: str) -> None:
            steps.append(Modulate(len(transmissions), landmark))
            transmissions.append(Transmission(element, place))

        def relay_over(relay: Relay, distance_m: float, order_m: float) -> int:
            relays.append(relay)
            distances.append(distance_m)
            orders.append(order_m)
            return len(relays) - 1

        pitch_m = finest_m = next(e.pitch_m for e in joined if isinstance(e, Pixels))
        for index, element in enumerate(joined):
            name = _name(element, self.elements, self.names)
            if isinstance(element, Space):
                order_m = self._order(element, joined[:index], pitch_m, name)
                number = relay_over(element.relay, element.distance_m or 0.0, order_m)
                if index < len(joined) - 1:
                    steps.append(Travel(number, f"before {_name(joined[index + 1], self.elements, self.names)}"))
                continue
            self._check(element, name, finest_m)
            if isinstance(element, Fourier):
                modulate(element, "before", "")
                kernels.append((relay_over(Relay(), 0.0, pitch_m), element))
                steps.append(Travel(len(relays) - 1))
                modulate(element, "behind", name)
                continue
            if isinstance(element, Pixels) and element.beside:
                transmissions[-1] = replace(transmissions[-1], beside=(*transmissions[-1].beside, element))
            else:
                modulate(element, "", name)
            if isinstance(element, Pixels):
                pitch_m, finest_m = element.pitch_m, min(finest_m, element.pitch_m if element.is_driven else finest_m)
        if not isinstance(joined[-1], Space):
            relay_over(Relay(), 0.0, pitch_m)
        return Way(
            steps=tuple(steps),
            relays=tuple(relays),
            distances_m=tuple(distances),
            orders_m=tuple(orders),
            last=len(relays) - 1,
            finest_m=min(e.pitch_m for e in joined if isinstance(e, Pixels)),
            sample_m=self.sample_m,
            shape=self.shape,
            upsample=1,
            transmissions=tuple(transmissions),
            kernels=tuple(kernels),
            behind_m=self._behind(joined, planes_from),
            relay_names=_relay_names(self.elements, self.names),
        )

    def _order(self, space: Space, before: Sequence[Element], pitch_m: float, name: str) -> float:
        """The pitch whose first order the stops of a space name."""
        square = space.square
        pixels = [e for e in before if isinstance(e, Pixels)]
        names = [_name(e, self.elements, self.names) for e in pixels]
        if square is None or square.half_side_na is not None:
            return pitch_m
        if square.of:
            if square.of not in names:
                expected = f"an element with pixels before it: {', '.join(names)}"
                raise UserError(f"elements.{name}.square", f'the first order of "{square.of}"', expected=expected)
            return pixels[names.index(square.of)].pitch_m
        if len({e.pitch_m for e in pixels}) > 1:
            raise UserError(
                f"elements.{name}.square",
                "a first order behind elements of different pitch",
                expected="whose it is",
                remedy=f'e.g. square = "first order of {names[0]}"; there are {", ".join(names)}',
            )
        return pitch_m

    def _check(self, element: Element, name: str, pitch_m: float) -> None:
        """Raises UserError for a mask that can't be read, and for a lens that the samples can't hold."""
        try:
            if isinstance(element, Mask) and element.file:
                mask_values(element)
            elif isinstance(element, Lens | Fourier):
                self._check_focal_length(element, pitch_m)
        except UserError as error:
            raise error.inside(f"elements.{name}.") from error

    def _check_focal_length(self, element: Lens | Fourier, pitch_m: float) -> None:
        f_m, sides_m = abs(element.focal_length_m), [n * self.sample_m for n in self.shape]
        if isinstance(element, Lens):
            f_m = min(abs(element.focal_length_at(float(λ))) for λ in self.wavelengths_m)
        least_m, most_m = focal_lengths_m(self.shape, self.sample_m, pitch_m, self.wavelengths_m)
        field = " × ".join(units.format_rounded(side, "mm") for side in sides_m)
        if f_m < least_m * (1 - _WHOLE):
            raise UserError(
                "focal_length",
                f"{units.format_rounded(f_m, 'mm')} for a field of {field}",
                expected=f"at least {units.format_rounded(least_m, 'mm')}, below which the samples make ghosts",
                remedy="choose a longer one, or raise upsample",
            )
        if not isinstance(element, Fourier):
            return
        if self.sampling.propagation != "linear":
            raise UserError("kind", f"fourier with {self.sampling.propagation} propagation", expected='"linear"')
        if f_m > most_m * (1 + _WHOLE):
            raise UserError(
                "focal_length",
                f"{units.format_rounded(f_m, 'mm')}: a plane of {field} can't hold the first order",
                expected=f"at most {units.format_rounded(most_m, 'mm')}, and for the samples at least "
                f"{units.format_rounded(least_m, 'mm')}",
                remedy="choose a shorter one, or raise upsample or shape",
            )

    def _behind(self, joined: list[Element], planes_from: str) -> float:
        """How far the last element lies behind that from which the planes are measured."""
        solid = [i for i, e in enumerate(joined) if not isinstance(e, Space)]
        names = [_name(joined[i], self.elements, self.names) for i in solid]
        if not planes_from or planes_from == names[-1]:
            return 0.0
        if planes_from not in names:
            raise UserError("planes_from", f'"{planes_from}"', expected=f"an element: {', '.join(names)}")
        between = joined[solid[names.index(planes_from)] + 1 : solid[-1] + 1]
        if any(isinstance(e, Fourier) for e in between):
            raise UserError("planes_from", f'"{planes_from}", before a Fourier plane', expected="an element behind it")
        return math.fsum(e.distance_m or 0.0 for e in between if isinstance(e, Space))
