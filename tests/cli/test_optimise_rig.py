"""`holoview optimise … --rig`: what it writes and prints, how it ends early, and what it refuses."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from holoview.bench.experiment import camera_loop as loop
from holoview.bench.rig import RigDescription
from holoview.bench.rig.devices import Devices
from holoview.holograms.hologram import load_hologram
from tests.experiment.camera_loop.conftest import PLANE_M, BenchHere, rig_text

Run = Callable[..., Any]
PLANE = ("--set", f"planes=[{PLANE_M}]")


@dataclass
class _Opened:
    """The benches that were opened. fail_after: pictures of the next one after which its camera doesn't answer."""

    benches: list[BenchHere] = field(default_factory=list)
    fail_after: int = 10**9

    def __call__(self, rig: RigDescription) -> Devices:
        self.benches.append(BenchHere(rig, self.fail_after))
        return self.benches[-1].devices()


@pytest.fixture
def opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> _Opened:
    """rig.toml in tmp_path, whose bench has a wrong gap and runs in this process."""
    hidden = '[virtual.effects.gap]\ngap_error = "0.2 mm"\n'
    (tmp_path / "rig.toml").write_text(rig_text(hidden=hidden), encoding="utf-8")
    opener = _Opened()
    monkeypatch.setattr(loop, "open_rig", opener)
    return opener


def _optimise(holoview: Run, picture: Path, *more: object, iterations: int = 4) -> Any:
    return holoview(
        *("optimise", "rig.toml", picture, "--rig", "rig.toml", *PLANE, "--iterations", iterations),
        *("-o", "best.safetensors", *more),
    )


def test_it_writes_the_hologram_and_prints_what_was_measured(
    holoview: Run, picture: Path, opened: _Opened, tmp_path: Path
) -> None:
    done = _optimise(holoview, picture, "--json")
    assert done.code == 0, done.err
    table = json.loads(done.out)
    assert table["iterations"] == 4 and table["pictures"] <= opened.benches[0].taken and table["bench_seconds"] > 0
    assert table["psnr_db"] > table["first_psnr_db"]
    hologram = load_hologram(tmp_path / "best.safetensors")
    assert hologram.system.sampling.propagation == "linear"
    assert opened.benches[0].was_off
    assert {path.name for path in tmp_path.iterdir()} == {picture.name, "rig.toml", "best.safetensors"}


def test_from_a_hologram_it_needs_no_optimisation_in_the_model(holoview: Run, picture: Path, opened: _Opened) -> None:
    assert _optimise(holoview, picture).code == 0
    done = holoview(
        *("optimise", "rig.toml", picture, "--rig", "rig.toml", *PLANE, "--iterations", 1),
        *("--start", "best.safetensors", "-o", "next.safetensors", "--preview", "seen.png"),
    )
    assert done.code == 0, done.err
    assert "optimising" not in done.err
    assert "dB at the start" in done.out and "(fresh pictures)" in done.out
    assert Path("seen.png").exists()


def test_a_device_that_fails_leaves_the_best_and_a_checkpoint_from_which_it_goes_on(
    holoview: Run, picture: Path, opened: _Opened
) -> None:
    opened.fail_after = 15
    failed = _optimise(holoview, picture, iterations=8)
    assert failed.code == 2 and opened.benches[0].was_off
    assert "camera: sent no picture" in failed.err
    assert "--resume best.loop.safetensors" in failed.err
    assert load_hologram("best.safetensors").drive.shape == (1, 2, 24, 32)
    opened.fail_after = 10**9
    resumed = _optimise(holoview, picture, "--resume", "best.loop.safetensors", iterations=8)
    assert resumed.code == 0, resumed.err
    assert "8 iterations" in resumed.out


def test_after_ctrl_c_the_best_so_far_is_kept_and_lasers_are_off(
    holoview: Run, picture: Path, opened: _Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    take = BenchHere.take

    def interrupted(self: BenchHere) -> Any:
        if self.taken == 14:
            signal.raise_signal(signal.SIGINT)
        return take(self)

    monkeypatch.setattr(BenchHere, "take", interrupted)
    done = _optimise(holoview, picture, iterations=50)
    assert done.code == 130 and opened.benches[0].was_off and opened.benches[0].taken < 30
    assert "the best so far is kept in best.safetensors" in done.err
    assert Path("best.loop.safetensors").exists()


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (("--set", "gap=3 mm"), "gap: is 3 mm; expected 1 mm"),
        (("--free", "wavelengths"), "--free: wavelengths with --rig"),
        (("--sharded",), "--sharded: with --rig"),
        (("--pupils", "2x2:0.1mm"), "with --rig"),
        (("--update-effects", "gap"), "--update-effects: without --model-updates"),
    ],
)
def test_what_doesnt_fit_a_rig_is_refused_before_anything_is_opened(
    holoview: Run, picture: Path, opened: _Opened, more: tuple[str, ...], says: str
) -> None:
    done = _optimise(holoview, picture, *more)
    assert done.code == 2 and says in done.err
    assert not opened.benches


def test_updates_of_the_model_need_a_rig(holoview: Run, picture: Path) -> None:
    done = holoview("optimise", "holochrome-8", picture, "--model-updates", 3)
    assert done.code == 2 and "--model-updates: without --rig" in done.err
