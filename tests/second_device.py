"""A second torch device that isn't there: computes on the processor, but keeps apart what would lie in two memories.

Inside the mode, tensors that are made on or moved to "cuda" say that they are there. An operation on tensors of both
memories raises RuntimeError, as CUDA does, and so does handing one to numpy. So a machine without a card can test that
a program keeps to its device.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import torch
from torch.overrides import TorchFunctionMode

import holoview as hv
from holoview.light.model.system import System

CARD = torch.device("cuda")
_TO_HOST = (torch.Tensor.numpy, torch.Tensor.__array__, torch.Tensor.__dlpack__)
_COPIES = (torch.Tensor.__setitem__, torch.Tensor.copy_)
"""What copies from one memory to the other."""
_MOVES = (torch.Tensor.to, torch.Tensor.cpu, torch.Tensor.cuda)
_DEVICE = torch.Tensor.device.__get__  # type: ignore[attr-defined]


class SecondDevice(TorchFunctionMode):
    """The mode, for a `with` block. moves: how many tensors went from one memory to the other."""

    def __init__(self) -> None:
        super().__init__()
        self.moves = 0

    def __torch_function__(
        self, func: Callable[..., Any], types: Any, args: tuple[Any, ...] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        """Run a function of torch on the processor, and remember in which memory its results would be."""
        named = dict(kwargs or {})
        if func == _DEVICE:  # a new object each time
            return CARD if self._is_there(args[0]) else torch.device("cpu")
        if func in _MOVES:
            return self._move(func, args, named)
        tensors = list(_tensors((args, named)))
        is_there = self._place(func, tensors)
        if "device" in named and named["device"] is not None:
            is_there = torch.device(named["device"]).type == "cuda"
            named["device"] = "cpu"
        out = func(*args, **named)
        if is_there:
            for tensor in _tensors(out):
                self._remember(tensor)
        return out

    def _move(self, func: Callable[..., Any], args: tuple[Any, ...], named: dict[str, Any]) -> Any:
        """`to`, `cpu` and `cuda`: a copy in the other memory, or the same tensor."""
        tensor, *rest = args
        words = [*rest, *([named.pop("device")] if "device" in named else [])]
        targets = [torch.device(word) for word in words if isinstance(word, str | torch.device)]
        targets += [self._device(word) for word in words if isinstance(word, torch.Tensor)]
        goes_there = self._is_there(tensor)
        if func is not torch.Tensor.to:
            goes_there = func is torch.Tensor.cuda
        elif targets:
            goes_there = targets[0].type == "cuda"
        others = [word for word in words if not isinstance(word, str | torch.device)]
        out = torch.Tensor.to(tensor, *others, **named) if others or named else tensor
        if goes_there != self._is_there(tensor):
            self.moves += 1
            out = out.clone() if out is tensor else out
        if goes_there:
            self._remember(out)
        return out

    def _place(self, func: Callable[..., Any], tensors: list[torch.Tensor]) -> bool:
        """Whether the operands are on the card. Raises RuntimeError where they are in both memories."""
        if func in _COPIES:
            return self._is_there(tensors[0])
        if func is torch.Tensor.__getitem__:  # whose indices may be on the processor
            tensors = tensors[:1] + [index for index in tensors[1:] if self._is_there(index)]
        places = {self._is_there(tensor) for tensor in tensors if tensor.ndim > 0}
        if len(places) > 1:
            raise RuntimeError(f"{getattr(func, '__name__', func)}: expected all tensors to be on the same device")
        is_there = places == {True} or any(self._is_there(tensor) for tensor in tensors)
        if is_there and func in _TO_HOST:
            raise TypeError("can't convert a tensor of the card to numpy; copy it to the processor first")
        return is_there

    def _device(self, tensor: torch.Tensor) -> torch.device:
        return CARD if self._is_there(tensor) else torch.device("cpu")

    def _is_there(self, tensor: torch.Tensor) -> bool:
        return bool(getattr(tensor, "_lies_on_the_card", False))

    def _remember(self, tensor: torch.Tensor) -> None:
        tensor._lies_on_the_card = True  # type: ignore[attr-defined]


def _tensors(value: Any) -> Iterator[torch.Tensor]:
    """All tensors in nested lists, tuples and dictionaries."""
    if isinstance(value, torch.Tensor):
        yield value
    elif isinstance(value, dict):
        yield from _tensors(tuple(value.values()))
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _tensors(item)


def small_bench(**changes: Any) -> System:
    """A bench of three lasers, two modulators and two planes, small enough to compute on both; with some changes."""
    lasers = {"wavelengths": ["460 nm", "530 nm", "620 nm"], "amplitudes": "white"}
    small = {"shape": [12, 16], "propagation": "compact", "planes": ["10 mm", "11 mm"]}
    if "modulators" in changes:
        small.pop("shape")
    return hv.load("holochrome-8").edit({**lasers, **small, **changes})
