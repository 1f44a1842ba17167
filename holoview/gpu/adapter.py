"""Finds and ranks the machine's graphics adapters, and checks their limits against what the shaders need."""

from __future__ import annotations

import os
import re
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import wgpu

from holoview.gpu.binding import load_backend
from holoview.util.errors import UserError, suggest_matches

MIB = 2**20

REQUIRED_LIMITS: Mapping[str, int] = {
    "max-storage-buffers-per-shader-stage": 8,
    "max-compute-invocations-per-workgroup": 256,
    "max-compute-workgroup-size-x": 256,
    "max-storage-buffer-binding-size": 64 * MIB,
    "max-buffer-size": 64 * MIB,
}
"""Minimum limits of an adapter: the defaults of WebGPU, with half of its default binding size."""

_KIND_RANK = {"DiscreteGPU": 0, "IntegratedGPU": 1, "CPU": 3}
_OTHER_RANK = 2


@dataclass(frozen=True)
class AdapterInfo:
    """Identity of an adapter as its driver reports it.

    kind: 'DiscreteGPU', 'IntegratedGPU', 'CPU', … backend: 'Vulkan', 'Metal', 'D3D12' or 'OpenGL'.
    driver: name and version of the driver.
    """

    name: str
    kind: str
    backend: str
    driver: str

    @classmethod
    def of(cls, native: Any) -> AdapterInfo:
        """Information about a wgpu adapter."""
        info = native.info
        return cls(info["device"], info["adapter_type"], info["backend_type"], info["description"])

    @property
    def is_opengl(self) -> bool:
        """Whether the backend is OpenGL, which lacks features and is slower than the native API."""
        return self.backend.startswith("OpenGL")

    @property
    def is_cpu(self) -> bool:
        """Whether the adapter executes shaders on the CPU."""
        return self.kind == "CPU"

    @property
    def label(self) -> str:
        """Name, backend and driver in one line, with a remark when it is OpenGL or a CPU adapter."""
        driver = re.sub(r"\s*\([^()]*\)$", "", self.driver)
        parts = [self.name, self.backend, driver]
        parts += ["through OpenGL only"] * self.is_opengl + ["a CPU adapter"] * self.is_cpu
        return ", ".join(part for part in parts if part)

    @property
    def rank(self) -> tuple[int, bool]:
        """Sort key, best first: discrete, integrated, other, CPU; then the native API before OpenGL."""
        return _KIND_RANK.get(self.kind, _OTHER_RANK), self.is_opengl


def native_adapters() -> list[Any]:
    """The wgpu adapters of this machine, best first; an empty list if no driver is installed."""
    load_backend()
    try:
        with _ENVIRONMENT, _runtime_folder():
            adapters = wgpu.gpu.enumerate_adapters_sync()
    except RuntimeError:
        return []
    return sorted(adapters, key=lambda native: AdapterInfo.of(native).rank)


_ENVIRONMENT = threading.Lock()
"""Held while the environment of the process is changed: jobs open devices at the same time."""


@contextmanager
def _runtime_folder() -> Iterator[None]:
    """Sets XDG_RUNTIME_DIR while adapters are enumerated; drivers print an irrelevant error where it is unset (CI)."""
    if "XDG_RUNTIME_DIR" in os.environ or sys.platform != "linux":
        yield
        return
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_RUNTIME_DIR"] = folder
        try:
            yield
        finally:
            del os.environ["XDG_RUNTIME_DIR"]


def choose_adapter(adapters: Sequence[Any], name: str | None = None) -> Any:
    """The best of some wgpu adapters, or the best one whose name contains `name` (case-insensitive).

    Without a name, an adapter with insufficient limits is chosen only if all are insufficient.
    Raises UserError if there is no adapter, or none of that name.
    """
    if not adapters:
        raise UserError(
            "graphics adapter",
            "none was found",
            expected="a driver for Vulkan, Metal or D3D12",
            remedy="install the driver of your GPU or a software one (Debian, Ubuntu: apt install "
            "mesa-vulkan-drivers), or use --backend torch",
        )
    if name is None:
        return min(adapters, key=lambda native: (bool(missing_limits(native.limits)), AdapterInfo.of(native).rank))
    matching = [native for native in adapters if name.lower() in native.info["device"].lower()]
    if not matching:
        names = {native.info["device"] for native in adapters}
        raise UserError("adapter", f"no adapter is called '{name}'", remedy=suggest_matches(name, names))
    return min(matching, key=lambda native: AdapterInfo.of(native).rank)


def missing_limits(limits: Mapping[str, int]) -> list[str]:
    """Names of the required limits that `limits` doesn't reach."""
    return [name for name, needed in REQUIRED_LIMITS.items() if limits.get(name, 0) < needed]


def check_limits(info: AdapterInfo, limits: Mapping[str, int]) -> None:
    """Raise UserError, which names each insufficient limit, if the adapter can't run the shaders."""
    short = missing_limits(limits)
    if short:
        raise UserError(
            f"adapter {info.label}",
            ", ".join(f"{name} is {limits.get(name, 0)}" for name in short),
            expected=", ".join(f"{name} of at least {REQUIRED_LIMITS[name]}" for name in short),
            remedy="choose another adapter, update its driver, or use --backend torch",
        )
