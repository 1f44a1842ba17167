"""What may be taken: a share of what the machine or the control group has left, or what is stated."""

from __future__ import annotations

import platform
from pathlib import Path

import numpy as np
import psutil
import pytest

from holoview.util import memory_limit
from holoview.util.errors import UserError
from holoview.util.memory_limit import give_back_freed_memory

LIMIT, USED, CACHE = 4_000_000_000, 1_500_000_000, 500_000_000


def _group(folder: Path, limit: str, names: tuple[str, str, str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / names[0]).write_text(f"{limit}\n", encoding="ascii")
    (folder / names[1]).write_text(f"{USED}\n", encoding="ascii")
    (folder / "memory.stat").write_text(f"anon 5\n{names[2]} {CACHE}\n", encoding="ascii")


@pytest.mark.parametrize("version", [1, 2])
def test_a_limit_of_any_group_around_the_process_counts(version: int, tmp_path: Path) -> None:
    names = ("memory.max", "memory.current", "inactive_file")
    top, line, without_limit = tmp_path, "0::/a/b", "max"
    if version == 1:
        names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
        top, line, without_limit = tmp_path / "memory", "4:cpu,memory:/a/b", str(2**63 - 4096)
    (tmp_path / "cgroup").write_text(f"1:name=systemd:/a\n{line}\n", encoding="ascii")
    _group(top / "a" / "b", without_limit, names)
    assert list(memory_limit._cgroup_left(tmp_path, tmp_path / "cgroup")) == []
    _group(top / "a", str(LIMIT), names)
    assert list(memory_limit._cgroup_left(tmp_path, tmp_path / "cgroup")) == [LIMIT - USED + CACHE]


def test_without_groups_the_machine_counts(tmp_path: Path) -> None:
    assert list(memory_limit._cgroup_left(tmp_path, tmp_path / "none")) == []


def test_a_share_of_the_free_memory_may_be_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(memory_limit.VARIABLE, raising=False)
    monkeypatch.setattr(memory_limit, "free_bytes", lambda: 8_000_000_000)
    memory_limit.require_memory("file", 5.9e9)
    with pytest.raises(UserError, match=r"file: needs about 6\.1 GB of memory, but 6 GB may be taken of the 8 GB"):
        memory_limit.require_memory("file", 6.1e9)


def test_a_stated_limit_is_of_the_whole_process(monkeypatch: pytest.MonkeyPatch) -> None:
    used = psutil.Process().memory_info().rss
    monkeypatch.setenv(memory_limit.VARIABLE, str(used + 5_000_000_000))
    assert abs(memory_limit.allowed_bytes() - 5e9) < 50e6
    memory_limit.require_memory("file", 4.9e9)
    with pytest.raises(UserError, match=r"file: needs about 5\.1 GB of memory, but (4\.9|5)"):
        memory_limit.require_memory("file", 5.1e9)
    monkeypatch.setenv(memory_limit.VARIABLE, "1MB")
    with pytest.raises(UserError, match="0 bytes are left of the 1MB"):
        memory_limit.require_memory("file", 1)


@pytest.mark.parametrize(("text", "count"), [("8GB", 8e9), (" 1.5 MiB ", 1.5 * 2**20), ("700", 700), ("2kb", 2000)])
def test_sizes_are_read(text: str, count: float) -> None:
    assert memory_limit.parse_size(text, "here") == count


@pytest.mark.parametrize("text", ["", "0", "-1GB", "nan", "inf", "8 apples", "1e9", "9" * 50])
def test_other_sizes_are_refused(text: str) -> None:
    with pytest.raises(UserError, match=r"here: .* such as 8GB"):
        memory_limit.parse_size(text, "here")


PIECE, COUNT = 1 << 16, 4000  # bytes, too few for a mapping of their own; 260 MB in all


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other allocators give it back by themselves")
def test_what_is_free_between_what_is_in_use_is_given_back() -> None:
    pieces = [np.ones(PIECE, np.uint8) for _ in range(COUNT)]
    full = psutil.Process().memory_info().rss
    kept = pieces[:: COUNT // 10]  # spread over all of it
    del pieces
    give_back_freed_memory(beyond=full + (1 << 40))
    held = psutil.Process().memory_info().rss
    give_back_freed_memory(beyond=0)
    assert psutil.Process().memory_info().rss < held - PIECE * COUNT / 2
    assert all((piece == 1).all() for piece in kept)
