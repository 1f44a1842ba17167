"""Records the fused kernels of a frame.

    light      source × first place → row FFT              → rows
    propagate  column FFT × H of a relay → column IFFT     → rows behind it      for each further place
    modulate   row IFFT × that place → row FFT             → rows                where elements stand
    propagate  column FFT × H to the plane → column IFFT   → rows at the plane
    observe    row IFFT → |field|² × weight                → intensity

A place is a modulator of the short form, or elements of a chain without a way between them. If the last relay's stops
pass so little that the spectrum is smaller than the rows before it, or passes store it anyway, `propagate` to the plane
is split, so that other planes are computed from the spectrum:

    spectrum   column FFT                                  → spectrum
    image      × H to the plane → column IFFT              → rows at the plane

Only rows that hold the field are stored between kernels, transformed along x, and of their frequencies only those that
a relay passes (`fused_kernels: FrameLayout`). H is the transfer function.

`DeviceTables` holds the inputs of the kernels in device buffers, with fingerprints that tell when a result is stale.

The buffers are rewritten in place when the bench is edited, so that bound dispatches stay valid. Two results are equal
if the bytes of their inputs are equal: `light_fingerprints` and `relay_fingerprint` return digests of these bytes,
which alone decide what an edit makes stale. Of a chain, whose tables are made where a kernel reads them, numbers stand
for what they follow from.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.engine.compositor import Compositor, WeightedIntensity
from holoview.light.engine.fused_kernels import (
    TABLES,
    TILE_X,
    TILE_Y,
    FrameLayout,
    FusedKernels,
    KernelVariant,
    StoredRows,
    Switches,
    frame_shape,
    lines_of,
    required_variants,
    rows_of,
    works_in_place,
)
from holoview.light.engine.shader_structs import (
    DISPATCH_PARAMS,
    MODULATOR,
    PLANE_WAVE,
    PROPAGATION,
    ShaderInputs,
    complex64,
    dense_transmission,
    modulator_uniform,
    pixel_spectra,
    plane_wave_uniform,
    propagation_uniform,
    support_table,
)
from holoview.light.gpu.device import Buffer, Device
from holoview.light.gpu.line_fft import LineFft, Strategy
from holoview.light.gpu.recorder import CommandRecorder, Dispatch
from holoview.light.gpu.texels import TexelMemory, TexelPool, Texels
from holoview.light.model.passband import Transfer
from holoview.light.model.plan import Plan
from holoview.light.numerics.sampling import ceil_div, frequency_indices, round_up
from holoview.util.mailbox import Inputs, are_same

_MOST_MADE_BYTES = 2**27  # of the tables of a chain that are kept from one update to the next
_SUPPORT_BYTES = 16  # of a vec4i: the frequencies that pass in a column

Key = tuple[str | int, ...]
Fingerprint = Hashable
"""Equal for equal inputs."""


class DeviceTables:
    """The inputs of a plan's kernels in device memory. A key is a name followed by indices:

    ("plane waves",)                          PlaneWave of each source and wavelength
    ("pixel spectra",)                        spectrum of one pixel in each of these waves, along y, then along x
    ("modulators", place)                     Modulator of each wavelength
    ("opd", frame, place)                     optical path of each pixel, in strokes
    ("dense", frame, place, wavelength)       transmission of each sample, if it is given sample by sample
    ("propagations", relay)                   Propagation of each wavelength
    ("support", relay)                        column support of each wavelength
    ("pupil", relay, wavelength)              pupil of a relay, if it apodises or aberrates

    Of a chain dense transmissions and pupils are made when they are asked for, and kept while they take little memory.
    """

    def __init__(self, device: Device, plan: Plan, inputs: ShaderInputs, plane: int | None = None) -> None:
        self._device = device
        self._tables: dict[Key, Buffer] = {}
        self._digests: dict[Key, tuple[bytes, ...]] = {}
        self._items: dict[Key, list[bytes]] = {}
        self._transfers: dict[tuple[int, int], Transfer] = {}  # that the tables of a relay and wavelength hold
        self._no_table = device.upload(np.zeros(1, np.complex64), "no table")
        self._numbers: dict[Key, tuple[Inputs, int]] = {}
        self._made: dict[Key, int] = {}  # tables of a chain, and the numbers that they belong to
        self.plan, self.inputs = plan, inputs
        changes = TableChanges(plan, inputs)
        self._add_inputs(changes)
        self._add_plan(changes, plane)
        self._apply(changes)

    def set_plan(self, plan: Plan, inputs: ShaderInputs, plane: int | None = None) -> None:
        """Replace the plan by one with the same grid and the same numbers of wavelengths, frames and sources.

        plane: to which the last relay leads, by its index; None: that of the last `set_plane`. All
        tables are computed, and with them all hooks of effects are called, before the first is written: an exception
        leaves everything as it was.
        """
        changes = TableChanges(plan, inputs)
        if inputs is not self.inputs:
            self._add_inputs(changes)
        self._add_plan(changes, plane)
        self._apply(changes)

    def set_plane(self, plane: int, wavelengths: Iterable[int] | None = None) -> None:
        """Set the focal plane to which the last relay leads, by its index in the plan, at all wavelengths or some.

        It holds for all work that hasn't been submitted yet, including recorded work.
        """
        changes = TableChanges(self.plan, self.inputs)
        self._add_propagation(changes, self.plan.way.last, plane, wavelengths)
        self._apply(changes)

    def table(self, *key: str | int) -> Buffer:
        """The buffer of a key."""
        return self._tables[key]

    def pupil(self, relay: int, wavelength: int) -> tuple[bool, Buffer]:
        """Whether the relay has a pupil at that wavelength, and its buffer; a dummy buffer if it has none."""
        key = ("pupil", relay, wavelength)
        if self.plan.way.is_chain and not self._is_made(key, self._pupil_number(relay, wavelength)):
            pupil = self.inputs.pupils[relay][wavelength]
            self._make(key, self._pupil_number(relay, wavelength), None if pupil is None else complex64(pupil))
        return self._or_dummy(key)

    def has_pupil(self, relay: int, wavelength: int) -> bool:
        """Whether the relay has a pupil at that wavelength."""
        key = ("pupil", relay, wavelength)
        if self.plan.way.is_chain and not self._is_made(key, self._pupil_number(relay, wavelength)):
            return self.inputs.pupils[relay][wavelength] is not None
        return key in self._tables

    def opd(self, frame: int, place: int) -> Buffer:
        """The buffer of the optical paths at a place; a dummy buffer if it has none."""
        return self._tables.get(("opd", frame, place), self._no_table)

    def dense(self, frame: int, place: int, wavelength: int) -> tuple[bool, Buffer]:
        """Whether the transmission of a place is given sample by sample, and its buffer; a dummy buffer if it isn't."""
        numbers = self.plan.way.places[place]
        key = ("dense", max(self.inputs.shown_first(frame, number) for number in numbers), place, wavelength)
        if self.plan.way.is_chain and not self._is_made(key, self._place_number(place, wavelength)):
            samples = dense_transmission(self.inputs, key[1], numbers, wavelength)
            self._make(key, self._place_number(place, wavelength), samples)
        return self._or_dummy(key)

    def _or_dummy(self, key: Key) -> tuple[bool, Buffer]:
        table = self._tables.get(key)
        return table is not None, table or self._no_table

    def _is_made(self, key: Key, number: int) -> bool:
        """Whether a table of a chain holds what belongs to a number, which may be nothing."""
        return self._made.get(key) == number

    def _make(self, key: Key, number: int, values: NDArray[np.complex64] | None) -> None:
        """Fill a table of a chain."""
        table = self._tables.pop(key, None)
        self._made[key] = number
        if values is not None and table is not None and table.nbytes == values.nbytes:
            self._device.write(table, values.tobytes())
            self._tables[key] = table
        elif values is not None:
            self._tables[key] = self._device.upload(values, " ".join(map(str, key)))

    def trim(self, most_bytes: int) -> bool:
        """Gives the tables back that were made for a chain where they take more memory, and tells whether they did."""
        is_over = sum(self._tables[key].nbytes for key in self._made if key in self._tables) > most_bytes
        if is_over:
            self._tables = {key: table for key, table in self._tables.items() if key not in self._made}
            self._made.clear()
        return is_over

    def is_tilted(self, source: int, wavelengths: range) -> bool:
        """Whether the plane wave of a source is tilted at any of some wavelengths."""
        return bool(np.any(self.plan.slopes[source, wavelengths.start : wavelengths.stop]))

    # --- fingerprints -----------------------------------------------------------------------------------------------

    def light_fingerprints(self, frame: int, source: int, wavelength: int) -> tuple[Fingerprint, ...]:
        """Fingerprints of the light behind each place."""
        way, wave = self.plan.way, source * len(self.plan.system.wavelengths_m) + wavelength
        found: list[Fingerprint] = []
        before: tuple[Fingerprint, ...] = (self._digests[("plane waves",)][wave],)
        for place in range(len(way.places)):
            found.append((*before, *self._transmission_fingerprint(place, frame, wavelength)))
            before = (found[-1], self.relay_fingerprint(wavelength, way.last + 1 - len(way.places) + place))
        return tuple(found)

    def relay_fingerprint(self, wavelength: int, relay: int) -> Fingerprint:
        """Fingerprint of the propagation through a relay."""
        tables = tuple(self._digests[name, relay][wavelength] for name in ("propagations", "support"))
        if self.plan.way.is_chain:
            return (*tables, self._pupil_number(relay, wavelength))
        return (*tables, self._digests.get(("pupil", relay, wavelength)))

    def _transmission_fingerprint(self, place: int, frame: int, wavelength: int) -> tuple[Fingerprint, ...]:
        if self.plan.way.is_chain:
            return (self._place_number(place, wavelength),)
        dense = self._digests.get(("dense", frame, place, wavelength))
        return dense or (self._digests["modulators", place][wavelength], self._digests["opd", frame, place])

    def _number(self, key: Key, inputs: Inputs) -> int:
        """A number that changes when what tables of a chain follow from does: these aren't made to be compared."""
        before, number = self._numbers.get(key, ((), 0))
        self._numbers[key] = inputs, number if are_same(before, inputs) else number + 1
        return self._numbers[key][1]

    def _bench_inputs(self, wavelength: int) -> Inputs:
        """What all tables of a wavelength follow from.

        Effects may make any depend on all of the bench but its planes, its eye and its patterns.
        """
        nominal = self.plan.nominal
        light: Inputs = (float(self.plan.system.wavelengths_m[wavelength]),)
        if not nominal.effects:
            return light
        lasers = (tuple(nominal.wavelengths_m), tuple(nominal.amplitudes.ravel()), nominal.source)
        return (*light, nominal.effects, nominal.elements, nominal.planes_from, nominal.sampling, *lasers)

    def _place_number(self, place: int, wavelength: int) -> int:
        """The number of what the transmission of a place of a chain follows from, in all frames."""
        way, system, found = self.plan.way, self.plan.system, self._bench_inputs(wavelength)
        names = {id(e): name for e, name in zip(system.elements, system.element_names, strict=True)}
        for of in (way.transmissions[number] for number in way.places[place]):
            arms = (names.get(id(element), "") for element in (of.element, *of.beside))
            found = (*found, of, *(self.inputs.drives.get(name) for name in arms))
        return self._number(("dense", place, wavelength), found)

    def _pupil_number(self, relay: int, wavelength: int) -> int:
        """The number of what the pupil of a relay of a chain follows from."""
        way, eye = self.plan.way, self.plan.nominal.eye
        stops = (way.relays[relay], way.orders_m[relay], way.kernel(relay), self.plan.has_weighted_stops)
        seen = (*stops, eye if relay == way.last else None)
        return self._number(("pupil", relay, wavelength), (*self._bench_inputs(wavelength), *seen))

    # --- computing --------------------------------------------------------------------------------------------------

    def _add_plan(self, changes: TableChanges, plane: int | None) -> None:
        """Add the tables that every plan states anew; plane: to which relay 1 leads, None where that stays."""
        plan = changes.plan
        wavelengths, sources = range(len(plan.system.wavelengths_m)), range(len(plan.slopes))
        waves = [plane_wave_uniform(plan, wavelength, source) for source in sources for wavelength in wavelengths]
        self._restate(changes, ("plane waves",), [PLANE_WAVE.pack(**values) for values in waves])
        spectra = [pixel_spectra(plan, wavelength, source) for source in sources for wavelength in wavelengths]
        self._restate(changes, ("pixel spectra",), [spectrum.tobytes() for spectrum in spectra])
        places, last = len(plan.way.places), plan.way.last
        for place in range(places):
            strokes = [modulator_uniform(plan, place, wavelength) for wavelength in wavelengths]
            self._restate(changes, ("modulators", place), [MODULATOR.pack(**values) for values in strokes])
        for relay in range(last + 1 - places, last):
            self._add_propagation(changes, relay, 0)
        if plane is not None:
            self._add_propagation(changes, last, plane)

    def _add_propagation(
        self, changes: TableChanges, relay: int, plane: int, wavelengths: Iterable[int] | None = None
    ) -> None:
        """Add the tables of a relay: of the last to the plane of an index."""
        plan = changes.plan
        grid, count = plan.grid, len(plan.system.wavelengths_m)
        propagations = list(self._items.get(("propagations", relay), [bytes(PROPAGATION.size)] * count))
        columns = grid.padded[1]
        supports = list(self._items.get(("support", relay), [bytes(_SUPPORT_BYTES * columns)] * count))
        for wavelength in range(count) if wavelengths is None else wavelengths:
            step, last = plan.transfer(relay, wavelength, plane), self._transfers.get((relay, wavelength))
            has_same_stops = last is not None and step.has_stops_of(last)
            if last is not None and has_same_stops and replace(step, support=last.support) == last:  # arrays aside
                continue
            changes.transfers[relay, wavelength] = step
            propagations[wavelength] = PROPAGATION.pack(**propagation_uniform(step))
            if not has_same_stops:  # most edits leave the stops as they are
                supports[wavelength] = support_table(step, grid).tobytes()
        self._restate(changes, ("propagations", relay), propagations)
        self._restate(changes, ("support", relay), supports)

    def _add_inputs(self, changes: TableChanges) -> None:
        """Add the tables of the inputs: optical paths, transmissions and pupils."""
        if changes.plan.way.is_chain:  # each is made when it is asked for
            return
        for frame in range(changes.plan.system.frames):
            for index, modulator in enumerate(changes.plan.system.modulators):
                strokes = changes.inputs.stroke_fractions(frame, index, modulator.stroke_m)
                self._add(changes, ("opd", frame, index), [strokes.tobytes()])
                self._add_dense(changes, frame, index)
        for relay, pupils in enumerate(changes.inputs.pupils):
            for wavelength, pupil in enumerate(pupils):
                key = ("pupil", relay, wavelength)
                if pupil is not None:
                    self._add(changes, key, [pupil.cpu().numpy().astype(np.complex64).tobytes()])
                else:
                    changes.dropped.append(key)

    def _add_dense(self, changes: TableChanges, frame: int, modulator: int) -> None:
        """Add the transmissions of a modulator's samples, if it has any, at the wavelengths with light."""
        plan, inputs = changes.plan, changes.inputs
        for wavelength in range(len(plan.system.wavelengths_m)):
            key = ("dense", frame, modulator, wavelength)
            if inputs.is_sampled(modulator) and plan.weights[frame, wavelength] > 0:
                self._add(changes, key, [dense_transmission(inputs, frame, [modulator], wavelength).tobytes()])
            else:
                changes.dropped.append(key)

    def _restate(self, changes: TableChanges, key: Key, items: list[bytes]) -> None:
        """Add a table that every plan states anew, if its items have changed; comparing them is faster than a
        digest."""
        if self._items.get(key) != items:
            self._add(changes, key, items)
            changes.items[key] = items

    def _add(self, changes: TableChanges, key: Key, items: list[bytes]) -> None:
        """Add the concatenated `items`, unless the buffer of the key holds them already."""
        digests = tuple(blake2b(item, digest_size=16).digest() for item in items)
        if self._digests.get(key) != digests:
            changes.data[key], changes.digests[key] = b"".join(items), digests

    # --- filling ----------------------------------------------------------------------------------------------------

    def _apply(self, changes: TableChanges) -> None:
        """Write what has changed. New buffers are allocated first, since memory may be short."""
        new = {
            key: self._device.buffer(len(data), " ".join(map(str, key)))
            for key, data in changes.data.items()
            if key not in self._tables or self._tables[key].nbytes != len(data)
        }
        self._device.check_alive()
        self.plan, self.inputs = changes.plan, changes.inputs
        self._tables |= new
        for key, data in changes.data.items():
            self._device.write(self._tables[key], data)
        self._digests |= changes.digests
        self._items |= changes.items
        self._transfers |= changes.transfers
        for key in changes.dropped:
            self._tables.pop(key, None)
            self._digests.pop(key, None)


@dataclass
class TableChanges:
    """What device memory is to hold for another plan and its inputs, computed as a whole before any of it is written.

    data, digests: bytes of the tables that differ, and digests of their items. items: of tables that every plan states
    anew. dropped: tables that there are none of. transfers: that the tables of a relay and wavelength will hold.
    """

    plan: Plan
    inputs: ShaderInputs
    data: dict[Key, bytes] = field(default_factory=dict)
    digests: dict[Key, tuple[bytes, ...]] = field(default_factory=dict)
    items: dict[Key, list[bytes]] = field(default_factory=dict)
    dropped: list[Key] = field(default_factory=list)
    transfers: dict[tuple[int, int], Transfer] = field(default_factory=dict)


# --- the fused kernels of a frame -------------------------------------------------------------------------------------


_COMPLEX64, _COMPLEX32, _F32 = 8, 4, 4


@dataclass(frozen=True)
class WavelengthSpan:
    """`count` successive wavelengths of one frame and source, from index `wavelength`, which one dispatch computes."""

    frame: int
    source: int
    wavelength: int
    count: int = 1


@dataclass(frozen=True)
class BufferRegion:
    """The fields or intensities of a span: their buffer, and the index of the first of them in it."""

    buffer: Buffer
    first: int = 0


class FusedFrame:
    """Records the kernels of a frame of one plan, which `tables.set_plan` can replace by another on the same grid.

    half: store fields as f16 between kernels (if `fused_kernels` is None). max_wavelengths: the most wavelengths of a
    span. fused_kernels: the kernels for this grid, if they exist already. plane: to which the last
    relay leads, by its index; None: set later. Raises UserError if the grid exceeds the device's limits.
    """

    def __init__(
        self,
        plan: Plan,
        inputs: ShaderInputs,
        device: Device,
        *,
        half: bool = False,
        max_wavelengths: int = 1,
        strategy: Strategy = "passes",
        fused_kernels: FusedKernels | None = None,
        plane: int | None = None,
    ) -> None:
        self.device, self.grid, self.max_wavelengths = device, plan.grid, max_wavelengths
        self._number_bytes = _COMPLEX32 if half else _COMPLEX64
        self.dispatch_counts: Counter[str] = Counter()
        if fused_kernels is None:
            fused_kernels = FusedKernels.kept(
                device, frame_shape(plan, has_plain_pixels=not inputs.is_sampled(0)), half=half
            )
        self.fused_kernels = fused_kernels
        self._dispatches: dict[Hashable, list[Dispatch]] = {}
        self.tables = DeviceTables(device, plan, inputs, plane)
        self.use_strategy(strategy)

    @property
    def layout(self) -> FrameLayout:
        """The rows that are stored between the kernels."""
        return self.fused_kernels.layout(self.strategy)

    def rows_behind(self, place: int) -> StoredRows:
        """The rows that `record_place` gives of a place."""
        first_relay = self.fused_kernels.shape.first_relay
        return self.layout.kept if place == self.last_place else self.layout.entering[first_relay + place]

    @property
    def last_place(self) -> int:
        """The number of the last place."""
        return self.fused_kernels.shape.places - 1

    def allocate_rows(self, label: str, rows: StoredRows) -> BufferRegion:
        """New memory for rows of a span of `max_wavelengths`."""
        return BufferRegion(self.device.buffer(self.rows_bytes(rows) * self.max_wavelengths, label))

    def rows_bytes(self, rows: StoredRows) -> int:
        """Device memory of the rows of one field."""
        return rows.samples * self._number_bytes

    @property
    def memory_bytes(self) -> int:
        """Device memory of the fields between kernels, of the work buffer and of texels."""
        others = (each.nbytes for each in (self._work, self._texels, self._table_texels) if each)
        return sum(rows.buffer.nbytes for rows in self._scratch) + sum(others)

    @property
    def traffic_bytes(self) -> int:
        """Bytes that the kernels read and write for one field, from the source to the intensity."""
        layout, shape = self.layout, self.fused_kernels.shape
        opd = shape.places * math.prod(self.grid.shape) * _F32 // self.grid.upsample**2
        if self.tables.plan.way.is_chain:  # a complex number for each sample
            opd = shape.places * math.prod(self.grid.shape) * 2 * _F32
        kernels = [("propagate", relay) for relay in range(shape.first_relay, shape.last_relay)]
        kernels += [("modulate", relay + 1) for _, relay in kernels]
        last = ("spectrum", "image") if layout.keeps_spectrum else ("propagate",)
        kernels += [(kernel, shape.last_relay) for kernel in last]
        numbers = layout.entering[shape.first_relay].samples + layout.leaving[-1].samples  # of `light` and `observe`
        numbers += sum(rows.samples for kernel in kernels for rows in rows_of(layout, *kernel))
        return numbers * self._number_bytes + opd + math.prod(self.grid.shape) * _F32

    @property
    def works_in_place(self) -> bool:
        """Whether `record_place` is faster if its target is the region of the rows that it begins with."""
        return works_in_place(self.layout)

    def use_strategy(self, strategy: Strategy) -> None:
        """Use another FFT strategy from now on. Stored fields become invalid: their spectra are in another order."""
        layout, (height, width) = self.fused_kernels.layout(strategy), self.grid.padded
        work = self._allocate_work(strategy)
        entering, leaving = (rows[layout.shape.first_relay :] for rows in (layout.entering, layout.leaving))
        largest = max((*entering, *leaving, layout.kept), key=lambda rows: rows.samples)
        others = largest
        has_equal_rows = leaving[:-1] == entering[1:] == entering[-1:]
        if layout.keeps_spectrum and has_equal_rows:  # then the wide rows are all in the other one
            others = max(entering[0], layout.spectrum, key=lambda rows: rows.samples)
        label = f"rows of the field, {width} x {height}"
        self._scratch = [self.allocate_rows(label, rows) for rows in (others, largest)]
        self.strategy, self._work = strategy, work
        self._texels: TexelMemory | None = None
        self._table_texels = TexelPool(self.device)
        if layout.reads_texels and not self.fused_kernels.half:
            most = max(largest.samples * self.max_wavelengths, (work.nbytes if work else 0) // _COMPLEX64)
            self._texels = TexelMemory(self.device, most, label)
        self._dispatches.clear()

    def required_variants(self) -> frozenset[KernelVariant]:
        """The kernel variants that the plan needs."""
        plan, inputs = self.tables.plan, self.tables.inputs
        wavelengths, relays = range(len(plan.system.wavelengths_m)), range(len(plan.relays))
        has_pupil = [{self.tables.has_pupil(relay, w) for w in wavelengths} for relay in relays]
        is_dense = [inputs.is_sampled(numbers[0]) for numbers in plan.way.places]
        return required_variants(self.layout, plan, has_pupil, is_dense)

    # --- kernels ----------------------------------------------------------------------------------------------------

    def record_light(
        self, recorder: CommandRecorder, span: WavelengthSpan, target: BufferRegion | None = None
    ) -> BufferRegion:
        """Record all kernels from the source to what is kept for all planes."""
        rows = None
        for place in range(self.last_place + 1):
            rows = self.record_place(recorder, span, place, rows, target if place == self.last_place else None)
        assert rows is not None
        return rows

    def _record_first_place(
        self, recorder: CommandRecorder, span: WavelengthSpan, target: BufferRegion | None
    ) -> BufferRegion:
        target = target or self._scratch[0]
        is_tilted = self.tables.is_tilted(span.source, range(span.wavelength, span.wavelength + span.count))
        is_dense, buffers = self._transmission(span, 0)
        buffers, switches = [self.tables.table("plane waves"), *buffers], (("is_tilted", is_tilted), is_dense)
        relay = self.fused_kernels.shape.first_relay
        self._record_kernel(recorder, "light", relay, span, None, target, buffers, switches)
        return target

    def record_place(
        self,
        recorder: CommandRecorder,
        span: WavelengthSpan,
        place: int,
        rows: BufferRegion | None,
        target: BufferRegion | None = None,
    ) -> BufferRegion:
        """Record the kernels from the light behind the place before to that behind a place, transformed along x.

        rows: the light behind the place before; None for the first, which begins at the source. Of the last place it is
        what is kept for all planes: these rows, or the spectrum.
        """
        if rows is None:
            return self._record_first_place(recorder, span, target)
        layout, (other, wide) = self.layout, self._scratch
        relay = self.fused_kernels.shape.first_relay + place - 1
        has_spectrum = layout.keeps_spectrum and place == self.last_place
        to, behind = None if has_spectrum else target, wide if rows != wide else other
        if layout.leaving[relay] == layout.entering[relay + 1]:
            behind = modulated = to or (rows if self.works_in_place and rows in self._scratch else behind)
        else:
            modulated = to or (other if behind != other else wide)
        self._record_propagation(recorder, "propagate", span, relay, rows, behind)
        is_dense, buffers = self._transmission(span, place)
        self._record_kernel(recorder, "modulate", relay + 1, span, behind, modulated, buffers, (is_dense,))
        if not has_spectrum:
            return modulated
        target = target or (other if modulated != other else wide)
        self._record_kernel(recorder, "spectrum", relay + 1, span, modulated, target, [])
        return target

    def _transmission(self, span: WavelengthSpan, place: int) -> tuple[tuple[str, bool], list[Buffer]]:
        """The switch and the tables of what multiplies light at a place."""
        is_dense, dense = self.tables.dense(span.frame, place, span.wavelength)
        return ("is_dense", is_dense), [
            self.tables.table("modulators", place),
            self.tables.opd(span.frame, place),
            dense,
        ]

    def trim(self, most_bytes: int = _MOST_MADE_BYTES) -> None:
        """Gives the tables back that were made for beams of a chain, if they take more memory."""
        if self.tables.trim(most_bytes):
            self._dispatches.clear()

    def download_spectrum(
        self, kept: BufferRegion
    ) -> tuple[NDArray[np.integer], NDArray[np.integer], NDArray[np.complexfloating]]:
        """The spectrum behind the last of several places, after the work that was submitted.

        kept: as `record_light` gives it, of one wavelength; of rows, the transform along y is done here. Returns signed
        indices of the rows (A,) and of the columns (B,), and the values (A, B), with phases from the field's first row
        where that transform was done.
        """
        layout, rows = self.layout, self.layout.kept
        shape = (round_up(rows.rows, TILE_Y), rows.stride)
        values: NDArray[np.complex64] = self.device.download(kept.buffer, np.complex64, shape)
        if layout.is_tiled:
            tiles = values.reshape(shape[0] // TILE_Y, rows.stride // TILE_X, TILE_Y, TILE_X)
            values = tiles.swapaxes(1, 2).reshape(shape)
        values, kx = values[: rows.rows, : rows.columns], layout.columns(layout.shape.last_relay).frequencies()
        if layout.keeps_spectrum:
            return layout.spectrum_rows().frequencies(), kx, values
        height = self.grid.padded[0]
        return frequency_indices(height), kx, np.fft.fft(values, height, axis=0)

    def record_intensity(
        self,
        recorder: CommandRecorder,
        span: WavelengthSpan,
        kept: BufferRegion,
        intensity: BufferRegion,
        *,
        weight: float = 1.0,
        accumulates: bool = False,
    ) -> None:
        """Record weight·|field|² at the plane of the last relay, stored or, with `accumulates`, added to `intensity`.

        kept: the light behind the last place, as `record_place` gives it.
        """
        at_plane = self._scratch[1] if kept != self._scratch[1] else self._scratch[0]
        kernel, last = "image" if self.layout.keeps_spectrum else "propagate", self.fused_kernels.shape.last_relay
        self._record_propagation(recorder, kernel, span, last, kept, at_plane)
        switches = (("accumulates", accumulates),)
        self._record_kernel(recorder, "observe", last, span, at_plane, intensity, [], switches, weight=weight)

    def _record_propagation(
        self,
        recorder: CommandRecorder,
        kernel: str,
        span: WavelengthSpan,
        relay: int,
        source: BufferRegion,
        target: BufferRegion,
    ) -> None:
        has_pupil, pupil = self.tables.pupil(relay, span.wavelength)
        buffers = [self.tables.table("propagations", relay), self.tables.table("support", relay), pupil]
        if kernel == "propagate":
            buffers.append(self.tables.table("pixel spectra"))
        self._record_kernel(recorder, kernel, relay, span, source, target, buffers, (("has_pupil", has_pupil),))

    def _record_kernel(
        self,
        recorder: CommandRecorder,
        kernel: str,
        relay: int,
        span: WavelengthSpan,
        source: BufferRegion | None,
        target: BufferRegion,
        tables: Sequence[Buffer],
        switches: Switches = (),
        *,
        weight: float = 0.0,
    ) -> None:
        """Record a kernel; its dispatches are bound once for equal arguments."""
        key = (kernel, relay, span, source, target, *tables, switches, weight)
        if key not in self._dispatches:
            params = DISPATCH_PARAMS.pack(
                first_wave=span.source * len(self.tables.plan.system.wavelengths_m) + span.wavelength,
                first_wavelength=span.wavelength,
                source_field=source.first if source else 0,
                target_field=target.first,
                work_field=source.first if source and kernel == "observe" else target.first,
                weight=weight,
            )
            separate = kernel != "observe" and source is not None and source != target
            variant = KernelVariant(self.fused_kernels.shape, kernel, relay, switches, separate)
            lines = lines_of(self.layout, kernel, relay)
            transform = self.fused_kernels.transform(variant, self.strategy)
            rows: list[Any] = [(source or target).buffer, target.buffer if separate else None]
            read, later, out = list[Any](tables), None, [target.buffer] if kernel == "observe" else []
            uniform = self.device.uniform(params, f"parameters of {kernel}")
            if self._texels is not None:
                rows, between = self._texel_rows(kernel, relay, span, source, target, transform)
                read = self._texel_tables(kernel, tables)
                later = [uniform, *between, *(each.view if isinstance(each, Texels) else each for each in read), *out]
            buffers = [uniform, *rows, *read, *out]
            self._dispatches[key] = transform.bind(
                buffers, lines, span.count, self._work, later=later, texels=self._texels
            )
        for dispatch in self._dispatches[key]:
            recorder.add(dispatch)
        self.dispatch_counts[kernel] += 1

    def _texel_rows(
        self,
        kernel: str,
        relay: int,
        span: WavelengthSpan,
        source: BufferRegion | None,
        target: BufferRegion,
        transform: LineFft,
    ) -> tuple[list[Any], list[Any]]:
        """What a kernel that reads texels binds as its rows: its first shader, and further ones, which read what the
        one before has written."""
        texels, (read, written) = self._texels, rows_of(self.layout, kernel, relay)
        assert texels is not None
        worked, rows = (source, read) if source and kernel == "observe" else (target, written)

        def fields(region: BufferRegion, samples: int) -> Texels:
            return Texels(texels, region.buffer, region.first * samples, span.count * samples)

        first = fields(source, read.samples) if source else texels.view
        later = fields(worked, rows.samples) if transform.has_work_hooks else texels.view
        return [first, worked.buffer], [later, worked.buffer]

    def _texel_tables(self, kernel: str, tables: Sequence[Buffer]) -> list[Any]:
        """The tables of a kernel that reads texels; a texture is shared by all tables of a name."""
        bound: list[Any] = []
        for buffer, table in zip(tables, TABLES.get(kernel, ()), strict=True):
            if table is None:
                bound.append(buffer)
                continue
            bound.append(self._table_texels.texels(table[0], buffer, 0, ceil_div(buffer.nbytes, _COMPLEX64)))
        return bound

    def _allocate_work(self, strategy: Strategy) -> Buffer | None:
        """The work buffer of the transforms, if they need one. Raises UserError for an unsupported size."""
        kernels = self.fused_kernels
        variants = kernels.plain_variants(strategy, self.tables.plan)  # pupils and transmissions need no work
        transforms = (kernels.transform(variant, strategy) for variant in variants)
        nbytes = self.max_wavelengths * max(transform.work_bytes for transform in transforms)
        size = f"{self.grid.padded[1]} x {self.grid.padded[0]}"
        return self.device.buffer(nbytes, f"padded field, {size}") if nbytes else None


def group_into_spans(lit: Iterable[tuple[int, int]], max_wavelengths: int) -> list[WavelengthSpan]:
    """Group sorted (frame, wavelength) pairs into spans of successive wavelengths, all of source 0.

    A span starts at a multiple of `max_wavelengths` or after a gap, and doesn't cross such a multiple.
    """
    spans: list[WavelengthSpan] = []
    for frame, wavelength in lit:
        last = spans[-1] if spans else None
        follows = last is not None and (last.frame, last.wavelength + last.count) == (frame, wavelength)
        if last is not None and follows and wavelength % max_wavelengths:
            spans[-1] = replace(last, count=last.count + 1)
        else:
            spans.append(WavelengthSpan(frame, 0, wavelength))
    return spans


# --- memory for results -----------------------------------------------------------------------------------------------


FrameWavelength = tuple[int, int]
"""Index of a frame and index of a wavelength."""
XyzWeight = NDArray[np.float64]
"""XYZ (3,) of unit intensity."""


class LightMemory:
    """Light behind places by place and span, as much as fits `budget_bytes`.

    A buffer holds the `frame.max_wavelengths` successive wavelengths that a dispatch may compute.
    """

    def __init__(self, frame: FusedFrame, budget_bytes: int) -> None:
        self._frame, self._budget_bytes = frame, budget_bytes
        self._buffers: dict[tuple[int, int, int, int], Buffer] = {}

    def region(self, place: int, span: WavelengthSpan) -> BufferRegion | None:
        """Where the light of a span is stored, allocated if necessary; None if the budget has no room for it."""
        chunk, first = divmod(span.wavelength, self._frame.max_wavelengths)
        key = (place, span.frame, span.source, chunk)
        if key not in self._buffers:
            if self.memory_bytes + self._buffer_bytes(place) > self._budget_bytes:
                return None
            label = f"light behind place {place + 1}, frame {span.frame}"
            self._buffers[key] = self._frame.allocate_rows(label, self._frame.rows_behind(place)).buffer
        return BufferRegion(self._buffers[key], first)

    def has_room_for(self, spans: int, places: Iterable[int]) -> bool:
        """Whether the light of so many wavelengths, frames and sources behind some places would fit an empty cache."""
        buffers = ceil_div(spans, self._frame.max_wavelengths)
        return buffers * sum(map(self._buffer_bytes, places)) <= self._budget_bytes

    def clear(self, place: int | None = None) -> None:
        """Release the memory of a place, or all of it, because light of another size is going to be stored."""
        self._buffers = {key: buffer for key, buffer in self._buffers.items() if place not in (None, key[0])}

    def _buffer_bytes(self, place: int) -> int:
        return self._frame.rows_bytes(self._frame.rows_behind(place)) * self._frame.max_wavelengths

    @property
    def memory_bytes(self) -> int:
        """Device memory of the stored light."""
        return sum(buffer.nbytes for buffer in self._buffers.values())


def light_keys(place: int, span: WavelengthSpan) -> list[Hashable]:
    """The keys of the light of a span: ("light", place, frame, source, wavelength)."""
    return [("light", place, span.frame, span.source, span.wavelength + i) for i in range(span.count)]


class IntensityMemory:
    """Intensities by frame and wavelength at unit amplitude, in few large buffers that compositing reads as a whole.

    Resident intensities, as many as fit `budget_bytes` in the given order, have a region of their own. The others are
    transient: they share one region, and each has to be added to XYZ before the next overwrites it. The
    `max_wavelengths` successive wavelengths that a dispatch may compute are adjacent.
    """

    def __init__(
        self, compositor: Compositor, order: Iterable[FrameWavelength], max_wavelengths: int, budget_bytes: int
    ) -> None:
        self._max_wavelengths = max_wavelengths
        groups = list(dict.fromkeys((frame, wavelength // max_wavelengths) for frame, wavelength in order))
        group_bytes = compositor.intensity_bytes * max_wavelengths
        resident = groups[: max(budget_bytes // group_bytes, 0)]
        groups_per_buffer = max(compositor.largest_bytes // group_bytes, 1)
        self.buffers: list[Buffer] = []
        self._regions: dict[FrameWavelength, BufferRegion] = {}
        for start in range(0, len(resident), groups_per_buffer):
            some = resident[start : start + groups_per_buffer]
            buffer = compositor.intensity_buffer(len(some) * max_wavelengths)
            self.buffers.append(buffer)
            self._regions |= {group: BufferRegion(buffer, i * max_wavelengths) for i, group in enumerate(some)}
        has_transient = len(resident) < len(groups)
        self._shared = BufferRegion(compositor.intensity_buffer(max_wavelengths)) if has_transient else None
        self.memory_bytes = group_bytes * len(resident)

    def is_resident(self, key: FrameWavelength) -> bool:
        """Whether an intensity has a region of its own."""
        return self._group(key) in self._regions

    def region(self, key: FrameWavelength) -> BufferRegion:
        """Where an intensity is stored."""
        region = self._regions.get(self._group(key), self._shared)
        assert region is not None, "a transient intensity needs the shared region"
        return BufferRegion(region.buffer, region.first + key[1] % self._max_wavelengths)

    def blend_terms(self, weights: Mapping[FrameWavelength, XyzWeight], buffer: Buffer) -> list[WeightedIntensity]:
        """The weighted intensities that are stored in `buffer`."""
        regions = ((self.region(key), weight) for key, weight in weights.items())
        return [(region.first, weight) for region, weight in regions if region.buffer is buffer]

    def _group(self, key: FrameWavelength) -> FrameWavelength:
        return key[0], key[1] // self._max_wavelengths
