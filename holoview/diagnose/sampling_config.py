"""How a prediction samples light: it changes the model's accuracy, not the bench."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SamplingConfig:
    """The keywords of `Predictor` that set its sampling.

    finer: samples on each axis for every one of the model's own. padding: sides of the grid over the modulators'.
    points: points on each axis that a camera pixel averages; None: one for each sample on it.
    """

    finer: int = 1
    padding: int = 2
    points: int | None = None

    @property
    def description(self) -> str:
        """How it differs from the default."""
        parts = ["finer samples"] if self.finer > 1 else []
        parts += [f"a grid {self.padding} times the modulators' size"] if self.padding > 2 else []
        parts += ["camera pixels that integrate"] if (self.points or self.finer) > 1 else []
        return " and ".join(parts)

    @property
    def cli_options(self) -> str:
        """The options of `holoview diagnose` for it."""
        points = f" --points {self.points}" if self.points else ""
        return f"--finer {self.finer} --padding {self.padding}{points}"


PLAIN = SamplingConfig()
