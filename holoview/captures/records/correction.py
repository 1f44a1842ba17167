"""What a correction of a session's records is: a wrong record with a name, and the captures as they should have been.

Corrections are applied in the order of the catalogue (`ORDER`). The exchange of the modulators' patterns is undone
first, so that "modulator 1" is the one on the bench in every other correction.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures

ORDER = (
    "slm_exchange",
    "slm1_orientation",
    "slm2_orientation",
    "camera_orientation",
    "slm1_inverted",
    "slm2_inverted",
    "capture_order",
    "wavelength_order",
    "distance_order",
    "power_order",
)
"""The ids of all kinds of wrong records."""


@dataclasses.dataclass(frozen=True)
class Correction(ABC):
    """A wrong record that can be put right. Instances are small and comparable."""

    @property
    @abstractmethod
    def effect(self) -> str:
        """The id of the wrong record, one of `ORDER`."""

    @property
    @abstractmethod
    def choice(self) -> str:
        """What happened to the records, as a short text; empty where the id says it all."""

    @property
    @abstractmethod
    def sentence(self) -> str:
        """The finding in words."""

    @abstractmethod
    def apply(self, captures: Captures) -> Captures:
        """The captures with this record as it should have been."""

    @property
    def label(self) -> str:
        """Id and choice."""
        return f"{self.effect} {self.choice}".strip()


Hypothesis = tuple[Correction, ...]
"""Corrections to be applied together; () leaves the captures as they are recorded."""


def hypothesis(corrections: Iterable[Correction]) -> Hypothesis:
    """The corrections in the order in which they are applied."""
    return tuple(sorted(corrections, key=lambda c: ORDER.index(c.effect)))


def apply_corrections(captures: Captures, corrections: Hypothesis) -> Captures:
    """The captures as they should have been recorded, without a note of it."""
    for correction in corrections:
        captures = correction.apply(captures)
    return captures


def with_levels(captures: Captures, slm: int, levels: NDArray[np.unsignedinteger]) -> Captures:
    """The captures with other patterns (capture, y, x) of modulator `slm`, which counts from 0."""
    changed = captures.levels.copy()
    changed[:, slm] = levels
    return dataclasses.replace(captures, levels=changed)
