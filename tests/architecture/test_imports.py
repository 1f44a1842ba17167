"""Import rules that import-linter's contracts (pyproject.toml) can't say: what an import loads, what comes late."""

from __future__ import annotations

import ast
import graphlib
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import holoview
from tests.patience import PATIENCE_S

PACKAGE = Path(holoview.__file__).resolve().parent
CONFIGURATION = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))
DESCRIPTION = (
    *(f"util.{name}" for name in ("errors", "files", "tables", "units")),
    "numerics.sampling",
    *(f"model.{name}" for name in ("bench_parts", "fields", "plan", "preset", "scheme", "shorthand", "system")),
    *(f"model.effects.{name}" for name in ("effect", "registry")),
)
"""What describes a bench: importing it loads neither torch nor WebGPU."""
GUIS = {"imgui_bundle", "rendercanvas", "glfw"}
ENGINES = {"torch", "wgpu", *GUIS}
SLOW_LIBRARIES = {"torch", "scipy", "colour", "matplotlib", "h5py", "rich"}

SLOW = "starting: it takes a second to import, and what needs none of it shouldn't wait"
OPTIONAL = "an optional library: the rest works without it"
CHOICE = "importing a rendercanvas backend chooses the window system, and may need what isn't installed"
BACKEND = "importing it loads wgpu's backend, which is for `holoview.gpu.adapter` to do"
FIRST = "before it, Ctrl-C is made to leave without a traceback"
LATE: dict[tuple[str, str], str] = {
    ("holoview.optimise.forward_model", "holoview.optimise.compiled_model"): OPTIONAL,
    ("holoview.optimise.kernels", "holoview.optimise.compiled_model"): OPTIONAL,
    ("holoview.colour", "colour"): SLOW,
    ("holoview.engine.backend", "holoview.engine.torch_executor"): SLOW,
    ("holoview.engine.light_share", "holoview.engine.light_behind"): SLOW,
    ("holoview.engine.backend", "holoview.engine.wgpu_executor"): OPTIONAL,
    ("holoview.engine.backend", "holoview.gpu.device"): OPTIONAL,
    ("holoview.optics.frame_inputs", "holoview.optics.bench"): SLOW,
    ("holoview.optics.frame_inputs", "holoview.optics.torch_effects"): SLOW,
    ("holoview.__main__", "holoview.cli"): FIRST,
    ("holoview.__main__", "logging"): FIRST,
    ("holoview.__main__", "warnings"): FIRST,
    ("holoview.commands.console", "rich.console"): SLOW,
    ("holoview.commands.console", "rich.progress"): SLOW,
    ("holoview.render.page_images", "torch"): SLOW,
    ("holoview.view", "holoview.engine.point_light"): SLOW,
    ("holoview.view", "holoview.engine.torch_executor"): SLOW,
    ("holoview.io.load_field", "holoview.wavefield.demodulation"): SLOW,
    ("holoview.render.page_images", "holoview.wavefield.demodulation"): SLOW,
    ("holoview.commands.render", "holoview.wavefield.demodulation"): SLOW,
    ("holoview.commands.effects", "holoview.captures.effect_trial"): SLOW,
    ("holoview.io.load_field", "holoview.wavefield.focus"): SLOW,
    ("holoview.io.load_field", "holoview.wavefield.imaging"): SLOW,
    ("holoview.io.load_field", "holoview.wavefield.synthetic_aperture"): SLOW,
    ("holoview.io.hologram", "holoview.wavefield.field_target"): SLOW,
    ("holoview.document.target_builder", "holoview.optimise.field_loss"): SLOW,
    ("holoview.io.hologram", "holoview.wavefield.imaging"): SLOW,
    ("holoview.render.page_images", "holoview.engine.torch_executor"): SLOW,
    ("holoview.render.page_images", "holoview.optics.frame_inputs"): SLOW,
    ("holoview.render.page_images", "holoview.optics.slm"): SLOW,
    ("holoview.render.point_probe", "holoview.engine.point_light"): SLOW,
    ("holoview.document.measurements", "holoview.metrics.perceptual"): SLOW,
    ("holoview.document.measurements", "scipy"): SLOW,
    ("holoview.document.optimisation_job", "holoview.optimise.solve"): SLOW,
    ("holoview.document.optimisation_job", "holoview.optimise.parallel"): SLOW,
    ("holoview.metrics.speckle", "scipy.special"): SLOW,
    ("holoview.wavefield.focus", "scipy.signal"): SLOW,
    ("holoview.wavefield.focused_objects", "scipy.signal"): SLOW,
    ("holoview.wavefield.readers.matlab5", "scipy.io"): SLOW,
    ("holoview.targets.defocus", "scipy"): SLOW,
    ("holoview.gpu.recorder", "wgpu.backends.wgpu_native"): BACKEND,
    ("holoview.effects.calibrated", "holoview.model.effects.learned_maps"): SLOW,
    ("holoview.effects.source_field", "holoview.optics.free_space"): SLOW,
    ("holoview.effects.source_field", "torch"): SLOW,
    ("holoview.study.report", "pyarrow"): OPTIONAL,
    ("holoview.commands.diagnose", "holoview.diagnose.report.display_gain"): SLOW,
    ("holoview.commands.diagnose", "holoview.diagnose.report.html_report"): SLOW,
    ("holoview.benchmark.report_run", "holoview.benchmark.optimiser_iteration"): OPTIONAL,
    ("holoview.benchmark.report_run", "holoview.benchmark.time_to_quality"): OPTIONAL,
    ("holoview.commands.bench", "holoview.benchmark.time_to_quality"): OPTIONAL,
    ("holoview.commands.bench_report", "holoview.app.script"): OPTIONAL,
    ("holoview.commands.view", "holoview.app.launch"): OPTIONAL,
    ("holoview.app.script", "rendercanvas.offscreen"): CHOICE,
    ("holoview.commands.view", "holoview.app.startup"): OPTIONAL,
    ("holoview.commands.view", "holoview.gpu.device"): OPTIONAL,
    ("holoview.app.launch", "holoview.app.no_adapter"): SLOW,
    ("holoview.app.launch", "holoview.app.run"): SLOW,
    ("holoview.app.context", "holoview.experiment.rig_session"): SLOW,
    ("holoview.app.panels.rig", "holoview.app.rig_controls"): SLOW,
    ("holoview.commands.view", "holoview.experiment.rig_bench"): SLOW,
    ("holoview.app.run", "glfw"): CHOICE,
    ("holoview.app.run", "rendercanvas.glfw"): CHOICE,
    ("holoview.app.run", "holoview.app.served_canvas"): CHOICE,
    ("holoview.app.run", "rendercanvas.offscreen"): CHOICE,
    ("holoview.app.notebook", "rendercanvas.anywidget"): CHOICE,
    ("holoview.app.serve", "rendercanvas.http"): CHOICE,
}
"""Every import inside a function, with its reason; all others stand at the top of their files."""


def _modules() -> dict[str, Path]:
    """Every module of the package by its dotted name."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = ("holoview", *path.relative_to(PACKAGE).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = _modules()


@cache
def _tree(module: str) -> ast.Module:
    return ast.parse(MODULES[module].read_text(encoding="utf-8"))


def _is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")


def _import_nodes(
    body: list[ast.stmt], everywhere: bool, in_function: bool = False
) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
    """Imports that run when the module is imported, or all of them; and whether each stands in a function."""
    for node in body:
        is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node, in_function
        elif not everywhere and (is_function or _is_type_checking(node)):
            continue
        else:
            for field in ("body", "orelse", "finalbody"):
                yield from _import_nodes(getattr(node, field, []), everywhere, in_function or is_function)
            for handler in getattr(node, "handlers", []):
                yield from _import_nodes(handler.body, everywhere, in_function or is_function)


def _names(node: ast.Import | ast.ImportFrom) -> set[str]:
    """Dotted names that are imported; `from a import b` counts as a.b where that is a module, else as a."""
    if isinstance(node, ast.Import):
        return {alias.name for alias in node.names}
    return {full if (full := f"{node.module}.{alias.name}") in MODULES else str(node.module) for alias in node.names}


def _imported(module: str, *, everywhere: bool = False) -> set[str]:
    """What a module imports when it is imported itself, or anywhere in its text."""
    nodes = _import_nodes(_tree(module).body, everywhere)
    return {name for node, _ in nodes for name in _names(node)}


def _with_parents(module: str) -> set[str]:
    parts = module.split(".")
    return {".".join(parts[: i + 1]) for i in range(len(parts))}


@cache
def _reached(module: str) -> frozenset[str]:
    """Everything that importing a module imports, through modules of the package and their parents."""
    done: set[str] = set()
    waiting = _with_parents(module)
    while waiting:
        name = waiting.pop()
        done.add(name)
        if name in MODULES:
            for imported in _imported(name):
                waiting |= _with_parents(imported) - done
    return frozenset(done)


def _under(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


def test_the_parser_sees_the_imports_that_are_there() -> None:
    assert {"torch", "holoview.model.plan", "holoview.model.passband"} <= _imported("holoview.optics.bench")
    assert "holoview.optics.propagate" in _reached("holoview.engine.torch_executor")
    assert "torch" in _reached("holoview.engine.torch_executor")
    assert "holoview.gpu.device" in _imported("holoview.engine.backend", everywhere=True)
    assert "holoview.gpu.device" not in _imported("holoview.engine.backend")


@pytest.mark.parametrize("module", DESCRIPTION)
def test_the_description_of_a_bench_reaches_no_engine_and_no_window(module: str) -> None:
    assert f"holoview.{module}" in MODULES
    reached = {name.partition(".")[0] for name in _reached(f"holoview.{module}")}
    assert not reached & ENGINES


def test_the_viewer_starts_without_the_libraries_that_take_long_to_import() -> None:
    roots = [f"holoview.{name}" for name in ("commands.view", "app.startup", "app.launch", "app.run")]
    reached = {name.partition(".")[0] for root in roots for name in _reached(root)}
    assert {"numpy", "wgpu", "imgui_bundle"} <= reached
    assert not reached & SLOW_LIBRARIES


def test_of_the_app_only_what_draws_windows_knows_webgpu() -> None:
    drawing = {f"holoview.app.{name}" for name in ("window", "viewport")}
    users = {m for m in MODULES if any(_under(name, "wgpu") for name in _imported(m, everywhere=True))}
    assert {m for m in users if _under(m, "holoview.app")} == drawing


def test_no_module_is_part_of_an_import_circle() -> None:
    """All imports count, those in functions and for annotations too; the exceptions are those of import-linter."""
    contracts = {contract["type"]: contract for contract in CONFIGURATION["tool"]["importlinter"]["contracts"]}
    allowed = {tuple(text.split(" -> ")) for text in contracts["acyclic_siblings"]["ignore_imports"]}
    graph = {
        module: {name for name in _imported(module, everywhere=True) & MODULES.keys() if (module, name) not in allowed}
        for module in MODULES
    }
    assert sum(map(len, graph.values())) > 1000
    tuple(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError, with the circle


def test_imports_stand_at_the_top_but_for_those_that_are_listed_with_a_reason() -> None:
    late = {
        (module, name)
        for module in MODULES
        for node, in_function in _import_nodes(_tree(module).body, everywhere=True)
        if in_function
        for name in _names(node)
    }
    assert late == LATE.keys()


def test_imports_are_absolute() -> None:
    for module in MODULES:
        nodes = _import_nodes(_tree(module).body, everywhere=True)
        assert all(node.level == 0 for node, _ in nodes if isinstance(node, ast.ImportFrom)), module


@pytest.mark.parametrize(
    "program",
    [
        "import holoview",
        "from holoview.model.effects.registry import listed_effects; assert listed_effects()",
        "from holoview import load; load('holochrome-8')",
        "from holoview import make_plan, System",
    ],
)
def test_describing_a_bench_loads_neither_torch_nor_webgpu_nor_a_gui(program: str) -> None:
    check = f"import sys; {program}; loaded = {sorted(ENGINES)!r} & sys.modules.keys(); assert not loaded, loaded"
    check = check.replace(f"{sorted(ENGINES)!r} &", f"set({sorted(ENGINES)!r}) &")
    subprocess.run([sys.executable, "-c", check], check=True, timeout=PATIENCE_S)
