"""Which strategy of the transforms a bench is measured with, and what the choice rests on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from holoview.gpu.device import Device
from holoview.gpu.line_fft import Strategy, supported_strategies
from holoview.gpu.tune import FftTuner, StrategyOption, TuningResult

Shape = tuple[int, int]


@dataclass(frozen=True)
class TuningReport:
    """What timing the strategies of transforms of `shape` (ny, nx) told, and the one that was chosen."""

    shape: Shape
    chosen: Strategy
    tuning: TuningResult

    def as_dict(self) -> dict[str, Any]:
        """For programs."""
        tables = {name: dict(getattr(self.tuning, name)) for name in ("seconds", "compile_seconds", "refused")}
        return {"size": [self.shape[1], self.shape[0]], "chosen": self.chosen} | tables

    def format_lines(self) -> list[str]:
        """For people."""
        out = [f"{self.shape[1]} x {self.shape[0]}: {self.chosen}"]
        for strategy in sorted({*self.tuning.seconds, *self.tuning.compile_seconds, *self.tuning.refused}):
            parts = [f"  {strategy:<10}"]
            if strategy in self.tuning.seconds:
                parts.append(f"{1e3 * self.tuning.seconds[strategy]:8.2f} ms an FFT and its inverse")
            if strategy in self.tuning.compile_seconds:
                parts.append(f"{self.tuning.compile_seconds[strategy]:7.2f} s to compile both")
            if strategy in self.tuning.refused:
                parts.append(f"refused: {self.tuning.refused[strategy]}")
            out.append("  ".join(parts))
        return out


def tune(device: Device, shape: Shape, *, remeasure: bool = False) -> TuningReport:
    """The choice for fields of a shape, remembered or measured; waits until it is made.

    Raises UserError for a size that can't be transformed.
    """
    with FftTuner(device, shape, remeasure=remeasure) as choice:
        chosen = choice.wait()
        return TuningReport(shape, chosen, choice.tuning)


def resolve_strategy(device: Device, shape: Shape, requested: StrategyOption) -> Strategy:
    """The strategy that was asked for; for "auto" the fastest one."""
    if requested != "auto":
        return requested
    return tune(device, shape).chosen if len(supported_strategies(device, shape)) > 1 else "passes"
