"""Helpers of several benchmarks: facts about the machine, command-line arguments, Markdown tables."""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Sequence
from importlib.metadata import version
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


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table: the first column is aligned left, the others right."""
    rule = ["---", *["---:"] * (len(header) - 1)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, rule, *rows))
