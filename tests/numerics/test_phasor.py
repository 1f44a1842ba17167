"""Phasors of thousands of turns are as exact as those of their fractions."""

from __future__ import annotations

import torch

from holoview.numerics.fourier import phasor_of_turns


def test_whole_turns_change_nothing() -> None:
    turns = torch.linspace(-0.5, 0.5, 33, dtype=torch.float64)
    expected = torch.exp(2j * torch.pi * turns)
    torch.testing.assert_close(phasor_of_turns(turns), expected, rtol=0, atol=1e-15)
    torch.testing.assert_close(phasor_of_turns(turns + 4096), expected, rtol=0, atol=1e-11)


def test_the_precision_is_that_of_the_turns() -> None:
    assert phasor_of_turns(torch.zeros(2)).dtype == torch.complex64
