"""What an eye costs: a new focal plane beside a pupil that is moved, and iterations for one pupil beside several.

    OMP_NUM_THREADS=1 python -m benchmarks.eye_costs --size 1024x768

All is done in turn in one process, so that other load on the machine slows all alike. Times are processor times of
this process, medians; on a software adapter they include the shaders.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from itertools import count

import numpy as np

from benchmarks.common import count_of, markdown_table, shape_of
from holoview.holograms.optimise.checkpoint import IterationState
from holoview.holograms.optimise.eyes import OptimisedEyes, target_at_places
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.holograms.view import random_drive
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.gpu.device import open_device
from holoview.light.model import preset
from holoview.light.model.system import System
from holoview.viewer.document.target_builder import example_target

_PUPILS = ("", "2x2:0.8mm", "3x3:0.6mm", "random:4:0.8mm")
_WARM_UP = 2


def main() -> None:
    """Prints both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="holochrome-8")
    parser.add_argument("--size", type=shape_of, default=(192, 256), help="simulated samples, x by y (256x192)")
    parser.add_argument("--repeats", type=count_of, default=7)
    args = parser.parse_args()
    rows, columns = (side // 2 for side in args.size)
    system = preset.load(args.preset).with_(shape=[rows, columns], eye={"pupil": "2 mm", "chromatic_axis": "pupil"})
    print(_table(_medians(_edits(system), args.repeats), "new focal plane"), end="\n\n")
    periodic = system.with_(propagation="periodic")
    print(_table(_medians({text or "one": _iterations(periodic, text) for text in _PUPILS}, args.repeats), "one"))


def _edits(system: System) -> dict[str, Callable[[], None]]:
    """Edits of a picture that is rendered by shaders, each followed by its new picture."""
    renderer = IncrementalRenderer(system, random_drive(system), open_device(None))
    steps = count(1)

    def refocus() -> None:
        renderer.edit(plane_m=float(system.planes_m[0]) + 1e-5 * (next(steps) % 100))
        _finish(renderer)

    def move_pupil() -> None:
        renderer.edit(system=renderer.system.edit({"eye.pupil_x": 1e-5 * (next(steps) % 100)}))
        _finish(renderer)

    def switch_chromatic() -> None:
        renderer.edit(system=renderer.system.edit({"eye.chromatic": next(steps) % 2 == 0}))
        _finish(renderer)

    return {"new focal plane": refocus, "pupil moved": move_pupil, "colour error on or off": switch_chromatic}


def _finish(renderer: IncrementalRenderer) -> None:
    renderer.update()
    renderer.srgb8()


def _iterations(system: System, pupils: str) -> Callable[[], None]:
    """Iterations of an optimisation for the still life, one with each call."""
    eyes = OptimisedEyes.from_text(pupils or None, "compensate")
    places = eyes.places_in(system)
    settings = places.in_settings(Settings(iterations=10_000))
    states: Iterator[IterationState] = iterate(system, target_at_places(example_target(), system, places), settings)

    def advance() -> None:
        next(states)

    return advance


def _medians(tasks: dict[str, Callable[[], None]], repeats: int) -> dict[str, float]:
    """Processor time (s) of each task, done in turn."""
    seconds: dict[str, list[float]] = {name: [] for name in tasks}
    for number in range(_WARM_UP + repeats):
        for name, task in tasks.items():
            began = time.process_time()
            task()
            if number >= _WARM_UP:
                seconds[name].append(time.process_time() - began)
    return {name: statistics.median(samples) for name, samples in seconds.items()}


def _table(medians: dict[str, float], reference: str) -> str:
    shares = np.array(list(medians.values())) / medians[reference]
    rows = [(name, f"{1e3 * s:.1f}", f"{ratio:.2f}") for (name, s), ratio in zip(medians.items(), shares, strict=True)]
    return markdown_table(("", "ms of processor time", f"times {reference}"), rows)


if __name__ == "__main__":
    main()
