"""`holoview view` where a library that windows need is missing."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import pytest


def test_a_missing_library_is_named(holoview: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "holoview.viewer.app.launch", None)
    done = holoview("view", "--offscreen", "--screenshot", "v.png")
    assert done.code == 2
    assert "window can't be drawn" in done.err and "libxext6" in done.err and "Traceback" not in done.err
