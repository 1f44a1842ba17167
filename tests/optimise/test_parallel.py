"""Processes that share the lasers compute what one computes; teams of threads; the torch device that is chosen."""

from __future__ import annotations

import math
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier, get_ident
from time import sleep
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from holoview.holograms.optimise.forward_model import ForwardModel
from holoview.holograms.optimise.lasers import with_only_lasers
from holoview.holograms.optimise.parallel import (
    MIN_SAMPLES_FOR_TEAM,
    MIN_SAMPLES_FOR_THREADS,
    SINGLE_PROCESS,
    ProcessGroup,
    ThreadTeam,
    device_for_rank,
    resolve_torch_device,
    shard_lasers,
    thread_count,
    torch_threads,
    torchrun_group,
)
from holoview.holograms.optimise.problem import EvaluationRequest, Problem
from holoview.holograms.optimise.propagation import TORCH_KERNELS, PlanePropagation
from holoview.holograms.optimise.settings import Settings
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.util.errors import UserError
from tests.patience import PATIENCE_S

SCRIPT = Path(__file__).with_name("process_group_run.py")
REPOSITORY = SCRIPT.parents[2]
CASES = (
    "one frame",
    "two frames, some lasers off",
    "sources",
    "one modulator",
    "even eyebox",
    "encoded",
    "free wavelengths",
    "a region",
    "levels",
)
DOUBLE = 1e-12
"""Sums in another order differ by 1e-16; twelve iterations make up to 4e-14 of it, in the drive."""
PROBED = "encoded"
"""The sRGB curve amplifies rounding: near black its image has few digits left, and Adam divides by its own gradient.
By how much depends on the processor, so it is measured here: probes change the target's last digits (64 ε)."""
PROBES = 3
FACTOR = 4.0
"""Of the largest change that a probe makes: what sums in another order may make."""
SINGLE = 1e-5
"""In single precision: losses differ by 8e-7, the drive by 9e-6."""

Bench = Callable[..., System]


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _environment(rank: int, size: int, port: int) -> dict[str, str]:
    paths = os.pathsep.join([str(REPOSITORY), os.environ.get("PYTHONPATH", "")])
    ours = {"RANK": rank, "WORLD_SIZE": size, "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "OMP_NUM_THREADS": 1}
    return os.environ | {key: str(value) for key, value in ours.items()} | {"PYTHONPATH": paths}


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, np.ndarray]]:
    """What each of two processes found; the first also alone."""
    folder, port = tmp_path_factory.mktemp("group"), _free_port()
    command = [sys.executable, str(SCRIPT), str(folder)]
    started = [subprocess.Popen(command, env=_environment(rank, 2, port)) for rank in range(2)]
    try:
        assert [process.wait(timeout=PATIENCE_S) for process in started] == [0, 0]
    finally:
        for process in started:
            process.kill()
    return [dict(np.load(folder / f"{rank}.npz")) for rank in range(2)]


@pytest.mark.parametrize("case", CASES)
def test_two_processes_find_what_one_finds(case: str, results: list[dict[str, np.ndarray]]) -> None:
    found = results[0]
    for name in ("losses", "eyebox", "drive", "amplitudes", "wavelengths"):
        expected, near = found[f"{case}/alone/{name}"], DOUBLE
        if case == PROBED:
            changes = [np.abs(found[f"probe {probe}/{name}"] - expected).max() for probe in range(PROBES)]
            near = max(DOUBLE, FACTOR * max(changes))
            assert near < SINGLE, "so large a tolerance would show nothing"
        np.testing.assert_allclose(found[f"{case}/{name}"], expected, rtol=DOUBLE, atol=near, err_msg=name)
    losses = found[f"{case}/losses"]
    assert losses.min() < 0.95 * losses[0]


def test_in_single_precision_they_find_it_to_five_digits(results: list[dict[str, np.ndarray]]) -> None:
    for name in ("losses", "amplitudes"):
        np.testing.assert_allclose(results[0][f"single/{name}"], results[0][f"single/alone/{name}"], rtol=SINGLE)
    assert results[0]["single/losses"][0] != results[0]["one frame/losses"][0], "that was double precision"


@pytest.mark.parametrize("case", CASES)
def test_both_hold_the_same_numbers_to_the_last_bit(case: str, results: list[dict[str, np.ndarray]]) -> None:
    for name in ("losses", "drive", "amplitudes", "wavelengths"):
        np.testing.assert_array_equal(results[1][f"{case}/{name}"], results[0][f"{case}/{name}"], err_msg=name)


@pytest.mark.parametrize(("count", "size"), [(3, 2), (8, 3), (24, 5), (4, 4)])
def test_parts_cover_everything_once_and_differ_by_one_at_most(count: int, size: int) -> None:
    parts = [range(count)[ProcessGroup(rank, size).shard(count)] for rank in range(size)]
    assert [i for part in parts for i in part] == list(range(count))
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


def test_frames_of_a_wavelength_stay_in_one_process_where_they_can(bench: Bench) -> None:
    plan = make_plan(bench(amplitudes=np.ones((2, 3))))
    assert shard_lasers(plan, ProcessGroup(0, 3)) == [[(0, 0), (1, 0)], [(0, 1), (1, 1)], [(0, 2), (1, 2)]]
    assert shard_lasers(plan, SINGLE_PROCESS) == [[(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2)]]
    part = with_only_lasers(plan, [(0, 1), (1, 1)])
    assert ForwardModel(part).lasers == [(0, 1), (1, 1)]
    assert part.grid == plan.grid


def test_more_processes_than_lasers_are_refused(bench: Bench) -> None:
    with pytest.raises(UserError, match="4 of them for 3 lasers; expected a laser for each"):
        shard_lasers(make_plan(bench()), ProcessGroup(0, 4))


def test_a_process_that_was_started_alone_is_told_how(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RANK", raising=False)
    with (
        pytest.raises(UserError, match=r"--sharded: this process was started alone; expected torchrun"),
        torchrun_group("cpu"),
    ):
        pass


def test_each_process_takes_a_gpu_of_its_own_unless_one_was_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOCAL_RANK", "3")
    assert [device_for_rank(device) for device in ("cuda", "cuda:1", "cpu")] == ["cuda:3", "cuda:1", "cpu"]


def test_alone_nothing_changes() -> None:
    mine = torch.ones(3, 2)
    SINGLE_PROCESS.all_reduce_sum(mine)
    assert mine.equal(torch.ones(3, 2))
    assert [(place, rows is mine) for place, rows in SINGLE_PROCESS.broadcast_shards(mine, 3)] == [(slice(0, 3), True)]
    assert SINGLE_PROCESS.any_rank(True)
    assert not SINGLE_PROCESS.any_rank(False)


@pytest.mark.long
def test_the_command_shares_the_lasers_and_writes_one_file(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", "-m", "holoview"]
    picture = tmp_path / "grey.png"
    Image.new("RGB", (64, 48), (90, 120, 150)).save(picture)
    options = ["--set", "shape=[24,32]", "--iterations", "2", "--device", "cpu", "--sharded", "-o", "h.safetensors"]
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [*command, "optimise", "simultaneous", str(picture), *options],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("h.safetensors: 2 iterations") == 1
    assert {path.name for path in tmp_path.iterdir()} == {picture.name, "h.safetensors"}


CPU = torch.device("cpu")
SMALL, LARGE = MIN_SAMPLES_FOR_THREADS - 1, MIN_SAMPLES_FOR_THREADS


@pytest.fixture
def _two_threads(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("_two_threads")
@pytest.mark.parametrize(("samples", "count"), [(1, 1), (SMALL, 1), (LARGE, 2), (1 << 24, 2)])
def test_small_fields_get_one_thread_and_large_ones_the_callers_number(samples: int, count: int) -> None:
    assert thread_count(samples) == count


@pytest.mark.usefixtures("_two_threads")
def test_a_number_that_the_environment_asks_for_holds_for_small_fields(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    assert thread_count(SMALL) == 2


@pytest.mark.usefixtures("_two_threads")
def test_the_callers_number_comes_back_after_an_error_and_after_nested_blocks() -> None:
    with pytest.raises(ValueError, match="inside"), torch_threads(1):
        with torch_threads(1):
            assert torch.get_num_threads() == 1
        assert torch.get_num_threads() == 1
        raise ValueError("inside")
    assert torch.get_num_threads() == 2


@pytest.mark.usefixtures("_two_threads")
@pytest.mark.parametrize("shape", [(48, 64), (96, 128), (192, 256)], ids=["few", "some", "many"])
def test_passes_are_shared_by_a_team_while_torch_uses_one_thread(
    bench: Bench, shape: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    system = bench(shape=shape, propagation="periodic")
    samples = math.prod(make_plan(system).grid.padded)
    stack = np.full((len(system.planes_m), *make_plan(system).grid.shape, 3), 0.2, dtype=np.float32)
    problem = Problem(system, stack, Settings(iterations=1), kernels=TORCH_KERNELS)
    found: set[tuple[int, int]] = set()
    compute = PlanePropagation.move

    def recorded(*arguments: Any) -> None:
        found.add((torch.get_num_threads(), get_ident()))
        compute(*arguments)

    monkeypatch.setattr(PlanePropagation, "move", recorded)
    opd_m = torch.rand(system.drive_shape) * 500e-9
    amplitudes = np.ones(system.amplitudes.shape)
    alone = problem.evaluate(opd_m, amplitudes, EvaluationRequest(path_gradient=True))
    assert {threads for threads, _ in found} == {1}
    assert (get_ident() in {thread for _, thread in found}) == (samples < MIN_SAMPLES_FOR_TEAM)
    assert torch.get_num_threads() == 2
    assert problem.evaluate(opd_m, amplitudes, EvaluationRequest(path_gradient=True)).loss == alone.loss


@pytest.mark.usefixtures("_two_threads")
def test_a_team_gives_results_in_the_order_of_the_items_from_several_threads_of_one_torch_thread_each() -> None:
    both = Barrier(2)

    def compute(item: int) -> tuple[int, int, int]:
        both.wait(timeout=PATIENCE_S)  # each of two threads waits for the other
        return item, torch.get_num_threads(), get_ident()

    found = ThreadTeam(CPU).map(compute, range(6))
    assert [item for item, _, _ in found] == list(range(6))
    assert {count for _, count, _ in found} == {1}
    assert len({thread for _, _, thread in found}) == 2
    assert get_ident() not in {thread for _, _, thread in found}
    assert torch.get_num_threads() == 2


@pytest.mark.usefixtures("_two_threads")
def test_a_team_may_have_more_threads_than_an_operation_of_torch() -> None:
    torch.set_num_threads(1)
    both = Barrier(2)
    assert ThreadTeam(CPU, 2).map(lambda item: both.wait(timeout=PATIENCE_S) in (0, 1), range(2)) == [True, True]


@pytest.mark.usefixtures("_two_threads")
@pytest.mark.parametrize(("threads", "items"), [(1, 3), (2, 1), (2, 0)])
def test_where_there_is_nothing_to_share_the_caller_computes(threads: int, items: int) -> None:
    torch.set_num_threads(threads)
    assert ThreadTeam(CPU).map(lambda item: get_ident(), range(items)) == [get_ident()] * items


@pytest.mark.usefixtures("_two_threads")
def test_a_gpu_is_used_by_the_caller() -> None:
    assert ThreadTeam(torch.device("cuda")).map(lambda item: get_ident(), range(4)) == [get_ident()] * 4


@pytest.mark.usefixtures("_two_threads")
def test_an_error_in_a_thread_is_raised_and_the_team_goes_on() -> None:
    team = ThreadTeam(CPU)
    with pytest.raises(ZeroDivisionError):
        team.map(lambda item: 1 / item, [1, 0, 2])
    assert team.map(lambda item: 2 * item, [1, 2]) == [2, 4]


@pytest.mark.usefixtures("_two_threads")
def test_a_team_adds_up_in_the_order_of_the_items() -> None:
    both, sums = Barrier(2), list[tuple[int, int, int]]()

    def compute(item: int) -> tuple[int, int]:
        both.wait(timeout=PATIENCE_S)
        if item % 2 == 0:
            sleep(0.01)  # most often the later one of two is ready first
        return item, get_ident()

    ThreadTeam(CPU).add_up(compute, range(6), lambda found: sums.append((*found, get_ident())))
    assert [item for item, *_ in sums] == list(range(6))
    assert all(computed == added for _, computed, added in sums)
    assert len({added for *_, added in sums}) == 2


@pytest.mark.usefixtures("_two_threads")
@pytest.mark.parametrize("failing", ["item", "sum"])
def test_an_error_ends_a_sum_whose_other_items_wait_for_their_turn(failing: str) -> None:
    both, added = Barrier(2), list[int]()

    def compute(item: int) -> int:
        if item < 2:
            both.wait(timeout=PATIENCE_S)
        return 1 // item if failing == "item" else item

    def add(item: int) -> None:
        added.append(1 // item)

    team = ThreadTeam(CPU)
    with pytest.raises(ZeroDivisionError):
        team.add_up(compute, range(6), add)
    assert not added
    team.add_up(lambda item: item, range(2, 6), added.append)
    assert added == [2, 3, 4, 5]


@pytest.mark.usefixtures("_two_threads")
def test_new_threads_of_others_keep_the_number_that_was_set() -> None:
    ThreadTeam(CPU).map(lambda item: item, range(4))
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(torch.get_num_threads).result() == 2


@pytest.fixture
def _cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)


@pytest.fixture
def _only_the_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)


@pytest.mark.usefixtures("_only_the_processor")
def test_without_a_graphics_card_it_is_the_processor() -> None:
    assert resolve_torch_device() == resolve_torch_device("auto") == resolve_torch_device("cpu") == "cpu"


@pytest.mark.usefixtures("_cuda")
def test_a_graphics_card_is_preferred() -> None:
    assert resolve_torch_device() == "cuda"


@pytest.mark.usefixtures("_only_the_processor")
@pytest.mark.parametrize("name", ["cuda", "cuda:1", "mps", "gpu", ""])
def test_a_device_that_is_not_there_is_refused_with_those_that_are(name: str) -> None:
    with pytest.raises(UserError, match=f'device: "{name}" isn\'t available; expected one of cpu'):
        resolve_torch_device(name)


@pytest.mark.usefixtures("_cuda")
def test_a_device_that_cannot_transform_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any, **__: Any) -> torch.Tensor:
        raise RuntimeError("no such ordinal\nand much more")

    monkeypatch.setattr(torch, "ones", broken)
    with pytest.raises(UserError, match='device: "cuda:7" doesn\'t work: no such ordinal; expected one of cuda'):
        resolve_torch_device("cuda:7")
