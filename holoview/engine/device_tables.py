"""Device buffers with the inputs of the fused kernels, and fingerprints that tell when a result is stale.

The buffers are rewritten in place when the bench is edited, so that bound dispatches stay valid. Two results are equal
if the bytes of their inputs are equal: `field_fingerprints` and `relay_fingerprint` return digests of these bytes, and
nothing else decides what an edit makes stale.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from hashlib import blake2b

import numpy as np

from holoview.engine.shader_inputs import ShaderInputs
from holoview.engine.shader_structs import (
    MODULATOR,
    PLANE_WAVE,
    PROPAGATION,
    dense_transmission,
    modulator_uniform,
    pixel_spectra,
    plane_wave_uniform,
    propagation_uniform,
    support_table,
)
from holoview.gpu.device import Buffer, Device
from holoview.model.plan import Plan

_SUPPORT_BYTES = 16  # of a vec4i: the frequencies that pass in a column

Key = tuple[str | int, ...]
Fingerprint = Hashable
"""Equal for equal inputs."""


class DeviceTables:
    """The inputs of a plan's kernels in device memory. A key is a name followed by indices:

    ("plane waves",)                          PlaneWave of each source and wavelength
    ("pixel spectra",)                        spectrum of one pixel in each of these waves, along y, then along x
    ("modulators", modulator)                 Modulator of each wavelength
    ("opd", frame, modulator)                 optical path of each pixel, in strokes
    ("dense", frame, modulator, wavelength)   transmission of each sample, if it is given sample by sample
    ("propagations", relay)                   Propagation of each wavelength
    ("support", relay)                        column support of each wavelength
    ("pupil", relay, wavelength)              pupil of a relay, if it apodises or aberrates
    """

    def __init__(self, device: Device, plan: Plan, inputs: ShaderInputs) -> None:
        self.plan, self.inputs = plan, inputs
        self._device = device
        self._tables: dict[Key, Buffer] = {}
        self._digests: dict[Key, tuple[bytes, ...]] = {}
        self._items: dict[Key, list[bytes]] = {}
        self._support_rows: dict[tuple[int, int], bytes] = {}  # of which the support by columns is among the items
        self._no_table = device.upload(np.zeros(1, np.complex64), "no table")
        self._fill_inputs()
        self.set_plan(plan, inputs)

    def set_plan(self, plan: Plan, inputs: ShaderInputs) -> None:
        """Replace the plan by one with the same grid and the same numbers of wavelengths, frames and sources.

        The distance of relay 1 stays that of the last `set_distance`.
        """
        has_changed = inputs is not self.inputs
        self.plan, self.inputs = plan, inputs
        wavelengths, sources = range(len(plan.system.wavelengths_m)), range(len(plan.slopes))
        waves = [plane_wave_uniform(plan, wavelength, source) for source in sources for wavelength in wavelengths]
        self._fill(("plane waves",), [PLANE_WAVE.pack(**values) for values in waves])
        spectra = [pixel_spectra(plan, wavelength, source) for source in sources for wavelength in wavelengths]
        self._fill(("pixel spectra",), [spectrum.tobytes() for spectrum in spectra])
        for modulator in range(len(plan.system.modulators)):
            strokes = [modulator_uniform(plan, modulator, wavelength) for wavelength in wavelengths]
            self._fill(("modulators", modulator), [MODULATOR.pack(**values) for values in strokes])
        if has_changed:
            self._fill_inputs()
        if plan.system.gap_m is not None:
            self.set_distance(0, plan.system.gap_m)

    def set_distance(self, relay: int, distance_m: float, wavelengths: Iterable[int] | None = None) -> None:
        """Set the propagation distance of relay 0 (the gap) or 1 (to a plane), at all wavelengths or some.

        It holds for all work that hasn't been submitted yet, including recorded work.
        """
        grid, count = self.plan.grid, len(self.plan.system.wavelengths_m)
        propagations = list(self._items.get(("propagations", relay), [bytes(PROPAGATION.size)] * count))
        columns = grid.padded[1]
        supports = list(self._items.get(("support", relay), [bytes(_SUPPORT_BYTES * columns)] * count))
        for wavelength in range(count) if wavelengths is None else wavelengths:
            step = self.plan.transfer(relay, wavelength, distance_m)
            propagations[wavelength] = PROPAGATION.pack(**propagation_uniform(step))
            rows = step.support.tobytes()
            if self._support_rows.get((relay, wavelength)) != rows:  # most edits leave the stops as they are
                self._support_rows[relay, wavelength] = rows
                supports[wavelength] = support_table(step, grid).tobytes()
        for name, items in (("propagations", propagations), ("support", supports)):
            self._items[name, relay] = items
            self._fill((name, relay), items)

    def table(self, *key: str | int) -> Buffer:
        """The buffer of a key."""
        return self._tables[key]

    def pupil(self, relay: int, wavelength: int) -> tuple[bool, Buffer]:
        """Whether the relay has a pupil at that wavelength, and its buffer; a dummy buffer if it has none."""
        return self._optional("pupil", relay, wavelength)

    def dense(self, frame: int, modulator: int, wavelength: int) -> tuple[bool, Buffer]:
        """Whether a modulator's transmission is given sample by sample, and its buffer; a dummy buffer if it isn't."""
        return self._optional("dense", frame, modulator, wavelength)

    def _optional(self, *key: str | int) -> tuple[bool, Buffer]:
        table = self._tables.get(key)
        return table is not None, table or self._no_table

    def is_tilted(self, source: int, wavelengths: range) -> bool:
        """Whether the plane wave of a source is tilted at any of some wavelengths."""
        return bool(np.any(self.plan.slopes[source, wavelengths.start : wavelengths.stop]))

    # --- fingerprints -----------------------------------------------------------------------------------------------

    def field_fingerprints(self, frame: int, source: int, wavelength: int) -> tuple[Fingerprint, Fingerprint]:
        """Fingerprints of the fields behind the first and behind the last modulator."""
        wave = source * len(self.plan.system.wavelengths_m) + wavelength
        first = (self._digests[("plane waves",)][wave], *self._modulator_fingerprint(0, frame, wavelength))
        if self.plan.system.gap_m is None:
            return first, first
        gap = self.relay_fingerprint(wavelength, relay=0)
        return first, (first, gap, *self._modulator_fingerprint(1, frame, wavelength))

    def relay_fingerprint(self, wavelength: int, relay: int = 1) -> Fingerprint:
        """Fingerprint of the propagation through a relay: over the gap (0) or to the plane (1)."""
        tables = tuple(self._digests[name, relay][wavelength] for name in ("propagations", "support"))
        return (*tables, self._digests.get(("pupil", relay, wavelength)))

    def _modulator_fingerprint(self, modulator: int, frame: int, wavelength: int) -> tuple[Fingerprint, ...]:
        dense = self._digests.get(("dense", frame, modulator, wavelength))
        return dense or (self._digests["modulators", modulator][wavelength], self._digests["opd", frame, modulator])

    # --- filling ----------------------------------------------------------------------------------------------------

    def _fill_inputs(self) -> None:
        """Fill the tables of the inputs: optical paths, transmissions and pupils."""
        for frame in range(self.plan.system.frames):
            for index, modulator in enumerate(self.plan.system.modulators):
                strokes = self.inputs.stroke_fractions(frame, index, modulator.stroke_m)
                self._fill(("opd", frame, index), [strokes.tobytes()])
                self._fill_dense(frame, index)
        for relay, pupils in enumerate(self.inputs.pupils):
            for wavelength, pupil in enumerate(pupils):
                key = ("pupil", relay, wavelength)
                if pupil is not None:
                    self._fill(key, [pupil.cpu().numpy().astype(np.complex64).tobytes()])
                else:
                    self._drop(key)

    def _fill_dense(self, frame: int, modulator: int) -> None:
        """Fill the transmissions of a modulator's samples, if it has any, at the wavelengths with light."""
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
        """Write the concatenated `items` to the buffer of a key, unless they are there already."""
        digests = tuple(blake2b(item, digest_size=16).digest() for item in items)
        if self._digests.get(key) == digests:
            return
        data = b"".join(items)
        if key not in self._tables or self._tables[key].nbytes != len(data):
            self._tables[key] = self._device.buffer(len(data), " ".join(map(str, key)))
        self._device.write(self._tables[key], data)
        self._digests[key] = digests
