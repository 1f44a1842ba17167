"""Results on the device (fields, intensities, XYZ, sRGB) with fingerprints of their inputs; recomputes stale ones.

A result is stale if its fingerprint differs from that of the present bench. While a result is being written it has no
fingerprint, until all of its work has been submitted, since an update may be abandoned half way. Results that exceed
the memory budget are recomputed when they are needed; so are first rows, until an edit shows that storing them pays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from holoview.engine.compositor import Compositor, WeightedIntensity
from holoview.engine.device_cache import FieldCache, FieldName, FrameWavelength, IntensityCache, XyzWeight
from holoview.engine.device_tables import Fingerprint
from holoview.engine.fused import BufferRegion, FusedFrame, WavelengthSpan
from holoview.engine.kernels import FusedKernels
from holoview.engine.shader_inputs import ShaderInputs
from holoview.gpu.device import Buffer
from holoview.gpu.line_fft import Strategy
from holoview.gpu.recorder import CommandRecorder
from holoview.model.plan import Plan


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
        self.xyz_fingerprint: Fingerprint = None
        self.srgb_fingerprint: Fingerprint = None
        lit_first = sorted(np.ndindex(*plan.weights.shape), key=lambda key: plan.weights[key] == 0)
        self._intensities = IntensityCache(self.compositor, lit_first, max_wavelengths, settings.budget_bytes)
        self._fields = FieldCache(self.frame, settings.budget_bytes - self._intensities.memory_bytes)
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
        self.frame.use_strategy(strategy)

    def invalidate(self) -> None:
        """Mark all results as stale."""
        self._intensities.fingerprints.clear()
        self._fields.invalidate()
        self.xyz_fingerprint = self.srgb_fingerprint = None

    # --- fingerprints -----------------------------------------------------------------------------------------------

    def is_resident(self, key: FrameWavelength) -> bool:
        """Whether an intensity has a region of its own."""
        return self._intensities.is_resident(key)

    def is_current(self, key: FrameWavelength) -> bool:
        """Whether an intensity is stored and not stale."""
        return self.is_resident(key) and self._intensities.fingerprints.get(key) == self.intensity_fingerprint(key)

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
        self._intensities.fingerprints.update(dict.fromkeys(keys))
        region = self._intensities.region(keys[0])
        self.frame.record_intensity(recorder, span, second, region, accumulates=span.source > 0)
        if span.source == len(self.plan.slopes) - 1:
            complete = {key: self.intensity_fingerprint(key) for key in keys}
            recorder.on_submit(partial(self._intensities.fingerprints.update, complete))

    def composite_resident(
        self, weights: dict[FrameWavelength, XyzWeight], fingerprint: Fingerprint, recorder: CommandRecorder
    ) -> None:
        """Record XYZ as the weighted sum of all resident intensities; `fingerprint` is that of XYZ afterwards."""
        self._set_xyz_fingerprint(fingerprint, recorder)
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
        self._set_xyz_fingerprint(fingerprint, recorder)

    def encode_srgb(self, exposure_stops: float, fingerprint: Fingerprint, recorder: CommandRecorder) -> None:
        """Record the sRGB image of XYZ; `fingerprint` is that of the image afterwards."""
        self.compositor.encode_srgb(recorder, self.xyz_buffer, self.srgb_buffer, exposure_stops)
        self.frame.dispatch_counts["show"] += 1
        self.srgb_fingerprint = None
        recorder.on_submit(partial(setattr, self, "srgb_fingerprint", fingerprint))

    def intensity(self, key: FrameWavelength) -> NDArray[np.float32]:
        """The stored intensity at unit amplitude, (y, x), on the host."""
        region = self._intensities.region(key)
        return self.compositor.download_intensity(region.buffer, region.first)

    def _record_second_rows(self, span: WavelengthSpan, recorder: CommandRecorder) -> BufferRegion:
        """The field behind the last modulator: the stored one, else recomputed from the latest stored field."""
        wavelengths = range(span.wavelength, span.wavelength + span.count)
        pairs = [self.frame.tables.field_fingerprints(span.frame, span.source, w) for w in wavelengths]
        first_fingerprints, second_fingerprints = [first for first, _ in pairs], [second for _, second in pairs]
        cached = self._fields.region("second", span)
        if cached is not None and self._fields.is_current("second", span, second_fingerprints):
            return cached
        if self.plan.system.gap_m is None:
            second = self.frame.record_first_modulator(recorder, span, cached)
        else:
            target = cached if self.frame.works_in_place else None
            first = self._record_first_rows(span, recorder, first_fingerprints, target)
            second = self.frame.record_second_modulator(recorder, span, first, cached)
        if cached is not None:
            self._set_field_fingerprints("second", span, second_fingerprints, recorder)
        return second

    def _record_first_rows(
        self,
        span: WavelengthSpan,
        recorder: CommandRecorder,
        fingerprints: list[Fingerprint],
        uncached_target: BufferRegion | None,
    ) -> BufferRegion:
        """The field behind the first of two modulators: the stored one, else recomputed.

        It is written to the cache, or to `uncached_target` if the cache has no room or isn't used.
        """
        cached = self._fields.region("first", span) if self._caches_first_field else None
        if cached is not None and self._fields.is_current("first", span, fingerprints):
            return cached
        if cached is None:
            return self.frame.record_first_modulator(recorder, span, uncached_target)
        self._set_field_fingerprints("first", span, fingerprints, recorder)
        return self.frame.record_first_modulator(recorder, span, cached)

    def _set_field_fingerprints(
        self, name: FieldName, span: WavelengthSpan, fingerprints: Sequence[Fingerprint], recorder: CommandRecorder
    ) -> None:
        """Set the fingerprints of recorded fields once their work is submitted; until then they have none.

        They aren't set if the strategy has changed in between, because the spectra are in the order of the old one.
        """
        self._fields.set_fingerprints(name, span, [None] * span.count)
        strategy = self.frame.strategy

        def set_if_same_strategy() -> None:
            if self.frame.strategy == strategy:
                self._fields.set_fingerprints(name, span, fingerprints)

        recorder.on_submit(set_if_same_strategy)

    def _set_xyz_fingerprint(self, fingerprint: Fingerprint, recorder: CommandRecorder) -> None:
        """Set the fingerprint of XYZ once the recorded work is submitted; until then it has none."""
        self.xyz_fingerprint = None
        recorder.on_submit(partial(setattr, self, "xyz_fingerprint", fingerprint))

    def _record_composite(
        self, recorder: CommandRecorder, intensity: Buffer, terms: Sequence[WeightedIntensity], *, accumulates: bool
    ) -> None:
        self.compositor.composite(recorder, intensity, terms, self.xyz_buffer, accumulates=accumulates)
        self.frame.dispatch_counts["composite"] += 1


def has_no_dense_maps(inputs: ShaderInputs) -> bool:
    """Whether no relay has a pupil and no modulator's transmission is given sample by sample."""
    return inputs.sampled_transmissions is None and all(pupil is None for pupils in inputs.pupils for pupil in pupils)
