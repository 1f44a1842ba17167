"""The installed version, libraries that a plain installation leaves out, code that numba compiles, users' files."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from holoview.util.errors import UserError
from holoview.util.files import TEXT_LIMIT, cache_dir, read_limited

T = TypeVar("T")

try:
    __version__ = version("holoview")
except PackageNotFoundError:  # a checkout that isn't installed
    __version__ = "0+unknown"


EXTRAS = {
    "anywidget": "notebook",
    "av": "export",
    "distributed": "cluster",
    "flip_evaluator": "perceptual",
    "imagecodecs": "images",
    "imageio": "export",
    "matplotlib": "plots",
    "numba": "fast",
    "pycvvdp": "perceptual",
    "pymmcore_plus": "rig",
    "serial": "rig",
    "skimage": "unwrap",
    "slmsuite": "rig",
    "uvicorn": "serve",
    "websockets": "serve",
}
"""The extra of holoview that brings each optional library, by the library's module."""


def import_optional(module: str, purpose: str) -> Any:
    """Imports a module of a library in `EXTRAS`.

    module: its dotted name. purpose: the feature that needs it, such as an option or a kind of file; the error starts
    with it. Raises UserError, which names the extra, if the library isn't installed or can't be loaded.

    >>> from holoview.util.packages import import_optional
    >>> import_optional("matplotlib.figure", "--plot").Figure.__name__
    'Figure'
    """
    try:
        return importlib.import_module(module)
    except (ImportError, OSError, RuntimeError) as error:  # the latter two from libraries that don't fit each other
        library = module.partition(".")[0]
        found = f"{library} can't be loaded: {error}"
        if isinstance(error, ModuleNotFoundError) and error.name:  # the library itself, or another one that it needs
            found = f"{error.name.partition('.')[0]} isn't installed"
        remedy = f'install it with `pip install "holoview[{EXTRAS[library]}]"`'
        raise UserError(purpose, found, remedy=remedy) from error


REORDERED = ("contract", "reassoc", "nsz")
"""What rounding may depend on, as LLVM calls it; infinities and NaN stay what they are."""


def compiled(function: Any) -> Any:
    """A function as machine code that holds no lock of Python, kept in the user's cache folder.

    It is compiled when first called with numbers of some precision. Raises UserError where numba can't be loaded.
    """
    numba = import_optional("numba", "compiled kernels")
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(cache_dir() / "numba")  # read where a function is decorated
    try:
        return numba.njit(nogil=True, cache=True, error_model="numpy", fastmath=set(REORDERED))(function)
    finally:
        numba.config.CACHE_DIR = before


_TORCH_LIBRARIES = ("libtorch_cpu", "libtorch_python")


def load_torch_libraries() -> None:
    """Loads the shared libraries of torch, of which `import` then finds most of its work done.

    Importing holds Python's lock while the system loads them, half a second for which a window would stand still. Here
    the system is called without the lock; on Windows, which has another call, nothing is done.
    """
    spec = importlib.util.find_spec("torch")
    if sys.platform == "win32" or spec is None or spec.origin is None or "torch" in sys.modules:
        return
    system = ctypes.CDLL(None)
    system.dlopen.argtypes, system.dlopen.restype = (ctypes.c_char_p, ctypes.c_int), ctypes.c_void_p
    for name in _TORCH_LIBRARIES:
        path = Path(spec.origin).parent / "lib" / f"{name}{'.dylib' if sys.platform == 'darwin' else '.so'}"
        if path.exists():
            system.dlopen(os.fsencode(path), os.RTLD_NOW)


def run_python_file(file: Path, name: str, find: Callable[[ModuleType], T], *, expected: str = "a Python file") -> T:
    """Runs all code of a user's file as a module called `name`; returns what `find` takes from the module.

    No bytecode is written beside the file. Raises UserError if it is missing, or if its code fails, in `find` too.
    """
    code = read_limited(file, expected, TEXT_LIMIT)
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise UserError(str(file), "isn't a Python file", expected="a name that ends in .py")
    module = importlib.util.module_from_spec(spec)
    try:
        exec(compile(code, str(file), "exec"), vars(module))  # the loader would write bytecode beside it
        return find(module)
    except Exception as error:
        raise UserError(str(file), f"failed: {type(error).__name__}: {error}", remedy="mend the file") from error
