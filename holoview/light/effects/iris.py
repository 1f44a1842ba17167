"""Stops of the relays, round or square, of another size than nominal or off their centres; a stop of the zero order."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import ClassVar

from holoview.light.model.bench_parts import Relay
from holoview.light.model.effects.effect import Effect, Needs, Parameter, Values, square_grid
from holoview.light.model.elements import Space
from holoview.light.model.stops import SquareStop
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.units import format_rounded

PARAMETERS = (
    Parameter(
        "radius_error",
        "Relative error of the radius, or of the side of a square stop.",
        low=-0.9,
        high=4.0,
        prior=0.1,
        scan=(-0.5, 0.5, 0.1),
        non_smooth=True,
    ),
    Parameter(
        "decentre_y", "Shift in y, in nominal radii or half sides.", low=-2.0, high=2.0, prior=0.1, non_smooth=True
    ),
    Parameter(
        "decentre_x", "Shift in x, in nominal radii or half sides.", low=-2.0, high=2.0, prior=0.1, non_smooth=True
    ),
)

_NARROWER = (-0.4, -0.2)
"""Errors of the radius at which a search also moves the stop. Where a narrow stop off its centre takes the zero order
away, neither its radius nor its shift alone makes the prediction any better."""


class Iris(Effect):
    """Aperture na → na·(1 + radius_error), with its centre moved by the direction sines na·(decentre_y, decentre_x).

    na is the radius of an iris or half the side of a square stop, the smaller where there are both; of a stop at the
    first order of every wavelength that at 550 nm.
    """

    relay: ClassVar[str]
    parameters = PARAMETERS
    element_kinds = ("space",)
    element_id = "iris"

    def starting_points(self, system: System) -> Iterable[dict[str, float]]:
        moved = square_grid("decentre_y", "decentre_x", 0.4, 0.2)
        narrower = [{**point, "radius_error": error} for error in _NARROWER for point in moved]
        return [*super().starting_points(system), *moved, *narrower]

    def actual_system(self, system: System, v: Values) -> System:
        relay: Relay = getattr(system, self.relay)
        moved = _moved(relay, _narrower_stop(relay, system.modulators[0].pitch_m)[1], v)
        return system.edit({self.relay: moved})

    def actual_element(self, system: System, element: str, v: Values) -> System:
        relay, order_m = relay_of_space(system, element)
        if not relay.has_aperture:
            raise UserError(element, "has neither an iris nor a square stop", expected="a space with one")
        return _with_stops(system, element, _moved(relay, _narrower_stop(relay, order_m)[1], v))

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        square, na = _narrower_stop(getattr(system, self.relay), system.modulators[0].pitch_m)
        decentre = (v["decentre_y"], v["decentre_x"])
        sizes = [f"{size:.4g}" for size in (na * (1 + v["radius_error"]), na)]
        y, x = (format_rounded(na * shift, "mrad", 3) for shift in decentre)
        faults = ["has {} of {}, not {}".format(_measure(square), *sizes)] * (sizes[0] != sizes[1])
        faults += [f"is off its centre by {y} (y) and {x} (x)"] * any(decentre)
        return {"stop": "iris" if square is None else "square stop", "faults": " and ".join(faults)}


def _moved(relay: Relay, na: float, v: Values) -> Relay:
    """A relay whose stops, of the nominal aperture na, have another size and place."""
    factor = 1 + v["radius_error"]
    shift = na * v["decentre_y"], na * v["decentre_x"]
    y, x = (max(-1.0, min(c + s, 1.0)) for c, s in zip(relay.centre_na, shift, strict=True))
    iris_na = None if relay.iris_na is None else min(relay.iris_na * factor, 1.0)
    square = None if relay.square is None else relay.square.scaled(factor)
    return dataclasses.replace(relay, iris_na=iris_na, square=square, centre_na=(y, x))


def _narrower_stop(relay: Relay, order_m: float) -> tuple[SquareStop | None, float]:
    """The square stop, or None where there is none or a narrower iris, and the nominal aperture `na`."""
    iris = 1.0 if relay.iris_na is None else relay.iris_na
    half_side = 1.0 if relay.square is None else relay.square.nominal_na(order_m)
    return (relay.square, half_side) if half_side < iris else (None, iris)


def relay_of_space(system: System, element: str) -> tuple[Relay, float]:
    """The stops of a space, and the pitch whose first order they name, m."""
    way = system.way
    number = next(i for i, names in enumerate(way.relay_names) if element in names)
    return way.relays[number], way.orders_m[number]


def _with_stops(system: System, element: str, relay: Relay) -> System:
    """The system with other stops in a space."""
    index, elements = system.part(element), list(system.elements)
    space = elements[index]
    assert isinstance(space, Space)
    elements[index] = Space.over(space.distance_m, relay, space.name)
    return system.edit({"elements": tuple(elements)})


def _measure(square: SquareStop | None) -> str:
    """The quantity of a stop that `na` states, in words."""
    if square is None:
        return "an aperture"
    return "half a side, at 550 nm," if _is_ideal(square) else "half a side"


def _is_ideal(square: SquareStop | None) -> bool:
    """Whether it is a stop at the first order of every wavelength, which no real aperture is."""
    return square is not None and square.half_side_na is None and square.wavelength_m is None


class Iris1(Iris):
    """The iris or square stop in the Fourier plane of relay 1."""

    id = "iris1"
    cause = "The iris or square stop between the modulators is wider, narrower or off its centre."
    finding = "The {stop} of relay 1 {faults}."
    relay = "relay1"
    acts_on = ("relay 1",)
    needs = Needs(modulators=2, irises=(1,), fourier=False)


class Iris2(Iris):
    """The iris or square stop in the Fourier plane of relay 2."""

    id = "iris2"
    cause = "The iris or square stop behind the last modulator is wider, narrower or off its centre."
    finding = "The {stop} of relay 2 {faults}."
    relay = "relay2"
    acts_on = ("relay 2",)
    needs = Needs(irises=(2,), fourier=False)


class DcBlock(Effect):
    """A round stop at the zero order in the Fourier plane of relay 2; `radius` is the direction sine at its edge.

    The stop covers at most 99 % of the way to the farthest point of the relay's iris or square stop. A square stop at
    the first order of every wavelength sets no such limit: a wavelength whose light is all covered is dark.
    """

    id = "dc_block"
    cause = "A stop at the zero order (or dust there) takes low frequencies away."
    finding = "A stop of {radius} radius blocks the zero order."
    parameters = (
        Parameter(
            "radius",
            "Direction sine at the stop's edge.",
            "mrad",
            low=0.0,
            high=50e-3,
            prior=1e-3,
            scan=(0.5e-3, 5.5e-3, 0.5e-3),
            non_smooth=True,
        ),
    )
    acts_on = ("relay 2",)
    element_kinds = ("space",)

    def actual_system(self, system: System, v: Values) -> System:
        blocked = _blocked(system.relay2, float(system.wavelengths_m[0]), system.modulators[0].pitch_m, v)
        return dataclasses.replace(system, relay2=blocked)

    def actual_element(self, system: System, element: str, v: Values) -> System:
        relay, order_m = relay_of_space(system, element)
        return _with_stops(system, element, _blocked(relay, float(system.wavelengths_m[0]), order_m, v))


def _blocked(relay: Relay, wavelength_m: float, order_m: float, v: Values) -> Relay:
    """A relay with a stop at its zero order."""
    radius = max(v["radius"], relay.dc_block_na or 0.0)
    if not _is_ideal(relay.square) or relay.iris_na is not None:
        real = dataclasses.replace(relay, square=None) if _is_ideal(relay.square) else relay
        radius = min(radius, 0.99 * real.steepest_sine(wavelength_m, order_m))  # real stops pass the same of all
    if radius < 1e-5:  # the least that a System accepts
        return relay
    return dataclasses.replace(relay, dc_block_na=radius)
