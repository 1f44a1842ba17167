"""Adapters are enumerated from several threads at once, as jobs do that open devices."""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
import wgpu

from holoview.gpu.adapter import native_adapters


def test_several_threads_may_look_for_adapters_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def enumerate_slowly() -> list[Any]:
        time.sleep(0.02)
        return []

    native_adapters()  # loads the library, which brings the function that is replaced
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr(wgpu.gpu, "enumerate_adapters_sync", enumerate_slowly)
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda _: native_adapters(), range(8))) == [[]] * 8
    assert "XDG_RUNTIME_DIR" not in os.environ
