"""Time to the first picture, from the start of a process, with nothing cached: neither shaders nor choices."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

from holoview.benchmark.frame_benchmark import Criterion
from holoview.model import preset
from holoview.model.system import System

_CACHES = ("XDG_CACHE_HOME", "MESA_SHADER_CACHE_DIR", "LOCALAPPDATA")
_PROGRAM = """
import sys
from concurrent.futures import ThreadPoolExecutor
from holoview.model import preset
from holoview.gpu.device import open_device
with ThreadPoolExecutor(1) as aside:
    device = aside.submit(open_device, sys.argv[1] or None)
    system = preset.loads(sys.stdin.read())
    from holoview.engine.incremental import IncrementalRenderer
    from holoview.view import random_drive
    drive = random_drive(system)
renderer = IncrementalRenderer(system, drive, device.result())
renderer.update()
renderer.srgb8()
"""


def first_image_s(system: System, adapter: str | None = None) -> float:
    """Seconds from starting Python to a picture on the host, with empty caches of holoview and of Mesa's drivers.

    Other drivers keep their own caches, which stay as they are.
    """
    with tempfile.TemporaryDirectory() as empty:
        environment = os.environ | dict.fromkeys(_CACHES, empty)
        start = time.perf_counter()
        command = [sys.executable, "-c", _PROGRAM, adapter or ""]
        subprocess.run(command, input=preset.dumps(system), text=True, env=environment, check=True)
        return time.perf_counter() - start


def first_image_criterion(system: System, adapter: str | None = None) -> Criterion:
    """The time to the first picture of the periodic bench, with its bar."""
    periodic = system.edit({"propagation": "periodic"})
    return Criterion("first image from process start, cold cache", first_image_s(periodic, adapter), 5.0, 3.0, "s")
