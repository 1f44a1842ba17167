"""An open graphics device: checked allocation, upload and download, and cached pipelines.

A native call of wgpu on a lost device or a destroyed buffer aborts the process instead of raising an exception.
Therefore buffers are never destroyed explicitly, only released, and `check_alive` precedes every submission.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import wgpu
from numpy.typing import DTypeLike, NDArray

from holoview.light.gpu.adapter import ENUMERATION, MIB, AdapterInfo, check_limits, choose_adapter, native_adapters
from holoview.light.gpu.shader import TEXEL_FORMAT, TEXELS, ShaderSource, compile_error
from holoview.util.errors import UserError

Constants = Mapping[str, int | float | bool]
SUBGROUP, TIMESTAMPS, INT64 = "subgroup", "timestamp-query", "shader-int64"
"""Optional features: subgroup operations (shuffles), timestamp queries, and 64-bit integers."""
_MAX_PIPELINES = 256
"""Compiled shaders that are kept: some ten viewers' worth. A software adapter takes about 1.3 MB for each."""
_UNIFORM_ALIGNMENT = 16
_COPY_ALIGNMENT = 4
_STORAGE_ALIGNMENT = 8
_REQUESTED_LIMITS = (
    "max-buffer-size",
    "max-storage-buffer-binding-size",
    "max-uniform-buffer-binding-size",
    "max-storage-buffers-per-shader-stage",
    "max-compute-invocations-per-workgroup",
    "max-compute-workgroup-size-x",
    "max-compute-workgroup-size-y",
    "max-compute-workgroup-size-z",
    "max-compute-workgroup-storage-size",
    "max-compute-workgroups-per-dimension",
    "max-texture-dimension-2d",
)


class DeviceLost(UserError):
    """The device was lost because its driver was reset or updated, or the adapter was removed."""

    def __init__(self, info: AdapterInfo) -> None:
        super().__init__(f"adapter {info.label}", "the device was lost", remedy="reopen the device or restart")


@dataclass(frozen=True, eq=False)
class Buffer:
    """Memory on a device. `raw` is the wgpu buffer; `nbytes` is the requested size, which padding may exceed.

    The memory is freed when the last reference is gone.
    """

    raw: Any
    nbytes: int
    label: str


@dataclass(frozen=True, eq=False)
class Pipeline:
    """A compiled compute shader; `raw` is the wgpu pipeline."""

    raw: Any
    label: str


@dataclass(frozen=True)
class TransformOptions:
    """How shaders of FFTs are generated.

    largest_radix: values that an invocation holds in registers at most, up to 32; fewer compile faster.
    pass_invocations: of a workgroup of an FFT by passes. is_rough: whether these passes are computed to six decimal
    digits instead of seven, and faster.
    """

    largest_radix: int = 32
    pass_invocations: int = 64
    is_rough: bool = False


class Device:
    """A wgpu device with checks before each native call that could abort the process.

    `raw` is the wgpu device, for what this class doesn't wrap (textures, drawing). `limits` are the limits that all
    sizes are checked against. Of the compiled shaders, the `max_pipelines` that were asked for last are kept.
    `generated`: shaders that were generated for this device, by what they depend on, the last used at the end.
    `transforms`: how shaders of FFTs are generated for it.
    """

    transforms = TransformOptions()

    def __init__(
        self, raw: Any, info: AdapterInfo, limits: Mapping[str, int], max_pipelines: int = _MAX_PIPELINES
    ) -> None:
        self.raw = raw
        self.info = info
        self.limits = limits
        self._max_pipelines = max_pipelines
        self._pipelines: OrderedDict[tuple[Any, ...], Pipeline] = OrderedDict()
        self.generated: OrderedDict[Hashable, Any] = OrderedDict()
        self._fence: Buffer | None = None

    @property
    def features(self) -> frozenset[str]:
        """Names of the optional features that the device was opened with."""
        return frozenset(self.raw.features)

    def buffer(self, nbytes: int, label: str) -> Buffer:
        """A storage buffer of `nbytes` zeros. Raises UserError if it exceeds a limit or the free memory."""
        return self._allocate(nbytes, label, "storage")

    def upload(self, array: NDArray[Any], label: str) -> Buffer:
        """A storage buffer with the contents of `array` in C order. Raises UserError as `buffer` does."""
        buffer = self.buffer(array.nbytes, label)
        self.write(buffer, array)
        return buffer

    def uniform(self, data: bytes | NDArray[Any], label: str) -> Buffer:
        """A uniform buffer with `data`, such as the bytes from `WgslStruct.pack`. Raises UserError as `buffer` does."""
        array = _as_bytes(data)
        buffer = self._allocate(array.nbytes, label, "uniform")
        self.write(buffer, array)
        return buffer

    def write(self, buffer: Buffer, data: bytes | NDArray[Any]) -> None:
        """Overwrite the start of `buffer`, after all submitted work. Raises ValueError if the data is longer."""
        array = _as_bytes(data)
        if array.nbytes > buffer.nbytes:
            raise ValueError(f"{buffer.label}: {array.nbytes} bytes of data for a buffer of {buffer.nbytes}")
        self.check_alive()
        padding = -array.nbytes % _COPY_ALIGNMENT
        self.raw.queue.write_buffer(buffer.raw, 0, np.pad(array, (0, padding)) if padding else array)

    def download(self, buffer: Buffer, dtype: DTypeLike, shape: tuple[int, ...]) -> NDArray[Any]:
        """The start of `buffer` as an array of `shape`; waits for all submitted work."""
        count = int(np.prod(shape))
        nbytes = count * np.dtype(dtype).itemsize
        if not 0 < nbytes <= buffer.nbytes:
            raise ValueError(f"{buffer.label}: {nbytes} bytes asked of a buffer of {buffer.nbytes}")
        self.check_alive()
        data = self.raw.queue.read_buffer(buffer.raw, 0, nbytes + -nbytes % _COPY_ALIGNMENT)
        return np.frombuffer(data, dtype=dtype, count=count).reshape(shape)

    def wait(self) -> None:
        """Wait for all submitted work."""
        # The wait function of wgpu 0.32 raises TypeError. Reading a few bytes back waits for all earlier submissions.
        self.check_alive()
        if self._fence is None:
            self._fence = self.buffer(_COPY_ALIGNMENT, "fence")
        self.raw.queue.read_buffer(self._fence.raw)

    def check_alive(self) -> None:
        """Raise DeviceLost if the device was lost. Tests it by a tiny allocation, in about 25 µs."""
        try:
            self.raw.create_buffer(size=_COPY_ALIGNMENT, usage=wgpu.BufferUsage.COPY_DST)
        except wgpu.GPUError as error:
            self._raise_if_lost(error)
            raise _out_of_memory("device", _COPY_ALIGNMENT) from error

    def loss_behind(self, error: BaseException) -> DeviceLost | None:
        """The loss of the device that is behind an error, or None: a library may fail first, and say so only then."""
        if isinstance(error, DeviceLost):
            return error
        try:
            self.check_alive()
        except DeviceLost as lost:
            return lost
        except UserError:  # it is there, but has no memory left
            return None
        return None

    def pipeline(self, source: ShaderSource, constants: Constants | None = None, entry: str = "main") -> Pipeline:
        """The compute pipeline of `source` with values for its override constants, compiled unless it is still kept.

        Raises ShaderError if the shader doesn't compile, and DeviceLost.
        """
        values = dict(constants or {})
        key = _pipeline_key(source, values, entry)
        if key not in self._pipelines:
            self._pipelines[key] = self._compile(source, values, entry)
        self._pipelines.move_to_end(key)
        while len(self._pipelines) > self._max_pipelines:
            self._pipelines.popitem(last=False)
        return self._pipelines[key]

    def has_pipeline(self, source: ShaderSource, constants: Constants | None = None, entry: str = "main") -> bool:
        """Whether this pipeline is still kept."""
        return _pipeline_key(source, constants or {}, entry) in self._pipelines

    def _compile(self, source: ShaderSource, constants: dict[str, int | float | bool], entry: str) -> Pipeline:
        self.check_alive()
        try:
            module = self.raw.create_shader_module(label=source.label, code=source.text)
            stage = {"module": module, "entry_point": entry, "constants": constants}
            layout = self._layout(source)
            return Pipeline(
                self.raw.create_compute_pipeline(label=source.label, layout=layout, compute=stage), source.label
            )
        except wgpu.GPUError as error:
            raise compile_error(source, str(error)) from error

    def _layout(self, source: ShaderSource) -> Any:
        """A pipeline layout with all that is declared, even what the entry point doesn't use."""
        declared = source.bindings()
        if declared is None:
            return "auto"
        groups = []
        for number in range(max(declared, default=-1) + 1):
            entries = [
                {"binding": binding, "visibility": wgpu.ShaderStage.COMPUTE, **_binding_layout(kind)}
                for binding, kind in sorted(declared.get(number, {}).items())
            ]
            groups.append(self.raw.create_bind_group_layout(entries=entries))
        return self.raw.create_pipeline_layout(bind_group_layouts=groups)

    def _allocate(self, nbytes: int, label: str, kind: Literal["storage", "uniform"]) -> Buffer:
        alignment = _UNIFORM_ALIGNMENT if kind == "uniform" else _STORAGE_ALIGNMENT
        size = nbytes + -nbytes % alignment
        self._check_size(size, label, kind)
        usage = wgpu.BufferUsage.UNIFORM if kind == "uniform" else wgpu.BufferUsage.STORAGE
        usage |= wgpu.BufferUsage.COPY_SRC | wgpu.BufferUsage.COPY_DST
        try:
            return Buffer(self.raw.create_buffer(label=label, size=size, usage=usage), nbytes, label)
        except wgpu.GPUError as error:
            self._raise_if_lost(error)
            if isinstance(error, MemoryError) or "memory" in str(error).lower():
                raise _out_of_memory(label, size) from error
            raise

    def _raise_if_lost(self, error: wgpu.GPUError) -> None:
        if "lost" in str(error).lower():
            raise DeviceLost(self.info) from error

    def _check_size(self, size: int, label: str, kind: Literal["storage", "uniform"]) -> None:
        if size < 1:
            raise ValueError(f"{label}: a buffer of {size} bytes")
        for name in (f"max-{kind}-buffer-binding-size", "max-buffer-size"):
            if size > self.limits[name]:
                raise UserError(
                    f"buffer '{label}'",
                    f"needs {_mib(size)}",
                    expected=f"at most {_mib(self.limits[name])} ({name} of {self.info.name})",
                    remedy="lower the size of the grid or the number of fields at a time",
                )


def open_device(adapter: str | None = None, features: Iterable[str] = (SUBGROUP, TIMESTAMPS, INT64)) -> Device:
    """Open the best adapter, or the best one whose name contains `adapter`, with the highest limits that it supports.

    features: requested if the adapter has them and omitted otherwise; `Device.features` holds the result.
    Raises UserError if there is no adapter, none of that name, if its limits are too small, or if it can't be opened.
    """
    with ENUMERATION:
        native = choose_adapter(native_adapters(), adapter)
    info = AdapterInfo.of(native)
    check_limits(info, native.limits)
    limits = {name: native.limits[name] for name in _REQUESTED_LIMITS}
    try:
        raw = native.request_device_sync(
            label="holoview", required_features=sorted(set(features) & set(native.features)), required_limits=limits
        )
    except (RuntimeError, wgpu.GPUError) as error:
        remedy = "close other programs that use it, update its driver, or use --backend torch"
        raise UserError(f"adapter {info.label}", f"can't be opened: {error}", remedy=remedy) from error
    return Device(raw, info, dict(raw.limits))


def _binding_layout(kind: str) -> dict[str, Any]:
    """What WebGPU's layout of a bind group says of a binding."""
    if kind == TEXELS:
        return {"storage_texture": {"access": "read-only", "format": TEXEL_FORMAT, "view_dimension": "2d"}}
    return {"buffer": {"type": kind}}


def _pipeline_key(source: ShaderSource, constants: Constants, entry: str) -> tuple[Any, ...]:
    return source, entry, tuple(sorted(constants.items()))


def _as_bytes(data: bytes | NDArray[Any]) -> NDArray[np.uint8]:
    if isinstance(data, bytes):
        return np.frombuffer(data, np.uint8)
    return np.ascontiguousarray(data).reshape(-1).view(np.uint8)


def _mib(nbytes: int) -> str:
    return f"{nbytes / MIB:.4g} MiB" if nbytes >= MIB else f"{nbytes} bytes"


def _out_of_memory(label: str, size: int) -> UserError:
    return UserError(
        f"buffer '{label}'",
        f"no memory is left on the device for {_mib(size)}",
        remedy="lower the size of the grid or the number of fields at a time, or close other programs",
    )
