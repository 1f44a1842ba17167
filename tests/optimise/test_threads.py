"""One torch thread for small fields, and the caller's number afterwards."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from holoview.optimise.threads import MIN_SAMPLES_FOR_THREADS, limit_torch_threads

SMALL, LARGE = MIN_SAMPLES_FOR_THREADS - 1, MIN_SAMPLES_FOR_THREADS


@pytest.fixture(autouse=True)
def _two_threads(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize(("samples", "inside"), [(1, 1), (SMALL, 1), (LARGE, 2), (1 << 24, 2)])
def test_small_fields_get_one_thread_and_large_ones_the_callers_number(samples: int, inside: int) -> None:
    with limit_torch_threads(samples):
        assert torch.get_num_threads() == inside
    assert torch.get_num_threads() == 2


def test_the_callers_number_comes_back_after_an_error() -> None:
    with pytest.raises(ValueError, match="inside"), limit_torch_threads(SMALL):
        raise ValueError("inside")
    assert torch.get_num_threads() == 2


def test_blocks_may_be_nested() -> None:
    with limit_torch_threads(SMALL):
        with limit_torch_threads(SMALL):
            pass
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == 2


def test_a_number_that_the_environment_asks_for_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with limit_torch_threads(SMALL):
        assert torch.get_num_threads() == 2
