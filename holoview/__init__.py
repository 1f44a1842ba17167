"""holoview simulates and optimises holograms for polychromatic displays with one or two phase modulators.

>>> import holoview as hv
>>> system = hv.load("holochrome-8").with_(shape=[48, 64])
>>> drive = hv.random_drive(system, seed=0)
>>> view = hv.simulate(system, drive, planes=["10 mm"])
>>> view.srgb8[0].shape  # what an eye sees, (y, x, 3)
(96, 128, 3)

All numbers are in SI units (metres, radians); text such as "10 mm" is accepted wherever a length or an angle of a
display is. Drives have the axes (frame, modulator, y, x), intensities (plane, wavelength, y, x). A user's mistake
raises `UserError`. The packages, from the lowest layer to the highest:

util        errors, units, atomic files, safetensors
numerics    FFT lengths, Zernike polynomials, resampling, least squares
colour      cone fundamentals, CIE XYZ, sRGB, white balance
gpu         WebGPU: adapters, devices, WGSL linking, FFTs in shaders
model       the display as data: `System`, presets, colour schemes, `Plan`; the framework of effects
optics      source, modulator, propagation and pupil as torch functions; effects applied to light
targets     pictures with depth as focal stacks with natural defocus
wavefield   complex fields without a modulator: files of other programs, recordings of cameras
effects     imperfections of real displays: physical causes
engine      the graph of stages of a frame, evaluated by torch and by shaders; incremental rendering
io          files of holograms, pictures and modulator patterns
view        `simulate`: what an observer sees of a hologram
metrics     PSNR, colour difference, speckle contrast, eyebox uniformity
optimise    patterns, laser amplitudes and wavelengths for a focal stack
captures    measured data, virtual measurements, and the expected camera images
page        a hologram as a web page
diagnose    which imperfections explain captures, with intervals
calibrate   maps and tables learned from captures
benchmark   timings
figures     contact sheets
rig         hardware: devices, their registration, measuring
render      images of a document, kept up to date
document    the document that a viewer edits: undo, background jobs, files
study       the figures of the HoloChrome paper as jobs
experiment  the next capture, camera in the loop, a rig beside a document
app         the viewer; `show` in a notebook
commands    the subcommands of the command line, which `cli` parses
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # type checkers know the name; importing `typing` would take as long as all else here
if TYPE_CHECKING:
    from holoview.holograms.fields.exchange import push
    from holoview.holograms.hologram import Hologram, load_hologram
    from holoview.holograms.load_field import load_field
    from holoview.holograms.optimise.settings import Settings
    from holoview.holograms.optimise.solve import iterate
    from holoview.holograms.targets.target import Placement, target_for
    from holoview.holograms.view import View, as_field, field_at, point_light, random_drive, sections, simulate
    from holoview.light.model.bench_parts import Modulator, Relay, Sampling, Source
    from holoview.light.model.eye import Eye, Prescription, chromatic_refraction, natural_pupil_diameter
    from holoview.light.model.plan import Plan, make_plan
    from holoview.light.model.preset import load
    from holoview.light.model.stops import SquareStop
    from holoview.light.model.system import System
    from holoview.util.errors import UserError
    from holoview.util.packages import __version__
    from holoview.viewer.app.notebook import show
    from holoview.viewer.page.page import export_html

_MODULES = {
    "Eye": "holoview.light.model.eye",
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
    "load": "holoview.light.model.preset",
    "load_field": "holoview.holograms.load_field",
    "load_hologram": "holoview.holograms.hologram",
    "make_plan": "holoview.light.model.plan",
    "natural_pupil_diameter": "holoview.light.model.eye",
    "point_light": "holoview.holograms.view",
    "push": "holoview.holograms.fields.exchange",
    "random_drive": "holoview.holograms.view",
    "sections": "holoview.holograms.view",
    "show": "holoview.viewer.app.notebook",
    "simulate": "holoview.holograms.view",
    "target_for": "holoview.holograms.targets.target",
}

__all__ = [
    "Eye",
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
    "load",
    "load_field",
    "load_hologram",
    "make_plan",
    "natural_pupil_diameter",
    "point_light",
    "push",
    "random_drive",
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
