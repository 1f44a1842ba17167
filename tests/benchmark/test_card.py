"""The report of a run on a card: every setting of the question once, its pairs, and a call that goes on."""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

from benchmarks import card

SCALE = card.Scale.dry()


def rows() -> list[dict[str, Any]]:
    """All settings with a made-up result, in which modulator 2 gains as many dB as there are lasers."""
    return [row | {"psnr_db": 20.0 + row["lasers"] * (row["modulators"] - 1)} for row in card.question(SCALE)]


def test_each_setting_has_its_partner_and_comes_once() -> None:
    keys = [card._key(row) for row in rows()]
    assert len(set(keys)) == len(keys)
    found = card.gains(rows())
    assert 2 * len(found) == len(keys)
    assert all(gain == row["lasers"] for row, gain in found)


def test_the_table_has_a_row_for_each_case_and_counts_its_pairs() -> None:
    lines = card.question_table(rows()).splitlines()
    assert len(lines) == 2 + 2 * (2 + 4 + 4)  # stops; losses × what is free, by lasers
    assert all(line.endswith("| 6 |") for line in lines[2:])  # three scenes, two seeds
    assert "| 8.00 | 8.00 | 8.00 |" in next(line for line in lines if line.startswith("| 8 λ"))


def test_a_further_call_optimises_only_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results = {"psnr_db": 20.0, "speckle_contrast": 0.3, "eyebox_variation": 0.1, "seconds": 1.0}
    commands: list[list[str]] = []

    def answer(command: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
        commands.append(command)
        failed = len(commands) == 3
        return subprocess.CompletedProcess(command, int(failed), json.dumps(results), "out of memory")

    monkeypatch.setattr(card.subprocess, "run", answer)
    total = len(list(card.question(SCALE)))
    card.run_question(SCALE, tmp_path, time.monotonic() + 3600)
    assert len(commands) == total
    card.run_question(SCALE, tmp_path, time.monotonic() + 3600)
    assert commands[total:] == [commands[2]]
    card.run_question(SCALE, tmp_path, time.monotonic() - 1)
    assert len(commands) == total + 1
    assert len((tmp_path / "question.jsonl").read_text().splitlines()) == total


def test_what_failed_or_was_stopped_is_in_the_report() -> None:
    entries = [
        {"name": "one", "command": "a", "failed": "no adapter"},
        {"name": "two", "command": "b", "stopped_after_s": 60.0},
        {"name": "three", "command": "c", "result": "a window: 3 ms"},
    ]
    text = card.report_text({"dry_run": True, "card": "", "steps": entries, "question": rows()})
    assert all(words in text for words in ("no adapter", "stopped after 60.0 s", "a window: 3 ms", "mean nothing"))
    assert "The second modulator's gain" in text
