"""Deprecated names in effect files from before version 0.1.0: they work until version 0.3, with a FutureWarning."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

MEMBERS = {
    "power": "laser_power",
    "moments": "exposure_samples",
    "response": "stroke_response",
    "path": "optical_path",
    "seat": "slm2_pose",
    "aim": "camera_pose",
    "offset": "black_level_offset",
    "where": "acts_on",
    "equals": "degenerate_with",
    "equal_to": "degeneracies",
    "starts": "starting_points",
    "words": "finding_fields",
    "sentence": "format_finding",
    "values": "parameter_values",
    "changes": "overrides",
}
"""Hooks, class variables and methods of `Effect`, {old name: new name}."""


def warn(old: str, new: str, stacklevel: int = 3) -> None:
    """Warns that `old` is called `new` now; users see a FutureWarning by default."""
    warnings.warn(f"`{old}` is called `{new}` now; the old name works until version 0.3", FutureWarning, stacklevel)


def adopt_old_members(cls: type[Any]) -> None:
    """Adds the new name of everything that a subclass of `Effect` defines under an old one, and warns."""
    for old, new in MEMBERS.items():
        if old in vars(cls) and new not in vars(cls):
            warn(f"{cls.__name__}.{old}", new, stacklevel=4)
            setattr(cls, new, vars(cls)[old])


def old_attribute(old: str, new: str) -> Any:
    """A read-only property under an old name."""

    def read(self: Any) -> Any:
        warn(old, new)
        return getattr(self, new)

    return property(read)


def old_method(old: str, new: str, inherited: Callable[..., Any]) -> Any:
    """A method under an old name.

    inherited: the base class's method, which `super()` has to reach when a subclass overrides the old name.
    """

    def call(self: Any, *arguments: Any, **keywords: Any) -> Any:
        warn(old, new)
        method = getattr(type(self), new) if getattr(type(self), old) is call else inherited
        return method(self, *arguments, **keywords)

    return call


def moved(old_module: str, new_module: str, names: Mapping[str, str] | None = None) -> Callable[[str], Any]:
    """A `__getattr__` for a module whose content has moved; names: {old name: new name}, where they differ."""

    def get(name: str) -> Any:
        new = (names or {}).get(name, name)
        if name.startswith("__") or not hasattr(module := import_module(new_module), new):
            raise AttributeError(f"module {old_module!r} has no attribute {name!r}")
        warn(f"{old_module}.{name}", f"{new_module}.{new}")
        return getattr(module, new)

    return get
