"""The tables that the fused kernels read, on the device, and what identifies them.

Tables are rewritten in place when the bench is edited, so that whatever is bound to them stays bound. Two results are
the same if the bytes that they are computed from are the same: `rows_of` and `plane_of` tell these, as digests, and
nothing else decides what an edit makes stale.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from hashlib import blake2b
from typing import TYPE_CHECKING

import numpy as np

from holoview.engine.shader_structs import MODULATOR, PLANE_WAVE, PROPAGATION
from holoview.engine.uniforms import (
    column_support,
    dense_transmission,
    modulator_uniform,
    plane_wave_uniform,
    propagation_uniform,
)
from holoview.gpu.device import Buffer, Device
from holoview.model.plan import Plan

if TYPE_CHECKING:
    from holoview.optics.frame_inputs import AnyFrameInputs

_STOPS_BYTES = 8

Key = tuple[str | int, ...]
Fingerprint = Hashable
"""Equal for equal inputs."""


class DeviceTables:
    """Tables of a plan and its slots: waves; lights, paths, samples of modulators; paths, stops, pupils of relays."""

    def __init__(self, device: Device, plan: Plan, inputs: AnyFrameInputs) -> None:
        self.plan, self.inputs = plan, inputs
        self._device = device
        self._tables: dict[Key, Buffer] = {}
        self._digests: dict[Key, tuple[bytes, ...]] = {}
        self._items: dict[Key, list[bytes]] = {}
        self._no_table = device.upload(np.zeros(1, np.complex64), "no table")
        self._fill_slots()
        self.set_plan(plan, inputs)

    def set_plan(self, plan: Plan, inputs: AnyFrameInputs) -> None:
        """Go on with another plan of the same grid and the same numbers of wavelengths, frames and sources."""
        changed = inputs is not self.inputs
        self.plan, self.inputs = plan, inputs
        wavelengths, sources = range(len(plan.system.wavelengths_m)), range(len(plan.slopes))
        self._fill(
            ("waves",), [PLANE_WAVE.pack(**plane_wave_uniform(plan, w, s)) for s in sources for w in wavelengths]
        )
        for modulator in range(len(plan.system.modulators)):
            self._fill(
                ("lights", modulator), [MODULATOR.pack(**modulator_uniform(plan, modulator, w)) for w in wavelengths]
            )
        if changed:
            self._fill_slots()
        if plan.system.gap_m is not None:
            self.set_distance(0, plan.system.gap_m)

    def set_distance(self, relay: int, distance_m: float, wavelengths: Iterable[int] | None = None) -> None:
        """Where relay 0 (the gap) or 1 (to a plane) leads, at all wavelengths or some, for all that isn't submitted."""
        grid, count = self.plan.grid, len(self.plan.system.wavelengths_m)
        paths = list(self._items.get(("paths", relay), [bytes(PROPAGATION.size)] * count))
        stops = list(self._items.get(("stops", relay), [bytes(_STOPS_BYTES * (grid.padded[1] // 2 + 1))] * count))
        for wavelength in range(count) if wavelengths is None else wavelengths:
            step = self.plan.transfer(relay, wavelength, distance_m)
            paths[wavelength] = PROPAGATION.pack(**propagation_uniform(step))
            stops[wavelength] = column_support(step, grid).tobytes()
        for name, items in (("paths", paths), ("stops", stops)):
            self._items[name, relay] = items
            self._fill((name, relay), items)

    def table(self, *key: str | int) -> Buffer:
        """The table of a name and its numbers: ("waves",), ("lights", modulator), ("opd", frame, modulator), …"""
        return self._tables[key]

    def pupil(self, relay: int, wavelength: int) -> tuple[bool, Buffer]:
        """Whether the relay has a pupil at that wavelength, and its table; any table when it has none."""
        return self._optional("pupil", relay, wavelength)

    def dense(self, frame: int, modulator: int, wavelength: int) -> tuple[bool, Buffer]:
        """Whether a modulator has a transmission of samples, and its table; any table when it has none."""
        return self._optional("dense", frame, modulator, wavelength)

    def _optional(self, *key: str | int) -> tuple[bool, Buffer]:
        found = self._tables.get(key)
        return found is not None, found or self._no_table

    def is_tilted(self, source: int, wavelengths: range) -> bool:
        """Whether any of the waves of a source falls in at an angle."""
        return bool(np.any(self.plan.slopes[source, wavelengths.start : wavelengths.stop]))

    # --- what results depend on -------------------------------------------------------------------------------------

    def field_fingerprints(self, frame: int, source: int, wavelength: int) -> tuple[Fingerprint, Fingerprint]:
        """What the light behind the first and behind the last modulator is computed from."""
        number = source * len(self.plan.system.wavelengths_m) + wavelength
        first = (self._digests[("waves",)][number], *self._modulator_fingerprint(0, frame, wavelength))
        if self.plan.system.gap_m is None:
            return first, first
        return first, (
            first,
            self.relay_fingerprint(wavelength, relay=0),
            *self._modulator_fingerprint(1, frame, wavelength),
        )

    def relay_fingerprint(self, wavelength: int, relay: int = 1) -> Fingerprint:
        """What the way through a relay is computed from: to the plane, or over the gap."""
        tables = tuple(self._digests[name, relay][wavelength] for name in ("paths", "stops"))
        return (*tables, self._digests.get(("pupil", relay, wavelength)))

    def _modulator_fingerprint(self, modulator: int, frame: int, wavelength: int) -> tuple[Fingerprint, ...]:
        dense = self._digests.get(("dense", frame, modulator, wavelength))
        return dense or (self._digests["lights", modulator][wavelength], self._digests["opd", frame, modulator])

    # --- filling ----------------------------------------------------------------------------------------------------

    def _fill_slots(self) -> None:
        """Optical paths and pupils."""
        for frame in range(self.plan.system.frames):
            for modulator, panel in enumerate(self.plan.system.modulators):
                maps = self.inputs.stroke_fractions(frame, modulator, panel.stroke_m)
                self._fill(("opd", frame, modulator), [maps.tobytes()])
                self._fill_dense(frame, modulator)
        for relay, pupils in enumerate(self.inputs.pupils):
            for wavelength, pupil in enumerate(pupils):
                key = ("pupil", relay, wavelength)
                if pupil is not None:
                    self._fill(key, [pupil.cpu().numpy().astype(np.complex64).tobytes()])
                else:
                    self._drop(key)

    def _fill_dense(self, frame: int, modulator: int) -> None:
        """Transmissions of a modulator's samples at the wavelengths that are lit, where effects give it any."""
        for wavelength in range(len(self.plan.system.wavelengths_m)):
            key = ("dense", frame, modulator, wavelength)
            if self.inputs.is_sampled(modulator) and self.plan.weights[frame, wavelength] > 0:
                self._fill(key, [dense_transmission(self.inputs, frame, modulator, wavelength).tobytes()])
            else:
                self._drop(key)

    def _drop(self, key: Key) -> None:
        if key in self._tables:
            del self._tables[key], self._digests[key]

    def _fill(self, key: Key, items: list[bytes]) -> None:
        """The table of that key holds `items` for all that isn't submitted."""
        digests = tuple(blake2b(item, digest_size=16).digest() for item in items)
        if self._digests.get(key) == digests:
            return
        data = b"".join(items)
        if key not in self._tables or self._tables[key].nbytes != len(data):
            self._tables[key] = self._device.buffer(len(data), " ".join(map(str, key)))
        self._device.write(self._tables[key], data)
        self._digests[key] = digests
