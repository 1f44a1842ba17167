"""The loss by structure: its value, its slopes, its region, and what it is for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.holograms.metrics.image_quality import measure_image_quality
from holoview.holograms.metrics.perceptual import ms_ssim
from holoview.holograms.optimise.objective import Objective, PlaneLoss, make_objective
from holoview.holograms.optimise.settings import LOSS_SPACES, Settings
from holoview.holograms.optimise.solve import iterate
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.util.errors import UserError

Bench = Callable[..., System]
ROWS, COLUMNS = 48, 44
WEIGHT = LOSS_SPACES["ms-ssim"].structure_weight


def _stack(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.1, 0.9, (2, ROWS, COLUMNS, 3))


def _objective(bench: Bench, **settings: Any) -> Objective:
    system = bench(shape=[ROWS // 2, COLUMNS // 2], planes=["0.3 mm", "0.4 mm"])
    return make_objective(make_plan(system), _stack(), Settings(loss="ms-ssim", **settings), double=True)


def _evaluate(objective: Objective, image: torch.Tensor, plane: int = 0) -> PlaneLoss:
    return objective.plane_losses([plane], objective.evaluate_rows(plane, slice(0, ROWS), image).norms[None, None])[0]


def _channels(rgb: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.moveaxis(rgb, -1, 0).copy())


@pytest.mark.parametrize("region", [None, (3, 5, 30, 28)], ids=["everything", "region"])
def test_it_is_the_loss_of_encoded_srgb_and_the_metric(region: Any, bench: Bench) -> None:
    seen = _stack(1)[1]
    plain = make_objective(
        make_plan(bench(shape=[ROWS // 2, COLUMNS // 2], planes=["0.3 mm", "0.4 mm"])),
        _stack(),
        Settings(loss="srgb", region=region, plane_weights=(1.0, 3.0)),
        double=True,
    )
    structural = _objective(bench, region=region, plane_weights=(1.0, 3.0))
    x, y, width, height = region or (0, 0, COLUMNS, ROWS)
    similarity = ms_ssim(*(one[y : y + height, x : x + width] for one in (seen, _stack()[1]))).mean
    squares, both = (_evaluate(objective, _channels(seen), plane=1) for objective in (plain, structural))
    assert both.loss == pytest.approx(squares.loss + 1.5 / 2 * WEIGHT * (1 - similarity), rel=1e-12)
    assert both.psnr_db == pytest.approx(squares.psnr_db, abs=1e-9)


def test_its_slopes_are_what_differences_approach(bench: Bench) -> None:
    objective = _objective(bench, region=(3, 5, 30, 28))
    image = _channels(_stack(1)[0])
    slopes = image.clone()
    _evaluate(objective, slopes)
    random = torch.Generator().manual_seed(0)
    for _ in range(3):
        direction, step = torch.randn(image.shape, dtype=torch.float64, generator=random), 1e-6
        ahead, behind = (_evaluate(objective, image + sign * step * direction).loss for sign in (1, -1))
        # Rounding of a loss near 0.1, 1e-16 over 2e-6; the cubic term is of the order of step².
        assert (slopes * direction).sum().item() == pytest.approx((ahead - behind) / (2 * step), abs=1e-9)
    outside = slopes.clone()
    outside[:, 5:33, 3:33] = 0
    assert not outside.any()


def test_the_target_itself_is_perfect(bench: Bench) -> None:
    objective = _objective(bench)
    image = objective.target[0].clone()
    assert _evaluate(objective, image).loss == 0.0
    assert float(image.abs().max()) < 1e-15, "no slope but rounding at the best place"


def test_images_smaller_than_its_window_are_refused(bench: Bench) -> None:
    with pytest.raises(UserError, match="loss: images of 10 x 20 samples; expected at least 11 rows and columns"):
        _objective(bench, region=(0, 0, 10, 20))


def test_it_finds_a_picture_of_better_structure_than_squared_errors_do(bench: Bench) -> None:
    """Of a wall with bright discs, with equal settings: 0.19 ± 0.03 more with eight draws."""
    system = bench(shape=[24, 24], planes=["1 mm"])
    y, x = np.indices(make_plan(system).grid.shape) % 16 - 8
    stack = np.repeat(np.where(np.hypot(y, x) < 5, 0.6, 0.2)[None, ..., None], 3, axis=-1)
    found = {}
    for loss in ("srgb", "ms-ssim"):
        best = list(iterate(system, stack, Settings(iterations=30, loss=loss)))[-1].best
        found[loss] = measure_image_quality(hv.simulate(best.system, best.drive, backend="torch"), stack).ms_ssim
    assert found["ms-ssim"] is not None and found["srgb"] is not None
    assert found["ms-ssim"].mean > found["srgb"].mean + 0.03
