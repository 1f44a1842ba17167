"""One of the fields whose intensities add up on the camera, and the light with which it illuminates the modulators."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from holoview.model.effects.hook_contexts import ModulatorContext
from holoview.model.plan import Plan
from holoview.optics.source import pixel_wave, plane_wave

Tensor = torch.Tensor


@dataclass(frozen=True)
class IncoherentComponent:
    """A field that is coherent in itself: one wavelength and source direction of a plan, at one moment of an exposure.

    path_factor: what multiplies all optical paths at that moment (flicker of a modulator).
    laser: number of the laser among those of the session, 0 for the shortest wavelength.
    slm_frame: (rows, columns) of the modulators that the plan's are the middle of; their own where None.
    """

    wavelength_index: int
    source_index: int
    path_factor: float
    laser: int = 0
    slm_frame: tuple[int, int] | None = None

    def wavelength_m(self, plan: Plan) -> float:
        """The wavelength."""
        return float(plan.system.wavelengths_m[self.wavelength_index])

    def slopes(self, plan: Plan) -> tuple[float, float]:
        """Phase slopes (y, x) of the illumination in turns per sample; (0, 0) for normal incidence."""
        slope_y, slope_x = plan.slopes[self.source_index, self.wavelength_index].tolist()
        return slope_y, slope_x

    def modulator_context(self, plan: Plan, number: int) -> ModulatorContext:
        """What the hooks of effects need to know of modulator `number` (0 or 1) at this wavelength."""
        modulator = plan.system.modulators[number]
        return ModulatorContext(
            number=number,
            wavelength_m=self.wavelength_m(plan),
            stroke_m=modulator.stroke_m,
            pitch_m=modulator.pitch_m,
            shape=modulator.shape,
            upsample=plan.grid.upsample,
            laser=self.laser,
            frame=self.slm_frame,
        )

    def illuminate(self, plan: Plan, transmission: Tensor, dtype: torch.dtype) -> Tensor:
        """The field behind the first modulator: its transmission (pixels or samples) times the incident plane wave."""
        if not any(self.slopes(plan)):
            return transmission
        wave = pixel_wave if tuple(transmission.shape) == plan.system.modulators[0].shape else plane_wave
        return transmission * wave(plan, self.wavelength_index, self.source_index, dtype, transmission.device)
