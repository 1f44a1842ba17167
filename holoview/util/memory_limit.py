"""How much memory a command may take, found out before it is asked for.

Readers know the need of a file from its declared sizes, simulations know theirs from their plan. `require_memory`
refuses a need beyond the limit: a share of the memory that is free on the machine or in the process's control group, or
the number of bytes that `--memory` or the environment variable HOLOVIEW_MEMORY states. Worker processes get equal
shares of the rest, so that all of them together stay below the limit.
"""

from __future__ import annotations

import ctypes
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

if sys.platform == "linux":
    import resource

from holoview.util.errors import UserError
from holoview.util.processes import MEMBERSHIP, MOUNT, group_folders, read_lines

FREE_SHARE = 0.75
"""The share of the free memory that may be taken where no limit is stated: the rest is left to other programs."""

VARIABLE = "HOLOVIEW_MEMORY"
"""The environment variable with the most memory that the process may take in all, such as "8GB"."""

WORKER_BYTES = 400_000_000
"""Memory of a worker process before its work: with torch and the studies imported it takes 250 to 330 MB."""

_UNITS = {"": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
_UNITS |= {"KIB": 2**10, "MIB": 2**20, "GIB": 2**30, "TIB": 2**40}
_SIZE = re.compile(r"\s*(\d{1,18}(?:\.\d{0,18})?)\s*([kmgt]i?b|)\s*", re.IGNORECASE)
_EXPECTED = "a size such as 8GB or 500MiB"
_ROOT = Path("/")
_GROUP_FILES = (
    ("memory.max", "memory.current", "inactive_file"),
    ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)
"""The limit and the use of a control group, and its cache in memory.stat, in versions 2 and 1."""
_NO_LIMIT = 1 << 62  # bytes; version 1 writes 2⁶³ less a page where there is no limit, and version 2 "max"


def parse_size(text: str, where: str) -> int:
    """Bytes from text such as "8GB" or "500 MiB". Raises UserError, with the place `where`, for other text and 0."""
    match = _SIZE.fullmatch(text)
    count = 0 if match is None else int(float(match[1]) * _UNITS[match[2].upper()])
    if count <= 0:
        raise UserError(where, f'"{text}"', expected=_EXPECTED)
    return count


def format_size(count: float) -> str:
    """Bytes in words, such as "12.7 GB"."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= factor:
            return f"{count / factor:.3g} {unit}"
    return f"{count:.0f} bytes"


@contextmanager
def memory_setting(text: str | None) -> Iterator[None]:
    """States the limit of this process, and of those that it starts, while the block runs; None leaves it.

    Raises UserError for text that isn't a size.
    """
    if text is None:
        yield
        return
    parse_size(text, "--memory")
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = text
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before


def allowed_bytes() -> int:
    """The memory that this process may still take. Raises UserError where HOLOVIEW_MEMORY isn't a size."""
    stated = os.environ.get(VARIABLE)
    if stated is not None:
        return max(parse_size(stated, VARIABLE) - psutil.Process().memory_info().rss, 0)
    return int(FREE_SHARE * free_bytes())


def free_bytes() -> int:
    """The memory that new allocations can have: of the machine, of the control group, of the address space."""
    left = [psutil.virtual_memory().available, *_cgroup_left(_ROOT / MOUNT, _ROOT / MEMBERSHIP)]
    return min([*left, *_address_space_left()])


def require_memory(where: str, needed: float, remedy: str = "make it smaller") -> None:
    """Raises UserError, with the numbers, if `needed` bytes exceed what this process may still take.

    where: the file or the computation that needs them. remedy: a change by which it needs less.
    """
    if needed <= (allowed := allowed_bytes()):
        return
    stated = os.environ.get(VARIABLE)
    if stated is None:
        limit = f"{format_size(allowed)} may be taken of the {format_size(free_bytes())} that are free"
    else:
        limit = f"{format_size(allowed)} are left of the {stated.strip()} that were allowed"
    more = f"{remedy}, or allow more, e.g. --memory {_round_up(needed)}"
    raise UserError(where, f"needs about {format_size(needed)} of memory, but {limit}", remedy=more)


def workers_within_memory(workers: int, needed: float = 0.0) -> int:
    """As many of `workers` processes as fit into what this process may still take, at least 1.

    needed: bytes that the work of each takes.
    """
    return max(1, min(workers, int(allowed_bytes() // (WORKER_BYTES + needed))))


def worker_share(workers: int, allowed: int | None = None) -> str:
    """The limit of each of so many processes, as HOLOVIEW_MEMORY states it: equal shares of what may still be taken.

    allowed: bytes that they share; None: all that this process may still take.
    """
    share = (allowed_bytes() if allowed is None else allowed) // workers
    return f"{max(share // 10**6, 1)}MB"


def _address_space_left() -> Iterator[int]:
    """The bytes of address space that the process may still take where that is limited (Linux)."""
    if sys.platform == "linux":
        most = resource.getrlimit(resource.RLIMIT_AS)[0]
        if most != resource.RLIM_INFINITY:
            yield max(most - psutil.Process().memory_info().vms, 0)


def _round_up(needed: float) -> str:
    """A size to state so that `needed` bytes fit beside the memory that the program itself takes."""
    return f"{int((needed + psutil.Process().memory_info().rss) * 1.1 / 1e9) + 1}GB"


def _cgroup_left(mount: Path, membership: Path) -> Iterator[int]:
    """The bytes that each memory limit of this process's control groups leaves; files' caches count as free."""
    for group in group_folders(mount, membership, "memory"):
        for limit, usage, cache in _GROUP_FILES:
            most = read_lines(group / limit)
            if most and most[0].isdecimal() and int(most[0]) < _NO_LIMIT and (used := read_lines(group / usage)):
                statistics = dict(line.split(" ", 1) for line in read_lines(group / "memory.stat") if " " in line)
                yield max(int(most[0]) - int(used[0]) + int(statistics.get(cache, 0)), 0)


# --- memory that was freed --------------------------------------------------------------------------------------------


def give_back_freed_memory(beyond: int) -> None:
    """Gives freed memory back where this process takes more than so many bytes; outside Linux, does nothing.

    GNU's allocator keeps freed memory between blocks in use: of 7 GB after fits to large pictures, 3.9 GB were free.
    """
    if sys.platform == "linux" and psutil.Process().memory_info().rss > beyond:
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # other C libraries lack it
        if trim is not None:
            trim(0)
