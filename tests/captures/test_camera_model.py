"""Caches drop what was used least recently; transforms of a band equal the whole transforms within the band."""

from __future__ import annotations

import pytest
import torch

import holoview as hv
from holoview.bench.captures.camera_model import FrequencyBand, InvariantCache, TensorCache
from holoview.light.optics.propagate import support_mask, transfer_function, transfer_function_at


def test_the_longest_unused_results_go_first() -> None:
    made: list[str] = []

    def make(name: str) -> torch.Tensor:
        made.append(name)
        return torch.zeros(10, dtype=torch.float64)

    cache = TensorCache(200)
    for name in ("a", "b", "a", "c", "a", "b"):
        cache.get(name, lambda name=name: make(name))  # type: ignore[misc]
    assert made == ["a", "b", "c", "b"]
    nothing = InvariantCache(cache)
    assert nothing.get("a", lambda: torch.zeros(1)) is not nothing.get("a", lambda: torch.zeros(1))


SHAPE, PADDED = (12, 15), (24, 30)


def _field() -> torch.Tensor:
    return torch.randn(*SHAPE, dtype=torch.complex128, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("reach", [(5, 4), (11, 3), (12, 15), (0, 0), (40, 2)])
def test_the_spectrum_is_cut_out_of_the_whole_one(reach: tuple[int, int]) -> None:
    band, field = FrequencyBand(PADDED, reach), _field()
    ky, kx = band.frequency_indices
    whole = torch.fft.fft2(torch.nn.functional.pad(field, (0, 15, 0, 12)))
    torch.testing.assert_close(band.forward(field), whole[ky][:, kx])
    kept = torch.zeros(PADDED, dtype=torch.complex128)
    kept[ky[:, None], kx[None, :]] = band.forward(field)
    torch.testing.assert_close(band.inverse(band.forward(field), SHAPE), torch.fft.ifft2(kept)[:12, :15])


def test_forward_and_inverse_are_adjoint_but_for_the_scale() -> None:
    band, field = FrequencyBand(PADDED, (5, 4)), _field()
    spectrum = torch.randn(11, 9, dtype=torch.complex128, generator=torch.Generator().manual_seed(1))
    left = torch.vdot(band.forward(field).flatten(), spectrum.flatten())
    right = torch.vdot(field.flatten(), band.inverse(spectrum, SHAPE).flatten()) * 24 * 30
    torch.testing.assert_close(left, right)


@pytest.mark.parametrize(
    "relay",
    [{"iris_na": 0.01}, {"iris_na": 0.03}, {}, {"square": "first order"}, {"square": 0.017}],
    ids=str,
)
def test_a_band_holds_all_that_a_relay_lets_through(relay: dict[str, float | str]) -> None:
    system = hv.load("holochrome-8").edit({"shape": [20, 28], "relay2": relay})
    plan = hv.make_plan(system, [0.01])
    step = plan.transfer(1, 0)
    band = FrequencyBand.from_transfer(step, plan.grid)
    whole = transfer_function(step, plan.grid, torch.complex128, torch.device("cpu"))
    ky, kx = band.frequency_indices
    assert torch.equal(transfer_function_at(step, ky, kx, torch.complex128), whole[ky][:, kx])
    assert int((whole[ky][:, kx] != 0).sum()) == int((whole != 0).sum())
    assert bool(support_mask(step, kx, ky % plan.grid.padded[0]).any(dim=0).all())  # and no column more


@pytest.mark.parametrize("relay", [{"iris_na": 0.02}, {"square": 0.017}, {"square": "first order"}], ids=str)
def test_a_band_around_a_displaced_stop_holds_its_light(relay: dict[str, float | str]) -> None:
    moved = {**relay, "centre_na": [-0.013, 0.019]}
    plan = hv.make_plan(hv.load("holochrome-8").edit({"shape": [20, 28], "relay2": moved}), [0.01])
    step = plan.transfer(1, 0)
    ky, kx = FrequencyBand.from_transfer(step, plan.grid).frequency_indices
    whole = transfer_function(step, plan.grid, torch.complex128, torch.device("cpu"))
    assert int((whole[ky][:, kx] != 0).sum()) == int((whole != 0).sum()) > 0
