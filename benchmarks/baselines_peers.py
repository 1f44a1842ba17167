"""Other libraries on a case that all support: one wavelength, one modulator, some planes, MSE of intensity, Adam.

odak (learn.wave) and torchoptics are used as their documentation shows. Modulator pixels are squares of samples, as in
holoview, which needs neither library; those that aren't installed aren't measured. `padding` is 1 (none) or 2 (twice
the field).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from contextlib import chdir, redirect_stderr
from importlib.metadata import PackageNotFoundError, version
from io import StringIO
from tempfile import TemporaryDirectory
from typing import Any

import torch

from holoview.evidence.benchmark.autograd_loop import Work

Tensor = torch.Tensor
Propagate = Callable[[Tensor, float], Tensor]
"""A field (y, x) and a distance (m) to the field there."""

LIBRARIES = ("odak", "torchoptics")
ODAK_KINDS = {1: "Angular Spectrum", 2: "Bandlimited Angular Spectrum"}
"""odak's propagation by padding: with the band limit where ours has it."""


def installed(library: str) -> str | None:
    """The version of a library, or None if it isn't installed."""
    try:
        return version(library)
    except PackageNotFoundError:
        return None


class Peer:
    """Optimises the modulator's phase by PyTorch's Adam with the propagation of a library."""

    def __init__(self, work: Work, propagate: Propagate) -> None:
        modulator = work.system.modulators[0]
        self.upsample = work.system.sampling.upsample
        self.planes_m = [float(z) for z in work.system.planes_m]
        self.target = torch.from_numpy(work.stack[..., 0]).contiguous()
        turn = 2 * math.pi * modulator.stroke_m / float(work.system.wavelengths_m[0])
        self.phase = (turn * torch.tensor(work.drive[0, 0])).requires_grad_()
        self.adam = torch.optim.Adam([self.phase], lr=0.1)
        self._propagate = propagate

    def step(self) -> float:
        """Make one iteration and return the loss before the step."""
        self.adam.zero_grad()
        loss = self.loss()
        loss.backward()
        self.adam.step()
        return loss.item()

    def loss(self) -> Tensor:
        phase = self.phase.repeat_interleave(self.upsample, dim=-2).repeat_interleave(self.upsample, dim=-1)
        field = torch.polar(torch.ones_like(phase), phase)
        fields = [self._propagate(field, z) for z in self.planes_m]
        return torch.nn.functional.mse_loss(torch.stack([f.abs().square() for f in fields]), self.target)


def odak_each_time(work: Work, padding: int) -> Peer:
    """odak.learn.wave.propagate_beam, which computes the kernel at each call."""
    wave, pitch_m, λ = _odak(), _pitch(work), _wavelength(work)
    kind, pads = ODAK_KINDS[padding], [padding == 2, False, padding == 2]

    def propagate(field: Tensor, distance_m: float) -> Tensor:
        return wave.propagate_beam(field, wave.wavenumber(λ), distance_m, pitch_m, λ, kind, zero_padding=pads)

    return Peer(work, propagate)


def odak_kept(work: Work, padding: int) -> Peer:
    """odak.learn.wave.propagate_beam with "custom" propagation: odak's kernels, computed once."""
    wave, pitch_m, λ = _odak(), _pitch(work), _wavelength(work)
    pads = [padding == 2, False, padding == 2]
    rows, columns = (n * work.system.sampling.upsample * padding for n in work.system.modulators[0].shape)
    kernels = {
        z: wave.get_propagation_kernel(rows, columns, pitch_m, λ, z, propagation_type=ODAK_KINDS[padding])
        for z in map(float, work.system.planes_m)
    }

    def propagate(field: Tensor, distance_m: float) -> Tensor:
        kernel = kernels[distance_m]
        return wave.propagate_beam(field, 0.0, distance_m, pitch_m, λ, "custom", kernel=kernel, zero_padding=pads)

    return Peer(work, propagate)


def torchoptics_field(work: Work, padding: int) -> Peer:
    """torchoptics.Field.propagate_to_z by angular spectrum, in float32 as the others (its default is float64)."""
    import torchoptics

    torchoptics.set_default_dtype(torch.float32)
    pitch_m, λ = _pitch(work), _wavelength(work)
    pad = [n * work.system.sampling.upsample * (padding - 1) // 2 for n in work.system.modulators[0].shape]

    def propagate(field: Tensor, distance_m: float) -> Tensor:
        wave = torchoptics.Field(field, wavelength=λ, z=0, spacing=pitch_m)
        return wave.propagate_to_z(distance_m, propagation_method="ASM", asm_pad=pad).data

    return Peer(work, propagate)


class OdakOptimiser:
    """odak.learn.wave.multi_color_hologram_optimizer, its multi-plane optimiser, with image loss only, padded twofold.

    It makes one step for each plane, so that an iteration is as many steps as planes. Its pixels are single samples.
    """

    def __init__(self, work: Work) -> None:
        wave = _odak()
        shape = [n * work.system.sampling.upsample for n in work.system.modulators[0].shape]
        wavelengths, planes = [_wavelength(work)], torch.tensor(work.system.planes_m)
        light = wave.propagator(
            resolution=shape,
            wavelengths=wavelengths,
            pixel_pitch=_pitch(work),
            propagator_type="forward",
            distances=planes,
            aperture_size=4 * max(shape),
        )
        self._optimiser = wave.multi_color_hologram_optimizer(
            wavelengths=wavelengths,
            resolution=shape,
            targets=torch.from_numpy(work.stack[..., 0])[:, None].contiguous(),
            propagator=light,
            number_of_frames=1,
            number_of_depth_layers=len(planes),
            double_phase=False,
            method="conventional",
        )
        self._optimiser.init_optimizer()

    def step(self) -> None:
        """Make one iteration, with its progress bars suppressed."""
        with redirect_stderr(StringIO()):
            self._optimiser.gradient_descent(number_of_iterations=1, weights=[1.0, 0.0, 0.0, 0.0])


PEERS: dict[str, tuple[str, Callable[[Work, int], Peer]]] = {
    "odak, propagate_beam": ("odak", odak_each_time),
    "odak, propagate_beam, kernels kept": ("odak", odak_kept),
    "torchoptics, Field.propagate_to_z": ("torchoptics", torchoptics_field),
}
"""Library and constructor of each variant, by name; for both paddings."""


def _odak() -> Any:
    """odak.learn.wave, imported in a temporary working folder, since it creates a log file, and with less logging."""
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder, chdir(folder):
        import odak.learn.wave
    logging.getLogger("odak").setLevel(logging.ERROR)
    return odak.learn.wave


def _pitch(work: Work) -> float:
    return work.system.modulators[0].pitch_m / work.system.sampling.upsample


def _wavelength(work: Work) -> float:
    return float(work.system.wavelengths_m[0])
