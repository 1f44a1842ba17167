"""A hologram that is looked at while its bench is edited: after an edit, only what depends on it is computed again.

    first rows ─▶ second rows ─▶ intensity ─▶ XYZ ─▶ picture
    (frame, source, wavelength)  (frame, wavelength)

Each result is kept on the device with the identity of what it was computed from; it is stale when that identity is no
longer the one that the bench gives. There are no rules of what an edit invalidates beyond that:

    exposure                    the picture
    observer, amplitudes        XYZ and the picture: intensities are kept at unit amplitude
    focal plane, relay 2        from the second rows: one column FFT × H × column IFFT and one row IFFT a wavelength
    gap, relay 1, modulator 2   from the first rows
    one wavelength              that wavelength

What the memory budget has no room for is computed again when it is needed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.engine.display import Display, Share
from holoview.engine.fused import FusedFrame, Rows, Span
from holoview.engine.inputs import Identity
from holoview.engine.shelf import Lit, Shelf, Slices, Weight
from holoview.gpu.device import Buffer, Device
from holoview.gpu.lines import Strategy
from holoview.gpu.recorder import Recorder
from holoview.gpu.timer import Timer
from holoview.optics.slots import Slots, make_slots
from holoview.plan import Plan, make_plan
from holoview.system import System

Job = Callable[[Recorder], None]

BUDGET_BYTES = 2**30
"""Device memory for results that are kept, unless another budget is given."""


@dataclass(frozen=True)
class Step:
    """Progress of an update: `done` of `total` submissions."""

    done: int
    total: int


class FrameSession:
    """One drive of one system at one focal plane, on a device, ready for edits.

    After `edit`, either `update` computes what is stale, or the caller goes through `steps`, a small submission each,
    and may drop the rest as soon as another edit comes. What is seen is on the device as `seen` (XYZ, f32, (y, x, 4))
    and `picture` (8-bit sRGB, `display.pitch` pixels a row, ready to be copied to a texture), and on the host from
    `xyz`, `srgb8` and `intensity`. A `timer`, where one is set, takes the time of all dispatches on the device.

    half: store fields as f16 between kernels. together: the most wavelengths that are computed at a time where no relay
    has a pupil; one makes the smallest steps, several occupy a large GPU better. strategy: of the transforms; "passes"
    compile at once, "subgroup" is faster and takes long to compile; ask `has_subgroups` first.
    Raises UserError as `make_plan` and `make_slots` do, and when the grid exceeds the device's limits.
    """

    def __init__(
        self,
        system: System,
        drive: Any,
        device: Device,
        *,
        plane_m: float | None = None,
        exposure_stops: float = 0.0,
        budget_bytes: int = BUDGET_BYTES,
        half: bool = False,
        together: int = 1,
        strategy: Strategy = "passes",
    ) -> None:
        self.device = device
        self._budget, self._half, self._together = budget_bytes, half, together
        self._strategy = strategy
        self._drive, self._generation = drive, 0
        self.timer: Timer | None = None
        self._seen_of: Identity = None
        self._picture_of: Identity = None
        self.plane_m = float(system.planes_m[0]) if plane_m is None else plane_m
        self.exposure_stops = exposure_stops
        self._plan = make_plan(system, [*system.planes_m, self.plane_m])
        self._slots = make_slots(self._plan, drive)
        self._open()

    @property
    def system(self) -> System:
        """The bench as it was last edited."""
        return self._plan.nominal

    @property
    def kernels(self) -> Counter[str]:
        """How many fused kernels were dispatched, by name; `composite` and `show` among them."""
        return self._frame.kernels

    @property
    def memory_bytes(self) -> int:
        """Memory on the device that fields and intensities take."""
        return self._frame.memory_bytes + self._shelf.memory_bytes + self._slices.memory_bytes

    @property
    def traffic_bytes(self) -> int:
        """Bytes that the kernels read and write for a wavelength of a frame and a source, up to its intensity."""
        return self._frame.traffic_bytes

    def edit(
        self,
        *,
        system: System | None = None,
        drive: Any = None,
        plane_m: float | None = None,
        exposure_stops: float | None = None,
    ) -> None:
        """Changes what is to be computed, and computes nothing. Results stay those of before until they are updated.

        Raises UserError when the change is impossible; then nothing has changed.
        """
        given = self.system if system is None else system
        plane = self.plane_m if plane_m is None else plane_m
        plan, slots = self._plan, self._slots
        if system is not None or plane_m is not None:
            plan = make_plan(given, [*given.planes_m, plane])
        if drive is not None or _slots_of(plan) != _slots_of(self._plan):
            slots = make_slots(plan, self._drive if drive is None else drive)
        self._generation += 1
        before = self._rows_identities()
        self._drive = self._drive if drive is None else drive
        self.plane_m = plane
        self.exposure_stops = self.exposure_stops if exposure_stops is None else exposure_stops
        fits = _structure(plan, slots) == _structure(self._plan, self._slots)
        self._plan, self._slots = plan, slots
        if not fits:
            self._open()
        else:
            self._frame.inputs.use(plan, slots)
            self._frame.inputs.set_distance(1, plane)
            self._keeps_first |= self._begins_at_the_gap(before)

    def update(self, *, picture: bool = True) -> None:
        """Computes all that is stale, but not the picture without `picture`."""
        for _ in self.steps(picture=picture):
            pass

    def forget(self) -> None:
        """Everything is stale: the next update begins at the light source."""
        self._generation += 1
        self._slices.identities.clear()
        self._shelf.forget()
        self._seen_of = self._picture_of = None

    def steps(self, *, picture: bool = True, wait: bool = False) -> Iterator[Step]:
        """Computes what is stale, a submission a step; with `wait`, a step ends when the device has done it.

        The iterator ends early once the session is edited: what it has done stays, and the next one goes on from there.
        """
        generation, work = self._generation, self._work(picture)
        for done, job in enumerate(work, start=1):
            if generation != self._generation:
                return
            self._submit(job, wait)
            yield Step(done, len(work))

    def stack(self, planes_m: Sequence[float]) -> NDArray[np.float32]:
        """XYZ (plane, y, x, 3) at several planes, sharing all up to the second rows; the session's plane stays."""
        before, out = self.plane_m, []
        try:
            for plane_m in planes_m:
                self.edit(plane_m=plane_m)
                self.update()
                out.append(self.xyz())
        finally:
            self.edit(plane_m=before)
        return np.stack(out)

    def xyz(self) -> NDArray[np.float32]:
        """What the observer saw at the last update, XYZ (y, x, 3)."""
        return self.display.xyz(self.seen)

    def srgb8(self) -> NDArray[np.uint8]:
        """The picture of the last update, sRGB (y, x, 3), 8 bit."""
        return self.display.srgb8(self.picture)

    def intensity(self, wavelength: int) -> NDArray[np.float32]:
        """Intensity (y, x) of a wavelength as the bench is now: frames and sources averaged, amplitudes applied."""
        total = np.zeros(self._plan.grid.shape, np.float32)
        for frame in self._plan.lit(wavelength):
            lit = (frame, wavelength)
            if not self._is_fresh(lit):
                for span in self._sources(Span(frame, 0, wavelength)):
                    self._submit(partial(self._expose, span))
            place = self._slices.place(lit)
            unit = self.display.intensity(place.buffer, place.first)
            total += np.float32(self._plan.weights[lit]) * unit
        return total

    # --- what is stale ----------------------------------------------------------------------------------------------

    def _open(self) -> None:
        """Takes memory on the device for the results of the plan, none of which is known yet."""
        plan, slots = self._plan, self._slots
        self._frame = FusedFrame(
            plan,
            slots,
            self.device,
            half=self._half,
            together=self._together if _is_clear(slots) else 1,
            strategy=self._strategy,
        )
        self._frame.inputs.set_distance(1, self.plane_m)
        self.display = Display(self.device, plan.grid.shape)
        self.seen, self.picture = self.display.seen("XYZ"), self.display.picture("picture")
        self._seen_of = self._picture_of = None
        lit_first = sorted(np.ndindex(*plan.weights.shape), key=lambda lit: plan.weights[lit] == 0)
        self._slices = Slices(self.display, lit_first, self._frame.together, self._budget)
        self._shelf = Shelf(self._frame, self._budget - self._slices.memory_bytes)
        self._keeps_first = False

    def _work(self, picture: bool) -> list[Job]:
        """What has to be submitted, in order: intensities that stay, their blend, those that don't, the picture."""
        lit = [(int(f), int(w)) for f, w in np.argwhere(self._plan.weights > 0)]
        weights = {key: self._plan.weights[key] * self._plan.colour_weights[key[1]] for key in lit}
        seen_of = tuple((self._identity(key), weights[key].tobytes()) for key in lit)
        work: list[Job] = []
        for run in self._runs([key for key in lit if self._slices.is_housed(key) and not self._is_fresh(key)]):
            work += [partial(self._expose, span) for span in self._sources(run)]
        if self._seen_of != seen_of:
            homeless = self._runs([key for key in lit if not self._slices.is_housed(key)])
            work.append(partial(self._blend, weights, None if homeless else seen_of))
            for run in homeless:
                work += [partial(self._expose, span) for span in self._sources(run)]
                work.append(partial(self._add, run, weights, seen_of if run is homeless[-1] else None))
        picture_of = (seen_of, self.exposure_stops)
        if picture and self._picture_of != picture_of:
            work.append(partial(self._show, picture_of))
        return work

    def _runs(self, stale: list[Lit]) -> list[Span]:
        """Neighbouring wavelengths of a frame together, as many as may be computed at a time."""
        runs: list[Span] = []
        for frame, wavelength in stale:
            last = runs[-1] if runs else None
            follows = last is not None and (last.frame, last.wavelength + last.count) == (frame, wavelength)
            if last is not None and follows and wavelength % self._frame.together:
                runs[-1] = replace(last, count=last.count + 1)
            else:
                runs.append(Span(frame, 0, wavelength))
        return runs

    def _sources(self, run: Span) -> list[Span]:
        return [replace(run, source=source) for source in range(len(self._plan.slopes))]

    def _rows_identities(self) -> tuple[Identity, Identity]:
        """What the first and the second rows of the first laser that is lit are computed from."""
        frame, wavelength = np.argwhere(self._plan.weights > 0)[0].tolist()
        return self._frame.inputs.rows_of(frame, 0, wavelength)

    def _begins_at_the_gap(self, before: tuple[Identity, Identity]) -> bool:
        """Whether the first rows would have been of use after an edit, and may be kept for the next one like it.

        They aren't kept from the start: it costs each frame a copy, since kernels then can't work in place.
        """
        first, second = self._rows_identities()
        fields = 2 * len(self._plan.slopes) * int(np.count_nonzero(self._plan.weights))
        return first == before[0] and second != before[1] and self._shelf.has_room_for(fields)

    def _is_fresh(self, lit: Lit) -> bool:
        return self._slices.is_housed(lit) and self._slices.identities.get(lit) == self._identity(lit)

    def _identity(self, lit: Lit) -> Identity:
        """What the intensity of a frame and wavelength is computed from."""
        frame, wavelength = lit
        inputs = self._frame.inputs
        rows = tuple(inputs.rows_of(frame, source, wavelength)[1] for source in range(len(self._plan.slopes)))
        return rows, inputs.plane_of(wavelength)

    # --- submissions ------------------------------------------------------------------------------------------------

    def _submit(self, job: Job, wait: bool = False) -> None:
        recorder = Recorder(self.device, "frame", self.timer)
        job(recorder)
        recorder.submit(wait=wait)

    def _expose(self, span: Span, recorder: Recorder) -> None:
        """Adds the light of a source to the intensities of a span, or begins them with the first source."""
        second = self._second_rows(span, recorder)
        keys = [(span.frame, span.wavelength + i) for i in range(span.count)]
        place = self._slices.place(keys[0])
        self._frame.observe(recorder, span, second, place, adds=span.source > 0)
        is_complete = span.source == len(self._plan.slopes) - 1
        self._slices.identities.update({key: self._identity(key) if is_complete else None for key in keys})

    def _second_rows(self, span: Span, recorder: Recorder) -> Rows:
        """The light behind the last modulator: what is kept of it, else computed from as far on as possible."""
        wavelengths = range(span.wavelength, span.wavelength + span.count)
        of = [self._frame.inputs.rows_of(span.frame, span.source, wavelength) for wavelength in wavelengths]
        first_of, second_of = [first for first, _ in of], [second for _, second in of]
        home = self._shelf.rows("second", span)
        if home is not None and self._shelf.holds("second", span, second_of):
            return home
        if self._plan.system.gap_m is None:
            rows = self._frame.first(recorder, span, home)
        else:
            first = self._first_rows(span, recorder, first_of, home)
            rows = self._frame.second(recorder, span, first, home)
        if home is not None:
            self._shelf.mark("second", span, second_of)
        return rows

    def _first_rows(self, span: Span, recorder: Recorder, first_of: list[Identity], otherwise: Rows | None) -> Rows:
        """The light behind the first of two modulators, kept, or computed where it is kept or else `otherwise`."""
        home = self._shelf.rows("first", span) if self._keeps_first else None
        if home is not None and self._shelf.holds("first", span, first_of):
            return home
        if home is None:
            return self._frame.first(recorder, span, otherwise)
        self._shelf.mark("first", span, first_of)
        return self._frame.first(recorder, span, home)

    def _blend(self, weights: dict[Lit, Weight], seen_of: Identity, recorder: Recorder) -> None:
        """Begins XYZ with the intensities that stay where they are."""
        if not self._slices.banks:
            recorder.clear(self.seen)
        housed = {key: weight for key, weight in weights.items() if self._slices.is_housed(key)}
        for number, bank in enumerate(self._slices.banks):
            shares = self._slices.shares(housed, bank)
            self._composite(recorder, bank, shares, adds=number > 0)
        self._seen_of = seen_of

    def _add(self, run: Span, weights: dict[Lit, Weight], seen_of: Identity, recorder: Recorder) -> None:
        """Adds intensities to XYZ before the next ones take their place."""
        some = {key: weights[key] for key in ((run.frame, run.wavelength + i) for i in range(run.count))}
        place = self._slices.place((run.frame, run.wavelength))
        self._composite(recorder, place.buffer, self._slices.shares(some, place.buffer), adds=True)
        self._seen_of = seen_of

    def _composite(self, recorder: Recorder, intensity: Buffer, shares: list[Share], *, adds: bool) -> None:
        self.display.composite(recorder, intensity, shares, self.seen, adds=adds)
        self.kernels["composite"] += 1

    def _show(self, picture_of: Identity, recorder: Recorder) -> None:
        """Makes the picture of a complete XYZ."""
        self.display.show(recorder, self.seen, self.picture, self.exposure_stops)
        self.kernels["show"] += 1
        self._picture_of = picture_of


def _is_clear(slots: Slots) -> bool:
    """Whether no relay has a pupil."""
    return all(pupil is None for pupils in slots.pupils for pupil in pupils)


def _structure(plan: Plan, slots: Slots) -> Identity:
    """What decides how much memory is taken, and what the kernels are compiled for."""
    return plan.grid, plan.weights.shape, len(plan.slopes), len(plan.system.modulators), _is_clear(slots)


def _slots_of(plan: Plan) -> Identity:
    """What the slots of a drive depend on."""
    system = plan.system
    return system.modulators, system.relay1, system.relay2, system.wavelengths_m.tobytes(), plan.grid, system.frames
