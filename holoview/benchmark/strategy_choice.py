"""Chooses the FFT strategy that is measured, and reports the times on which the choice is based."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from holoview.gpu.device import Device
from holoview.gpu.line_fft import Strategy, supported_strategies
from holoview.gpu.tune import FftTuner, StrategyOption, TuningResult

Shape = tuple[int, int]


@dataclass(frozen=True)
class TuningReport:
    """Times of the strategies for fields of `shape` (ny, nx), and the chosen strategy."""

    shape: Shape
    chosen: Strategy
    tuning: TuningResult

    def as_dict(self) -> dict[str, Any]:
        """The report as JSON values."""
        tables = {name: dict(getattr(self.tuning, name)) for name in ("seconds", "compile_seconds", "refused")}
        return {"size": [self.shape[1], self.shape[0]], "chosen": self.chosen} | tables

    def format_lines(self) -> list[str]:
        """The report as lines of text."""
        lines = [f"{self.shape[1]} x {self.shape[0]}: {self.chosen}"]
        for strategy in sorted({*self.tuning.seconds, *self.tuning.compile_seconds, *self.tuning.refused}):
            parts = [f"  {strategy:<10}"]
            if strategy in self.tuning.seconds:
                parts.append(f"{1e3 * self.tuning.seconds[strategy]:8.2f} ms an FFT and its inverse")
            if strategy in self.tuning.compile_seconds:
                parts.append(f"{self.tuning.compile_seconds[strategy]:7.2f} s to compile both")
            if strategy in self.tuning.refused:
                parts.append(f"refused: {self.tuning.refused[strategy]}")
            lines.append("  ".join(parts))
        return lines


def tune(device: Device, shape: Shape, *, remeasure: bool = False) -> TuningReport:
    """The fastest strategy for fields of `shape` (ny, nx), from the cache or measured; waits for the result.

    remeasure: ignore cached times. Raises UserError for a size that can't be transformed.
    """
    with FftTuner(device, shape, remeasure=remeasure) as tuner:
        chosen = tuner.wait()
        return TuningReport(shape, chosen, tuner.tuning)


def resolve_strategy(device: Device, shape: Shape, requested: StrategyOption) -> Strategy:
    """The requested strategy, or for "auto" the fastest one."""
    if requested != "auto":
        return requested
    return tune(device, shape).chosen if len(supported_strategies(device, shape)) > 1 else "passes"
