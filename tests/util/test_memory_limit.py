"""What may be taken: a share of what the machine or the control group has left, or what is stated."""

from __future__ import annotations

from pathlib import Path

import psutil
import pytest

from holoview.util import memory
from holoview.util.errors import UserError

LIMIT, USED, CACHE = 4_000_000_000, 1_500_000_000, 500_000_000


def _group(folder: Path, limit: str, names: tuple[str, str, str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / names[0]).write_text(f"{limit}\n", encoding="ascii")
    (folder / names[1]).write_text(f"{USED}\n", encoding="ascii")
    (folder / "memory.stat").write_text(f"anon 5\n{names[2]} {CACHE}\n", encoding="ascii")


@pytest.mark.parametrize("version", [1, 2])
def test_a_limit_of_any_group_around_the_process_counts(version: int, tmp_path: Path) -> None:
    names = ("memory.max", "memory.current", "inactive_file")
    top, line = tmp_path, "0::/a/b"
    if version == 1:
        names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
        top, line = tmp_path / "memory", "4:cpu,memory:/a/b"
    (tmp_path / "cgroup").write_text(f"1:name=systemd:/a\n{line}\n", encoding="ascii")
    _group(top / "a" / "b", "max", names)
    assert list(memory._cgroup_left(tmp_path, tmp_path / "cgroup")) == []
    _group(top / "a", str(LIMIT), names)
    assert list(memory._cgroup_left(tmp_path, tmp_path / "cgroup")) == [LIMIT - USED + CACHE]


def test_without_groups_the_machine_counts(tmp_path: Path) -> None:
    assert list(memory._cgroup_left(tmp_path, tmp_path / "none")) == []


def test_a_share_of_the_free_memory_may_be_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(memory.VARIABLE, raising=False)
    monkeypatch.setattr(memory, "free_bytes", lambda: 8_000_000_000)
    memory.require_memory("file", 5.9e9)
    with pytest.raises(UserError, match=r"file: needs about 6\.1 GB of memory, but 6 GB may be taken of the 8 GB"):
        memory.require_memory("file", 6.1e9)


def test_a_stated_limit_is_of_the_whole_process(monkeypatch: pytest.MonkeyPatch) -> None:
    used = psutil.Process().memory_info().rss
    monkeypatch.setenv(memory.VARIABLE, str(used + 5_000_000_000))
    assert abs(memory.allowed_bytes() - 5e9) < 50e6
    memory.require_memory("file", 4.9e9)
    with pytest.raises(UserError, match=r"file: needs about 5\.1 GB of memory, but (4\.9|5)"):
        memory.require_memory("file", 5.1e9)
    monkeypatch.setenv(memory.VARIABLE, "1MB")
    with pytest.raises(UserError, match="0 bytes are left of the 1MB"):
        memory.require_memory("file", 1)


@pytest.mark.parametrize(("text", "count"), [("8GB", 8e9), (" 1.5 MiB ", 1.5 * 2**20), ("700", 700), ("2kb", 2000)])
def test_sizes_are_read(text: str, count: float) -> None:
    assert memory.parse_size(text, "here") == count


@pytest.mark.parametrize("text", ["", "0", "-1GB", "nan", "inf", "8 apples", "1e9", "9" * 50])
def test_other_sizes_are_refused(text: str) -> None:
    with pytest.raises(UserError, match=r"here: .* such as 8GB"):
        memory.parse_size(text, "here")
