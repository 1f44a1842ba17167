"""The optical bench as data: frozen, checked when it is built, in SI units.

    source ─▶ elements, with spaces between them ─▶ plane z ─▶ |·|² ─▶ observer

Its short form has one or two equal phase modulators:

    source ─▶ modulator 1 ─▶ gap (relay 1) ─▶ modulator 2 ─▶ relay 2 to plane z ─▶ |·|² ─▶ observer

A `System` describes this bench and computes nothing; `holoview.light.model.plan` derives every number of a simulation.
`System.with_` and `System.edit` return a changed copy. Lengths and angles are SI numbers or text such as "3 mm".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.colour import observer_range_m
from holoview.light.model.bench_parts import Modulator, Relay, Sampling, Source
from holoview.light.model.chain import (
    NoModulators,
    ShortForm,
    Way,
    chain_way,
    elements_of,
    needs_short_form,
    pixel_shape,
    place_of,
    short_form,
    short_way,
)
from holoview.light.model.effects.on_element import AT, split_id
from holoview.light.model.effects.registry import EffectPairs, EffectTable, require_possible_effects
from holoview.light.model.elements import Element, ElementsField, Pixels, Space, element_names
from holoview.light.model.eye import Eye
from holoview.light.model.fields import (
    Array,
    Choice,
    Description,
    Nested,
    NestedList,
    Number,
    described_field,
    validate,
    with_changes,
)
from holoview.light.model.shorthand import expand_edit
from holoview.light.observers import parse_observer
from holoview.util import units
from holoview.util.errors import UserError, suggest_matches

Floats = NDArray[np.float64]

EYE_RANGE_M = (390e-9, 830e-9)
"""Wavelengths at which the responses of eyes are known."""
_LONGEST_M = 1.0  # of any gap or plane, so that a 3 that was meant in millimetres is refused instead of taken as 3 m

_FIELD_REACH_M = 2.0  # of a field, whose image may lie before its plane: digital holography and far displays

PLANE_DISTANCES = Array(Number("mm", low=0.0, high=_LONGEST_M), most=4096)
"""Field type of the distances of focal planes, measured from the last modulator."""
FIELD_DISTANCES = Array(Number("mm", low=-_FIELD_REACH_M, high=_FIELD_REACH_M), most=4096)
"""Field type of the distances of focal planes from the plane of a field; negative before it."""


@dataclass(frozen=True)
class ObserverText:
    """Field type of an observer: one line of text, as `holoview.light.observers` reads it."""

    def parse(self, value: Any, where: str) -> str:
        if not isinstance(value, str):
            raise UserError(where, f"{value!r} is not text", expected='text in quotes, such as "age 60, field 4"')
        return parse_observer(value).text

    def to_toml(self, value: str) -> str:
        return value


@dataclass(frozen=True, eq=False)
class System(Description):
    """A display: lasers, elements that light passes, focal planes, observer and sampling. Frozen.

    Elements are given as such, or in the short form as `modulators`, `gap_m`, `relay1` and `relay2`; `elements` has
    them in either case, and of a chain of that form the four others are known, too. In place of modulators it may have
    the plane of a complex field (`Modulator.content`), alone and without padding between its samples: `upsample` is 1.
    Its planes may lie before it.

    wavelengths_m: (wavelength,) vacuum wavelengths of the lasers, m.
    amplitudes: (frame, wavelength) relative power of each laser in each frame, a factor of the intensity. Frames and
    directions of the source are averaged.
    modulators: one or two `Modulator`s of equal shape and pitch, or the plane of a field; none of another chain.
    gap_m: distance from modulator 1 to modulator 2, m; None with one modulator.
    planes_m: (plane,) distances of the focal planes from the last element, m; larger is nearer to the viewer.
    source: illumination of the first modulator, a `Source`.
    relay1, relay2: `Relay` between the modulators, and behind the last one.
    observer: "eye" (2° cone fundamentals), "cie1931", "mono" (a camera with flat response), "age 60, field 4" or what
    else `holoview.light.observers` lists. It determines XYZ.
    eye: an `Eye` behind an eyepiece, whose pupil and focus decide what reaches the retina; None: the light in the focal
    planes themselves, as a camera without a lens would record it.
    sampling: the grid of the simulation, a `Sampling`.
    effects: imperfections that are active and their values, {"gap": {"gap_error": "0.1 mm"}}; ids are those of
    `holoview.light.effects`.
    name, description: of the preset.
    elements: what light passes, in order: `holoview.light.model.elements` has their kinds.
    planes_from: the name of the element from which planes are measured; "": the last that isn't a space.

    Lengths are metres or text such as "2 mm", at most 1 m; planes of a field lie from -2 m to 2 m. Arrays are
    read-only. Two systems are equal, and have equal hashes, when all values are. Raises UserError, with the key, the
    value and a remedy, when a value is out of range or values contradict each other. Usually made by `load` and changed
    by `with_`:

    >>> import holoview as hv
    >>> system = hv.load("holochrome-8").with_(shape=[48, 64], planes=["5 mm", "10 mm"])
    >>> len(system.wavelengths_m), len(system.modulators), system.gap_m
    (8, 2, 0.002)
    >>> hv.System(["532 nm"], [[1.0]], [hv.Modulator("8 um", (48, 64), "800 nm")]).planes_m.tolist()
    [0.01]
    """

    wavelengths_m: Floats = described_field(
        Array(Number("nm", low=100e-9, high=10e-6)), "Vacuum wavelength of each laser."
    )
    amplitudes: Floats = described_field(
        Array(Number(low=0.0, high=1e12), axes=2), "Relative power of each laser in each frame."
    )
    modulators: tuple[Modulator, ...] = described_field(
        NestedList(Modulator), "One or two phase modulators.", default=()
    )
    gap_m: float | None = described_field(
        Number("mm", low=0.0, high=_LONGEST_M, optional=True), "From modulator 1 to 2.", default=None
    )
    planes_m: Floats = described_field(
        FIELD_DISTANCES, "Focal planes, measured from the last modulator.", default=(0.01,)
    )
    source: Source = described_field(Nested(Source), "Illumination.", default_factory=Source)
    relay1: Relay = described_field(Nested(Relay), "Between the modulators.", default_factory=Relay)
    relay2: Relay = described_field(
        Nested(Relay), "From the last modulator to the focal planes.", default_factory=Relay
    )
    observer: str = described_field(
        ObserverText(), 'Who looks: eye, "age 60, field 4", "person 17", cie1931, cie1964, mono.', default="eye"
    )
    eye: Eye | None = described_field(
        Nested(Eye, optional=True), "An eye behind an eyepiece; none when absent.", default=None
    )
    sampling: Sampling = described_field(Nested(Sampling), "Grid of the simulation.", default_factory=Sampling)
    effects: EffectPairs = described_field(
        EffectTable(), "What the bench does beyond the plain model: effects by their id.", default=()
    )
    name: str = described_field(Choice(), "Name of the preset.", default="")
    description: str = described_field(Choice(), "The bench in a sentence.", default="")
    elements: tuple[Element, ...] = described_field(
        ElementsField(), "What light passes, in order, in place of modulators, gap and relays.", default=()
    )
    planes_from: str = described_field(
        Choice(), "The element from which planes are measured; the last but spaces when absent.", default=""
    )

    def __post_init__(self) -> None:
        validate(self)
        self._complete_elements()
        for key, array in (("wavelengths", self.wavelengths_m), ("planes", self.planes_m)):
            if array.ndim != 1 or len(array) == 0:
                raise UserError(key, f"an array of shape {array.shape}", expected="a list of at least one length")
        self._check_amplitudes()
        if not self.is_chain:
            self._check_modulators()
            self._check_field()
        _ = self.way  # which checks the chain
        self._place_effects()
        self.plane_type.parse(self.planes_m, "planes")
        self._check_source()
        self._check_stops()
        self._check_visible()
        require_possible_effects(self)

    def _complete_elements(self) -> None:
        """The elements of a short form, or the short form of elements, if they have one."""
        if self.modulators:
            if len(self.modulators) > 2 or self.planes_from:
                return  # refused by the checks that follow
            short = ShortForm(self.modulators, self.gap_m, self.relay1, self.relay2)
            object.__setattr__(self, "elements", elements_of(short, tuple(e.name for e in self.elements)))
            return
        if not self.elements:
            raise UserError("modulators", "0 of them", expected="one or two, or other elements")
        if self.gap_m is not None or not self.relay1.is_clear or not self.relay2.is_clear:
            raise UserError(
                "elements", "beside a gap or relays", expected="spaces, which have their distances and stops"
            )
        found = short_form(self.elements, self.planes_from)
        object.__setattr__(self, "modulators", NoModulators() if found is None else found.modulators)
        if found is not None:
            for key in ("gap_m", "relay1", "relay2"):
                object.__setattr__(self, key, getattr(found, key))
            names = tuple(e.name for e in self.elements)
            object.__setattr__(self, "elements", elements_of(found, (*names, "")[: 2 * len(found.modulators)]))
            object.__setattr__(self, "planes_from", "")

    def _place_effects(self) -> None:
        """Effects on elements of a short form know these by their place, which their names may change around."""
        if self.is_chain or not any(AT in name for name, _ in self.effects):
            return
        count = len(self.elements)
        places = {name: place_of(index, count) for index, name in enumerate(self.element_names)}
        pairs = {
            f"{own}{AT}{places.get(element, element)}" if element else own: values
            for own, element, values in ((*split_id(name), values) for name, values in self.effects)
        }
        object.__setattr__(self, "effects", tuple(sorted(pairs.items())))

    def part(self, name: str) -> int:
        """The index in `elements` of the one with a name, or at a place of a short form.

        name: such as "mask", or "modulator 2". Raises UserError where there is none.

        >>> import holoview as hv
        >>> hv.load("holochrome-8").part("modulator 2")
        2
        """
        names, count = list(self.element_names), len(self.elements)
        places = [] if self.is_chain else [place_of(index, count) for index in range(count)]
        for known in (names, places):
            if name in known:
                return known.index(name)
        raise UserError("element", f'"{name}"', expected=", ".join(names), remedy=suggest_matches(name, names))

    def _check_amplitudes(self) -> None:
        count = len(self.wavelengths_m)
        if self.amplitudes.ndim != 2 or self.amplitudes.shape[1] != count or len(self.amplitudes) == 0:
            raise UserError(
                "amplitudes",
                f"a table of shape {self.amplitudes.shape}",
                expected=f"(frames, {count}): a row a frame, a column a wavelength",
                remedy='give amplitudes together with wavelengths, or "white"',
            )
        if not np.any(self.amplitudes > 0):
            raise UserError("amplitudes", "all are zero", expected="at least one laser that is on")

    def _check_modulators(self) -> None:
        count = len(self.modulators)
        if count not in (1, 2):
            raise UserError("modulators", f"{count} of them", expected="one or two")
        if count == 1 and self.gap_m is not None:
            raise UserError(
                "gap",
                f"{units.format_rounded(self.gap_m, 'mm')} with one modulator",
                expected="no gap",
                remedy="add a second [[modulators]] table or remove the gap",
            )
        if count == 2 and self.gap_m is None:
            raise UserError(
                "gap", "is missing", expected="the distance between the two modulators", remedy='e.g. gap = "2 mm"'
            )
        if count == 1 and not self.relay1.is_clear:
            raise UserError(
                "relay1",
                "with one modulator",
                expected="no relay 1",
                remedy="it lies between two modulators: use relay2",
            )
        first, last = self.modulators[0], self.modulators[-1]
        if first.pitch_m != last.pitch_m or first.shape != last.shape:
            raise UserError(
                "modulators",
                " and ".join(f"{m.shape} at {units.format_rounded(m.pitch_m, 'um')}" for m in (first, last)),
                expected="two modulators of equal shape and pitch (as imaged onto each other by relay 1)",
            )

    def _check_field(self) -> None:
        is_field = [modulator.is_field for modulator in self.modulators]
        if any(is_field) and len(is_field) > 1:
            raise UserError("modulators", "a field beside a modulator", expected="the plane of a field alone")
        if any(is_field) and self.sampling.upsample != 1:
            raise UserError(
                "sampling.upsample",
                f"{self.sampling.upsample} with a field",
                expected="1: a field is known at points, not by pixels",
            )

    def _check_source(self) -> None:
        tilts = self.source.tilts_rad
        if tilts is not None and len(tilts) != len(self.wavelengths_m):
            raise UserError(
                "source.tilts",
                f"{len(tilts)} rows",
                expected=f"a row for each of {len(self.wavelengths_m)} wavelengths",
            )

    def _check_stops(self) -> None:
        """At the longest wavelength, at which a stop at the first order is widest, light passes each relay."""
        for number, (relay, order_m) in enumerate(zip(self.way.relays, self.way.orders_m, strict=True), 1):
            key = "elements" if self.is_chain else f"relay{number}"
            try:
                relay.check_passes_light(float(self.wavelengths_m.max()), order_m)
            except UserError as error:
                raise error.inside(f"{key}.") from error

    def _check_visible(self) -> None:
        low, high = observer_range_m(self.observer)
        if self.eye is not None or parse_observer(self.observer).kind not in ("mono", "camera"):
            low, high = max(low, EYE_RANGE_M[0]), min(high, EYE_RANGE_M[1])
        for i, wavelength in enumerate(self.wavelengths_m):
            if not low <= wavelength <= high:
                raise UserError(
                    f"wavelengths[{i}]",
                    units.format_rounded(wavelength, "nm"),
                    expected=f"{low * 1e9:.4g} to {high * 1e9:.4g} nm, where the observer's response is known",
                    remedy='choose another wavelength, or observer = "mono" without an eye',
                )

    @property
    def frames(self) -> int:
        """Number of frames that are shown one after another in one image.

        >>> import holoview as hv
        >>> hv.load("holochrome-8").with_(frames=3).frames
        3
        """
        return len(self.amplitudes)

    @property
    def is_field(self) -> bool:
        """Whether it has the plane of a complex field in place of modulators.

        >>> import holoview as hv
        >>> hv.load("holochrome-8").is_field
        False
        """
        return not self.is_chain and self.modulators[0].is_field

    @property
    def is_chain(self) -> bool:
        """Whether its elements have no short form.

        >>> import holoview as hv
        >>> hv.load("holochrome-8").is_chain
        False
        """
        return isinstance(self.modulators, NoModulators)

    def require_short_form(self, what: str) -> None:
        """Raises UserError for a chain that has no short form.

        what: which needs one, in words.

        >>> import holoview as hv
        >>> hv.load("holochrome-8").require_short_form("a page")
        """
        if self.is_chain:
            raise needs_short_form(what)

    @cached_property
    def way(self) -> Way:
        """What light does from the source to the last element (`holoview.light.model.chain`).

        >>> import holoview as hv
        >>> [step.landmark for step in hv.load("holochrome-8").way.steps]
        ['slm1', 'gap', 'slm2']
        """
        if self.is_chain:
            return chain_way(self.elements, self.planes_from, self.sampling, self.wavelengths_m)
        return short_way(ShortForm(self.modulators, self.gap_m, self.relay1, self.relay2), self.sampling)

    @property
    def element_names(self) -> tuple[str, ...]:
        """The names of its elements: their own, or made from their kinds.

        >>> import holoview as hv
        >>> hv.load("holochrome-8").element_names
        ('phase1', 'space1', 'phase2', 'space2')
        """
        return element_names(self.elements)

    @property
    def drive_shapes(self) -> dict[str, tuple[int, int, int]]:
        """Shapes (frame, y, x) of the patterns of the elements that show some, by their names.

        >>> import holoview as hv
        >>> hv.load("holochrome-8").with_(shape=[48, 64]).drive_shapes
        {'phase1': (1, 48, 64), 'phase2': (1, 48, 64)}
        """
        pairs = zip(self.element_names, self.elements, strict=True)
        driven = [(name, e) for name, e in pairs if isinstance(e, Pixels) and e.is_driven]
        return {name: (1 if getattr(e, "shared", False) else self.frames, *pixel_shape(e)) for name, e in driven}

    @property
    def stages(self) -> tuple[str, ...]:
        """Where a frame's light can be looked at, in the order in which it passes.

        "light": the illumination of the first modulator, or of the field. "slm1": behind modulator 1; of a field
        "field". "gap": at modulator 2, before it. "slm2": behind modulator 2. "stop": in the Fourier plane of relay 2,
        behind its stops, by direction. "plane": in the focal plane. With an eye "pupil": in its pupil, by direction,
        with the phase that its focus on the plane leaves; "retina": on the retina. Of a chain, in place of those of
        modulators: the names of its elements, behind which the light is looked at, and "before " with the name.

        >>> import holoview as hv
        >>> hv.load("holochrome-8").stages
        ('light', 'slm1', 'gap', 'slm2', 'stop', 'plane')
        """
        if self.is_field:
            before: tuple[str, ...] = ("light", "field")
        elif self.is_chain:
            before = ("light", *(step.landmark for step in self.way.steps if step.landmark))
        else:
            before = ("light", "slm1") if self.gap_m is None else ("light", "slm1", "gap", "slm2")
        return (*before, "stop", "plane", *(() if self.eye is None else ("pupil", "retina")))

    def stage_behind(self, name: str) -> str:
        """The stage at which the light right behind an element is looked at; behind a space that before the next one.

        name: as `part` takes it. Raises UserError where there is none, and behind the last space, where planes are.

        >>> import holoview as hv
        >>> hv.load("holochrome-8").stage_behind("modulator 2"), hv.load("high-contrast").stage_behind("space")
        ('slm2', 'before coarse')
        """
        index, names = self.part(name), self.element_names
        if not self.is_chain:
            places = ("field",) if self.is_field else ("slm1", "gap", "slm2") if self.gap_m is not None else ("slm1",)
            if index < len(places):
                return places[index]
        elif not isinstance(self.elements[index], Space):
            return getattr(self.elements[index], "beside", "") or names[index]
        else:
            for element, following in zip(self.elements[index + 1 :], names[index + 1 :], strict=True):
                if not isinstance(element, Space):
                    return f"before {following}"
        raise UserError("element", f'"{name}", the last space', expected="an element: behind it lie the planes")

    @property
    def plane_type(self) -> Array:
        """Field type of the distances of its focal planes, with their range.

        >>> import holoview as hv
        >>> hv.load("holochrome-8").plane_type.item.high
        1.0
        """
        return FIELD_DISTANCES if self.is_field else PLANE_DISTANCES

    @property
    def drive_shape(self) -> tuple[int, int, int, int]:
        """Shape (frame, modulator, y, x) of a drive, the patterns that the modulators show.

        For a field (frame, wavelength, y, x): its drive is the complex field itself. Raises UserError for a chain,
        whose patterns are known by their elements (`drive_shapes`).

        >>> import holoview as hv
        >>> hv.load("holochrome-8").with_(shape=[48, 64]).drive_shape
        (1, 2, 48, 64)
        """
        if self.is_chain:
            raise needs_short_form()
        count = len(self.wavelengths_m) if self.is_field else len(self.modulators)
        return (self.frames, count, *self.modulators[0].shape)

    @property
    def field_m(self) -> tuple[float, float]:
        """Size (y, x) of the modulators, m.

        >>> import holoview as hv
        >>> hv.load("holochrome-8").with_(shape=[48, 64]).field_m
        (0.000384, 0.000512)
        """
        if self.is_chain:
            return self.way.shape[0] * self.way.sample_m, self.way.shape[1] * self.way.sample_m
        modulator = self.modulators[0]
        return modulator.shape[0] * modulator.pitch_m, modulator.shape[1] * modulator.pitch_m

    @property
    def effect_values(self) -> dict[str, dict[str, Any]]:
        """The active effects, {id: {parameter: SI value}}; parameters that aren't stated are at their identity.

        >>> import holoview as hv
        >>> hv.load("holochrome-8").edit({"effects.gap.gap_error": "0.1 mm"}).effect_values
        {'gap': {'gap_error': 0.0001}}
        """
        return {name: dict(pairs) for name, pairs in self.effects}

    def edit(self, changes: Mapping[str, Any]) -> System:
        """A copy of the system with some keys changed.

        changes: {key: value}. Keys are those of presets: the fields' names without units, with dots into nested ones
        ("relay2.iris_na", "modulators.0.pitch", "effects.gap.gap_error"). Values are SI numbers or text.

        Shorthands: `pitch`, `shape`, `stroke` and `levels` change every modulator; `upsample`, `propagation` and
        `padding` change the sampling; `amplitudes` "white" balances the lasers to D65; `frames` repeats equal
        amplitudes; a table `source` with `grid` and `spacing` makes a grid of directions; `gap` None, with one
        modulator, takes away relay 1.

        All changes are applied before the copy is checked. Raises UserError for unknown keys and impossible values.

        >>> import holoview as hv
        >>> system = hv.load("holochrome-8").edit({"gap": 3e-3, "relay2.iris_na": 0.02, "amplitudes": "white"})
        >>> system.gap_m, system.relay2.iris_na
        (0.003, 0.02)
        """
        expanded = expand_edit(self, changes)
        heads = {key.partition(".")[0] for key in expanded}
        if "elements" in heads or "planes_from" in heads:
            expanded = _in_elements(self, expanded, heads)
        elif self.is_chain and "modulators" in expanded:
            expanded = {"elements": (), "planes_from": ""} | expanded
        edited: System = with_changes(self, expanded)
        return edited

    def with_(self, **changes: Any) -> System:
        """`edit` with keywords: a changed copy.

        changes: keys without dots and their new values.

        Raises UserError for unknown keys and impossible values.

        >>> import holoview as hv
        >>> hv.load("holochrome-8").with_(gap="3 mm", upsample=4).sampling.upsample
        4
        """
        return self.edit(changes)


def _in_elements(system: System, changes: dict[str, Any], heads: set[str]) -> dict[str, Any]:
    """Changes of elements, before which the short form is taken away: it follows from them."""
    beside = heads & {"modulators", "gap", "relay1", "relay2"}
    if beside:
        key = min(beside)
        raise UserError(key, "changed together with elements", expected="one of them", remedy="change elements alone")
    return {"modulators": (), "gap": None, "relay1": Relay(), "relay2": Relay(), "elements": system.elements} | changes


def bench_of_field(system: System, pitch_m: float, shape: tuple[int, int], **changes: Any) -> System:
    """A system with the plane of a field in place of its modulators and of the light before them.

    pitch_m, shape: of the field's samples, (rows, columns). changes: of further fields of the system.
    """
    plane: dict[str, Any] = {
        "modulators": (Modulator(pitch_m, shape, content="field"),),
        "gap_m": None,
        "source": Source(),
    }
    sampling = replace(system.sampling, upsample=1)
    return replace(system, **plane | {"relay1": Relay(), "sampling": sampling, "effects": ()} | changes)
