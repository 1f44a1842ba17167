"""Intensity on a camera behind a chain of elements: the stages of `engine.frame` with the effects of captures.

The light behind each step of the way is kept under a key that names all that it depends on, so that a fit of an effect
on a late element doesn't compute the light before it anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from holoview.bench.captures.camera_model import (
    POSE_HOOKS,
    FrequencyBand,
    IncoherentComponent,
    Key,
    PixelGrid,
    TensorCache,
    camera_picture,
)
from holoview.light.engine.frame import light_along
from holoview.light.engine.torch_executor import TorchField, TorchPropagation
from holoview.light.model.effects.effect import MODULATOR_HOOKS
from holoview.light.model.elements import Pixels
from holoview.light.model.plan import Plan
from holoview.light.model.system import System
from holoview.light.optics.bench import pupil_without_effects, relay_response
from holoview.light.optics.chain import ChainTransmissions
from holoview.light.optics.torch_effects import TorchEffects, effects_pupil

Tensor = torch.Tensor


class ChainModel:
    """Intensities on the camera at the first plane of a plan.

    plan: of the chain with its effects on distances, angles, wavelengths and apertures. effects: their other hooks.
    nominal: the chain without effects. earlier: the patterns by element that were sent before, and first of all.
    """

    def __init__(
        self,
        plan: Plan,
        effects: TorchEffects,
        nominal: System,
        pixel_grid: PixelGrid,
        dtype: torch.dtype,
        cache: TensorCache,
        earlier: tuple[dict[str, Tensor], dict[str, Tensor]] | None = None,
    ) -> None:
        self.plan, self.effects, self.nominal = plan, effects, nominal
        self.pixel_grid, self.dtype, self.cache, self.earlier = pixel_grid, dtype, cache, earlier

    def intensity(self, drive: dict[str, Tensor], component: IncoherentComponent, capture: int) -> Tensor:
        """|E|² (y, x) on the camera for unit power in one component.

        drive: patterns (rows, columns) by the names of elements. capture: its index, for the cache.
        """
        stages = _Stages(self, drive, component, capture)
        *_, (_, last) = light_along(stages, component.wavelength, 0, component.source)
        seen = stages.transmit(last, self.plan.way.last, component.wavelength)
        pose_key = self.effects.cache_key(*POSE_HOOKS)

        def picture() -> Tensor:
            pose = self.effects.camera_pose(float(self.plan.planes_m[0]))
            spectrum = stages.spectrum_in_band(seen, self.plan.way.last)
            return camera_picture(*spectrum, self.plan.grid, self.pixel_grid, pose, self.effects.camera_motion())

        return self.cache.get((stages.key, "intensity", pose_key), picture)


class _Stages(TorchPropagation):
    """The stages of one component of a capture; `key` names all that the light so far depends on."""

    def __init__(
        self, model: ChainModel, drive: dict[str, Tensor], component: IncoherentComponent, capture: int
    ) -> None:
        super().__init__(model.plan, _Inputs(model, drive, component), double=model.dtype == torch.complex128)
        self._model, self._component = model, component
        self.key: Key = (capture,)

    def illuminate(self, wavelength: int, source: int) -> TorchField:
        slopes = tuple(self.plan.slopes[source, wavelength].tolist())
        λ = float(self.plan.system.wavelengths_m[wavelength])
        source_key = self._model.effects.cache_key("transmission", acts_on="source")
        self.key = (*self.key, slopes, λ, self.plan.grid, source_key, self._component.path_factor)
        return super().illuminate(wavelength, source)

    def modulate(self, field: TorchField, frame: int, modulator: int, wavelength: int) -> TorchField:
        of, inputs = self.plan.way.transmissions[modulator], self._modulators
        assert isinstance(inputs, _Inputs)
        name, laser = inputs.name_of(of.element), self._component.laser
        hooks = self._model.effects.cache_key(*MODULATOR_HOOKS, acts_on=name, laser=laser)
        self.key = (*self.key, of.element, of.place, hooks)
        return TorchField(self._kept(lambda: super(_Stages, self).modulate(field, frame, modulator, wavelength).values))

    def transmit(self, spectrum: TorchField, relay: int, wavelength: int, plane: int = 0) -> TorchField:
        self.key = (*self.key, *self._relay_key(relay, wavelength))
        return super().transmit(spectrum, relay, wavelength, plane)

    def _kept(self, compute: Any) -> Tensor:
        return self._model.cache.get(self.key, compute)

    def _relay_key(self, relay: int, wavelength: int) -> Key:
        way = self.plan.way
        hooks = self._model.effects.on_parts(way.relay_names[relay], "pupil")
        values = tuple((effect.id, v.cache_key) for effect, v in hooks)
        distance_m = self.plan.transfer(relay, wavelength).distance_m
        λ = float(self.plan.system.wavelengths_m[wavelength])
        ky, kx = self.frequencies(relay)  # which follow from all wavelengths of the plan
        band = (len(ky), int(ky.min()), len(kx), int(kx.min()))
        stops = (way.relays[relay], way.orders_m[relay], way.kernel(relay))
        return relay, *stops, distance_m, λ, self.plan.grid, band, values

    def transfer(self, relay: int, wavelength: int, plane: int = 0) -> Tensor:
        """Kept also where gradients are recorded, unless an effect changes the pupil: none flows through it then."""

        def compute() -> Tensor:
            pupil = pupil_without_effects(self.plan, relay, wavelength)
            added = effects_pupil(self.plan, relay, wavelength, self._model.effects, self._model.nominal)
            both = added if pupil is None else pupil if added is None else pupil * added
            transfer = self.plan.transfer(relay, wavelength, plane)
            return relay_response(transfer, *self._frequency_tensors(relay), both, self.dtype)

        key, cache = ("relay of a chain", *self._relay_key(relay, wavelength)), self._model.cache
        is_changed = self._model.effects.on_parts(self.plan.way.relay_names[relay], "pupil")
        return cache.get(key, compute) if is_changed else cache.get_invariant(key, compute)

    def spectrum_in_band(self, seen: TorchField, relay: int) -> tuple[Tensor, FrequencyBand]:
        """A spectrum behind a relay in the smallest band that holds it, of a field that begins at its first sample."""
        ky, kx = self._frequency_tensors(relay)
        padded, offset = self.plan.grid.padded, self.plan.grid.offset
        band = FrequencyBand(padded, (int(ky.abs().max()), int(kx.abs().max())))
        rows, columns = (len(k) for k in band.frequency_indices)
        held = torch.zeros((rows, columns), dtype=seen.values.dtype)
        held[(ky % rows)[:, None], (kx % columns)[None, :]] = seen.values
        return band.displaced(held, (-offset[0], -offset[1])), band


class _Inputs(ChainTransmissions):
    """The patterns of one capture, as `TorchPropagation` asks for them."""

    def __init__(self, model: ChainModel, drive: dict[str, Tensor], component: IncoherentComponent) -> None:
        super().__init__(model.plan, drive, model.effects, component.laser)
        self._earlier, self._path_factor = model.earlier or ({}, {}), component.path_factor

    def patterns(self, element: Pixels, frame: int) -> tuple[Sequence[Any], float]:
        """Those of the capture, of that before and of the first."""
        name = self.name_of(element)
        return [self._drives[name], *(earlier.get(name) for earlier in self._earlier)], self._path_factor

    def path_m(self, frame: int, modulator: int) -> Tensor:
        """Never asked for: all elements are given by samples."""
        raise AssertionError

    def transmission(self, frame: int, modulator: int, wavelength: int) -> Tensor:
        """The transmission (y, x) of the samples at a step of the way."""
        return self.sampled_transmission(frame, modulator, wavelength)
