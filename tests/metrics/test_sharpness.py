"""Contrast ratios, and MTF of edges and line pairs, beside the analytic MTF of circular and square pupils."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from holoview.holograms.metrics.sharpness import (
    black_beside_white,
    checkerboard,
    checkerboard_contrast,
    circular_pupil_mtf,
    contrast_ratio,
    line_pair_transfer,
    sequential_contrast,
    slanted_edge_mtf,
    square_pupil_mtf,
    target_mtf,
)
from holoview.util.errors import UserError

SIDE, FINER, CUT_OFF = 192, 4, 0.4
REGION = (48, 48, 96, 96)
Floats = NDArray[np.float64]


def _edge(kind: str, degrees: float) -> Floats:
    """A slanted edge behind a pupil of incoherent light whose cut-off is 0.4 cycles a sample, from a finer grid."""
    n = SIDE * FINER
    y, x = np.mgrid[:n, :n] / FINER
    edge = np.clip((x - SIDE / 2 - np.tan(np.deg2rad(degrees)) * (y - SIDE / 2)) * FINER + 0.5, 0, 1)
    f = np.abs(np.fft.fftfreq(n, 1 / FINER)) / CUT_OFF
    if kind == "square":
        mtf = np.outer(square_pupil_mtf(f), square_pupil_mtf(f))
    else:
        mtf = circular_pupil_mtf(np.hypot(f[:, None], f[None, :]))
    return np.asarray(np.fft.ifft2(np.fft.fft2(edge) * mtf).real[::FINER, ::FINER])


@pytest.mark.parametrize("degrees", [3.0, -5.0])
@pytest.mark.parametrize("kind", ["square", "circle"])
def test_a_slanted_edge_has_the_mtf_of_its_pupil(kind: str, degrees: float) -> None:
    """The window over the edge's derivative blurs the kink at frequency 0: the worst error was 1.7 % of 1."""
    known = square_pupil_mtf if kind == "square" else circular_pupil_mtf
    image = _edge(kind, degrees)
    for values in (0.2 + 3 * image, image.T, 1 - image):
        found = slanted_edge_mtf(values, REGION)
        below = found.cycles < CUT_OFF
        assert np.abs(found.values[below] - known(found.cycles[below] / CUT_OFF)).max() < 0.025
        assert found.angle_deg == pytest.approx(abs(degrees), abs=0.05)
        half = 0.5 if kind == "square" else 0.4040  # of the cut-off
        assert found.half == pytest.approx(half * CUT_OFF, rel=0.03)


def test_the_mtf_of_pupils_is_the_overlap_of_two() -> None:
    """Area of two discs, or squares, displaced against one another, over the area of one; counted on a grid."""
    side = np.linspace(-1, 1, 801)
    y, x = side[:, None], side[None, :]
    for ν in (0.0, 0.25, 0.5, 0.9):
        disc = (np.hypot(x - ν, y) <= 1) & (np.hypot(x + ν, y) <= 1)
        assert circular_pupil_mtf(np.array(ν)) == pytest.approx(disc.sum() / (np.hypot(x, y) <= 1).sum(), abs=5e-3)
        assert square_pupil_mtf(np.array(ν)) == pytest.approx(1 - ν)


def test_line_pairs_have_the_contrast_that_is_left() -> None:
    bars = np.tile((np.arange(120) // 5 % 2).astype(float), (30, 1))
    spectrum = np.fft.fft(bars, axis=1)
    spectrum[:, [12, -12]] *= 0.3
    assert line_pair_transfer(np.fft.ifft(spectrum, axis=1).real, bars, 0.1) == pytest.approx(0.3, rel=1e-9)
    assert line_pair_transfer(np.fft.ifft(spectrum, axis=1).real.T, bars.T, 0.1, axis=0) == pytest.approx(0.3, rel=1e-9)
    with pytest.raises(UserError, match="line pairs"):
        line_pair_transfer(np.ones((4, 20)), np.ones((4, 20)) * 0, 0.1)


@pytest.mark.parametrize(
    "image",
    [np.ones((32, 32)), np.random.default_rng(0).random((32, 32)), np.tile(np.arange(32) > 15, (32, 1)).astype(float)],
    ids=["even", "noise", "upright edge"],
)
def test_what_holds_no_slanted_edge_is_refused(image: Floats) -> None:
    with pytest.raises(UserError, match="--edge"):
        slanted_edge_mtf(image, (0, 0, 32, 32))


def test_contrast_ratios() -> None:
    board = 0.02 + 0.98 * checkerboard((64, 96))
    assert checkerboard_contrast(board).value == pytest.approx(50.0)
    assert board[0, 0] == 1.0 and board[0, 30] == 0.02
    assert contrast_ratio(np.full(5, 2.0), np.full(5, 0.5)) == 4.0
    with pytest.raises(UserError, match="contrast ratio"):
        contrast_ratio(np.ones(3), np.zeros(3))


def test_black_beside_white() -> None:
    target = checkerboard((64, 64))
    found = black_beside_white(0.03 + 0.87 * target, target)
    assert found is not None and found.ratio == pytest.approx(30.0) and found.samples == 2048
    assert black_beside_white(target, np.full((64, 64), 0.5)) is None
    assert black_beside_white(target, np.zeros((64, 64))) is None


@pytest.mark.parametrize("speckle", [0.0, 0.1])
def test_a_picture_of_any_content_has_the_mtf_of_its_blur(speckle: float) -> None:
    """A Gaussian of σ samples: exp(−2π²σ²f²). Speckle of contrast C on a target of contrast 1/√3 scatters a ring of m
    frequencies by √3·C/√m, 0.03 in the innermost one (m = 28) and less in all others; without speckle the window mixes
    frequencies 1/200 apart, over which this MTF changes by 0.02."""
    rng, sigma = np.random.default_rng(31), 1.2
    target = rng.uniform(0, 2, (256, 256))
    f = np.hypot(np.fft.fftfreq(256)[:, None], np.fft.fftfreq(256))
    image = np.fft.ifft2(np.fft.fft2(target) * np.exp(-2 * (np.pi * sigma * f) ** 2)).real
    if speckle:
        image = image * rng.gamma(1 / speckle**2, speckle**2, image.shape)
    found = target_mtf(3.0 * image, target, (28, 28, 200, 200))
    left = found.values - np.exp(-2 * (np.pi * sigma * found.cycles) ** 2)
    assert len(found.values) > 25  # of 33 rings up to half a cycle a sample
    assert np.abs(left).max() < 5 * np.hypot(np.sqrt(3 / 28) * speckle, 0.02 / np.sqrt(28))
    assert found.half == pytest.approx(np.sqrt(np.log(2) / 2) / (np.pi * sigma), rel=0.05)


def test_a_picture_of_something_else_and_a_flat_target_tell_no_mtf() -> None:
    target, other = np.random.default_rng(32).uniform(0, 2, (2, 128, 128))
    for wanted, said in ((target, "doesn't follow"), (np.ones((128, 128)), "no structure")):
        with pytest.raises(UserError, match=said):
            target_mtf(other, wanted, (0, 0, 128, 128))


# --- standard errors --------------------------------------------------------------------------------------------------

_DRAWS = 60


def _check_errors(found: list[tuple[float, float]], lowest: float, highest: float) -> None:
    """The scatter of drawn values over the root mean square of the errors that they come with."""
    values, errors = np.array(found).T
    assert lowest < values.std(ddof=1) / np.sqrt(np.square(errors).mean()) < highest


def _light(rng: np.random.Generator, shape: tuple[int, int], contrast: float, grain: int = 3) -> Floats:
    """Speckle of mean 1 in grains of some samples, of a contrast that is near the given one."""
    n = rng.gamma(1 / contrast**2, contrast**2, (shape[0] + grain, shape[1] + grain)) - 1
    return 1 + grain * ndimage.uniform_filter(n, grain)[: shape[0], : shape[1]]


def test_the_errors_of_contrast_ratios_are_their_scatter() -> None:
    """60 drawn values scatter by their deviation to 1/√118 = 9 %, that of 60 errors of 64 blocks each is 1 % at most,
    and blocks of 12 × 16 samples are a little correlated by grains of 3 (5 %): within 1 ± 0.5 by five deviations."""
    rng, shape = np.random.default_rng(41), (96, 128)
    board, ramp = checkerboard(shape), np.linspace(0.5, 1.0, 128) * checkerboard(shape)
    fields, pictures, beside = [], [], []
    for _ in range(_DRAWS):
        of_board = checkerboard_contrast((0.1 + board) * _light(rng, shape, 0.7))
        of_pictures = sequential_contrast(10 * _light(rng, shape, 0.7), _light(rng, shape, 0.4))
        of_target = black_beside_white((0.1 + ramp) * _light(rng, shape, 0.7), ramp)
        assert of_target is not None and of_target.standard_error is not None
        fields.append((of_board.value, of_board.standard_error))
        pictures.append((of_pictures.value, of_pictures.standard_error))
        beside.append((of_target.ratio, of_target.standard_error))
    for found in (fields, pictures, beside):
        _check_errors(found, 0.5, 1.5)
    dark = black_beside_white(board, board)
    assert dark is not None and dark.standard_error is None and dark.as_json()["standard_error"] is None


@pytest.mark.parametrize(("kind", "degrees"), [("square", 5.0), ("circle", -12.0)])
def test_the_error_of_an_edge_s_mtf_is_its_scatter(kind: str, degrees: float) -> None:
    """As above, but of 16 groups of rows each error is known to 1/√30 = 18 %, all 60 together to 2.4 %, and the slope
    scatters: over ten other seeds the ratio was 0.77 to 1.16, 0.91 and 1.02 in the mean, with 9 % as expected."""
    rng, base, found = np.random.default_rng(42), 0.2 + 3 * _edge(kind, degrees), []
    for _ in range(_DRAWS):
        mtf = slanted_edge_mtf(base * rng.gamma(1 / 0.05**2, 0.05**2, base.shape), REGION)
        found.append((mtf.half, mtf.half_error))
        assert mtf.as_json(None)["half_standard_error"] == mtf.half_error
    _check_errors(found, 0.45, 1.55)


def test_the_error_of_a_picture_s_mtf_is_its_scatter() -> None:
    """Blurred blocks with speckle of 0.1 and 0.2: as the ratios, the noise being that of some hundred frequencies."""
    rng, sigma = np.random.default_rng(43), 1.2
    target = np.kron(rng.uniform(0.05, 1, (48, 48)), np.ones((4, 4)))
    image = ndimage.gaussian_filter(target, sigma)
    for contrast in (0.1, 0.2):
        found = []
        for _ in range(_DRAWS):
            mtf = target_mtf(image * rng.gamma(1 / contrast**2, contrast**2, image.shape), target, (16, 16, 160, 120))
            found.append((mtf.half, mtf.half_error))
        _check_errors(found, 0.5, 1.5)
