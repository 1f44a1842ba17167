"""Effects: what real benches do and the plain model doesn't. One physical cause a file, named as its id.

Each states its cause, its parameters, and the hooks of what it changes (`holoview.model.effects.effect`). The registry
(`holoview.model.effects.registry`) finds every file of this package by itself.

starting_grids    points from which a search starts, shared by several effects
aberration_base   what the aberrations of both relays have in common; iris_base: likewise the irises
learned_maps      maps that a calibration learned; calibration_file: their file; calibrated: the effect that uses them
"""

from typing import Any

from holoview.model.effects.effect import DataProperties, Effect, Needs
from holoview.model.effects.old_names import moved
from holoview.model.effects.parameter import Parameter, Values

__all__ = ["DataProperties", "Effect", "Needs", "Parameter", "Values"]

_old = moved(__name__, "holoview.model.effects.effect", {"Facts": "DataProperties"})


def __getattr__(name: str) -> Any:
    """`Facts`, as `DataProperties` was called before version 0.2."""
    if name != "Facts":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _old(name)
