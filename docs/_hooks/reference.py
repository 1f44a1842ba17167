"""Pages of the reference that are made at build time: the command line, `hv.*`, and every module of the package.

Nothing here names a command, a public name or a module: what exists is found, so that nothing is forgotten when code
moves. The package is read, not imported; only the command line is asked for its help.
"""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

from docs._hooks.repository import ROOT, module_page

PACKAGE = ROOT / "holoview"
COMMAND_LINE = "reference/command-line.md"
PYTHON = "reference/python.md"
_COLUMNS = "100"
_LESS_SOUGHT = "---\nsearch:\n  boost: 0.5\n---\n\n"
"""Modules come after the manual where both hold the words that were sought."""
_LISTED = re.compile(r"^    ([a-z][\w-]*)(?: \([^)]*\))?(?:\s{2,}|$)", re.MULTILINE)


def command_line() -> str:
    """The page of the command line: the help of every command and of their commands."""
    intro = "Every command tells its options by `--help`; this page is what they say."
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        commands = _commands(_help())
        sections = list(pool.map(lambda name: "\n\n".join(_sections(name)), commands))
    return "\n\n".join(["# Command line", intro, *sections]) + "\n"


def _sections(*names: str) -> Iterator[str]:
    """The section of a command, and those of its own commands below."""
    text = _help(*names)
    usage, _, rest = text.partition("\n\n")
    description, _, options = rest.partition("\n\n")
    depth = "#" * (len(names) + 1)
    yield f"{depth} `holoview {' '.join(names)}`"
    yield re.sub(r"\s+", " ", description) if not description.startswith("options:") else ""
    shown = f"{usage}\n\n{options if not description.startswith('options:') else rest}".rstrip()
    yield f"```text\n{shown}\n```"
    for name in _commands(text):
        yield from _sections(*names, name)


def _commands(text: str) -> list[str]:
    """The commands that a help text lists."""
    _, _, listed = text.partition("\n  COMMAND\n")
    return _LISTED.findall(listed.partition("\n\n")[0])


@cache
def _help(*names: str) -> str:
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    told = subprocess.run(
        [sys.executable, "-m", "holoview", *names, "--help"],
        env={**os.environ, "COLUMNS": _COLUMNS, "PYTHONPATH": paths, "NO_COLOR": "1"},
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=True,
    )
    return told.stdout


def public_names() -> list[str]:
    """The names of `holoview.__all__`, as its source states them; special ones left out."""
    for node in ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return [name for name in ast.literal_eval(node.value) if not name.startswith("__")]
    raise ValueError("holoview/__init__.py states no __all__")


def python() -> str:
    """The page of `hv.*`: every public name."""
    intro = (
        "All that is public from Python, as `import holoview as hv` gives it. These names, their arguments and what "
        "they return stay as they are within a major version; modules behind them may move."
    )
    names = public_names()
    contents = ", ".join(f"[`{name}`][holoview.{name}]" for name in names) + "."
    return "\n\n".join(["# Python", intro, contents, *(f"::: holoview.{name}" for name in names)]) + "\n"


def modules() -> dict[str, str]:
    """The page of every module of the package, {page: Markdown}."""
    pages = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(ROOT)
        if path.name == "__main__.py":
            continue
        parts = place.with_suffix("").parts
        name = ".".join(parts[:-1] if path.name == "__init__.py" else parts)
        shown = f"      members: {_own_names(path)}\n" if path.name == "__init__.py" else ""
        options = f"    options:\n      show_root_heading: false\n      show_root_toc_entry: false\n{shown}"
        pages[module_page(place.as_posix())] = f"{_LESS_SOUGHT}# `{name}`\n\n::: {name}\n{options}"
    return pages


def _own_names(package: Path) -> list[str] | str:
    """What a package's own file defines; what it passes on from its modules is on their pages."""
    tree = ast.parse(package.read_text(encoding="utf-8"))
    names = [node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)]
    return [name for name in names if not name.startswith("_")] or "false"


def modules_nav(folder: Path = PACKAGE) -> list[Any]:
    """The navigation of the modules' pages: a package's own page first, then its modules, then its packages."""
    here = [module_page((folder / "__init__.py").relative_to(ROOT).as_posix())]
    files = [path for path in sorted(folder.glob("*.py")) if not path.name.startswith("__")]
    entries: list[Any] = [*here, *({path.stem: module_page(path.relative_to(ROOT).as_posix())} for path in files)]
    for inner in sorted(folder.iterdir()):
        if (inner / "__init__.py").is_file():
            entries.append({inner.name: modules_nav(inner)})
    return entries
