"""Draws chains of elements, possible ones and others: each is a picture on every stage, or one sentence."""

from __future__ import annotations

import random
from typing import Any

import numpy as np

import holoview as hv
from holoview.light.model import preset
from holoview.light.model.derived_numbers import info_rows
from tests.fuzz.trial import Case

_WRONG: tuple[Any, ...] = (None, 0, -1, "x", float("nan"), 1e9, [], {}, "8", True, "1e400 um", "ä")
_MODULATORS = ("phase", "amplitude", "complex")
_KINDS = (*_MODULATORS, "mask", "mask", "lens", "space", "space", "space", "fourier")
_SHAPES = ([24, 32], [16, 16], [6, 8], [12, 16], [25, 31])


class ChainDrawer:
    """Draws tables of benches, of which few values are wrong."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)

    def table(self) -> dict[str, Any]:
        """A preset."""
        count = self._random.choice([1, 2, 2, 3, 3, 4, 5])
        kinds = self._random.choices(_MODULATORS) + self._random.choices(_KINDS, k=count - 1)
        if self._random.random() < 0.1:
            kinds[self._random.randrange(count)] = self._random.choice([*_KINDS, "field"])
        elements = [self._element(kind) for kind in kinds]
        if kinds[-1] == "space" and self._random.random() < 0.9:
            del elements[-1]["distance"]  # the planes tell how far the light goes
        table: dict[str, Any] = {"wavelengths": ["480 nm", "600 nm"], "amplitudes": "white", "elements": elements}
        table["planes"] = self._maybe(self._random.choice([["3 mm"], ["1 mm", "2 mm"], [0]]))
        how = {"upsample": self._random.choice([1, 2]), "propagation": self._random.choice(["linear", "periodic"])}
        return table | self._seldom(sampling=how) | self._seldom(planes_from="phase") | self._seldom(eye={}, frames=2)

    def _maybe(self, value: Any) -> Any:
        return value if self._random.random() < 0.98 else self._random.choice(_WRONG)

    def _seldom(self, **values: Any) -> dict[str, Any]:
        return values if self._random.random() < 0.2 else {}

    def _element(self, kind: str) -> dict[str, Any]:
        choice = self._random.choice
        element = {"kind": self._maybe(kind)} | self._seldom(name=choice(["a", "b", "c", "d", "e", "slm"]))
        if kind == "space":
            stops = self._seldom(square=choice(["first order", "first order of phase", 0.02]), iris_na=0.02)
            return element | {"distance": self._maybe(choice(["1 mm", "0 mm"]))} | stops
        if kind in ("lens", "fourier"):
            return element | {"focal_length": self._maybe(choice(["2 mm", "1.5 mm", "20 mm", "5 mm"]))}
        element |= {"pitch": self._maybe(choice(["8 um", "8 um", "4 um", "16 um", "3 um"]))}
        element |= {"shape": self._maybe(choice(_SHAPES))} | self._seldom(offset=["8 um", "0 um"])
        if self._random.random() < 0.05:
            element |= {"beside": choice(["phase", "slm", "amplitude"])}
        if kind == "mask":
            pattern = choice(["random", "grating", "lens array", "half plane"])
            element |= {"pattern": self._maybe(pattern), "period": "32 um", "focal_length": "5 mm"}
        has_stroke = kind in ("phase", "mask", "complex")
        return element | ({"stroke": self._maybe("800 nm")} if has_stroke else {})


def see_every_stage(table: dict[str, Any]) -> None:
    """The picture of a drawn preset, its light at every stage, and its numbers. Raises UserError where it can't be."""
    system = preset.from_table(table)
    assert preset.loads(preset.dumps(system)) == system
    drive = hv.random_drive(system)
    view = hv.simulate(system, drive, backend="torch")
    for stage in system.stages:
        hv.field_at(system, drive, stage=stage)
    assert info_rows(system)
    assert np.isfinite(view.intensity).all()


def chains(rng: np.random.Generator) -> Case:
    """A drawn chain of elements; its name begins with the seed of its drawer."""
    seed = int(rng.integers(1 << 31))
    table = ChainDrawer(seed).table()
    kinds = " ".join(str(element["kind"]) for element in table["elements"])
    return Case("chains", f"{seed}: {kinds}", lambda folder: None, call=lambda: see_every_stage(table))
