"""Write the observers' tables from colour-science: `python -m assets.make_observers` from the root of the checkout."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from holoview.light.colour import TABLES, import_colour_science
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


def main() -> None:
    """Write every table."""
    FOLDER.mkdir(exist_ok=True)
    for name, (source, columns) in TABLES.items():
        write_file(FOLDER / f"{name}.csv", table(source, columns))


if __name__ == "__main__":
    main()
