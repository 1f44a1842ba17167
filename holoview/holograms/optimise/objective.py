"""The loss of a focal stack, its derivative, and the laser amplitudes that make it smallest.

`Objective`               the loss in a colour space, inside a region, weighted by plane: squared errors, or structure
`torch_srgb_encode`       the curve of encoded sRGB, and its derivative
`RowEvaluation`           rows of a focal plane: image, loss and the gradients of the fields, in one pass
`AmplitudeLeastSquares`   laser amplitudes by non-negative least squares
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.optimise.parallel import SINGLE_PROCESS, ProcessGroup
from holoview.holograms.optimise.propagation import TORCH_KERNELS, Kernels, PlanePropagation
from holoview.holograms.optimise.settings import LossSpace, Settings, find_loss_space
from holoview.light.model.plan import Plan
from holoview.light.numerics.sampling import Region, region_slices, zero_outside
from holoview.light.numerics.structural_similarity import WINDOW, multi_scale_similarity, scale_count
from holoview.util.errors import UserError

Tensor = torch.Tensor
Floats = NDArray[np.float64]
Cut = tuple[slice, slice, slice]


@dataclass(frozen=True)
class PlaneLoss:
    """A plane's part of the loss, and its PSNR (dB) clipped to 0…1: of linear sRGB, or of the only channel."""

    loss: float
    psnr_db: float


@dataclass(frozen=True)
class ResidualSums:
    """norms (2,): over some rows, of the residuals, and of the errors from which the PSNR follows; on the device.

    The squared residuals of a structural loss include its weight times 1 − MS-SSIM for each number of the image.
    """

    norms: Tensor


class Objective:
    """L = Σ_k weight_k·[mean(residual_k²) + structure_weight·(1 − MS-SSIM_k)]/K over K planes, inside the region.

    Brightness is fixed: 1 is the display's white, and no scale factor is fitted. target (plane, channel, y, x): linear,
    before any encoding. wavelength_channels (wavelength, channel): of unit intensity. region_slices: of (y, x).
    """

    def __init__(
        self,
        loss: LossSpace,
        wavelength_channels: Tensor,
        target: Tensor,
        plane_weights: NDArray[np.float64],
        region: Region | None,
    ):
        self.loss, self.wavelength_channels = loss, wavelength_channels
        self.plane_weights = plane_weights
        rows, columns = target.shape[-2:]
        self.region_slices = region_slices(region or (0, 0, columns, rows))
        matrix = loss.to_rgb
        is_linear_srgb = matrix is not None and np.allclose(matrix, np.eye(3))
        self._to_rgb = None if matrix is None or is_linear_srgb else torch.as_tensor(matrix).to(target)
        # squared errors of the channels that the PSNR is defined on
        self.is_plain = self._to_rgb is None and not loss.is_encoded and loss.structure_weight == 0
        self.target = target

    @property
    def is_whole(self) -> bool:
        """Whether all samples count: the region is the image."""
        return all(part == slice(0, n) for part, n in zip(self.region_slices, self.target.shape[-2:], strict=True))

    def set_stack(self, stack: NDArray[np.floating]) -> None:
        """Changes to another focal stack (plane, y, x, 3) in linear sRGB, of the same shape.

        Raises UserError for another shape, and for numbers that aren't finite.
        """
        planes, _, rows, columns = self.target.shape
        _check_stack(stack, (planes, rows, columns, 3))
        self.target.copy_(_target_channels(self.loss, stack))

    def loss_of(self, image: Tensor, planes: Sequence[int] | None = None) -> Tensor:
        """The loss of an image (plane, channel, y, x) of some planes, all when None; torch takes its derivative."""
        inside, parts = (slice(None), *self.region_slices), []
        for shown, plane in zip(image, planes or range(len(self.target)), strict=True):
            shown, wanted, weight = shown[inside], self.target[plane][inside], self.plane_weights[plane]
            if self.loss.is_encoded:
                shown, wanted = torch_srgb_encode(shown), torch_srgb_encode(wanted)
            part = (shown - wanted).square().mean()
            if self.loss.structure_weight:
                part = part + self.loss.structure_weight * (1 - multi_scale_similarity(shown, wanted).mean())
            parts.append(float(weight) * part)
        return torch.stack(parts).mean()

    def psnr_db(self, image: Tensor, planes: Sequence[int] | None = None) -> float:
        """The PSNR of an image (plane, channel, y, x) as of `PlaneLoss`, mean over some planes, all when None."""
        inside, planes = (slice(None), *self.region_slices), planes or range(len(self.target))
        pairs = zip(image, planes, strict=True)
        norms = [self._error_norm(shown[inside], self.target[plane][inside]) for shown, plane in pairs]
        both = torch.stack(norms)[:, None, None].expand(-1, 1, 2)
        return float(np.mean([one.psnr_db for one in self.plane_losses(planes, both)]))

    def evaluate_rows(self, plane: int, rows: slice, image: Tensor, kernels: Kernels = TORCH_KERNELS) -> ResidualSums:
        """Sums over rows of a plane's image (channel, row, x), which is overwritten with ∂L/∂image.

        A structural loss takes all rows at once (`needs_whole_planes`).
        """
        cut = self.cut_region(rows)
        if cut is None:
            image.zero_()
            return ResidualSums(image.new_zeros(2))
        inside, inside_target = cut
        cropped, target = image[inside], self.target[plane][inside_target]
        if self.is_plain:
            norms = kernels.replace_by_residual(cropped, target, self.slope_of_residual(plane))
        else:
            norms = self._replace_by_slopes(plane, cropped, target)
        zero_outside(image, *inside[1:])
        return ResidualSums(torch.stack(norms))

    def _replace_by_slopes(self, plane: int, cropped: Tensor, target: Tensor) -> tuple[Tensor, Tensor]:
        """Replaces an image by ∂L/∂image, for losses of any kind; returns the norms of `ResidualSums`."""
        error_norm = self._error_norm(cropped, target)
        derivative = torch_srgb_encode_derivative(cropped) if self.loss.is_encoded else None
        if self.loss.is_encoded:
            cropped.copy_(torch_srgb_encode(cropped))
            target = torch_srgb_encode(target)
        structure = _structural_part(cropped, target, self.loss.structure_weight)
        residual_norm = torch.linalg.vector_norm(cropped.sub_(target))
        cropped.mul_(2 * self._sample_weight(plane))
        if structure is not None:
            residual_norm = torch.hypot(residual_norm, structure.norm)
            cropped.add_(structure.slopes, alpha=self._sample_weight(plane))
        if derivative is not None:
            cropped.mul_(derivative)
        return residual_norm, error_norm

    @property
    def needs_whole_planes(self) -> bool:
        """Whether `evaluate_rows` has to be given all rows of a plane at once."""
        return self.loss.structure_weight > 0

    def plane_losses(self, planes: Sequence[int], norms: Tensor) -> list[PlaneLoss]:
        """The losses of planes from norms (plane, part, 2) over all parts of their rows (`ResidualSums.norms`)."""
        rows, columns = self.region_slices
        numbers = (rows.stop - rows.start) * (columns.stop - columns.start) * (1 if self.target.shape[1] == 1 else 3)
        squares = norms.double().square().sum(dim=1).tolist()
        return [
            PlaneLoss(self._sample_weight(plane) * residual, -10 * math.log10(max(error / numbers, 1e-20)))
            for plane, (residual, error) in zip(planes, squares, strict=True)
        ]

    def cut_region(self, rows: slice) -> tuple[Cut, Cut] | None:
        """Slices (channel, y, x) of the region in a block of rows, and in a whole plane; None if it lies elsewhere."""
        region_rows, columns = self.region_slices
        start, stop = max(rows.start, region_rows.start), min(rows.stop, region_rows.stop)
        if start >= stop:
            return None
        channels = slice(None)
        return (channels, slice(start - rows.start, stop - rows.start), columns), (
            channels,
            slice(start, stop),
            columns,
        )

    def picture(self, image: Tensor) -> NDArray[np.floating]:
        """An image (channel, y, x) as linear sRGB (y, x, 3); grey where there is only one channel."""
        if len(image) == 1:
            image = image.expand(3, -1, -1)
        elif self._to_rgb is not None:
            image = torch.einsum("rc,cyx->ryx", self._to_rgb, image)
        return image.movedim(0, -1).cpu().numpy().copy()

    def slope_of_residual(self, plane: int) -> float:
        """The factor from image − target to ∂L/∂image, of a plain loss."""
        return 2 * self._sample_weight(plane)

    def _sample_weight(self, plane: int) -> float:
        """The part of the loss of one squared residual, of one channel of one sample."""
        rows, columns = self.region_slices
        samples = (rows.stop - rows.start) * (columns.stop - columns.start)
        return float(self.plane_weights[plane]) / (len(self.target) * self.target.shape[1] * samples)

    def _error_norm(self, image: Tensor, target: Tensor) -> Tensor:
        """The norm of the difference of images in linear sRGB, or of the only channel, clipped to 0…1."""
        if self._to_rgb is not None:
            image, target = (torch.einsum("rc,cyx->ryx", self._to_rgb, t) for t in (image, target))
        return torch.linalg.vector_norm(image.clamp(0, 1).sub_(target.clamp(0, 1)))


@dataclass(frozen=True)
class _StructuralPart:
    """s·n·(1 − MS-SSIM) of an image of n numbers: its root, and its slopes (channel, y, x)."""

    norm: Tensor
    slopes: Tensor


def _structural_part(image: Tensor, target: Tensor, weight: float) -> _StructuralPart | None:
    """The structural part of a loss of images (channel, y, x) with the weight s; None where that is 0.

    Channel by channel, because the slopes take some hundred images of memory.
    """
    if weight == 0:
        return None
    total, slopes = image.new_zeros(()), torch.empty_like(image)
    for channel in range(len(image)):
        with torch.enable_grad():
            variable = image[channel : channel + 1].detach().clone().requires_grad_()
            similarity = multi_scale_similarity(variable, target[channel : channel + 1]).sum()
            part = weight * variable.numel() * (1 - similarity)
            (slopes[channel : channel + 1],) = torch.autograd.grad(part, variable)
        total += part.detach()
    return _StructuralPart(total.clamp_min(0).sqrt(), slopes)


def make_objective(
    plan: Plan, stack: NDArray[np.floating], settings: Settings, *, device: str = "cpu", double: bool = False
) -> Objective:
    """The objective for a focal stack (plane, y, x, 3) in linear sRGB, on the plan's planes and simulation grid.

    double: compute in float64. Raises UserError when the stack, the region or the planes' weights don't fit the plan.
    """
    planes, shape = len(plan.planes_m), plan.grid.shape
    _check_stack(stack, (planes, *shape, 3))
    loss = find_loss_space(settings.loss_for(plan.system.observer))
    target = _target_channels(loss, stack).to(torch.float64 if double else torch.float32).to(device)
    return Objective(
        loss,
        channels_of_wavelengths(loss, plan, target),
        target,
        _plane_weights(settings, planes),
        _checked_region(settings, shape, loss),
    )


def _check_stack(stack: NDArray[np.floating], expected: tuple[int, ...]) -> None:
    """Raises UserError for a stack of another shape, without light, or with values that aren't finite."""
    if stack.shape != expected:
        raise UserError("target", f"a stack of shape {stack.shape}", expected=f"(plane, y, x, 3) = {expected}")
    if not np.isfinite(stack).all():
        raise UserError("target", "a value that isn't a finite number", expected="linear light")
    if not np.any(stack > 0):
        raise UserError("target", "is black everywhere", expected="some light above 0")


def _target_channels(loss: LossSpace, stack: NDArray[np.floating]) -> Tensor:
    """The channels (plane, channel, y, x) of a stack (plane, y, x, 3)."""
    return torch.as_tensor(np.ascontiguousarray(np.moveaxis(loss.channels_of_rgb(stack), -1, 1)))


def channels_of_wavelengths(loss: LossSpace, plan: Plan, like: Tensor) -> Tensor:
    """Channels (wavelength, channel) of unit intensity at each wavelength."""
    return torch.as_tensor(loss.channels_of_xyz(plan.colour_weights).copy()).to(like.dtype).to(like.device)


def _plane_weights(settings: Settings, planes: int) -> NDArray[np.float64]:
    """The settings' weights, scaled to a mean of 1."""
    if settings.plane_weights is None:
        return np.ones(planes)
    weights = np.asarray(settings.plane_weights, dtype=np.float64)
    if len(weights) != planes:
        raise UserError("plane weights", f"{len(weights)} of them", expected=f"one for each of {planes} planes")
    return weights * (planes / weights.sum())


def _checked_region(settings: Settings, shape: tuple[int, int], loss: LossSpace) -> Region | None:
    x, y, width, height = settings.region or (0, 0, shape[1], shape[0])
    if settings.region is not None and (x + width > shape[1] or y + height > shape[0]):
        found = f"x, y, w, h = {x}, {y}, {width}, {height}"
        raise UserError("region", found, expected=f"inside the simulated {shape[1]} x {shape[0]} samples")
    if loss.structure_weight and scale_count((height, width)) == 0:
        expected = f"at least {WINDOW} rows and columns for this loss, {WINDOW * 16} for all of its scales"
        raise UserError("loss", f"images of {width} x {height} samples", expected=expected)
    return settings.region


# --- the curve of encoded sRGB ---------------------------------------------------------------------------------------

_SRGB_KNEE, _SRGB_SLOPE = 0.0031308, 12.92  # IEC 61966-2-1


def torch_srgb_encode(light: Tensor) -> Tensor:
    """sRGB's curve (IEC 61966-2-1) of linear light of any shape, continued to negative values as an odd function."""
    magnitude = light.abs()
    curve = 1.055 * magnitude.clamp_min(_SRGB_KNEE) ** (1 / 2.4) - 0.055
    return torch.where(magnitude <= _SRGB_KNEE, _SRGB_SLOPE * light, torch.copysign(curve, light))


def torch_srgb_encode_derivative(light: Tensor) -> Tensor:
    """Derivative of `torch_srgb_encode`: at most 12.92."""
    magnitude = light.abs().clamp_min(_SRGB_KNEE)
    return torch.where(magnitude <= _SRGB_KNEE, _SRGB_SLOPE, (1.055 / 2.4) * magnitude ** (1 / 2.4 - 1))


# --- rows of a plane -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RowResult:
    """The part of a block of rows in an evaluation; None where it wasn't requested.

    image_products: Σ ∂L/∂image·intensity (channel, own laser), float64.
    """

    sums: ResidualSums
    normal_equations: NormalEquations | None
    image_products: Tensor | None


@dataclass(frozen=True)
class RowEvaluation:
    """Evaluates blocks of rows of planes: fields of all beams, image, loss, and the gradients of the fields.

    All operations on the samples of a plane happen here, while a block of rows is in the cache: the squares of the
    fields, the mixture of lasers to colours, the loss and its slope, and the mixture back to lasers. To be called by
    `ForwardModel.process_planes`; threads may share it.

    weights (own laser, channel): what a laser's unit intensity adds to the image. least_squares: None if amplitudes
    aren't solved for. picture: where to write the image (channel, y, x) of the plane `pictured_plane`.
    """

    objective: Objective
    group: ProcessGroup
    weights: Tensor
    least_squares: AmplitudeLeastSquares | None
    kernels: Kernels
    needs_gradient: bool
    needs_image_products: bool
    picture: Tensor
    pictured_plane: int

    def __call__(self, plane: int, rows: slice, fields: Tensor) -> RowResult:
        """The result of rows of a plane. fields (laser, source, row, x): E, replaced by c_E if a gradient is needed."""
        beam_weights = beam_weights_of(self.weights, fields.shape[1])
        image = self.kernels.mix(fields, beam_weights)
        self.group.all_reduce_sum(image)
        if plane == self.pictured_plane:
            self.picture[:, rows] = image
        intensity = None
        if self.least_squares is not None or self.needs_image_products:
            intensity = _mean_intensity(fields)
        normal_equations = None
        if self.least_squares is not None and intensity is not None:
            normal_equations = self._normal_equations(plane, rows, intensity, self.least_squares)
        sums = self.objective.evaluate_rows(plane, rows, image, self.kernels)  # image is now ∂L/∂image
        products = None
        if self.needs_image_products and intensity is not None:
            products = (image.flatten(1) @ intensity.flatten(1).T).double().cpu()
        if self.needs_gradient:
            self.kernels.replace_by_adjoint(fields, beam_weights, image)
        return RowResult(sums, normal_equations, products)

    @property
    def is_plain(self) -> bool:
        """Whether `evaluate_lines` computes everything wanted: squared errors, their gradients, normal equations."""
        objective = self.objective
        is_plain = objective.is_plain and objective.is_whole and not self.needs_image_products
        return is_plain and self.group.size == 1

    def evaluate_lines(self, plane: int, rows: slice, lines: Tensor, propagation: PlanePropagation) -> RowResult:
        """The result of rows of a plane from its lines of E (laser, source, y, k_x); theirs become those of c_E."""
        least_squares = self.least_squares
        norms, products = propagation.evaluate_rows(
            lines,
            rows,
            beam_weights_of(self.weights, lines.shape[1]),
            self.objective.target[plane],
            self.objective.slope_of_residual(plane),
            self.picture if plane == self.pictured_plane else None,
            carry_back=self.needs_gradient,
            correlates=least_squares is not None,
        )
        equations = None if least_squares is None else least_squares.of_beams(products)
        return RowResult(ResidualSums(norms), equations, None)

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
    if sources == 1:
        return weights
    return weights[:, None].expand(-1, sources, -1).flatten(0, 1) / sources


def _mean_intensity(fields: Tensor) -> Tensor:
    """|E|² (laser, row, x) of fields (laser, source, row, x), mean over sources."""
    squares = torch.view_as_real(fields).square()
    mean = squares.mean(dim=1) if fields.shape[1] > 1 else squares[:, 0]
    return mean[..., 0] + mean[..., 1]


# --- laser amplitudes in closed form ---------------------------------------------------------------------------------

# Intensities of neighbouring wavelengths are nearly parallel, and rounding makes their float32 Gram matrix indefinite:
# eigenvalues below this fraction of the largest are raised to it.
_EIGENVALUE_FLOOR = 1e-6


@dataclass(frozen=True)
class NormalEquations:
    """The rows of own lasers, for some samples: gram (own laser, laser) and right_hand_side (own laser,)."""

    gram: Floats
    right_hand_side: Floats


class AmplitudeLeastSquares:
    """Laser amplitudes by non-negative least squares, since the image is linear in them.

        minimise Σ_{plane, channel, pixel} (Σ_j a_j·M_jc·I_j − T_c)²   over a ≥ 0

    with the intensity I_j of laser j at unit amplitude, its colour M_jc and the target T_c. Only the Gram matrix
    G_ij = (I_i·I_j)(M_i·M_j) and the right-hand side b_i = Σ_c M_ic (I_i·T_c) are needed; both are accumulated part by
    part. In a process group, each process fills the rows of its own lasers.

    laser_channels (laser, channel): what each laser of the whole process group adds to the image at unit amplitude and
    intensity.
    """

    def __init__(self, laser_channels: Floats, group: ProcessGroup = SINGLE_PROCESS) -> None:
        count = len(laser_channels)
        self._laser_channels, self._group = laser_channels, group
        self._own_rows = group.shard(count)
        self._gram, self._right_hand_side = np.zeros((count, count)), np.zeros(count)

    def normal_equations(self, intensity: Tensor, target: Tensor) -> NormalEquations:
        """The part of some samples: intensity (own laser, …) at unit amplitude, target (channel, …) of equal trailing
        shape."""
        own_images, target_channels = intensity.flatten(1), target.flatten(1)
        gram = np.zeros((len(own_images), len(self._laser_channels)))
        for columns, images in self._group.broadcast_shards(own_images, len(self._laser_channels)):
            gram[:, columns] = (own_images @ images.T).cpu().double().numpy()
        return self._equations(gram, (own_images @ target_channels.T).cpu().double().numpy())

    def of_beams(self, products: Floats) -> NormalEquations:
        """The same of all lasers from sums of products of beams, as `PlanePropagation.evaluate_rows` returns them."""
        lasers, beams = len(self._laser_channels), len(products)
        gram = np.triu(products[:, :beams]) + np.triu(products[:, :beams], 1).T
        if beams == lasers:
            return self._equations(gram, products[:, beams:])
        mean = np.kron(np.eye(lasers), np.full(beams // lasers, lasers / beams))  # over the sources of a laser
        return self._equations(mean @ gram @ mean.T, mean @ products[:, beams:])

    def _equations(self, gram: Floats, products: Floats) -> NormalEquations:
        """products (own laser, channel): of intensities and the target."""
        return NormalEquations(gram, np.einsum("lc,lc->l", self._laser_channels[self._own_rows], products))

    def add(self, part: NormalEquations, weight: float = 1.0) -> None:
        """Adds a part of the samples."""
        self._gram[self._own_rows] += weight * part.gram
        self._right_hand_side[self._own_rows] += weight * part.right_hand_side

    def all_reduce(self) -> None:
        """Gives every process all rows; to be called after the last part."""
        self._group.all_reduce_sum(torch.from_numpy(self._gram), torch.from_numpy(self._right_hand_side))

    @property
    def is_dark(self) -> bool:
        """Whether no laser gives any light in any plane."""
        return not np.any(self._gram)

    def solve(self) -> Floats:
        """The amplitudes (laser,) ≥ 0 for which the sum of the lasers' images is nearest to the target."""
        return _solve_nnls(self._gram * (self._laser_channels @ self._laser_channels.T), self._right_hand_side)


def _solve_nnls(gram: Floats, right_hand_side: Floats) -> Floats:
    """argmin over a ≥ 0 of aᵀGa − 2bᵀa by NNLS on a square root of G, scaled so that its diagonal is 1; 0 for G = 0."""
    if not np.any(gram):
        return np.zeros_like(right_hand_side)
    from scipy import optimize  # slow start: it is loaded while a target is built

    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(gram / scale[:, None] / scale[None, :])
    values = np.maximum(values, _EIGENVALUE_FLOOR * values[-1])
    root = np.sqrt(values)[:, None] * vectors.T
    amplitudes, _ = optimize.nnls(root, (vectors.T @ (right_hand_side / scale)) / np.sqrt(values))
    return np.asarray(amplitudes) / scale
