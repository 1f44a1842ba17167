"""Graphics adapters: which there are, which one to take, and whether its limits are enough."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import wgpu

from holoview.util.errors import UserError, suggest_matches

MIB = 2**20

REQUIRED_LIMITS: Mapping[str, int] = {
    "max-storage-buffers-per-shader-stage": 8,
    "max-compute-invocations-per-workgroup": 256,
    "max-compute-workgroup-size-x": 256,
    "max-storage-buffer-binding-size": 64 * MIB,
    "max-buffer-size": 64 * MIB,
}
"""The least that the shaders can work with: WebGPU's own defaults, with half of its default binding size."""

_KIND_RANK = {"DiscreteGPU": 0, "IntegratedGPU": 1, "CPU": 3}
_OTHER_RANK = 2


@dataclass(frozen=True)
class AdapterInfo:
    """What an adapter says about itself: `kind` as 'DiscreteGPU' or 'CPU', `backend` as 'Vulkan' or 'OpenGL'."""

    name: str
    kind: str
    backend: str
    driver: str

    @classmethod
    def of(cls, native: Any) -> AdapterInfo:
        """Read a wgpu adapter."""
        info = native.info
        return cls(info["device"], info["adapter_type"], info["backend_type"], info["description"])

    @property
    def is_opengl(self) -> bool:
        """Whether the adapter is reached through OpenGL, which lacks features and is slower than the native API."""
        return self.backend.startswith("OpenGL")

    @property
    def is_cpu(self) -> bool:
        """Whether shaders run on the processor."""
        return self.kind == "CPU"

    @property
    def label(self) -> str:
        """All of it in one line, with a warning when it is OpenGL or a CPU adapter."""
        driver = re.sub(r"\s*\([^()]*\)$", "", self.driver)
        parts = [self.name, self.backend, driver]
        parts += ["through OpenGL only"] * self.is_opengl + ["a CPU adapter"] * self.is_cpu
        return ", ".join(part for part in parts if part)

    @property
    def rank(self) -> tuple[int, bool]:
        """Sorts adapters best first: discrete, integrated, other, CPU; then the native API before OpenGL."""
        return _KIND_RANK.get(self.kind, _OTHER_RANK), self.is_opengl


def native_adapters() -> list[Any]:
    """The wgpu adapters of this machine, best first; an empty list where no driver is installed."""
    try:
        with _runtime_folder():
            found = wgpu.gpu.enumerate_adapters_sync()
    except RuntimeError:
        return []
    return sorted(found, key=lambda native: AdapterInfo.of(native).rank)


@contextmanager
def _runtime_folder() -> Iterator[None]:
    """XDG_RUNTIME_DIR set while drivers are asked: without it, as in CI, they print an error that concerns nobody."""
    if "XDG_RUNTIME_DIR" in os.environ or sys.platform != "linux":
        yield
        return
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_RUNTIME_DIR"] = folder
        try:
            yield
        finally:
            del os.environ["XDG_RUNTIME_DIR"]


def list_adapters() -> list[AdapterInfo]:
    """The adapters of this machine, best first."""
    return [AdapterInfo.of(native) for native in native_adapters()]


def choose_adapter(found: Sequence[Any], name: str | None = None) -> Any:
    """The best of the wgpu adapters `found`, or the best one whose name contains `name` (case doesn't matter).

    Without a name, an adapter with too small limits is only taken when there is no other.
    Raises UserError when there is none, or none of that name.
    """
    if not found:
        raise UserError(
            "graphics adapter",
            "none was found",
            expected="a driver for Vulkan, Metal or D3D12",
            remedy="install the driver of your GPU or a software one (Debian, Ubuntu: apt install "
            "mesa-vulkan-drivers), or use --backend torch",
        )
    if name is None:
        return min(found, key=lambda native: (bool(missing_limits(native.limits)), AdapterInfo.of(native).rank))
    fitting = [native for native in found if name.lower() in native.info["device"].lower()]
    if not fitting:
        names = {native.info["device"] for native in found}
        raise UserError("adapter", f"no adapter is called '{name}'", remedy=suggest_matches(name, names))
    return min(fitting, key=lambda native: AdapterInfo.of(native).rank)


def missing_limits(limits: Mapping[str, int]) -> list[str]:
    """The names of the needed limits that `limits` falls short of."""
    return [name for name, needed in REQUIRED_LIMITS.items() if limits.get(name, 0) < needed]


def check_limits(info: AdapterInfo, limits: Mapping[str, int]) -> None:
    """Raise UserError naming limit, needed and found when the adapter can't run the shaders."""
    short = missing_limits(limits)
    if short:
        raise UserError(
            f"adapter {info.label}",
            ", ".join(f"{name} is {limits.get(name, 0)}" for name in short),
            expected=", ".join(f"{name} of at least {REQUIRED_LIMITS[name]}" for name in short),
            remedy="choose another adapter, update its driver, or use --backend torch",
        )
