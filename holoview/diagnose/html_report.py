"""Writes a diagnosis as one HTML file with its pictures inside, and the pictures as PNG files beside it."""

from __future__ import annotations

import base64
from importlib.resources import files
from pathlib import Path

import jinja2

from holoview.diagnose import plots
from holoview.diagnose.diagnosis import Diagnosis
from holoview.diagnose.display_gain import DisplayGain
from holoview.diagnose.formatting import format_value
from holoview.diagnose.judge import Verdict
from holoview.report.images import figure_bytes
from holoview.util.file_writer import write_file
from holoview.util.progress import ProgressCallback

_MEANINGS = {
    Verdict.CONSISTENT: "Nothing is wrong beyond the noise.",
    Verdict.EXPLAINED: "One cause, or several together, explain the captures down to the noise.",
    Verdict.PARTLY: "The causes below explain a good part; something else is wrong too.",
    Verdict.AMBIGUOUS: "More than one explanation fits; these captures can't tell which is true.",
    Verdict.UNEXPLAINED: "Something is wrong that no effect of the library explains.",
}


def write_report(
    folder: Path,
    title: str,
    diagnosis: Diagnosis,
    gain: DisplayGain | None = None,
    progress: ProgressCallback | None = None,
) -> Path:
    """Writes report.html and its PNG files into the folder; returns the path of the HTML file.

    gain: what the extended model gains on the display, if that was computed.
    """
    figures = {
        "residuals": plots.residual_maps(diagnosis.samples),
        "excess": plots.excess_bars(diagnosis),
        "held-out": plots.held_out_psnr_bars(diagnosis),
        "candidates": plots.candidate_excess_bars(diagnosis),
    }
    if diagnosis.free_maps:
        figures["free-maps"] = plots.free_maps(diagnosis.free_maps)
    if diagnosis.pixel_maps:
        figures["pixel-maps"] = plots.pixel_maps(diagnosis.pixel_maps)
    pictures = {}
    for number, (name, figure) in enumerate(figures.items(), 1):
        pictures[name] = figure_bytes(figure)
        if progress is not None:
            progress(number, len(figures) + 1, name)
    if gain is not None:
        pictures["display"] = gain.sheet
    for name, data in pictures.items():
        write_file(folder / f"{name}.png", data)
    path = folder / "report.html"
    write_file(path, _render_html(title, diagnosis, pictures, gain))
    if progress is not None:
        progress(len(figures) + 1, len(figures) + 1, "report.html")
    return path


def _render_html(title: str, found: Diagnosis, pictures: dict[str, bytes], gain: DisplayGain | None) -> str:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    template = environment.from_string(files(__package__).joinpath("report.html").read_text(encoding="utf-8"))
    return template.render(
        title=title,
        found=found,
        meaning=_MEANINGS[found.verdict],
        gain=gain,
        pictures={name: base64.b64encode(data).decode("ascii") for name, data in pictures.items()},
        notes=_notes(found),
        format_value=format_value,
    )


def _notes(found: Diagnosis) -> list[str]:
    prnu = [f"Pixels differ in sensitivity by {found.fixed_pattern:.2%}."] if found.fixed_pattern else []
    return [
        *prnu,
        f"Gains of captures vary by {found.gain_spread:.2%} about those of their wavelength; each was fitted.",
        f"Took {found.seconds:.0f} s.",
        *found.notes,
    ]
