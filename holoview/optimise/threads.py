"""As many CPU threads as the size of the work deserves."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch

MIN_SAMPLES_FOR_THREADS = 1 << 17
"""Below this many samples of a padded field, starting threads costs more than they save."""


@contextmanager
def limit_torch_threads(samples: int) -> Iterator[None]:
    """One torch thread inside the block for fields of few samples; the caller's number otherwise."""
    before = torch.get_num_threads()
    chosen = 1 if samples < MIN_SAMPLES_FOR_THREADS and "OMP_NUM_THREADS" not in os.environ else before
    if chosen != before:
        torch.set_num_threads(chosen)
    try:
        yield
    finally:
        if chosen != before:
            torch.set_num_threads(before)
