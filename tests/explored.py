"""Cases of a parametrised test: some in the default run, the others in the run that explores."""

from __future__ import annotations

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
