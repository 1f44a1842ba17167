"""What a camera in the loop gains on virtual benches that aren't as their nominal model, beside better models.

    python -m benchmarks.rig_camera_loop                    # all benches, some minutes each
    python -m benchmarks.rig_camera_loop --bench gap --iterations 20

On each bench, holograms are optimised with the nominal model, with the diagnosed one, with the calibrated one, and with
the camera in the loop from the nominal and from the diagnosed one, and from the nominal one with updates of the model.
The right model, which nobody knows on a real bench, tells what there is to gain. `--without-diagnosis` leaves out what
takes minutes.

All are shown on the bench and scored by its camera in the same way: PSNR of the linear image against the target, mean
over planes, each laser's power set by least squares from its own pictures, fresh pictures. What is really wrong is
known to the bench's process alone.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures import write_captures
from holoview.bench.captures.dataset import join_captures
from holoview.bench.diagnose.extended_model import extended_system
from holoview.bench.experiment.bench_camera import BenchCamera
from holoview.bench.experiment.camera_loop import CameraLoop, ModelUpdates
from holoview.bench.experiment.rig_bench import on_rig, system_of_rig
from holoview.bench.rig import RigDescription, open_rig, read_rig
from holoview.bench.rig.capture_plan import default_plan
from holoview.bench.rig.measurement import Measurement
from holoview.commands import cli
from holoview.holograms.hologram import Hologram
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.holograms.targets.picture import read_picture
from holoview.holograms.targets.target import Placement, target_for
from holoview.light.model import preset
from holoview.light.model.system import System

PICTURE = Path(__file__).resolve().parent.parent / "assets" / "still-life.png"

_SLM = """device = "virtual"
shape = [48, 64]
pitch = "8 um"
num_levels = 256
opd_range = "825 nm"
settle = 0.1
"""
_REST = """[camera]
device = "virtual"
shape = [96, 128]
pitch = "4 um"
bit_depth = 12
electrons_per_count = 4.0
read_noise = 3.0
black_level = 64
[stage]
device = "virtual"
range = ["0 mm", "5 mm"]
[limits]
power = 1.0
exposure = [1e-5, 0.5]
[virtual]
bench = "hidden.toml"
[lasers]
device = "virtual"
"""
_NOISE = "seed = 3\nsettle = 0.02\nprnu = 0.01\nexposure_jitter = 0.01\n"


@dataclass(frozen=True)
class Bench:
    """A rig and what is really there. wavelengths, geometry: TOML. sequential: whether each laser has a frame."""

    modulators: int
    wavelengths: str
    geometry: str
    planes: tuple[str, ...]
    hidden: str
    sequential: bool = False

    def write(self, folder: Path) -> RigDescription:
        """Writes rig.toml and hidden.toml, and reads the rig."""
        slms = "".join(f"[slm{n}]\n{_SLM}" for n in range(1, self.modulators + 1))
        text = f"{slms}{_REST}wavelengths = {self.wavelengths}\n[geometry]\n{self.geometry}"
        (folder / "rig.toml").write_text(text, encoding="utf-8")
        (folder / "hidden.toml").write_text(_NOISE + self.hidden, encoding="utf-8")
        return read_rig(folder / "rig.toml")


BENCHES = {
    "gap": Bench(
        modulators=2,
        wavelengths='["520 nm"]',
        geometry='gap = "1 mm"\niris1_na = 0.03\niris2_na = 0.03\n',
        planes=("2 mm",),
        hidden='[effects.gap]\ngap_error = "0.2 mm"\n[effects.stroke]\nstroke_error = -0.06\n'
        '[effects.camera_alignment]\nshift_y = "6 um"\nshift_x = "-9 um"\n',
    ),
    "colour": Bench(
        modulators=2,
        wavelengths='["450 nm", "520 nm", "638 nm"]',
        geometry='gap = "1 mm"\niris1_na = 0.03\niris2_na = 0.03\n',
        planes=("2 mm",),
        hidden='[effects.gap]\ngap_error = "-0.15 mm"\n[effects.slm_alignment]\nshift_x = "3 um"\n'
        "[effects.vignetting]\nfall_y = 0.1\nfall_x = 0.15\n",
        sequential=True,
    ),
    "one modulator": Bench(
        modulators=1,
        wavelengths='["520 nm"]',
        geometry="iris2_na = 0.03\n",
        planes=("1 mm", "3 mm"),
        hidden='[effects.distance]\ndistance_error = "0.15 mm"\n[effects.stroke]\nstroke_error = 0.08\n'
        "[effects.crosstalk]\nsigma = 0.4\n",
    ),
}


@dataclass(frozen=True)
class Cost:
    """Pictures (captures, where a session takes them) and seconds of bench time."""

    pictures: int = 0
    bench_s: float = 0.0

    def __add__(self, other: Cost) -> Cost:
        return Cost(self.pictures + other.pictures, self.bench_s + other.bench_s)


Row = tuple[str, Hologram, Cost]
"""What a hologram was optimised with, the hologram, and what that cost."""


class Trial:
    """One bench: its rig, nominal system and target."""

    def __init__(self, bench: Bench, folder: Path, iterations: int) -> None:
        self.folder, self.rig = folder, bench.write(folder)
        system = system_of_rig(self.rig)
        if bench.sequential:
            system = system.edit({"amplitudes": np.diag(3 * system.amplitudes[0])})
        self.nominal = on_rig(system.edit({"planes": list(bench.planes), "propagation": "compact"}), self.rig)
        self.stack = target_for(self.nominal, read_picture(PICTURE), Placement()).stack
        self.iterations = iterations

    def optimised(self, system: System) -> Hologram:
        """The hologram that a model alone finds."""
        *_, last = iterate(system, self.stack, Settings(iterations=60))
        return last.best

    def score(self, hologram: Hologram) -> float:
        """PSNR on the bench, seen by a loop that ends with its first pictures."""
        with self._loop(self.nominal, hologram.drive) as loop:
            return next(iter(loop.states())).psnr_db

    def in_loop(self, system: System, start: Hologram, updates: ModelUpdates | None = None) -> tuple[Hologram, Cost]:
        """The best hologram of a camera loop with a model, and what it cost."""
        with self._loop(system, start.drive, updates) as loop:
            *_, last = loop.states()
        return last.best, Cost(last.pictures, last.bench_s)

    def measured(self) -> Cost:
        """Takes the default session of captures, captures.h5."""
        with open_rig(self.rig) as devices:
            began, session = devices.clock.now(), Measurement(self.rig, devices)
            requests = default_plan(self.rig).requests
            captures = [session.take(request, request.levels(self.rig)) for request in requests]
            bench_s = devices.clock.now() - began
        write_captures(self.folder / "captures.h5", join_captures(captures))
        return Cost(len(captures), bench_s)

    def found(self, *command: str, written: str) -> System:
        """The nominal bench with the effects of the preset that a command wrote."""
        with contextlib.redirect_stdout(sys.stderr):
            assert cli.main([*command]) == 0
        return extended_system(self.nominal, preset.load(str(self.folder / written)).effect_values)

    @contextlib.contextmanager
    def _loop(
        self, system: System, start: NDArray[np.float32], updates: ModelUpdates | None = None
    ) -> Iterator[CameraLoop]:
        settings = Settings(iterations=self.iterations, step_rad=0.05)
        with open_rig(self.rig) as devices:
            camera = BenchCamera(self.rig, devices)
            yield CameraLoop(system, self.stack, settings, self.rig, camera, start, updates=updates)


def known_rows(trial: Trial, bench: Bench) -> Iterator[Row]:
    """What needs neither a session of captures nor a diagnosis."""
    hidden = tomllib.loads(bench.hidden)["effects"]
    right = trial.nominal.edit({f"effects.{name}.{key}": v for name, own in hidden.items() for key, v in own.items()})
    for what, system in (("nominal model", trial.nominal), ("right model", right)):
        hologram = trial.optimised(system)
        yield what, hologram, Cost()
        yield f"{what}, then camera in the loop", *trial.in_loop(system, hologram)


def found_rows(trial: Trial, updates_every: int) -> Iterator[Row]:
    """What needs captures: diagnosis, calibration, updates of the model."""
    folder = trial.folder
    captures, session = str(folder / "captures.h5"), trial.measured()
    command = ("diagnose", captures, "--workers", "1", "--thorough", "--save-preset", str(folder / "diagnosed.toml"))
    diagnosed = trial.found(*command, written="diagnosed.toml")
    print(f"diagnosed: {diagnosed.effect_values}", file=sys.stderr)
    calibrated = trial.found("calibrate", captures, "-o", str(folder / "calibrated.toml"), written="calibrated.toml")
    of_diagnosed = trial.optimised(diagnosed)
    yield "diagnosed model", of_diagnosed, session
    yield "calibrated model", trial.optimised(calibrated), session
    best, cost = trial.in_loop(diagnosed, of_diagnosed)
    yield "diagnosed model, then camera in the loop", best, cost + session
    of_nominal = trial.optimised(trial.nominal)
    best, cost = trial.in_loop(trial.nominal, of_nominal, ModelUpdates(updates_every))
    yield f"nominal model, then camera in the loop, model updated every {updates_every}", best, cost


def run(name: str, iterations: int, updates_every: int, *, diagnose: bool) -> None:
    """Prints the rows of one bench."""
    with tempfile.TemporaryDirectory() as folder:
        trial, base = Trial(BENCHES[name], Path(folder), iterations), math.nan
        rows = known_rows(trial, BENCHES[name])
        for what, hologram, cost in chain(rows, found_rows(trial, updates_every) if diagnose else ()):
            score = trial.score(hologram)
            base = score if math.isnan(base) else base
            gain = f"{score - base:+.2f}"
            print(f"| {name} | {what} | {score:.2f} | {gain} | {cost.pictures} | {cost.bench_s:.0f} |", flush=True)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bench", choices=[*BENCHES], nargs="+", default=[*BENCHES])
    parser.add_argument("--iterations", type=int, default=40, help="of the camera's loop (40)")
    parser.add_argument("--updates-every", type=int, default=20, help="iterations between updates of the model (20)")
    parser.add_argument("--without-diagnosis", action="store_true", help="only what takes a minute")
    args = parser.parse_args()
    print("| bench | optimised with | measured PSNR, dB | gain, dB | pictures | bench time, s |")
    print("| --- | --- | ---: | ---: | ---: | ---: |")
    for name in args.bench:
        began = time.process_time()
        run(name, args.iterations, args.updates_every, diagnose=not args.without_diagnosis)
        print(f"{name}: {time.process_time() - began:.0f} s of processor time", file=sys.stderr)


if __name__ == "__main__":
    main()
