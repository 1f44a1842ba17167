"""Scores a program's results on the conformance set: python score.py CASES RESULTS.

CASES is the folder of cases.toml. RESULTS has NAME.npy for each case that the program computed: the field (y, x) at
`distance_m`, on the samples of NAME.field.npy, complex. The phase of light that travels along +z rises: a plane wave is
exp(+2πi·z/λ). A common factor of modulus 1 doesn't count. This program needs Python 3.11 and numpy, nothing else.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def error_of(result: NDArray[Any], answer: NDArray[Any], indices: NDArray[Any] | list[int]) -> float:
    """Relative L2 difference of a result (y, x) at rows and columns `indices` from the answer, after one phase factor.

    Infinite for results with values that aren't finite.
    """
    seen = np.asarray(result, dtype=np.complex128)[indices][:, indices]
    if not np.isfinite(seen).all():
        return float("inf")
    overlap = np.vdot(seen, answer)
    factor = overlap / abs(overlap) if abs(overlap) > 0 else 1.0
    return float(np.linalg.norm(seen * factor - answer) / np.linalg.norm(answer))


def main(cases: Path, results: Path) -> int:
    """Prints a line for each case and the number that passed; 0 if all of them did."""
    table = tomllib.loads((cases / "cases.toml").read_text(encoding="utf-8"))
    passed = 0
    for name, case in table.items():
        path = results / f"{name}.npy"
        if not path.exists():
            print(f"{name}: no result")
            continue
        answer = np.load(cases / f"{name}.answer.npy", allow_pickle=False)
        error = error_of(np.load(path, allow_pickle=False), answer, case["rows_and_columns"])
        passed += error <= case["tolerance"]
        verdict = "passed" if error <= case["tolerance"] else "failed"
        print(f"{name}: {verdict}, error {error:.2g}, tolerance {case['tolerance']:.2g}")
    print(f"{passed} of {len(table)} passed")
    return 0 if passed == len(table) else 1


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
