"""Who may import whom: the description knows no engine, the GPU layer knows no optics, only the app knows a GUI."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import holoview

PACKAGE = Path(holoview.__file__).resolve().parent
DESCRIPTION = ("errors", "files", "grid", "plan", "preset", "schema", "shorthand", "system", "units")
GUIS = {"imgui_bundle", "rendercanvas", "glfw"}
ENGINES = {"torch", "wgpu", *GUIS}
GPU_MAY_KNOW = ("holoview.util.errors", "holoview.util.files", "holoview.numerics.fft_grid", "holoview.gpu")


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


def _import_nodes(body: list[ast.stmt], everywhere: bool) -> Iterator[ast.Import | ast.ImportFrom]:
    """Imports that run when the module is imported, or all of them, those in functions included."""
    for node in body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif not everywhere and (isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) or _is_type_checking(node)):
            continue
        else:
            for field in ("body", "orelse", "finalbody"):
                yield from _import_nodes(getattr(node, field, []), everywhere)
            for handler in getattr(node, "handlers", []):
                yield from _import_nodes(handler.body, everywhere)


def _imported(module: str, *, everywhere: bool = False) -> set[str]:
    """Dotted names that a module imports; `from a import b` counts as a.b where that is a module, else as a."""
    names: set[str] = set()
    for node in _import_nodes(_tree(module).body, everywhere):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        else:
            names |= {
                full if (full := f"{node.module}.{alias.name}") in MODULES else str(node.module) for alias in node.names
            }
    return names


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
    assert {"torch", "holoview.plan", "holoview.util.errors"} <= _imported("holoview.optics.frame_inputs")
    assert "holoview.optics.pupil" in _reached("holoview.engine.torch_executor")
    assert "torch" in _reached("holoview.engine.torch_executor")
    assert "holoview.gpu.device" in _imported("holoview.engine.backend", everywhere=True)
    assert "holoview.gpu.device" not in _imported("holoview.engine.backend")


@pytest.mark.parametrize("module", DESCRIPTION)
def test_the_description_of_a_bench_reaches_no_engine_and_no_window(module: str) -> None:
    reached = {name.partition(".")[0] for name in _reached(f"holoview.{module}")}
    assert not reached & ENGINES
    direct = {name.partition(".")[0] for name in _imported(f"holoview.{module}", everywhere=True)}
    assert not direct & ENGINES


def test_only_the_gpu_layer_and_what_draws_windows_know_webgpu() -> None:
    users = {m for m in MODULES if any(_under(name, "wgpu") for name in _imported(m, everywhere=True))}
    drawing = {f"holoview.app.{name}" for name in ("window", "viewport", "textures")}
    assert drawing < users
    assert all(_under(module, "holoview.gpu") for module in users - drawing), sorted(users)


@pytest.mark.parametrize("module", [m for m in MODULES if _under(m, "holoview.gpu")])
def test_the_gpu_layer_knows_no_optics(module: str) -> None:
    ours = {name for name in _imported(module, everywhere=True) if _under(name, "holoview")}
    assert not {name for name in ours if not any(_under(name, allowed) for allowed in GPU_MAY_KNOW)}


@pytest.mark.parametrize("toolkit", ["imgui_bundle", "rendercanvas", "glfw"])
def test_only_the_app_knows_a_gui(toolkit: str) -> None:
    users = {m for m in MODULES if any(_under(name, toolkit) for name in _imported(m, everywhere=True))}
    assert users
    assert all(_under(module, "holoview.app") for module in users), sorted(users)


@pytest.mark.parametrize("module", [m for m in MODULES if _under(m, "holoview.app.panels")])
def test_panels_hold_no_physics(module: str) -> None:
    physics = ("torch", "wgpu", "scipy", "holoview.optics", "holoview.engine", "holoview.gpu", "holoview.plan")
    names = _imported(module, everywhere=True)
    assert not {name for name in names if any(_under(name, part) for part in physics)}


@pytest.mark.parametrize("module", [m for m in MODULES if _under(m, "holoview.session")])
def test_a_session_knows_no_window(module: str) -> None:
    names = _imported(module, everywhere=True)
    assert not {name for name in names if any(_under(name, upper) for upper in ("holoview.app", *sorted(GUIS)))}


def test_nothing_below_the_app_and_the_command_line_imports_the_app() -> None:
    outside = [m for m in MODULES if not _under(m, "holoview.app")]
    assert not {m for m in outside if any(_under(name, "holoview.app") for name in _imported(m))}


@pytest.mark.parametrize("layer", ["optics", "effects", "captures", "engine", "optimise"])
def test_physics_does_not_look_up_to_what_uses_it(layer: str) -> None:
    above = ("holoview.view", "holoview.cli", "holoview.commands", "holoview.app")
    for module in (m for m in MODULES if _under(m, f"holoview.{layer}")):
        names = _imported(module, everywhere=True)
        assert not {name for name in names if any(_under(name, upper) for upper in above)}


def test_effects_know_neither_what_computes_them_nor_what_looks_for_them() -> None:
    users = ("engine", "gpu", "optimise", "captures", "diagnose")
    for module in (m for m in MODULES if _under(m, "holoview.effects")):
        names = _imported(module, everywhere=True)
        assert not {name for name in names if any(_under(name, f"holoview.{user}") for user in users)}, module


def test_imports_are_absolute() -> None:
    for module in MODULES:
        nodes = _import_nodes(_tree(module).body, everywhere=True)
        assert all(node.level == 0 for node in nodes if isinstance(node, ast.ImportFrom)), module


@pytest.mark.parametrize(
    "program",
    ["import holoview", "from holoview import load; load('holochrome-8')", "from holoview import make_plan, System"],
)
def test_describing_a_bench_loads_neither_torch_nor_webgpu_nor_a_gui(program: str) -> None:
    check = f"import sys; {program}; loaded = {sorted(ENGINES)!r} & sys.modules.keys(); assert not loaded, loaded"
    check = check.replace(f"{sorted(ENGINES)!r} &", f"set({sorted(ENGINES)!r}) &")
    subprocess.run([sys.executable, "-c", check], check=True, timeout=60)
