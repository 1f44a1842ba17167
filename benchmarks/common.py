"""What several benchmarks have in common: the facts of the machine, and numbers on the command line."""

from __future__ import annotations

import argparse
import os
import platform
from importlib.metadata import version
from typing import Any

import torch

from holoview import __version__


def machine_facts(adapter: str) -> dict[str, Any]:
    """The WebGPU adapter's label, cores, torch's threads, and versions."""
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
    """For argparse: how often something is timed."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f'"{text}": expected a whole number from 1')
    return int(text)


def shape_of(text: str) -> tuple[int, int]:
    """For argparse: (y, x) of '1024x768'."""
    columns, _, rows = text.partition("x")
    if not (rows.isdecimal() and columns.isdecimal() and int(rows) and int(columns)):
        raise argparse.ArgumentTypeError(f'"{text}": expected columns by rows, such as 1024x768')
    return int(rows), int(columns)
