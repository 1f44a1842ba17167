"""A dotted name of holoview that a docstring, a comment or the manual has in backticks is one that there is."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

from holoview.util.former_names import present_name

ROOT = Path(__file__).resolve().parents[2]
WINGS = sorted(path.stem for path in (ROOT / "holoview").iterdir() if not path.stem.startswith("_"))
PACKAGES = {path.parent.name for path in (ROOT / "holoview").glob("*/*/__init__.py")}
HEADS = {*WINGS, *PACKAGES, "holoview", "hv", "benchmarks", "tests", "docs"}
DOTTED = re.compile(r"`+([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)+)(?:\([^`]*\))?`+")
FILES = re.compile(r".*\.(csv|toml|py|js|json|html|png|h5|txt|md)")
ELSEWHERE = {"holoview.readers"}  # the group of entry points of readers
PAGES = [*sorted((ROOT / "docs").glob("*.md")), *(ROOT / name for name in ("README.md", "CONTRIBUTING.md"))]
SOURCES = [*sorted((ROOT / "holoview").rglob("*.py")), *sorted((ROOT / "benchmarks").glob("*"))]


def _names(path: Path) -> Iterator[str]:
    for name in DOTTED.findall(path.read_text(encoding="utf-8")):
        if name.partition(".")[0] in HEADS and name not in ELSEWHERE and not FILES.fullmatch(name):
            yield name


def _exists(name: str, path: Path) -> bool:
    """Whether a name is one of the package, of one of its wings, or of the folder that the file with it is in."""
    first, _, rest = name.partition(".")
    if first in ("holoview", "hv", "benchmarks", "tests", "docs"):
        return _resolves(f"holoview.{rest}" if first == "hv" else name)
    folder = ".".join(path.relative_to(ROOT).parent.parts)
    return any(_resolves(f"{place}.{name}") for place in (folder, "holoview", *(f"holoview.{wing}" for wing in WINGS)))


def _resolves(name: str) -> bool:
    parts = name.split(".")
    if present_name(name) is not None:
        return False
    for count in range(len(parts), 0, -1):
        try:
            found: object = import_module(".".join(parts[:count]))
        except ImportError:
            continue
        for part in parts[count:]:
            if part in getattr(found, "__annotations__", {}) and not isinstance(found, ModuleType):
                return True
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def test_every_dotted_name_in_backticks_is_one_that_there_is() -> None:
    paths = [path for path in (*SOURCES, *PAGES) if path.suffix in (".py", ".md")]
    named = [(name, path) for path in paths for name in _names(path)]
    assert len(named) > 100
    stale = [f"{path.relative_to(ROOT)}: {name}" for name, path in named if not _exists(name, path)]
    assert stale == []


def test_a_stale_name_is_told_from_one_that_is() -> None:
    names = ["util.threads", "hv.make_plan", "model.plan.Plan", "hv.make_plans", "processes.leave"]
    found = [_exists(name, ROOT / "holoview" / "util" / "processes.py") for name in names]
    assert found == [False, True, True, False, True]
