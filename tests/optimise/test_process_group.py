"""Two processes that share the lasers compute what one computes, and stay identical."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.optimise.forward_model import ForwardModel
from holoview.optimise.lasers import with_only_lasers
from holoview.optimise.parallel import SINGLE_PROCESS, ProcessGroup, device_for_rank, shard_lasers, torchrun_group
from holoview.util.errors import UserError

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
        assert [process.wait(timeout=120) for process in started] == [0, 0]
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


def test_the_command_shares_the_lasers_and_writes_one_file(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", "-m", "holoview"]
    picture = REPOSITORY / "assets" / "still-life.png"
    options = ["--set", "shape=[24,32]", "--iterations", "2", "--device", "cpu", "--sharded", "-o", "h.safetensors"]
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [*command, "optimise", "simultaneous", str(picture), *options],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("h.safetensors: 2 iterations") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["h.safetensors"]
