"""Which planes an early iteration takes, where few of them count at a time (`Settings.drawn_planes`)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

_DRAWN_SHARE = 0.7  # of the iterations; the last ones take all planes, and are so many where that's at most half
_SETTLING = 40
_WHOLE_EVERY = 10  # iterations of which one takes all planes


def planes_in_turn(iteration: int, iterations: int, count: int, few: int, seed: int) -> tuple[int, ...] | None:
    """The planes that count in an iteration, `few` of `count`; None: all.

    Early iterations take some planes in turn, in an order that is drawn anew for each turn. The sum of a turn's
    gradients is nearly that of all planes, unlike that of independently drawn planes.
    """
    settles = iteration >= min(_DRAWN_SHARE * iterations, max(iterations - _SETTLING, iterations / 2))
    if not 0 < few < count or settles or iteration % _WHOLE_EVERY == 0:
        return None
    turn, place = divmod(iteration, count // few)
    chosen = _order_of_planes(seed, turn, count)[place * few : (place + 1) * few]
    return tuple(sorted(chosen))


@lru_cache(maxsize=2)
def _order_of_planes(seed: int, turn: int, count: int) -> list[int]:
    """All planes in an order that is drawn anew for each turn."""
    order: list[int] = np.random.default_rng((seed, turn)).permutation(count).tolist()
    return order
