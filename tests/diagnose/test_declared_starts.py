"""Effects declare which starting values a diagnosis may read off the pictures for them."""

from __future__ import annotations

from holoview.light.model.effects.effect import StartKind
from holoview.light.model.effects.registry import listed_effects

SPECIAL = {
    "ghost": StartKind.GHOST,
    "motion_blur": StartKind.SMEAR,
    "camera_fringes": StartKind.CAMERA_FRINGES,
    "slm1_fringes": StartKind.MODULATOR_FRINGES,
    "slm2_fringes": StartKind.MODULATOR_FRINGES,
    "slm1_stuck": StartKind.STUCK_PIXELS,
    "slm2_stuck": StartKind.STUCK_PIXELS,
    "plane_errors": StartKind.PLANES,
}
NEEDED = {
    StartKind.DISPLACEMENT: set[str](),
    StartKind.GHOST: {"strength", "shift_y", "shift_x"},
    StartKind.SMEAR: {"length_y", "length_x"},
    StartKind.CAMERA_FRINGES: {"path_y", "path_x", "cos1", "sin1"},
    StartKind.MODULATOR_FRINGES: {"path_y", "path_x", "cos1", "sin1"},
    StartKind.STUCK_PIXELS: {"columns", "rows", "pixel_rows", "pixel_columns", "part_levels", "kept_rows", "late_rows"},
    StartKind.PLANES: {"distances", "errors"},
}


def test_each_effect_declares_its_starts() -> None:
    declared = {name: effect.start_kinds for name, effect in listed_effects().items()}
    assert declared == {name: (SPECIAL.get(name, StartKind.DISPLACEMENT),) for name in declared}


def test_an_effect_has_the_parameters_that_its_starts_fill() -> None:
    for effect in listed_effects().values():
        for kind in effect.start_kinds:
            assert {p.name for p in effect.parameters} >= NEEDED[kind], effect.id
