"""Prints how much of the light each padding gets wrong: the table in docs/physics-evidence.md.

    python -m benchmarks.padding_errors
    python -m benchmarks.padding_errors --size 256x192 --reference 4

Random patterns through two modulators with samples of 4 µm, a gap of 2 mm, 11 mm in front of the plane, without stops,
behind square stops at the first order (those of most presets), and behind irises of NA 0.03. The relative L2 error of
the intensity over the whole field, against a grid several times as large, in complex128.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

import numpy as np

import holoview as hv
from benchmarks.common import count_of, markdown_table, shape_of

WAVELENGTHS = ("450 nm", "650 nm")
STOPS: dict[str, dict[str, Any]] = {
    "without stops": {},
    "square stops": {"square": "first order"},
    "irises": {"iris_na": 0.03},
}
"""Of both relays."""
PADDINGS: dict[str, dict[str, Any]] = {
    "linear": {"propagation": "linear", "padding": 2},
    "linear, 3 times": {"propagation": "linear", "padding": 3},
    "compact": {"propagation": "compact"},
    "periodic": {"propagation": "periodic"},
}


def bench(samples: tuple[int, int], stops: dict[str, Any], sampling: dict[str, Any]) -> hv.System:
    """The bench of (y, x) samples of the field."""
    changes = {
        "shape": [samples[0] // 2, samples[1] // 2],
        "wavelengths": list(WAVELENGTHS),
        "amplitudes": [[1.0] * len(WAVELENGTHS)],
        "planes": ["11 mm"],
        "relay1": stops,
        "relay2": stops,
    }
    return hv.load("holochrome-8").edit({**changes, **sampling})


def errors(samples: tuple[int, int], stops: dict[str, Any], reference: int) -> dict[str, list[float]]:
    """By padding the relative L2 error of each wavelength. reference: side of the reference grid over the field's."""
    best = bench(samples, stops, {"propagation": "linear", "padding": reference})
    drive = hv.random_drive(best, seed=0)
    expected = hv.simulate(best, drive, backend="torch64").intensity[0]
    found = {}
    for name, sampling in PADDINGS.items():
        seen = hv.simulate(bench(samples, stops, sampling), drive, backend="torch64").intensity[0]
        found[name] = [float(np.linalg.norm(a - b) / np.linalg.norm(b)) for a, b in zip(seen, expected, strict=True)]
    return found


def main(arguments: list[str] | None = None) -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=shape_of, default=(768, 1024), help="samples of the field, x by y (1024x768)")
    parser.add_argument("--reference", type=count_of, default=6, help="side of the reference grid over the field's (6)")
    options = parser.parse_args(arguments)
    columns = {name: errors(options.size, stops, options.reference) for name, stops in STOPS.items()}
    rows = [
        [padding, *(" / ".join(f"{100 * error:.2g} %" for error in found[padding]) for found in columns.values())]
        for padding in PADDINGS
    ]
    print(markdown_table([f"padding, {' / '.join(WAVELENGTHS)}", *columns], rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
