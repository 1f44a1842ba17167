"""A viewer whose graphics device is lost at any moment starts again with its work."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.device_loss import recovery
from holoview.light.gpu.device import Device
from tests.explored import explored

pytestmark = pytest.mark.gpu


@pytest.mark.long
@pytest.mark.parametrize("optimises", explored([False, True], [False]))
def test_the_work_is_back_after_the_device_was_lost(device: Device, tmp_path: Path, optimises: bool) -> None:
    found = recovery(tmp_path, ("--new", "--set", "shape=[96, 128]"), optimises)
    assert found.connected <= found.window <= found.picture
