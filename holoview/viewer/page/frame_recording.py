"""The data of a hologram in a page: its bench in numbers, its patterns, and the frame recording.

`record_frames` turns a frame into data: every buffer, pipeline and dispatch that computes it, for a program without
Python to replay.

`RecordingDevice` stands where an open device stands, and keeps what is asked of it instead of doing it. What the engine
allocates, compiles and dispatches on it is the *frame recording*, a JSON object, and contents of buffers:

    format, version   "holoview-frame-recording", "1"
    strategy          of the FFTs: "passes" runs everywhere, "workgroup" needs the workgroup memory in `limits`
    is_quick          whether it is the recording of the quick image, on a smaller grid, whose shaders compile faster
    plane_m           the focal plane of the tables that change with it, or null with an eye
    limits            the device limits that the recording keeps to: WebGPU's, which every device offers, or higher ones
    shape             samples (y, x) of the image
    pitch             pixels from one row to the next in the sRGB image
    buffers           each: label, size in bytes, usage ("storage" or "uniform"), data: number of its content in
                      `contents`, or null for zeros
    codes             the WGSL texts
    pipelines         each: label, code (number of its text), constants (values of `override` declarations), and
                      groups: the bindings of each bind group as [number, type]
    bind_groups       each: pipeline, group, entries as [binding, buffer]
    lit               each frame and wavelength with light: [frame, wavelength, buffer, index]; buffer counts those of
                      intensities in the order of the `composite` steps
    is_kept           whether each `field` step has a buffer of its own, so that a new focal plane repeats `intensity`
                      only; else `field` precedes each `intensity`
    steps             in order; each: name, dispatches as [pipeline, [[group, bind group], …], [x, y, z] workgroups],
                      and of `field` and `intensity`: frame, source, wavelength
    results           labels of the buffers that hold XYZ (four float32 a sample) and the sRGB image (4 bytes a pixel)

Names of steps: `field` computes the light behind the last modulator, `intensity` the intensity at the plane of one
wavelength, `composite` XYZ, `show` the 8-bit sRGB image; replayed in this order, they make the image. A step reads
tables, which are buffers with these labels (`DeviceTables`): who changes a table repeats the steps that read it, of the
wavelengths that changed, and those that follow.

    plane waves       of each source and wavelength: the struct PlaneWave
    pixel spectra     of each source and wavelength: the spectrum of one pixel along y, then along x, two float32 each
    modulators M      of each wavelength: the struct Modulator
    opd FRAME M       a pattern, float32 of 0 to 1 of the stroke
    propagations N    of each wavelength: the struct Propagation, through the gap (0) or to the focal plane (1)
    support N         of each wavelength and column of frequencies, four int32: the smallest absolute k_y, the lowest
                      and the highest k_y that pass
    dense FRAME M WAVELENGTH, pupil RELAY WAVELENGTH
                      a transmission of each sample, a pupil at each frequency, complex: where effects or aberrations
                      need them

Of a chain of elements each has a buffer of its own, and M is the number of a transmission of its `Way`. Of a static
element there is FRAME 0 alone. Without effects `chain.js` fills `dense`, and `pupil` of kernels of Fourier planes:

    wave WAVELENGTH SOURCE               PlaneWave
    dense FRAME M WAVELENGTH             what multiplies the light, of each sample
    transmit RELAY WAVELENGTH 0          Propagation, to the next element or the focal plane
    support RELAY WAVELENGTH 0           as above

A content is a part of the binary data from `offset`, of so many `bytes`; recordings of the same frame by several
strategies share them. Of the kind `raw` it is stored as it is; of the kinds `codes8` and `codes16` it begins with a
table of `values` 32-bit words, and then has a number of 8 or 16 bits into this table for each word. All numbers are
little-endian. Phases are in turns, in fixed point: 32 bits and 16 guard bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.hologram import Hologram
from holoview.light import colour
from holoview.light.engine.compositor import MAX_TERMS, Compositor
from holoview.light.engine.fused import BufferRegion, FusedFrame, WavelengthSpan
from holoview.light.engine.fused_kernels import frame_shape
from holoview.light.engine.shader_structs import (
    BLEND_TERM,
    MODULATOR,
    PLANE_WAVE,
    PROPAGATION,
    SRGB_ENCODING,
    ShaderInputs,
)
from holoview.light.gpu.adapter import AdapterInfo
from holoview.light.gpu.device import Buffer, Device, TransformOptions
from holoview.light.gpu.line_fft import Strategy, supported_strategies
from holoview.light.gpu.recorder import CommandRecorder
from holoview.light.gpu.shader import WgslStruct
from holoview.light.model import preset
from holoview.light.model.drives import complex_names
from holoview.light.model.effects.registry import ActiveEffects
from holoview.light.model.eye import Eye
from holoview.light.model.focus import focused_planes
from holoview.light.model.plan import Plan, make_plan, source_sines, walk_off
from holoview.light.model.system import System
from holoview.light.observers import observer_rows
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory
from holoview.viewer.page.chain_recording import (
    ElementNumbers,
    StagedBeams,
    element_numbers,
    has_pupils,
    space_numbers,
)

FORMAT, VERSION = "holoview-frame-recording", "1"
DEFAULT_LIMITS = {
    "max-buffer-size": 256 << 20,
    "max-storage-buffer-binding-size": 128 << 20,
    "max-uniform-buffer-binding-size": 64 << 10,
    "max-storage-buffers-per-shader-stage": 8,
    "max-compute-invocations-per-workgroup": 256,
    "max-compute-workgroup-size-x": 256,
    "max-compute-workgroup-size-y": 256,
    "max-compute-workgroup-size-z": 64,
    "max-compute-workgroup-storage-size": 16384,
    "max-compute-workgroups-per-dimension": 65535,
}
"""What every WebGPU device offers: https://www.w3.org/TR/webgpu/#limits."""
_MORE_WORKGROUP_MEMORY = 32768  # which nearly all graphics cards offer
_UNIFORM_USAGE = 0x40  # GPUBufferUsage.UNIFORM
_QUICK_TRANSFORMS = TransformOptions(largest_radix=20, pass_invocations=256, is_rough=True)
"""Beyond this radix SwiftShader takes four times as long to compile a shader; each workgroup costs it a microsecond."""
_KNOTS = 33  # of the line from nominal to true distances, which the effects of the library make straight
_KEPT_BYTES = 512 << 20  # of fields that are kept between frames; more are recomputed


@dataclass(frozen=True)
class Frame:
    """The recording: the frame of a plan by a strategy within limits of the device, first at the plan's last plane."""

    plan: Plan
    inputs: ShaderInputs
    strategy: Strategy = "passes"
    limits: Mapping[str, int] = field(default_factory=lambda: DEFAULT_LIMITS)
    is_quick: bool = False


@dataclass(frozen=True)
class Recordings:
    """Recordings of frames as the module's description lists them, in the order of the frames.

    contents: the parts of `data`. also: the parts of further arrays; None for zeros.
    """

    heads: list[dict[str, Any]]
    contents: list[dict[str, Any]]
    data: bytes
    also: list[int | None]


@dataclass(eq=False)
class _Numbered:
    """Something that was made on the device: its number among its kind, and its size if it is a buffer."""

    number: int
    size: int = 0
    groups: Sequence[Any] = ()

    def get_bind_group_layout(self, number: int) -> tuple[int, int]:
        """The layout of a pipeline's group: the numbers of both."""
        return self.number, number


@dataclass
class _Pass:
    """An encoder and its compute pass: keeps the dispatches."""

    dispatches: list[list[Any]] = field(default_factory=list)
    _pipeline: int = -1
    _groups: dict[int, int] = field(default_factory=dict)

    def begin_compute_pass(self, **_: Any) -> _Pass:
        """The pass, which is the encoder itself."""
        return self

    def set_pipeline(self, pipeline: _Numbered) -> None:
        """Chooses the pipeline of the next dispatch."""
        self._pipeline, self._groups = pipeline.number, {}

    def set_bind_group(self, number: int, group: _Numbered) -> None:
        """Binds a group for the next dispatch."""
        self._groups[number] = group.number

    def dispatch_workgroups(self, *workgroups: int) -> None:
        """Keeps a dispatch."""
        self.dispatches.append([self._pipeline, sorted(self._groups.items()), list(workgroups)])

    def end(self) -> None:
        """Ends the pass."""

    def finish(self) -> list[list[Any]]:
        """The dispatches."""
        return self.dispatches


class _RecordingGpu:
    """Stands for wgpu's device and its queue: everything that `Device` asks of them is numbered and kept."""

    features: frozenset[str] = frozenset()

    def __init__(self) -> None:
        self.queue = self
        self.buffers: list[dict[str, Any]] = []
        self.contents: dict[int, bytearray] = {}
        self.pipelines: list[dict[str, Any]] = []
        self.bind_groups: list[dict[str, Any]] = []
        self.submitted: list[list[Any]] = []

    def create_buffer(self, *, size: int, usage: int, label: str = "") -> _Numbered:
        """Numbers a buffer, unless it has no label: such buffers only test whether the device is alive."""
        if not label:
            return _Numbered(-1, size)
        kind = "uniform" if usage & _UNIFORM_USAGE else "storage"
        self.buffers.append({"label": label, "size": size, "usage": kind})
        return _Numbered(len(self.buffers) - 1, size)

    def write_buffer(self, buffer: _Numbered, offset: int, data: NDArray[np.uint8]) -> None:
        """Keeps the contents of a buffer."""
        memory = self.contents.setdefault(buffer.number, bytearray(buffer.size))
        raw = np.ascontiguousarray(data).tobytes()
        memory[offset : offset + len(raw)] = raw

    def create_shader_module(self, *, label: str, code: str) -> tuple[str, str]:
        """The label and the code."""
        return label, code

    def create_bind_group_layout(self, *, entries: list[dict[str, Any]]) -> list[list[Any]]:
        """The bindings and their types."""
        return [[entry["binding"], entry["buffer"]["type"]] for entry in entries]

    def create_pipeline_layout(self, *, bind_group_layouts: list[Any]) -> list[Any]:
        """The groups."""
        return bind_group_layouts

    def create_compute_pipeline(self, *, label: str, layout: Any, compute: dict[str, Any]) -> _Numbered:
        """Numbers a pipeline."""
        if layout == "auto":
            raise ValueError(f"{label}: a recorded shader declares all its bindings as buffers")
        code = compute["module"][1]
        constants = {name: float(value) for name, value in compute["constants"].items()}
        self.pipelines.append({"label": label, "code": code, "constants": constants, "groups": layout})
        return _Numbered(len(self.pipelines) - 1)

    def create_bind_group(self, *, layout: tuple[int, int], entries: list[dict[str, Any]]) -> _Numbered:
        """Numbers a bind group."""
        bound = [[entry["binding"], entry["resource"]["buffer"].number] for entry in entries]
        self.bind_groups.append({"pipeline": layout[0], "group": layout[1], "entries": bound})
        return _Numbered(len(self.bind_groups) - 1)

    def create_command_encoder(self, *, label: str = "") -> _Pass:
        """An encoder that keeps its dispatches."""
        return _Pass()

    def submit(self, commands: list[list[list[Any]]]) -> None:
        """Keeps the dispatches that were submitted."""
        for dispatches in commands:
            self.submitted += dispatches


class RecordingDevice(Device):
    """A device that keeps what is asked of it. Nothing can be read from it."""

    def __init__(self, limits: Mapping[str, int] = DEFAULT_LIMITS) -> None:
        self.gpu = _RecordingGpu()
        super().__init__(self.gpu, AdapterInfo("a recording", "Other", "WebGPU", ""), limits)

    def upload(self, array: NDArray[Any], label: str) -> Buffer:
        """A storage buffer with the contents of an array; zeros aren't kept."""
        return super().upload(array, label) if array.any() else self.buffer(array.nbytes, label)

    def check_alive(self) -> None:
        """Nothing: a recording isn't lost."""


def strategies(frame: Frame) -> list[Frame]:
    """A frame by each strategy of the FFTs that browsers' devices may offer, the one that runs everywhere first."""
    more = {**DEFAULT_LIMITS, "max-compute-workgroup-storage-size": _MORE_WORKGROUP_MEMORY}
    frames = [frame, replace(frame, strategy="workgroup", limits=more)]
    padded = frame.plan.grid.padded
    return [each for each in frames if each.strategy in supported_strategies(RecordingDevice(each.limits), padded)]


def record_frames(frames: Sequence[Frame], also: Sequence[bytes] = ()) -> Recordings:
    """Recordings of frames.

    also: further arrays to store with the contents of buffers; an array that equals a content takes no room.
    Raises UserError for a grid beyond WebGPU's default limits.
    """
    arrays: list[bytes] = []
    heads: list[dict[str, Any]] = []
    for frame in frames:
        device = RecordingDevice(frame.limits)
        if frame.is_quick:
            device.transforms = _QUICK_TRANSFORMS
        heads.append(_record(device, frame, first_content=len(arrays)))
        arrays += [bytes(device.gpu.contents.get(i, b"")) for i in range(len(device.gpu.buffers))]
    of_each, contents, data = pack_contents([*arrays, *also])
    for head in heads:
        for buffer in head["buffers"]:
            buffer["data"] = of_each[buffer["data"]]
    return Recordings(heads, contents, data, of_each[len(arrays) :])


def _record(device: RecordingDevice, recorded: Frame, first_content: int) -> dict[str, Any]:
    """The recording of a frame. first_content: number of the first buffer's content.

    Fields behind the last modulator are kept between frames if they fit into 512 MiB; else `field` steps write to one
    buffer, and precede each `intensity`.
    """
    plan = recorded.plan
    compositor = Compositor(device, plan.grid.shape)
    lit = [(int(f), int(w)) for f, w in np.argwhere(plan.weights > 0)]
    sources = range(len(plan.slopes))
    beams = (StagedBeams if plan.way.is_chain else _FusedBeams)(
        device, plan, recorded.inputs, recorded.strategy, len(lit) * len(sources), _KEPT_BYTES
    )
    steps: list[dict[str, Any]] = []

    def step(name: str, submit: Callable[[], None], **place: int) -> None:
        device.gpu.submitted = []
        submit()
        steps.append({"name": name, **place, "dispatches": device.gpu.submitted})

    intensities, of_each = _intensity_buffers(compositor, lit)
    for f, w in lit:
        for source in sources:
            span, place = WavelengthSpan(f, source, w), {"frame": f, "source": source, "wavelength": w}
            step("field", partial(beams.record_field, span), **place)
            store = partial(beams.record_intensity, span, of_each[f, w], accumulates=source > 0)
            step("intensity", store, **place)
    xyz, srgb = compositor.xyz_buffer("XYZ"), compositor.srgb_buffer("sRGB")
    for number, buffer in enumerate(intensities):
        terms = [
            (region.first, plan.weights[key] * plan.colour_weights[key[1]])
            for key, region in of_each.items()
            if region.buffer is buffer
        ]
        recorder = CommandRecorder(device)
        compositor.composite(recorder, buffer, terms, xyz, base=xyz if number else None)
        step("composite", recorder.submit)
    recorder = CommandRecorder(device)
    compositor.encode_srgb(recorder, xyz, srgb)
    step("show", recorder.submit)
    regions = [[f, w, intensities.index(region.buffer), region.first] for (f, w), region in of_each.items()]
    return _assembled(device, recorded, compositor, steps, regions, beams.is_kept, first_content)


class _FusedBeams:
    """Records the light of a short form by fused kernels, as `StagedBeams` does that of a chain."""

    def __init__(
        self, device: Device, plan: Plan, inputs: ShaderInputs, strategy: Strategy, count: int, most_bytes: int
    ) -> None:
        self._device = device
        self._frame = FusedFrame(plan, inputs, device, strategy=strategy)
        self._frame.tables.set_plane(len(plan.planes) - 1)
        self.is_kept = self._frame.rows_bytes(self._frame.rows_behind(self._frame.last_place)) * count <= most_bytes
        self._kept: BufferRegion | None = None

    def record_field(self, span: WavelengthSpan) -> None:
        """Submits the light behind the last modulator."""
        frame, recorder, target = self._frame, CommandRecorder(self._device), None
        if self.is_kept:
            target = frame.allocate_rows(
                f"field {span.frame} {span.source} {span.wavelength}", frame.rows_behind(frame.last_place)
            )
        self._kept = frame.record_light(recorder, span, target)
        recorder.submit()

    def record_intensity(self, span: WavelengthSpan, to: BufferRegion, *, accumulates: bool) -> None:
        """Submits the intensity of the last light at the focal plane."""
        assert self._kept is not None
        recorder = CommandRecorder(self._device)
        self._frame.record_intensity(recorder, span, self._kept, to, accumulates=accumulates)
        recorder.submit()


def _intensity_buffers(
    compositor: Compositor, lit: list[tuple[int, int]]
) -> tuple[list[Any], dict[tuple[int, int], BufferRegion]]:
    """Buffers for the intensities of all lit frames and wavelengths, and the region of each; one dispatch adds each."""
    each = max(min(compositor.largest_bytes // compositor.intensity_bytes, MAX_TERMS), 1)
    buffers = [
        compositor.intensity_buffer(min(each, len(lit) - start), f"intensities {start}")
        for start in range(0, len(lit), each)
    ]
    return buffers, {key: BufferRegion(buffers[i // each], i % each) for i, key in enumerate(lit)}


def _assembled(
    device: RecordingDevice,
    recorded: Frame,
    compositor: Compositor,
    steps: list[dict[str, Any]],
    regions: list[list[int]],
    is_kept: bool,
    first_content: int,
) -> dict[str, Any]:
    gpu = device.gpu
    codes = list(dict.fromkeys(pipeline["code"] for pipeline in gpu.pipelines))
    return {
        "format": FORMAT,
        "version": VERSION,
        "strategy": recorded.strategy,
        "is_quick": recorded.is_quick,
        "plane_m": None if recorded.plan.nominal.eye else recorded.plan.planes[-1].nominal_m,
        "limits": dict(device.limits),
        "shape": list(compositor.shape),
        "pitch": compositor.pitch,
        "is_kept": is_kept,
        "lit": regions,
        "buffers": [{**buffer, "data": first_content + number} for number, buffer in enumerate(gpu.buffers)],
        "codes": codes,
        "pipelines": [{**pipeline, "code": codes.index(pipeline["code"])} for pipeline in gpu.pipelines],
        "bind_groups": gpu.bind_groups,
        "steps": steps,
        "results": {"xyz": "XYZ", "srgb": "sRGB"},
    }


def pack_contents(arrays: Sequence[bytes]) -> tuple[list[int | None], list[dict[str, Any]], bytes]:
    """Contents of buffers, each once, without loss: the part of each, the parts, and the binary data.

    A part is stored as it is (`raw`) or, if its 32-bit words take at most 256 or 65 536 values and many, as numbers of
    8 or 16 bits into a table of these values (`codes8`, `codes16`): a pattern of 256 levels takes a quarter. Buffers
    of zeros have no part.
    """
    parts: list[dict[str, Any]] = []
    of_each: list[int | None] = []
    known: dict[bytes, int] = {}
    out = bytearray()
    for raw in arrays:
        if raw.count(0) == len(raw):
            of_each.append(None)
            continue
        if raw not in known:
            known[raw] = len(parts)
            kind, packed, values = _coded(raw)
            parts.append({"kind": kind, "offset": len(out), "bytes": len(packed), "values": values})
            out += packed + bytes(-len(packed) % 4)
        of_each.append(known[raw])
    return of_each, parts, bytes(out)


def unpack_content(part: dict[str, Any], data: bytes) -> bytes:
    """The content of a part: the inverse of `pack_contents`. Raises ValueError where the part isn't in the data."""
    start, size, count = part["offset"], part["bytes"], part["values"]
    raw = data[start : start + size]
    if not (isinstance(start, int) and start >= 0 and len(raw) == size and 4 * count <= size):
        raise ValueError("a content that isn't in the data")
    if part["kind"] == "raw":
        return raw
    dtype = {"codes8": np.uint8, "codes16": np.uint16}[part["kind"]]
    codes = np.frombuffer(raw, dtype, offset=4 * count)
    if codes.size and int(codes.max()) >= count:
        raise ValueError("codes beyond their table")
    return np.frombuffer(raw, np.uint32, count)[codes].tobytes()


def _coded(raw: bytes) -> tuple[str, bytes, int]:
    """How a content is stored, its bytes, and the number of values in its table, which comes first."""
    if len(raw) % 4 or len(raw) < 4096:
        return "raw", raw, 0
    words = np.frombuffer(raw, np.uint32)
    values, codes = np.unique(words, return_inverse=True)
    for kind, dtype, most in (("codes8", np.uint8, 256), ("codes16", np.uint16, 65536)):
        if len(values) <= most and len(values) * 4 < len(words) * (4 - np.dtype(dtype).itemsize):
            return kind, values.tobytes() + codes.astype(dtype).tobytes(), len(values)
    return "raw", raw, 0


# --- what the page knows of a hologram --------------------------------------------------------------------------------


_STRUCTS = (PLANE_WAVE, MODULATOR, PROPAGATION, BLEND_TERM, SRGB_ENCODING)
_QUICK_SAMPLES = 1 << 19  # of the padded grid: with fewer, a whole frame is quick


def page_document(
    hologram: Hologram, name: str, plane_m: float, plane_range_m: tuple[float, float]
) -> tuple[dict[str, Any], list[dict[str, Any]], bytes]:
    """The JSON of one hologram of a page, its frame recordings, and the binary data of both.

    name: on the page. plane_m: the nominal focal plane that it opens with. plane_range_m: the nearest and the farthest
    that it can show. Raises UserError for a bench that can't be rendered, or beyond WebGPU's limits.
    """
    planes_m = [*focused_planes(hologram.system), max(plane_range_m, key=abs), plane_m]
    plan = make_plan(hologram.system, planes_m)
    inputs = FrameInputs(plan, hologram.drive)
    is_sampled = not plan.way.is_chain and inputs.sampled_transmissions is not None
    quick = None if is_sampled else _quick_plan(plan, planes_m)
    frames = strategies(Frame(plan, inputs))
    if quick is not None:
        frames.insert(0, Frame(quick, FrameInputs(quick, hologram.drive), is_quick=True))
    patterns = _patterns(hologram)
    elements = element_numbers(plan, inputs) if plan.way.is_chain else ElementNumbers()
    recordings = record_frames(frames, [array.tobytes() for array in (*patterns, *elements.arrays)])
    bench = bench_numbers(plan, plane_range_m, is_sampled=is_sampled)
    document = {
        "name": name,
        "toml": preset.dumps(hologram.system),
        "bench": bench | {"elements": elements.named(recordings.also[len(patterns) :])},
        "quick": None if quick is None else _grid_numbers(quick),
        "structs": {struct.name: _layout(struct) for struct in _STRUCTS},
        "contents": recordings.contents,
        "patterns": recordings.also[: len(patterns)],
    }
    return document, recordings.heads, recordings.data


def _patterns(hologram: Hologram) -> list[NDArray[Any]]:
    """The patterns (y, x) of a hologram, by frame and modulator; of a chain by element and frame."""
    system = hologram.system
    if system.is_chain:
        drives = [np.ascontiguousarray(each, _chain_type(system, name)) for name, each in hologram.drive.items()]
        return [pattern for drive in drives for pattern in drive]
    patterns = np.ascontiguousarray(hologram.drive, dtype=_drive_type(system))
    return list(patterns.reshape(-1, *patterns.shape[2:]))


def _chain_type(system: System, name: str) -> np.dtype[Any]:
    """The type of the patterns of an element."""
    return np.dtype(np.complex64 if name in complex_names(system) else np.float32)


def _quick_plan(plan: Plan, planes_m: Sequence[float]) -> Plan | None:
    """The plan of a preview, padded by the light's walk-off only; None where it wouldn't be much faster or as true."""
    system = plan.nominal
    if system.sampling.propagation != "linear" or system.effects or has_pupils(system) or system.way.kernels:
        return None
    if plan.grid.padded[0] * plan.grid.padded[1] < _QUICK_SAMPLES:
        return None
    return make_plan(system.with_(propagation="compact"), planes_m)


def read_document(document: dict[str, Any], data: bytes) -> Hologram:
    """The hologram of a page's document. Raises UserError, KeyError, TypeError or ValueError for a damaged one."""
    system = preset.loads(document["toml"], "the page's bench")
    parts, numbers = document["contents"], list(document["patterns"])
    shapes = (
        system.drive_shapes if system.is_chain else {"": (math.prod(system.drive_shape[:2]), *system.drive_shape[2:])}
    )
    total = sum(count for count, *_ in shapes.values())
    if len(numbers) != total:
        raise ValueError(f"{len(numbers)} patterns, expected {total}")

    def drive(shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
        size, own = dtype.itemsize * math.prod(shape[1:]), [numbers.pop(0) for _ in range(shape[0])]
        require_memory("the page's hologram", 3 * size * len(own))
        patterns = [bytes(size) if number is None else unpack_content(parts[number], data) for number in own]
        return np.frombuffer(b"".join(patterns), dtype).reshape(shape)

    if not system.is_chain:
        return Hologram(drive(shapes[""], _drive_type(system)).reshape(system.drive_shape), system)
    return Hologram({name: drive(shape, _chain_type(system, name)) for name, shape in shapes.items()}, system)


def _drive_type(system: System) -> np.dtype[Any]:
    """The type of the numbers of a drive: of patterns, or of a complex field."""
    return np.dtype(np.complex64 if system.is_field else np.float32)


def bench_numbers(plan: Plan, plane_range_m: tuple[float, float], *, is_sampled: bool = False) -> dict[str, Any]:
    """The numbers of a plan from which a page derives the tables of its recording (`bench.js`), in SI units.

    Readers choose nominal planes, gaps and lasers: `true_planes` and `true_gaps` lead to the distances with effects,
    null without effects, and `laser_of` tells the laser of each of `wavelengths_m`, its spectral lines.

    plane_range_m: the nearest and the farthest nominal plane that the page can show. is_sampled: whether a modulator's
    transmission is given sample by sample, so that wavelengths can't be moved.
    """
    system, nominal = plan.system, plan.nominal
    is_fixed, count = has_pupils(nominal), len(system.wavelengths_m)
    gaps_m = gap_range(nominal, plane_range_m)
    own: dict[str, Any] = {"strokes_m": [modulator.stroke_m for modulator in system.modulators]}
    if plan.way.is_chain:
        own = space_numbers(plan)
    return (
        _grid_numbers(plan, is_sampled=is_sampled)
        | own
        | {
            "is_chain": plan.way.is_chain,
            "wavelengths_m": system.wavelengths_m.tolist(),
            "nominal_wavelengths_m": nominal.wavelengths_m.tolist(),
            "laser_of": [plan.laser_of(wavelength) for wavelength in range(count)],
            "weights": plan.weights.tolist(),
            "gap_m": system.gap_m,
            "nominal_gap_m": nominal.gap_m,
            "true_planes": _true_distances(nominal, "planes", plane_range_m),
            "true_gaps": None if gaps_m is None else _true_distances(nominal, "gap", gaps_m),
            "planes_m": nominal.planes_m.tolist(),
            "sines": source_sines(system).tolist(),
            "relays": [_relay(plan, relay) for relay in range(len(plan.relays))],
            "eye": None if nominal.eye is None else _eye(nominal.eye, nominal.field_m, nominal.planes_m),
            "observer": observer_table(system.observer),
            "fixed": {
                "wavelengths": bool(is_sampled or is_fixed or nominal.effects),
                "powers": bool(ActiveEffects(nominal.effect_values).with_hooks("laser_power")),
                "pupil": is_fixed,
            },
        }
    )


def gap_range(system: System, plane_range_m: tuple[float, float]) -> tuple[float, float] | None:
    """The nominal gaps that a page can show, m: from 0 to three times the bench's, or as far as padding holds light.

    With effects, gaps that the bench can't have with them are left out. plane_range_m: as of `bench_numbers`.
    """
    if system.gap_m is None:
        return None
    low, high = 0.0, 3 * system.gap_m
    if system.sampling.propagation == "compact":
        plan = make_plan(system, [max(plane_range_m, key=abs)])
        room = min(p - n for p, n in zip(plan.grid.padded, plan.grid.shape, strict=True))
        reach = walk_off(plan.system, 0, 1.0)
        high = max(system.gap_m, min(high, room / reach if reach else math.inf))
    known = _true_distances(system, "gap", (low, high))
    return (low, high) if known is None else (known["nominal_m"][0], known["nominal_m"][-1])


def _true_distances(system: System, key: str, range_m: tuple[float, float]) -> dict[str, list[float]] | None:
    """Nominal planes or gaps over a range, and where they are with effects, m; None without effects."""
    if not system.effects:
        return None
    own_m = system.planes_m if key == "planes" else [system.gap_m or 0.0]
    active, known = ActiveEffects(system.effect_values), {}
    for nominal_m in np.union1d(np.linspace(*range_m, _KNOTS), own_m).tolist():
        with suppress(UserError):  # such a bench can't be
            true = active.as_built(system.edit({key: [nominal_m] if key == "planes" else nominal_m}))
            known[nominal_m] = float(true.planes_m[0]) if key == "planes" else float(true.gap_m or 0.0)
    return {"nominal_m": list(known), "true_m": list(known.values())}


def _grid_numbers(plan: Plan, *, is_sampled: bool = False) -> dict[str, Any]:
    """The numbers of a plan that depend on its grid."""
    grid = plan.grid
    return {
        "grid": {"shape": grid.shape, "padded": grid.padded, "pitch_m": grid.pitch_m, "upsample": grid.upsample},
        "propagation": plan.system.sampling.propagation,
        "bands": None if plan.way.is_chain else frame_shape(plan, has_plain_pixels=not is_sampled).bands,
    }


def observer_table(observer: str) -> dict[str, Any]:
    """The observer's response as `colour.observer_weights` reads it: a constant, or a table in steps of 1 nm."""
    if observer == "mono":
        return {"constant": colour.D65_WHITE.tolist()}
    if observer == "eye":
        nm, rows = observer_rows("cones")
        return {"first_nm": float(nm[0]), "table": rows.tolist(), "matrix": colour.LMS_TO_XYZ.tolist()}
    nm, rows = colour.observer_table(observer)
    return {"first_nm": float(nm[0]), "table": rows.tolist(), "matrix": None}


def _relay(plan: Plan, number: int) -> dict[str, Any]:
    """The stops of a relay, and the pixels whose first order they name: their pitch, and how many samples it is."""
    relay, order_m = plan.relays[number], plan.order_m(number)
    return {
        "iris_na": relay.iris_na,
        "centre_na": list(relay.centre_na),
        "square": None if relay.square is None else {k: v for k, v in asdict(relay.square).items() if k != "of"},
        "dc_block_na": relay.dc_block_na,
        "is_kernel": plan.way.kernel(number) is not None,
        "order": {"pitch_m": order_m, "samples": round(order_m / plan.grid.pitch_m)},
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
