"""Light through chains of elements: against an optics of its own in numpy, and against what is known analytically."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import holoview as hv
from holoview.holograms.view import field_at, random_drive, simulate
from holoview.light.engine.point_light import beam_at_point
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs

Complex = NDArray[np.complex128]

UM, MM, NM = 1e-6, 1e-3, 1e-9
SHAPE, DX = (30, 24), 4 * UM  # of the modulators' pixels; of the samples, two for each pixel


def chain(*elements: dict[str, Any], wavelengths: list[float] | None = None, **changes: Any) -> System:
    """A bench with these elements, one wavelength and a plane at 3 mm unless something else is said."""
    lasers = wavelengths or [532 * NM]
    values: dict[str, Any] = {"planes_m": [3 * MM], "observer": "mono"} | changes
    return System(lasers, [[1.0] * len(lasers)], elements=elements, **values)


def pixels(kind: str, **keys: Any) -> dict[str, Any]:
    """An element of the pixels of all modulators here."""
    return {"kind": kind, "pitch": 8 * UM, "shape": SHAPE} | keys


def light_behind(system: System, drive: Any, stage: str, laser: int = 0) -> Complex:
    return np.asarray(field_at(system, drive, stage=stage, laser=laser).values)


# --- an optics of its own ---------------------------------------------------------------------------------------------


def middle(n: int) -> NDArray[np.float64]:
    """Positions of n samples, counted from their middle."""
    return np.arange(n) - (n - 1) / 2


def through_space(field: Complex, distance_m: float, λ: float, na: float = np.inf) -> Complex:
    """The angular spectrum over twice the window, with the band limit of Matsushima and Shimobaba and a round iris."""
    padded = [2 * n for n in field.shape]
    start = [(p - n) // 4 * 2 for p, n in zip(padded, field.shape, strict=True)]
    window = tuple(slice(s, s + n) for s, n in zip(start, field.shape, strict=True))
    whole = np.zeros(padded, complex)
    whole[window] = field
    sines, passes = [], []
    for n in padded:
        k = np.round(np.fft.fftfreq(n) * n)
        highest = 1 / (λ * np.sqrt((2 * distance_m / (n * DX)) ** 2 + 1)) * (n * DX)
        sines.append(λ * k / (n * DX))
        passes.append(np.abs(k) <= np.floor(highest))
    a = sines[0][:, None] ** 2 + sines[1][None, :] ** 2
    transfer = np.exp(-2j * np.pi * distance_m / λ * a / (1 + np.sqrt(1 - a)))
    transfer *= passes[0][:, None] & passes[1][None, :] & (np.sqrt(a) <= na)
    return np.asarray(np.fft.ifft2(np.fft.fft2(whole) * transfer)[window])


def fourier_plane(field: Complex, focal_m: float, λ: float) -> Complex:
    """−i/(λf)·∫u·exp(−2πi·x·x'/(λf)), as a sum over the samples."""
    y, x = (np.exp(-2j * np.pi * DX**2 / (λ * focal_m) * np.outer(middle(n), middle(n))) for n in field.shape)
    return np.asarray(-1j * DX**2 / (λ * focal_m) * (y @ field @ x))


def on_samples(pattern: NDArray[Any], size: int, field: tuple[int, int], off: tuple[int, int] = (0, 0)) -> Complex:
    """Pixels of some samples in the middle of a field, moved by some samples; nothing passes beside them."""
    fine = np.kron(pattern, np.ones((size, size)))
    out = np.zeros(field, complex)
    y, x = ((n - m) // 2 + o for n, m, o in zip(field, fine.shape, off, strict=True))
    out[y : y + fine.shape[0], x : x + fine.shape[1]] = fine
    return out


def every_kind(mask_file: str) -> tuple[dict[str, Any], ...]:
    """A chain with every kind of element that may stand in one."""
    return (
        pixels("phase", stroke=800 * NM, levels=16),
        {"kind": "space", "distance": 1 * MM, "iris_na": 0.03},
        pixels("complex", stroke=600 * NM),
        {"kind": "mask", "pitch": 4 * UM, "file": mask_file},
        {"kind": "lens", "focal_length": 20 * MM},
        {"kind": "space", "distance": 2 * MM},
        pixels("amplitude", pitch=24 * UM, shape=(8, 8), offset=[0.0, 24 * UM], range=[0.2, 0.9], name="coarse"),
        {"kind": "fourier", "focal_length": 2 * MM},
        pixels("amplitude", levels=2, name="binary"),
        {"kind": "space", "iris_na": 0.035},
    )


def independent_plane(system: System, drive: dict[str, NDArray[Any]], mask: NDArray[Any], laser: int) -> Complex:
    """The field in the plane of `every_kind`."""
    λ = float(system.wavelengths_m[laser])
    field = (60, 60)  # 12 samples more along x: the coarse modulator stands 6 samples off the axis
    levels = np.rint(drive["phase"][0] * 15) / 15
    u = on_samples(np.exp(2j * np.pi * levels * 800 * NM / λ), 2, field)
    u = through_space(u, 1 * MM, λ, na=0.03)
    turns = np.mod(np.angle(drive["complex"][0]) / (2 * np.pi), 1)
    u = u * on_samples(np.abs(drive["complex"][0]) * np.exp(2j * np.pi * turns * 600 * NM / λ), 2, field)
    u = u * on_samples(np.exp(2j * np.pi * mask[0] / λ) * mask[1], 1, field)
    r2 = (middle(field[0])[:, None] ** 2 + middle(field[1])[None, :] ** 2) * DX**2
    u = through_space(u * np.exp(-1j * np.pi * r2 / (λ * 20 * MM)), 2 * MM, λ)
    u = u * on_samples(0.2 + 0.7 * drive["coarse"][0], 6, field, (0, 6))
    u = fourier_plane(u, 2 * MM, λ) * on_samples(np.rint(drive["binary"][0]), 2, field)
    return through_space(u, 3 * MM, λ, na=0.035)


def test_every_kind_of_element_does_what_an_independent_optics_says(tmp_path: Any) -> None:
    random = np.random.default_rng(3)
    mask = np.stack([random.uniform(-1e-6, 1e-6, (60, 48)), random.random((60, 48))])
    np.save(tmp_path / "mask.npy", mask)
    system = chain(*every_kind(str(tmp_path / "mask.npy")), wavelengths=[532 * NM, 580 * NM])
    drive = {
        name: each.astype(complex if each.dtype.kind == "c" else float) for name, each in random_drive(system).items()
    }
    drive["complex"] *= random.random(drive["complex"].shape)
    for laser in (0, 1):
        found = light_behind(system, drive, "plane", laser)
        expected = independent_plane(system, drive, mask, laser)
        # complex128: some ten roundings of 1e-16 in phases of up to 1e4 turns, which are reduced exactly before
        assert np.linalg.norm(found - expected) < 1e-11 * np.linalg.norm(expected)


# --- what is known ----------------------------------------------------------------------------------------------------


def test_a_chain_of_the_short_form_is_the_bench_of_today_to_the_last_bit() -> None:
    old = hv.load("holochrome-8").with_(shape=SHAPE, planes=["4 mm"])
    keys = ("wavelengths_m", "amplitudes", "planes_m", "sampling", "observer", "name", "description")
    new = System(elements=old.elements, **{key: getattr(old, key) for key in keys})
    assert new == old
    drive = random_drive(old)
    by_name = dict(zip(new.drive_shapes, np.moveaxis(drive, 1, 0), strict=True))
    assert np.array_equal(
        simulate(new, by_name, backend="torch").intensity, simulate(old, drive, backend="torch").intensity
    )


def test_in_the_fourier_plane_of_an_open_aperture_stands_a_sinc() -> None:
    focal_m, λ = 2 * MM, 532 * NM
    system = chain(pixels("amplitude"), {"kind": "fourier", "focal_length": focal_m})
    found = light_behind(system, np.ones(SHAPE), "fourier")
    rate = DX**2 / (λ * focal_m)  # of a sum of samples the sinc is sin(πnαk)/sin(πα k), which isn't 0/0 off the middle
    y, x = (np.sin(np.pi * rate * n * middle(n)) / np.sin(np.pi * rate * middle(n)) for n in (60, 48))
    assert np.allclose(found, -1j * rate * y[:, None] * x[None, :], rtol=0, atol=1e-11)


def test_two_fourier_elements_mirror_the_light() -> None:
    focal_m = 48 * DX**2 / (532 * NM)  # at which the samples of the plane are those of a discrete transform
    fourier = {"kind": "fourier", "focal_length": focal_m}
    square = {"kind": "phase", "pitch": 8 * UM, "shape": (24, 24), "stroke": 800 * NM}
    system = chain(square, fourier | {"name": "first"}, fourier | {"name": "second"})
    drive = random_drive(system, seed=1)
    before, behind = (light_behind(system, drive, stage) for stage in ("phase", "second"))
    assert np.allclose(behind, -before[::-1, ::-1], rtol=0, atol=1e-11)  # −i twice


def test_a_lens_focuses_at_its_focal_length() -> None:
    focal_m, λ = 12 * MM, 532 * NM
    system = chain(pixels("amplitude"), {"kind": "lens", "focal_length": focal_m}, planes_m=[focal_m])
    found = np.abs(light_behind(system, np.ones(SHAPE), "plane"))
    brightest = np.unravel_index(np.argmax(found), found.shape)
    assert set(brightest) <= {23, 24, 29, 30}  # the four samples around the axis
    # The middle of an Airy-like pattern: area/(λf), less 1.2 % half a sample off the axis along x and 0.5 % along y;
    # a band limit and the fourth order of the lens take less than 1 %.
    area_m2 = SHAPE[0] * SHAPE[1] * (8 * UM) ** 2
    expected = np.prod([np.sinc(n * 8 * UM * DX / 2 / (λ * focal_m)) for n in SHAPE]) * area_m2 / (λ * focal_m)
    assert found.max() == pytest.approx(expected, rel=0.02)


def test_a_lens_of_glass_focuses_blue_light_nearer() -> None:
    focal_m, abbe = 12 * MM, 30.0
    lens = {"kind": "lens", "focal_length": focal_m, "abbe": abbe}
    powers = []
    for λ in (486.13 * NM, 587.56 * NM, 656.27 * NM):
        system = chain(pixels("amplitude"), lens, planes_m=[focal_m], wavelengths=[λ])
        ratio = light_behind(system, np.ones(SHAPE), "lens") / light_behind(system, np.ones(SHAPE), "amplitude")
        x = middle(48) * DX
        phase = np.unwrap(np.angle(ratio[30]))
        powers.append(-np.polyfit(x, phase, 2)[0] * λ / np.pi)  # of −πx²/(λf)
    # By its definition V = (n_d − 1)/(n_F − n_C), and powers are in proportion to n − 1; rounding of the fit alone.
    assert powers[1] == pytest.approx(1 / focal_m, rel=1e-9)
    assert powers[1] / (powers[0] - powers[2]) == pytest.approx(abbe, rel=1e-7)


def test_modulators_side_by_side_add_as_a_complex_modulator() -> None:
    """(exp(iα) + exp(iβ))/2, the mean; a third one beside them takes a third of the light's amplitude."""
    first, second = (
        pixels("phase", stroke=800 * NM, name="arm 1"),
        pixels("phase", stroke=700 * NM, name="arm 2", beside="arm 1"),
    )
    stop, λ = {"kind": "space", "square": "first order"}, 532 * NM
    for more in ((), (pixels("amplitude", beside="arm 1"),)):
        system = chain(first, second, *more, stop)
        drives = {name: each.astype(float) for name, each in random_drive(system).items()}
        light = [np.exp(2j * np.pi * drives[f"arm {n}"] * stroke * NM / λ) for n, stroke in ((1, 800), (2, 700))]
        light += [drives["amplitude"].astype(complex)] if more else []
        expected = light_behind(chain(pixels("complex"), stop), np.mean(light, axis=0), "plane")
        found = light_behind(system, drives, "plane")
        assert np.linalg.norm(found - expected) < 1e-12 * np.linalg.norm(expected)  # complex128
        assert system.stage_behind("arm 2") == "arm 1"


def test_an_arm_has_its_own_place_and_masks_may_stand_in_one() -> None:
    dark = pixels("amplitude", beside="phase", offset=[16 * UM, 0.0])
    mask = {"kind": "mask", "pitch": 4 * UM, "shape": (60, 48), "pattern": "half plane", "beside": "phase"}
    system = chain(pixels("phase", stroke=800 * NM), dark, mask)
    drive = {name: each.astype(float) for name, each in random_drive(system).items()}
    half = np.zeros((60, 48))
    half[:30] = 1.0
    field = (68, 48)  # the field holds the arm that stands 4 samples off the axis
    arms = [
        on_samples(np.exp(2j * np.pi * drive["phase"][0] * 800 / 532), 2, field),
        on_samples(drive["amplitude"][0], 2, field, (4, 0)),
        on_samples(half, 1, field),
    ]
    np.testing.assert_allclose(light_behind(system, drive, "phase"), np.mean(arms, axis=0), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("beside", "words"), [("nowhere", 'right before it, "phase"'), ("amplitude", 'right before it, "phase"')]
)
def test_what_cannot_stand_side_by_side_is_a_sentence(beside: str, words: str) -> None:
    with pytest.raises(hv.UserError, match=words):
        chain(pixels("phase", stroke=800 * NM), pixels("amplitude", beside=beside))
    with pytest.raises(hv.UserError, match="no element with pixels"):
        space = {"kind": "space", "distance": 1 * MM}
        chain(pixels("phase", stroke=800 * NM), space, pixels("amplitude", beside="phase"))


def test_the_light_of_a_point_tells_what_each_arm_gives() -> None:
    """The contributions of all arms, as fields, add up to the light of the point."""
    second = pixels("phase", stroke=700 * NM, beside="arm 1")
    elements = (
        pixels("amplitude"),
        {"kind": "space", "distance": 1 * MM},
        pixels("phase", stroke=800 * NM, name="arm 1"),
    )
    for before in (elements, elements[2:]):
        system = chain(*before, second)
        plan = hv.make_plan(system)
        executor = TorchExecutor(plan, FrameInputs(plan, random_drive(system)), double=True)
        found = beam_at_point(executor, plan.beams([0])[0], 0, (31, 20))
        assert len(found.contributions) == len(system.drive_shapes)
        total = sum(found.contributions[-2:]).sum()
        assert abs(total - found.field) < 1e-11 * np.abs(found.contributions[-1]).sum()


def test_a_grating_sends_the_light_to_its_orders() -> None:
    focal_m, λ, period_m = 2 * MM, 532 * NM, 32 * UM
    grating = {"kind": "mask", "pitch": 4 * UM, "shape": (60, 48), "pattern": "grating", "period": period_m}
    system = chain(pixels("amplitude"), grating | {"stroke": λ / 2}, {"kind": "fourier", "focal_length": focal_m})
    power = np.abs(light_behind(system, np.ones(SHAPE), "fourier")) ** 2
    order = λ * focal_m / period_m / DX  # in samples of the Fourier plane
    x = middle(48)
    shares = [power[:, np.abs(x - m * order) < order / 2].sum() / (60 * 48) for m in (-1, 0, 1)]
    # Lines of half a wave of half the period: (2/π)² = 40.5 % in either first order, nothing in the zero order.
    assert shares[0] == pytest.approx(shares[2], rel=1e-9)
    assert shares[1] < 0.05  # the tails of the orders beside it: six periods
    assert shares[0] == pytest.approx(4 / np.pi**2, abs=0.03)


def test_a_chain_that_only_changes_phases_keeps_the_power() -> None:
    mask = {"kind": "mask", "pitch": 4 * UM, "shape": (60, 48), "pattern": "random", "stroke": 700 * NM}
    gap = {"kind": "space", "distance": 1 * MM}
    lens = {"kind": "lens", "focal_length": 30 * MM}
    periodic = hv.Sampling(propagation="periodic")
    system = chain(
        pixels("phase", stroke=800 * NM), gap, mask, lens, gap, pixels("phase", stroke=800 * NM), sampling=periodic
    )
    found = light_behind(system, random_drive(system), "plane")
    assert np.sum(np.abs(found) ** 2) == pytest.approx(60 * 48, rel=1e-12)


def test_planes_are_told_from_the_element_that_is_named() -> None:
    slm, gap = pixels("phase", stroke=800 * NM, name="slm"), {"kind": "space", "distance": 2 * MM}
    system = chain(slm, gap, pixels("amplitude"), planes_from="slm")
    plan = hv.make_plan(system)
    assert (plan.planes[0].nominal_m, plan.planes[0].true_m) == (3 * MM, 1 * MM)
    with pytest.raises(hv.UserError, match="before the last element"):
        hv.make_plan(system, ["1 mm"])


def test_patterns_are_given_by_name_by_order_or_alone() -> None:
    system = chain(pixels("phase", stroke=800 * NM), pixels("amplitude"))
    drive = random_drive(system)
    by_name = simulate(system, drive, backend="torch64").intensity
    assert np.array_equal(by_name, simulate(system, list(drive.values()), backend="torch64").intensity)
    alone = chain(pixels("amplitude"))
    assert simulate(alone, np.ones(SHAPE), backend="torch64").intensity.shape == (1, 1, 60, 48)


@pytest.mark.parametrize(
    ("drive", "words"),
    [
        ({"phase": np.zeros(SHAPE)}, 'none for "amplitude"'),
        ({"phase": np.zeros(SHAPE), "amplitud": np.zeros(SHAPE)}, '"amplitud"'),
        ([np.zeros(SHAPE)], "1 patterns"),
        ([np.zeros(SHAPE), np.full(SHAPE, 1.5)], "from 1.5 to 1.5"),
        ([np.zeros(SHAPE), np.full(SHAPE, np.nan)], "nan"),
        ([np.zeros(SHAPE), np.zeros((3, 4))], r"shape \(3, 4\)"),
        ([np.zeros(SHAPE), np.zeros(SHAPE, complex)], "type complex128"),
        (np.zeros(SHAPE), "one array"),
    ],
)
def test_patterns_that_do_not_fit_are_named(drive: Any, words: str) -> None:
    with pytest.raises(hv.UserError, match=words):
        simulate(chain(pixels("phase", stroke=800 * NM), pixels("amplitude")), drive)
