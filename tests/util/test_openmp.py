"""The settings of OpenMP: those of the user are kept, and torch obeys them."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from holoview.util import processors
from holoview.util.processors import SPIN_COUNT, share_the_machine


@pytest.fixture
def _four_of_eight(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processors, "process_cpu_count", lambda: 4)
    monkeypatch.setattr(processors, "affine_cpu_count", lambda: 8)


@pytest.mark.usefixtures("_four_of_eight")
def test_threads_sleep_early_and_are_as_many_as_the_container_grants() -> None:
    environment: dict[str, str] = {}
    share_the_machine(environment)
    assert environment == {"GOMP_SPINCOUNT": str(SPIN_COUNT), "OMP_NUM_THREADS": "4", "LP_NUM_THREADS": "4"}


@pytest.mark.usefixtures("_four_of_eight")
@pytest.mark.parametrize(
    "stated",
    [
        {"GOMP_SPINCOUNT": "infinite", "OMP_NUM_THREADS": "7", "LP_NUM_THREADS": "3"},
        {"OMP_WAIT_POLICY": "active", "OMP_NUM_THREADS": "7", "LP_NUM_THREADS": "3"},
    ],
)
def test_what_the_user_states_is_kept(stated: dict[str, str]) -> None:
    environment = dict(stated)
    share_the_machine(environment)
    assert environment == stated


def test_without_a_limit_none_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processors, "process_cpu_count", lambda: 8)
    monkeypatch.setattr(processors, "affine_cpu_count", lambda: 8)
    environment: dict[str, str] = {}
    share_the_machine(environment)
    assert "OMP_NUM_THREADS" not in environment


def test_the_command_line_sets_this_before_torch_is_loaded() -> None:
    code = (
        "import os, sys, holoview.cli as cli\n"
        "assert 'torch' not in sys.modules\n"
        "cli.main(['presets'])\n"
        "print(os.environ['GOMP_SPINCOUNT'])"
    )
    environment = {key: value for key, value in os.environ.items() if key not in ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == str(SPIN_COUNT)
