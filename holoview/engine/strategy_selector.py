"""Which strategy the kernels of a session use: the one that was named, or the fastest one whose shaders are ready."""

from __future__ import annotations

from typing import Literal

from holoview.engine.fused import FusedFrame
from holoview.engine.kernels import KernelVariant
from holoview.gpu.device import Device
from holoview.gpu.line_fft import Strategy
from holoview.gpu.tune import FftTuner, remembered_strategy

Shape = tuple[int, int]


class StrategySelector:
    """The strategy for one grid after the other. With "auto", `poll` looks for a faster one in the background.

    An edit may need variants of kernels that aren't compiled yet, such as those with a pupil: "passes" are taken until
    the faster ones are.
    """

    def __init__(self, device: Device, requested: Strategy | Literal["auto"]) -> None:
        self._device, self._requested = device, requested
        self._best: Strategy = "passes"
        self._ready: frozenset[KernelVariant] = frozenset()
        self._compiles_instantly = False
        self._choice: FftTuner | None = None
        self._tuning_variants: frozenset[KernelVariant] = frozenset()
        self._shape: Shape | None = None

    def initial_strategy(self, shape: Shape) -> Strategy:
        """The strategy to begin a grid with: without waiting, and without a search."""
        if self._requested != "auto":
            return self._requested
        if shape != self._shape:
            self.close()
            self._shape, self._ready = shape, frozenset()
            self._best = remembered_strategy(self._device, shape)
            self._compiles_instantly = self._best != "passes"
        return self._best

    def strategy_for(self, variants: frozenset[KernelVariant]) -> Strategy:
        """The fastest strategy whose shaders for these variants are compiled, or take no time to be."""
        if self._requested != "auto":
            return self._requested
        return self._best if self._compiles_instantly or variants <= self._ready else "passes"

    def poll(self, shape: Shape, frame: FusedFrame) -> Strategy:
        """The same for the kernels of a frame, after a look at how far the search is; it begins where it has to."""
        if self._requested != "auto":
            return self._requested
        variants = frame.required_variants()
        if self._choice is None and not variants <= self._ready:
            self._tuning_variants = variants
            self._choice = FftTuner(
                self._device, shape, lambda strategy: frame.fused_kernels.shaders(strategy, self._tuning_variants)
            )
        if self._choice is not None:
            self._choice.poll()
            if self._choice.is_settled:
                self._adopt(self._choice, shape)
        return self.strategy_for(variants)

    def close(self) -> None:
        """End the search, if there is one."""
        if self._choice is not None:
            self._choice.close()
            self._choice = None

    def _adopt(self, choice: FftTuner, shape: Shape) -> None:
        known = self._ready if choice.current == self._best else frozenset()
        self._best, self._ready = choice.current, known | self._tuning_variants
        self._compiles_instantly = self._best != "passes" and remembered_strategy(self._device, shape) == self._best
        self.close()
