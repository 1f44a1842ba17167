"""The inputs of a frame as shaders read them: a protocol that `holoview.optics.frame_inputs` fulfils."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


class DeviceArray(Protocol):
    """A complex array that can be copied to host memory, such as a torch.Tensor."""

    def cpu(self) -> Any:
        """A copy in host memory with a method `numpy()`."""


class ShaderInputs(Protocol):
    """Optical paths, transmissions and pupils of a frame."""

    @property
    def pupils(self) -> Sequence[Sequence[DeviceArray | None]]:
        """pupils[relay][wavelength]: complex (P_y, P_x), or None if the relay neither apodises nor aberrates."""

    @property
    def sampled_transmissions(self) -> object | None:
        """None if the transmission of each modulator is exp(2πi·opd/λ) of its pixels."""

    def stroke_fractions(self, frame: int, modulator: int, stroke_m: float) -> NDArray[np.float32]:
        """Optical path of a modulator's pixels divided by the stroke (m), (y, x)."""

    def is_sampled(self, modulator: int) -> bool:
        """Whether a modulator's transmission is given sample by sample."""

    def transmission(self, frame: int, modulator: int, wavelength: int) -> DeviceArray | None:
        """Complex transmission of a modulator's samples, (y, x); None if it isn't given sample by sample."""
