"""Whether patterns arrive at modulators unscaled and whole: every fault that is hidden is found, and none elsewhere."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.bench.captures.gratings import grating, signal_pattern
from holoview.bench.rig import RigDescription, read_rig
from holoview.bench.rig.signal_check import SignalCheck, check_signals, signal_lines
from holoview.bench.rig.virtual.signal_faults import SignalFaults
from holoview.commands.cli import main
from holoview.util.errors import UserError
from tests.rig.align.hidden_bench import Hidden
from tests.rig.conftest import MakeRig, direct_devices, write_rig

SLM = {"device": "virtual", "shape": [48, 64], "pitch": "8 um", "num_levels": 256, "opd_range": "825 nm", "settle": 0.1}
LARGE: dict[str, Any] = {"slm1": SLM, "slm2": SLM, "camera.shape": [140, 160]}
BENCH = {
    "camera_alignment": {"shift_y": "30 um", "shift_x": "-20 um"},
    "gap": {"gap_error": "0.08 mm"},
    "stroke": {"stroke_error": -0.1},
}


def found_with(make_rig: MakeRig, signal: dict[str, Any], **hidden: Any) -> tuple[SignalCheck, ...]:
    placement = {"slm2": "flip_x", "camera": "flip_y"}
    virtual = {"seed": 5, "settle": 0.02, "prnu": 0.01, "effects": BENCH, "placement": placement, "signal": signal}
    rig = make_rig(LARGE | {"virtual": virtual | hidden})
    with direct_devices(rig) as devices:
        return check_signals(rig, devices)


@pytest.mark.parametrize("seed", [5, 6])
def test_a_bench_with_errors_of_its_own_has_no_fault_of_the_signal(make_rig: MakeRig, seed: int) -> None:
    """A stroke that is a tenth too short, shifts, turns, PRNU and noise are no faults of the signal."""
    checks = found_with(make_rig, {}, seed=seed)
    assert [check.modulator for check in checks] == [0, 1]
    for check in checks:
        assert check.faults == () and check.notes == () and check.merged == 0
        # the nominal pitches hold here; the peak of 6 or more periods lies within a twentieth of a bin
        assert check.scale == pytest.approx(1.0, abs=0.01)
        assert check.low == pytest.approx(1.0, abs=0.05) and check.high == pytest.approx(1.0, abs=0.05)
        assert "no two of 9 neighbouring levels alike" in signal_lines(check)[0]


@pytest.mark.parametrize("scale", [1.25, 1.5, 0.8])
def test_a_scaled_screen_is_found_with_its_scale(make_rig: MakeRig, scale: float) -> None:
    for check in found_with(make_rig, {"scale": scale}):
        # the scale of pixels that are repeated, or left out, is even over the whole picture only
        assert check.scale == pytest.approx(scale, rel=0.03)
        assert len(check.faults) == 1 and "scales the screen (set it to 100 %)" in check.faults[0]


@pytest.mark.parametrize(
    ("signal", "said"),
    [
        ({"range": "clipped"}, "the 16 darkest and the 16 brightest of 256 levels show the same"),
        ({"range": "compressed"}, "compressed to limited range, 16 to 235"),
        ({"bits": 7}, "lower bits are lost"),
        ({"bits": 6}, "lower bits are lost"),
    ],
)
def test_levels_that_are_lost_are_found_and_what_becomes_of_them_is_said(
    make_rig: MakeRig, signal: dict[str, Any], said: str
) -> None:
    for check in found_with(make_rig, signal):
        assert len(check.faults) == 1 and said in check.faults[0], check
        assert check.scale == pytest.approx(1.0, abs=0.01)


def test_two_faults_are_two_sentences(make_rig: MakeRig) -> None:
    for check in found_with(make_rig, {"scale": 1.25, "range": "clipped"}):
        assert len(check.faults) == 2


def test_what_cannot_be_checked_is_said(make_rig: MakeRig, tmp_path: Path) -> None:
    few = SLM | {"num_levels": 16}
    rig = make_rig(LARGE | {"slm1": few, "slm2": few})
    with direct_devices(rig) as devices:
        checks = check_signals(rig, devices)
    assert all("16 levels isn't checked" in check.notes[0] and not check.faults for check in checks)
    fourier: RigDescription = Hidden("fourier").write(tmp_path)
    with direct_devices(fourier) as devices:
        (check,) = check_signals(fourier, devices)
    assert "isn't checked on a Fourier bench" in signal_lines(check)[0]
    dark = make_rig(
        LARGE | {"camera.read_noise": 400.0, "limits.exposure": [1e-5, 2e-5], "lasers.wavelengths": ["450 nm"]}
    )
    with direct_devices(dark) as devices:
        for check in check_signals(dark, devices):  # a thousandth of the light: a step of one level is below the noise
            assert check.merged is None and (check.faults or "bits aren't checked" in check.notes[0])


@pytest.mark.long
def test_rig_test_says_it_and_ends_with_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(write_rig(tmp_path / "rig.toml", LARGE | {"virtual": {"signal": {"scale": 1.25}}}))
    assert main(["rig", "test", path]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert sum(re.search(r"1\.2\d times as large as it was sent", line) is not None for line in lines) == 2, lines
    assert lines[-1] == "all devices answer; the lasers are off"
    assert main(["rig", "test", path, "--no-signal"]) == 0
    assert "times as large" not in capsys.readouterr().out


# --- the faults themselves, and the patterns ---


def test_the_hidden_faults_do_what_video_links_do() -> None:
    levels = np.arange(256, dtype=np.uint8)[None, :]
    compressed = SignalFaults(range="compressed").arrived(levels, 256)[0]
    assert compressed[0] == 16 and compressed[-1] == 235 and len(np.unique(compressed)) == 220
    clipped = SignalFaults(range="clipped").arrived(levels, 256)[0]
    assert not clipped[:17].any() and np.all(clipped[235:] == 255) and clipped[17] > 0 and clipped[234] < 255
    assert np.array_equal(SignalFaults(bits=6).arrived(levels, 256)[0], levels[0] & 0b11111100)
    assert np.array_equal(SignalFaults().arrived(levels, 256), levels)
    scaled = SignalFaults(scale=2.0).arrived(levels, 256)[0]
    assert np.array_equal(scaled, np.repeat(levels[0, :128], 2))
    with pytest.raises(UserError, match="scale"):
        SignalFaults(scale=0.0)


@pytest.mark.parametrize("bits", [8, 16])
def test_the_test_pattern_loses_a_band_with_each_fault(bits: int) -> None:
    top, shape = 2**bits - 1, (96, 640)
    pattern = signal_pattern(shape, bits)
    assert pattern.shape == shape and pattern.dtype == (np.uint8 if bits == 8 else np.uint16)
    fine, _, dark, middle, bright, unit = pattern[8::16]
    assert np.array_equal(np.unique(fine[0::2]), [0]) and len(np.unique(fine[1::2])) == 1

    def bars(band: np.ndarray, **fault: Any) -> int:
        return len(np.unique(SignalFaults(**fault).arrived(band[None], top + 1)))

    assert bars(dark) == bars(middle) == bars(bright) == 2
    assert bars(dark, range="clipped") == bars(bright, range="clipped") == 1 and bars(middle, range="clipped") == 2
    assert bars(unit) == 9 and bars(unit, bits=bits - 1) == 5
    moved = SignalFaults(scale=1.25).arrived(fine[None], top + 1)[0]
    assert np.any(moved[1:] == moved[:-1])  # bars of two pixels between those of one: beats


def test_a_grating_has_its_period_and_levels() -> None:
    bars = grating((4, 32), 8, 3, 200)
    assert np.array_equal(bars[0], np.tile([3, 3, 3, 3, 200, 200, 200, 200], 4)) and bars.shape == (4, 32)


def test_a_signal_table_is_read_and_mistakes_are_named(tmp_path: Path) -> None:
    rig = read_rig(write_rig(tmp_path / "rig.toml", {"virtual": {"signal": {"range": "narrow"}}}))
    with pytest.raises(UserError, match=r"signal\.range"):
        direct_devices(rig)
