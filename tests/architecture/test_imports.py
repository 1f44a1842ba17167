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

from tests.architecture.source_trees import PACKAGE, source_trees
from tests.patience import PATIENCE_S

CONFIGURATION = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))
DESCRIPTION = (
    *(f"util.{name}" for name in ("errors", "files", "tables", "units")),
    "light.numerics.sampling",
    *(
        f"light.model.{name}"
        for name in (
            "bench_parts",
            "chain",
            "drives",
            "elements",
            "fields",
            "masks",
            "plan",
            "preset",
            "scheme",
            "shorthand",
            "system",
        )
    ),
    *(f"light.model.effects.{name}" for name in ("effect", "registry")),
)
"""What describes a bench: importing it loads neither torch nor WebGPU."""
GUIS = {"imgui_bundle", "rendercanvas", "glfw"}
ENGINES = {"torch", "wgpu", *GUIS}
SLOW_LIBRARIES = {"torch", "scipy", "colour", "matplotlib", "h5py", "jinja2", "rich"}

SLOW = "starting: it takes a second to import, and what needs none of it shouldn't wait"
OPTIONAL = "an optional library: the rest works without it"
CHOICE = "importing a rendercanvas backend chooses the window system, and may need what isn't installed"
BACKEND = "importing it loads wgpu's backend, which is for `holoview.light.gpu.adapter` to do"
FIRST = "before it, Ctrl-C is made to leave without a traceback"
LATE: dict[tuple[str, str], str] = {
    ("holoview.holograms.optimise.forward_model", "holoview.holograms.optimise.compiled_model"): OPTIONAL,
    ("holoview.holograms.optimise.kernel_choice", "holoview.holograms.optimise.compiled_model"): OPTIONAL,
    ("holoview.light.colour", "colour"): SLOW,
    ("holoview.light.engine.backend", "holoview.light.engine.torch_executor"): SLOW,
    ("holoview.light.engine.light_share", "holoview.light.engine.light_behind"): SLOW,
    ("holoview.light.engine.backend", "holoview.light.engine.wgpu_executor"): OPTIONAL,
    ("holoview.light.engine.backend", "holoview.light.gpu.device"): OPTIONAL,
    ("holoview.light.optics.frame_inputs", "holoview.light.optics.bench"): SLOW,
    ("holoview.light.optics.frame_inputs", "holoview.light.optics.chain"): SLOW,
    ("holoview.light.optics.frame_inputs", "holoview.light.optics.torch_effects"): SLOW,
    ("holoview.__main__", "holoview.commands.supervisor"): FIRST,
    ("holoview.__main__", "logging"): FIRST,
    ("holoview.__main__", "warnings"): FIRST,
    ("holoview.commands.supervisor", "holoview.commands.cli"): SLOW,
    ("holoview.commands.console", "rich.console"): SLOW,
    ("holoview.commands.console", "rich.progress"): SLOW,
    ("holoview.viewer.page.page", "jinja2"): SLOW,
    ("holoview.viewer.render.page_images", "torch"): SLOW,
    ("holoview.holograms.view", "holoview.holograms.files.light_writer"): OPTIONAL,
    ("holoview.holograms.view", "holoview.light.engine.point_light"): SLOW,
    ("holoview.holograms.view", "holoview.light.engine.torch_executor"): SLOW,
    ("holoview.holograms.load_field", "holoview.holograms.fields.demodulation"): SLOW,
    ("holoview.viewer.render.page_images", "holoview.holograms.fields.demodulation"): SLOW,
    ("holoview.commands.render", "holoview.holograms.fields.demodulation"): SLOW,
    ("holoview.commands.render", "holoview.light.engine.light_budget"): SLOW,
    ("holoview.commands.effects", "holoview.bench.captures.effect_trial"): SLOW,
    ("holoview.commands.optimise", "holoview.bench.experiment.camera_loop"): SLOW,
    ("holoview.commands.optimise", "holoview.bench.experiment.camera_problem"): SLOW,
    ("holoview.commands.optimise", "holoview.bench.experiment.rig_bench"): SLOW,
    ("holoview.commands.optimise", "holoview.bench.rig"): SLOW,
    ("holoview.holograms.load_field", "holoview.holograms.fields.focus"): SLOW,
    ("holoview.holograms.load_field", "holoview.holograms.fields.imaging"): SLOW,
    ("holoview.holograms.load_field", "holoview.holograms.fields.synthetic_aperture"): SLOW,
    ("holoview.holograms.hologram", "holoview.holograms.fields.field_target"): SLOW,
    ("holoview.viewer.document.target_builder", "holoview.holograms.optimise.field_loss"): SLOW,
    ("holoview.holograms.hologram", "holoview.holograms.fields.imaging"): SLOW,
    ("holoview.viewer.render.page_images", "holoview.light.engine.torch_executor"): SLOW,
    ("holoview.viewer.render.page_images", "holoview.light.optics.frame_inputs"): SLOW,
    ("holoview.viewer.render.page_images", "holoview.light.optics.slm"): SLOW,
    ("holoview.viewer.render.point_probe", "holoview.light.engine.point_light"): SLOW,
    ("holoview.viewer.document.measurements", "holoview.holograms.metrics.perceptual"): SLOW,
    ("holoview.viewer.document.measurements", "scipy"): SLOW,
    ("holoview.viewer.render.light_by_gap", "holoview.light.engine.light_behind"): SLOW,
    ("holoview.viewer.render.light_by_gap", "scipy.interpolate"): SLOW,
    ("holoview.viewer.document.measurements", "holoview.holograms.metrics.speckle_measurement"): SLOW,
    ("holoview.viewer.document.optimisation_job", "holoview.holograms.optimise.solve"): SLOW,
    ("holoview.viewer.document.optimisation_job", "holoview.holograms.optimise.parallel"): SLOW,
    ("holoview.holograms.optimise.objective", "scipy"): SLOW,
    ("holoview.holograms.optimise.wavelengths", "scipy"): SLOW,
    ("holoview.holograms.metrics.speckle", "scipy.special"): SLOW,
    ("holoview.holograms.fields.focus", "scipy.signal"): SLOW,
    ("holoview.holograms.fields.focused_objects", "scipy.signal"): SLOW,
    ("holoview.holograms.files.readers.matlab5", "scipy.io"): SLOW,
    ("holoview.holograms.targets.defocus", "scipy"): SLOW,
    ("holoview.light.gpu.recorder", "wgpu.backends.wgpu_native"): BACKEND,
    ("holoview.light.effects.calibrated", "holoview.light.model.effects.learned_maps"): SLOW,
    ("holoview.holograms.fields.source_field", "holoview.light.optics.free_space"): SLOW,
    ("holoview.holograms.fields.source_field", "torch"): SLOW,
    ("holoview.evidence.study.report", "pyarrow"): OPTIONAL,
    ("holoview.commands.diagnose", "holoview.bench.diagnose.report.display_gain"): SLOW,
    ("holoview.commands.diagnose", "holoview.bench.diagnose.report.html_report"): SLOW,
    ("holoview.evidence.benchmark.frame_benchmark", "holoview.holograms.optimise.chain_executor"): OPTIONAL,
    ("holoview.evidence.benchmark.report_run", "holoview.evidence.benchmark.optimiser_iteration"): OPTIONAL,
    ("holoview.evidence.benchmark.report_run", "holoview.evidence.benchmark.time_to_quality"): OPTIONAL,
    ("holoview.commands.bench", "holoview.evidence.benchmark.time_to_quality"): OPTIONAL,
    ("holoview.commands.bench_report", "holoview.viewer.app.script"): OPTIONAL,
    ("holoview.commands.view", "holoview.viewer.app.launch"): OPTIONAL,
    ("holoview.viewer.app.script", "rendercanvas.offscreen"): CHOICE,
    ("holoview.commands.view", "holoview.viewer.app.startup"): OPTIONAL,
    ("holoview.commands.view", "holoview.light.gpu.device"): OPTIONAL,
    ("holoview.viewer.app.launch", "holoview.viewer.app.no_adapter"): SLOW,
    ("holoview.viewer.app.launch", "holoview.viewer.app.run"): SLOW,
    ("holoview.viewer.app.launch", "holoview.viewer.document.file_loader"): SLOW,
    ("holoview.viewer.app.context", "holoview.viewer.document.rig_session"): SLOW,
    ("holoview.viewer.app.panels.rig", "holoview.viewer.app.rig_controls"): SLOW,
    ("holoview.commands.view", "holoview.bench.experiment.rig_bench"): SLOW,
    ("holoview.commands.view", "holoview.evidence.sweep.in_viewer"): SLOW,
    ("holoview.viewer.app.run", "glfw"): CHOICE,
    ("holoview.viewer.app.run", "rendercanvas.glfw"): CHOICE,
    ("holoview.viewer.app.run", "holoview.viewer.app.served_canvas"): CHOICE,
    ("holoview.viewer.app.run", "rendercanvas.offscreen"): CHOICE,
    ("holoview.viewer.app.notebook", "rendercanvas.anywidget"): CHOICE,
    ("holoview.viewer.app.serve", "rendercanvas.http"): CHOICE,
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


def _tree(module: str) -> ast.Module:
    return source_trees()[MODULES[module]]


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
    assert {"torch", "holoview.light.model.plan", "holoview.light.model.passband"} <= _imported(
        "holoview.light.optics.bench"
    )
    assert "holoview.light.optics.propagate" in _reached("holoview.light.engine.torch_executor")
    assert "torch" in _reached("holoview.light.engine.torch_executor")
    assert "holoview.light.gpu.device" in _imported("holoview.light.engine.backend", everywhere=True)
    assert "holoview.light.gpu.device" not in _imported("holoview.light.engine.backend")


@pytest.mark.parametrize("module", DESCRIPTION)
def test_the_description_of_a_bench_reaches_no_engine_and_no_window(module: str) -> None:
    assert f"holoview.{module}" in MODULES
    reached = {name.partition(".")[0] for name in _reached(f"holoview.{module}")}
    assert not reached & ENGINES


def test_the_viewer_starts_without_the_libraries_that_take_long_to_import() -> None:
    roots = ["holoview.commands.view", *(f"holoview.viewer.app.{name}" for name in ("startup", "launch", "run"))]
    reached = {name.partition(".")[0] for root in roots for name in _reached(root)}
    assert {"numpy", "wgpu", "imgui_bundle"} <= reached
    assert not reached & SLOW_LIBRARIES


def test_a_picture_is_rendered_by_shaders_without_the_libraries_that_take_long_to_import() -> None:
    roots = ["holoview.commands.render", "holoview.light.engine.wgpu_executor", "holoview.light.gpu.device"]
    reached = {name.partition(".")[0] for root in roots for name in _reached(root)}
    assert {"numpy", "wgpu", "PIL"} <= reached
    assert not reached & SLOW_LIBRARIES


def test_of_the_app_only_what_draws_windows_knows_webgpu() -> None:
    drawing = {f"holoview.viewer.app.{name}" for name in ("window", "viewport")}
    users = {m for m in MODULES if any(_under(name, "wgpu") for name in _imported(m, everywhere=True))}
    assert {m for m in users if _under(m, "holoview.viewer.app")} == drawing


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
        "from holoview.light.model.effects.registry import listed_effects; assert listed_effects()",
        "from holoview import load; load('holochrome-8')",
        "from holoview import make_plan, System",
    ],
)
def test_describing_a_bench_loads_neither_torch_nor_webgpu_nor_a_gui(program: str) -> None:
    check = f"import sys; {program}; loaded = {sorted(ENGINES)!r} & sys.modules.keys(); assert not loaded, loaded"
    check = check.replace(f"{sorted(ENGINES)!r} &", f"set({sorted(ENGINES)!r}) &")
    subprocess.run([sys.executable, "-c", check], check=True, timeout=PATIENCE_S)
