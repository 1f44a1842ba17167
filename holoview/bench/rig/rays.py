"""The rays of a rig: how light comes from a pixel of a modulator to the camera, through whatever stands between.

A ray has a place q and the sine s of its direction, both (…, 2), y and x. On its way

    free space of length d    q ▸ q + d·tan(asin(s))
    lens of focal length f    s ▸ s − q/f
    Fourier element of f      q ▸ f·s,  s ▸ −q/f

The other modulators let it through. Near the axis q = A·r + B·s of a ray that begins at r. With A = 0 the camera stands
in a Fourier plane of the modulator, and sees directions. Elsewhere it sees what stands at the distance B/A behind the
modulator, A times as large: a grating's Talbot stripes and a lens's dots follow from that distance alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.devices import Levels
from holoview.light.model.elements import Fourier, Lens, Mask, Space

Floats = NDArray[np.float64]
_SPACE, _LENS, _FOURIER = "space", "lens", "fourier"
_LEAST_POWER = 1e-6  # 1/m, of lenses together; less is rounding
_ALMOST = 0.05  # of a modulator's own image, in a plane that still is much like its Fourier plane


@dataclass(frozen=True)
class RayWay:
    """The way from a modulator to the camera.

    steps: of each its kind and length, m. behind_m: by how much the free space to the camera is shorter than its stated
    distance. gap: the index of the space whose length an alignment seeks; None without one. offset_m: place (y, x) of
    the modulator's centre.
    """

    steps: tuple[tuple[str, float], ...] = ()
    behind_m: float = 0.0
    gap: int | None = None
    offset_m: tuple[float, float] = (0.0, 0.0)

    @property
    def gap_m(self) -> float:
        """The nominal length of the space that an alignment seeks; 0 without one."""
        return 0.0 if self.gap is None else self.steps[self.gap][1]

    def traced(self, place: Floats, sine: Floats, distance_m: float, gap_m: float) -> Floats:
        """Where rays (…, 2) meet the camera at a stated distance. place: from the modulator's centre.

        gap_m: the length of the space that is sought.
        """
        place = place + np.array(self.offset_m)
        return self._traced(
            place, sine, distance_m, gap_m, lambda s: s / np.sqrt(1 - (s**2).sum(axis=-1, keepdims=True))
        )

    def matrix(self, distance_m: float, gap_m: float | None = None) -> tuple[float, float]:
        """A and B (m) at a stated distance of the camera. gap_m: of the sought space, nominal if None."""
        unit = np.eye(2)
        a, b = self._traced(unit[0], unit[1], distance_m, self.gap_m if gap_m is None else gap_m, lambda s: s)
        return float(a), float(b)

    @property
    def has_lens(self) -> bool:
        """Whether a lens stands on it."""
        return any(kind == _LENS for kind, _ in self.steps)

    @property
    def focal_length_m(self) -> float | None:
        """B where A is 0, of a way to a Fourier plane of the modulator; None of other ways."""
        a, b, c, d = self._growing()
        return b - a * d / c if c else None

    @property
    def focus_m(self) -> float:
        """The stated distance of the camera in a Fourier plane of the modulator; only of ways to one."""
        a, _, c, _ = self._growing()
        return -a / c

    def stage_m(self, length_m: float, stage_m: tuple[float, float]) -> float:
        """The distance of the camera, within the stage's range, at which it sees `length_m` behind the modulator best.

        Where the modulator's Fourier plane can be reached, or almost, that plane.
        """
        a, b, c, d = self._growing()
        if c:
            place_m = float(np.clip(-a / c, *stage_m))
            if abs(a + c * place_m) < _ALMOST:
                return place_m
        return float(np.clip((length_m * a - b) / (d - length_m * c), *stage_m))

    def _growing(self) -> tuple[float, float, float, float]:
        """A and B at the distance 0, and by how much they grow with each metre of it."""
        (a, b), (a1, b1) = self.matrix(0.0), self.matrix(1.0)
        return a, b, a1 - a if abs(a1 - a) > _LEAST_POWER else 0.0, b1 - b

    def _traced(
        self, place: Floats, sine: Floats, distance_m: float, gap_m: float, slope: Callable[[Floats], Floats]
    ) -> Floats:
        q, s = place, sine
        for number, (kind, length_m) in enumerate((*self.steps, (_SPACE, distance_m - self.behind_m))):
            if kind == _SPACE:
                q = q + (gap_m if number == self.gap else length_m) * slope(s)
            elif kind == _LENS:
                s = s - q / length_m
            else:
                q, s = length_m * s, -q / length_m
        return q


def way_to_camera(rig: RigDescription, number: int, wavelength_m: float) -> RayWay:
    """The nominal way from the modulator of this number to the camera.

    Its gap is the space behind modulator 1 of a short form, and of a chain the first space between the two modulators
    that make dots (`RigDescription.dotted`).
    """
    chain, bench = rig.bench.chain, rig.bench
    if chain is None:
        if bench.focal_length_m is not None:
            return RayWay(((_FOURIER, bench.focal_length_m),))
        return RayWay(((_SPACE, bench.gap_m or 0.0),), gap=0) if number + 1 < len(bench.slms) else RayWay()
    index, steps, gap = chain.part(rig.modulator_names[number]), list[tuple[str, float]](), None
    for name, element in list(zip(chain.element_names, chain.elements, strict=True))[index:]:
        if isinstance(element, Space) and element.distance_m is not None:
            gap = len(steps) if name == rig.gap_space else gap
            steps.append((_SPACE, element.distance_m))
        elif isinstance(element, Lens):
            steps.append((_LENS, element.focal_length_at(wavelength_m)))
        elif isinstance(element, Fourier):
            steps.append((_FOURIER, element.focal_length_m))
    return RayWay(tuple(steps), chain.way.behind_m, gap, chain.elements[index].offset_m)  # type: ignore[attr-defined]


def mask_in_the_light(rig: RigDescription) -> str:
    """A mask of a chain, whose speckle hides gratings and dots, in words; "" without one."""
    chain = rig.bench.chain
    named = () if chain is None else zip(chain.element_names, chain.elements, strict=True)
    return next((f"{name}, of kind {e.kind}" for name, e in named if isinstance(e, Mask)), "")


def arms_beside(rig: RigDescription, name: str) -> tuple[str, ...]:
    """The names of the elements that stand beside one in the other arms of an interferometer."""
    chain = rig.bench.chain
    if chain is None:
        return ()
    beside = {own: getattr(e, "beside", "") for own, e in zip(chain.element_names, chain.elements, strict=True)}

    def first(own: str) -> str:
        return first(beside[own]) if beside[own] else own

    return tuple(own for own in beside if own != name and first(own) == first(name))


def settings_beside(rig: RigDescription, number: int, wavelength_m: float) -> list[list[Levels]]:
    """Patterns of all modulators around a pattern of the one of a number: the mean of the pictures has no interference.

    All let the light through. A phase modulator in another arm is flat, once half a wave behind, so that its light
    interferes with the pattern's with either sign; one of amplitude is dark.
    """
    patterns = [rig.clear_levels]
    for arm in arms_beside(rig, rig.modulator_names[number]):
        if arm not in rig.modulator_names:
            continue
        k = rig.modulator_names.index(arm)
        slm = rig.bench.slms[k]
        if not slm.opd_range_m:
            patterns[0][k][:] = 0
            continue
        half = round(min(wavelength_m / (2 * slm.opd_range_m), 1.0) * (slm.num_levels - 1))
        patterns = [patterns[0], [own.copy() for own in patterns[-1]]]
        patterns[1][k][:] = half
    return patterns
