"""Jitter is told from a movement that all captures share, however few there are."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.bench.diagnose.likelihood import mean_is_significant


@pytest.mark.parametrize("captures", [2, 4, 8])
def test_jitter_seldom_has_a_direction(captures: int) -> None:
    """One in a hundred by construction: of 200 000 draws 2000 ± 44, and 240 more or fewer once in ten million times."""
    draws = np.random.default_rng(0).standard_normal((captures, 200_000))
    assert mean_is_significant(draws, 0.01).mean() == pytest.approx(0.01, rel=0.12)


def test_what_all_share_has_one() -> None:
    jitter = 0.02 * np.random.default_rng(1).standard_normal((8, 2))
    assert mean_is_significant(jitter + np.array([0.3, 0.0]), 1e-4).tolist() == [True, False]


def test_a_single_capture_moves_as_all_do() -> None:
    assert mean_is_significant(np.array([[0.1, 0.0]]), 1e-4).all()
