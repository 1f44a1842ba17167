"""Helpers of several benchmarks: facts about the machine, command-line arguments, lines of JSON, Markdown tables."""

from __future__ import annotations

import argparse
import json
import os
import platform
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch

from holoview import __version__


def machine_facts(adapter: str) -> dict[str, Any]:
    """Label of the WebGPU adapter, number of cores, threads of PyTorch, and versions."""
    return {
        "adapter": adapter,
        "torch_threads": torch.get_num_threads(),
        "cores": os.cpu_count(),
        "platform": platform.platform(),
        "versions": {
            "holoview": __version__,
            "python": platform.python_version(),
            **{name: version(name) for name in ("numpy", "torch", "wgpu")},
        },
    }


def count_of(text: str) -> int:
    """Argument type: a positive count."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f'"{text}": expected a whole number from 1')
    return int(text)


def shape_of(text: str) -> tuple[int, int]:
    """Argument type: (y, x) from text such as '1024x768', which is x by y."""
    columns, _, rows = text.partition("x")
    if not (rows.isdecimal() and columns.isdecimal() and int(rows) and int(columns)):
        raise argparse.ArgumentTypeError(f'"{text}": expected columns by rows, such as 1024x768')
    return int(rows), int(columns)


def lines_or_summary(parser: argparse.ArgumentParser, name: str, summarise: Callable[[Path], None]) -> Any:
    """The arguments of a measurement in one thread that writes lines to `output`. With --summary prints a table, ends.

    name: of the output in out/.
    """
    parser.add_argument("-o", "--output", type=Path, default=Path(f"out/{name}.jsonl"))
    parser.add_argument("--summary", type=Path, help="print the table of such a file, and measure nothing")
    args = parser.parse_args()
    if args.summary is not None:
        summarise(args.summary)
        parser.exit()
    torch.set_num_threads(1)
    args.output.parent.mkdir(parents=True, exist_ok=True)
    return args


def append_line(file: Path, row: dict[str, Any]) -> None:
    """Adds a line of JSON."""
    with file.open("a", encoding="utf-8") as lines:
        lines.write(json.dumps(row) + "\n")


def read_lines(file: Path) -> list[dict[str, Any]]:
    """The lines of JSON."""
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table: the first column is aligned left, the others right."""
    rule = ["---", *["---:"] * (len(header) - 1)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, rule, *rows))
