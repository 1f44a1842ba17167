"""Ratios beside those that were kept: what counts as a change, and what is kept for whom."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import ratios


@pytest.mark.parametrize(
    ("now", "kept", "expected"),
    [
        ([1.10, 1.11, 1.12], [1.0, 1.01, 1.02], 1.11 / 1.01 - 1),  # slower
        ([0.90, 0.91, 0.92], [1.0, 1.01, 1.02], 0.91 / 1.01 - 1),  # faster
        ([1.03, 1.04, 1.05], [1.0, 1.01, 1.02], None),  # apart, but by 3 %
        ([1.00, 1.11, 1.12], [1.0, 1.01, 1.02], None),  # by 10 %, but a run as before
    ],
)
def test_a_change_is_larger_than_five_per_cent_and_than_the_scatter(
    now: list[float], kept: list[float], expected: float | None
) -> None:
    assert ratios.change(now, kept) == (None if expected is None else pytest.approx(expected))


def test_results_are_kept_by_processor_and_a_slower_one_ends_with_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file, found = tmp_path / "ratios.json", {"plane / frame": [0.4, 0.41, 0.42]}
    monkeypatch.setattr(ratios, "measure", lambda *_: found)
    monkeypatch.setattr(ratios, "processor_name", lambda: "one")
    options = ["--file", str(file)]
    assert ratios.main(options) == 0
    assert not file.exists()
    assert "has nothing of this processor yet" in capsys.readouterr().out
    assert ratios.main([*options, "--keep"]) == 0
    monkeypatch.setattr(ratios, "processor_name", lambda: "two")
    assert ratios.main([*options, "--keep"]) == 0
    assert set(json.loads(file.read_text(encoding="utf-8"))) == {"one", "two"}
    found["plane / frame"] = [0.5, 0.51, 0.52]
    capsys.readouterr()
    assert ratios.main(options) == 1
    assert "slower: +24%" in capsys.readouterr().out
    found["plane / frame"] = [0.3, 0.31, 0.32]
    assert ratios.main(options) == 0
