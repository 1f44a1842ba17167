"""Pruned transforms against whole FFTs of the padded field, their adjoints and their gradients."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from holoview.light.numerics.fourier import PrunedAxis, PrunedTransform, chirp_z_transform, dft_matrix, phasor_of_turns
from holoview.light.numerics.sampling import frequency_indices

AXES = {
    "all": PrunedAxis.for_band(12, 0, 12, -6, 5),
    "all, padded": PrunedAxis.for_band(15, 4, 9, -7, 7),
    "around zero": PrunedAxis.for_band(20, 3, 11, -4, 4),
    "around zero, odd": PrunedAxis.for_band(15, 0, 15, -3, 2),
    "above zero": PrunedAxis.for_band(16, 5, 8, 2, 6),
    "below zero": PrunedAxis.for_band(16, 5, 11, -7, -3),
    "over the highest frequency": PrunedAxis.for_band(16, 2, 7, 5, 11),
    "one frequency": PrunedAxis.for_band(9, 1, 6, 0, 0),
    "none": PrunedAxis.for_band(8, 2, 4, 1, 0),
}
Pair = tuple[PrunedAxis, PrunedAxis]
PAIRS = [(y, x) for y in ("all", "around zero", "over the highest frequency", "none") for x in AXES]


def _random(seed: int, *shape: int) -> torch.Tensor:
    return torch.randn(*shape, dtype=torch.complex128, generator=torch.Generator().manual_seed(seed))


def _whole_spectrum(field: torch.Tensor, axes: Pair) -> torch.Tensor:
    padded = torch.zeros(axes[0].padded, axes[1].padded, dtype=torch.complex128)
    padded[tuple(slice(a.offset, a.offset + a.count) for a in axes)] = field
    return torch.fft.fft2(padded)


@pytest.mark.parametrize("names", PAIRS, ids=", ".join)
def test_the_spectrum_is_that_of_the_padded_field_in_the_band(names: tuple[str, str]) -> None:
    axes = (AXES[names[0]], AXES[names[1]])
    field = _random(0, axes[0].count, axes[1].count)
    found = PrunedTransform(axes).forward(field)
    whole = _whole_spectrum(field, axes)
    expected = whole[np.ix_(*(a.indices % a.padded for a in axes))]
    # FFTs of 20 points in float64 of numbers near 1, whose sums are below 1e2: 1e2 · 2⁻⁵³ · 5 steps
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("names", PAIRS, ids=", ".join)
def test_the_field_is_that_of_the_spectrum_with_zeros_outside_the_band(names: tuple[str, str]) -> None:
    axes = (AXES[names[0]], AXES[names[1]])
    spectrum = _random(1, axes[0].frequencies, axes[1].frequencies)
    whole = torch.zeros(axes[0].padded, axes[1].padded, dtype=torch.complex128)
    whole[np.ix_(*(a.indices % a.padded for a in axes))] = spectrum
    expected = torch.fft.ifft2(whole)[tuple(slice(a.offset, a.offset + a.count) for a in axes)]
    torch.testing.assert_close(PrunedTransform(axes).inverse(spectrum), expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", AXES)
def test_the_inverse_is_the_adjoint_of_the_transform_divided_by_its_length(name: str) -> None:
    axis = AXES[name]
    field, spectrum = _random(2, 3, axis.count), _random(3, 3, axis.frequencies)
    one = torch.vdot(spectrum.flatten(), axis.forward(field, 1).flatten())
    other = torch.vdot(axis.inverse(spectrum, 1).flatten(), field.flatten()) * axis.padded
    torch.testing.assert_close(one, other, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", AXES)
def test_the_transposed_transforms_are_transposed_and_not_conjugated(name: str) -> None:
    axis = AXES[name]
    field, spectrum = _random(2, 3, axis.count), _random(3, 3, axis.frequencies)
    one = (spectrum * axis.forward(field, 1)).sum()
    torch.testing.assert_close(one, (axis.forward_transposed(spectrum, 1) * field).sum(), rtol=0, atol=1e-12)
    one = (field * axis.inverse(spectrum, 1)).sum()
    torch.testing.assert_close(one, (axis.inverse_transposed(field, 1) * spectrum).sum(), rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", AXES)
def test_any_axis_of_a_batch_can_be_transformed(name: str) -> None:
    axis = AXES[name]
    field = _random(4, 2, axis.count, 3)
    torch.testing.assert_close(axis.forward(field, 1), axis.forward(field.mT, -1).mT)
    torch.testing.assert_close(axis.inverse(axis.forward(field, -2), 1), axis.inverse(axis.forward(field, 1), -2))


@pytest.mark.parametrize("name", AXES)
def test_torch_differentiates_both_ways(name: str) -> None:
    axis = AXES[name]
    field, spectrum = (_random(5, 2, n).requires_grad_() for n in (axis.count, axis.frequencies))
    assert torch.autograd.gradcheck(lambda x: axis.forward(x, 1), field)
    assert torch.autograd.gradcheck(lambda x: axis.inverse(x, 1), spectrum)


def test_a_band_of_all_frequencies_is_in_the_order_of_the_fft() -> None:
    assert AXES["all"].indices.tolist() == frequency_indices(12).tolist()
    assert AXES["all, padded"].indices.tolist() == frequency_indices(15).tolist()
    assert AXES["around zero"].indices.tolist() == list(range(-4, 5))
    assert AXES["over the highest frequency"].indices.tolist() == [5, 6, 7, -8, -7, -6, -5]


@pytest.mark.parametrize("count", [5, 40, 300])
@pytest.mark.parametrize(("first", "step"), [(0.0, 1 / 37), (-0.31, 0.00271), (0.2, -0.013), (3.7, 0.4)])
@pytest.mark.parametrize("chirps", [True, False])
def test_sums_are_the_sums(first: float, step: float, count: int, chirps: bool) -> None:
    values = torch.randn(3, 37, dtype=torch.complex128, generator=torch.Generator().manual_seed(0))
    expected = values @ dft_matrix(37, first, step, count).T
    found = chirp_z_transform(values, first, step, count, matrix_limit=0 if chirps else 1000)
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-9)  # chirps of 18000 turns


def test_the_frequencies_of_an_fft_give_the_fft() -> None:
    values = torch.randn(16, dtype=torch.complex128, generator=torch.Generator().manual_seed(1))
    centre = torch.exp(2j * torch.pi * torch.arange(16).double() * 7.5 / 16)  # positions count from the middle
    torch.testing.assert_close(chirp_z_transform(values[None], 0.0, 1 / 16, 16)[0], torch.fft.fft(values) * centre)


def test_single_precision_keeps_six_digits_at_full_size() -> None:
    values = torch.randn(2, 1920, dtype=torch.complex64, generator=torch.Generator().manual_seed(2))
    found = chirp_z_transform(values, -0.4, 0.8 / 2048, 2048)
    expected = chirp_z_transform(values.to(torch.complex128), -0.4, 0.8 / 2048, 2048)
    assert float((found - expected).norm() / expected.norm()) < 2e-6


def test_whole_turns_change_nothing() -> None:
    turns = torch.linspace(-0.5, 0.5, 33, dtype=torch.float64)
    expected = torch.exp(2j * torch.pi * turns)
    torch.testing.assert_close(phasor_of_turns(turns), expected, rtol=0, atol=1e-15)
    torch.testing.assert_close(phasor_of_turns(turns + 4096), expected, rtol=0, atol=1e-11)


def test_the_precision_is_that_of_the_turns() -> None:
    assert phasor_of_turns(torch.zeros(2)).dtype == torch.complex64
