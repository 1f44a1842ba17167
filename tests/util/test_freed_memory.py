"""What was freed between what is in use goes back to the system."""

from __future__ import annotations

import platform

import numpy as np
import psutil
import pytest

from holoview.util.memory import give_back_freed_memory

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
