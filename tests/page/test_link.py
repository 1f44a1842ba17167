"""A link's state is that of the hologram that the viewer opens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import holoview as hv
from holoview.viewer.page.link import shown_by_link, split_link


@pytest.fixture
def hologram() -> hv.Hologram:
    system = hv.load("holochrome-8").with_(shape=[8, 12], eye={})
    return hv.Hologram(hv.random_drive(system), system)


def test_a_link_changes_the_bench_and_tells_the_plane(hologram: hv.Hologram) -> None:
    state = (
        "plane=9.7mm&gap=2.1mm&laser3=off&power1=0.5&wavelength8=640nm&laser2.1=off"
        "&pupil=4mm&pupil_x=-1mm&chromatic=off&region=3,2,10,8&view=wipe-target&split=0.3"
    )
    shown = shown_by_link(hologram, state)
    system = shown.hologram.system
    assert shown.plane_m == pytest.approx(9.7e-3) and shown.region == (3, 2, 10, 8)
    assert system.gap_m == pytest.approx(2.1e-3)
    expected = hologram.system.amplitudes * np.array([0.5, 1, 0, 1, 1, 1, 1, 1])
    assert np.array_equal(system.amplitudes, expected)
    assert system.wavelengths_m[-1] == pytest.approx(640e-9)
    assert np.array_equal(system.wavelengths_m[:-1], hologram.system.wavelengths_m[:-1])
    assert system.eye is not None
    assert (system.eye.pupil_m, system.eye.pupil_x_m, system.eye.chromatic) == (4e-3, -1e-3, False)
    assert np.array_equal(shown.hologram.drive, hologram.drive)


def test_an_empty_state_changes_nothing(hologram: hv.Hologram) -> None:
    shown = shown_by_link(hologram, "")
    assert shown.hologram.system == hologram.system and shown.plane_m is None


@pytest.mark.parametrize(
    "state",
    [
        "plane",
        "plane=far",
        "plane=-1mm",
        "laser9=off",
        "laser=off",
        "laser99999=off",
        "laser1.=off",
        "laser.1=off",
        "power1=nan",
        "gap=1kg",
        "x=1",
        "power2=-1",
        "region=1,2,3",
        "region=1,2,3,0",
        "region=-1,2,3,4",
        "region=all",
    ],
)
def test_what_is_not_understood_gets_a_sentence(hologram: hv.Hologram, state: str) -> None:
    with pytest.raises(hv.UserError):
        shown_by_link(hologram, state)


def test_an_eyes_state_needs_an_eye(hologram: hv.Hologram) -> None:
    blind = hv.Hologram(hologram.drive, hologram.system.with_(eye=None))
    with pytest.raises(hv.UserError, match="eye"):
        shown_by_link(blind, "pupil=3mm")


def test_a_link_is_split_unless_there_is_a_file_of_that_name(tmp_path: Path) -> None:
    name = tmp_path / "a.html#plane=1mm"
    assert split_link(str(name)) == (tmp_path / "a.html", "plane=1mm")
    assert split_link(tmp_path / "b.safetensors") == (tmp_path / "b.safetensors", "")
    name.write_text("x", encoding="utf-8")
    assert split_link(name) == (name, "")
    too_long = f"a.html#view={'x' * 300}"
    assert split_link(too_long) == (Path("a.html"), f"view={'x' * 300}")
