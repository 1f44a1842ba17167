"""Results on the device (fields, intensities, XYZ, sRGB) with fingerprints of their inputs; recomputes stale ones.

A result is stale if its fingerprint differs from that of the present bench. While a result is being written it has no
fingerprint, until all of its work has been submitted, since an update may be abandoned half way. Results that exceed
the memory budget are recomputed when they are needed; so are first rows, until an edit shows that storing them pays.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from holoview.engine.compositor import Compositor, WeightedIntensity
from holoview.engine.fused import BufferRegion, Fingerprint, FusedFrame, WavelengthSpan
from holoview.engine.kernels import FusedKernels, StoredRows
from holoview.engine.shader_structs import ShaderInputs
from holoview.gpu.device import Buffer
from holoview.gpu.line_fft import Strategy
from holoview.gpu.recorder import CommandRecorder
from holoview.model.plan import Plan
from holoview.numerics.sampling import ceil_div


@dataclass(frozen=True)
class RenderSettings:
    """Options of a renderer: see `IncrementalRenderer`."""

    budget_bytes: int
    max_wavelengths: int


class ResultCache:
    """Device memory for the results of a plan, and the kernels that compute them. All results are stale at first.

    Raises UserError if the grid exceeds the device's limits.
    """

    def __init__(
        self,
        plan: Plan,
        inputs: ShaderInputs,
        fused_kernels: FusedKernels,
        settings: RenderSettings,
        strategy: Strategy,
    ) -> None:
        max_wavelengths = settings.max_wavelengths if has_no_dense_maps(inputs) else 1
        device = fused_kernels.device
        self.frame = FusedFrame(
            plan, inputs, device, max_wavelengths=max_wavelengths, strategy=strategy, fused_kernels=fused_kernels
        )
        self.compositor = Compositor(device, plan.grid.shape)
        self.xyz_buffer, self.srgb_buffer = self.compositor.xyz_buffer("XYZ"), self.compositor.srgb_buffer("sRGB image")
        self._fingerprints: dict[Hashable, Fingerprint] = {}  # of complete results; see `_keys`
        lit_first = sorted(np.ndindex(*plan.weights.shape), key=lambda key: plan.weights[key] == 0)
        self._intensities = IntensityMemory(self.compositor, lit_first, max_wavelengths, settings.budget_bytes)
        self._fields = FieldMemory(self.frame, settings.budget_bytes - self._intensities.memory_bytes)
        self._caches_first_field = False

    @property
    def plan(self) -> Plan:
        """The plan that is computed."""
        return self.frame.tables.plan

    @property
    def memory_bytes(self) -> int:
        """Device memory of fields and intensities."""
        return self.frame.memory_bytes + self._fields.memory_bytes + self._intensities.memory_bytes

    def set_plan(self, plan: Plan, inputs: ShaderInputs, plane_m: float) -> None:
        """Replace the plan by one of the same structure, with relay 1 leading to a plane at `plane_m`."""
        before = self._example_fingerprints()
        self.frame.tables.set_plan(plan, inputs)
        self.frame.tables.set_distance(1, plane_m)
        self._caches_first_field |= self._is_gap_edit(before)

    def use_strategy(self, strategy: Strategy) -> None:
        """Use another FFT strategy. Fields become stale, since their spectra are in the order of the previous one."""
        self._fields.clear()
        self._forget([key for key in self._fingerprints if isinstance(key, tuple) and key[0] in FIELD_NAMES])
        self.frame.use_strategy(strategy)

    def invalidate(self) -> None:
        """Mark all results as stale."""
        self._fingerprints.clear()

    # --- fingerprints -----------------------------------------------------------------------------------------------

    def is_resident(self, key: FrameWavelength) -> bool:
        """Whether an intensity has a region of its own."""
        return self._intensities.is_resident(key)

    def is_current(self, key: FrameWavelength) -> bool:
        """Whether an intensity is stored and not stale."""
        return self.is_resident(key) and self.holds({("intensity", *key): self.intensity_fingerprint(key)})

    def holds(self, fingerprints: Mapping[Hashable, Fingerprint]) -> bool:
        """Whether results are stored with these fingerprints. Keys: "XYZ", "sRGB", or as `_keys` makes them."""
        return all(self._fingerprints.get(key) == fingerprint for key, fingerprint in fingerprints.items())

    def _forget(self, keys: Iterable[Hashable]) -> None:
        """Mark results as stale, as they are going to be written."""
        for key in keys:
            self._fingerprints.pop(key, None)

    def _remember(self, fingerprints: Mapping[Hashable, Fingerprint], recorder: CommandRecorder) -> None:
        """Set the fingerprints of results once the recorded work is submitted; until then they have none."""
        self._forget(fingerprints)
        recorder.on_submit(partial(self._fingerprints.update, fingerprints))

    def intensity_fingerprint(self, key: FrameWavelength) -> Fingerprint:
        """Fingerprint of the intensity that the present bench has."""
        frame, wavelength = key
        tables = self.frame.tables
        fields = tuple(
            tables.field_fingerprints(frame, source, wavelength)[1] for source in range(len(self.plan.slopes))
        )
        return fields, tables.relay_fingerprint(wavelength)

    def _example_fingerprints(self) -> tuple[Fingerprint, Fingerprint]:
        """Fingerprints of the first and second rows of the first frame and wavelength with light."""
        frame, wavelength = np.argwhere(self.plan.weights > 0)[0].tolist()
        return self.frame.tables.field_fingerprints(frame, 0, wavelength)

    def _is_gap_edit(self, before: tuple[Fingerprint, Fingerprint]) -> bool:
        """Whether an edit changed the second rows but not the first ones, and all of these fit the budget.

        After such an edit the first rows are stored. They aren't from the start, because the kernels that follow then
        can't work in place, which is slower.
        """
        first, second = self._example_fingerprints()
        fields = len(self.plan.slopes) * int(np.count_nonzero(self.plan.weights))
        return first == before[0] and second != before[1] and self._fields.has_room_for(fields)

    # --- recording --------------------------------------------------------------------------------------------------

    def accumulate_intensity(self, span: WavelengthSpan, recorder: CommandRecorder) -> None:
        """Record the intensities of a span for one source: stored for source 0, added for the others."""
        second = self._record_second_rows(span, recorder)
        keys = [(span.frame, span.wavelength + i) for i in range(span.count)]
        self._forget([("intensity", *key) for key in keys])
        region = self._intensities.region(keys[0])
        self.frame.record_intensity(recorder, span, second, region, accumulates=span.source > 0)
        if span.source == len(self.plan.slopes) - 1:
            self._remember({("intensity", *key): self.intensity_fingerprint(key) for key in keys}, recorder)

    def composite_resident(
        self, weights: dict[FrameWavelength, XyzWeight], fingerprint: Fingerprint, recorder: CommandRecorder
    ) -> None:
        """Record XYZ as the weighted sum of all resident intensities; `fingerprint` is that of XYZ afterwards."""
        self._remember({"XYZ": fingerprint}, recorder)
        if not self._intensities.buffers:
            recorder.clear(self.xyz_buffer)
        resident = {key: weight for key, weight in weights.items() if self.is_resident(key)}
        for number, buffer in enumerate(self._intensities.buffers):
            terms = self._intensities.blend_terms(resident, buffer)
            self._record_composite(recorder, buffer, terms, accumulates=number > 0)

    def composite_transient(
        self,
        span: WavelengthSpan,
        weights: dict[FrameWavelength, XyzWeight],
        fingerprint: Fingerprint,
        recorder: CommandRecorder,
    ) -> None:
        """Record adding the transient intensities of a span to XYZ; `fingerprint` is that of XYZ afterwards."""
        some = {key: weights[key] for key in ((span.frame, span.wavelength + i) for i in range(span.count))}
        buffer = self._intensities.region((span.frame, span.wavelength)).buffer
        self._record_composite(recorder, buffer, self._intensities.blend_terms(some, buffer), accumulates=True)
        self._remember({"XYZ": fingerprint}, recorder)

    def encode_srgb(self, exposure_stops: float, fingerprint: Fingerprint, recorder: CommandRecorder) -> None:
        """Record the sRGB image of XYZ; `fingerprint` is that of the image afterwards."""
        self.compositor.encode_srgb(recorder, self.xyz_buffer, self.srgb_buffer, exposure_stops)
        self.frame.dispatch_counts["show"] += 1
        self._remember({"sRGB": fingerprint}, recorder)

    def intensity(self, key: FrameWavelength) -> NDArray[np.float32]:
        """The stored intensity at unit amplitude, (y, x), on the host."""
        region = self._intensities.region(key)
        return self.compositor.download_intensity(region.buffer, region.first)

    def _record_second_rows(self, span: WavelengthSpan, recorder: CommandRecorder) -> BufferRegion:
        """The field behind the last modulator: the stored one, else recomputed from the latest stored field."""
        wavelengths = range(span.wavelength, span.wavelength + span.count)
        pairs = [self.frame.tables.field_fingerprints(span.frame, span.source, w) for w in wavelengths]
        firsts = dict(zip(_keys("first", span), (first for first, _ in pairs), strict=True))
        seconds = dict(zip(_keys("second", span), (second for _, second in pairs), strict=True))
        cached = self._fields.region("second", span)
        if cached is not None and self.holds(seconds):
            return cached
        if self.plan.system.gap_m is None:
            second = self.frame.record_first_modulator(recorder, span, cached)
        else:
            target = cached if self.frame.works_in_place else None
            first = self._record_first_rows(span, recorder, firsts, target)
            second = self.frame.record_second_modulator(recorder, span, first, cached)
        if cached is not None:
            self._remember_fields(seconds, recorder)
        return second

    def _record_first_rows(
        self,
        span: WavelengthSpan,
        recorder: CommandRecorder,
        fingerprints: Mapping[Hashable, Fingerprint],
        uncached_target: BufferRegion | None,
    ) -> BufferRegion:
        """The field behind the first of two modulators: the stored one, else recomputed.

        It is written to the cache, or to `uncached_target` if the cache has no room or isn't used.
        """
        cached = self._fields.region("first", span) if self._caches_first_field else None
        if cached is not None and self.holds(fingerprints):
            return cached
        if cached is None:
            return self.frame.record_first_modulator(recorder, span, uncached_target)
        self._remember_fields(fingerprints, recorder)
        return self.frame.record_first_modulator(recorder, span, cached)

    def _remember_fields(self, fingerprints: Mapping[Hashable, Fingerprint], recorder: CommandRecorder) -> None:
        """As `_remember`, unless the strategy changes in between: the spectra are in the order of the old one."""
        self._forget(fingerprints)
        strategy = self.frame.strategy

        def set_if_same_strategy() -> None:
            if self.frame.strategy == strategy:
                self._fingerprints.update(fingerprints)

        recorder.on_submit(set_if_same_strategy)

    def _record_composite(
        self, recorder: CommandRecorder, intensity: Buffer, terms: Sequence[WeightedIntensity], *, accumulates: bool
    ) -> None:
        self.compositor.composite(recorder, intensity, terms, self.xyz_buffer, accumulates=accumulates)
        self.frame.dispatch_counts["composite"] += 1


def has_no_dense_maps(inputs: ShaderInputs) -> bool:
    """Whether no relay has a pupil and no modulator's transmission is given sample by sample."""
    return inputs.sampled_transmissions is None and all(pupil is None for pupils in inputs.pupils for pupil in pupils)


# Caches of complex fields and of intensities in device memory, within a budget, with fingerprints of their inputs.


FieldName = Literal["first", "second"]
"""The field behind the first modulator, or what is kept behind the last one."""
FIELD_NAMES: tuple[FieldName, ...] = ("first", "second")
FrameWavelength = tuple[int, int]
"""Index of a frame and index of a wavelength."""
XyzWeight = NDArray[np.float64]
"""XYZ (3,) of unit intensity."""


class FieldMemory:
    """Fields between kernels by name and span, as many as fit `budget_bytes`.

    A buffer holds the `frame.max_wavelengths` successive wavelengths that a dispatch may compute.
    """

    def __init__(self, frame: FusedFrame, budget_bytes: int) -> None:
        self._frame, self._budget_bytes = frame, budget_bytes
        self._buffers: dict[Hashable, Buffer] = {}

    def region(self, name: FieldName, span: WavelengthSpan) -> BufferRegion | None:
        """Where the fields of a span are stored, allocated if necessary; None if the budget has no room for them."""
        chunk, first = divmod(span.wavelength, self._frame.max_wavelengths)
        key = (name, span.frame, span.source, chunk)
        if key not in self._buffers:
            if self.memory_bytes + self._buffer_bytes(name) > self._budget_bytes:
                return None
            label = f"{name} rows, frame {span.frame}"
            self._buffers[key] = self._frame.allocate_rows(label, self._rows(name)).buffer
        return BufferRegion(self._buffers[key], first)

    def has_room_for(self, fields: int) -> bool:
        """Whether this many first fields and as many second ones would fit an empty cache."""
        buffers = ceil_div(fields, self._frame.max_wavelengths)
        return buffers * sum(self._buffer_bytes(name) for name in FIELD_NAMES) <= self._budget_bytes

    def clear(self) -> None:
        """Release all memory, because fields of another size are going to be stored."""
        self._buffers.clear()

    def _rows(self, name: FieldName) -> StoredRows:
        return self._frame.layout.first if name == "first" else self._frame.kept

    def _buffer_bytes(self, name: FieldName) -> int:
        return self._frame.rows_bytes(self._rows(name)) * self._frame.max_wavelengths

    @property
    def memory_bytes(self) -> int:
        """Device memory of the stored fields."""
        return sum(buffer.nbytes for buffer in self._buffers.values())


def _keys(name: FieldName, span: WavelengthSpan) -> list[Hashable]:
    """The keys of the fields of a span: (name, frame, source, wavelength)."""
    return [(name, span.frame, span.source, span.wavelength + i) for i in range(span.count)]


class IntensityMemory:
    """Intensities by frame and wavelength at unit amplitude, in few large buffers that compositing reads as a whole.

    Resident intensities, as many as fit `budget_bytes` in the given order, have a region of their own. The others are
    transient: they share one region and have to be added to XYZ before the next one overwrites it. The
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
        """Those of the weighted intensities that are stored in `buffer`."""
        regions = ((self.region(key), weight) for key, weight in weights.items())
        return [(region.first, weight) for region, weight in regions if region.buffer is buffer]

    def _group(self, key: FrameWavelength) -> FrameWavelength:
        return key[0], key[1] // self._max_wavelengths
