"""Makes docs/gallery.md: every study at the quick scale, with a figure and pictures of each.

python -m benchmarks.gallery [-o out/gallery]     results of earlier runs in this folder are used again
"""

from __future__ import annotations

import argparse
import io
import textwrap
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from holoview.commands.console import progress_bar
from holoview.evidence.study.charts import render_figure
from holoview.evidence.study.report import version_summary, write_report
from holoview.evidence.study.runner import ResultStore, run_jobs
from holoview.evidence.study.studies import studies_by_name
from holoview.evidence.study.study import QUICK, Findings, Study, StudyFigure, StudyPicture
from holoview.util.file_writer import write_file

DOCS = Path(__file__).resolve().parent.parent / "docs"
FIGURE_WIDTH, PICTURE_WIDTH = 560, 256
_MOST_PICTURES = 3
_CHOSEN = {"model-vs-capture": ("light-2", "left-before-2", "left-after-2")}
"""Names of the pictures of a study for which the first two and the last aren't a good choice."""
_LINE = 120
_QUALITY = 88
_COLOURS = 256

HEAD = """# Gallery

Every study at its quick scale (128 × 96 samples, 40 iterations, one seed and three focal planes unless stated), made by
`python -m benchmarks.gallery`. Gains scatter at this size: [studies](studies.md#results) has the figures to quote,
[speckle contrast](speckle-contrast.md) says how to read the contrasts.

{versions}"""


def run_study(study: Study, folder: Path) -> Findings:
    """Run a study at the quick scale, write its report, and return its findings."""
    with progress_bar(study.name) as report:
        results = run_jobs(study, study.jobs(QUICK, 0), ResultStore(folder / "jobs"), progress=report)
    findings = study.analyse(results)
    write_report(folder, study, QUICK, 0, findings)
    return findings


def section(study: Study, findings: Findings, images: Path) -> str:
    """Write the images of a study and return its Markdown."""
    chosen = _chosen(study, findings.pictures)
    parts = [
        f"## {study.title}",
        _wrapped(f"`holoview study {study.name}` · {study.summary}{_size(study)}"),
        *(_figure(study, plot, images) for plot in findings.plots[:1]),
        *([_table([p.caption for p in chosen], [[_picture(study, p, images) for p in chosen]])] if chosen else []),
    ]
    return "\n\n".join(parts)


def _size(study: Study) -> str:
    """The size of a study's jobs, where it isn't that of most studies, which the head of the page states."""
    size = study.describe_size(QUICK)
    return "" if size == QUICK.description else f" ({size}.)"


def _chosen(study: Study, pictures: Sequence[StudyPicture]) -> Sequence[StudyPicture]:
    """The pictures named in `_CHOSEN`, else the first two and the last: target, simplest display, best display."""
    if study.name in _CHOSEN:
        return [picture for picture in pictures if picture.name in _CHOSEN[study.name]]
    return pictures if len(pictures) <= _MOST_PICTURES else (*pictures[: _MOST_PICTURES - 1], pictures[-1])


def _wrapped(text: str) -> str:
    return textwrap.fill(text, _LINE, break_long_words=False, break_on_hyphens=False)


def _figure(study: Study, plot: StudyFigure, images: Path) -> str:
    with Image.open(io.BytesIO(render_figure(plot)["png"])) as figure:
        size = FIGURE_WIDTH, round(figure.height * FIGURE_WIDTH / figure.width)
        small = figure.convert("RGB").resize(size, Image.Resampling.LANCZOS).quantize(_COLOURS)
    name = f"{study.name}-{plot.name}.png"
    buffer = io.BytesIO()
    small.save(buffer, format="PNG", optimize=True)
    write_file(images / name, buffer.getbuffer())
    return f"![](images/gallery/{name})\n\n{_wrapped(f'*{plot.caption}.*')}"


def _picture(study: Study, picture: StudyPicture, images: Path) -> str:
    """Write a picture enlarged by an integer factor, so that speckle isn't interpolated, and return its Markdown."""
    pixels = Image.fromarray(picture.pixels)
    scale = max(PICTURE_WIDTH // pixels.width, 1)
    name = f"{study.name}-{picture.name}.jpg"
    large = pixels.resize((scale * pixels.width, scale * pixels.height), Image.Resampling.NEAREST)
    buffer = io.BytesIO()
    large.save(buffer, format="JPEG", quality=_QUALITY)
    write_file(images / name, buffer.getbuffer())
    return f"![](images/gallery/{name})"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows))


def main() -> None:
    """Runs the studies and writes the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, default=Path("out/gallery"), help="reports and jobs"
    )
    parser.add_argument("--docs", metavar="DIR", type=Path, default=DOCS, help="where gallery.md is written (docs)")
    parser.add_argument("--only", nargs="+", choices=[*studies_by_name()], help="studies")
    args = parser.parse_args()
    folder, images = args.output, args.docs / "images" / "gallery"
    studies = [study for name, study in studies_by_name().items() if args.only is None or name in args.only]
    images.mkdir(parents=True, exist_ok=True)
    parts = [HEAD.format(versions=_wrapped(f"Computed with {version_summary()}."))]
    parts += [section(study, run_study(study, folder / study.name), images) for study in studies]
    write_file(args.docs / "gallery.md", "\n\n".join(parts) + "\n")
    print(f"{args.docs / 'gallery.md'}: {sum(file.stat().st_size for file in images.iterdir()) / 1e6:.2f} MB of images")


if __name__ == "__main__":
    main()
