"""What a graphics card should reach, and what a report's numbers say about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from holoview.benchmark.frame_cases import FRAME, IN_A_ROW

FRAME_GOAL_MS, SHARE_GOAL, IMAGES_GOAL_PER_S = 1.0, 0.5, 60.0
"""A frame of 8 λ at 1024 × 768 samples on a card such as an H100, the share of a copy's bandwidth, images a second."""
GOAL_SIZE, GOAL_WAVELENGTHS = [1024, 768], 8

Case = Mapping[str, Any]


@dataclass(frozen=True)
class Goal:
    """A goal in words, what was measured in words, and whether it is met; None where it wasn't measured."""

    text: str
    measured: str
    is_met: bool | None


def share_of_copy(case: Case, copy_bandwidth: float | None) -> float | None:
    """Share of a copy's bandwidth that a case's frame reaches by the device's clock; None where either is unknown."""
    if copy_bandwidth is None or "device_ms" not in case or not case["device_ms"][FRAME]:
        return None
    share: float = case["frame_bytes"] / (1e-3 * case["device_ms"][FRAME]) / copy_bandwidth
    return share


def goals(
    cases: Sequence[Case], copy_bandwidth: float | None, viewer: Sequence[Case], stages: Sequence[Case]
) -> list[Goal]:
    """The goals with what the results of a report say about them. stages: errors and what is allowed, by stage."""
    chosen = [case for case in cases if case["size"] == GOAL_SIZE and case["wavelengths"] == GOAL_WAVELENGTHS]
    return [_stages_goal(stages), _frame_goal(chosen), _share_goal(chosen, copy_bandwidth), _viewer_goal(viewer)]


def _stages_goal(stages: Sequence[Case]) -> Goal:
    text = "each stage as exact as rounding allows"
    if not stages:
        return Goal(text, "not measured", None)
    ratio, name = max((entry["error"] / entry["allowed"], name) for bench in stages for name, entry in bench.items())
    return Goal(text, f"{name}: {ratio:.2f} of what is allowed", ratio <= 1)


def _frame_goal(chosen: Sequence[Case]) -> Goal:
    text = f"8 λ at 1024 × 768 in at most {FRAME_GOAL_MS:g} ms"
    if not chosen:
        return Goal(text, "not measured", None)
    best = min(chosen, key=lambda case: case["median_ms"][FRAME])
    alone, row = best["median_ms"][FRAME], best["median_ms"][IN_A_ROW]
    device = f", {best['device_ms'][FRAME]:.3g} ms by the device's clock" if "device_ms" in best else ""
    how = f"{best['strategy']}, {best['per_dispatch']} λ in a dispatch"
    return Goal(text, f"{alone:.3g} ms alone, {row:.3g} ms in a row{device} ({how})", alone <= FRAME_GOAL_MS)


def _share_goal(chosen: Sequence[Case], copy_bandwidth: float | None) -> Goal:
    text = f"at least {SHARE_GOAL:.0%} of a copy's bandwidth there"
    shares = [share for case in chosen if (share := share_of_copy(case, copy_bandwidth)) is not None]
    if not shares:
        return Goal(text, "not measured", None)
    return Goal(text, f"{max(shares):.0%}", max(shares) >= SHARE_GOAL)


def _viewer_goal(viewer: Sequence[Case]) -> Goal:
    text = f"{IMAGES_GOAL_PER_S:g} images a second while a plane is scrubbed in the viewer"
    if not viewer:
        return Goal(text, "not measured", None)
    rate = viewer[0]["scrub_images_per_s"]
    return Goal(text, f"{rate:.3g}", rate >= IMAGES_GOAL_PER_S)
