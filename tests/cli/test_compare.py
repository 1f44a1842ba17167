"""`holoview compare` scores a hologram beside its reference: whole and parts, in samples and degrees."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from tests.cli.conftest import Outcome

Run = Callable[..., Outcome]
KNOWN = ("--pitch", "8um", "--wavelength", "532nm")


@pytest.fixture
def original(tmp_path: Any) -> np.ndarray:
    rng = np.random.default_rng(20)
    field = rng.normal(size=(64, 96)) + 1j * rng.normal(size=(64, 96))
    np.save("original.npy", field.astype(np.complex64))
    return field.astype(np.complex64)


def _compared(holoview: Run, *arguments: str) -> Any:
    done = holoview("compare", *arguments, *KNOWN, "--json")
    assert done.code == 0, done.err
    return json.loads(done.out)


def test_the_hologram_has_the_ratio_of_its_error_and_equal_ones_have_none(holoview: Run, original: np.ndarray) -> None:
    np.save("brighter.npy", original * np.float32(1.01))
    found = _compared(holoview, "brighter.npy", "original.npy")
    assert found["hologram"]["snr_db"] == pytest.approx(40, abs=1e-3)
    # without a distance the view is that of the hologram itself: an error of 1 % of each amplitude
    amplitude = np.abs(original)
    span = np.ptp(amplitude)
    clipped = np.minimum(0.01 * amplitude, amplitude.max() - amplitude)
    rounding = 1 / 6 / 255**2  # of both views to 8 bits
    expected = -10 * math.log10(np.mean(np.square(clipped / span)) + rounding)
    # the mean of 6 144 squares of errors below two levels is known to 2 %
    assert found["views"][0]["psnr_db"] == pytest.approx(expected, abs=0.3)
    same = _compared(holoview, "original.npy", "original.npy", "--plane", "2cm")
    assert same["hologram"] == {"snr_db": None, "ssim": pytest.approx(1)}
    assert same["views"][0]["psnr_db"] is None and same["views"][0]["vifp"] == pytest.approx(1)


def test_a_view_sees_the_errors_of_its_own_part_alone(holoview: Run, original: np.ndarray) -> None:
    spoilt = original.copy()
    spoilt[:, 64:] *= -1
    np.save("spoilt.npy", spoilt)
    places = ("--viewpoint=-1,0,32", "--viewpoint=1,0,32", "--viewpoint=0,0,64")
    views = _compared(holoview, "spoilt.npy", "original.npy", "--plane", "1cm", "2cm", *places)["views"]
    assert [view["plane_m"] for view in views] == [0.01] * 3 + [0.02] * 3
    for left, right, middle in (views[:3], views[3:]):
        assert left["psnr_db"] is None and left["ssim"] == pytest.approx(1)
        # a sign alone leaves the amplitude of an aperture as it is
        assert right["psnr_db"] is None and middle["psnr_db"] is not None and middle["ssim"] < 0.9


def test_degrees_are_samples_seen_from_the_image(holoview: Run, original: np.ndarray) -> None:
    np.save("turned.npy", original * np.exp(1j * np.linspace(0, 3, 96)).astype(np.complex64))
    degrees = math.degrees(2 * math.atan(40 * 8e-6 / 2 / 0.02))
    places = ("--viewpoint=1,-1,40", f"--viewpoint=1,-1,{degrees:.9f}deg")
    one, other = _compared(holoview, "turned.npy", "original.npy", "--plane", "2cm", *places)["views"]
    assert {k: v for k, v in one.items() if k != "viewpoint"} == {k: v for k, v in other.items() if k != "viewpoint"}


def test_parts_in_several_files_and_files_of_holoview_are_compared(holoview: Run, original: np.ndarray) -> None:
    amplitude, phase = np.abs(original) / np.abs(original).max(), np.angle(original) % (2 * np.pi) / (2 * np.pi)
    names = ["ampli.png", "phase.png"]
    for name, part in zip(names, (amplitude, phase), strict=True):
        Image.fromarray(np.rint(255 * part).astype(np.uint8)).save(name)
    assert _compared(holoview, *names, *names)["hologram"]["snr_db"] is None
    known = {"pitch": "8um", "wavelengths": "532nm", "distance": "1cm", "propagation": "asm"}  # it stays in its plane
    hv.load_field("original.npy", **known).save("field.safetensors")
    done = holoview("compare", "field.safetensors", "field.safetensors")
    assert done.code == 0 and "SNR inf dB, SSIM 1.0000" in done.out and "10 mm" in done.out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("original.npy",), "as many of the hologram as of the reference"),
        (("small.npy", "original.npy"), "as the reference: 96 × 64 samples"),
        (("original.npy", "original.npy", "--resize", "64"), "--resize"),
        (("original.npy", "original.npy", "--percentiles", "99,5"), "percentiles"),
        (("original.npy", "original.npy", "--percentiles", "bright"), "--percentiles"),
        (("original.npy", "original.npy", "--viewpoint", "0,0,80"), "aperture"),
        (("original.npy", "original.npy", "--viewpoint", "left"), "--viewpoint"),
    ],
)
def test_what_has_no_score_is_refused_in_a_line(
    holoview: Run, original: np.ndarray, arguments: tuple[str, ...], words: str
) -> None:
    np.save("small.npy", original[:32])
    done = holoview("compare", *arguments, *KNOWN)
    assert done.code == 2 and words in done.err
