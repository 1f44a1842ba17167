"""The frequencies that are computed; beams and columns are each computed once, in parts of the size asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch

from holoview.holograms.optimise.beams import (
    BeamGroup,
    ZeroTails,
    block_bytes,
    group_beams,
    samples_a_pixel,
    slices,
    spectral_axes,
)
from holoview.holograms.optimise.forward_model import ForwardModel
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.numerics.sampling import frequency_indices

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


Bench = Callable[..., System]


def test_every_frequency_that_a_transfer_function_passes_is_computed(case: str, plan_of: Callable[[str], Any]) -> None:
    plan = plan_of(case)
    y, x = spectral_axes(plan)
    relays = [(1, plane, y.last_frequencies, x.last_frequencies) for plane in range(len(plan.planes))]
    if plan.system.gap_m is not None:
        relays.append((0, 0, y.gap_frequencies, x.gap_frequencies))
    for relay, plane, ky, kx in relays:
        for λ in range(len(plan.system.wavelengths_m)):
            support = plan.transfer(relay, λ, plane).support
            lit = support[:, 1] <= support[:, 2]
            assert set(frequency_indices(len(support))[lit]) <= set(ky.tolist())
            assert lit.any()
            assert support[lit, 1].min() >= kx.min()
            assert support[lit, 2].max() <= kx.max()


def test_the_pixels_spectrum_has_no_more_numbers_than_its_period(case: str, plan_of: Callable[[str], Any]) -> None:
    plan = plan_of(case)
    for axis, padded in zip(spectral_axes(plan), plan.grid.padded, strict=True):
        assert axis.pixels.frequencies == min(axis.gap.frequencies, padded // samples_a_pixel(plan))
        covered = [i for columns, entries in axis.tiles for i in range(columns.start, columns.stop)]
        assert covered == list(range(axis.gap.frequencies))


@pytest.mark.parametrize("width", [1, 3, 100])
def test_tiles_repeat_the_period_of_the_pixels_spectrum(width: int, case: str, plan_of: Callable[[str], Any]) -> None:
    for axis in spectral_axes(plan_of(case)):
        found = torch.full((axis.gap.frequencies,), -1)
        for part, tiles in axis.tiles_of_blocks(width):
            for columns, entries in tiles:
                found[columns] = torch.arange(part.start, part.stop)[entries]
        period = axis.pixels.padded
        assert found.tolist() == [i % period for i in range(axis.gap.frequencies)]


def test_first_orders_take_a_quarter_of_the_spectrum(bench: Bench) -> None:
    orders = {"relay1.square": "first order", "relay2.square": "first order", "propagation": "periodic"}
    model = ForwardModel(make_plan(bench(**orders)))
    rows, columns = model.plan.grid.padded
    spectrum = model.spectrum(0, 0).whole
    assert tuple(spectrum.shape) == (rows // 2 - 1, columns // 2 - 1)
    assert model.transfer_functions.planes[0].shape[-2:] == spectrum.shape


def test_where_nothing_passes_there_is_no_light(bench: Bench, noise: Callable[..., torch.Tensor]) -> None:
    system = bench(**{"relay2.iris_na": 1e-5, "relay2.centre_na": [0.0013, 0.0], "propagation": "periodic"})
    plan = make_plan(system)
    model = ForwardModel(plan)
    model.forward(noise(0, *system.drive_shape) * 825e-9)
    rows = model.process_planes([0], lambda plane, rows, fields: fields.abs().max(), carry_back=False)
    assert float(max(rows[0])) == 0.0
