"""Least-recently-used caches of tensors, limited in bytes."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable

import torch


class TensorCache:
    """Tensors by a key that names everything they were computed from.

    Beyond `max_bytes` in all, the least recently used tensors are dropped; the latest one always stays.
    """

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes, self._bytes = max_bytes, 0
        self._tensors: OrderedDict[Hashable, torch.Tensor] = OrderedDict()

    def get(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """The tensor of that key, computed if it isn't in the cache."""
        cached = self._tensors.get(key)
        if cached is not None:
            self._tensors.move_to_end(key)
            return cached
        computed = compute()
        self._tensors[key] = computed
        self._bytes += computed.nbytes
        while self._bytes > self._max_bytes and len(self._tensors) > 1:
            self._bytes -= self._tensors.popitem(last=False)[1].nbytes
        return computed

    def get_invariant(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """As `get`, for a tensor that no effect changes and through which no gradient flows."""
        return self.get(key, compute)


class InvariantCache(TensorCache):
    """Caches, in another cache, only the tensors that no effect changes; all others are computed anew.

    For calls with gradients: a cached tensor would belong to the computation graph of an earlier call.
    """

    def __init__(self, store: TensorCache) -> None:
        super().__init__(0)
        self._store = store

    def get(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """The tensor, computed anew."""
        return compute()

    def get_invariant(self, key: Hashable, compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """The tensor of that key, computed if it isn't in the other cache."""
        return self._store.get(key, compute)
