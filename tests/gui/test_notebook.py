"""The viewer in a notebook's cell: frames go to the widget, code and hand edit the same session."""

from __future__ import annotations

import subprocess
import sys

import pytest

import holoview
from holoview.light.gpu.device import Device
from holoview.util.errors import UserError
from tests.gui.notebook_session import SYSTEM
from tests.patience import PATIENCE_S


@pytest.mark.long
@pytest.mark.gpu
def test_frames_are_sent_and_an_edit_by_code_is_seen(device: Device) -> None:
    command = [sys.executable, "-W", "error", "-X", "faulthandler", "-m", "tests.gui.notebook_session"]
    kernel = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert kernel.returncode == 0 and "Traceback" not in kernel.stderr, kernel.stderr


def test_outside_a_notebook_the_remedy_is_told() -> None:
    with pytest.raises(UserError, match="holoview view"):
        holoview.show(SYSTEM)
