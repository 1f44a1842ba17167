"""The version of the installed package, which files and reports name."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("holoview")
except PackageNotFoundError:  # a checkout that isn't installed
    __version__ = "0+unknown"
