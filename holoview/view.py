"""What an observer sees of a hologram: the function that the command line, the viewer and notebooks call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.colour import to_srgb8, xyz_to_linear_srgb
from holoview.engine.backend import open_executor
from holoview.engine.frame import ProgressCallback, compute_focal_stack
from holoview.model.plan import make_plan, parse_planes
from holoview.model.system import System


@dataclass(frozen=True)
class View:
    """What is seen at each focal plane.

    intensity (plane, wavelength, y, x): frames and sources averaged, laser amplitudes applied; on the modulator's own
    area at the simulation pitch. xyz (plane, y, x, 3). wavelengths_m (wavelength,), planes_m (plane,), pitch_m: metres.
    Effects of the bench may split wavelengths; planes are called by their nominal distances.
    backend: what computed it, in words.
    """

    intensity: NDArray[np.floating]
    xyz: NDArray[np.floating]
    wavelengths_m: NDArray[np.float64]
    planes_m: NDArray[np.float64]
    pitch_m: float
    backend: str

    @cached_property
    def rgb(self) -> NDArray[np.floating]:
        """Linear sRGB (plane, y, x, 3), neither clipped nor gamut-mapped: it may leave 0…1."""
        return xyz_to_linear_srgb(self.xyz)

    @cached_property
    def srgb8(self) -> NDArray[np.uint8]:
        """Encoded sRGB (plane, y, x, 3), 8 bit; each channel is clipped to the gamut."""
        return to_srgb8(self.rgb)

    def at(self, planes: Sequence[int]) -> View:
        """The view at some of its planes, by their index."""
        chosen = list(planes)
        return replace(self, intensity=self.intensity[chosen], xyz=self.xyz[chosen], planes_m=self.planes_m[chosen])

    def cropped(self, region: tuple[int, int, int, int]) -> View:
        """The view in a region (x, y, width, height), samples."""
        x, y, width, height = region
        rows, columns = slice(y, y + height), slice(x, x + width)
        return replace(self, intensity=self.intensity[..., rows, columns], xyz=self.xyz[:, rows, columns])

    def exposed(self, stops: float) -> View:
        """The view with every intensity multiplied by 2^stops."""
        factor = 2.0**stops
        return replace(self, intensity=self.intensity * factor, xyz=self.xyz * factor)


def random_drive(system: System, seed: int = 0) -> NDArray[np.float32]:
    """Uniform random drive (frame, modulator, y, x) in 0…1, which gives speckle; one seed gives one drive."""
    return np.random.default_rng(seed).random(system.drive_shape, dtype=np.float32)


def simulate(
    system: System,
    drive: Any,
    planes: Sequence[float | str] | NDArray[np.float64] | None = None,
    backend: str = "auto",
    *,
    adapter: str | None = None,
    progress: ProgressCallback | None = None,
) -> View:
    """The view of a drive (frame, modulator, y, x) in 0…1 at `planes` (metres or text; the system's own when None).

    backend: "wgpu" (WGSL shaders), "torch" (complex64), "torch64" (complex128), "auto" (wgpu where an adapter is found,
    else torch; `View.backend` says which). Raises UserError when the drive doesn't fit, for a plane behind the
    modulator, and when the backend isn't available.
    """
    plan = make_plan(system, planes)
    executor, label = open_executor(plan, drive, backend, adapter)
    intensity, xyz = compute_focal_stack(executor, progress)
    return View(
        intensity=intensity,
        xyz=xyz,
        wavelengths_m=plan.system.wavelengths_m,
        planes_m=system.planes_m if planes is None else parse_planes(planes),
        pitch_m=plan.grid.pitch_m,
        backend=label,
    )
