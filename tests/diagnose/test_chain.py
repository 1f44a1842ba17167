"""Hidden faults of chains, drawn by a program that shares no code with the predictor, are found and named."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.bench.diagnose.pipeline import diagnose
from tests.diagnose.independent_chain import OF_AMPLITUDE, OF_MASK, captures_with, draw_fault

KINDS = [*((kind, False) for kind in OF_AMPLITUDE), *((kind, True) for kind in OF_MASK)]
QUICK = [("leakage", False), ("shifted", True)]


@pytest.mark.parametrize(
    ("kind", "is_mask"), [k if k in QUICK else pytest.param(*k, marks=pytest.mark.explores) for k in KINDS]
)
def test_a_hidden_fault_of_a_chain_is_named_with_its_size(kind: str, is_mask: bool) -> None:
    rng = np.random.default_rng([7, is_mask, KINDS.index((kind, is_mask))])
    fault = draw_fault(rng, kind)
    found = diagnose(captures_with(fault, is_mask, rng))
    (cause,) = found.causes
    assert found.verdict == "explained" and cause.effect == fault.effect
    for name, value in fault.values.items():
        # 1 %, for what the band limit and the stops of the two programs differ in at the noise's size
        assert cause.intervals[name].value == pytest.approx(value, rel=0.01)
    assert "second" in cause.sentence


@pytest.mark.explores
@pytest.mark.parametrize("is_mask", [False, True])
def test_of_a_chain_without_a_fault_nothing_is_named(is_mask: bool) -> None:
    found = diagnose(captures_with(None, is_mask, np.random.default_rng([8, is_mask])))
    assert found.verdict == "consistent" and not found.causes
