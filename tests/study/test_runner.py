from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from holoview.commands import cli
from holoview.commands import study as study_command
from holoview.evidence.study import studies
from holoview.evidence.study.runner import (
    ExecutionTarget,
    ProcessExecutor,
    ResultStore,
    WorkerResources,
    run_in_worker,
    run_jobs,
)
from holoview.evidence.study.study import SCALES, StudyJob
from holoview.util.errors import UserError
from holoview.util.memory_limit import VARIABLE, WORKER_BYTES, parse_size
from holoview.util.packages import __version__
from holoview.util.processes import process_cpu_count
from tests.child_process import child_process
from tests.patience import PATIENCE_S, wait_until
from tests.study.probe import STUDY

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent


def _job(n: int, **settings: Any) -> StudyJob:
    return StudyJob("probe", f"square {n}", {"n": n, **settings})


def _jobs(log: Path, count: int = 6, **settings: Any) -> list[StudyJob]:
    return [_job(n, log=str(log), **settings) for n in range(count)]


def _log(log: Path) -> list[int]:
    return sorted(int(line.split()[0]) for line in log.read_text(encoding="utf-8").splitlines())


@pytest.fixture
def store(tmp_path: Path) -> ResultStore:
    return ResultStore(tmp_path / "jobs")


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes that are started by a test find this study's module."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))


@pytest.mark.parametrize("workers", [1, 2])
def test_every_job_is_done_once_and_results_come_in_order(workers: int, store: ResultStore, tmp_path: Path) -> None:
    jobs, seen = _jobs(tmp_path / "log"), []
    results = run_jobs(
        STUDY, jobs, store, ExecutionTarget(workers), lambda done, total, note: seen.append((done, total))
    )
    assert [outcome.numbers["square"] for _, outcome in results] == [n**2 for n in range(6)]
    assert [job for job, _ in results] == jobs
    assert _log(tmp_path / "log") == list(range(6))
    assert seen[0] == (0, 6) and seen[-1] == (6, 6)


@pytest.mark.long
def test_what_is_kept_isn_t_done_again(store: ResultStore, tmp_path: Path) -> None:
    log = tmp_path / "log"
    run_jobs(STUDY, _jobs(log, 3), store)
    results = run_jobs(STUDY, _jobs(log, 5), store)
    assert len(results) == 5
    assert _log(log) == list(range(5))


def test_jobs_of_equal_settings_share_a_result(store: ResultStore, tmp_path: Path) -> None:
    results = run_jobs(STUDY, [_job(2, log=str(tmp_path / "log")) for _ in range(3)], store)
    assert [outcome.numbers["square"] for _, outcome in results] == [4, 4, 4]
    assert _log(tmp_path / "log") == [2]


def test_pictures_come_back_as_they_were(store: ResultStore) -> None:
    ((_, outcome),) = run_jobs(STUDY, [_job(7)], store)
    np.testing.assert_array_equal(outcome.pictures["flat"], np.full((2, 3, 3), 7, np.uint8))


@pytest.mark.parametrize("workers", [1, 2])
def test_a_job_that_stumbles_is_tried_again(workers: int, store: ResultStore, tmp_path: Path) -> None:
    jobs = [_job(1, log=str(tmp_path / "log"), fate="fails once"), _job(3, log=str(tmp_path / "log"))]
    results = run_jobs(STUDY, jobs, store, ExecutionTarget(workers))
    assert [outcome.numbers["square"] for _, outcome in results] == [1, 9]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_job_that_keeps_failing_is_named_and_the_others_are_kept(
    workers: int, store: ResultStore, tmp_path: Path
) -> None:
    bad, good = _job(1, log=str(tmp_path / "log"), fate="fails"), _job(3, log=str(tmp_path / "log"))
    with pytest.raises(UserError, match=r"job square 1: failed 3 times: always.*1 of 2 jobs are done and kept"):
        run_jobs(STUDY, [bad, good], store, ExecutionTarget(workers))
    assert store.load(good) is not None
    assert store.load(bad) is None


@pytest.mark.long
def test_a_process_that_is_killed_loses_nothing(store: ResultStore, tmp_path: Path) -> None:
    log = str(tmp_path / "log")
    jobs = [_job(n, log=log, fate="dies once" if n == 2 else "") for n in range(5)]
    results = run_jobs(STUDY, jobs, store, ExecutionTarget(2))
    assert [outcome.numbers["square"] for _, outcome in results] == [n**2 for n in range(5)]


@pytest.mark.long
def test_only_the_job_whose_process_died_pays_for_it(store: ResultStore, tmp_path: Path) -> None:
    jobs = [_job(0, log=str(tmp_path / "log"), fate="dies"), *(_job(n, seconds=0.1) for n in range(1, 6))]
    with pytest.raises(UserError, match=r"job square 0: failed 2 times: its process was killed.*5 of 6 jobs are done"):
        run_jobs(STUDY, jobs, store, ExecutionTarget(2), retries=1)
    assert _log(tmp_path / "log") == [0, 0]


def test_a_job_that_failed_is_tried_again_before_the_others(store: ResultStore, tmp_path: Path) -> None:
    log = tmp_path / "log"
    run_jobs(STUDY, [_job(1, log=str(log), fate="fails once"), _job(3, log=str(log))], store)
    assert [line.split()[0] for line in log.read_text().splitlines()] == ["1", "1", "3"]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_refusal_is_passed_on_and_not_tried_again(workers: int, store: ResultStore, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="n: 1; expected another"):
        run_jobs(STUDY, [_job(1, log=str(tmp_path / "log"), fate="refuses")], store, ExecutionTarget(workers))
    assert _log(tmp_path / "log") == [1]


@pytest.mark.long
@pytest.mark.parametrize("size", ["--quick", "--full"])
def test_a_run_says_how_large_it_was_and_a_quick_one_what_that_changes(
    size: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for module in (studies, study_command):  # which binds the name when it is imported
        monkeypatch.setattr(module, "studies_by_name", lambda: {"probe": STUDY})
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    assert cli.main(["study", "probe", size, "-o", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert f"{size[2:]}: {STUDY.describe_size(SCALES[size[2:]])}; 20 jobs in " in out
    assert (STUDY.quick_note in out) == (size == "--quick")
    assert (STUDY.quick_note in (tmp_path / "report.html").read_text(encoding="utf-8")) == (size == "--quick")


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_ctrl_c_in_a_terminal_keeps_what_is_done(tmp_path: Path) -> None:
    """A terminal sends SIGINT to the program and to its workers."""
    program = (
        "import sys; from holoview import cli; from holoview.evidence.study import studies\n"
        "from tests.study.probe import STUDY\n"
        "studies.studies_by_name = lambda: {'probe': STUDY}; sys.exit(cli.main())"
    )
    command = [sys.executable, "-c", program, "study", "probe", "-o", str(tmp_path), "--workers", "2"]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with child_process(command, cwd=ROOT, start_new_session=True, **pipes) as process:
        wait_until(lambda: list(tmp_path.glob("jobs/[!.]*.json")))  # not one being written
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE_S)
    kept = len(list(tmp_path.glob("jobs/*.json")))
    assert (process.returncode, out) == (130, "")
    assert 0 < kept < 20
    assert err == (
        f"interrupted: {kept} of 20 jobs are done and kept in {tmp_path / 'jobs'}; run it again for the rest\n"
    )


def test_processes_share_the_cores() -> None:
    executor = ProcessExecutor(2)
    assert sorted(worker.index for worker in executor.worker_resources) == [0, 1]
    assert all(worker.threads == max(process_cpu_count() // 2, 1) for worker in executor.worker_resources)
    executor.shutdown(kill=False)


def test_processes_share_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    used = psutil.Process().memory_info().rss
    monkeypatch.setenv(VARIABLE, str(used + 3 * WORKER_BYTES))
    jobs = [_job(n) for n in range(2)]
    with pytest.raises(UserError, match=r"--workers 4: leave each process less than 400 MB.*at most [23]"):
        run_jobs(STUDY, jobs, ResultStore(tmp_path), ExecutionTarget(workers=4))
    executor = ProcessExecutor(2)
    shares = [parse_size(str(worker.memory), "share") for worker in executor.worker_resources]
    executor.shutdown(kill=False)
    assert len(shares) == 2 and 2.5 * WORKER_BYTES < sum(shares) <= 3 * WORKER_BYTES
    with pytest.raises(UserError, match="none"):
        run_in_worker(WorkerResources(memory="none"), STUDY, {"n": 1}, __version__)


def test_a_share_keeps_torch_to_its_threads() -> None:
    import torch

    before = torch.get_num_threads()
    WorkerResources(threads=3).apply()
    assert torch.get_num_threads() == 3
    torch.set_num_threads(before)


def test_a_worker_of_another_version_refuses() -> None:
    with pytest.raises(UserError, match=r"holoview"):
        run_in_worker(WorkerResources(), STUDY, {"n": 1}, "0.0")


def _to_be_killed(log: Path) -> list[StudyJob]:
    """Four jobs of which the third is long at the first attempt."""
    return [_job(n, log=str(log), fate="waits once" if n == 2 else "") for n in range(4)]


@pytest.mark.long
def test_a_run_that_is_killed_goes_on_where_it_was(tmp_path: Path) -> None:
    folder, log = tmp_path / "jobs", tmp_path / "log"
    program = (
        "import sys; from pathlib import Path; from holoview.evidence.study.runner import run_jobs\n"
        "from holoview.evidence.study.runner import ResultStore\n"
        "from tests.study.test_runner import _to_be_killed, STUDY\n"
        "run_jobs(STUDY, _to_be_killed(Path(sys.argv[2])), ResultStore(Path(sys.argv[1])))\n"
    )
    with child_process([sys.executable, "-c", program, str(folder), str(log)], cwd=ROOT) as process:
        wait_until(lambda: log.exists() and len(_log(log)) == 3)
        process.send_signal(signal.SIGKILL)
    assert len(list(folder.glob("*.json"))) == 2
    results = run_jobs(STUDY, _to_be_killed(log), ResultStore(folder))
    assert [outcome.numbers["square"] for _, outcome in results] == [0, 1, 4, 9]
    assert _log(log) == [0, 1, 2, 2, 3]


@pytest.mark.parametrize("damage", ["", "{", '{"format": "other"}', "[]", '{"format": "holoview-result"}'])
def test_a_result_that_isn_t_whole_is_made_again(damage: str, store: ResultStore, tmp_path: Path) -> None:
    job = _job(3, log=str(tmp_path / "log"))
    run_jobs(STUDY, [job], store)
    (path,) = store.folder.glob("*.json")
    path.write_text(damage)
    assert store.load(job) is None
    run_jobs(STUDY, [job], store)
    assert _log(tmp_path / "log") == [3, 3]


@pytest.mark.parametrize("change", [{"numbers": {}}, {"numbers": {"square": 10}}, {"label": "another"}])
def test_a_result_that_was_changed_is_made_again(change: dict[str, Any], store: ResultStore) -> None:
    """A number that is missing would be missed only once a report is written."""
    job = _job(3)
    run_jobs(STUDY, [job], store)
    (path,) = store.folder.glob("*.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    assert store.load(job) is None


def test_a_lost_picture_makes_a_result_not_whole(store: ResultStore) -> None:
    job = _job(3)
    run_jobs(STUDY, [job], store)
    next(store.folder.glob("*.png")).unlink()
    assert store.load(job) is None


def test_keys_tell_settings_apart() -> None:
    assert _job(1).key == _job(1).key
    assert _job(1).key != _job(2).key
    assert _job(1).key != StudyJob("other", "square 1", {"n": 1}).key
    assert _job(1).key != StudyJob("probe", "square 1", {"n": 1}, revision=2).key
    assert _job(1).key == STUDY.make_job("another label", {"n": 1}).key
