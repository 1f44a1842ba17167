"""Colour spaces of the loss: channels, and sRGB's curve with its derivative."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from holoview.colour import D65_WHITE, SRGB_TO_XYZ, cone_fundamentals, observer_weights, srgb_encode
from holoview.optimise.objective import torch_srgb_encode, torch_srgb_encode_derivative
from holoview.optimise.settings import LOSS_SPACES, Settings, find_loss_space
from holoview.optimise.wavelengths import channel_wavelength_derivatives, check_wavelength_search
from holoview.util.errors import UserError

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


def test_slopes_of_an_observer_without_cones_are_refused() -> None:
    with pytest.raises(UserError, match='free wavelengths: observer = "cie1931"; expected "eye" or "mono"'):
        check_wavelength_search("cie1931", Settings())
    check_wavelength_search("eye", Settings())
    check_wavelength_search("mono", Settings(wavelength_range_m=(300e-9, 900e-9)))
    with pytest.raises(UserError, match=r"wavelength range: .*900 nm"):
        check_wavelength_search("eye", Settings(wavelength_range_m=(400e-9, 900e-9)))
