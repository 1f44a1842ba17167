"""The loss of complex fields: how far the light of each laser is from a given field, but for a factor of its own.

With the field E of a beam in a plane and the wanted field T, inside the region,

    L = mean over planes and beams of min_c ‖c·E − T‖²/‖T‖² = 1 − |⟨T, E⟩|²/(‖T‖²·‖E‖²),   ⟨T, E⟩ = Σ conj(T)·E

so that neither the laser's power nor a constant phase counts. Powers are chosen for the picture, by least squares; the
phases of a laser's light relative to other planes and other lasers can't be seen. The overlap |⟨T, E⟩|/(‖T‖·‖E‖) is the
root of the fidelity, as slmsuite and others define it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.fields.field_target import FieldTarget
from holoview.holograms.optimise.objective import (
    AmplitudeLeastSquares,
    Objective,
    ResidualSums,
    RowResult,
    beam_weights_of,
)
from holoview.holograms.optimise.propagation import Kernels
from holoview.holograms.optimise.settings import Settings
from holoview.light.model.focus import focused_planes
from holoview.light.model.system import System
from holoview.util.errors import UserError

Tensor = torch.Tensor


@dataclass(frozen=True, eq=False)
class ComplexTarget:
    """A target of `iterate` whose phases count too.

    stack: (plane, y, x, 3) linear sRGB of its light, by which lasers' powers are chosen. fields: (plane, frame,
    wavelength, y, x) complex64, wanted of each laser, on the samples of the simulation; one frame holds for all.
    """

    stack: NDArray[np.float32]
    fields: NDArray[np.complex64]

    @classmethod
    def of(cls, scene: FieldTarget, system: System) -> ComplexTarget:
        """The light of a field in the planes of a system. Raises UserError as `FieldTarget.fields` does."""
        planes_m = focused_planes(system)
        fields = np.stack([scene.fields(system, float(plane_m)) for plane_m in planes_m])
        if fields.shape[1] not in (1, system.frames):
            raise UserError(
                "target", f"{fields.shape[1]} frames", expected=f"one, or {system.frames} as the system has"
            )
        return cls(scene.images(system, planes_m), fields)

    def of_lasers(self, lasers: list[tuple[int, int]]) -> Tensor:
        """The fields (plane, laser, y, x) of lasers that are given as pairs of frame and wavelength."""
        frames = self.fields.shape[1]
        chosen = [self.fields[:, frame if frames > 1 else 0, wavelength] for frame, wavelength in lasers]
        return torch.from_numpy(np.stack(chosen, axis=1))


def check_suits(system: System, settings: Settings, processes: int) -> None:
    """Raises UserError for settings that this loss can't have: free wavelengths, few levels, several processes."""
    if "wavelengths" in settings.free:
        raise UserError("free", "wavelengths with a complex target", expected="patterns and amplitudes")
    if settings.loss is not None:
        raise UserError("loss", f'"{settings.loss}" with a complex target', expected="none: its fields are compared")
    if any(getattr(element, "levels", None) is not None for element in system.elements):
        raise UserError("levels", "with a complex target", expected="modulators that are continuous")
    if settings.pupil_places_m or settings.drawn_pupils or processes > 1:
        found = "places of a pupil" if processes == 1 else f"{processes} processes"
        raise UserError("target", f"a complex one with {found}", expected="a picture for these")


@dataclass(frozen=True)
class FieldEvaluation:
    """Evaluates whole planes by their fields; their images give the PSNR, and the lasers' powers by least squares.

    To be called by `ForwardModel.process_planes`. wanted (plane, laser, y, x). Other fields: as in `RowEvaluation`.
    """

    objective: Objective
    wanted: Tensor
    weights: Tensor
    least_squares: AmplitudeLeastSquares | None
    kernels: Kernels
    needs_gradient: bool
    picture: Tensor
    pictured_plane: int

    def __call__(self, plane: int, rows: slice, fields: Tensor) -> RowResult:
        """The result of a plane. fields (laser, source, y, x): E, replaced by c_E if a gradient is needed."""
        image = self.kernels.mix(fields, beam_weights_of(self.weights, fields.shape[1]))
        if plane == self.pictured_plane:
            self.picture.copy_(image)
        inside = (slice(None), *self.objective.region_slices)
        equations = None
        if self.least_squares is not None:
            squares = fields.abs().square().mean(dim=1)
            equations = self.least_squares.normal_equations(squares[inside], self.objective.target[plane][inside])
        sums = self.objective.evaluate_rows(plane, rows, image, self.kernels)
        loss = self._replace_by_adjoint(plane, fields)
        numbers = self.objective.target[0][inside].numel()
        norms = sums.norms.clone()
        norms[0] = math.sqrt(max(loss, 0.0) * numbers)
        return RowResult(ResidualSums(norms), equations, None)

    def _replace_by_adjoint(self, plane: int, fields: Tensor) -> float:
        """The mean loss of the beams of a plane, whose fields are replaced by c_E = ∂L/∂Re E − i·∂L/∂Im E."""
        inside = (..., *self.objective.region_slices)
        light, wanted = fields[inside], self.wanted[plane][:, None][inside].to(fields)
        overlap = (wanted.conj() * light).sum(dim=(-2, -1), keepdim=True)
        powers = [values.abs().square().sum(dim=(-2, -1), keepdim=True) for values in (wanted, light)]
        product = (powers[0] * powers[1]).clamp_min(torch.finfo(powers[0].dtype).tiny)
        fidelity = overlap.abs().square() / product
        beams = fields.shape[0] * fields.shape[1]
        if self.needs_gradient:
            share = 2 * float(self.objective.plane_weights[plane]) / (len(self.wanted) * beams)
            slopes = fidelity / powers[1].clamp_min(torch.finfo(powers[0].dtype).tiny) * light.conj()
            slopes = share * (slopes - overlap.conj() / product * wanted.conj())
            fields.zero_()
            fields[inside] = slopes
        return float((1 - fidelity).double().mean())


def infidelity(light: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """1 − |⟨T, E⟩|²/(‖T‖²·‖E‖²) of fields (…, y, x), (…), of which torch takes the derivative."""
    overlap = (wanted.conj() * light).sum(dim=(-2, -1)).abs().square()
    powers = [values.abs().square().sum(dim=(-2, -1)) for values in (wanted, light)]
    return 1 - overlap / (powers[0] * powers[1]).clamp_min(torch.finfo(powers[0].dtype).tiny)


def split_target(
    target: NDArray[np.floating] | ComplexTarget,
) -> tuple[NDArray[np.floating], ComplexTarget | None]:
    """The focal stack of a target, and the target itself where it is complex."""
    return (target.stack, target) if isinstance(target, ComplexTarget) else (target, None)
