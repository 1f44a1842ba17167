"""A chain of elements in a page: its stages as a recording, and the numbers of its elements.

Of a chain without effects the page itself computes what elements multiply light by, and the kernels of Fourier planes,
from the patterns and these numbers (`chain.js`), so that its lasers and spaces can be moved and a page is small. With
effects it holds what Python computed of each sample.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.engine.frame import spectrum_behind_modulators
from holoview.light.engine.fused import BufferRegion, WavelengthSpan
from holoview.light.engine.shader_structs import DeviceArray, ShaderInputs
from holoview.light.engine.wgpu_executor import GpuField, WgpuExecutor
from holoview.light.gpu.device import Device
from holoview.light.gpu.line_fft import Strategy
from holoview.light.model.chain import pixel_shape
from holoview.light.model.elements import ComplexModulator, Element, Fourier, Lens, Mask, Pixels, Space
from holoview.light.model.masks import mask_values
from holoview.light.model.plan import Plan, walk_off
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs

_ARRAYS = ("path", "amplitude")  # of a mask
_LONGER = 3.0  # than the file's: spaces that a page can show
_SHORT_M = 1e-3  # the same of a space of no length


# --- the recording ----------------------------------------------------------------------------------------------------


class StagedBeams:
    """Records the light of a chain, each beam's spectrum behind the last element apart from its intensity at a plane.

    most_bytes: of spectra that are kept; beyond it all use the same memory.
    """

    def __init__(
        self, device: Device, plan: Plan, inputs: ShaderInputs, strategy: Strategy, count: int, most_bytes: int
    ) -> None:
        plan = replace(plan, planes=plan.planes[-1:], _transfers={})
        self._executor = WgpuExecutor(plan, _Tables(plan, inputs), device, strategy=strategy, single_stages=True)
        self.is_kept = self._executor.field_bytes * count <= most_bytes
        self._spectrum: GpuField | None = None

    def record_field(self, span: WavelengthSpan) -> None:
        """Submits the light behind the last element."""
        if self._spectrum is not None and self.is_kept:
            self._executor.set_aside(self._spectrum)
        self._spectrum = spectrum_behind_modulators(self._executor, span.wavelength, span.frame, span.source)
        self._executor.submit()

    def record_intensity(self, span: WavelengthSpan, to: BufferRegion, *, accumulates: bool) -> None:
        """Submits the intensity of the last light at the focal plane."""
        assert self._spectrum is not None
        last = self._executor.plan.way.last
        seen = self._executor.field(self._executor.transmit(self._spectrum, last, span.wavelength), last)
        self._executor.add_intensity(seen, to, 1.0, accumulates=accumulates)
        self._executor.submit()


@dataclass(frozen=True)
class _Tables:
    """The inputs of a recording: zeros where the page computes what elements and Fourier planes do."""

    plan: Plan
    inputs: ShaderInputs

    @property
    def pupils(self) -> Sequence[Sequence[DeviceArray | None]]:
        """Those of Python, but for kernels of Fourier planes without effects."""
        way, count = self.plan.way, len(self.plan.system.wavelengths_m)
        if self.plan.nominal.effects:
            return self.inputs.pupils
        known: Any = self.inputs.pupils if has_pupils(self.plan.nominal) else [[None] * count for _ in way.relays]
        return [
            of if way.kernel(relay) is None else [_Blank(self.plan.grid.padded)] * count
            for relay, of in enumerate(known)
        ]

    @property
    def drives(self) -> Mapping[str, object]:
        """Those of Python."""
        return self.inputs.drives

    @property
    def sampled_transmissions(self) -> object | None:
        """Those of Python."""
        return self.inputs.sampled_transmissions

    def stroke_fractions(self, frame: int, modulator: int, stroke_m: float) -> NDArray[np.float32]:
        """As of Python; nothing reads them."""
        return self.inputs.stroke_fractions(frame, modulator, stroke_m)

    def is_sampled(self, modulator: int) -> bool:
        """Always."""
        return True

    def shown_first(self, frame: int, modulator: int) -> int:
        """The first frame in which an element has the same transmission."""
        return self.inputs.shown_first(frame, modulator)

    def transmission(self, frame: int, modulator: int, wavelength: int) -> DeviceArray | None:
        """Zeros without effects."""
        if self.plan.nominal.effects:
            return self.inputs.transmission(frame, modulator, wavelength)
        return _Blank(self.plan.grid.shape)


@dataclass(frozen=True)
class _Blank:
    """A table of zeros that takes no memory, in place of a tensor."""

    shape: tuple[int, int]

    def cpu(self) -> _Blank:
        """Itself."""
        return self

    def numpy(self) -> NDArray[np.complex64]:
        """The zeros."""
        return np.zeros(self.shape, np.complex64)


def has_pupils(system: System) -> bool:
    """Whether a relay or the eye has a pupil function, which Python computes for the file's wavelengths."""
    relays = any(relay.aberration_m or relay.apodisation_na is not None for relay in system.way.relays)
    return relays or (system.eye is not None and system.eye.has_pupil_function)


# --- the numbers of a chain -------------------------------------------------------------------------------------------


@dataclass
class ElementNumbers:
    """What a page computes the tables of a chain from.

    numbers: of each step of the way that multiplies light, in the order of `Way.transmissions`, `beside` those of the
    elements to whose light its own adds; None with effects.
    arrays: patterns and masks, which the numbers name by their place here.
    """

    numbers: list[dict[str, Any]] | None = None
    arrays: list[NDArray[Any]] = field(default_factory=list)

    def named(self, contents: Sequence[int | None]) -> list[dict[str, Any]] | None:
        """The numbers with arrays as {data: the part that holds it, null for zeros}. contents: parts of `arrays`."""
        if self.numbers is None:
            return None

        def refer(place: int | None) -> dict[str, Any] | None:
            return None if place is None else {"data": contents[place]}

        def named(key: str, value: Any) -> Any:
            if key in _ARRAYS:
                return refer(value)
            if key == "patterns":
                return [refer(place) for place in value]
            return [of_element(each) for each in value] if key == "beside" else value

        def of_element(each: dict[str, Any]) -> dict[str, Any]:
            return {key: named(key, value) for key, value in each.items()}

        return [of_element(each) for each in self.numbers]


def element_numbers(plan: Plan, inputs: FrameInputs) -> ElementNumbers:
    """The numbers of the elements of a chain. Lengths in SI units, places in samples."""
    found = ElementNumbers()
    if plan.nominal.effects:
        return found
    transmissions: Any = inputs.sampled_transmissions

    def stored(array: NDArray[Any] | None, dtype: Any = np.float32) -> int | None:
        if array is None:
            return None
        found.arrays.append(np.ascontiguousarray(array, dtype))
        return len(found.arrays) - 1

    def numbers_of(number: int, element: Element, place: str) -> dict[str, Any]:
        if isinstance(element, Lens | Fourier):
            f_m, abbe = element.focal_length_m, element.abbe if isinstance(element, Lens) else None
            return {
                "kind": element.kind,
                "place": place,
                "focal_length_m": f_m,
                "abbe": abbe,
                "order_m": _finest(plan, number),
            }
        assert isinstance(element, Pixels)
        shape, size = pixel_shape(element), round(element.pitch_m / plan.grid.pitch_m)
        start = [
            round((n - m * size) / 2 + off / plan.grid.pitch_m)
            for n, m, off in zip(plan.grid.shape, shape, element.offset_m, strict=True)
        ]
        known = {"kind": element.kind, "shape": shape, "size": size, "start": start}
        if isinstance(element, Mask):
            values = mask_values(element)
            return known | {"path": stored(values.path_m), "amplitude": stored(values.amplitude)}
        frames = [f for f in range(plan.system.frames) if inputs.shown_first(f, number) == f]
        dtype = np.complex64 if isinstance(element, ComplexModulator) else np.float32
        patterns = [stored(transmissions.sent(element, f).cpu().numpy(), dtype) for f in frames]
        of_kind = {"stroke_m": getattr(element, "stroke_m", None), "range": getattr(element, "range", None)}
        return known | of_kind | {"patterns": patterns}

    found.numbers = [
        numbers_of(number, of.element, of.place) | {"beside": [numbers_of(number, arm, "") for arm in of.beside]}
        for number, of in enumerate(plan.way.transmissions)
    ]
    return found


def _finest(plan: Plan, number: int) -> float:
    """The pitch of the finest pixels that show patterns before a step of the way, whose order a Fourier plane holds."""
    elements = [of.element for of in plan.way.transmissions]
    first = next(e.pitch_m for e in elements if isinstance(e, Pixels))
    return min([first, *(e.pitch_m for e in elements[:number] if isinstance(e, Pixels) and e.is_driven)])


def space_numbers(plan: Plan) -> dict[str, Any]:
    """The distances of a chain: of each relay, of the spaces that a page can change, and to where planes are told from.

    Without effects a space can have from 0 to three times its length, or as far as padding holds its light; with
    effects none can be changed. behind: the spaces between the element that planes are measured from and the last one.
    """
    system, way = plan.nominal, plan.system.way
    distances_m, names = list(way.distances_m), list(system.element_names)
    if system.effects:
        fixed = {"fixed_m": way.behind_m, "spaces": [], "from": system.planes_from}
        return {"distances_m": distances_m, "spaces": [], "behind": fixed}
    named = zip(names, system.elements, strict=True)
    lengths = {name: e.distance_m for name, e in named if isinstance(e, Space) and e.distance_m is not None}
    spaces: list[dict[str, Any]] = []
    for relay, of_relay in enumerate(way.relay_names):
        own = [name for name in of_relay if name in lengths]
        for name in own:
            most_m = _longest(plan, relay) - math.fsum(lengths[other] for other in own if other != name)
            high_m = max(lengths[name], min(_LONGER * lengths[name] or _SHORT_M, most_m))
            key = f"elements.{names.index(name)}"
            known = {"name": name, "key": key, "relay": relay, "nominal_m": lengths[name], "range_m": [0.0, high_m]}
            spaces.append(known)
    before = names[names.index(system.planes_from) + 1 :] if system.planes_from and way.behind_m else []
    between = {"fixed_m": 0.0, "spaces": [name for name in before if name in lengths], "from": system.planes_from}
    return {"distances_m": distances_m, "spaces": spaces, "behind": between}


def _longest(plan: Plan, relay: int) -> float:
    """The distance over which the padding holds all light of a relay, m."""
    if plan.system.sampling.propagation != "compact":
        return math.inf
    room = min(p - n for p, n in zip(plan.grid.padded, plan.grid.shape, strict=True))
    reach = walk_off(plan.system, relay, 1.0)
    return room / reach if reach else math.inf
