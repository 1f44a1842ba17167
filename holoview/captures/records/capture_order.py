"""Patterns and pictures that are out of step: the pattern of a capture is recorded some captures further on."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.records.correction import Correction

_SETTINGS = ("wavelength_m", "distance_m", "power", "exposure_s")


@dataclass(frozen=True)
class PatternOffset(Correction):
    """Patterns are recorded `offset` captures after their pictures (before them if negative).

    slms: the modulators concerned, from 0. with_settings: wavelength, distance, power and exposure are out of step with
    the pictures too. wraps: the captures at one end belong to the pictures at the other; otherwise those have no
    pattern in the file, and are left out.
    """

    offset: int
    slms: tuple[int, ...]
    modulators: int
    with_settings: bool = False
    wraps: bool = True

    effect = "capture_order"

    @property
    def is_plain(self) -> bool:
        """Whether it concerns the patterns of all modulators, and nothing else."""
        return not self.with_settings and len(self.slms) == self.modulators

    @property
    def choice(self) -> str:
        which = f" of modulator {self.slms[0] + 1}" if len(self.slms) < self.modulators else ""
        return f"offset:{self.offset:+d}{which}{' with settings' * self.with_settings}"

    @property
    def sentence(self) -> str:
        one = len(self.slms) < self.modulators
        who = f"The patterns of modulator {self.slms[0] + 1}" if one else "The patterns"
        also = ", with their wavelengths, distances, powers and exposures," * self.with_settings
        count, where = abs(self.offset), "later" if self.offset > 0 else "earlier"
        ends = "" if self.wraps else " Captures whose pattern isn't in the file are left out."
        return f"{who}{also} stand {count} capture{'s' * (count > 1)} {where} in the file than their pictures.{ends}"

    def apply(self, captures: Captures) -> Captures:
        levels = captures.levels.copy()
        for slm in self.slms:
            levels[:, slm] = np.roll(levels[:, slm], -self.offset, axis=0)
        changed: dict[str, NDArray[np.generic]] = {"levels": levels}
        if self.with_settings:
            changed |= {name: np.roll(getattr(captures, name), -self.offset) for name in _SETTINGS}
        moved = dataclasses.replace(captures, **changed)  # type: ignore[arg-type]
        return moved if self.wraps else moved.subset(np.flatnonzero(~self.wrapped(len(captures))))

    def wrapped(self, count: int) -> NDArray[np.bool_]:
        """Which of `count` pictures would get a pattern from the other end of the file."""
        source = np.arange(count) + self.offset
        return (source < 0) | (source >= count)

    def without_ends(self) -> PatternOffset:
        """The same, but the pictures at the end have no pattern."""
        return dataclasses.replace(self, wraps=False)


def offset_candidates(captures: Captures, largest: int) -> list[Correction]:
    """Offsets up to ± `largest` of all patterns, of those of each modulator, and of patterns with their settings."""
    modulators = len(captures.slms)
    each = [tuple(range(modulators)), *((slm,) for slm in range(modulators) if modulators > 1)]
    most = min(largest, len(captures) // 2)
    steps = [sign * n for n in range(1, most + 1) for sign in (1, -1)]
    settings_vary = any(len(np.unique(getattr(captures, name))) > 1 for name in _SETTINGS[:2])
    found = [PatternOffset(n, slms, modulators) for slms in each for n in steps]
    if settings_vary:
        found += [PatternOffset(n, each[0], modulators, with_settings=True) for n in steps]
    return list(found)
