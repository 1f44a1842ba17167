"""torch works as ever whose shared libraries were loaded before it is imported."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.patience import PATIENCE_S

_PROGRAM = """
import sys
from pathlib import Path
from holoview.util.packages import load_torch_libraries
load_torch_libraries()
assert "torch" not in sys.modules
if sys.platform == "linux":
    assert "libtorch_cpu.so" in Path("/proc/self/maps").read_text()
import torch
load_torch_libraries()
print(float(torch.fft.fft(torch.ones(4)).abs()[0]), torch.randn(3, requires_grad=True).sum().requires_grad)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="there nothing is loaded so")
def test_torch_works_whose_libraries_were_loaded_before_it() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "4.0 True\n", "")
