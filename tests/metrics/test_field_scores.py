"""SNR and SSIM of complex fields, PSNR and SSIM of views, on cases that can be worked out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from holoview.holograms.metrics.field_scores import field_snr, field_ssim, view_scores, vifp
from holoview.util.errors import UserError


def _field(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(40, 50)) + 1j * rng.normal(size=(40, 50))


def test_snr_is_that_of_the_difference() -> None:
    field = _field(1)
    assert field_snr(field * 1.01, field) == pytest.approx(40)
    assert field_snr(field * np.exp(0.2j), field) == pytest.approx(-20 * math.log10(2 * math.sin(0.1)))
    assert field_snr(field, field) == math.inf


def test_ssim_is_one_for_equal_fields_alone_and_looks_at_the_phase() -> None:
    field = _field(2)
    assert field_ssim(field, field) == pytest.approx(1)
    # real and imaginary parts exchanged are independent noise. A window weighs about 28 samples, so that about 100
    # independent windows have a mean correlation of 0 ± 0.02
    assert abs(field_ssim(field * 1j, field)) < 0.1


def test_ssim_of_a_brighter_constant_is_the_formula() -> None:
    dark, bright = np.full((16, 16), 100, np.uint8), np.full((16, 16), 150, np.uint8)
    a, b, c1 = 100 / 255, 150 / 255, 0.01**2
    scores = view_scores(bright, dark)
    assert scores["ssim"] == pytest.approx((2 * a * b + c1) / (a * a + b * b + c1), rel=1e-9)
    assert scores["psnr_db"] == pytest.approx(-20 * math.log10(50 / 255))


def test_what_has_no_score_is_refused() -> None:
    field = _field(3)
    for call in (
        lambda: field_snr(field, field[1:]),
        lambda: field_snr(field, field * 0),
        lambda: field_ssim(field[:5], field[:5]),
        lambda: view_scores(np.zeros((5, 5), np.uint8), np.zeros((5, 5), np.uint8)),
    ):
        with pytest.raises(UserError):
            call()


@pytest.mark.parametrize(("kind", "published"), [("noise", 0.4739500872), ("blur", 0.6045734792), ("same", 1.0)])
def test_vifp_is_that_of_an_independent_program(kind: str, published: float) -> None:
    """Values of sewar 0.4.10 (`sewar.vifp`), which follows the code of the paper's authors."""
    y, x = np.mgrid[:96, :128]
    reference = np.rint(128 + 60 * np.sin(x / 5) + 40 * np.cos(y * x / 300)).clip(0, 255)
    rolled = [np.roll(reference, shift, axis) for shift, axis in ((0, 0), (1, 0), (1, 1), (2, 1))]
    noisy = np.rint(reference * 0.8 + 20 + 12 * np.sin(x * 1.7 + y * 2.3)).clip(0, 255)
    view = {"noise": noisy, "blur": np.rint(sum(rolled) / 4), "same": reference}[kind]
    assert vifp(view, reference) == pytest.approx(published, abs=1e-6)
    scores = view_scores(view.astype(np.uint8), reference.astype(np.uint8))
    assert scores["vifp"] == pytest.approx(published, abs=1e-6)


def test_vifp_needs_a_picture() -> None:
    with pytest.raises(UserError):
        vifp(np.ones((50, 50)), np.ones((50, 50)))
    with pytest.raises(UserError):
        vifp(np.eye(20), np.eye(20))
