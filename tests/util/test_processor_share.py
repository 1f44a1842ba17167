"""The share of the processor that a thread gets, as the kernel counts it."""

from __future__ import annotations

from pathlib import Path

import pytest

from holoview.util import processors as module
from holoview.util.processors import processor_share


@pytest.mark.parametrize(
    ("text", "share"),
    [("3000 1000 17\n", 0.75), ("5 0 1", 1.0), ("0 30 1", 1.0), ("", 1.0), ("words 1 2", 1.0)],
)
def test_it_is_what_ran_over_what_ran_or_waited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, share: float
) -> None:
    told = tmp_path / "schedstat"
    told.write_text(text)
    monkeypatch.setattr(module, "_SCHEDSTAT", told)
    assert processor_share() == share


def test_where_the_system_does_not_tell_it_is_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_SCHEDSTAT", tmp_path / "missing")
    assert processor_share() == 1.0


def test_this_thread_got_some() -> None:
    assert 0 < processor_share() <= 1
