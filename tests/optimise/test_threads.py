"""One torch thread for small fields, and the caller's number afterwards; parts computed by a team of threads."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier, get_ident

import pytest
import torch

from holoview.optimise.parallel import MIN_SAMPLES_FOR_THREADS, ThreadTeam, limit_torch_threads

CPU = torch.device("cpu")
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


def test_a_team_gives_results_in_the_order_of_the_items_from_several_threads_of_one_torch_thread_each() -> None:
    both = Barrier(2)

    def compute(item: int) -> tuple[int, int, int]:
        both.wait(timeout=60)  # each of two threads waits for the other
        return item, torch.get_num_threads(), get_ident()

    found = ThreadTeam(CPU).map(compute, range(6))
    assert [item for item, _, _ in found] == list(range(6))
    assert {count for _, count, _ in found} == {1}
    assert len({thread for _, _, thread in found}) == 2
    assert get_ident() not in {thread for _, _, thread in found}
    assert torch.get_num_threads() == 2


@pytest.mark.parametrize(("threads", "items"), [(1, 3), (2, 1), (2, 0)])
def test_where_there_is_nothing_to_share_the_caller_computes(threads: int, items: int) -> None:
    torch.set_num_threads(threads)
    assert ThreadTeam(CPU).map(lambda item: get_ident(), range(items)) == [get_ident()] * items


def test_a_gpu_is_used_by_the_caller() -> None:
    assert ThreadTeam(torch.device("cuda")).map(lambda item: get_ident(), range(4)) == [get_ident()] * 4


def test_an_error_in_a_thread_is_raised_and_the_team_goes_on() -> None:
    team = ThreadTeam(CPU)
    with pytest.raises(ZeroDivisionError):
        team.map(lambda item: 1 / item, [1, 0, 2])
    assert team.map(lambda item: 2 * item, [1, 2]) == [2, 4]


def test_new_threads_of_others_keep_the_number_that_was_set() -> None:
    ThreadTeam(CPU).map(lambda item: item, range(4))
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(torch.get_num_threads).result() == 2
