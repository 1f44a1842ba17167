"""CPUs that a container grants, read from control groups of both versions."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from holoview.util import processes as processors
from holoview.util.processes import (
    SPIN_COUNT,
    affine_cpu_count,
    cpu_quota,
    process_cpu_count,
    share_the_machine,
)


def _write(root: Path, groups: str, files: dict[str, str]) -> Path:
    for name, text in {"proc/self/cgroup": groups, **files}.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return root


@pytest.mark.parametrize(
    ("groups", "files", "quota"),
    [
        ("0::/\n", {"sys/fs/cgroup/cpu.max": "150000 100000\n"}, 1.5),
        ("0::/\n", {"sys/fs/cgroup/cpu.max": "max 100000\n"}, None),
        ("0::/\n", {}, None),
        (
            "0::/a.slice/b.service\n",
            {"sys/fs/cgroup/a.slice/cpu.max": "200000 100000", "sys/fs/cgroup/a.slice/b.service/cpu.max": "max 100000"},
            2.0,
        ),
        (
            "3:cpu,cpuacct:/docker/x\n2:memory:/m\n0::/\n",
            {
                "sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us": "50000\n",
                "sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us": "100000\n",
            },
            0.5,
        ),
        (
            "1:cpu:/\n",
            {"sys/fs/cgroup/cpu/cpu.cfs_quota_us": "-1\n", "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000\n"},
            None,
        ),
        ("0::/\n", {"sys/fs/cgroup/cpu.max": "nonsense"}, None),
    ],
)
def test_the_least_limit_of_the_groups_counts(
    tmp_path: Path, groups: str, files: dict[str, str], quota: float | None
) -> None:
    assert cpu_quota(_write(tmp_path, groups, files)) == quota


def test_a_system_without_control_groups_has_no_limit(tmp_path: Path) -> None:
    assert cpu_quota(tmp_path) is None


@pytest.mark.parametrize(("quota", "count"), [(None, 8), (2.5, 3), (0.1, 1), (64.0, 8)])
def test_a_share_of_a_cpu_counts_as_one(monkeypatch: pytest.MonkeyPatch, quota: float | None, count: int) -> None:
    monkeypatch.setattr(processors, "cpu_quota", lambda: quota)
    monkeypatch.setattr(processors, "affine_cpu_count", lambda: 8)
    assert process_cpu_count() == count


def test_the_mask_has_at_least_one_cpu() -> None:
    assert 1 <= process_cpu_count() <= affine_cpu_count()


@pytest.fixture
def _four_of_eight(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processors, "process_cpu_count", lambda: 4)
    monkeypatch.setattr(processors, "affine_cpu_count", lambda: 8)


@pytest.mark.usefixtures("_four_of_eight")
def test_threads_sleep_early_and_are_as_many_as_the_container_grants() -> None:
    environment: dict[str, str] = {}
    share_the_machine(environment)
    assert environment == {"GOMP_SPINCOUNT": str(SPIN_COUNT), "OMP_NUM_THREADS": "4", "LP_NUM_THREADS": "4"}


@pytest.mark.usefixtures("_four_of_eight")
@pytest.mark.parametrize(
    "stated",
    [
        {"GOMP_SPINCOUNT": "infinite", "OMP_NUM_THREADS": "7", "LP_NUM_THREADS": "3"},
        {"OMP_WAIT_POLICY": "active", "OMP_NUM_THREADS": "7", "LP_NUM_THREADS": "3"},
    ],
)
def test_what_the_user_states_is_kept(stated: dict[str, str]) -> None:
    environment = dict(stated)
    share_the_machine(environment)
    assert environment == stated


def test_without_a_limit_none_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processors, "process_cpu_count", lambda: 8)
    monkeypatch.setattr(processors, "affine_cpu_count", lambda: 8)
    environment: dict[str, str] = {}
    share_the_machine(environment)
    assert "OMP_NUM_THREADS" not in environment


def test_the_command_line_sets_this_before_torch_is_loaded() -> None:
    code = (
        "import os, sys, holoview.commands.cli as cli\n"
        "assert 'torch' not in sys.modules\n"
        "cli.main(['presets'])\n"
        "print(os.environ['GOMP_SPINCOUNT'])"
    )
    environment = {key: value for key, value in os.environ.items() if key not in ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == str(SPIN_COUNT)
