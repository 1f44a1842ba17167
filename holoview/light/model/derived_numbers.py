"""Numbers that follow from a bench, as text: cut-offs, sampling, diffraction angles, limits of the model, memory."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from holoview.light.model.bench_parts import Relay
from holoview.light.model.chain_numbers import element_lines, etendue_mm2sr, reach_m
from holoview.light.model.effects.registry import ActiveEffects
from holoview.light.model.eye import field_degrees, sample_degrees
from holoview.light.model.passband import band_limit
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.model.validity import LightFigures, read_limits, wrap_around
from holoview.util import units

_COMPLEX64, _FLOAT32 = 8, 4


@dataclass(frozen=True)
class InfoRow:
    """One derived quantity: heading, name, and value as text with its unit."""

    heading: str
    name: str
    text: str


def info_rows(system: System, optimiser_bytes: int | None = None, light: LightFigures | None = None) -> list[InfoRow]:
    """The quantities to check before trusting a simulation of a bench, sorted by heading.

    optimiser_bytes: memory that an optimisation takes, for a bench with modulators. light: that it shows, if known.
    """
    plan = make_plan(system)
    return [
        *(_chain(system) if system.is_chain else _bench(system)),
        *(_chain_diffraction(plan) if system.is_chain else _diffraction(system)),
        *_cut_offs(plan),
        *_sampling(plan),
        *_eye(plan),
        *_limits(plan, light),
        *_memory(plan, optimiser_bytes),
        *_effects(system),
    ]


def _chain(system: System) -> list[InfoRow]:
    """The lasers of a chain, its elements in the order of the light, and its planes."""
    planes = ", ".join(f"{z * 1e3:.4g}" for z in system.planes_m)
    height_m, width_m = system.field_m
    return [
        *_lasers(system),
        InfoRow("bench", "field", f"{width_m * 1e3:.4g} x {height_m * 1e3:.4g} mm"),
        InfoRow(
            "bench", "focal planes", f"{planes} mm" + (f" from {system.planes_from}" if system.planes_from else "")
        ),
        InfoRow("bench", "observer", system.observer),
        *(InfoRow("elements, in the order of the light", name, text) for name, text in element_lines(system)),
    ]


def _chain_diffraction(plan: Plan) -> list[InfoRow]:
    """The étendue of a chain, and how far its light moves sideways on the way to the planes."""
    system, last_m = plan.system, plan.order_m(plan.way.last)
    low, high = etendue_mm2sr(system)
    side_m, field_m = reach_m(system, float(plan.planes_m.max()), plan.way.finest_m), min(system.field_m)
    text = f"{units.format_rounded(side_m, 'um')}, {side_m / last_m:.3g} of the last pixels"
    narrow = f"; twice that is more than the field of {units.format_rounded(field_m, 'mm')}"
    return [
        InfoRow("diffraction", "étendue", _span(f"{low:.3g}", f"{high:.3g}") + " mm² sr (pixels × λ²)"),
        InfoRow("diffraction", "sideways to the last plane", text + (narrow if 2 * side_m > field_m else "")),
    ]


def _lasers(system: System) -> list[InfoRow]:
    nm = [f"{λ * 1e9:.4g}" for λ in system.wavelengths_m]
    return [
        InfoRow("bench", "wavelengths", f"{len(nm)}: {', '.join(nm)} nm"),
        InfoRow("bench", "frames", str(system.frames)),
        InfoRow("bench", "source directions", str(len(system.source.directions_rad))),
    ]


def _bench(system: System) -> list[InfoRow]:
    modulator = system.modulators[0]
    rows, columns = modulator.shape
    width_m, height_m = columns * modulator.pitch_m, rows * modulator.pitch_m
    levels = "continuous" if modulator.levels is None else f"{len(modulator.levels)} levels"
    out = [
        *_lasers(system),
        InfoRow("bench", "field", f"{columns} x {rows} samples")
        if system.is_field
        else InfoRow("bench", "modulators", f"{len(system.modulators)} of {columns} x {rows} pixels, {levels}"),
        InfoRow("bench", "pixel pitch", units.format_rounded(modulator.pitch_m, "um")),
        InfoRow("bench", "active area", f"{width_m * 1e3:.4g} x {height_m * 1e3:.4g} mm"),
    ]
    if system.gap_m is not None:
        out.append(InfoRow("bench", "gap", units.format_rounded(system.gap_m, "mm")))
    planes = ", ".join(f"{z * 1e3:.4g}" for z in system.planes_m)
    return [*out, InfoRow("bench", "focal planes", f"{planes} mm"), InfoRow("bench", "observer", system.observer)]


def _eye(plan: Plan) -> list[InfoRow]:
    """The view of a system's eye: its pupil beside the eyebox, and where it is focused."""
    system, eye, λ = plan.nominal, plan.nominal.eye, plan.system.wavelengths_m
    if eye is None:
        return []
    pitch_m, f = plan.order_m(plan.way.last), eye.eyepiece_m
    eyebox = [f * λ_m / pitch_m * 1e3 for λ_m in (λ.min(), λ.max())]
    degrees = sample_degrees(plan.grid.pitch_m, f)
    field = [field_degrees(side, f) for side in system.field_m]
    spread_m = float(np.ptp(plan.focus_shift_m))
    place = f"y {eye.pupil_y_m * 1e3:g}, x {eye.pupil_x_m * 1e3:g} mm"
    pupil = f"{eye.pupil_diameter_m(system.field_m) * 1e3:.3g} mm at {place}"
    return [
        InfoRow("eye", "eyepiece", f"{units.format_rounded(f, 'mm')}, {f * f * 1e3:.3g} mm of distance a dioptre"),
        InfoRow("eye", "plane at infinity", units.format_rounded(eye.far_plane_m(system.planes_m), "mm")),
        InfoRow(
            "eye", "focused at", f"{', '.join(f'{(plane.accommodation_dpt or 0.0):.3g}' for plane in plan.planes)} D"
        ),
        InfoRow("eye", "pupil", pupil),
        InfoRow(
            "eye", "eyebox of the first order", f"{eyebox[0]:.3g} mm at {λ.min() * 1e9:.4g} nm to {eyebox[1]:.3g} mm"
        ),
        InfoRow("eye", "field of view", f"{field[1]:.3g}° x {field[0]:.3g}°, {1 / degrees:.4g} samples a degree"),
        InfoRow(
            "eye",
            "focus of the wavelengths",
            f"{spread_m * 1e3:.3g} mm apart, {spread_m / f**2:.3g} D (chromatic aberration)",
        ),
    ]


def _diffraction(system: System) -> list[InfoRow]:
    modulator = system.modulators[0]
    shortest, longest = float(system.wavelengths_m.min()), float(system.wavelengths_m.max())
    pixels = math.prod(modulator.shape)
    turns = [2 * modulator.stroke_m / λ for λ in (shortest, longest)]
    sines = [min(1.0, λ / (2 * modulator.pitch_m)) for λ in (shortest, longest)]
    angles = [math.degrees(math.asin(sine)) for sine in sines]
    cone = min(0.999, system.relay2.first_order_sine(longest, modulator.pitch_m))
    blur = float(np.ptp(system.planes_m)) * math.tan(math.asin(cone)) / modulator.pitch_m
    phase_range = InfoRow(
        "diffraction",
        "phase range",
        f"{turns[0]:.3g} pi at {shortest * 1e9:.4g} nm, {turns[1]:.3g} pi at {longest * 1e9:.4g} nm",
    )
    return [
        *([] if system.is_field else [phase_range]),
        InfoRow("diffraction", "largest angle (half)", _span(*(f"{angle:.3g}°" for angle in angles))),
        InfoRow(
            "diffraction",
            "étendue",
            _span(*(f"{pixels * λ**2 * 1e6:.3g}" for λ in (shortest, longest))) + " mm² sr (pixels × λ²)",
        ),
        InfoRow("diffraction", "defocus over the stack", f"±{blur:.3g} modulator pixels"),
    ]


def _span(low: str, high: str) -> str:
    return low if low == high else f"{low} to {high}"


def _cut_offs(plan: Plan) -> list[InfoRow]:
    system, dx = plan.system, plan.grid.pitch_m
    out = [
        InfoRow("cut-offs", "modulator", f"{0.5e-3 / plan.way.finest_m:.4g} cycles/mm"),
        InfoRow("cut-offs", "simulation grid", f"{0.5e-3 / dx:.4g} cycles/mm"),
    ]
    for number, relay in enumerate(plan.relays):
        out += _stops(plan.way.relay_words(number), relay, system, plan.order_m(number))
    longest, farthest = float(system.wavelengths_m.max()), float(np.abs(plan.planes_m).max())
    limit = min(band_limit(p, dx, longest, farthest) for p in plan.grid.padded)
    text = f"{limit * 1e-3:.4g} cycles/mm"
    if limit >= 0.5 / dx:
        text = "not needed (the kernel doesn't alias)"
    elif system.sampling.propagation == "periodic":
        text = f"none (periodic), though the kernel aliases above {text}"
    return [*out, InfoRow("cut-offs", "band limit at the farthest plane", text)]


def _stops(name: str, relay: Relay, system: System, pitch_m: float) -> list[InfoRow]:
    """The frequencies that a relay's stops pass at each wavelength."""
    rows = []
    if relay.iris_na is not None:
        sines = [relay.iris_na] * len(system.wavelengths_m)
        text = f"radius {_by_wavelength(sines, system, pitch_m)} (NA {relay.iris_na:g})"
        rows.append(InfoRow("cut-offs", f"iris of {name}", text))
    if relay.square is not None:
        sines = [relay.square.half_side_sine(float(λ), pitch_m) for λ in system.wavelengths_m]
        text = f"half side {_by_wavelength(sines, system, pitch_m)} ({relay.square})"
        rows.append(InfoRow("cut-offs", f"square stop of {name}", text))
    if any(relay.centre_na):
        y, x = relay.centre_na
        rows.append(InfoRow("cut-offs", f"centre of {name}'s stops", f"direction sine {y:g} (y), {x:g} (x)"))
    if relay.dc_block_na is not None:
        rows.append(InfoRow("cut-offs", f"DC block of {name}", f"NA {relay.dc_block_na:g}"))
    return rows


def _by_wavelength(sines: list[float], system: System, pitch_m: float) -> str:
    """Direction sines of all wavelengths as frequencies, and as multiples of the first order of a pitch."""
    cycles = np.array(sines) / system.wavelengths_m
    if np.allclose(cycles, cycles[0], rtol=1e-9):
        cycles = cycles[:1]
    orders = cycles * 2 * pitch_m
    frequencies, multiples = (", ".join(f"{x:.4g}" for x in row) for row in (cycles * 1e-3, orders))
    return f"{frequencies} cycles/mm = {multiples} first orders"


def _sampling(plan: Plan) -> list[InfoRow]:
    grid, how = plan.grid, plan.system.sampling.propagation
    if how == "periodic" and grid.padded != grid.shape:
        how += ", padded to the next sizes that can be transformed"
    fewer = _smaller_alone(plan)
    shared = (
        f"of the farthest of {len(plan.planes)}: {fewer} alone would take fewer samples, and look a little different"
    )
    return [
        InfoRow(
            "sampling",
            "simulated field",
            f"{grid.shape[1]} x {grid.shape[0]} at {units.format_rounded(grid.pitch_m, 'um')}",
        ),
        InfoRow("sampling", "transformed grid", f"{grid.padded[1]} x {grid.padded[0]} ({how})"),
        *([InfoRow("sampling", "grid of all planes", shared)] if fewer else []),
        InfoRow("sampling", "expected wrap-around", format_wrap_around(plan)),
    ]


def _smaller_alone(plan: Plan) -> int:
    """How many planes would be computed on a smaller grid without the others; their pictures differ then a little."""
    alone = [make_plan(plan.nominal, [plane.nominal_m]).grid.padded for plane in plan.planes]
    return sum(padded != plan.grid.padded for padded in alone)


def format_wrap_around(plan: Plan) -> str:
    """How much of the field is reached by light that wrapped around the edges of the padded grid, as text."""
    system, (worst, worst_name, worst_reach) = plan.system, wrap_around(plan)
    if worst == 0.0:
        return "none: the padding exceeds the largest walk-off"
    if system.sampling.propagation == "periodic":
        return f"up to {worst:.0%} of a side ({worst_reach:.0f} samples walk-off over the {worst_name})"
    return (
        f"none: light that walks off by more than the padding ({worst_reach:.0f} samples over the {worst_name}) is cut"
    )


def _limits(plan: Plan, light: LightFigures | None) -> list[InfoRow]:
    """The verdict of each limit of the model on a bench."""
    rows = []
    for reading in read_limits(plan, light):
        text = f"{reading.measured.value:.3g}, true if {reading.limit.threshold}"
        if reading.is_exceeded:
            verdict = "REFUSED" if reading.limit.refuses else "NOT TRUE"
            text += f": {verdict}: {reading.measured.found}; {reading.measured.remedy}"
        rows.append(InfoRow("limits of the model", reading.limit.name, text))
    return rows


def _memory(plan: Plan, optimiser_bytes: int | None) -> list[InfoRow]:
    field = math.prod(plan.grid.padded) * _COMPLEX64
    stack = len(plan.system.wavelengths_m) * len(plan.planes) * math.prod(plan.grid.shape) * _FLOAT32
    rows = [
        InfoRow("memory", "one padded field", _bytes(field)),
        InfoRow("memory", "focal stack of intensities", _bytes(stack)),
    ]
    if optimiser_bytes is not None:
        rows.append(InfoRow("memory", "optimiser", f"about {_bytes(optimiser_bytes)}"))
    return rows


def _effects(system: System) -> list[InfoRow]:
    """The effects that are switched on, each as a sentence; effects of the camera aren't rendered."""
    if not system.effects:
        return []
    active = ActiveEffects(system.effect_values)
    rows = [
        InfoRow("effects", effect.id, effect.format_finding(system, dict(values))) for effect, values in active.pairs
    ]
    camera = [effect.id for effect in active.camera_effects()]
    note = f"{', '.join(camera)}: of the camera that took captures, not of what is rendered"
    return [*rows, *([InfoRow("effects", "not seen", note)] if camera else [])]


def _bytes(count: float) -> str:
    return f"{count / 2**20:.4g} MiB" if count < 2**30 else f"{count / 2**30:.3g} GiB"
