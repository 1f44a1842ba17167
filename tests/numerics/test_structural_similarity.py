"""MS-SSIM against two independent programs, in its limits, and in its slopes."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from holoview.light.numerics.structural_similarity import WEIGHTS, WINDOW, multi_scale_similarity, scale_count

ROWS, COLUMNS = 192, 208  # multiples of 16: programs differ in what they do with an odd last row


def pictures(rows: int = ROWS, columns: int = COLUMNS) -> tuple[torch.Tensor, torch.Tensor]:
    """Chirps in 0.1 … 0.9, and the same with less contrast and fine ripples; the upper left part, (1, y, x) float64."""
    y, x = np.meshgrid(np.arange(ROWS) / ROWS, np.arange(COLUMNS) / COLUMNS, indexing="ij")
    target = 0.5 + 0.4 * np.sin(40 * x * x + 3 * y) * np.cos(17 * y * (1 + x))
    image = np.clip(0.9 * target + 0.05 + 0.15 * np.sin(311 * x + 197 * y) * np.cos(23 * x * y), 0, 1)
    both = np.ascontiguousarray(np.stack([image, target])[:, None, :rows, :columns])
    return torch.from_numpy(both[0]), torch.from_numpy(both[1])


def test_five_scales_are_those_of_an_independent_program() -> None:
    """pytorch-msssim 1.0.0, ms_ssim(data_range=1), with its Gaussian window computed in float64."""
    assert float(multi_scale_similarity(*pictures())) == pytest.approx(0.9438213898654616, rel=1e-12)


def test_one_scale_is_the_ssim_of_an_independent_program() -> None:
    """scikit-image 0.26.0, structural_similarity(full=True) with Gaussian weights, σ = 1.5, inside the rim of 5."""
    assert scale_count((16, 20)) == 1
    assert float(multi_scale_similarity(*pictures(16, 20))) == pytest.approx(0.08518509364435521, rel=1e-12)


def test_the_definition_written_out_for_one_window() -> None:
    image, target = (one[0].numpy() for one in pictures(WINDOW, WINDOW))
    offsets = np.arange(WINDOW) - 5
    line = np.exp(-(offsets**2) / (2 * 1.5**2))
    window = np.outer(line, line) / line.sum() ** 2
    mean_x, mean_y = (window * image).sum(), (window * target).sum()
    var_x, var_y = (window * (image - mean_x) ** 2).sum(), (window * (target - mean_y) ** 2).sum()
    covariance = (window * (image - mean_x) * (target - mean_y)).sum()
    luminance = (2 * mean_x * mean_y + 1e-4) / (mean_x**2 + mean_y**2 + 1e-4)
    structure = (2 * covariance + 9e-4) / (var_x + var_y + 9e-4)
    found = multi_scale_similarity(*pictures(WINDOW, WINDOW))
    assert float(found) == pytest.approx(luminance * structure, rel=1e-12)


def test_fewer_scales_for_small_pictures_have_weights_that_sum_to_one() -> None:
    sides = (10, 11, 21, 22, 43, 44, 87, 88, 175, 176, 4000)
    assert [scale_count((side, 4000)) for side in sides] == [0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]
    assert [scale_count((4000, side)) for side in sides] == [scale_count((side, 4000)) for side in sides]
    assert sum(WEIGHTS) == pytest.approx(1.0001), "as published"
    black, white = torch.zeros(1, 24, 24, dtype=torch.float64), torch.ones(1, 24, 24, dtype=torch.float64)
    expected = (1e-4 / 1.0001) ** (WEIGHTS[1] / sum(WEIGHTS[:2]))  # even images: s = 1, and l at the coarsest of two
    assert float(multi_scale_similarity(black, white)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("shape", [(11, 11), (50, 37), (181, 177)])
def test_equal_images_have_1_in_every_channel(shape: tuple[int, int], dtype: torch.dtype) -> None:
    image = torch.rand(3, *shape, dtype=dtype, generator=torch.Generator().manual_seed(0))
    found = multi_scale_similarity(image, image.clone())
    assert found.tolist() == pytest.approx([1.0] * 3, abs=1e-6)  # float32: some roundings of 2⁻²⁴


def test_it_falls_as_the_contrast_of_speckle_rises() -> None:
    """Fully developed speckle of unit mean is mixed into the picture: its contrast σ/μ rises from 0 to 1."""
    target = pictures()[1]
    speckle = -torch.log(torch.rand(target.shape, dtype=target.dtype, generator=torch.Generator().manual_seed(1)))
    contrasts = np.linspace(0, 1, 11)
    found = [float(multi_scale_similarity(target * (1 - c + c * speckle), target)) for c in contrasts]
    assert found[0] == pytest.approx(1, abs=1e-12)
    assert np.diff(found).max() < 0 and found[-1] < 0.7


def test_images_and_range_scale_together() -> None:
    image, target = pictures(96, 96)
    once = multi_scale_similarity(image, target)
    assert float(multi_scale_similarity(255 * image, 255 * target, 255.0)) == pytest.approx(float(once), rel=1e-10)


@pytest.mark.parametrize("shape", [(13, 14), (25, 23), (177, 178)], ids=["one scale", "two, odd", "five, odd"])
def test_its_slopes_are_what_differences_approach(shape: tuple[int, int]) -> None:
    random = torch.Generator().manual_seed(2)
    target = torch.rand(2, *shape, dtype=torch.float64, generator=random)
    image = (target + 0.2 * torch.rand(2, *shape, dtype=torch.float64, generator=random)).requires_grad_()
    (slopes,) = torch.autograd.grad(multi_scale_similarity(image, target).sum(), image)
    for _ in range(3):
        direction, step = torch.randn(2, *shape, dtype=torch.float64, generator=random), 1e-5
        ahead, behind = (
            multi_scale_similarity(image.detach() + sign * step * direction, target).sum() for sign in (1, -1)
        )
        # Rounding of values near 1 leaves 1e-9 (r.m.s.), and so does the cubic term, of the order of step².
        assert (slopes * direction).sum().item() == pytest.approx((ahead - behind).item() / (2 * step), abs=3e-8)


def test_pictures_of_opposite_structure_keep_finite_slopes() -> None:
    target = pictures(40, 40)[1]
    image = (1 - target).requires_grad_()
    similarity = multi_scale_similarity(image, target).sum()
    (slopes,) = torch.autograd.grad(similarity, image)
    assert torch.isfinite(slopes).all()
    assert 0 < similarity.item() < 0.01


@pytest.mark.parametrize("shapes", [((1, 10, 40), (1, 10, 40)), ((1, 20, 20), (2, 20, 20)), ((20, 20), (20, 20))])
def test_images_that_do_not_fit_are_refused(shapes: tuple[tuple[int, ...], tuple[int, ...]]) -> None:
    with pytest.raises(ValueError, match="expected equal"):
        multi_scale_similarity(*(torch.zeros(shape) for shape in shapes))
