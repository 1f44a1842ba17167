"""Results that are kept for as long as there is room: the longest unused go first."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable

import torch


class TensorCache:
    """Tensors by what they were computed from, up to `limit` bytes in all."""

    def __init__(self, limit: int) -> None:
        self._limit, self._bytes = limit, 0
        self._kept: OrderedDict[Hashable, torch.Tensor] = OrderedDict()

    def get(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """The tensor of that key, made when it isn't there."""
        found = self._kept.get(key)
        if found is not None:
            self._kept.move_to_end(key)
            return found
        made = compute()
        self._kept[key] = made
        self._bytes += made.nbytes
        while self._bytes > self._limit and len(self._kept) > 1:
            self._bytes -= self._kept.popitem(last=False)[1].nbytes
        return made

    def get_invariant(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """A part that no effect changes, of a result."""
        return self.get(key, compute)


class InvariantCache(TensorCache):
    """Keeps nothing through which gradients flow; parts that no effect changes are kept beside, in another cache."""

    def __init__(self, store: TensorCache) -> None:
        super().__init__(0)
        self._beside = store

    def get(self, key: Hashable, make: Callable[[], torch.Tensor]) -> torch.Tensor:
        """What is made."""
        return make()

    def get_invariant(self, key: Hashable, make: Callable[[], torch.Tensor]) -> torch.Tensor:
        """The part, made when it isn't there."""
        return self._beside.get(key, make)
