"""What a page knows of a hologram: its bench in numbers, its patterns, and the frame recording."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview import colour
from holoview.engine.kernels import frame_shape
from holoview.engine.shader_structs import BLEND_TERM, MODULATOR, PLANE_WAVE, PROPAGATION, SRGB_ENCODING
from holoview.gpu.shader import WgslStruct
from holoview.io.hologram import Hologram
from holoview.model import preset
from holoview.model.bench_parts import Relay
from holoview.model.eye import Eye
from holoview.model.focus import focused_planes
from holoview.model.plan import Plan, make_plan
from holoview.model.system import System
from holoview.optics.frame_inputs import FrameInputs
from holoview.page.recording import Frame, record_frames, strategies, unpack_content

_STRUCTS = (PLANE_WAVE, MODULATOR, PROPAGATION, BLEND_TERM, SRGB_ENCODING)
_QUICK_SAMPLES = 1 << 19  # of the padded grid: with fewer, a whole frame is quick


def page_document(
    hologram: Hologram, name: str, plane_m: float, farthest_m: float
) -> tuple[dict[str, Any], list[dict[str, Any]], bytes]:
    """The JSON of one hologram of a page, its frame recordings, and the binary data of both.

    name: what the page calls it. plane_m: the focal plane that it opens with. farthest_m: the one with the largest
    distance that it can show. Raises UserError for a bench that can't be rendered, or beyond WebGPU's limits.
    """
    plan = make_plan(hologram.system, [*focused_planes(hologram.system), farthest_m])
    inputs = FrameInputs(plan, hologram.drive)
    quick = None if inputs.sampled_transmissions is not None else _quick_plan(plan, farthest_m)
    frames = strategies(Frame(plan, inputs, plane_m))
    if quick is not None:
        frames.insert(0, Frame(quick, FrameInputs(quick, hologram.drive), plane_m, is_quick=True))
    patterns = np.ascontiguousarray(hologram.drive, dtype=_drive_type(hologram.system))
    pixels = patterns.reshape(-1, *patterns.shape[2:])
    recordings = record_frames(frames, [pattern.tobytes() for pattern in pixels])
    document = {
        "name": name,
        "toml": preset.dumps(hologram.system),
        "bench": bench_numbers(plan, is_sampled=inputs.sampled_transmissions is not None),
        "quick": None if quick is None else _grid_numbers(quick),
        "structs": {struct.name: _layout(struct) for struct in _STRUCTS},
        "contents": recordings.contents,
        "patterns": recordings.also,
    }
    return document, recordings.heads, recordings.data


def _quick_plan(plan: Plan, farthest_m: float) -> Plan | None:
    """The plan of a preview, padded by the light's walk-off only; None where it wouldn't be much faster or as true."""
    system = plan.nominal
    if system.sampling.propagation != "linear" or system.effects or _has_pupils(system):
        return None
    if plan.grid.padded[0] * plan.grid.padded[1] < _QUICK_SAMPLES:
        return None
    return make_plan(system.with_(propagation="compact"), [*focused_planes(system), farthest_m])


def read_document(document: dict[str, Any], data: bytes) -> Hologram:
    """The hologram of a page's document. Raises UserError, KeyError, TypeError or ValueError for a damaged one."""
    system = preset.loads(document["toml"], "the page's bench")
    parts, numbers, shape = document["contents"], document["patterns"], system.drive_shape
    if len(numbers) != shape[0] * shape[1]:
        raise ValueError(f"{len(numbers)} patterns, expected {shape[0] * shape[1]}")
    dtype = _drive_type(system)
    size = dtype.itemsize * shape[2] * shape[3]
    patterns = [bytes(size) if number is None else unpack_content(parts[number], data) for number in numbers]
    return Hologram(np.frombuffer(b"".join(patterns), dtype).reshape(shape), system)


def _drive_type(system: System) -> np.dtype[Any]:
    """The type of the numbers of a drive: of patterns, or of a complex field."""
    return np.dtype(np.complex64 if system.is_field else np.float32)


def bench_numbers(plan: Plan, *, is_sampled: bool = False) -> dict[str, Any]:
    """The numbers of a plan from which a page derives the tables of its recording (`bench.js`), in SI units.

    is_sampled: whether a modulator's transmission is given sample by sample, so that wavelengths can't be moved.
    """
    system, nominal = plan.system, plan.nominal
    sines = plan.slopes * system.wavelengths_m[None, :, None] / plan.grid.pitch_m
    has_pupils = _has_pupils(nominal)
    return _grid_numbers(plan, is_sampled=is_sampled) | {
        "wavelengths_m": system.wavelengths_m.tolist(),
        "nominal_wavelengths_m": nominal.wavelengths_m.tolist(),
        "weights": plan.weights.tolist(),
        "strokes_m": [modulator.stroke_m for modulator in system.modulators],
        "gap_m": system.gap_m,
        "nominal_gap_m": nominal.gap_m,
        "planes_m": nominal.planes_m.tolist(),
        "sines": sines.tolist(),
        "pixel_pitch_m": system.modulators[0].pitch_m,
        "relays": [_relay(relay) for relay in plan.relays],
        "eye": None if nominal.eye is None else _eye(nominal.eye, nominal.field_m, nominal.planes_m),
        "observer": observer_table(system.observer),
        "fixed": {"wavelengths": bool(is_sampled or has_pupils or nominal.effects), "pupil": has_pupils},
    }


def _grid_numbers(plan: Plan, *, is_sampled: bool = False) -> dict[str, Any]:
    """The numbers of a plan that depend on its grid."""
    grid = plan.grid
    return {
        "grid": {"shape": grid.shape, "padded": grid.padded, "pitch_m": grid.pitch_m, "upsample": grid.upsample},
        "propagation": plan.system.sampling.propagation,
        "bands": frame_shape(plan, has_plain_pixels=not is_sampled).bands,
    }


def _has_pupils(system: System) -> bool:
    """Whether a relay or the eye has a pupil function, which Python computes for the file's wavelengths."""
    relays = any(relay.aberration_m or relay.apodisation_na is not None for relay in (system.relay1, system.relay2))
    return relays or (system.eye is not None and system.eye.has_pupil_function)


def observer_table(observer: str) -> dict[str, Any]:
    """The observer's response as `colour.observer_weights` reads it: a constant, or a table in steps of 1 nm."""
    if observer == "mono":
        return {"constant": colour.D65_WHITE.tolist()}
    nm, rows = colour.observer_rows("cones" if observer == "eye" else observer)
    matrix = colour.LMS_TO_XYZ.tolist() if observer == "eye" else None
    return {"first_nm": float(nm[0]), "table": rows.tolist(), "matrix": matrix}


def _relay(relay: Relay) -> dict[str, Any]:
    return {
        "iris_na": relay.iris_na,
        "centre_na": list(relay.centre_na),
        "square": None if relay.square is None else asdict(relay.square),
        "dc_block_na": relay.dc_block_na,
    }


def _eye(eye: Eye, field_m: tuple[float, float], planes_m: NDArray[np.float64]) -> dict[str, Any]:
    return {
        "eyepiece_m": eye.eyepiece_m,
        "far_plane_m": eye.far_plane_m(planes_m),
        "pupil_m": eye.pupil_diameter_m(field_m),
        "pupil_y_m": eye.pupil_y_m,
        "pupil_x_m": eye.pupil_x_m,
        "chromatic": eye.chromatic,
        "chromatic_axis": eye.chromatic_axis,
        "reference_m": eye.reference_m,
        "mean_sphere_dpt": eye.prescription.mean_sphere_dpt,
    }


def _layout(struct: WgslStruct) -> dict[str, Any]:
    """Where the fields of a struct lie: its size, and of each field the offset in bytes, the type and the count."""
    fields = {}
    for name, _ in struct.fields:
        dtype, offset = struct.dtype.fields[name][:2]  # type: ignore[index]
        fields[name] = [int(offset), dtype.base.name, int(np.prod(dtype.shape, dtype=int))]
    return {"size": struct.size, "fields": fields}
