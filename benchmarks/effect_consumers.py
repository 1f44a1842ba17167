"""One bench everywhere: each effect as each part of the program shows it, compared with `simulate` in complex128.

    python -m benchmarks.effect_consumers [--effects gap,distance,second_line+flicker] [--json]

Consumers are the parts that take a bench and show its light: `simulate` on the other backends, `field_at` at every
stage, `point_light`, `sections`, the optimiser's model, the predictor of captures, edits of a renderer, and the page.
The benches are small and have all that effects act on: two directions of the source, two frames, two wavelengths, stops
in both relays; of two modulators, one, and a field, seen with and without an eye.

The table has the greatest deviation over all benches, as a root mean square relative to that of what `simulate` shows;
nothing where a consumer doesn't take such benches. A bench that can't have an effect must be refused by all.
"""

from __future__ import annotations

import argparse
import base64
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
import wgpu
from numpy.typing import NDArray

import holoview as hv
import holoview.viewer.page
from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, blank_captures
from holoview.holograms.optimise.forward_model import make_forward_model
from holoview.holograms.optimise.lasers import changes_lasers
from holoview.holograms.optimise.propagation import TORCH_KERNELS
from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.engine.torch_executor import StageField, TorchExecutor, beam_at_stage
from holoview.light.engine.wgpu_executor import WgpuExecutor
from holoview.light.gpu.device import Device, open_device
from holoview.light.model.effects.registry import (
    ActiveEffects,
    bench_properties,
    get_effect,
    listed_effects,
    parameter_unmet_by_bench,
)
from holoview.light.model.plan import Beam, Plan, make_plan
from holoview.light.model.system import System
from holoview.light.model.validity import check_plan
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.light.optics.slm import optical_path
from holoview.util.errors import UserError
from holoview.viewer.page.frame_recording import page_document, unpack_content
from tests.chromium import started_browser

Values = Mapping[str, Any]

VALUES: dict[str, Values] = {
    "amplitude_gamma": {"gamma": 1.4},
    "aberration1": {"z5": 8e-8, "z7": 5e-8},
    "aberration2": {"z4": 8e-8, "z8": 5e-8},
    "ambient": {"level": 50.0},
    "bandwidth": {"sigma": 2e-9},
    "beam": {"size": 1.4, "edge": 2.0, "centre_y": 0.3, "ellipse": 0.1, "z4": 60e-9, "z8": -50e-9},
    "camera_alignment": {"shift_y": 3e-6},
    "camera_black": {"black": 10.0},
    "camera_blur": {"sigma": 1.0},
    "camera_fringes": {"path_y": 2e-6, "cos1": 0.1},
    "camera_gamma": {"exponent": 0.1},
    "crosstalk": {"sigma": 0.4},
    "dc_block": {"radius": 0.002},
    "dispersion": {"slope": 0.2},
    "distance": {"distance_error": 0.4e-3},
    "flicker": {"depth": 0.2},
    "fringing": {"width_y": 0.6, "width_x": -0.4},
    "gap": {"gap_error": 0.3e-3},
    "ghost": {"strength": 0.1, "shift_y": 3.0},
    "iris1": {"radius_error": 0.2, "decentre_y": 0.1},
    "iris2": {"radius_error": -0.2, "decentre_x": 0.1},
    "laser_power": {"exponent": 0.5},
    "leakage": {"amplitude": 0.2},
    "lut": {"gamma1": 1.3, "level2_05": 0.1},
    "lut_dispersion": {"slope1": 0.4, "slope2": -0.2},
    "mask_depth": {"error": 0.1},
    "misplaced": {"shift_y": 3e-6, "shift_z": 1e-4, "rotation": 0.01},
    "motion_blur": {"length_y": 2.0},
    "plane_errors": {"distances": (5e-3,), "errors": (2e-4,)},
    "polarisation": {"share": 0.2},
    "second_line": {"share": 0.3, "offset": 6e-9},
    "settling": {"share1": 0.3, "share2": 0.1},
    "slm1_fringes": {"path_y": 2e-6, "cos1": 0.1, "sin2": 0.1},
    "slm1_stuck": {"columns": (2, 9), "column_levels": (0.3, 0.8), "pixel_rows": (1,), "pixel_columns": (4,)},
    "slm2_fringes": {"path_x": -3e-6, "sin1": 0.2},
    "slm2_stuck": {"rows": (3, 4), "row_levels": (0.6,)},
    "slm_alignment": {"shift_y": 3e-6, "rotation": 0.01, "magnification": 0.02},
    "slm_flatness": {"z5_1": 5e-8, "z6_2": -4e-8},
    "source_extent": {"radius": 1e-3},
    "source_profile": {"fall": 0.5, "slope_x": 0.2},
    "stage": {"scale": 0.1},
    "stroke": {"stroke_error": -0.1, "difference": 0.05},
    "stroke_map": {"z2_1": 0.1, "z4_2": 0.1},
    "tilt": {"tilt_y": 2e-3, "tilt_x": -1e-3},
    "twisted_nematic": {"slope": 0.3, "bow": -0.2, "bend": 0.1},
    "undiffracted": {"share": 0.2},
    "vignetting": {"slope_y": 0.2},
    "wavelength_offset": {"offset": 5e-9},
}
"""Values of each effect that change pictures plainly; an effect that isn't here has half a prior of each parameter."""

_SHAPE = (12, 16)
_RELAYS = {"relay1.iris_na": 0.035, "relay2.iris_na": 0.03}
_LASERS = {"wavelengths": ["470 nm", "630 nm"], "amplitudes": [[1.0, 0.6], [0.4, 0.8]]}
_SOURCE = {"directions": [[0.0, 0.0], [4e-3, -2e-3]]}
EYE = {"pupil": "3 mm", "pupil_x": "0.2 mm", "chromatic_axis": "pupil"}


def benches() -> dict[str, tuple[System, Any]]:
    """The benches by name, each with the patterns that it shows."""
    base = hv.load("holochrome-8").edit(
        {"shape": list(_SHAPE), "planes": ["5 mm", "6 mm"], "gap": "1.5 mm", "source": _SOURCE, **_LASERS, **_RELAYS}
    )
    one = base.with_(modulators=base.modulators[:1], gap=None, relay1={})
    rng, shape = np.random.default_rng(4), (2, 2, 24, 30)
    values = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    hologram = hv.load_field(values, pitch="4 um", distance="5 mm", wavelengths=_LASERS["wavelengths"])
    stops = {"relay2.iris_na": 0.03, "amplitudes": _LASERS["amplitudes"]}
    light = hologram.system.edit({"planes": ["-4 mm", "6 mm"], **stops})
    plain = {
        "two modulators": (base, hv.random_drive(base, 1)),
        "one modulator": (one, hv.random_drive(one, 2)),
        "a field": (light, hologram.drive),
    }
    seen = {f"{name}, an eye": (system.with_(eye=EYE), drive) for name, (system, drive) in plain.items()}
    return plain | seen


def with_effect(system: System, name: str) -> System:
    """A bench with an effect, or with several: "second_line+flicker"; without parameters of parts that it lacks."""
    bench = bench_properties(system)
    effects: dict[str, Values] = {}
    for each in name.split("+"):
        lacking = {p.name for p in get_effect(each).parameters if parameter_unmet_by_bench(p, bench)}
        effects[each] = {key: value for key, value in values_of(each).items() if key not in lacking}
    return system.edit({"effects": effects})


def values_of(name: str) -> Values:
    """The values of an effect."""
    return VALUES.get(name) or {p.name: p.nudged(0.5) for p in listed_effects()[name].parameters}


# --- what consumers show ----------------------------------------------------------------------------------------------


@dataclass
class Shown:
    """A bench with one effect, its patterns, and how `simulate` shows it in complex128; None where it is refused."""

    system: System
    drive: Any
    effect: str
    view: hv.View | None

    @property
    def plane_m(self) -> float:
        """The last of its planes."""
        return float(self.system.planes_m[-1])

    @property
    def place(self) -> tuple[int, int]:
        """A sample (row, column) of the image."""
        return 9, 17

    def by_laser(self) -> NDArray[np.floating]:
        """The intensity (laser, y, x) at the last plane."""
        assert self.view is not None
        intensity = self.view.intensity[-1]
        return intensity.reshape(len(self.system.wavelengths_m), -1, *intensity.shape[1:]).sum(axis=1)


def shown_by(system: System, drive: Any, effect: str) -> Shown | None:
    """A bench with an effect, beside what `simulate` shows of it; None where no such bench can be built."""
    try:
        system = with_effect(system, effect)
    except UserError:
        return None
    try:
        return Shown(system, drive, effect, hv.simulate(system, drive, backend="torch64"))
    except UserError:
        return Shown(system, drive, effect, None)


def deviation(found: Any, expected: Any) -> float:
    """The root mean square of a difference relative to that of what is expected; infinite for what isn't finite."""
    found, expected = np.asarray(found), np.asarray(expected)
    error = float(np.linalg.norm(found - expected) / np.linalg.norm(expected))
    return error if math.isfinite(error) else math.inf


def by_backend(shown: Shown, open_executor: Callable[[Plan, FrameInputs], Any]) -> float:
    """`simulate` on another backend, whose executor is given: each `simulate` would open a device of its own."""
    plan = make_plan(shown.system)
    intensity, xyz = compute_focal_stack(open_executor(check_plan(plan), FrameInputs(plan, shown.drive)))
    if shown.view is None:
        return math.inf
    return max(deviation(intensity, shown.view.intensity), deviation(xyz, shown.view.xyz))


def by_field_at(shown: Shown) -> float:
    """Fields: Σ weight·|field|² over all beams; the central one; and stages by plain Fourier sums from those before."""
    system, view = shown.system, shown.view
    ask = partial(hv.field_at, system, shown.drive, plane=shown.plane_m, laser=1, frame=1)
    fields = {stage: ask(stage=stage) for stage in system.stages}
    plan = make_plan(system, [*system.planes_m, shown.plane_m])
    executor, last = TorchExecutor(plan, FrameInputs(plan, shown.drive), double=True), system.stages[-1]
    total = [
        sum(beam.weight * np.abs(beam_at_stage(executor, beam, last)) ** 2 for beam in plan.beams([laser]))
        for laser in range(len(system.wavelengths_m))
    ]
    assert view is not None
    beam, share = plan.central_beam(1, 1, 0)
    worst = [deviation(total, shown.by_laser()), abs(fields[last].share - share)]
    worst.append(deviation(fields[last].values, beam_at_stage(executor, beam, last)))

    stop, behind = fields["stop"], fields[system.stages[system.stages.index("stop") - 1]]
    waves = [_waves(stop, axis, plan.grid.shape[axis], plan.grid.pitch_m) for axis in (0, 1)]
    samples = math.prod(plan.grid.padded)
    if "pupil" in fields:
        worst.append(deviation(waves[0] @ fields["pupil"].values @ waves[1].T / samples, fields["retina"].values))
    flat = plan if system.eye is None else make_plan(system.with_(eye=None), [*system.planes_m, shown.plane_m])
    sine_y, sine_x = (_sines(stop, axis) for axis in (0, 1))
    root = np.sqrt(np.maximum(1 - sine_y[:, None] ** 2 - sine_x**2, 0.0)) - 1
    free = np.exp(2j * np.pi * flat.planes[-1].true_m / stop.wavelength_m * root)
    passes = _within_band(flat, beam, stop)
    worst.append(deviation(waves[0] @ (stop.values * free * passes) @ waves[1].T / samples, fields["plane"].values))
    if not ActiveEffects(system.effect_values).with_hooks("pupil"):
        spectrum = waves[0].conj().T @ behind.values @ waves[1].conj()
        worst.append(deviation(stop.values, spectrum * (np.abs(stop.values) > 0)))
    return max(worst)


def _within_band(plan: Plan, beam: Beam, stop: StageField) -> NDArray[np.bool_]:
    """Which frequencies of the light behind the stops the band limit of the way to the last plane passes."""
    transfer = plan.transfer(1, beam.wavelength, len(plan.planes) - 1)
    ky, kx = (np.rint(_sines(stop, axis) / stop.step[axis]).astype(int) for axis in (0, 1))
    smallest, lowest, highest = transfer.support[ky % len(transfer.support)].T[..., None]
    return (np.abs(kx) >= smallest) & (kx >= lowest) & (kx <= highest)


def _sines(light: StageField, axis: int) -> NDArray[np.float64]:
    """The direction sines of the samples of light that is known by direction."""
    return light.origin[axis] + np.arange(light.values.shape[axis]) * light.step[axis]


def _waves(light: StageField, axis: int, samples: int, pitch_m: float) -> NDArray[np.complex128]:
    """exp(2πi·s·x/λ) at samples x (rows), from the middle, for the direction sines s (columns) of light."""
    x = (np.arange(samples) - (samples - 1) / 2) * pitch_m
    return np.exp(2j * np.pi * x[:, None] * _sines(light, axis) / light.wavelength_m)


def by_point_light(shown: Shown) -> float:
    """The intensities and the colour of a sample of the image."""
    found = hv.point_light(shown.system, shown.drive, at=shown.place, plane=shown.plane_m, window=8)
    row, column = shown.place
    assert shown.view is not None
    return max(
        deviation(found.intensities, shown.by_laser()[:, row, column]),
        deviation(found.xyz, shown.view.xyz[-1, row, column]),
        abs(sum(found.orders.values()) - 1),
    )


def by_sections(shown: Shown) -> float:
    """Sections through the image at all planes."""
    found = hv.sections(shown.system, shown.drive, at=shown.place)
    row, column = shown.place
    assert shown.view is not None
    return max(deviation(found.xz, shown.view.xyz[:, row]), deviation(found.yz, shown.view.xyz[:, :, column]))


def by_optimiser(shown: Shown) -> float | None:
    """The optimiser's model; None for a field, which isn't optimised, and effects that it refuses."""
    system, view = shown.system, shown.view
    if system.is_field or changes_lasers(system, system.effect_values):
        return None
    plan = make_plan(system)
    assert view is not None
    model = make_forward_model(plan, device="cpu", double=True, kernels=TORCH_KERNELS)
    drive = torch.from_numpy(shown.drive.astype(np.float64))
    paths = [optical_path(drive[:, i], modulator) for i, modulator in enumerate(system.modulators)]
    with torch.no_grad():
        model.forward(torch.stack(paths, dim=1))
        squares = lambda plane, rows, fields: fields.abs().square().sum(dim=1)  # noqa: E731
        planes = range(len(plan.planes))
        found = [torch.cat(blocks, dim=1).numpy() for blocks in model.process_planes(planes, squares, carry_back=False)]
    intensity = np.zeros_like(view.intensity)
    for plane, lasers in enumerate(found):
        for (frame, wavelength), light in zip(model.lasers, lasers, strict=True):
            intensity[plane, wavelength] += plan.weights[frame, wavelength] * light
    return deviation(intensity, view.intensity)


def by_captures(shown: Shown) -> float | None:
    """The predictor of captures, of the second of two captures in which lasers shine one by one.

    None for a field, with an eye, and for effects of a camera, which an observer doesn't see. The bench is that of the
    captures: one direction of the source, two frames, the second of which is captured.
    """
    system, active = shown.system, ActiveEffects(shown.system.effect_values)
    if system.is_field or system.eye is not None or active.camera_effects():
        return None
    worst = 0.0
    lasers = system.edit({"source": {"directions": [[0.0, 0.0]]}, "amplitudes": [[1.0, 1.0]], "effects": {}})
    settings = AcquisitionSettings(captures_per_condition=2, planes_m=(shown.plane_m,))
    captures = blank_captures(lasers, settings, np.random.default_rng(3))
    predictor = Predictor(captures, double_precision=True)
    for k in (1, 3):
        nominal = captures.nominal_system(planes_m=[shown.plane_m])
        powers = np.where(nominal.wavelengths_m == captures.wavelength_m[k], captures.power[k], 0.0)
        bench = nominal.edit({"amplitudes": [[0.0, 0.0], powers.tolist()], "effects": dict(system.effect_values)})
        drive = np.stack([captures.drive(k - 1), captures.drive(k)])
        seen = 2 * hv.simulate(bench, drive, backend="torch64").intensity[0].sum(axis=0)  # the mean over two frames
        found = predictor([k], system.effect_values).signal[0].numpy() / float(captures.exposure_s[k])
        worst = max(worst, deviation(found, seen))
    return worst


def by_edits(shown: Shown, renderers: dict[tuple[Any, ...], IncrementalRenderer], device: Device) -> float:
    """A renderer that showed the bench with another effect before, at another plane; its lasers' intensities too."""
    key = (shown.system.is_field, len(shown.system.modulators), shown.system.eye is not None)
    if key not in renderers:
        plain = shown.system.edit({"effects": {}})
        renderers[key] = IncrementalRenderer(plain, shown.drive, device, strategy="passes")
        renderers[key].update()
    renderer = renderers[key]
    renderer.edit(plane_m=float(shown.system.planes_m[0]))
    renderer.edit(system=shown.system, plane_m=shown.plane_m)
    renderer.update(with_srgb=False)
    if shown.view is None:
        return math.inf
    intensities = [renderer.intensity(laser) for laser in range(len(shown.system.wavelengths_m))]
    luminance = sum(renderer.luminance(laser) for laser in range(len(shown.system.wavelengths_m)))
    xyz = shown.view.xyz[-1]
    return max(
        deviation(renderer.xyz(), xyz), deviation(intensities, shown.by_laser()), deviation(luminance, xyz[..., 1])
    )


# --- the page ---------------------------------------------------------------------------------------------------------


_DRIVER = """
const base64 = bytes => {
    let text = ""
    const raw = new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength)
    for (const byte of raw) text += String.fromCharCode(byte)
    return btoa(text)
}
async function asked({ document, head, changes }) {
    const work = []
    const numbers = new Map(head.buffers.map((label, index) => [label, index]))
    const write = (buffer, at, bytes) => work.push(["write", buffer, at, base64(bytes)])
    const replay = {
        head: { ...head, buffers: undefined },
        buffers: head.buffers.map((_, index) => index),
        device: { queue: { writeBuffer: write, onSubmittedWorkDone: async () => {} } },
        write: (label, bytes, offset = 0) => write(numbers.get(label), offset, bytes),
        compiled: async () => {},
        run: steps => work.push(["run", steps.map(step => head.steps.indexOf(step))]),
    }
    const { bench } = document
    const live = new LiveHologram(document, bench, [head], async () => replay)
    const state = {
        gap_m: bench.nominal_gap_m,
        lasers: bench.nominal_wavelengths_m.map(() => true),
        powers: bench.nominal_wavelengths_m.map(() => 1),
        wavelengths_m: bench.nominal_wavelengths_m,
        eye: bench.eye,
    }
    for (const change of changes) {
        await live.update({ ...state, ...change })
        work.push(["read"])
    }
    return work
}
"""


class PageReplay:
    """Replays pages' recordings on a device, after the changes that their scripts ask for in a browser without one."""

    def __init__(self, tab: Any, device: Device) -> None:
        self._tab, self._gpu = tab, device.raw
        self._pipelines: dict[str, Any] = {}
        folder = Path(holoview.viewer.page.__file__).parent
        scripts = [(folder / name).read_text(encoding="utf-8") for name in ("bench.js", "hologram.js")]
        tab.add_script_tag(content="\n".join([*scripts, _DRIVER]))

    def xyz(
        self, document: dict[str, Any], head: dict[str, Any], data: bytes, changes: list[Values]
    ) -> Iterator[NDArray[Any]]:
        """XYZ (y, x, 3) that the page shows after each of some changes of its state."""
        steps = [
            {**step, "dispatches": step["dispatches"] if step["name"] == "composite" else []} for step in head["steps"]
        ]
        script = {name: head[name] for name in ("lit", "is_kept", "plane_m", "bind_groups")}
        script |= {"steps": steps, "buffers": [buffer["label"] for buffer in head["buffers"]]}
        known = {name: document[name] for name in ("bench", "structs")}
        given = json.dumps({"document": known, "head": script, "changes": changes})
        work = json.loads(self._tab.evaluate("async given => JSON.stringify(await asked(JSON.parse(given)))", given))
        buffers = [self._buffer(buffer, document["contents"], data) for buffer in head["buffers"]]
        pipelines = [self._pipeline(head, pipeline) for pipeline in head["pipelines"]]
        groups = [self._group(each, pipelines, buffers) for each in head["bind_groups"]]
        (result,) = (i for i, buffer in enumerate(head["buffers"]) if buffer["label"] == head["results"]["xyz"])
        rows, columns = head["shape"]
        for kind, *rest in work:
            if kind == "write":
                buffer, offset, text = rest
                self._gpu.queue.write_buffer(buffers[buffer], offset, base64.b64decode(text))
            elif kind == "run":
                self._run([head["steps"][i] for i in rest[0]], pipelines, groups)
            else:
                values = np.frombuffer(self._gpu.queue.read_buffer(buffers[result]), np.float32)
                yield values[: rows * columns * 4].reshape(rows, columns, 4)[..., :3]

    def _group(self, described: dict[str, Any], pipelines: list[Any], buffers: list[Any]) -> Any:
        layout = pipelines[described["pipeline"]].get_bind_group_layout(described["group"])
        entries = [
            {"binding": binding, "resource": {"buffer": buffers[i], "offset": 0, "size": buffers[i].size}}
            for binding, i in described["entries"]
        ]
        return self._gpu.create_bind_group(layout=layout, entries=entries)

    def _buffer(self, described: dict[str, Any], contents: list[dict[str, Any]], data: bytes) -> Any:
        usage = wgpu.BufferUsage.UNIFORM if described["usage"] == "uniform" else wgpu.BufferUsage.STORAGE
        usage |= wgpu.BufferUsage.COPY_SRC | wgpu.BufferUsage.COPY_DST
        buffer = self._gpu.create_buffer(size=described["size"], usage=usage)
        if described["data"] is not None:
            self._gpu.queue.write_buffer(buffer, 0, unpack_content(contents[described["data"]], data))
        return buffer

    def _pipeline(self, head: dict[str, Any], described: dict[str, Any]) -> Any:
        code = head["codes"][described["code"]]
        key = json.dumps([code, described["constants"], described["groups"]])
        if key not in self._pipelines:
            layouts = [
                self._gpu.create_bind_group_layout(
                    entries=[
                        {"binding": b, "visibility": wgpu.ShaderStage.COMPUTE, "buffer": {"type": kind}}
                        for b, kind in group
                    ]
                )
                for group in described["groups"]
            ]
            self._pipelines[key] = self._gpu.create_compute_pipeline(
                layout=self._gpu.create_pipeline_layout(bind_group_layouts=layouts),
                compute={
                    "module": self._gpu.create_shader_module(code=code),
                    "entry_point": "main",
                    "constants": described["constants"],
                },
            )
        return self._pipelines[key]

    def _run(self, steps: list[dict[str, Any]], pipelines: list[Any], groups: list[Any]) -> None:
        encoder = self._gpu.create_command_encoder()
        compute = encoder.begin_compute_pass()
        for step in steps:
            for pipeline, bound, workgroups in step["dispatches"]:
                compute.set_pipeline(pipelines[pipeline])
                for number, group in bound:
                    compute.set_bind_group(number, groups[group])
                compute.dispatch_workgroups(*workgroups)
        compute.end()
        self._gpu.queue.submit([encoder.finish()])


def by_page(shown: Shown, replay: PageReplay) -> float:
    """The page, opened at the first plane, then moved to the last and, where there is a gap, to a longer gap."""
    system, planes_m = shown.system, shown.system.planes_m
    ends = float(planes_m.min()), float(planes_m.max())
    document, heads, data = page_document(hv.Hologram(shown.drive, system), "hologram", float(planes_m[0]), ends)
    last = {"plane_m": shown.plane_m}
    changes: list[Values] = [{"plane_m": float(planes_m[0])}, last]
    if shown.view is None:
        return math.inf
    expected = list(shown.view.xyz)
    if system.gap_m is not None:
        longer_m = 1.1 * system.gap_m
        changes.append({**last, "gap_m": longer_m})
        expected.append(hv.simulate(system.with_(gap=longer_m), shown.drive, backend="torch64").xyz[-1])
    found = replay.xyz(document, heads[0], data, changes)
    return max(deviation(xyz, as_it_is) for xyz, as_it_is in zip(found, expected, strict=True))


# --- the table --------------------------------------------------------------------------------------------------------


Consumer = Callable[[Shown], float | None]


@contextmanager
def consumers() -> Iterator[dict[str, Consumer]]:
    """All consumers by name, with a device and, for the page, a browser that runs its scripts."""
    device, renderers = open_device(), dict[tuple[Any, ...], IncrementalRenderer]()
    with started_browser() as browser:
        replay = PageReplay(browser.open("about:blank"), device)
        yield {
            "torch": partial(by_backend, open_executor=TorchExecutor),
            "wgpu": partial(by_backend, open_executor=partial(WgpuExecutor, device=device)),
            "field_at": by_field_at,
            "point_light": by_point_light,
            "sections": by_sections,
            "optimiser": by_optimiser,
            "captures": by_captures,
            "edits": partial(by_edits, renderers=renderers, device=device),
            "page": partial(by_page, replay=replay),
        }
        for renderer in renderers.values():
            renderer.close()


def measured(consumer: Consumer, shown: Shown) -> float | None:
    """The deviation of a consumer; None where it doesn't apply, or is refused as `simulate` is, infinite where not."""
    try:
        found = consumer(shown)
    except UserError:
        return None if shown.view is None else math.inf
    return math.inf if shown.view is None and found is not None else found


def main(argv: list[str] | None = None) -> int:
    """Prints the table; the exit code is 1 if a consumer deviates by more than 1e-3."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--effects", help="ids, with commas between them, + between those at once; all when left out")
    parser.add_argument("--json", action="store_true", help="print JSON")
    args = parser.parse_args(argv)
    names = args.effects.split(",") if args.effects else list(listed_effects())
    table: dict[str, dict[str, float | None]] = {}
    kinds = benches()
    with consumers() as all_consumers:
        for name in names:
            row: dict[str, float | None] = dict.fromkeys(all_consumers)
            for system, drive in kinds.values():
                shown = shown_by(system, drive, name)
                for consumer, function in all_consumers.items():
                    found = None if shown is None else measured(function, shown)
                    if found is not None:
                        row[consumer] = max(found, row[consumer] or 0.0)
            table[name] = row
            print(name, {k: None if v is None else f"{v:.1e}" for k, v in row.items()}, file=sys.stderr, flush=True)
    if args.json:
        print(json.dumps(table, indent=2))
    else:
        print(_text(table))
    return 0 if all((value or 0.0) < _WORST for row in table.values() for value in row.values()) else 1


_WORST = 1e-3


def _text(table: Mapping[str, Mapping[str, float | None]]) -> str:
    heads = list(next(iter(table.values())))
    lines = ["| effect | " + " | ".join(heads) + " |", "| --- |" + " --- |" * len(heads)]
    for name, row in table.items():
        values = ["" if value is None else f"{value:.0e}" for value in row.values()]
        lines.append(f"| {name} | " + " | ".join(values) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
