"""Beams and columns are each computed once, in parts of the size that was asked for."""

from __future__ import annotations

import pytest
import torch

from holoview.optimise.beams import BeamGroup, ZeroTails, block_bytes, group_beams, slices

COLOURS = [(0, 0), (0, 1), (0, 2), (1, 0), (1, 2)]  # (frame, wavelength)
SEQUENTIAL = [(0, 0), (1, 1), (2, 2)]


@pytest.mark.parametrize(("total", "size"), [(10, 3), (9, 3), (2, 5), (0, 4), (7, 0)])
def test_slices_cover_everything_once(total: int, size: int) -> None:
    parts = slices(total, size)
    assert [i for part in parts for i in range(total)[part]] == list(range(total))
    assert all(part.stop - part.start <= max(1, size) for part in parts)


@pytest.mark.parametrize("lasers", [COLOURS, SEQUENTIAL], ids=["colours", "sequential"])
@pytest.mark.parametrize("sources", [1, 3])
@pytest.mark.parametrize("limit", [1, 250, 400, 10_000])
def test_groups_hold_every_beam_once_with_its_wavelength(
    lasers: list[tuple[int, int]], sources: int, limit: int
) -> None:
    wavelengths = [0, 1, 2]
    groups = group_beams(lasers, wavelengths, sources, 100, limit)
    found = []
    for group in groups:
        assert group.shape[0] * group.shape[1] <= max(1, limit // 100)
        chosen = range(len(lasers))[group.lasers]
        assert [lasers[i][1] for i in chosen] == wavelengths[group.wavelengths]
        found += [(i, s) for i in chosen for s in range(sources)[group.sources]]
    assert sorted(found) == [(i, s) for i in range(len(lasers)) for s in range(sources)]


def test_beams_are_joined_as_far_as_their_wavelengths_follow_each_other() -> None:
    groups = group_beams(COLOURS, [0, 1, 2], 2, 100, 10_000)
    assert groups == [
        BeamGroup(slice(0, 3), slice(0, 2), slice(0, 3)),
        BeamGroup(slice(3, 4), slice(0, 2), slice(0, 1)),
        BeamGroup(slice(4, 5), slice(0, 2), slice(2, 3)),
    ]


def test_a_gpu_gets_larger_blocks() -> None:
    assert block_bytes(torch.device("cuda")) > 100 * block_bytes(torch.device("cpu"))


def test_tails_stay_zero_while_the_rest_is_used_again() -> None:
    tails, like = ZeroTails(), torch.ones(2, 3)
    first = tails.buffer(like, -1, 5)
    first[:, :3] = 7
    again = tails.buffer(like, -1, 5)
    assert again is first
    assert not again[:, 3:].any()
    shorter = tails.buffer(torch.ones(2, 2), -1, 5)
    assert shorter is not first
    assert not shorter.any()
