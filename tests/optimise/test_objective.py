"""Loss, gradient, PSNR and picture of an image in every colour space; their channels; sRGB's curve."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from holoview.holograms.metrics.fidelity import psnr_linear_srgb, psnr_luminance
from holoview.holograms.optimise.objective import (
    Objective,
    PlaneLoss,
    make_objective,
    torch_srgb_encode,
    torch_srgb_encode_derivative,
)
from holoview.holograms.optimise.settings import LOSS_SPACES, Settings, find_loss_space
from holoview.holograms.optimise.wavelengths import channel_wavelength_derivatives, check_wavelength_search
from holoview.light.colour import D65_WHITE, SRGB_TO_XYZ, XYZ_TO_SRGB, cone_fundamentals, observer_weights, srgb_encode
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.util.errors import UserError

Bench = Callable[..., System]
PLANES, ROWS, COLUMNS = 3, 8, 12
REGION = (3, 1, 6, 5)
POINTWISE = [name for name, loss in LOSS_SPACES.items() if not loss.structure_weight]
THREE = [name for name in POINTWISE if len(LOSS_SPACES[name].matrix) == 3]


def _system(bench: Bench, **changes: Any) -> System:
    return bench(shape=[ROWS // 2, COLUMNS // 2], planes=["0.3 mm", "0.4 mm", "0.6 mm"], **changes)


def _stack(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((PLANES, ROWS, COLUMNS, 3))


def _objective(bench: Bench, double: bool = True, **settings: Any) -> Objective:
    return make_objective(make_plan(_system(bench)), _stack(), Settings(**settings), double=double)


def _image(objective: Objective, seed: int = 1) -> torch.Tensor:
    """Channels of an image that leaves the gamut on both sides."""
    rgb = np.random.default_rng(seed).normal(0.5, 0.6, (ROWS, COLUMNS, 3))
    return torch.from_numpy(np.ascontiguousarray(np.moveaxis(objective.loss.channels_of_rgb(rgb), -1, 0)))


def _evaluate(objective: Objective, plane: int, image: torch.Tensor, at_a_time: int = 3) -> PlaneLoss:
    """The loss of an image (channel, y, x), evaluated in blocks of rows, which is overwritten with its slope."""
    blocks = [slice(start, min(start + at_a_time, ROWS)) for start in range(0, ROWS, at_a_time)]
    norms = [objective.evaluate_rows(plane, rows, image[:, rows]).norms for rows in blocks]
    return objective.plane_losses([plane], torch.stack(norms)[None])[0]


def _plain_loss(name: str, image: torch.Tensor, wanted: np.ndarray, region: Any, weight: float) -> torch.Tensor:
    """weight·mean(residual²)/planes, written out; the target from linear sRGB."""
    matrix = torch.from_numpy(LOSS_SPACES[name].matrix @ SRGB_TO_XYZ)
    target = torch.einsum("cr,yxr->cyx", matrix, torch.from_numpy(wanted))
    if name == "srgb":
        image, target = (
            torch.sign(t) * (1.055 * t.abs() ** (1 / 2.4) - 0.055) * (t.abs() > 0.0031308)
            + 12.92 * t * (t.abs() <= 0.0031308)
            for t in (image, target)
        )
    x, y, width, height = region
    residual = (image - target)[:, y : y + height, x : x + width]
    return weight * residual.square().mean() / PLANES


@pytest.mark.parametrize("region", [None, REGION], ids=["everything", "region"])
@pytest.mark.parametrize("weights", [None, (1.0, 4.0, 1.0)], ids=["equal", "weighted"])
@pytest.mark.parametrize("name", POINTWISE)
def test_the_loss_and_its_slope_are_those_of_the_plain_formula(
    name: str, weights: Any, region: Any, bench: Bench
) -> None:
    objective = _objective(bench, loss=name, region=region, plane_weights=weights)
    for plane in range(PLANES):
        image = _image(objective)
        plain = image.clone().requires_grad_()
        weight = 1.0 if weights is None else weights[plane] / 2
        expected = _plain_loss(name, plain, _stack()[plane], region or (0, 0, COLUMNS, ROWS), weight)
        expected.backward()
        judged = _evaluate(objective, plane, image)
        assert judged.loss == pytest.approx(expected.item(), rel=1e-12)
        torch.testing.assert_close(image, plain.grad, rtol=1e-12, atol=1e-16)


@pytest.mark.parametrize("name", POINTWISE)
def test_the_target_itself_is_perfect(name: str, bench: Bench) -> None:
    objective = _objective(bench, loss=name)
    image = objective.target[1].clone()
    judged = _evaluate(objective, 1, image)
    assert (judged.loss, judged.psnr_db) == (0.0, 200.0)
    assert not image.any()


@pytest.mark.parametrize("name", THREE)
def test_the_psnr_is_that_of_the_metrics(name: str, bench: Bench) -> None:
    objective = _objective(bench, loss=name)
    image = _image(objective)
    expected = psnr_linear_srgb(objective.picture(image), _stack()[2]).mean_db
    assert _evaluate(objective, 2, image).psnr_db == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("name", ["luminance", "mono"])
def test_where_only_luminance_counts_its_psnr_is_given(name: str, bench: Bench) -> None:
    objective = _objective(bench, loss=name)
    image = _image(objective).clamp(0, 1)
    seen, wanted = np.zeros((2, ROWS, COLUMNS, 3))
    seen[..., 1], wanted[..., 1] = image[0], _stack()[2] @ SRGB_TO_XYZ[1]
    expected = psnr_luminance(seen, wanted).mean_db
    assert _evaluate(objective, 2, image).psnr_db == pytest.approx(expected, abs=1e-10)


def test_only_the_region_is_judged(bench: Bench) -> None:
    objective = _objective(bench, region=REGION)
    image = _image(objective)
    x, y, width, height = REGION
    cut = (..., slice(y, y + height), slice(x, x + width))
    other = _image(objective, seed=7)
    other[cut] = image[cut]
    pictures = [objective.picture(image)[y : y + height, x : x + width], _stack()[0][y : y + height, x : x + width]]
    first, second = _evaluate(objective, 0, image), _evaluate(objective, 0, other)
    assert first == second
    assert torch.equal(image, other)
    assert first.psnr_db == pytest.approx(psnr_linear_srgb(*pictures).mean_db, abs=1e-10)


def test_weights_are_relative(bench: Bench) -> None:
    first, second = (_objective(bench, plane_weights=weights) for weights in ((1.0, 2.0, 3.0), (10.0, 20.0, 30.0)))
    np.testing.assert_allclose(first.plane_weights, second.plane_weights, rtol=1e-15)
    np.testing.assert_allclose(first.plane_weights, [0.5, 1.0, 1.5], rtol=1e-15)


@pytest.mark.parametrize("name", THREE)
def test_a_picture_is_linear_srgb_whatever_the_channels(name: str, bench: Bench) -> None:
    objective = _objective(bench, loss=name)
    np.testing.assert_allclose(objective.picture(objective.target[1]), _stack()[1], rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", ["luminance", "mono"])
def test_a_picture_of_one_channel_is_grey(name: str, bench: Bench) -> None:
    objective = _objective(bench, loss=name)
    grey = (_stack()[1] @ SRGB_TO_XYZ[1])[..., None]
    np.testing.assert_allclose(objective.picture(objective.target[1]), np.repeat(grey, 3, axis=-1), rtol=1e-13)


def test_a_picture_stays_as_it_was_when_the_image_is_overwritten(bench: Bench) -> None:
    objective = _objective(bench)
    image = _image(objective)
    picture = objective.picture(image)
    before = picture.copy()
    _evaluate(objective, 0, image)
    np.testing.assert_array_equal(picture, before)


@pytest.mark.parametrize(
    ("changes", "settings", "name"),
    [
        ({}, {}, "linear-srgb"),
        ({"observer": "cie1931"}, {}, "linear-srgb"),
        ({"observer": "mono"}, {}, "mono"),
        ({"observer": "mono"}, {"loss": "xyz"}, "xyz"),
        ({}, {"loss": "mono"}, "mono"),
    ],
    ids=["eye", "cie1931", "mono", "mono, xyz", "eye, mono"],
)
def test_the_colours_of_lasers_are_those_of_the_observer(
    changes: dict[str, Any], settings: dict[str, Any], name: str, bench: Bench
) -> None:
    plan = make_plan(_system(bench, **changes))
    objective = make_objective(plan, _stack(), Settings(**settings), double=True)
    assert objective.loss is LOSS_SPACES[name]
    expected = np.ones((3, 1)) if name == "mono" else plan.colour_weights
    if name == "linear-srgb":
        expected = expected @ XYZ_TO_SRGB.T
    np.testing.assert_allclose(objective.wavelength_channels.numpy(), expected, rtol=1e-13)


def test_single_precision_is_the_default_and_near_double(bench: Bench) -> None:
    single, double = (_objective(bench, double=d, loss="srgb") for d in (False, True))
    assert single.target.dtype == torch.float32
    image = _image(double)
    found, expected = image.float(), image.clone()
    a, b = _evaluate(single, 0, found), _evaluate(double, 0, expected)
    assert a.loss == pytest.approx(b.loss, rel=1e-6)
    assert a.psnr_db == pytest.approx(b.psnr_db, abs=1e-5)
    assert float((found - expected).norm()) <= 1e-6 * float(expected.norm())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"region": (8, 0, 5, 8)}, "region: x, y, w, h = 8, 0, 5, 8; expected inside the simulated 12 x 8 samples"),
        ({"region": (0, 3, 5, 6)}, "region: "),
        ({"plane_weights": (1.0, 2.0)}, "plane weights: 2 of them; expected one for each of 3 planes"),
        ({"loss": "lab"}, 'loss: "lab"'),
    ],
    ids=str,
)
def test_settings_that_do_not_fit_are_refused(settings: dict[str, Any], message: str, bench: Bench) -> None:
    with pytest.raises(UserError, match=message):
        _objective(bench, **settings)


KNEE = 0.0031308
COLOURED = [name for name in LOSS_SPACES if not LOSS_SPACES[name].ignores_wavelength]
# Between whole nanometres: the tables of the observer are linear there.
WAVELENGTHS_M = np.array([455.4, 531.7, 601.3, 648.8]) * 1e-9


def _light() -> torch.Tensor:
    """Both signs, both sides of the knee, away from the knee itself."""
    positive = torch.cat([torch.tensor([0.0, 1e-30, 1e-6, 0.003, 0.00314]), torch.logspace(-2, 1, 20)]).double()
    return torch.cat([-positive.flip(0), positive])


@pytest.mark.parametrize(("dtype", "rtol"), [(torch.float32, 1e-6), (torch.float64, 1e-14)])
def test_the_curve_is_that_of_the_colour_module(dtype: torch.dtype, rtol: float) -> None:
    light = _light().to(dtype)
    np.testing.assert_allclose(torch_srgb_encode(light).numpy(), srgb_encode(light.numpy()), rtol=rtol, atol=0)


def test_the_curve_is_odd_and_so_its_slope_even() -> None:
    light = _light()
    assert torch.equal(torch_srgb_encode(-light), -torch_srgb_encode(light))
    assert torch.equal(torch_srgb_encode_derivative(-light), torch_srgb_encode_derivative(light))


def test_the_curves_slope_is_what_central_differences_approach() -> None:
    light = _light()
    step = 1e-6 * light.abs().clamp_min(1e-6)
    expected = (torch_srgb_encode(light + step) - torch_srgb_encode(light - step)) / (2 * step)
    torch.testing.assert_close(
        torch_srgb_encode_derivative(light), expected, rtol=1e-8, atol=0
    )  # rounding 1e-16 over 1e-6 of light


def test_the_slope_is_steepest_in_the_dark_and_finite_there() -> None:
    for dtype in (torch.float32, torch.float64):
        dark = torch.tensor([0.0, -0.0, 1e-40, -1e-40, KNEE / 2, -KNEE / 2], dtype=dtype)
        assert torch.equal(torch_srgb_encode_derivative(dark), torch.full_like(dark, 12.92))
        assert bool(torch.isfinite(torch_srgb_encode(dark)).all())
    assert (
        float(torch_srgb_encode_derivative(torch.linspace(-2, 2, 1001)).max()) <= 12.93
    )  # the standard's knee is off by 1e-7


@pytest.mark.parametrize("name", COLOURED)
def test_a_laser_and_a_target_of_the_same_colour_have_the_same_channels(name: str) -> None:
    xyz = observer_weights("eye", WAVELENGTHS_M)
    rgb = xyz @ np.linalg.inv(SRGB_TO_XYZ).T
    assert (rgb < 0).any()  # lasers lie outside the gamut
    loss = find_loss_space(name)
    np.testing.assert_allclose(loss.channels_of_rgb(rgb), loss.channels_of_xyz(xyz), rtol=1e-12, atol=1e-14)
    assert loss.channels_of_xyz(xyz).shape == (4, len(loss.matrix))


def test_channels_are_what_their_names_say() -> None:
    xyz = observer_weights("eye", WAVELENGTHS_M)
    np.testing.assert_allclose(find_loss_space("xyz").channels_of_xyz(xyz), xyz, rtol=1e-15)
    np.testing.assert_allclose(find_loss_space("luminance").channels_of_xyz(xyz), xyz[:, 1:2], rtol=1e-15)
    cones = find_loss_space("lms").channels_of_xyz(xyz)
    np.testing.assert_allclose(cones, cone_fundamentals(WAVELENGTHS_M), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(find_loss_space("linear-srgb").channels_of_xyz(D65_WHITE[None]), [[1, 1, 1]], rtol=1e-14)
    np.testing.assert_array_equal(find_loss_space("linear-srgb").matrix, find_loss_space("srgb").matrix)


def test_a_mono_camera_sees_every_laser_alike_and_a_targets_luminance() -> None:
    loss = find_loss_space("mono")
    np.testing.assert_array_equal(loss.channels_of_xyz(observer_weights("eye", WAVELENGTHS_M)), np.ones((4, 1)))
    rgb = np.array([[0.2, 0.7, 0.1], [1.0, 1.0, 1.0]])
    np.testing.assert_allclose(loss.channels_of_rgb(rgb), rgb @ SRGB_TO_XYZ[1:2].T, rtol=1e-14)


@pytest.mark.parametrize("name", LOSS_SPACES)
def test_three_channels_go_back_to_rgb_and_one_does_not(name: str) -> None:
    loss = find_loss_space(name)
    if len(loss.matrix) == 1:
        assert loss.to_rgb is None
        return
    rgb = np.random.default_rng(0).normal(size=(5, 7, 3))
    assert loss.to_rgb is not None
    np.testing.assert_allclose(loss.channels_of_rgb(rgb) @ loss.to_rgb.T, rgb, rtol=0, atol=1e-13)


def test_which_losses_are_encoded_which_see_structure_and_which_no_wavelength() -> None:
    assert [name for name, loss in LOSS_SPACES.items() if loss.is_encoded] == ["srgb", "ms-ssim"]
    assert [name for name, loss in LOSS_SPACES.items() if loss.structure_weight] == ["ms-ssim"]
    assert [name for name, loss in LOSS_SPACES.items() if loss.ignores_wavelength] == ["mono"]


def test_an_unknown_loss_is_refused_with_the_nearest() -> None:
    with pytest.raises(UserError, match=r'loss: "srbg"; expected linear-srgb, srgb, xyz.* did you mean srgb\?'):
        find_loss_space("srbg")


@pytest.mark.parametrize("name", COLOURED)
def test_colour_slopes_are_what_central_differences_approach(name: str) -> None:
    loss, step_m = find_loss_space(name), 1e-12
    sides = [loss.channels_of_xyz(observer_weights("eye", WAVELENGTHS_M + sign * step_m)) for sign in (1, -1)]
    expected = (sides[0] - sides[1]) / (2 * step_m)
    found = channel_wavelength_derivatives(loss, WAVELENGTHS_M, "eye")
    # Rounding of channels of order 1 over 2 pm: 1e-4/m, beside slopes of 1e7/m.
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-2)
    assert (np.abs(found).max(axis=1) > 1e5).all()


@pytest.mark.parametrize(("name", "observer"), [("mono", "eye"), ("mono", "mono"), ("xyz", "mono")])
def test_colours_that_do_not_depend_on_the_wavelength_have_no_slope(name: str, observer: str) -> None:
    loss = find_loss_space(name)
    np.testing.assert_array_equal(
        channel_wavelength_derivatives(loss, WAVELENGTHS_M, observer), np.zeros((4, len(loss.matrix)))
    )


def test_wavelengths_that_an_observer_doesn_t_see_are_refused() -> None:
    for observer in ("eye", "cie1931", "age 60, field 4"):  # each has slopes
        check_wavelength_search(observer, Settings())
    check_wavelength_search("mono", Settings(wavelength_range_m=(300e-9, 900e-9)))
    with pytest.raises(UserError, match=r"wavelength range: .*900 nm"):
        check_wavelength_search("eye", Settings(wavelength_range_m=(400e-9, 900e-9)))
