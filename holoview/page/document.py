"""What a page knows of a hologram: its bench in numbers, its patterns, and the frame recording."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview import colour
from holoview.engine.frame_layout import frame_shape
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
from holoview.page.recording import record_frames, unpack_content

_STRUCTS = (PLANE_WAVE, MODULATOR, PROPAGATION, BLEND_TERM, SRGB_ENCODING)


def page_document(
    hologram: Hologram, name: str, farthest_m: float
) -> tuple[dict[str, Any], list[dict[str, Any]], bytes]:
    """The JSON of one hologram of a page, its frame recordings, and the binary data of both.

    name: what the page calls it. farthest_m: the focal plane with the largest distance that the page can show.
    Raises UserError for a bench that can't be rendered, or beyond WebGPU's limits.
    """
    system = hologram.system
    plan = make_plan(system, [*focused_planes(system), farthest_m])
    inputs = FrameInputs(plan, hologram.drive)
    patterns = np.ascontiguousarray(hologram.drive, dtype=_drive_type(system))
    pixels = patterns.reshape(-1, *patterns.shape[2:])
    recordings = record_frames(plan, inputs, [pattern.tobytes() for pattern in pixels])
    document = {
        "name": name,
        "toml": preset.dumps(system),
        "bench": bench_numbers(plan, is_sampled=inputs.sampled_transmissions is not None),
        "structs": {struct.name: _layout(struct) for struct in _STRUCTS},
        "contents": recordings.contents,
        "patterns": recordings.also,
    }
    return document, recordings.heads, recordings.data


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
    system, nominal, grid = plan.system, plan.nominal, plan.grid
    bands = frame_shape(plan, has_plain_pixels=not is_sampled).bands
    dx = grid.pitch_m
    sines = plan.slopes * system.wavelengths_m[None, :, None] / dx
    has_pupils = any(r.aberration_m or r.apodisation_na is not None for r in (nominal.relay1, nominal.relay2))
    has_pupils |= nominal.eye is not None and nominal.eye.has_pupil_function
    return {
        "wavelengths_m": system.wavelengths_m.tolist(),
        "nominal_wavelengths_m": nominal.wavelengths_m.tolist(),
        "weights": plan.weights.tolist(),
        "strokes_m": [modulator.stroke_m for modulator in system.modulators],
        "gap_m": system.gap_m,
        "nominal_gap_m": nominal.gap_m,
        "planes_m": nominal.planes_m.tolist(),
        "sines": sines.tolist(),
        "pixel_pitch_m": system.modulators[0].pitch_m,
        "grid": {"shape": grid.shape, "padded": grid.padded, "pitch_m": grid.pitch_m, "upsample": grid.upsample},
        "propagation": system.sampling.propagation,
        "relays": [_relay(relay) for relay in plan.relays],
        "bands": bands,
        "eye": None if nominal.eye is None else _eye(nominal.eye, nominal.field_m, nominal.planes_m),
        "observer": observer_table(system.observer),
        "fixed": {"wavelengths": bool(is_sampled or has_pupils or nominal.effects), "pupil": bool(has_pupils)},
    }


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
