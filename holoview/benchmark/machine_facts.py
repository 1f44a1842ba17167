"""What a measurement depends on: the adapter with its limits and features, the driver, processor, memory, versions."""

from __future__ import annotations

import os
import platform
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import torch

from holoview.gpu.adapter import AdapterInfo, native_adapters
from holoview.gpu.device import Device
from holoview.util.packages import __version__
from holoview.util.processors import process_cpu_count

_PACKAGES = ("numpy", "torch", "wgpu")


def machine_facts(device: Device) -> dict[str, Any]:
    """All facts as JSON values; None for what isn't known."""
    native = device.raw.adapter
    return {
        "adapter": asdict(device.info),
        "adapters": [AdapterInfo.of(other).label for other in native_adapters()],
        "limits": dict(device.limits),
        "features": {"used": sorted(device.features), "all": sorted(native.features)},
        "processor": processor_name(),
        "cores": process_cpu_count(),
        "memory_bytes": _memory_bytes(),
        "platform": platform.platform(),
        "torch_threads": torch.get_num_threads(),
        "cuda": _cuda(),
        "versions": versions(),
    }


def versions() -> dict[str, str]:
    """Versions of holoview, Python and the libraries that decide about speed."""
    return {"holoview": __version__, "python": platform.python_version()} | {name: _version(name) for name in _PACKAGES}


def processor_name(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """The processor's model where the system tells it, else its architecture. cpuinfo: the file of Linux."""
    try:
        lines = cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, platform.machine())


def _memory_bytes() -> int | None:
    """Main memory of the machine; None where the system has no POSIX call for it."""
    if not hasattr(os, "sysconf"):
        return None
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def _cuda() -> dict[str, Any] | None:
    """The card that PyTorch computes on, if it has one."""
    if not torch.cuda.is_available():
        return None
    properties = torch.cuda.get_device_properties(0)
    return {
        "name": properties.name,
        "memory_bytes": properties.total_memory,
        "multiprocessors": properties.multi_processor_count,
        "cuda": torch.version.cuda,
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"
