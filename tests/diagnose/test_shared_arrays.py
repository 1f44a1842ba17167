"""Objects for several processes: equal to what was stored, with large arrays in common memory."""

from __future__ import annotations

import multiprocessing

import numpy as np
import pytest

from holoview.bench.diagnose.worker_pool import ArrayStore, SharedObjects

LARGE = np.arange(1 << 19, dtype=np.uint16).reshape(2, 512, 512)


def test_objects_come_back_equal_and_large_arrays_are_no_part_of_the_pickle() -> None:
    store = ArrayStore()
    objects = {"a": LARGE, "again": LARGE, "cut": LARGE[:, 100:], "small": np.arange(3), "text": ("x", 1.5)}
    shared = store.store(objects)
    cut_bytes = objects["cut"].nbytes  # not in one piece of memory, so that it is copied
    assert len(shared.pickled) < cut_bytes + 10_000 and [n for _, n in shared.spans] == [LARGE.nbytes]
    found = shared.load()
    store.close()
    assert found["again"] is found["a"] and found["text"] == objects["text"]
    for name in ("a", "cut", "small"):
        assert np.array_equal(found[name], objects[name])


def test_what_one_process_writes_no_other_sees() -> None:
    store = ArrayStore()
    shared = store.store({"a": LARGE})
    first, second = shared.load()["a"], shared.load()["a"]
    assert not first.flags.owndata and first.flags.writeable
    first[0, 0, 0] = 7
    assert second[0, 0, 0] == LARGE[0, 0, 0] == 0
    store.close()


def test_objects_without_large_arrays_need_no_file() -> None:
    shared = ArrayStore().store({"text": "x"})
    assert shared.path is None and shared.load() == {"text": "x"}


def _total(shared: SharedObjects) -> int:
    return int(shared.load()["a"].sum(dtype=np.int64))


def test_another_process_reads_them() -> None:
    store = ArrayStore()
    shared = store.store({"a": LARGE})
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(_total, (shared,)) == LARGE.sum(dtype=np.int64)
    store.close()


def test_the_file_is_gone_once_the_store_is_closed() -> None:
    store = ArrayStore()
    shared = store.store({"a": LARGE})
    store.close()
    with pytest.raises(OSError):
        shared.load()
