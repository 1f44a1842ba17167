"""The program `holoview`, whose viewer loses its graphics device when a file appears; for `benchmarks.device_loss`."""

from __future__ import annotations

import gc
import os
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from holoview.commands.cli import main
from holoview.commands.supervisor import supervise

LOSE = "HOLOVIEW_BENCHMARK_LOSE"
"""The environment variable that names the file."""


def viewer(words: Sequence[str]) -> int:
    """Runs `holoview`."""
    threading.Thread(target=_lose_device, args=(Path(os.environ[LOSE]),), daemon=True).start()
    return main(words)


def _lose_device(told: Path) -> None:
    while not told.exists():
        time.sleep(0.02)
    from wgpu.backends.wgpu_native import lib  # the start of the viewer isn't to wait for them

    from holoview.light.gpu.device import Device

    devices = [found for found in gc.get_objects() if type(found) is Device]  # isinstance asks dead weak references
    told.unlink()
    if not devices:
        print("no graphics device to lose", file=sys.stderr, flush=True)
    for device in devices:  # not by `destroy`, which also ends the thread that tells who waits; a driver doesn't
        lib.wgpuDeviceDestroy(device.raw._internal)


if __name__ == "__main__":
    sys.exit(supervise(viewer, sys.argv[1:]))
