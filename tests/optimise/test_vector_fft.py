"""FFTs of lines side by side, against numpy's; which lengths they take; passes at the edges of blocks and of fields."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

pytest.importorskip("numba")

from holoview.holograms.optimise.beams import flat_view, padded_rows
from holoview.holograms.optimise.vector_fft import LANES, fft, fft_plan, has_fft
from holoview.holograms.optimise.vector_kernels import line_to_band, line_to_window, transform_columns, transform_rows
from holoview.light.numerics.fourier import PrunedAxis

Noise = Callable[..., torch.Tensor]
ROUNDING = {False: 2.0**-24, True: 2.0**-53}


def rounding_bound(length: int, double: bool) -> float:
    """Of the relative L2 error: in a stage, up to 5 sums and the product with a root round 10 times at most."""
    return 10 * len(fft_plan(length, double).radices) * ROUNDING[double]


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("length", [2, 3, 4, 5, 15, 60, 96, 128, 250, 324, 1280])
def test_a_block_is_transformed_as_by_numpy(length: int, double: bool) -> None:
    rng = np.random.default_rng(length)
    lines = rng.standard_normal((length, LANES)) + 1j * rng.standard_normal((length, LANES))
    plan = fft_plan(length, double)
    numbers = np.float64 if double else np.float32
    block = np.stack([lines.real, lines.imag], axis=1).astype(numbers).ravel()
    found = fft(block, np.empty_like(block), plan.radices, plan.roots, plan.starts).reshape(length, 2, LANES)
    expected = np.fft.ifft(lines.astype(np.complex128 if double else np.complex64), axis=0, norm="forward")
    difference = (found[:, 0] + 1j * found[:, 1])[plan.places] - expected
    assert np.linalg.norm(difference) <= rounding_bound(length, double) * np.linalg.norm(expected)


@pytest.mark.parametrize(("length", "fits"), [(1, False), (2, True), (1920, True), (7, False), (2 * 11, False)])
def test_lengths_have_the_factors_2_3_and_5(length: int, fits: bool) -> None:
    assert has_fft(length) is fits


AXES = {
    "all": PrunedAxis(60, 0, 60, 0, 60),
    "padded": PrunedAxis(60, 0, 45, 0, 60),
    "a band around zero": PrunedAxis(60, 0, 37, -11, 23),
    "a band from zero on": PrunedAxis(60, 0, 41, 0, 17),
}


@pytest.mark.parametrize("forward", [False, True])
@pytest.mark.parametrize("to_band", [False, True])
@pytest.mark.parametrize("name", AXES)
@pytest.mark.parametrize("along", ["rows", "columns"])
def test_lines_between_window_and_band_are_those_of_torch(
    along: str, name: str, to_band: bool, forward: bool, noise: Noise
) -> None:
    """With more lines than a vector has, but no multiple of that; nothing beside the result is written."""
    axis, others, beams = AXES[name], LANES + 5, (2, 3)
    before, after = (axis.count, axis.frequencies) if to_band else (axis.frequencies, axis.count)
    shape, result = ((others, before), (others, after)) if along == "rows" else ((before, others), (after, others))
    source = padded_rows(*beams, *shape, like=torch.empty(0, dtype=torch.complex128))
    source.copy_(torch.complex(noise(0, *beams, *shape) - 0.5, noise(1, *beams, *shape) - 0.5))
    target = torch.full((*beams, result[0], result[1] + LANES), 7.0, dtype=torch.complex128)[..., : result[1]]
    line = (line_to_band if to_band else line_to_window)(axis, forward=forward, double=True)
    (flat, _, strides), (target_flat, _, target_strides) = flat_view(source), flat_view(target)
    if along == "rows":
        transform_rows(flat, strides, target_flat, target_strides, (*beams, others), line)
    else:
        transform_columns(flat, strides, target_flat, target_strides, beams, others, line, 1.0)
    transforms = {
        (True, True): axis.forward,
        (False, True): axis.forward_transposed,
        (True, False): axis.inverse_transposed,
        (False, False): axis.inverse,
    }
    expected = transforms[to_band, forward](source, -1 if along == "rows" else -2) * (1 if forward else axis.padded)
    bound = 2 * rounding_bound(axis.padded, True) * float(source.norm()) * axis.padded**0.5
    assert float((target - expected).norm()) <= bound
    beside = target.as_strided((*beams, result[0], LANES), target.stride(), result[1])
    if along == "columns":
        assert bool((beside == 7).all())
