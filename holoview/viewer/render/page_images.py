"""The images of the pages "phase", "field" and "spectrum": the phase of a pattern, a complex field, the eyebox.

`PageImages` keeps the displayed ones on the device, and the spectrum of a camera's recording. They are computed in
torch, which takes a second to import: call `phase_turns` and `eyebox_xyz` on a worker thread.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.colour import SRGB_TO_XYZ, srgb_decode
from holoview.light.engine.frame import spectrum_behind_modulators
from holoview.light.gpu.device import Device
from holoview.light.model.elements import PhaseModulator
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.util.mailbox import LatestTask
from holoview.viewer.render.scene import DeviceImage, Drive, Scene, uploaded_image
from holoview.viewer.render.tone_mapping import field_picture
from holoview.viewer.render.view_settings import ViewSettings

Xyz = NDArray[np.float32]
_DECADES = 6.0  # of power that the picture of a recording's spectrum spans


@dataclass(frozen=True, eq=False)
class SeenField:
    """The picture of a field (y, x, 3) in XYZ, its values (y, x), and the meaning of its colours, in words.

    values: complex; of an intensity of all lasers their Y.
    """

    xyz: Xyz
    values: NDArray[np.inexact]
    scale: str


class PageImages:
    """Images of derived pages, each computed on a thread; the image before stays until the new one is ready.

    deliver: has the owner make a call. on_error: called by the owner with the exception.
    seen_field: the newest of the page "field".
    """

    def __init__(
        self, device: Device, deliver: Callable[[Callable[[], None]], None], on_error: Callable[[BaseException], None]
    ) -> None:
        self._device = device
        self._pictures: dict[str, DeviceImage] = {}
        self._tasks: dict[str, LatestTask[Xyz | SeenField]] = {
            page: LatestTask(f"page {page}", deliver, on_error) for page in ("phase", "field", "spectrum", "recording")
        }
        self.seen_field: SeenField | None = None

    @property
    def is_busy(self) -> bool:
        """Whether an image is being computed."""
        return any(task.is_busy for task in self._tasks.values())

    def picture(self, scene: Scene, view: ViewSettings) -> DeviceImage | None:
        """The image of the page of the view settings; None until it is computed."""
        if view.page == "phase":
            self._request("phase", (scene.system, scene.drive, view.frame, view.modulator), _phase_xyz)
        if view.page == "field":
            self._request("field", _field_key(scene, view), _seen_field)
        if view.page == "spectrum":
            system = scene.system.with_(eye=None)  # the eyebox doesn't depend on where the pupil is
            self._request("spectrum", (system, scene.drive, scene.system.eye is not None), eyebox_xyz)
        return self._pictures.get(view.page)

    def recording(self, pictures: NDArray[np.float32], wavelength: int) -> DeviceImage | None:
        """The power spectrum of the first of a recording's pictures, 0 in the middle; None until it is computed."""
        self._request("recording", (wavelength, pictures), _recording_xyz)
        return self._pictures.get("recording")

    def close(self) -> None:
        """Ends the threads."""
        for task in self._tasks.values():
            task.close()

    def _request(self, page: str, inputs: tuple[Any, ...], compute: Callable[..., Xyz | SeenField]) -> None:
        """Has the image of a page computed from its inputs, unless they are those of the newest request."""
        self._tasks[page].submit(partial(compute, *inputs), partial(self._put, page), inputs)

    def _put(self, page: str, result: Xyz | SeenField) -> None:
        if isinstance(result, SeenField):
            self.seen_field = result
        xyz = result.xyz if isinstance(result, SeenField) else result
        self._pictures[page] = uploaded_image(self._device, xyz, page)


def _phase_xyz(system: System, drive: Drive, frame: int, modulator: int) -> Xyz:
    """The phase of a pattern in turns (y, x, 3), thrice, as the shader of images reads it."""
    return np.repeat(phase_turns(system, drive, frame, modulator)[..., None], 3, axis=2)


def _field_key(scene: Scene, view: ViewSettings) -> tuple[Any, ...]:
    """The inputs of the page "field"; the focal plane counts behind the stops only."""
    system = scene.system
    stage = view.stage if view.stage in system.stages else "plane"
    is_behind = system.stages.index(stage) > system.stages.index("stop")
    plane_m = scene.plane_m if is_behind else float(system.planes_m[0])
    return system, scene.drive, stage, view.quantity, plane_m, view.solo or 0, view.frame


def _seen_field(
    system: System, drive: Drive, stage: str, quantity: str, plane_m: float, laser: int, frame: int
) -> SeenField:
    from holoview.light.engine.torch_executor import stage_field, stage_xyz

    if quantity == "intensity":
        seen = stage_xyz(system, drive, stage, plane_m)
        return SeenField(seen.astype(np.float32), seen[..., 1], f"intensity at {stage}: all lasers that are on")
    field = stage_field(system, drive, stage, plane_m, laser=laser, frame=frame)
    picture = field_picture(field.values, quantity)
    xyz = (srgb_decode(picture.srgb8 / 255) @ SRGB_TO_XYZ.T).astype(np.float32)
    note = f"; {field.note}" if field.note else ""
    return SeenField(xyz, field.values, f"{stage}, {field.wavelength_m * 1e9:.4g} nm: {picture.scale}{note}")


def _recording_xyz(wavelength: int, pictures: NDArray[np.float32]) -> Xyz:
    """The picture XYZ (y, x, 3) of the spectrum of a recording's first picture, grey over `_DECADES` of power."""
    from holoview.holograms.fields.demodulation import recording_spectrum  # slow start: it imports scipy

    power = recording_spectrum(pictures[0, wavelength])
    level = np.clip(1 + np.log10(np.maximum(power / power.max(), 1e-30)) / _DECADES, 0, 1) if power.any() else power
    return (srgb_decode(level)[..., None] * SRGB_TO_XYZ.sum(axis=1)).astype(np.float32)


def phase_turns(system: System, drive: Drive, frame: int, modulator: int) -> NDArray[np.float32]:
    """Phase (y, x) of a modulator's pattern at the median wavelength, in turns modulo 1: 2π radians are one turn.

    Of a field the phase of its values there; modulator is 0. Of a chain of elements that of the one among those that
    show patterns; of an amplitude modulator its amplitude in place of the phase.
    """
    if system.is_chain:
        return _turns_of_element(system, drive, frame, modulator)
    if system.is_field:
        middle = int(np.argsort(system.wavelengths_m)[len(system.wavelengths_m) // 2])
        turns_of_field: NDArray[np.float32] = (np.angle(drive[frame, middle]) / (2 * np.pi) % 1.0).astype(np.float32)
        return turns_of_field
    import torch  # slow start: a viewer begins with neither image

    from holoview.light.optics.slm import optical_path

    wavelength_m = float(np.sort(system.wavelengths_m)[len(system.wavelengths_m) // 2])
    path_m = optical_path(torch.from_numpy(drive[frame, modulator].copy()), system.modulators[modulator])
    turns: NDArray[np.float32] = torch.remainder(path_m / wavelength_m, 1.0).numpy()
    return turns


def _turns_of_element(system: System, drive: Drive, frame: int, number: int) -> NDArray[np.float32]:
    name = list(system.drive_shapes)[number]
    element, patterns = system.elements[system.part(name)], drive[name][min(frame, len(drive[name]) - 1)]
    if isinstance(element, PhaseModulator):
        wavelength_m = float(np.sort(system.wavelengths_m)[len(system.wavelengths_m) // 2])
        shown = patterns * (element.stroke_m / wavelength_m) % 1.0
    else:
        shown = np.angle(patterns) / (2 * np.pi) % 1.0 if np.iscomplexobj(patterns) else patterns
    turns: NDArray[np.float32] = shown.astype(np.float32)
    return turns


def eyebox_xyz(system: System, drive: Drive, by_place: bool = False) -> NDArray[np.float32]:
    """XYZ (y, x, 3) of the light in the first diffraction order of the finest pixels: the eyebox.

    By spatial frequency, 0 is in the middle and the edges are at ±1/(2·pitch), where the angle of a laser is
    ±λ/(2·pitch). By place behind an eyepiece, it is a square up to the edge of the longest wavelength; the others fill
    less of it.
    The light is taken behind the last stops and includes the envelope of a pixel's aperture; it is scaled to a
    mean luminance of 1/4. Without Fourier planes the grid isn't padded, so the resolution is one period of the
    grid. The eye of the system doesn't count.
    """
    from holoview.light.engine.torch_executor import TorchExecutor
    from holoview.light.optics.frame_inputs import FrameInputs
    from holoview.light.optics.slm import eyebox_order

    unpadded = {} if system.way.kernels else {"propagation": "periodic"}
    plan = make_plan(system.edit({**unpadded, "eye": None}))
    executor, order = TorchExecutor(plan, FrameInputs(plan, drive)), eyebox_order(plan)
    rows, columns = order.bins
    shape = (max(len(rows), len(columns)),) * 2 if by_place else (len(rows), len(columns))
    xyz = np.zeros((*shape, 3))
    band = np.ix_(
        *(k % padded for k, padded in zip(executor.frequencies(plan.way.last), plan.grid.padded, strict=True))
    )
    power = np.zeros(plan.grid.padded)
    for wavelength, λ in enumerate(plan.system.wavelengths_m):
        for frame in plan.lit(wavelength):
            for source in range(len(plan.slopes)):
                spectrum = spectrum_behind_modulators(executor, wavelength, frame, source)
                passed = executor.transmit(spectrum, plan.way.last, wavelength)
                power[band] = passed.values.abs().square().numpy()
                seen = power[np.ix_(rows, columns)]
                if by_place:
                    seen = _by_place(seen, float(λ / plan.system.wavelengths_m.max()))
                share = float(plan.weights[frame, wavelength]) / len(plan.slopes)
                xyz += share * seen[..., None] * plan.colour_weights[wavelength]
    mean = xyz[..., 1].mean()
    return (xyz / (4 * mean) if mean > 0 else xyz).astype(np.float32)


def _by_place(power: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """A first order (y, x), by frequency, as a square picture of the eyebox whose sum is the same.

    factor: side of this wavelength's eyebox over that of the picture, at most 1. Linear interpolation.
    """
    side, matrices = max(power.shape), []
    for n in power.shape:
        at = (np.arange(side) - side // 2) * (n / (side * factor)) + n // 2
        below = np.floor(at).astype(int)
        matrix = np.zeros((side, n))
        for index, weight in ((below, 1 - (at - below)), (below + 1, at - below)):
            inside = (index >= 0) & (index < n)
            matrix[np.flatnonzero(inside), index[inside]] += weight[inside]
        matrices.append(matrix * (n / (side * factor)))
    placed: NDArray[np.float64] = matrices[0] @ power @ matrices[1].T
    return placed
