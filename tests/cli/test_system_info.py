"""What `holoview info` says, against numbers worked out by hand."""

from __future__ import annotations

from typing import Any

import holoview as hv
from holoview.holograms.optimise.memory import peak_bytes
from holoview.light.model.derived_numbers import info_rows


def _facts(name: str, **changes: Any) -> dict[str, str]:
    system = hv.load(name).edit(changes)
    return {fact.name: fact.text for fact in info_rows(system, peak_bytes(system))}


def _mebibytes(text: str) -> float:
    number, unit = text.removeprefix("about ").split()
    return float(number) * {"MiB": 1, "GiB": 1024}[unit]


def test_etendue_is_the_number_of_pixels_times_the_squared_wavelength() -> None:
    # 384·512 · (460 nm)² = 196608 · 2.116e-13 m² = 4.160e-8 m² sr, and with 650 nm 8.307e-8
    assert _facts("holochrome-8")["étendue"] == "0.0416 to 0.0831 mm² sr (pixels × λ²)"
    # 800·1358 = 1086400 pixels: 2.299e-7 and 4.590e-7 m² sr
    assert _facts("bench-plm")["étendue"] == "0.23 to 0.459 mm² sr (pixels × λ²)"


def test_the_phase_range_is_twice_the_stroke_in_wavelengths_times_pi() -> None:
    # 2 · 825/460 = 3.587, 2 · 825/650 = 2.538
    assert _facts("holochrome-8")["phase range"] == "3.59 pi at 460 nm, 2.54 pi at 650 nm"


def test_the_largest_angle_is_that_of_two_pixels_a_period() -> None:
    # asin(0.46/16) = 1.6475°, asin(0.65/16) = 2.3283°
    assert _facts("holochrome-8")["largest angle (half)"] == "1.65° to 2.33°"


def test_defocus_over_the_stack_is_the_depth_times_the_tangent_of_the_cone() -> None:
    # 2 mm · tan 2.3283° / 8 µm = 10.165
    assert _facts("holochrome-8")["defocus over the stack"] == "±10.2 modulator pixels"
    # the iris of NA 0.024 is narrower than the modulator's 0.0301: 10 mm · tan(asin 0.024) / 10.8 µm = 22.229
    assert _facts("bench-plm")["defocus over the stack"] == "±22.2 modulator pixels"


def test_cut_offs_are_half_a_cycle_a_pixel_and_the_aperture_over_the_wavelength() -> None:
    found = _facts("bench-plm")
    assert found["modulator"] == "46.3 cycles/mm"  # 0.5 / 10.8 µm
    assert found["simulation grid"] == "92.59 cycles/mm"  # two samples a pixel
    assert found["iris of relay 1"].startswith("radius 52.17, ")  # 0.024 / 460 nm
    assert " 36.92 cycles/mm = " in found["iris of relay 1"]  # 0.024 / 650 nm
    assert found["iris of relay 1"].endswith(", 0.7975 first orders (NA 0.024)")  # 36.92 / 46.30
    assert found["iris of relay 1"] == found["iris of relay 2"]
    assert found["DC block of relay 2"] == "NA 0.0008"
    assert "DC block of relay 1" not in found


def test_the_band_limit_is_named_only_where_it_cuts() -> None:
    assert _facts("holochrome-8")["band limit at the farthest plane"] == "not needed (the kernel doesn't alias)"
    # 1 m away on 1536 · 4 µm = 6.144 mm: 1/(650 nm · √((2 m/6.144 mm)² + 1)) = 4726.1/m
    assert _facts("holochrome-8-open", planes=["1 m"])["band limit at the farthest plane"] == "4.726 cycles/mm"


def test_a_periodic_grid_does_not_claim_a_clean_kernel_where_it_aliases() -> None:
    # on 768 · 4 µm = 3.072 mm: 1/(650 nm · √((2 m/3.072 mm)² + 1)) = 2363.1/m
    found = _facts("holochrome-8", planes=["1 m"], propagation="periodic")["band limit at the farthest plane"]
    assert found == "none (periodic), though the kernel aliases above 2.363 cycles/mm"


def test_padding_beyond_the_walk_off_keeps_light_from_coming_back() -> None:
    clean = "none: the padding exceeds the largest walk-off"
    assert _facts("holochrome-8")["expected wrap-around"] == clean
    # the iris limits the walk-off: 30 mm · 0.024 / 5.4 µm = 133 samples, of 200 that are padded
    found = _facts("bench-plm")
    assert found["simulated field"] == "2716 x 1600 at 5.4 um"
    assert found["transformed grid"] == "2880 x 1800 (compact)"
    assert found["expected wrap-around"] == clean


def test_without_padding_the_walk_off_of_the_longest_path_comes_back() -> None:
    # sine 650 nm / 8 µm = 0.08125, tangent 0.081520: 11 mm · 0.081520 / 4 µm = 224.18 samples of 768
    found = _facts("holochrome-8-open", propagation="periodic")["expected wrap-around"]
    assert found == "up to 29% of a side (224 samples walk-off over the planes)"
    # 20 mm: 407.60 samples
    found = _facts("holochrome-8-open", propagation="periodic", gap="20 mm")["expected wrap-around"]
    assert found == "up to 53% of a side (408 samples walk-off over the gap)"


def test_light_that_leaves_the_padding_is_cut_rather_than_wrapped() -> None:
    found = _facts("holochrome-8-open", planes=["1 m"])["expected wrap-around"]
    assert found == "none: light that walks off by more than the padding (20380 samples over the planes) is cut"


def test_every_limit_of_the_model_has_its_figure() -> None:
    found = _facts("holochrome-8")
    # 1/(650 nm · √((22 mm/6.144 mm)² + 1)) of 1/(16 µm): 6.62
    assert found["band limit"] == "6.62, true if at least 1"
    assert found["samples a pixel"] == "0.234, true if at most 0.25"
    assert not any("NOT TRUE" in text or "REFUSED" in text for text in found.values())
    fine = _facts("holochrome-8", pitch="0.1 um")
    assert "REFUSED: light goes on to what lies at 11 mm" in fine["band left"]
    assert fine["evanescent orders"].startswith("0.926, true if at most 0: NOT TRUE: 93% of the first order")


def test_memory_is_that_of_complex64_fields_and_float32_intensities() -> None:
    found = _facts("holochrome-8")
    assert found["one padded field"] == "24 MiB"  # 2048 · 1536 · 8 bytes
    assert found["focal stack of intensities"] == "120 MiB"  # 8 · 5 · 1024 · 768 · 4 bytes


def test_the_optimiser_needs_more_for_more_lasers_and_modulators() -> None:
    need = {
        name: _mebibytes(_facts(name)["optimiser"])
        for name in ("holochrome-8-open", "holochrome-8-1slm-open", "multiplexed-open", "time-sequential-open")
    }
    assert need["holochrome-8-1slm-open"] < need["holochrome-8-open"]
    assert need["time-sequential-open"] < need["multiplexed-open"], "in each frame but one of three lasers is on"
    # peaks of processes over 12 iterations, above the memory before the problem was built (VmHWM, 2 threads); they hold
    # 68 to 89 MiB beside tensors: tables and threads of the FFTs, and what the allocator keeps
    measured = {"holochrome-8-open": 1015, "holochrome-8-1slm-open": 921, "time-sequential-open": 510}
    assert all(0 < peak - need[name] < 100 for name, peak in measured.items())


def test_the_bench_is_told_in_people_s_units() -> None:
    found = _facts("bench-plm")
    assert found["wavelengths"] == "8: 460, 487.1, 514.3, 541.4, 568.6, 595.7, 622.9, 650 nm"
    assert found["modulators"] == "2 of 1358 x 800 pixels, 16 levels"
    assert found["active area"] == "14.67 x 8.64 mm"
    assert found["gap"] == "5 mm"
    assert found["focal planes"] == "20, 22.5, 25, 27.5, 30 mm"
    assert "gap" not in _facts("simultaneous-1slm")


def test_effects_are_told_in_words_and_those_of_the_camera_set_apart() -> None:
    found = _facts("holochrome-8", **{"effects.gap.gap_error": "0.1 mm", "effects.camera_gamma.exponent": 0.2})
    assert found["gap"] == "The gap is 2.1 mm, not 2 mm."
    assert found["not seen"].startswith("camera_gamma")
    assert "not seen" not in _facts("holochrome-8")


def test_an_eye_is_told_in_dioptres_and_degrees() -> None:
    found = _facts("holochrome-8", eye={"pupil_x": "1 mm"})
    assert found["eyepiece"] == "40 mm, 1.6 mm of distance a dioptre"
    assert found["plane at infinity"] == "9 mm"
    assert found["focused at"] == "0, 0.313, 0.625, 0.938, 1.25 D"
    assert found["pupil"] == "3 mm at y 0, x 1 mm"
    assert found["eyebox of the first order"] == "2.3 mm at 460 nm to 3.25 mm"  # 40 mm · λ / 8 µm
    # 512 and 384 pixels of 8 µm: 2·atan(2.048/40) and 2·atan(1.536/40); a sample is 0.1 mrad
    assert found["field of view"] == "5.86° x 4.4°, 174.5 samples a degree"
    # Rx(650 nm) − Rx(460 nm) = 633.46·(1/245.898 − 1/435.898)
    assert found["focus of the wavelengths"] == "1.8 mm apart, 1.12 D (chromatic aberration)"
    assert "eyepiece" not in _facts("holochrome-8")


def test_info_says_that_the_grid_of_compact_is_shared_by_all_planes() -> None:
    """Of 20, 22.5, 25, 27.5 and 30 mm each alone would be padded less than the last one."""
    shared = _facts("bench-plm", shape=[96, 128])["grid of all planes"]
    assert shared == "of the farthest of 5: 4 alone would take fewer samples, and look a little different"
    for changes in ({"planes": ["30 mm"]}, {"propagation": "linear"}):
        assert "grid of all planes" not in _facts("bench-plm", shape=[96, 128], **changes)
