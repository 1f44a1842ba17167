"""Modulator and camera of a virtual bench as slmsuite's own classes, so that slmsuite's code runs on our light.

    slm = VirtualSLM("rig.toml")                                          # starts the bench
    camera = VirtualCamera("rig.toml", address=slm.address, token=slm.token)
    FourierSLM(camera, slm).fourier_calibrate(array_shape=5, array_pitch=5)

slmsuite knows no lasers, no stage and no clock of its own. The modulator switches a laser on while it is open, and the
bench's clock advances with the time that passes between calls, so that slmsuite's waits end; computing the light takes
no time there. With `live=False` only exposures and `wait` take time.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.rig.description import RigDescription, read_rig
from holoview.bench.rig.devices import Counts, DeviceError, Levels
from holoview.bench.rig.virtual.client import Packet, VirtualBenchProcess, ask, connect
from holoview.util.errors import UserError
from holoview.util.packages import import_optional

try:
    from slmsuite.hardware.cameras.camera import Camera
    from slmsuite.hardware.slms.slm import SLM
except (ImportError, OSError):  # the classes below name the extra that brings it
    Camera = SLM = object

_FIRST_EXPOSURE_S = 1e-3
Address = tuple[str, int]


class VirtualBenchLink:
    """A connection to a virtual bench. rig: its rig.toml. address, token: of one that runs; None starts one.

    live: whether the time that passes between messages passes on the bench as well. is_open: until it is closed.
    """

    def __init__(
        self, rig: str | os.PathLike[str], address: Address | None, token: str | None, live: bool = True
    ) -> None:
        import_optional("slmsuite", "the virtual bench's devices for slmsuite")
        self.rig: RigDescription = read_rig(rig, is_registered=False)
        self._live, self.is_open = live, True
        if (address is None) != (token is None):
            raise UserError("virtual bench", "address or token alone", expected="both, or neither")
        self._process = VirtualBenchProcess(Path(rig)) if address is None else None
        if self._process is not None:
            address, token = self._process.address, self._process.token
        assert address is not None and token is not None
        self.address: Address = (str(address[0]), int(address[1]))
        self.token = token
        try:
            self._connection = connect(self.address, token)
        except DeviceError:
            if self._process is not None:
                self._process.close()
            raise

    def ask(self, table: dict[str, Any], array: Levels | None = None) -> Packet:
        """Sends a message and returns the answer."""
        return ask(self._connection, {**table, "live": self._live}, array)

    def close(self) -> None:
        """Ends the connection, and the bench that it started; twice is once."""
        self.is_open = False
        self._connection.close()
        if self._process is not None:
            self._process.close()


class VirtualSLM(SLM):  # type: ignore[misc]
    """A modulator of a virtual bench. It switches a laser on, and off when it is closed.

    rig: rig.toml. number: from 1, of a chain in the order of its elements that show patterns. wavelength_nm: of the
    laser; None: the shortest. power: relative, within the limits.
    address, token: of a bench that runs; None starts one, which the SLM's own address and token then name.
    live: whether time on the bench goes on between calls.

    The amplitude modulators of a chain let the light through.
    A phase is shown as the optical path that delays the light by so much: `gamma` is the nominal response of rig.toml.
    """

    _gamma_sign = +1

    def __init__(
        self,
        rig: str | os.PathLike[str],
        *,
        number: int = 1,
        wavelength_nm: float | None = None,
        power: float = 1.0,
        address: Address | None = None,
        token: str | None = None,
        live: bool = True,
        **arguments: Any,
    ) -> None:
        self._link = VirtualBenchLink(rig, address, token, live)
        self.address, self.token = self._link.address, self._link.token
        self._number, facts = number - 1, self._link.rig
        self._wavelength_m = _laser(facts, wavelength_nm)
        if not 1 <= number <= len(facts.bench.slms):
            raise UserError("number", f"{number}", expected=f"1 … {len(facts.bench.slms)}, as {rig} has modulators")
        facts.limits.require_power(power)
        slm, name = facts.bench.slms[self._number], facts.modulator_names[self._number]
        if not slm.opd_range_m:
            expected = "a phase modulator, as slmsuite's modulators are"
            raise UserError(f"{rig}: {name}", "an amplitude modulator", expected=expected)
        bits = (slm.num_levels - 1).bit_length()
        if slm.num_levels != 2**bits:
            where = f"{rig}: {name}.num_levels"
            raise UserError(where, f"{slm.num_levels}", expected="a power of two, which slmsuite's modulators have")
        self._link.ask({"do": "laser", "wavelength": self._wavelength_m, "power": power})
        for k, (own, clear) in enumerate(zip(facts.bench.slms, facts.clear_levels, strict=True)):
            if not own.opd_range_m:
                self._link.ask({"do": "show", "slm": k}, clear)
        super().__init__(
            facts.slm_shapes[self._number][::-1],
            bitdepth=bits,
            name=f"virtual {name}",
            wav_um=self._wavelength_m * 1e6,
            pitch_um=slm.pitch_m * 1e6,
            **arguments,
        )
        self.set_gamma(np.linspace(0.0, slm.opd_range_m / self._wavelength_m, slm.num_levels))
        self.set_phase(None)

    def wait(self, seconds: float) -> None:
        """Lets time pass on the bench."""
        self._link.ask({"do": "wait", "seconds": seconds})

    def close(self) -> None:
        """Switches the laser off and ends the connection, and the bench that it started; twice is once."""
        if not self._link.is_open:  # slmsuite closes forgotten devices once more
            return
        try:
            self._link.ask({"do": "laser", "wavelength": None})
        finally:
            self._link.close()

    def _set_phase_hw(self, display: NDArray[Any]) -> None:
        self._link.ask({"do": "show", "slm": self._number}, display)


class VirtualCamera(Camera):  # type: ignore[misc]
    """The camera of a virtual bench. rig, address, token, live: as of `VirtualSLM`."""

    def __init__(
        self,
        rig: str | os.PathLike[str],
        *,
        address: Address | None = None,
        token: str | None = None,
        live: bool = True,
        **arguments: Any,
    ) -> None:
        self._link = VirtualBenchLink(rig, address, token, live)
        facts = self._link.rig
        self._set_exposure_hw(float(np.clip(_FIRST_EXPOSURE_S, *facts.limits.exposures_s)))
        super().__init__(
            facts.camera_shape[::-1],
            bitdepth=facts.bench.camera.bit_depth,
            pitch_um=facts.bench.camera.pitch_m * 1e6,
            name="virtual camera",
            exposure_bounds_s=facts.limits.exposures_s,
            **arguments,
        )

    @staticmethod
    def info(verbose: bool = True) -> list[str]:
        """The cameras that can be opened: each bench has its own, which its rig.toml names, and none is listed."""
        return []

    def flush(self, timeout_s: float = 1.0) -> None:
        """Nothing waits in a buffer: each picture is exposed after it is asked for."""

    def close(self) -> None:
        """Ends the connection, and the bench that it started."""
        self._link.close()

    def _get_exposure_hw(self) -> float:
        return self._exposure_hw_s

    def _set_exposure_hw(self, exposure_s: float) -> None:
        self._link.rig.limits.require_exposure(exposure_s)
        self._exposure_hw_s = float(self._link.ask({"do": "expose", "exposure": exposure_s}).table["exposure"])

    def _get_image_hw(self, timeout_s: float) -> Counts:
        picture = self._link.ask({"do": "take"}).array
        if picture is None:
            raise DeviceError("camera", "sent no picture")
        return picture


def _laser(rig: RigDescription, wavelength_nm: float | None) -> float:
    """The wavelength (m) of the laser that is meant."""
    if wavelength_nm is None:
        return rig.wavelengths_m[0]
    for wavelength_m in rig.wavelengths_m:
        if abs(wavelength_m * 1e9 - wavelength_nm) < 1e-6 * wavelength_nm:
            return wavelength_m
    known = ", ".join(f"{λ * 1e9:g}" for λ in rig.wavelengths_m)
    raise UserError("wavelength_nm", f"{wavelength_nm:g}", expected=f"one of {known}, the lasers of {rig.path}")
