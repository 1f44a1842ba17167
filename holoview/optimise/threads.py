"""Limits torch to one CPU thread where fields are small."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch

MIN_SAMPLES_FOR_THREADS = 1 << 17
"""Samples of a padded field below which starting threads takes longer than they save."""


@contextmanager
def limit_torch_threads(samples: int) -> Iterator[None]:
    """One torch thread inside the block for fields of few samples, unless OMP_NUM_THREADS is set; else no change."""
    before = torch.get_num_threads()
    chosen = 1 if samples < MIN_SAMPLES_FOR_THREADS and "OMP_NUM_THREADS" not in os.environ else before
    if chosen != before:
        torch.set_num_threads(chosen)
    try:
        yield
    finally:
        if chosen != before:
            torch.set_num_threads(before)
