"""A real scheduler with real workers, one of which is killed."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from holoview.evidence.study import runner
from holoview.evidence.study.runner import ExecutionTarget, ResultStore, run_jobs
from holoview.evidence.study.study import StudyJob
from holoview.util.errors import UserError
from holoview.util.processes import process_cpu_count
from tests.patience import PATIENCE_S, wait_until
from tests.study.probe import STUDY

distributed = pytest.importorskip("distributed", reason="dask.distributed isn't installed")
pytestmark = pytest.mark.filterwarnings("ignore")  # of dask and its event loops, when a worker goes away

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Address of a scheduler, and its two workers of a thread each."""
    folder = tmp_path_factory.mktemp("cluster")
    file = folder / "scheduler.json"
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    options = {"env": environment, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    scheduler = subprocess.Popen([*dask, "--no-dashboard", "--scheduler-file", str(file)], **options)
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1"]
    workers = [subprocess.Popen([*worker, "--no-nanny", "--no-dashboard"], **options) for _ in range(2)]
    try:
        wait_until(file.exists)
        with distributed.Client(scheduler_file=str(file), set_as_default=False) as client:
            client.wait_for_workers(2, timeout=PATIENCE_S)
            address = client.scheduler.address
        yield address, workers
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


def test_workers_share_their_machine_and_need_the_same_holoview(
    cluster: tuple[str, list[subprocess.Popen[bytes]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    with runner.dask_executor(cluster[0]) as executor:
        resources = executor.worker_resources
        assert sorted(worker.index for worker in resources.values()) == [0, 1]
        assert {worker.threads for worker in resources.values()} == {max(process_cpu_count() // 2, 1)}
        assert executor.submit(_resources_there).result() in resources.values()
    monkeypatch.setattr(runner, "__version__", "0.0")
    said = r"worker tcp://.*: has holoview .*expected holoview 0\.0, as here"
    with pytest.raises(UserError, match=said), runner.dask_executor(cluster[0]):
        pass


def _resources_there(resources: dict[str, runner.WorkerResources]) -> runner.WorkerResources:
    return runner.resources_of_worker(resources)


@pytest.mark.long
def test_a_worker_that_is_killed_loses_nothing(
    cluster: tuple[str, list[subprocess.Popen[bytes]]], tmp_path: Path
) -> None:
    address, workers = cluster
    store, log = ResultStore(tmp_path / "jobs"), tmp_path / "log"
    jobs = [StudyJob("probe", f"square {n}", {"n": n, "log": str(log), "seconds": 0.3}) for n in range(8)]
    killed = False

    def watch(done: int, total: int, note: str) -> None:
        nonlocal killed
        if done >= 2 and not killed:
            workers[0].kill()
            killed = True

    results = run_jobs(STUDY, jobs, store, ExecutionTarget(scheduler=address), watch)
    assert killed
    assert [outcome.numbers["square"] for _, outcome in results] == [n**2 for n in range(8)]
    pids = {line.split()[1] for line in log.read_text().splitlines()}
    assert len(pids) == 2


def test_a_scheduler_that_doesn_t_answer_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "CONNECT_TIMEOUT_S", 0.5)
    with pytest.raises(UserError, match=r"--scheduler tcp://127.0.0.1:9: no answer.*a Dask scheduler that runs"):
        run_jobs(
            STUDY,
            [StudyJob("probe", "one", {"n": 1})],
            ResultStore(tmp_path),
            ExecutionTarget(scheduler="tcp://127.0.0.1:9"),
        )
