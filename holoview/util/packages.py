"""The version of the installed package, and imports of libraries that a plain installation leaves out."""

from __future__ import annotations

import importlib
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from holoview.util.errors import UserError

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
