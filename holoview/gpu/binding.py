"""Loads wgpu's native backend with the C declarations of its driver library from a file in the user's cache folder.

wgpu gives the header of that library, 100 KB of C, to cffi at every start. Parsing it takes 0.3 s, and each of about 80
types that a window names later takes 15 ms more, since cffi then reads the names of all types again. cffi can write
declarations that it has parsed as a Python module, which loads in 10 ms ("out-of-line, ABI level" in its manual). The
first start with some header writes that module, and all later starts read it.

To this end the class `cffi.FFI` is replaced while wgpu's backend is imported. This relies on how wgpu uses it, so it is
done for tested versions of wgpu only, and if it fails, a warning says so and the backend is imported as it is.
"""

from __future__ import annotations

import sys
import tempfile
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import blake2b
from importlib import import_module
from pathlib import Path
from typing import Any

import cffi
import wgpu
from cffi import FFI

from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.files import cache_dir

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
    except Exception:  # it is missing, or isn't what was written
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
