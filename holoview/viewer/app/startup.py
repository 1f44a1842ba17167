"""Opens the device on a thread, which then computes the first picture, while the main thread builds the window.

This module imports little, so that the thread starts before the imports that it overlaps with.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from holoview.light.gpu.device import Device, open_device


class Startup:
    """Begins to open an adapter: the best one, or the best whose name contains `adapter`. thread: runs further work."""

    def __init__(self, adapter: str | None) -> None:
        self.thread = ThreadPoolExecutor(1, thread_name_prefix="holoview: start")
        self._device = self.thread.submit(open_device, adapter)

    def device(self) -> Device:
        """The open device; waits for it. Raises UserError as `open_device` does."""
        return self._device.result()
