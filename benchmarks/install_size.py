"""Measures what each library that holoview requires costs: disk space and time to import.

Run it with the Python of the environment that is to be measured; it needs nothing but the standard library:

    ENVIRONMENT/bin/python benchmarks/install_size.py

A library's own size is the disk space of the files that its record lists, byte code included. "Brings" is the space of
the libraries that nothing else in the environment needs, neither holoview nor one of its other libraries. The import
time is the median of five new processes, less that of an empty one, with the files in the system's cache.
"""

from __future__ import annotations

import argparse
import re
import statistics
import subprocess
import sys
import time
from importlib.metadata import Distribution, distribution, distributions

_MB = 1e6
MODULES = {
    "colour-science": "colour",
    "cvvdp": "pycvvdp",
    "flip-evaluator": "flip_evaluator",
    "openexr": "OpenEXR",
    "pillow": "PIL.Image",
    "pyarrow": "pyarrow.parquet",
}
"""Modules to import that aren't called as their libraries are."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def canonical(name: str) -> str:
    """The name of a distribution in the form that is compared: lower case, with hyphens."""
    return re.sub(r"[-_.]+", "-", name).lower()


def disk_bytes(found: Distribution) -> int:
    """Disk space of a distribution's files."""
    paths = {path.resolve() for file in found.files or () if (path := found.locate_file(file)).is_file()}
    return sum(512 * path.stat().st_blocks for path in paths)


def requirements(name: str, installed: dict[str, Distribution], optional: bool = False) -> set[str]:
    """The installed distributions that one requires; optional: also those of its extras."""
    texts = installed[name].requires or ()
    names = {canonical(_NAME.match(text)[0]) for text in texts if optional or "extra ==" not in text}
    return names & installed.keys()


def reachable(roots: set[str], installed: dict[str, Distribution], without: str = "") -> set[str]:
    """The distributions that the roots need, themselves included, but for what only `without` needs."""
    found: set[str] = set()
    waiting = roots - {without}
    while waiting:
        name = waiting.pop()
        found.add(name)
        waiting |= requirements(name, installed) - found - {without}
    return found


def import_seconds(statement: str) -> float:
    """Median time of five processes that run a statement."""
    times = []
    for _ in range(5):
        started = time.perf_counter()
        subprocess.run([sys.executable, "-W", "ignore", "-c", statement], check=True)
        times.append(time.perf_counter() - started)
    return statistics.median(times)


def main() -> None:
    """Prints a row for each direct requirement, the largest first, and the sums."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--no-times", action="store_true", help="leave out the times of imports")
    has_times = not parser.parse_args().no_times
    installed = {canonical(found.metadata["Name"]): found for found in distributions()}
    sizes = {name: disk_bytes(found) for name, found in installed.items()}
    plain = reachable({"holoview"}, installed)
    extras = requirements("holoview", installed, optional=True) - plain
    direct = requirements("holoview", installed) | extras
    roots = direct | {"holoview"}
    empty = import_seconds("pass") if has_times else 0.0
    print(f"{'library':<18}{'version':<12}{'MB':>6}{'brings':>8}  {'import':>7}  what it brings")
    rows = []
    for name in direct:
        brought = reachable({name}, installed) - reachable(roots, installed, without=name) - {name}
        rows.append((sizes[name] + sum(sizes[other] for other in brought), name, sorted(brought)))
    for total, name, brought in sorted(rows, reverse=True):
        module = MODULES.get(name, name.replace("-", "_"))
        seconds = f"{import_seconds(f'import {module}') - empty:6.2f} s" if has_times else " " * 8
        own, extra = sizes[name] / _MB, (total - sizes[name]) / _MB
        note = "(an extra)" if name in extras else ""
        version = distribution(name).version
        print(f"{name:<18}{version:<12}{own:6.1f}{extra:8.1f}  {seconds}  {' '.join([*brought, note])}".rstrip())
    others = sum(sizes.values()) - sum(sizes[name] for name in reachable(roots, installed))
    print(f"holoview itself {sizes['holoview'] / _MB:.1f} MB; all that a plain install needs", end=" ")
    print(f"{sum(sizes[name] for name in plain) / _MB:.0f} MB; pip and the like {others / _MB:.0f} MB")


if __name__ == "__main__":
    main()
