"""Where the light went: shares of the light on the first modulator that end in the picture, at stops, or elsewhere.

Behind the last modulator a field u is split into its zero order, the part z·w of the wave w that illuminates the bench,
z = ⟨w, u⟩/⟨w, w⟩, and the rest, which is orthogonal to it, so that their powers add. The rest is followed through the
stops of relay 2 and an eye's pupil to a plane; what is lost at each is the difference of the powers before and behind
(Parseval). All shares are 0 or more, but for rounding, and add up to 1. The zero order counts as itself wherever it
ends, so that the picture's share is without it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.light.engine.frame import SPECTRUM, light_along, relay_behind
from holoview.light.engine.torch_executor import TorchExecutor, TorchField, spectrum_power
from holoview.light.model.chain import needs_short_form
from holoview.light.model.plan import Plan
from holoview.light.optics.frame_inputs import FrameInputs

PLACES = {
    "picture": "in the picture, without the zero order",
    "outside_picture": "in its plane, beside the picture",
    "zero_order": "in the zero order",
    "stop_1": "at the stops of relay 1",
    "beyond_second_modulator": "beside the second modulator",
    "stop_2": "at the stops of relay 2",
    "pupil": "at the pupil of the eye",
    "beyond_grid": "beyond the grid of the simulation",
    "modulators": "absorbed by the modulators",
}
"""Where light ends, with words for it."""
_LAST_PLACES = {
    "stops": "at the stops behind the last element",
    "pupil": PLACES["pupil"],
    "beyond_grid": PLACES["beyond_grid"],
    "outside_picture": PLACES["outside_picture"],
}


def place_words(place: str, *, is_chain: bool = False) -> str:
    """Words for a place of a budget: one of `PLACES`; of a chain "at NAME", "stops", and "picture" with zero order."""
    if not is_chain:
        return PLACES[place]
    words = f"lost {place}".replace("lost at before ", "lost before ")
    return {**_LAST_PLACES, "picture": "in the picture"}.get(place, words)


@dataclass(frozen=True, eq=False)
class LightBudget:
    """Shares of the light on the first modulator.

    by_wavelength: (place, wavelength), places as of `PLACES`; NaN at wavelengths without light. total: (place,), of all
    wavelengths together.
    """

    by_wavelength: NDArray[np.float64]
    total: NDArray[np.float64]

    def as_json(self) -> dict[str, float]:
        """The shares of all wavelengths together, by place; places that no light reaches have 0."""
        return {name: round(max(0.0, float(share)), 9) for name, share in zip(PLACES, self.total, strict=True)}


def light_budget(plan: Plan, drive: Any, plane: int = 0) -> LightBudget:
    """Where the light of a bench went that shows a plane of a plan.

    drive: as of `simulate`. It takes the transforms of a frame, in PyTorch. Raises UserError for a chain of elements
    (`chain_light`).
    """
    if plan.way.is_chain:
        raise needs_short_form("where the light went")
    executor = TorchExecutor(plan, FrameInputs(plan, drive))
    powers = np.zeros((len(PLACES), len(plan.system.wavelengths_m)))
    for wavelength in range(powers.shape[1]):
        for frame in plan.lit(wavelength):
            for source in range(len(plan.slopes)):
                found = _beam(executor, wavelength, frame, source, plane)
                weight = float(plan.weights[frame, wavelength])
                powers[:, wavelength] += weight * np.array([found.get(name, 0.0) for name in PLACES])
    whole = powers.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = powers / np.where(whole > 0, whole, np.nan)
        total = powers.sum(axis=1) / (whole.sum() if whole.sum() > 0 else np.nan)
    return LightBudget(shares, total)


def chain_light(plan: Plan, drive: Any, plane: int = 0) -> tuple[dict[str, float], dict[str, float]]:
    """The light of all lasers in a chain of elements that shows a plane of a plan, as shares of what enters it.

    drive: as of `simulate`. The first are the shares that are left behind each element, by its name; "before NAME" is
    the light that arrives at it. The second are those that end at each place of `place_words`, the zero order among
    them: "at NAME" is what is lost from the place before to this one. They add up to 1; NaN without light. In PyTorch.
    """
    executor, powers, whole = TorchExecutor(plan, FrameInputs(plan, drive)), dict[str, float](), 0.0
    for beam in plan.beams(range(len(plan.lasers))):
        whole += beam.weight * math.prod(plan.grid.shape)
        for landmark, field in light_along(executor, beam.wavelength, beam.frame, beam.source):
            if landmark == SPECTRUM:
                found = _behind_chain(executor, field, beam.wavelength, plane)
            else:
                found = {landmark: _power(_samples(executor, field))} if landmark else {}
            for name, power in found.items():
                powers[name] = powers.get(name, 0.0) + beam.weight * power
    shares = {name: power / whole if whole else math.nan for name, power in powers.items()}
    behind = {name: share for name, share in shares.items() if name not in _LAST_PLACES}
    names = [*(f"at {name}" for name in behind), *_LAST_PLACES]
    lost = -np.diff([1.0, *shares.values()])
    return behind, dict(zip(names, lost.tolist(), strict=True)) | {"picture": shares["outside_picture"]}


def told_light(plan: Plan, drive: Any, plane: int = 0) -> tuple[dict[str, float], dict[str, float]]:
    """The light left behind each element of a chain, and where that of any bench went, by place; empty without light.

    Arguments as of `light_budget` and `chain_light`.
    """
    if not plan.way.is_chain:
        budget = light_budget(plan, drive, plane)
        return {}, budget.as_json() if np.isfinite(budget.total).all() else {}
    behind, went = chain_light(plan, drive, plane)
    if not all(map(math.isfinite, went.values())):
        return {}, {}
    return behind, {place: round(max(0.0, share), 9) for place, share in went.items()}


def _behind_chain(executor: TorchExecutor, spectrum: TorchField, wavelength: int, plane: int) -> dict[str, float]:
    """The power that is left behind each of `_LAST_PLACES`, of a spectrum behind the last element of a chain."""
    plan = executor.plan
    bins = math.prod(plan.grid.padded)
    seen = executor.transmit(spectrum, plan.way.last, wavelength, plane)
    left = (
        spectrum_power(spectrum.values, executor.stops(wavelength).abs()) / bins,
        spectrum_power(spectrum.values, executor.passed_amplitude(wavelength)) / bins,
        spectrum_power(seen.values, None) / bins,
        _power(executor.field(seen, plan.way.last).values),
    )
    return dict(zip(_LAST_PLACES, left, strict=True))


def _beam(executor: TorchExecutor, wavelength: int, frame: int, source: int, plane: int) -> dict[str, float]:
    """The power of one beam that ends at each place, in samples of unit intensity."""
    plan, lost = executor.plan, dict.fromkeys(PLACES, 0.0)
    bins, last = math.prod(plan.grid.padded), len(plan.system.modulators) - 1
    wave = _samples(executor, executor.illuminate(wavelength, source))
    field = executor.illuminate(wavelength, source)
    before = _power(wave)
    for modulator in range(last + 1):
        field = executor.modulate(field, frame, modulator, wavelength)
        behind = _power(_samples(executor, field))
        if not plan.nominal.is_field:
            lost["modulators"] += before - behind
        if modulator < last:
            spectrum = executor.spectrum(field, modulator).values
            stopped = spectrum_power(spectrum, executor.stops(wavelength, relay_behind(plan, modulator)).abs()) / bins
            moved = TorchField(spectrum * executor.transfer(0, wavelength))
            arrived = spectrum_power(moved.values, None) / bins
            field = executor.field(moved, 0)
            before = _power(field.values)
            lost["stop_1"] += behind - stopped
            lost["beyond_grid"] += stopped - arrived
            lost["beyond_second_modulator"] += arrived - before
    values = _samples(executor, field)
    zero = torch.sum(wave.conj() * values) / torch.sum(wave.abs().square())
    rest = values - zero * wave
    lost["zero_order"] = behind - _power(rest)
    _to_plane(executor, rest, wavelength, plane, lost)
    return lost


def _to_plane(executor: TorchExecutor, rest: torch.Tensor, wavelength: int, plane: int, lost: dict[str, float]) -> None:
    """Follows a field (y, x) from the last modulator to a plane."""
    plan = executor.plan
    bins = math.prod(plan.grid.padded)
    spectrum = executor.spectrum(TorchField(rest), len(plan.system.modulators) - 1).values
    through_stops = spectrum_power(spectrum, executor.stops(wavelength).abs()) / bins
    through_pupil = spectrum_power(spectrum, executor.passed_amplitude(wavelength)) / bins
    moved = TorchField(spectrum * executor.transfer(1, wavelength, plane))
    arrived = spectrum_power(moved.values, None) / bins
    shown = _power(executor.field(moved, 1).values)
    lost["stop_2"] = _power(rest) - through_stops
    lost["pupil"] = through_stops - through_pupil
    lost["beyond_grid"] += through_pupil - arrived
    lost["outside_picture"] = arrived - shown
    lost["picture"] = shown


def _samples(executor: TorchExecutor, field: TorchField) -> torch.Tensor:
    """The samples (y, x) of a field."""
    return torch.from_numpy(executor.download_field(field))


def _power(values: torch.Tensor) -> float:
    """Σ|u|² of a field (y, x)."""
    return spectrum_power(values, None)
