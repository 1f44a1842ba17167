"""Writes a study's report: one self-contained HTML file, the numbers as CSV, the figures as PNG and PDF."""

from __future__ import annotations

import csv
import io
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from PIL import Image

from holoview.evidence.study.charts import data_uri, render_figure
from holoview.evidence.study.study import QUICK, Claim, Findings, Study, StudyPicture, StudyScale
from holoview.holograms.files.pictures import write_png
from holoview.util.file_writer import write_file
from holoview.util.packages import __version__

_LIBRARIES = ("numpy", "torch", "colour-science")


def write_report(folder: Path, study: Study, scale: StudyScale, seed: int, findings: Findings, live: str = "") -> Path:
    """Writes report.html, numbers.csv (numbers.parquet as well if pyarrow is installed) and the figures.

    live: name of a page in the folder with the holograms, to which the report leads; none when empty.
    Returns the path of report.html.
    """
    figures = {plot.name: render_figure(plot) for plot in findings.plots}
    for name, kinds in figures.items():
        for kind, content in kinds.items():
            write_file(folder / f"{name}.{kind}", content)
    for picture in findings.pictures:
        write_png(folder / f"{picture.name}.png", picture.pixels, {"holoview.caption": picture.caption})
    _write_numbers(folder, findings.rows)
    path = folder / "report.html"
    write_file(path, _render_html(study, scale, seed, findings, figures, live))
    return path


def version_summary() -> str:
    """Versions of holoview, Python and the libraries that compute, and the platform."""
    libraries = ", ".join(f"{name} {version(name)}" for name in _LIBRARIES)
    machine = f"{platform.system()} {platform.machine()}"
    return f"holoview {__version__}, Python {platform.python_version()}, {libraries}, {machine}"


def format_claims(claims: Sequence[Claim]) -> list[str]:
    """A table of the claims as lines of text, with a line of headings."""
    table = [
        ("claim", "paper", "here", "verdict"),
        *((c.claim, c.published, c.measured, f"{c.verdict}: {c.reason}" if c.reason else c.verdict) for c in claims),
    ]
    widths = [max(len(row[i]) for row in table) for i in range(3)]
    lines = ["  ".join([*(cell.ljust(w) for cell, w in zip(row[:3], widths, strict=True)), row[3]]) for row in table]
    return [line.rstrip() for line in lines]


def _render_html(
    study: Study,
    scale: StudyScale,
    seed: int,
    findings: Findings,
    figures: Mapping[str, Mapping[str, bytes]],
    live: str,
) -> str:
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    template = environment.from_string(files(__package__).joinpath("report.html").read_text(encoding="utf-8"))
    columns = list(findings.rows[0]) if findings.rows else []
    return template.render(
        title=study.title,
        shows=study.summary,
        scale=f"Scale {scale.name}: {study.describe_size(scale)}; seed {seed}.",
        reduced=study.quick_note if scale.name == QUICK.name else "",
        live=live,
        claims=findings.claims,
        plots=[{"uri": data_uri(figures[plot.name]["png"]), "caption": plot.caption} for plot in findings.plots],
        pictures=[{"uri": data_uri(_png(picture)), "caption": picture.caption} for picture in findings.pictures],
        notes=findings.notes,
        columns=columns,
        rows=[[_format_cell(row.get(name)) for name in columns] for row in findings.rows],
        command=f"holoview study {study.name} --scale {scale.name} --seed {seed}",
        versions=version_summary(),
    )


def _png(picture: StudyPicture) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(picture.pixels)).save(buffer, format="PNG")
    return buffer.getvalue()


def _format_cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _write_numbers(folder: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    if not rows:
        return
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, fieldnames=list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)
    write_file(folder / "numbers.csv", text.getvalue())
    try:
        from pyarrow import Table, parquet  # optional library
    except ImportError:
        return
    buffer = io.BytesIO()
    parquet.write_table(Table.from_pylist([dict(row) for row in rows]), buffer)
    write_file(folder / "numbers.parquet", buffer.getbuffer())
