"""The stages of a chain as its optimisation needs them: transfer functions of all wavelengths are kept."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import torch

from holoview.light.engine.torch_executor import TorchExecutor, TorchField
from holoview.light.model.plan import Plan
from holoview.light.optics.bench import pupil_with_effects, relay_response
from holoview.light.optics.frame_inputs import FrameInputs

Tensor = torch.Tensor


class ChainExecutor(TorchExecutor):
    """Keeps the transfer functions and stops of all wavelengths; each plane is seen by an eye of its own."""

    _stops_of: Plan | None = None

    def held_at(self, plan: Plan) -> ChainExecutor:
        """The executor of a plan of other wavelengths, whose stops pass the frequencies that these pass."""
        moved = self._with_plan(plan)
        moved._stops_of = self.plan
        return moved

    def seen_from(self, plan: Plan) -> ChainExecutor:
        """The executor of a plan whose planes are seen from other places of the pupil (`Plan.seen_from`)."""
        moved, last = self._with_plan(plan), plan.way.last
        to_planes = (self.derived_transfer.__name__, last)
        moved._all_kept = {key: one for key, one in self._all_kept.items() if key[:2] != to_planes}
        return moved

    def _with_plan(self, plan: Plan) -> ChainExecutor:
        moved = copy.copy(self)
        moved.plan, moved.inputs = plan, dark_inputs(plan)
        moved._modulators = moved.inputs
        moved._all_kept = {}
        return moved

    def fields(self, spectrum: TorchField, wavelength: int, planes: Sequence[int]) -> Tensor:
        """E (plane, y, x) at some planes of the spectrum behind the last element."""
        return torch.stack([self._field_at(spectrum, wavelength, plane) for plane in planes])

    def intensities(self, behind: Iterable[tuple[list[TorchField], int]], planes: Sequence[int]) -> Tensor:
        """|E|² (laser, plane, y, x) there, summed over the sources of each laser.

        behind: for each laser, the spectra of its light from each source behind the last element, and its wavelength.
        """
        lasers = []
        for spectra, λ in behind:
            lasers.append(summed_sources([self._intensity_of(spectrum, λ, planes) for spectrum in spectra]))
        return torch.stack(lasers)

    def _intensity_of(self, spectrum: TorchField, wavelength: int, planes: Sequence[int]) -> Tensor:
        return torch.stack([power(self._field_at(spectrum, wavelength, plane)) for plane in planes])

    def passed_power(self, spectrum: TorchField, wavelength: int) -> Tensor:
        """|W|² (rows, columns) of the spectrum behind the last element, behind the stops there."""
        return power(spectrum.values * self.passed(wavelength))

    def _field_at(self, spectrum: TorchField, wavelength: int, plane: int) -> Tensor:
        last = self.plan.way.last
        return self.field(self.transmit(spectrum, last, wavelength, plane), last).values

    def passed(self, wavelength: int) -> Tensor:
        """|Stops × pupil| of the last relay, (rows, columns)."""
        return self._kept(self._derived_passed, wavelength)

    def _derived_passed(self, wavelength: int) -> Tensor:
        return self.stops(wavelength).abs()

    def transfer(self, relay: int, wavelength: int, plane: int = 0) -> Tensor:
        """As there."""
        return self._kept(self.derived_transfer, relay, wavelength, plane)

    def derived_transfer(self, relay: int, wavelength: int, plane: int = 0) -> Tensor:
        """As there."""
        found, held = (plan.transfer(relay, wavelength, plane) for plan in (self.plan, self._stops_of or self.plan))
        transfer, eye = replace(found, support=held.support), self.plan.planes[plane].eye
        if relay != self.plan.way.last or eye == self.plan.nominal.eye:
            return self._response(transfer, relay, wavelength)
        pupil = pupil_with_effects(self.plan, relay, wavelength, eye)
        return relay_response(transfer, *self._frequency_tensors(relay), pupil, self.dtype)

    def stops(self, wavelength: int, relay: int | None = None) -> Tensor:
        """As there."""
        return self._kept(self._derived_stops, wavelength, self.plan.way.last if relay is None else relay)

    def _derived_stops(self, wavelength: int, relay: int) -> Tensor:
        found, held = (plan.stops(relay, wavelength) for plan in (self.plan, self._stops_of or self.plan))
        return self._response(replace(found, support=held.support), relay, wavelength)

    def _kept(self, derive: Any, *arguments: Any) -> Tensor:
        key = (derive.__name__, *arguments)
        if key not in self._all_kept:
            self._all_kept[key] = derive(*arguments)
        return self._all_kept[key]

    @cached_property
    def _all_kept(self) -> dict[Any, Tensor]:
        return {}


def summed_sources(parts: list[Tensor]) -> Tensor:
    """The sum of tensors of equal shape; of one, itself."""
    return parts[0] if len(parts) == 1 else torch.stack(parts).sum(dim=0)


def power(values: Tensor) -> Tensor:
    """|·|² of complex values of any shape."""
    return values.real.square() + values.imag.square()


def dark_inputs(plan: Plan) -> FrameInputs:
    """Inputs of dark patterns, in whose place others are shown."""
    return FrameInputs(plan, {name: np.zeros(shape) for name, shape in plan.nominal.drive_shapes.items()})
