"""Loads wgpu's native backend fast, finds and ranks the graphics adapters, and checks their limits for the shaders."""

from __future__ import annotations

import os
import re
import sys
import tempfile
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import blake2b
from importlib import import_module
from pathlib import Path
from typing import Any

import cffi
import wgpu
from cffi import FFI

from holoview.util.errors import UserError, suggest_matches
from holoview.util.file_writer import write_file
from holoview.util.files import cache_dir

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
    def is_discrete(self) -> bool:
        """Whether the adapter is a graphics card of its own."""
        return self.kind == "DiscreteGPU"

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
        with ENUMERATION, _runtime_folder():
            adapters = wgpu.gpu.enumerate_adapters_sync()
    except RuntimeError:
        return []
    return sorted(adapters, key=lambda native: AdapterInfo.of(native).rank)


ENUMERATION = threading.RLock()
"""Held while adapters are enumerated, which changes the environment, and until those that aren't chosen are released:
jobs open devices at the same time, and a driver of OpenGL ends the process where two threads are at its adapters."""


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


# Loads wgpu's native backend with the C declarations of its driver library from a file in the user's cache folder.
#
# wgpu gives the header of that library, 100 KB of C, to cffi at every start. Parsing it takes 0.3 s, and each of about
# 80 types that a window names later takes 15 ms more, since cffi then reads the names of all types again. cffi can
# write declarations that it has parsed as a Python module, which loads in 10 ms ("out-of-line, ABI level" in its
# manual). The first start with some header writes that module, and all later starts read it.
#
# To this end the class `cffi.FFI` is replaced while wgpu's backend is imported. This relies on how wgpu uses it, so it
# is done for tested versions of wgpu only, and if it fails, a warning says so and the backend is imported as it is.


TESTED_VERSIONS = ((0, 32),)
"""Versions (major, minor) of wgpu whose backend is known to work with stored declarations."""
_BACKEND = "wgpu.backends.wgpu_native"
_LOCK = threading.Lock()


def load_backend() -> None:
    """Import wgpu's native backend, if it isn't imported yet. Raises what its import raises."""
    with _LOCK:
        if _BACKEND in sys.modules:
            return
        if wgpu.version_info[:2] in TESTED_VERSIONS:
            try:
                with stored_declarations():
                    import_module(_BACKEND)
                return
            except Exception as error:  # whatever doesn't fit: the backend works without it
                _forget_backend()
                warnings.warn(
                    f"wgpu {wgpu.__version__} doesn't load with stored declarations, so it starts slowly: {error!r}",
                    RuntimeWarning,
                    stacklevel=2,
                )
        import_module(_BACKEND)


@contextmanager
def stored_declarations(folder: Path | None = None) -> Iterator[None]:
    """Within it, objects of `cffi.FFI` that this thread makes take their declarations from `folder` (`cache_dir()`)."""
    thread = threading.get_ident()

    class StoredFFI(FFI):  # type: ignore[misc]  # a subclass, for what other threads do meanwhile
        def __init__(self, backend: Any = None) -> None:
            if threading.get_ident() != thread:
                super().__init__(backend)

        def cdef(self, source: str, *args: Any, **options: Any) -> None:
            if threading.get_ident() != thread:
                super().cdef(source, *args, **options)
                return
            compiled = load_declarations(source, folder)
            public = (name for name in dir(compiled) if not name.startswith("_"))
            self.__dict__.update({name: getattr(compiled, name) for name in public})

    cffi.FFI = StoredFFI
    try:
        yield
    finally:
        cffi.FFI = FFI


def load_declarations(header: str, folder: Path | None = None) -> Any:
    """An object like `cffi.FFI` with the declarations of a C header, from its file in `folder` (`cache_dir()`).

    A file that is missing or can't be read is written, if possible.
    """
    digest = blake2b(f"{cffi.__version__}\n{header}".encode(), digest_size=16).hexdigest()
    path = (cache_dir() if folder is None else folder) / f"declarations-{digest}.py"
    try:
        return _execute(path.read_text(encoding="utf-8"))
    except Exception:  # the file is missing or damaged
        text = _parse(header)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, text, is_durable=False)
    except (OSError, UserError):
        pass  # the folder isn't writable or the disk is full: the next start parses again
    return _execute(text)


def _parse(header: str) -> str:
    """The text of cffi's module for a header."""
    parsed = FFI()
    parsed.cdef(header)
    parsed.set_source("declarations", None)
    with tempfile.TemporaryDirectory() as folder:
        return Path(parsed.compile(tmpdir=folder)).read_text(encoding="utf-8")


def _execute(text: str) -> Any:
    namespace: dict[str, Any] = {}
    exec(compile(text, "declarations", "exec"), namespace)
    return namespace["ffi"]


def _forget_backend() -> None:
    """Make the next import of the backend begin anew."""
    for name in [name for name in sys.modules if name == _BACKEND or name.startswith(f"{_BACKEND}.")]:
        del sys.modules[name]
