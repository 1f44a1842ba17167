"""The inputs of a frame: optical paths, sampled transmissions and pupils, the same for all executors.

Levels, aberrations and effects are applied here, so that executors know nothing of them. All is computed in torch when
it is asked for; shaders read the drive of a bench without levels, pupils and effects as it is. Importing torch takes a
second, for which the first picture of the viewer doesn't wait.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.drives import chain_drives
from holoview.light.model.plan import Plan
from holoview.light.model.system import System
from holoview.util.errors import UserError

if TYPE_CHECKING:
    import torch

    from holoview.light.optics.chain import ChainTransmissions
    from holoview.light.optics.torch_effects import FieldTransmissions, SampledTransmissions


class FrameInputs:
    """The data from which the frames of a plan are computed.

    drive: (frame, modulator, y, x) in 0…1 of the stroke; for the plane of a field (frame, wavelength, y, x), complex.
    An array, or a tensor, which may require a gradient; of a chain a list or a mapping (`model.drives`). Raises
    UserError when it has another shape than `plan.nominal.drive_shape`, or values outside 0…1, of a field such that
    aren't finite.
    """

    def __init__(self, plan: Plan, drive: Any) -> None:
        self.plan, self._drive = plan, checked_drive(plan.nominal, drive)

    @property
    def drives(self) -> dict[str, Any]:
        """The patterns of a chain by the names of its elements."""
        return self._drive if self.plan.way.is_chain else {}

    @cached_property
    def opd_m(self) -> torch.Tensor:
        """Optical path (frame, modulator, y, x) of each modulator pixel, m, float64; without effects on modulators.

        For all frames of `plan.system`, with its strokes and the factors `plan.moments`.
        """
        from holoview.light.optics.bench import exposure_optical_paths  # slow start: it imports torch

        return exposure_optical_paths(self.plan, self._drive_tensor)

    def path_m(self, frame: int, modulator: int) -> torch.Tensor:
        """The optical path (y, x) of one modulator's pixels in a frame."""
        return self.opd_m[frame, modulator]

    @cached_property
    def pupils(self) -> tuple[tuple[torch.Tensor | None, ...], ...]:
        """pupils[relay][wavelength], (P_y, P_x) complex128, or None where light is only stopped."""
        wavelengths = range(len(self.plan.system.wavelengths_m))
        relays = range(len(self.plan.relays))
        if not _has_pupils(self.plan):
            return ((None,) * len(wavelengths),) * len(relays)
        from holoview.light.optics.bench import pupil_with_effects

        return tuple(tuple(pupil_with_effects(self.plan, relay, i) for i in wavelengths) for relay in relays)

    @cached_property
    def sampled_transmissions(self) -> SampledTransmissions | FieldTransmissions | ChainTransmissions | None:
        """Of modulators whose transmission isn't exp(2πi·opd/λ) of their pixels; None if there is none."""
        if self.plan.way.is_chain:
            from holoview.light.optics.chain import ChainTransmissions

            return ChainTransmissions(self.plan, self._drive)
        if not (self.plan.nominal.effects or self.plan.nominal.is_field):
            return None
        from holoview.light.optics.torch_effects import FieldTransmissions, SampledTransmissions

        if self.plan.nominal.is_field:
            return FieldTransmissions(self.plan, self._drive)
        transmissions = SampledTransmissions(self.plan, self._drive_tensor)
        return transmissions if transmissions.is_any_sampled else None

    def stroke_fractions(self, frame: int, modulator: int, stroke_m: float) -> NDArray[np.float32]:
        """Optical paths of a modulator's pixels (y, x), float32 in units of the stroke, which keeps a drive exact.

        A single 0 for the plane of a field and for a chain, which have none and for which nothing reads them.
        """
        if self.plan.nominal.is_field or self.plan.way.is_chain:
            return np.zeros((1, 1), np.float32)
        is_plain = self.plan.moments == (1.0,) and all(m.levels is None for m in self.plan.system.modulators)
        if is_plain and isinstance(self._drive, np.ndarray) and not self.plan.nominal.effects:
            return np.ascontiguousarray(self._drive[frame, modulator], dtype=np.float32)
        return np.ascontiguousarray((self.opd_m[frame, modulator] / stroke_m).float().cpu().numpy())

    def is_sampled(self, modulator: int) -> bool:
        """Whether the transmission of a modulator isn't exp(2πi·opd/λ) of its pixels."""
        return self.sampled_transmissions is not None and self.sampled_transmissions.is_sampled(modulator)

    def shown_first(self, frame: int, modulator: int) -> int:
        """The first frame in which a modulator has the same transmission, as far as the bench tells."""
        if self.plan.way.is_chain:
            return self.sampled_transmissions.shown_first(frame, modulator)  # type: ignore[union-attr]
        return frame

    def transmission(self, frame: int, modulator: int, wavelength: int) -> torch.Tensor | None:
        """The transmission (y, x) complex128 of a modulator's samples; None if it is exp(2πi·opd/λ) of its pixels."""
        if self.sampled_transmissions is None:
            return None
        return self.sampled_transmissions.sampled_transmission(frame, modulator, wavelength)

    @cached_property
    def _drive_tensor(self) -> torch.Tensor:
        """The drive in float64."""
        from holoview.light.optics.bench import drive_tensor

        return drive_tensor(self._drive) if isinstance(self._drive, np.ndarray) else self._drive.double()


def checked_drive(system: System, drive: Any) -> Any:
    """A drive as `FrameInputs` takes it: an array or a tensor, of a chain those of the elements by name."""
    if system.is_chain:
        return chain_drives(system, drive)
    drive = drive if hasattr(drive, "detach") else np.asarray(drive)
    check = _check_field if system.is_field else _check_fractions
    check(drive, system.drive_shape)
    return drive


def _check_fractions(drive: Any, expected: tuple[int, ...]) -> None:
    """Raises UserError unless a drive, an array or a tensor, is real, has the expected shape and lies in 0…1."""
    if isinstance(drive, np.ndarray):
        values, size = drive, drive.size
        if drive.dtype.kind not in "fiub":
            raise UserError("drive", f"values of type {drive.dtype}", expected="real numbers, 0 to 1 of the stroke")
    else:
        values, size = drive.detach(), drive.numel()
        if drive.is_complex():
            raise UserError("drive", "complex numbers", expected="real numbers, 0 to 1 of the modulator's stroke")
    if tuple(drive.shape) != expected:
        found = f"an array of shape {tuple(drive.shape)}"
        raise UserError("drive", found, expected=f"(frame, modulator, y, x) = {expected}")
    low, high = (float(values.min()), float(values.max())) if size else (0.0, 0.0)
    if not (low >= 0.0 and high <= 1.0):
        raise UserError(
            "drive", f"values from {low:g} to {high:g}", expected="0 to 1, a fraction of the modulator's stroke"
        )


def _check_field(field: Any, expected: tuple[int, ...]) -> None:
    """Raises UserError unless a field, an array or a tensor, is complex, has the expected shape and is finite."""
    is_complex = field.dtype.kind == "c" if isinstance(field, np.ndarray) else field.is_complex()
    if not is_complex:
        raise UserError("field", f"values of type {field.dtype}", expected="complex numbers")
    if tuple(field.shape) != expected:
        found = f"an array of shape {tuple(field.shape)}"
        raise UserError("field", found, expected=f"(frame, wavelength, y, x) = {expected}")
    if not math.isfinite(float(abs(field).max())):
        raise UserError("field", "values that aren't finite (NaN or infinite)", expected="finite numbers")


def _has_pupils(plan: Plan) -> bool:
    """Whether a relay, the eye or an effect may have a pupil that does more than stop light whole."""
    eye, has_kernels = plan.nominal.eye, bool(plan.way.kernels)
    has_pupils = (has_kernels or plan.has_weighted_stops) or any(
        relay.aberration_m or relay.apodisation_na is not None for relay in plan.nominal.way.relays
    )
    return has_pupils or bool(plan.nominal.effects) or (eye is not None and eye.has_pupil_function)
