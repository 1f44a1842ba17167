"""Cases of a parametrised test: some in the default run, the others in the run that explores."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def explored(cases: Iterable[Any], by_default: Collection[Any]) -> list[Any]:
    """The cases of `pytest.mark.parametrize`; those that aren't in `by_default` are marked `explores`."""
    return [case if case in by_default else pytest.param(case, marks=pytest.mark.explores) for case in cases]
