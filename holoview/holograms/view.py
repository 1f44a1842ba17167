"""Simulates what an observer sees of a hologram at each focal plane: `simulate`, `random_drive` and `View`."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.hologram import Hologram
from holoview.light.colour import COLOUR_SPACES, ColourSpace, to_srgb8, xyz_to_linear_srgb
from holoview.light.engine.backend import open_executor, simulation_bytes
from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.light_share import LightShares, figures_of, light_shares, needs_transforms
from holoview.light.model.drives import chain_drives, short_drive
from holoview.light.model.effects.registry import ActiveEffects
from holoview.light.model.elements import ComplexModulator
from holoview.light.model.eye import sample_degrees
from holoview.light.model.focus import focused_planes, parse_planes
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System, bench_of_field
from holoview.light.model.validity import exceeded_limits
from holoview.util.errors import UserError, suggest_matches
from holoview.util.memory_limit import require_memory
from holoview.util.progress import StepCallback

if TYPE_CHECKING:
    from holoview.holograms.files.light_file import PlaneLight
    from holoview.light.engine.point_light import PointLight, Sections
    from holoview.light.engine.torch_executor import StageField

_DRIVE_BYTES = 12  # of a pixel while it is drawn, in float64 and float32


@dataclass(frozen=True)
class View:
    """Images of a hologram at focal planes, over the area of the modulators, or on the retina. Made by `simulate`.

    With an eye, a "plane" is an accommodation: the image of each wavelength is that of the plane on which the eye is
    focused at this wavelength, seen through its pupil.

    intensity: (plane, wavelength, y, x) sum over frames and sources of |field|² · amplitude / (frames · sources). A
    modulator under a uniform wave at amplitude 1 has intensity 1.
    xyz: (plane, y, x, 3) colours, Y = 1 for the white of the display.
    wavelengths_m: (wavelength,) of the intensities; an effect may split a laser's line into several.
    planes_m: (plane,) nominal distances from the last modulator, m; (accommodation, wavelength) with an eye.
    focus_m: (plane,) the same at the eye's reference wavelength; equal to `planes_m` without an eye.
    accommodation_dpt: (accommodation,) vergences of `focus_m` in dioptres; None without an eye.
    degrees_per_sample: visual angle from one sample to the next, degrees; None without an eye.
    pitch_m: distance between samples, the modulator's pitch divided by `upsample`, m.
    backend: the executor that computed the view, in words.
    notes: where the model isn't true of the bench, each as a sentence (docs/physics.md has the limits).
    light: how much of the light is in the whole picture; see `light_in_picture`.
    observer: who sees the colours, as `System.observer` says it.

    >>> import holoview as hv
    >>> system = hv.load("holochrome-8").with_(shape=[48, 64])
    >>> view = hv.simulate(system, hv.random_drive(system), planes=["5 mm", "10 mm"], backend="torch")
    >>> view.intensity.shape, view.xyz.shape, view.pitch_m, view.backend
    ((2, 8, 96, 128), (2, 96, 128, 3), 4e-06, 'torch, complex64')
    """

    intensity: NDArray[np.floating]
    xyz: NDArray[np.floating]
    wavelengths_m: NDArray[np.float64]
    planes_m: NDArray[np.float64]
    pitch_m: float
    backend: str
    focus_m: NDArray[np.float64]
    accommodation_dpt: NDArray[np.float64] | None = None
    degrees_per_sample: float | None = None
    notes: tuple[str, ...] = ()
    light: LightShares | None = None
    observer: str = "eye"

    @property
    def light_in_picture(self) -> NDArray[np.float64]:
        """(plane, wavelength): the share of the light that is in the picture, 0…1; NaN where it isn't known.

        The power in the window of the plane, in that behind the last modulator, or of the field, and behind the stops
        of relay 2 and the pupil of an eye, which take light before it is counted. It is of the whole picture, also of a
        view that is `cropped`. Behind stops or a second modulator the first call takes about half of a simulation.

        >>> import holoview as hv, numpy as np
        >>> field = hv.load_field(np.ones((32, 32)) + 0j, pitch="8 um", wavelengths=["532 nm"])
        >>> hv.simulate(field, backend="torch64").light_in_picture.round(6).tolist()
        [[1.0]]
        """
        unknown: NDArray[np.float64] = np.full(self.intensity.shape[:2], np.nan)
        return unknown if self.light is None else self.light.by_wavelength

    @cached_property
    def rgb(self) -> NDArray[np.floating]:
        """Linear sRGB (plane, y, x, 3), not clipped: colours outside the gamut have channels outside 0…1.

        >>> import holoview as hv
        >>> system = hv.load("holochrome-8").with_(shape=[16, 16])
        >>> hv.simulate(system, hv.random_drive(system), backend="torch").rgb.shape[1:]
        (32, 32, 3)
        """
        return xyz_to_linear_srgb(self.xyz)

    @cached_property
    def srgb8(self) -> NDArray[np.uint8]:
        """8-bit sRGB (plane, y, x, 3) for a screen; each channel is clipped to 0…1 first.

        >>> import holoview as hv
        >>> system = hv.load("holochrome-8").with_(shape=[16, 16])
        >>> hv.simulate(system, hv.random_drive(system), backend="torch").srgb8.dtype
        dtype('uint8')
        """
        return to_srgb8(self.rgb)

    def at(self, planes: Sequence[int]) -> View:
        """The view at some of its planes.

        planes: indices of the planes, in the order of the result. Raises IndexError for one that doesn't exist.

        >>> import holoview as hv
        >>> system = hv.load("holochrome-8").with_(shape=[16, 16])
        >>> view = hv.simulate(system, hv.random_drive(system), planes=["5 mm", "10 mm"], backend="torch")
        >>> view.at([1]).planes_m.tolist()
        [0.01]
        """
        chosen = list(planes)
        dioptres = None if self.accommodation_dpt is None else self.accommodation_dpt[chosen]
        return replace(
            self,
            intensity=self.intensity[chosen],
            xyz=self.xyz[chosen],
            planes_m=self.planes_m[chosen],
            focus_m=self.focus_m[chosen],
            accommodation_dpt=dioptres,
            light=None if self.light is None else self.light.at(chosen),
        )

    def cropped(self, region: tuple[int, int, int, int]) -> View:
        """The view in a rectangle of samples.

        region: (x, y, width, height), samples from the upper left corner.

        >>> import holoview as hv
        >>> system = hv.load("holochrome-8").with_(shape=[16, 16])
        >>> view = hv.simulate(system, hv.random_drive(system), planes=["5 mm"], backend="torch")
        >>> view.cropped((4, 0, 20, 10)).xyz.shape
        (1, 10, 20, 3)
        """
        x, y, width, height = region
        rows, columns = slice(y, y + height), slice(x, x + width)
        return replace(self, intensity=self.intensity[..., rows, columns], xyz=self.xyz[:, rows, columns])

    def exposed(self, stops: float) -> View:
        """The view with every intensity and colour multiplied by 2^stops, as a longer exposure has.

        >>> import holoview as hv
        >>> system = hv.load("holochrome-8").with_(shape=[16, 16])
        >>> view = hv.simulate(system, hv.random_drive(system), planes=["5 mm"], backend="torch")
        >>> round(float(view.exposed(1).xyz.sum() / view.xyz.sum()), 3)
        2.0
        """
        factor = 2.0**stops
        return replace(self, intensity=self.intensity * factor, xyz=self.xyz * factor)


def random_drive(system: System, seed: int = 0) -> Any:
    """Independent random patterns, uniform over the stroke, which show as speckle.

    system: the display whose `drive_shape` the patterns have; a field gets random phases.
    seed: the same seed gives the same patterns.

    Returns float32 (frame, modulator, y, x) in 0…1 of the stroke; of a field complex64 (frame, wavelength, y, x); of a
    chain a mapping of patterns (frame, y, x) by the names of its elements, of a complex modulator with random phases.

    >>> import holoview as hv
    >>> hv.random_drive(hv.load("holochrome-8").with_(shape=[48, 64]), seed=1).shape
    (1, 2, 48, 64)
    """
    if system.is_chain:
        return _random_drives(system, seed)
    require_memory("patterns", math.prod(system.drive_shape) * _DRIVE_BYTES, remedy="lower shape or frames")
    drive = np.random.default_rng(seed).random(system.drive_shape, dtype=np.float32)
    return np.exp(2j * np.pi * drive).astype(np.complex64) if system.is_field else drive


def _random_drives(system: System, seed: int) -> dict[str, NDArray[Any]]:
    """Random patterns (frame, y, x) of a chain by the names of its elements."""
    pixels = sum(map(math.prod, system.drive_shapes.values()))
    require_memory("patterns", pixels * _DRIVE_BYTES, remedy="lower shape or frames")
    random, kinds = np.random.default_rng(seed), dict(zip(system.element_names, system.elements, strict=True))
    drives: dict[str, NDArray[Any]] = {}
    for name, shape in system.drive_shapes.items():
        drive = random.random(shape, dtype=np.float32)
        is_complex = isinstance(kinds[name], ComplexModulator)
        drives[name] = np.exp(2j * np.pi * drive).astype(np.complex64) if is_complex else drive
    return drives


def field_at(
    system: System | Hologram,
    drive: Any = None,
    *,
    stage: str = "plane",
    plane: float | str | None = None,
    laser: int = 0,
    frame: int = 0,
    source: int = 0,
) -> StageField:
    """The complex field of one laser at a stage of a frame, in complex128.

    system, drive: as of `simulate`.
    stage: "light", "slm1" (of a field "field"), "gap", "slm2", "stop", "plane", and with an eye "pupil" and "retina".
    plane: the focal plane, metres or text; the middle one of the system when None.
    laser, frame, source: indices of those of the system. Effects may split them into spectral lines, samples of an
    exposure and points, which add in intensity: the field is that of the central ones, and `note` says so.

    Returns a `StageField` with `values` (y, x), without the carrier exp(2πi·z/λ) and the power of the laser; at "stop"
    and "pupil" phases count from the axis. `share` is its share of the light that was asked for. Raises UserError
    for a stage that the system doesn't have, and as `simulate` does.

    >>> import holoview as hv
    >>> system = hv.load("holochrome-8").with_(shape=[16, 16])
    >>> behind = hv.field_at(system, hv.random_drive(system), stage="slm1")
    >>> float(abs(behind.values).round(6).min()), behind.step
    (1.0, (4e-06, 4e-06))
    """
    system, drive = _with_drive(system, drive)
    planes_m = focused_planes(system) if plane is None else parse_planes(system, [plane])
    from holoview.light.engine.torch_executor import stage_field  # slow start: importing torch takes a second

    plane_m = float(planes_m[len(planes_m) // 2])
    return stage_field(system, drive, stage, plane_m, laser=laser, frame=frame, source=source)


def sections(
    system: System | Hologram,
    drive: Any = None,
    *,
    planes: Sequence[float | str] | None = None,
    at: tuple[int, int] | None = None,
    lasers: Sequence[int] | None = None,
    progress: StepCallback | None = None,
) -> Sections:
    """The light in the planes x–z and y–z through a sample of the image.

    system, drive: as of `simulate`.
    planes: their distances, rising, metres or text; those of the system when None.
    at: row and column of the sample; the middle of the image when None.
    lasers: indices of those that are on; all when None. progress: called after each plane.

    Returns `Sections` with `xz` (plane, x, 3) and `yz` (plane, y, 3), XYZ of the intensity. Raises UserError for a
    sample outside the image, planes that don't rise, and as `simulate` does.

    >>> import holoview as hv
    >>> system = hv.load("holochrome-8").with_(shape=[16, 16])
    >>> hv.sections(system, hv.random_drive(system), planes=["9 mm", "10 mm", "11 mm"], at=(8, 20)).xz.shape
    (3, 32, 3)
    """
    system, drive = _with_drive(system, drive)
    planes_m = np.sort(system.planes_m) if planes is None else parse_planes(system, planes)
    if not np.all(np.diff(planes_m) > 0):
        raise UserError("planes", f"{len(planes_m)} that don't rise", expected="distances, the smallest first")
    from holoview.light.engine.point_light import section_steps  # slow start: importing torch takes a second

    for found in section_steps(system, drive, planes_m, _sample(system, at), _lit(system, lasers)):
        if progress is not None:
            progress(round(found.share * len(planes_m)), len(planes_m))
    return found


def point_light(
    system: System | Hologram,
    drive: Any = None,
    *,
    at: tuple[int, int] | None = None,
    plane: float | str | None = None,
    lasers: Sequence[int] | None = None,
    window: int = 64,
    progress: StepCallback | None = None,
) -> PointLight:
    """Which lasers, diffraction orders, directions and areas of the modulators light a sample of the image.

    system, drive: as of `simulate`. at, lasers: as of `sections`.
    plane: the focal plane, metres or text; the middle one of the system when None.
    window: samples across the Hann window around the sample whose spectrum gives the directions.
    progress: called after each beam: each laser of each frame and direction of the source.

    Returns `PointLight` with `intensities` (laser,), `orders` {(y, x): share of the field}, `areas`, XYZ (y, x, 3) of
    the contributions of each modulator's samples, and `directions`, XYZ (window, window, 3). Raises UserError as
    `sections` does.

    >>> import holoview as hv
    >>> system = hv.load("holochrome-8").with_(shape=[16, 16])
    >>> found = hv.point_light(system, hv.random_drive(system), at=(8, 20))
    >>> len(found.areas), round(sum(found.orders.values()), 6)
    (2, 1.0)
    """
    system, drive = _with_drive(system, drive)
    if not 2 <= window <= 4096 or window % 2:
        raise UserError("window", f"{window} samples", expected="an even number from 2 to 4096")
    planes_m = focused_planes(system) if plane is None else parse_planes(system, [plane])
    from holoview.light.engine.point_light import point_steps  # slow start: importing torch takes a second

    plane_m = float(planes_m[len(planes_m) // 2])
    for found in point_steps(system, drive, plane_m, _sample(system, at), _lit(system, lasers), window):
        if progress is not None:
            progress(round(found.share * 1000), 1000)
    return found


def _sample(system: System, at: tuple[int, int] | None) -> tuple[int, int]:
    """Row and column of a sample of the image, the middle one if None. Raises UserError for one outside."""
    rows, columns = system.way.shape
    row, column = (rows // 2, columns // 2) if at is None else at
    if not (0 <= row < rows and 0 <= column < columns):
        raise UserError(
            "at", f"row {row}, column {column}", expected=f"a sample of the {rows} × {columns} of the image"
        )
    return int(row), int(column)


def _lit(system: System, lasers: Sequence[int] | None) -> Sequence[int]:
    """Indices of the lasers that are on, all if None. Raises UserError for one that doesn't exist."""
    count = len(system.wavelengths_m)
    for laser in lasers or ():
        if not 0 <= laser < count:
            raise UserError("lasers", f"{laser}", expected=f"indices from 0 to {count - 1}")
    return range(count) if lasers is None else lasers


def _with_drive(system: System | Hologram, drive: Any) -> tuple[System, Any]:
    """A system and its drive, of which a hologram has both. Raises UserError without a drive."""
    bench = system.system if isinstance(system, Hologram) else system
    if isinstance(system, Hologram) and drive is None:
        drive = system.drive
    if drive is None:
        raise UserError("drive", "is missing", expected="patterns for a system; a hologram has its own")
    return bench, chain_drives(bench, drive) if bench.is_chain else short_drive(bench, drive)


def as_field(hologram: Hologram) -> Hologram:
    """The field behind the last element of a hologram, with the bench from there to the eye, which shows the same.

    hologram: patterns lit by one wave; a field is returned as it is. Effects on the transmission of modulators and on
    the light before them, such as `source_field`, are in the field.

    Returns a `Hologram` whose drive is the field (frame, wavelength, y, x), at the samples of the simulation. Raises
    UserError for several directions of the source, whose fields don't interfere, and for other effects.

    >>> import holoview as hv
    >>> system = hv.load("holochrome-8").with_(shape=[16, 16])
    >>> field = hv.as_field(hv.Hologram(hv.random_drive(system), system))
    >>> field.drive.shape, field.system.modulators[0].pitch_m
    ((1, 8, 32, 32), 4e-06)
    """
    system = hologram.system
    if system.is_field:
        return hologram
    if len(system.source.directions_rad) > 1 or not _ends_at_modulators(system):
        count = len(system.source.directions_rad)
        found = f"{count} directions of the source" if count > 1 else "effects on lasers or relays"
        expected = "one direction, and no effects but those on modulators and the light before them"
        raise UserError("field", found, expected=expected, remedy="take them away with --set")
    from holoview.light.engine.torch_executor import stage_field  # slow start: importing torch takes a second

    way = system.way
    relay, in_order = way.relays[way.last], way.sample_m / way.orders_m[way.last]
    square = relay.square and replace(relay.square, of="")
    if square is not None and not square.half_side_na:
        square = square.scaled(in_order)
    plane_m, last = float(system.planes_m[0]), system.stages[system.stages.index("stop") - 1]
    values = np.empty((system.frames, len(system.wavelengths_m), *way.shape), np.complex64)
    for frame, laser in np.ndindex(*values.shape[:2]):
        values[frame, laser] = stage_field(system, hologram.drive, last, plane_m, laser=laser, frame=frame).values
    changes = {"planes_m": system.planes_m - way.behind_m, "relay2": replace(relay, square=square)}
    return Hologram(values, bench_of_field(system, way.sample_m, way.shape, elements=(), planes_from="", **changes))


def _ends_at_modulators(system: System) -> bool:
    """Whether all effects are on the transmission of modulators or the light before them."""
    active, plain = ActiveEffects(system.effect_values), system.edit({"effects": {}})
    return not active.with_hooks("pupil") and active.as_built(system) == plain


def simulate(
    system: System | Hologram,
    drive: Any = None,
    planes: Sequence[float | str] | NDArray[np.float64] | None = None,
    backend: str = "auto",
    *,
    adapter: str | None = None,
    progress: StepCallback | None = None,
) -> View:
    """The image of a hologram at each focal plane, as an observer sees it.

    system: the display; or a hologram, which holds its own drive.
    drive: (frame, modulator, y, x) patterns in 0…1 of the stroke, an array or a tensor of `system.drive_shape`; of the
    plane of a field the complex field (frame, wavelength, y, x). Or a list of patterns (frame, y, x), one for each
    element that shows some, or a mapping of them by the elements' names (`System.drive_shapes`).
    planes: distances of the focal planes from the last modulator, metres or text such as "10 mm"; those of the system
    when None. With an eye, the planes on which it is focused at its reference wavelength; its accommodations when None.
    backend: "wgpu" (WGSL shaders), "torch" (complex64), "torch64" (complex128), or "auto": wgpu where an adapter is
    found, else torch. `View.backend` says which it was.
    adapter: part of the name of the WebGPU adapter to use.
    progress: called as progress(done, total) while it computes.

    Returns a `View`, whose `notes` tell where the model isn't true of the display. Raises UserError when the drive
    doesn't fit the system, for a wrong distance, when the grid or the stops leave nothing of the patterns to see, and
    when the backend or the adapter isn't available.

    Scalar diffraction by the angular spectrum, band-limited (Matsushima & Shimobaba 2009); frames, directions of the
    source and wavelengths add in intensity. Limits: pixels are squares with a fill factor of 1, polarisation isn't
    modelled, and effects of the camera are left out, as an observer doesn't look through it.

    >>> import holoview as hv
    >>> system = hv.load("holochrome-8").with_(shape=[48, 64])
    >>> view = hv.simulate(system, hv.random_drive(system, seed=0), planes=["10 mm"], backend="torch64")
    >>> view.srgb8[0].shape
    (96, 128, 3)
    """
    system, drive = _with_drive(system, drive)
    plan = make_plan(system, planes)
    needed = simulation_bytes(plan, double=backend == "torch64")
    require_memory("simulation", needed, remedy="lower shape, upsample, frames, planes or wavelengths")
    executor, label = open_executor(plan, drive, backend, adapter, measures_power=needs_transforms(plan))
    intensity, xyz = compute_focal_stack(executor, progress)
    focus_m, eye = np.array([plane.nominal_m for plane in plan.planes]), system.eye
    light = light_shares(plan, drive, intensity, executor.power_behind)
    return View(
        intensity=intensity,
        xyz=xyz,
        wavelengths_m=plan.system.wavelengths_m,
        planes_m=focus_m if eye is None else focus_m[:, None] + plan.focus_shift_m,
        pitch_m=plan.grid.pitch_m,
        backend=label,
        focus_m=focus_m,
        accommodation_dpt=None if eye is None else np.array([plane.accommodation_dpt for plane in plan.planes]),
        degrees_per_sample=None if eye is None else sample_degrees(plan.grid.pitch_m, eye.eyepiece_m),
        notes=exceeded_limits(plan, figures_of(plan, drive, light, focus_m)),
        light=light,
        observer=system.observer,
    )


def save(what: View | Hologram, path: str | os.PathLike[str], colour_space: str = "srgb") -> None:
    """Writes a view as numbers, or a hologram as a hologram file.

    what: a view: by the suffix of `path`, .npz (intensities, XYZ and linear RGB as they are), .exr (32-bit floats: R,
    G, B, X, Y, Z and a channel for each wavelength, a part for each plane), .tif (linear sRGB, 32-bit floats, a page
    for each plane) or .npy (intensities alone). Units, axes and observer are in the file, but for .npy.
    colour_space: "srgb", "p3" or "rec2020", of the linear RGB.

    Raises UserError for another suffix or space, and when the file can't be written.

    >>> import holoview as hv, numpy as np, pathlib, tempfile
    >>> system = hv.load("holochrome-8").with_(shape=[16, 16])
    >>> view = hv.simulate(system, hv.random_drive(system), planes=["5 mm"], backend="torch")
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "view.npz"
    >>> hv.save(view, file)
    >>> bool((np.load(file)["intensity"] == view.intensity).all())
    True
    """
    if isinstance(what, Hologram):
        what.save(path)
        return
    if colour_space not in COLOUR_SPACES:
        remedy = suggest_matches(colour_space, COLOUR_SPACES)
        raise UserError("colour_space", f'"{colour_space}"', expected=", ".join(COLOUR_SPACES), remedy=remedy)
    from holoview.holograms.files.light_writer import write_light  # OpenEXR and TIFF, which a view doesn't need

    write_light(path, light_numbers(what, COLOUR_SPACES[colour_space]))


def light_numbers(view: View, space: ColourSpace, **about: Any) -> PlaneLight:
    """The numbers of a view, with linear RGB of a colour space. about: further JSON values for the file."""
    from holoview.holograms.files.light_writer import make_light  # as in `save`

    return make_light(
        view.intensity,
        view.xyz,
        view.wavelengths_m,
        view.focus_m,
        space,
        observer=view.observer,
        pitch_m=view.pitch_m,
        degrees_per_sample=view.degrees_per_sample,
        backend=view.backend,
        notes=list(view.notes),
        **about,
    )
