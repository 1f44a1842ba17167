"""Counts in other bits than are stated are put right where it is sure, and refused with the right advice elsewhere."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.bench.captures import Captures, read_captures, write_captures
from holoview.bench.captures.count_bits import counts_as_stated
from holoview.bench.captures.validation import check_captures, check_settings, summarise
from holoview.util.errors import UserError

Make = Callable[..., Captures]


def _counts(seed: int = 0) -> NDArray[np.uint16]:
    """Six pictures of speckle by a camera of 12 bits, of which 2 % are saturated: 4095 = 4 means of e⁻⁴."""
    intensity = np.random.default_rng(seed).exponential(4095 / 4, (6, 64, 80))
    return np.clip(64 + intensity, 0, 4095).astype(np.uint16)


@pytest.mark.parametrize("layout", ["left-justified", "replicated", "scaled", "multiplied"])
def test_counts_are_brought_back_to_the_stated_bits(layout: str) -> None:
    counts = _counts()
    stored = {
        "left-justified": counts << np.uint16(4),
        "replicated": counts << np.uint16(4) | counts >> np.uint16(8),
        "multiplied": counts * np.uint16(10),
        "scaled": np.rint(counts * (65535 / 4095)).astype(np.uint16),
    }[layout]
    said: list[str] = []
    assert np.array_equal(counts_as_stated(stored, 12, said.append), counts)
    assert len(said) == 1 and "brought back to 12 bits" in said[0]


def test_what_the_advice_says_is_then_put_right() -> None:
    counts = _counts() // np.uint16(2)
    assert np.array_equal(counts_as_stated(counts * np.uint16(2), 11, lambda _: None), counts)


def test_counts_that_are_as_stated_stay(make_captures: Make) -> None:
    said: list[str] = []
    for counts, bits in ((_counts(), 12), (make_captures().images, 12), (make_captures().images, 16)):
        assert counts_as_stated(counts, bits, said.append) is counts
    assert not said


def test_counts_that_are_clipped_too_low_become_saturated() -> None:
    counts = np.minimum(_counts(), np.uint16(2600))
    said: list[str] = []
    found = counts_as_stated(counts, 12, said.append)
    assert np.array_equal(found == 4095, counts == 2600)
    assert np.array_equal(found[counts < 2600], counts[counts < 2600])
    assert f"{np.mean(counts == 2600):.2%} of the counts are 2600" in said[0]


@pytest.mark.parametrize(
    ("change", "bit_depth", "words"),
    [
        (lambda counts: counts // np.uint16(2) * np.uint16(2), 12, r"multiples of 2; .*bit_depth = 11"),
        (lambda counts: counts << np.uint16(2), 14, r"multiples of 4; .*bit_depth = 12"),
        (lambda counts: np.uint16(5) * counts, 16, r"multiples of 5; .*bit_depth = 12, .* counts divided by 5"),
        (lambda counts: counts + np.uint16(4000), 12, r"8095 counts; expected 0 to 4095 at 12 bits; correct bit_depth"),
        (lambda counts: counts << np.uint16(4), 16, r"all counts up to 65520 are multiples of 16; .*= 12"),
        (lambda counts: counts << np.uint16(4), 14, r"multiples of 16; .*bit_depth = 12, .* counts divided by 16"),
        (lambda counts: counts << np.uint16(4) | counts >> np.uint16(8), 16, r"12 bits replicated in 16; .*= 12,"),
        (lambda counts: counts, 16, r"of the counts are 4095, the largest, as of 12 bits; .*state bit_depth = 12"),
        (lambda counts: counts * np.uint16(10), 12, r"are multiples of 10; .*bit_depth = 12, .* counts divided by 10"),
    ],
)  # fmt: skip
def test_counts_of_other_bits_are_refused_with_advice(
    change: Callable[[NDArray[np.uint16]], NDArray[np.uint16]], bit_depth: int, words: str, make_captures: Make
) -> None:
    plain = make_captures(6)
    camera = dataclasses.replace(plain.camera, bit_depth=bit_depth)
    captures = dataclasses.replace(plain, images=change(_counts()), camera=camera)
    with pytest.raises(UserError, match=words):
        check_captures(captures)


def test_a_file_that_is_clipped_too_low_says_so(make_captures: Make, tmp_path: Path) -> None:
    counts = np.minimum(_counts(), np.uint16(2600))
    write_captures(tmp_path / "c.h5", dataclasses.replace(make_captures(6), images=counts), check_settings)
    found = summarise(read_captures(tmp_path / "c.h5"))
    assert found["clipped"] == {"level": 2600, "share": pytest.approx(np.mean(counts == 2600))}
    assert "clipped" not in summarise(make_captures())
