"""Names that packages had up to 1.0, which users' files may import: "holoview.model" is `holoview.light.model` now.

A former name gives the very module that has its new name, so that a class is the same class under both.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.machinery import ModuleSpec

TYPE_CHECKING = False  # as in holoview/__init__.py, which imports this
if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import ModuleType

_WINGS = {
    "light": ("numerics", "colour", "gpu", "model", "optics", "effects", "engine"),
    "holograms": ("targets", "optimise", "metrics", "view"),
    "bench": ("captures", "rig", "calibrate", "diagnose", "experiment"),
    "viewer": ("page", "render", "document", "app"),
    "evidence": ("study", "benchmark"),
    "util": ("figures",),
    "commands": ("cli",),
}
_MOVED = {
    "optimise.autograd_model": "holograms.optimise.forward_model",
    "optimise.graphed_step": "holograms.optimise.solve",
    "optimise.kernel_choice": "holograms.optimise.forward_model",
    "optimise.kernels": "holograms.optimise.propagation",
    "optimise.machine_code": "util.packages",
    "optimise.transfer_functions": "holograms.optimise.beams",
    "effects.source_field": "holograms.fields.source_field",
    "io": "holograms.files",
    "io.hologram": "holograms.hologram",
    "io.load_field": "holograms.load_field",
    "targets.colour_profile": "holograms.files.colour_profile",
    "targets.image_reader": "holograms.files.image_reader",
    "wavefield": "holograms.fields",
    "wavefield.conformance": "evidence.conformance.cases",
    "wavefield.conformance_score": "evidence.conformance.score",
    "wavefield.readers": "holograms.files.readers",
    "wavefield.request": "holograms.files.request",
    "experiment.live_view": "viewer.document.live_view",
    "experiment.rig_session": "viewer.document.rig_session",
}
FORMER = {f"{package}": f"{wing}.{package}" for wing, packages in _WINGS.items() for package in packages} | _MOVED
"""New names by former ones, both below `holoview`. What isn't listed itself is where the package that held it is."""


def present_name(name: str) -> str | None:
    """The name that a module or package with a former name has now; None for a name that isn't a former one."""
    root, _, rest = name.partition(".")
    parts = rest.split(".")
    for count in range(len(parts), 0, -1) if root == "holoview" else ():
        new = FORMER.get(".".join(parts[:count]))
        if new is not None:
            return ".".join((root, new, *parts[count:]))
    return None


class _FormerNames:
    """Finder and loader of modules by their former names. It is asked first: a package's folder holds its modules too.

    Both protocols without their base classes, whose import takes as long as that of `holoview`.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return None if present_name(fullname) is None else ModuleSpec(fullname, self)  # type: ignore[arg-type]

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        present = import_module(str(present_name(spec.name)))
        spec.loader_state = present.__spec__  # `importlib` puts this one in its place
        return present

    def exec_module(self, module: ModuleType) -> None:
        former = module.__spec__
        module.__spec__ = None if former is None else former.loader_state


def install_former_names() -> None:
    """From now on `import` knows the former names."""
    if not any(isinstance(finder, _FormerNames) for finder in sys.meta_path):
        sys.meta_path.insert(0, _FormerNames())
