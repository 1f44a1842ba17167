"""The common part of the models of intensity on a camera: fields whose intensities add up, modulators, a cache.

`near_field_model` and `fourier_model` have the same modulators and different light paths behind them.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass

import torch

from holoview.captures.camera_sampling import PixelGrid
from holoview.model.bench_parts import Relay
from holoview.model.effects.effect import MODULATOR_HOOKS
from holoview.model.effects.hook_contexts import ModulatorContext
from holoview.model.plan import Plan
from holoview.optics.torch_effects import TorchEffects, modulator_context

Tensor = torch.Tensor
Key = tuple[Hashable, ...]


@dataclass(frozen=True)
class IncoherentComponent:
    """A field that is coherent in itself: one wavelength and source direction of a plan, at one moment of an exposure.

    path_factor: factor of all optical paths at that moment (flicker of a modulator).
    laser: number of the laser among those of the captures, 0 for the shortest wavelength.
    slm_frame: (rows, columns) of the modulators that the plan's are the middle of; their own where None.
    """

    wavelength: int
    source: int
    path_factor: float
    laser: int = 0
    slm_frame: tuple[int, int] | None = None


class CameraModel:
    """Intensities on the camera at the first plane of a plan: the part that doesn't depend on the geometry.

    plan: of the bench with its effects on distances, angles, wavelengths and apertures. effects: their other hooks.
    relays: the nominal relays 1 and 2, whose stops normalise pupil coordinates.
    cache: keeps intermediate results; a key names all values that its result depends on.
    earlier: the drives that were sent before a pattern, and first of all; None where no effect asks for them.
    focal_length_m: of the lens of a Fourier bench; 0 in the near field.
    """

    def __init__(
        self,
        plan: Plan,
        effects: TorchEffects,
        relays: tuple[Relay, Relay],
        pixel_grid: PixelGrid,
        dtype: torch.dtype,
        cache: TensorCache,
        earlier: tuple[Tensor, Tensor] | None = None,
        focal_length_m: float = 0.0,
    ) -> None:
        self.plan, self.effects, self.relays, self.pixel_grid = plan, effects, relays, pixel_grid
        self.focal_length_m = focal_length_m
        self.dtype, self.cache, self.earlier = dtype, cache, earlier
        self.real_dtype = torch.float64 if dtype == torch.complex128 else torch.float32

    def wavelength_m(self, component: IncoherentComponent) -> float:
        """The wavelength of a component."""
        return float(self.plan.system.wavelengths_m[component.wavelength])

    def slopes(self, component: IncoherentComponent) -> tuple[float, float]:
        """Phase slopes (y, x) of the illumination in turns per sample; (0, 0) for normal incidence."""
        slope_y, slope_x = self.plan.slopes[component.source, component.wavelength].tolist()
        return slope_y, slope_x

    def context(self, number: int, component: IncoherentComponent) -> ModulatorContext:
        """The context of the hooks on modulator `number` (0 or 1)."""
        return modulator_context(self.plan, number, component.wavelength, component.laser, component.slm_frame)

    def transmission(self, drive: Tensor, number: int, component: IncoherentComponent) -> Tensor:
        """Complex transmission of a modulator, of pixels, or of samples where an effect needs them.

        It doesn't depend on the direction of the source. drive: of the capture, (modulator, y, x).
        """
        earlier = [patterns[number].to(self.real_dtype) for patterns in self.earlier or ()]
        return self.effects.modulator_transmission(
            drive[number].to(self.real_dtype),
            self.context(number, component),
            self.dtype,
            component.path_factor,
            *earlier,
        )

    def modulator_key(self, number: int, component: IncoherentComponent) -> Key:
        """Names all values that the light behind a modulator depends on, beside its pattern and the incoming light."""
        hooks = self.effects.cache_key(*MODULATOR_HOOKS, acts_on=f"modulator {number + 1}", laser=component.laser)
        source = self.effects.cache_key("transmission", acts_on="source") if number == 0 else ()
        stroke_m = self.plan.system.modulators[number].stroke_m
        return number, component.path_factor, self.wavelength_m(component), stroke_m, hooks, source


class TensorCache:
    """Tensors by a key that names everything they were computed from.

    Beyond `max_bytes` in all, the least recently used tensors are dropped; the latest one always stays.
    """

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes, self._bytes = max_bytes, 0
        self._tensors: OrderedDict[Hashable, torch.Tensor] = OrderedDict()

    def get(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """The tensor of that key, computed if it isn't in the cache."""
        cached = self._tensors.get(key)
        if cached is not None:
            self._tensors.move_to_end(key)
            return cached
        computed = compute()
        self._tensors[key] = computed
        self._bytes += computed.nbytes
        while self._bytes > self._max_bytes and len(self._tensors) > 1:
            self._bytes -= self._tensors.popitem(last=False)[1].nbytes
        return computed

    def get_invariant(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """As `get`, for a tensor that no effect changes and through which no gradient flows."""
        return self.get(key, compute)


class InvariantCache(TensorCache):
    """Caches, in another cache, only the tensors that no effect changes; all others are computed anew.

    For calls with gradients: a cached tensor would belong to the computation graph of an earlier call.
    """

    def __init__(self, store: TensorCache) -> None:
        super().__init__(0)
        self._store = store

    def get(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """The tensor, computed anew."""
        return compute()

    def get_invariant(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """The tensor of that key, computed if it isn't in the other cache."""
        return self._store.get(key, compute)
