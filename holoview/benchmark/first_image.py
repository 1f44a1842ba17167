"""Time from the start of a process to its first image, with empty caches of shaders and of FFT strategies."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

from holoview.benchmark.frame_benchmark import Criterion
from holoview.model import preset
from holoview.model.system import System

_CACHE_VARIABLES = ("XDG_CACHE_HOME", "MESA_SHADER_CACHE_DIR", "LOCALAPPDATA")
_PROGRAM = """
import sys
from concurrent.futures import ThreadPoolExecutor
from holoview.model import preset
from holoview.gpu.device import open_device
with ThreadPoolExecutor(1) as executor:
    device = executor.submit(open_device, sys.argv[1] or None)
    system = preset.loads(sys.stdin.read())
    from holoview.engine.incremental import IncrementalRenderer
    from holoview.view import random_drive
    drive = random_drive(system)
renderer = IncrementalRenderer(system, drive, device.result())
renderer.update()
renderer.srgb8()
"""


def first_image_s(system: System, adapter: str | None = None) -> float:
    """Seconds from starting Python to an image on the host, with empty caches of holoview and of Mesa's drivers.

    Caches of other drivers aren't emptied.
    """
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | dict.fromkeys(_CACHE_VARIABLES, folder)
        start = time.perf_counter()
        command = [sys.executable, "-c", _PROGRAM, adapter or ""]
        subprocess.run(command, input=preset.dumps(system), text=True, env=environment, check=True)
        return time.perf_counter() - start


def first_image_criterion(system: System, adapter: str | None = None) -> Criterion:
    """The time to the first image of a system without padding, with its limit."""
    periodic = system.edit({"propagation": "periodic"})
    return Criterion("first image from process start, cold cache", first_image_s(periodic, adapter), 5.0, 3.0, "s")
