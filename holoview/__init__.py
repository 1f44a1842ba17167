"""holoview simulates and optimises holograms for polychromatic displays: chains of modulators, masks and lenses.

>>> import holoview as hv
>>> system = hv.load("holochrome-8").with_(shape=[48, 64])
>>> drive = hv.random_drive(system, seed=0)
>>> view = hv.simulate(system, drive, planes=["10 mm"])
>>> view.srgb8[0].shape  # what an eye sees, (y, x, 3)
(96, 128, 3)

All numbers are in SI units (metres, radians); text such as "10 mm" is accepted wherever a length or an angle of a
display is. Drives have the axes (frame, modulator, y, x), or are a mapping by elements' names; intensities have (plane,
wavelength, y, x). A user's mistake raises `UserError`. The packages, each of which imports what stands above it here:

util        errors, units, files, tables, memory: knows nothing of optics
light       the bench as data, its physics, and the two executors: what light does on a bench
holograms   finding, reading, seeing and judging holograms
bench       real benches: captures, rigs, diagnosis, calibration, experiments
viewer      the document that one edits, its images, the window and the page
evidence    the paper's figures made again, timings, cases with known answers
commands    the command line
"""

from __future__ import annotations

from importlib import import_module

from holoview.util.former_names import install_former_names

TYPE_CHECKING = False  # type checkers know the name; importing `typing` would take as long as all else here
if TYPE_CHECKING:
    from holoview.holograms.fields.exchange import push
    from holoview.holograms.hologram import Hologram, load_hologram
    from holoview.holograms.load_field import load_field
    from holoview.holograms.optimise.learned_mask import learn_mask
    from holoview.holograms.optimise.settings import Settings
    from holoview.holograms.optimise.solve import iterate
    from holoview.holograms.targets.framing import Framing
    from holoview.holograms.targets.target import Placement, target_for
    from holoview.holograms.view import View, as_field, field_at, point_light, random_drive, save, sections, simulate
    from holoview.light.model.bench_parts import Modulator, Relay, Sampling, Source
    from holoview.light.model.eye import Eye, Prescription, chromatic_refraction, natural_pupil_diameter
    from holoview.light.model.plan import Plan, make_plan
    from holoview.light.model.preset import load
    from holoview.light.model.stops import SquareStop
    from holoview.light.model.system import System
    from holoview.light.observers import load_observer
    from holoview.util.errors import UserError
    from holoview.util.packages import __version__
    from holoview.viewer.app.notebook import show
    from holoview.viewer.page.page import export_html

install_former_names()

_MODULES = {
    "Eye": "holoview.light.model.eye",
    "Framing": "holoview.holograms.targets.framing",
    "Hologram": "holoview.holograms.hologram",
    "Modulator": "holoview.light.model.bench_parts",
    "Placement": "holoview.holograms.targets.target",
    "Plan": "holoview.light.model.plan",
    "Prescription": "holoview.light.model.eye",
    "Relay": "holoview.light.model.bench_parts",
    "Sampling": "holoview.light.model.bench_parts",
    "Settings": "holoview.holograms.optimise.settings",
    "Source": "holoview.light.model.bench_parts",
    "SquareStop": "holoview.light.model.stops",
    "System": "holoview.light.model.system",
    "UserError": "holoview.util.errors",
    "View": "holoview.holograms.view",
    "__version__": "holoview.util.packages",
    "as_field": "holoview.holograms.view",
    "chromatic_refraction": "holoview.light.model.eye",
    "export_html": "holoview.viewer.page.page",
    "field_at": "holoview.holograms.view",
    "iterate": "holoview.holograms.optimise.solve",
    "learn_mask": "holoview.holograms.optimise.learned_mask",
    "load": "holoview.light.model.preset",
    "load_field": "holoview.holograms.load_field",
    "load_hologram": "holoview.holograms.hologram",
    "load_observer": "holoview.light.observers",
    "make_plan": "holoview.light.model.plan",
    "natural_pupil_diameter": "holoview.light.model.eye",
    "point_light": "holoview.holograms.view",
    "push": "holoview.holograms.fields.exchange",
    "random_drive": "holoview.holograms.view",
    "save": "holoview.holograms.view",
    "sections": "holoview.holograms.view",
    "show": "holoview.viewer.app.notebook",
    "simulate": "holoview.holograms.view",
    "target_for": "holoview.holograms.targets.target",
}

__all__ = [
    "Eye",
    "Framing",
    "Hologram",
    "Modulator",
    "Placement",
    "Plan",
    "Prescription",
    "Relay",
    "Sampling",
    "Settings",
    "Source",
    "SquareStop",
    "System",
    "UserError",
    "View",
    "__version__",
    "as_field",
    "chromatic_refraction",
    "export_html",
    "field_at",
    "iterate",
    "learn_mask",
    "load",
    "load_field",
    "load_hologram",
    "load_observer",
    "make_plan",
    "natural_pupil_diameter",
    "point_light",
    "push",
    "random_drive",
    "save",
    "sections",
    "show",
    "simulate",
    "target_for",
]


def __getattr__(name: str) -> object:
    """Imports a public name when it is first used: the command line's help needs no numpy, a bench needs no torch."""
    if name not in _MODULES:
        raise AttributeError(f"module 'holoview' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_MODULES[name]), name)
    return value


def __dir__() -> list[str]:
    """The public names, for completion."""
    return sorted({*globals(), *__all__})
