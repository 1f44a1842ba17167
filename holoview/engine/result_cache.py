"""The results of a session on the device: what each was computed from, and how those that are stale are recorded.

Each result has the identity of what it was computed from, and is stale when that is no longer the identity that the
bench gives. It has none while it is written, until all of that is submitted, since work may be dropped half way. What
has no room is computed again when it is needed, and so is what has never been of use twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from holoview.engine.compositor import Compositor, WeightedIntensity
from holoview.engine.device_cache import FieldCache, FrameWavelength, IntensityCache, XyzWeight
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
    """How a session computes: see `FrameSession`."""

    budget_bytes: int
    max_wavelengths: int


class ResultCache:
    """Memory on a device for the results of a plan, none of which is known at first, and the kernels that make them.

    Raises UserError when the grid exceeds the device's limits.
    """

    def __init__(
        self,
        plan: Plan,
        inputs: ShaderInputs,
        fused_kernels: FusedKernels,
        settings: RenderSettings,
        strategy: Strategy,
    ) -> None:
        together, device = settings.max_wavelengths if has_no_dense_maps(inputs) else 1, fused_kernels.device
        self.frame = FusedFrame(
            plan, inputs, device, max_wavelengths=together, strategy=strategy, fused_kernels=fused_kernels
        )
        self.compositor = Compositor(device, plan.grid.shape)
        self.xyz_buffer, self.srgb_buffer = self.compositor.xyz_buffer("XYZ"), self.compositor.srgb_buffer("picture")
        self.xyz_fingerprint: Fingerprint = None
        self.srgb_fingerprint: Fingerprint = None
        lit_first = sorted(np.ndindex(*plan.weights.shape), key=lambda lit: plan.weights[lit] == 0)
        self._slices = IntensityCache(self.compositor, lit_first, together, settings.budget_bytes)
        self._shelf = FieldCache(self.frame, settings.budget_bytes - self._slices.memory_bytes)
        self._caches_first_field = False

    @property
    def plan(self) -> Plan:
        """What is to be computed."""
        return self.frame.tables.plan

    @property
    def memory_bytes(self) -> int:
        """Memory on the device that fields and intensities take."""
        return self.frame.memory_bytes + self._shelf.memory_bytes + self._slices.memory_bytes

    def set_plan(self, plan: Plan, inputs: ShaderInputs, plane_m: float) -> None:
        """Go on with a plan of the same structure."""
        before = self._rows_identities()
        self.frame.tables.set_plan(plan, inputs)
        self.frame.tables.set_distance(1, plane_m)
        self._caches_first_field |= self._is_gap_edit(before)

    def use_strategy(self, strategy: Strategy) -> None:
        """Go on by another strategy. Intensities stay; fields are spectra along x in the order of the one before."""
        self.frame.use_strategy(strategy)
        self._shelf.invalidate()

    def invalidate(self) -> None:
        """Everything is stale."""
        self._slices.fingerprints.clear()
        self._shelf.invalidate()
        self.xyz_fingerprint = self.srgb_fingerprint = None

    # --- what is stale ----------------------------------------------------------------------------------------------

    def is_resident(self, lit: FrameWavelength) -> bool:
        """Whether an intensity has a place of its own."""
        return self._slices.is_resident(lit)

    def is_current(self, lit: FrameWavelength) -> bool:
        """Whether an intensity is there and what the bench gives now."""
        return self.is_resident(lit) and self._slices.fingerprints.get(lit) == self.intensity_fingerprint(lit)

    def intensity_fingerprint(self, lit: FrameWavelength) -> Fingerprint:
        """What the intensity of a frame and wavelength is computed from."""
        frame, wavelength = lit
        inputs = self.frame.tables
        rows = tuple(inputs.field_fingerprints(frame, source, wavelength)[1] for source in range(len(self.plan.slopes)))
        return rows, inputs.relay_fingerprint(wavelength)

    def _rows_identities(self) -> tuple[Fingerprint, Fingerprint]:
        """What the first and the second rows of the first laser that is lit are computed from."""
        frame, wavelength = np.argwhere(self.plan.weights > 0)[0].tolist()
        return self.frame.tables.field_fingerprints(frame, 0, wavelength)

    def _is_gap_edit(self, before: tuple[Fingerprint, Fingerprint]) -> bool:
        """Whether the first rows would have been of use after an edit, and may be kept for the next one like it.

        They aren't kept from the start: it costs each frame a copy, since kernels then can't work in place.
        """
        first, second = self._rows_identities()
        fields = 2 * len(self.plan.slopes) * int(np.count_nonzero(self.plan.weights))
        return first == before[0] and second != before[1] and self._shelf.has_room_for(fields)

    # --- recording --------------------------------------------------------------------------------------------------

    def accumulate_intensity(self, span: WavelengthSpan, recorder: CommandRecorder) -> None:
        """Adds the light of a source to the intensities of a span, or begins them with the first source."""
        second = self._record_last_field(span, recorder)
        keys = [(span.frame, span.wavelength + i) for i in range(span.count)]
        self._slices.fingerprints.update(dict.fromkeys(keys))
        self.frame.record_intensity(recorder, span, second, self._slices.region(keys[0]), accumulates=span.source > 0)
        if span.source == len(self.plan.slopes) - 1:
            complete = {key: self.intensity_fingerprint(key) for key in keys}
            recorder.on_submit(partial(self._slices.fingerprints.update, complete))

    def composite_resident(
        self, weights: dict[FrameWavelength, XyzWeight], seen_of: Fingerprint, recorder: CommandRecorder
    ) -> None:
        """Begins XYZ with the intensities that stay where they are."""
        self._see(seen_of, recorder)
        if not self._slices.buffers:
            recorder.clear(self.xyz_buffer)
        housed = {key: weight for key, weight in weights.items() if self.is_resident(key)}
        for number, bank in enumerate(self._slices.buffers):
            self._composite(recorder, bank, self._slices.blend_terms(housed, bank), accumulates=number > 0)

    def composite_transient(
        self,
        run: WavelengthSpan,
        weights: dict[FrameWavelength, XyzWeight],
        seen_of: Fingerprint,
        recorder: CommandRecorder,
    ) -> None:
        """Adds intensities to XYZ before the next ones take their place."""
        some = {key: weights[key] for key in ((run.frame, run.wavelength + i) for i in range(run.count))}
        place = self._slices.region((run.frame, run.wavelength))
        self._composite(recorder, place.buffer, self._slices.blend_terms(some, place.buffer), accumulates=True)
        self._see(seen_of, recorder)

    def encode_srgb(self, exposure_stops: float, picture_of: Fingerprint, recorder: CommandRecorder) -> None:
        """Makes the picture of a complete XYZ."""
        self.compositor.encode_srgb(recorder, self.xyz_buffer, self.srgb_buffer, exposure_stops)
        self.frame.dispatch_counts["show"] += 1
        self.srgb_fingerprint = None
        recorder.on_submit(partial(setattr, self, "srgb_fingerprint", picture_of))

    def intensity(self, lit: FrameWavelength) -> NDArray[np.float32]:
        """An intensity at unit amplitude, (y, x), as it was last computed."""
        place = self._slices.region(lit)
        return self.compositor.download_intensity(place.buffer, place.first)

    def _record_last_field(self, span: WavelengthSpan, recorder: CommandRecorder) -> BufferRegion:
        """The light behind the last modulator: what is kept of it, else computed from as far on as possible."""
        wavelengths = range(span.wavelength, span.wavelength + span.count)
        of = [self.frame.tables.field_fingerprints(span.frame, span.source, wavelength) for wavelength in wavelengths]
        first_of, second_of = [first for first, _ in of], [second for _, second in of]
        home = self._shelf.region("second", span)
        if home is not None and self._shelf.is_current("second", span, second_of):
            return home
        if self.plan.system.gap_m is None:
            rows = self.frame.record_first_modulator(recorder, span, home)
        else:
            first = self._record_first_field(span, recorder, first_of, home if self.frame.works_in_place else None)
            rows = self.frame.record_second_modulator(recorder, span, first, home)
        if home is not None:
            self._mark("second", span, second_of, recorder)
        return rows

    def _record_first_field(
        self,
        span: WavelengthSpan,
        recorder: CommandRecorder,
        first_of: list[Fingerprint],
        otherwise: BufferRegion | None,
    ) -> BufferRegion:
        """The light behind the first of two modulators, kept, or computed where it is kept or else `otherwise`."""
        home = self._shelf.region("first", span) if self._caches_first_field else None
        if home is not None and self._shelf.is_current("first", span, first_of):
            return home
        if home is None:
            return self.frame.record_first_modulator(recorder, span, otherwise)
        self._mark("first", span, first_of, recorder)
        return self.frame.record_first_modulator(recorder, span, home)

    def _mark(
        self, name: str, span: WavelengthSpan, identities: Sequence[Fingerprint], recorder: CommandRecorder
    ) -> None:
        """Fields that are being written count as those of `identities` once all of that is submitted.

        They don't where another strategy has been taken meanwhile: they are spectra in the order of the one before.
        """
        self._shelf.set_fingerprints(name, span, [None] * span.count)
        strategy = self.frame.strategy

        def mark() -> None:
            if self.frame.strategy == strategy:
                self._shelf.set_fingerprints(name, span, identities)

        recorder.on_submit(mark)

    def _see(self, seen_of: Fingerprint, recorder: CommandRecorder) -> None:
        """The same for XYZ."""
        self.xyz_fingerprint = None
        recorder.on_submit(partial(setattr, self, "xyz_fingerprint", seen_of))

    def _composite(
        self, recorder: CommandRecorder, intensity: Buffer, shares: Sequence[WeightedIntensity], *, accumulates: bool
    ) -> None:
        self.compositor.composite(recorder, intensity, shares, self.xyz_buffer, accumulates=accumulates)
        self.frame.dispatch_counts["composite"] += 1


def has_no_dense_maps(inputs: ShaderInputs) -> bool:
    """Whether no relay has a pupil, and no modulator a transmission of its samples."""
    return inputs.sampled_transmissions is None and all(pupil is None for pupils in inputs.pupils for pupil in pupils)
