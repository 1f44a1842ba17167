"""Chooses the FFT strategy of a renderer: the requested one, or the fastest one whose shaders are compiled already."""

from __future__ import annotations

from holoview.engine.fused import FusedFrame
from holoview.engine.kernels import KernelVariant
from holoview.gpu.device import Device
from holoview.gpu.line_fft import Strategy
from holoview.gpu.tune import FftTuner, StrategyOption, remembered_strategy

Shape = tuple[int, int]


class StrategySelector:
    """Chooses the strategy for a padded grid, and again for each further grid.

    With "auto", `poll` searches for the fastest strategy in the background. An edit may need kernel variants that
    aren't compiled yet, such as those with a pupil; then "passes" is used until they are.
    """

    def __init__(self, device: Device, requested: StrategyOption) -> None:
        self._device, self._requested = device, requested
        self._best: Strategy = "passes"
        self._ready: frozenset[KernelVariant] = frozenset()
        self._compiles_instantly = False
        self._tuner: FftTuner | None = None
        self._tuning_variants: frozenset[KernelVariant] = frozenset()
        self._shape: Shape | None = None

    def initial_strategy(self, shape: Shape) -> Strategy:
        """The strategy to start with on a grid of `shape` (y, x), without waiting or searching."""
        if self._requested != "auto":
            return self._requested
        if shape != self._shape:
            self.close()
            self._shape, self._ready = shape, frozenset()
            self._best = remembered_strategy(self._device, shape)
            self._compiles_instantly = self._best != "passes"
        return self._best

    def strategy_for(self, variants: frozenset[KernelVariant]) -> Strategy:
        """The fastest strategy whose shaders for these variants are compiled or compile instantly."""
        if self._requested != "auto":
            return self._requested
        return self._best if self._compiles_instantly or variants <= self._ready else "passes"

    def poll(self, shape: Shape, frame: FusedFrame) -> Strategy:
        """`strategy_for` the kernels of a frame, after starting a search if one is needed and checking its progress."""
        if self._requested != "auto":
            return self._requested
        variants = frame.required_variants()
        if self._tuner is None and not variants <= self._ready:
            self._tuning_variants = variants
            self._tuner = FftTuner(
                self._device, shape, lambda strategy: frame.fused_kernels.shaders(strategy, self._tuning_variants)
            )
        if self._tuner is not None:
            self._tuner.poll()
            if self._tuner.is_settled:
                self._adopt(self._tuner, shape)
        return self.strategy_for(variants)

    def close(self) -> None:
        """Stop the search, if one is running."""
        if self._tuner is not None:
            self._tuner.close()
            self._tuner = None

    def _adopt(self, tuner: FftTuner, shape: Shape) -> None:
        """Use the result of a finished search."""
        still_ready = self._ready if tuner.current == self._best else frozenset()
        self._best, self._ready = tuner.current, still_ready | self._tuning_variants
        self._compiles_instantly = self._best != "passes" and remembered_strategy(self._device, shape) == self._best
        self.close()
