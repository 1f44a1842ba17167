"""Caches of tensors drop what was used least recently; with gradients only what no effect changes is cached."""

from __future__ import annotations

import torch

from holoview.captures.camera_model import InvariantCache, TensorCache


def test_the_longest_unused_results_go_first() -> None:
    made: list[str] = []

    def make(name: str) -> torch.Tensor:
        made.append(name)
        return torch.zeros(10, dtype=torch.float64)

    cache = TensorCache(200)
    for name in ("a", "b", "a", "c", "a", "b"):
        cache.get(name, lambda name=name: make(name))  # type: ignore[misc]
    assert made == ["a", "b", "c", "b"]
    nothing = InvariantCache(cache)
    assert nothing.get("a", lambda: torch.zeros(1)) is not nothing.get("a", lambda: torch.zeros(1))
