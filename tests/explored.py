"""Cases of a parametrised test: some in the default run, the others in the run that explores."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable
from typing import Any

import pytest


def explored(cases: Iterable[Any], by_default: Collection[Any] | int) -> list[Any]:
    """The cases of `pytest.mark.parametrize`; those that the default run leaves out are marked `explores`.

    by_default: the cases that it takes, or how many of the first.
    """
    listed = list(cases)
    kept = listed[:by_default] if isinstance(by_default, int) else by_default
    return [case if case in kept else pytest.param(case, marks=pytest.mark.explores) for case in listed]


def one_of_each(cases: Iterable[tuple[Any, ...]], place: int = 0) -> list[Any]:
    """The cases of a table; the default run takes one for each value at a place, such as each effect.

    Of the other values of the table, such as elements, it takes those next that it has taken least often.
    """
    groups, taken, kept = dict[Any, list[tuple[Any, ...]]](), Counter[tuple[int, Any]](), list[tuple[Any, ...]]()
    for case in (listed := list(cases)):
        groups.setdefault(case[place], []).append(case)
    for group in groups.values():
        kept.append(min(group, key=lambda case: sum(taken[other] for other in enumerate(case))))
        taken.update(enumerate(kept[-1]))
    return [case if case in kept else pytest.param(*case, marks=pytest.mark.explores) for case in listed]
