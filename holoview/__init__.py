"""holoview: an interactive hologram previewer for polychromatic, dual-modulator displays.

    system = holoview.load("holochrome-8")
    drive = holoview.random_drive(system, seed=0)
    view = holoview.simulate(system, drive, planes=["10 mm"])
    view.srgb8[0]  # what an eye sees, (y, x, 3)

errors units             how mistakes read; people's units
schema describe          what a parameter is; descriptions built from parameters
system shorthand preset  the bench as data, and as TOML
grid plan                FFT conventions; every derived number
optics engine gpu        elements in torch; two executors of a plan; WebGPU plumbing
colour metrics targets   the eye; PSNR, ΔE, speckle, eyebox; pictures to focal stacks
optimise hologram        finding patterns; the file that holds them (tensors: how such files are read)
effects captures         what real benches do besides; measured data and what the model expects of them
view cli                 what is seen; the command line
session app              what a viewer edits; the viewer itself, `show` in a notebook
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from holoview.model.bench_parts import Modulator, Relay, Sampling, Source
from holoview.model.plan import Plan, make_plan
from holoview.model.preset import load
from holoview.model.system import System
from holoview.util.errors import UserError
from holoview.util.version import __version__

if TYPE_CHECKING:
    from holoview.app.notebook import show
    from holoview.io.hologram import Hologram, load_hologram
    from holoview.optimise.settings import Settings
    from holoview.optimise.solve import iterate
    from holoview.targets.target import Placement, target_for
    from holoview.view import View, random_drive, simulate

_LAZY = {
    "Hologram": "holoview.io.hologram",
    "Placement": "holoview.targets.target",
    "Settings": "holoview.optimise.settings",
    "View": "holoview.view",
    "iterate": "holoview.optimise.solve",
    "load_hologram": "holoview.io.hologram",
    "random_drive": "holoview.view",
    "show": "holoview.app.notebook",
    "simulate": "holoview.view",
    "target_for": "holoview.targets.target",
}

__all__ = [
    "Hologram",
    "Modulator",
    "Placement",
    "Plan",
    "Relay",
    "Sampling",
    "Settings",
    "Source",
    "System",
    "UserError",
    "View",
    "__version__",
    "iterate",
    "load",
    "load_hologram",
    "make_plan",
    "random_drive",
    "show",
    "simulate",
    "target_for",
]


def __getattr__(name: str) -> Any:
    """Loads what needs torch (seconds) when it is first used."""
    if name not in _LAZY:
        raise AttributeError(f"module 'holoview' has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)
