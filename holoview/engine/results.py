"""The results of a session on the device: what each was computed from, and how those that are stale are recorded.

Each result has the identity of what it was computed from, and is stale when that is no longer the identity that the
bench gives. It has none while it is written, until all of that is submitted, since work may be dropped half way. What
has no room is computed again when it is needed, and so is what has never been of use twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from holoview.engine.display import Display, Share
from holoview.engine.fused import FusedFrame, Rows, Span
from holoview.engine.inputs import Identity
from holoview.engine.kernels import Kernels
from holoview.engine.shelf import Lit, Shelf, Slices, Weight
from holoview.gpu.device import Buffer
from holoview.gpu.lines import Strategy
from holoview.gpu.recorder import Recorder
from holoview.plan import Plan

if TYPE_CHECKING:
    from holoview.optics.slots import FrameSlots


@dataclass(frozen=True)
class Settings:
    """How a session computes: see `FrameSession`."""

    budget_bytes: int
    together: int


class Results:
    """Memory on a device for the results of a plan, none of which is known at first, and the kernels that make them.

    Raises UserError when the grid exceeds the device's limits.
    """

    def __init__(self, plan: Plan, slots: FrameSlots, shaders: Kernels, settings: Settings, strategy: Strategy) -> None:
        together, device = settings.together if is_clear(slots) else 1, shaders.device
        self.frame = FusedFrame(plan, slots, device, together=together, strategy=strategy, shaders=shaders)
        self.display = Display(device, plan.grid.shape)
        self.seen, self.picture = self.display.seen("XYZ"), self.display.picture("picture")
        self.seen_of: Identity = None
        self.picture_of: Identity = None
        lit_first = sorted(np.ndindex(*plan.weights.shape), key=lambda lit: plan.weights[lit] == 0)
        self._slices = Slices(self.display, lit_first, together, settings.budget_bytes)
        self._shelf = Shelf(self.frame, settings.budget_bytes - self._slices.memory_bytes)
        self._keeps_first = False

    @property
    def plan(self) -> Plan:
        """What is to be computed."""
        return self.frame.inputs.plan

    @property
    def memory_bytes(self) -> int:
        """Memory on the device that fields and intensities take."""
        return self.frame.memory_bytes + self._shelf.memory_bytes + self._slices.memory_bytes

    def use(self, plan: Plan, slots: FrameSlots, plane_m: float) -> None:
        """Go on with a plan of the same structure."""
        before = self._rows_identities()
        self.frame.inputs.use(plan, slots)
        self.frame.inputs.set_distance(1, plane_m)
        self._keeps_first |= self._begins_at_the_gap(before)

    def use_strategy(self, strategy: Strategy) -> None:
        """Go on by another strategy. Intensities stay; fields are spectra along x in the order of the one before."""
        self.frame.use_strategy(strategy)
        self._shelf.forget()

    def forget(self) -> None:
        """Everything is stale."""
        self._slices.identities.clear()
        self._shelf.forget()
        self.seen_of = self.picture_of = None

    # --- what is stale ----------------------------------------------------------------------------------------------

    def is_housed(self, lit: Lit) -> bool:
        """Whether an intensity has a place of its own."""
        return self._slices.is_housed(lit)

    def is_fresh(self, lit: Lit) -> bool:
        """Whether an intensity is there and what the bench gives now."""
        return self.is_housed(lit) and self._slices.identities.get(lit) == self.identity(lit)

    def identity(self, lit: Lit) -> Identity:
        """What the intensity of a frame and wavelength is computed from."""
        frame, wavelength = lit
        inputs = self.frame.inputs
        rows = tuple(inputs.rows_of(frame, source, wavelength)[1] for source in range(len(self.plan.slopes)))
        return rows, inputs.plane_of(wavelength)

    def _rows_identities(self) -> tuple[Identity, Identity]:
        """What the first and the second rows of the first laser that is lit are computed from."""
        frame, wavelength = np.argwhere(self.plan.weights > 0)[0].tolist()
        return self.frame.inputs.rows_of(frame, 0, wavelength)

    def _begins_at_the_gap(self, before: tuple[Identity, Identity]) -> bool:
        """Whether the first rows would have been of use after an edit, and may be kept for the next one like it.

        They aren't kept from the start: it costs each frame a copy, since kernels then can't work in place.
        """
        first, second = self._rows_identities()
        fields = 2 * len(self.plan.slopes) * int(np.count_nonzero(self.plan.weights))
        return first == before[0] and second != before[1] and self._shelf.has_room_for(fields)

    # --- recording --------------------------------------------------------------------------------------------------

    def expose(self, span: Span, recorder: Recorder) -> None:
        """Adds the light of a source to the intensities of a span, or begins them with the first source."""
        second = self._second_rows(span, recorder)
        keys = [(span.frame, span.wavelength + i) for i in range(span.count)]
        self._slices.identities.update(dict.fromkeys(keys))
        self.frame.observe(recorder, span, second, self._slices.place(keys[0]), adds=span.source > 0)
        if span.source == len(self.plan.slopes) - 1:
            complete = {key: self.identity(key) for key in keys}
            recorder.then(partial(self._slices.identities.update, complete))

    def blend(self, weights: dict[Lit, Weight], seen_of: Identity, recorder: Recorder) -> None:
        """Begins XYZ with the intensities that stay where they are."""
        self._see(seen_of, recorder)
        if not self._slices.banks:
            recorder.clear(self.seen)
        housed = {key: weight for key, weight in weights.items() if self.is_housed(key)}
        for number, bank in enumerate(self._slices.banks):
            self._composite(recorder, bank, self._slices.shares(housed, bank), adds=number > 0)

    def add(self, run: Span, weights: dict[Lit, Weight], seen_of: Identity, recorder: Recorder) -> None:
        """Adds intensities to XYZ before the next ones take their place."""
        some = {key: weights[key] for key in ((run.frame, run.wavelength + i) for i in range(run.count))}
        place = self._slices.place((run.frame, run.wavelength))
        self._composite(recorder, place.buffer, self._slices.shares(some, place.buffer), adds=True)
        self._see(seen_of, recorder)

    def show(self, exposure_stops: float, picture_of: Identity, recorder: Recorder) -> None:
        """Makes the picture of a complete XYZ."""
        self.display.show(recorder, self.seen, self.picture, exposure_stops)
        self.frame.kernels["show"] += 1
        self.picture_of = None
        recorder.then(partial(setattr, self, "picture_of", picture_of))

    def intensity(self, lit: Lit) -> NDArray[np.float32]:
        """An intensity at unit amplitude, (y, x), as it was last computed."""
        place = self._slices.place(lit)
        return self.display.intensity(place.buffer, place.first)

    def _second_rows(self, span: Span, recorder: Recorder) -> Rows:
        """The light behind the last modulator: what is kept of it, else computed from as far on as possible."""
        wavelengths = range(span.wavelength, span.wavelength + span.count)
        of = [self.frame.inputs.rows_of(span.frame, span.source, wavelength) for wavelength in wavelengths]
        first_of, second_of = [first for first, _ in of], [second for _, second in of]
        home = self._shelf.rows("second", span)
        if home is not None and self._shelf.holds("second", span, second_of):
            return home
        if self.plan.system.gap_m is None:
            rows = self.frame.first(recorder, span, home)
        else:
            first = self._first_rows(span, recorder, first_of, home if self.frame.works_in_place else None)
            rows = self.frame.second(recorder, span, first, home)
        if home is not None:
            self._mark("second", span, second_of, recorder)
        return rows

    def _first_rows(self, span: Span, recorder: Recorder, first_of: list[Identity], otherwise: Rows | None) -> Rows:
        """The light behind the first of two modulators, kept, or computed where it is kept or else `otherwise`."""
        home = self._shelf.rows("first", span) if self._keeps_first else None
        if home is not None and self._shelf.holds("first", span, first_of):
            return home
        if home is None:
            return self.frame.first(recorder, span, otherwise)
        self._mark("first", span, first_of, recorder)
        return self.frame.first(recorder, span, home)

    def _mark(self, name: str, span: Span, identities: Sequence[Identity], recorder: Recorder) -> None:
        """Fields that are being written count as those of `identities` once all of that is submitted.

        They don't where another strategy has been taken meanwhile: they are spectra in the order of the one before.
        """
        self._shelf.mark(name, span, [None] * span.count)
        strategy = self.frame.strategy

        def mark() -> None:
            if self.frame.strategy == strategy:
                self._shelf.mark(name, span, identities)

        recorder.then(mark)

    def _see(self, seen_of: Identity, recorder: Recorder) -> None:
        """The same for XYZ."""
        self.seen_of = None
        recorder.then(partial(setattr, self, "seen_of", seen_of))

    def _composite(self, recorder: Recorder, intensity: Buffer, shares: Sequence[Share], *, adds: bool) -> None:
        self.display.composite(recorder, intensity, shares, self.seen, adds=adds)
        self.frame.kernels["composite"] += 1


def is_clear(slots: FrameSlots) -> bool:
    """Whether no relay has a pupil, and no modulator a transmission of its samples."""
    return slots.light is None and all(pupil is None for pupils in slots.pupils for pupil in pupils)
