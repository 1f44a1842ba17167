"""Write the observers' tables: `python -m assets.make_observers` from the root of the checkout.

Those of colour-science; the densities of lens and macula of CIE 170-1:2006, which it gives each 5 nm, by cubic splines
each nanometre; and the 100 people who were drawn once, by numpy's generator from the seed 170.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from holoview.light.colour import TABLES, import_colour_science
from holoview.light.observers import PARAMETERS, PEOPLE
from holoview.util.file_writer import write_file

FOLDER = Path(__file__).parent / "observers"


def table(source: str, columns: str) -> str:
    """A colour-matching table of colour-science as CSV: nanometres, then three responses, each in its shortest digits.

    Some releases hold NaN where the S cone has no published value (above 615 nm): its response there is below 1e-5.
    """
    responses = import_colour_science().MSDS_CMFS[source]
    text = io.StringIO(newline="")
    text.write(f"# {source}\n# nm,{columns}\n")
    for nm, values in zip(responses.wavelengths, np.nan_to_num(responses.values, nan=0.0), strict=True):
        text.write(",".join([f"{nm:g}", *(repr(float(value)) for value in values)]) + "\n")
    return text.getvalue()


FILTERS = """\
390 0.809599 1.6337 0.1295
395 0.735718 1.36838 0.1854
400 0.661837 1.10306 0.248
405 0.587956 0.837744 0.32
410 0.530708 0.606672 0.39
415 0.46804 0.43826 0.466
420 0.427672 0.296308 0.566
425 0.393583 0.202137 0.67
430 0.372871 0.114729 0.748
435 0.336814 0.071286 0.792
440 0.310032 0.031288 0.824
445 0.282708 0.017272 0.88
450 0.258499 0.004381 0.952
455 0.24165 0.00215 0.996
460 0.2279 0 1
465 0.21306 0 0.934
470 0.20458 0 0.856
475 0.19292 0 0.812
480 0.18338 0 0.796
485 0.1749 0 0.792
490 0.16748 0 0.768
495 0.16006 0 0.71
500 0.1537 0 0.598
505 0.14628 0 0.472
510 0.1378 0 0.346
515 0.12932 0 0.232
520 0.12296 0 0.15
525 0.1166 0 0.094
530 0.11024 0 0.05
535 0.10494 0 0.0265
540 0.09858 0 0.0131
545 0.09222 0 0.0047
550 0.08586 0 0
555 0.0795 0 0
560 0.0742 0 0
565 0.06784 0 0
570 0.06148 0 0
575 0.05512 0 0
580 0.04876 0 0
585 0.04346 0 0
590 0.03812 0 0
595 0.03286 0 0
600 0.02968 0 0
605 0.02544 0 0
610 0.02226 0 0
615 0.01908 0 0
620 0.01696 0 0
625 0.01484 0 0
630 0.01166 0 0
635 0.00848 0 0
640 0.0053 0 0
645 0.00424 0 0
650 0.00318 0 0
655 0.00106 0 0
660 0 0 0
665 0 0 0
"""
"""nm; density of the lens that grows with age, and that which stays; macular density over its peak. Zero beyond."""

_SEED = 170
_AGES = (20.0, 70.0)
_DEVIATIONS = (18.7, 36.5, 9.0, 9.0, 7.4, 2.0, 1.5, 1.3)  # Asano, Fairchild, Blondé, PLoS ONE 11(2), 2016


def filters() -> str:
    """Densities of the lens and the macula each nanometre, as CSV."""
    rows = np.array([[float(number) for number in line.split()] for line in FILTERS.splitlines()])
    nm = np.arange(rows[0, 0], rows[-1, 0] + 1)
    values = CubicSpline(rows[:, 0], rows[:, 1:])(nm)
    lines = (f"{at:g}," + ",".join(f"{value + 0.0:.6f}" for value in row) for at, row in zip(nm, values, strict=True))
    return "\n".join(["# CIE 170-1:2006", "# nm,lens that grows with age,lens that stays,macula", *lines, ""])


def people() -> str:
    """The drawn people as CSV: number, age and the eight parameters."""
    random = np.random.Generator(np.random.PCG64(_SEED))  # this stream for ever: the file is shipped
    ages = random.uniform(*_AGES, PEOPLE)
    values = random.normal(size=(PEOPLE, len(PARAMETERS))) * _DEVIATIONS
    rows = (",".join(f"{x:.3f}" for x in (age, *row)) for age, row in zip(ages, values, strict=True))
    lines = [f"{number},{row}" for number, row in enumerate(rows, 1)]
    return "\n".join([f"# seed {_SEED}", f"# person,age,{','.join(PARAMETERS)}", *lines, ""])


def main() -> None:
    """Write every table."""
    FOLDER.mkdir(exist_ok=True)
    write_file(FOLDER / "filters.csv", filters())
    write_file(FOLDER / "people.csv", people())
    for name, (source, columns) in TABLES.items():
        write_file(FOLDER / f"{name}.csv", table(source, columns))


if __name__ == "__main__":
    main()
