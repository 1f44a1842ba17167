"""Settings of the correction of known effects that were measured."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class KnownConfig:
    """How errors of what an alignment measured are fitted before causes are searched."""

    time_share: float = 0.7
    """[1] Of a search's time, which they may take before it. Evidence: 16 s of one core on the virtual rig (48 × 64
    pixels, 24 captures)."""

    bases: int = 3
    """[fits] Single causes beside which they are fitted, at most. Evidence: none recorded."""

    as_good_cost: float = 1.5
    """[1] Cost of such a cause over the best one's, at most. Evidence: stroke and stroke_map within 1.02, the next one
    1.9 on the virtual rig."""

    max_deviations: float = 3.0
    """[σ of the alignment] A larger correction is no error of the measurement, but a cause to be named. Evidence: one
    normal deviate in 400 is larger."""

    listed: int = 3
    """[corrections] Named in the note. Evidence: none needed: the others are in the JSON."""
