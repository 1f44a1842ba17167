"""Rows of a focal plane: from the fields of all beams to the image, its loss, and back to the fields' gradients.

Everything that an evaluation does with the samples of a plane happens here, in one pass over a block of rows: the
squares of the fields, the mixture of lasers to colours, the loss and its slope, and the mixture back to lasers. Real
and imaginary parts stay interleaved, so that each step is one over consecutive numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from holoview.optimise.amplitudes import AmplitudeLeastSquares, NormalEquations
from holoview.optimise.objective import Objective, ResidualSums
from holoview.optimise.process_group import ProcessGroup

Tensor = torch.Tensor


@dataclass(frozen=True)
class RowResult:
    """What a block of rows adds to an evaluation; None where it wasn't requested.

    image_products: Σ ∂L/∂image·intensity (channel, own laser), float64.
    """

    sums: ResidualSums
    normal_equations: NormalEquations | None
    image_products: Tensor | None


@dataclass(frozen=True)
class RowEvaluation:
    """Evaluates blocks of rows of planes. To be called by `ForwardModel.process_planes`; threads may share it.

    weights (own laser, channel): what a laser's unit intensity adds to the image. least_squares: None if amplitudes
    aren't solved for. picture: where to write the image (channel, y, x) of the plane `pictured_plane`.
    """

    objective: Objective
    group: ProcessGroup
    weights: Tensor
    least_squares: AmplitudeLeastSquares | None
    needs_gradient: bool
    needs_image_products: bool
    picture: Tensor
    pictured_plane: int

    def __call__(self, plane: int, rows: slice, fields: Tensor) -> RowResult:
        """The result of rows of a plane. fields (laser, source, row, x): E, replaced by c_E if a gradient is needed."""
        parts = torch.view_as_real(fields)
        squares = parts.new_empty(parts.shape)
        torch.mul(parts, parts, out=squares)
        beam_weights = beam_weights_of(self.weights, fields.shape[1])
        image = _pair_sums((beam_weights.T @ squares.flatten(0, 1).flatten(1)).view(-1, *parts.shape[2:]))
        self.group.all_reduce_sum(image)
        if plane == self.pictured_plane:
            self.picture[:, rows] = image
        intensity = None
        if self.least_squares is not None or self.needs_image_products:
            intensity = _pair_sums(squares.mean(dim=1) if fields.shape[1] > 1 else squares[:, 0])
        normal_equations = None
        if self.least_squares is not None and intensity is not None:
            normal_equations = self._normal_equations(plane, rows, intensity, self.least_squares)
        sums = self.objective.evaluate_rows(plane, rows, image)  # image is now ∂L/∂image
        products = None
        if self.needs_image_products and intensity is not None:
            products = (image.flatten(1) @ intensity.flatten(1).T).double().cpu()
        if self.needs_gradient:
            replace_by_adjoint(fields, beam_weights, image, squares)
        return RowResult(sums, normal_equations, products)

    def _normal_equations(
        self, plane: int, rows: slice, intensity: Tensor, least_squares: AmplitudeLeastSquares
    ) -> NormalEquations | None:
        cut = self.objective.cut_region(rows)
        if cut is None:
            return None
        inside, inside_target = cut
        return least_squares.normal_equations(intensity[inside], self.objective.target[plane][inside_target])


def beam_weights_of(weights: Tensor, sources: int) -> Tensor:
    """The share of each beam in the channels, (beam, channel). weights (own laser, channel): of unit intensities."""
    return weights.repeat_interleave(sources, dim=0) / sources


def replace_by_adjoint(fields: Tensor, beam_weights: Tensor, slopes: Tensor, scratch: Tensor) -> None:
    """Replaces fields E (laser, source, row, x) by c_E = 2·g·conj(E), with g the slopes weighted for each beam.

    slopes (channel, row, x): ∂L/∂image. scratch: of the shape of the fields' real and imaginary parts, overwritten.
    """
    # g·(1 − i): pairs (g, −g) for the real and the imaginary part of conj(E)
    pairs = torch.view_as_real(slopes.to(fields.dtype).mul_(1 - 1j)).flatten(1)
    torch.mm(2 * beam_weights, pairs, out=scratch.view(len(beam_weights), -1))
    torch.view_as_real(fields).mul_(scratch)


def _pair_sums(values: Tensor) -> Tensor:
    """Sums of the pairs in the last axis."""
    return values[..., 0] + values[..., 1]
