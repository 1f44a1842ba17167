"""Off by 3 nm is a bench whose wavelength is 3 nm longer."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import torch

from holoview.bench.captures.dataset import Captures

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_it_adds_to_every_wavelength(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(2, wavelength_m=np.array([520e-9, 600e-9]))
    longer = dataclasses.replace(captures, wavelength_m=captures.wavelength_m + 3e-9)
    found = predicted(captures, {"wavelength_offset": {"offset": 3e-9}})
    torch.testing.assert_close(found, predicted(longer), rtol=1e-9, atol=0)
