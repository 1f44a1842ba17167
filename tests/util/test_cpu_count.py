"""CPUs that a container grants, read from control groups of both versions."""

from __future__ import annotations

from pathlib import Path

import pytest

from holoview.util import processors
from holoview.util.processors import affine_cpu_count, cpu_quota, process_cpu_count


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
