"""Compiled kernels against those of torch; which of them is chosen, and what is remembered of it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from holoview.holograms.hologram import Hologram
from holoview.holograms.optimise import chain_kernels, chain_loop, solve, vector_kernels
from holoview.holograms.optimise import kernel_choice as module
from holoview.holograms.optimise.checkpoint import Checkpoint, load_checkpoint
from holoview.holograms.optimise.compiled_model import CompiledKernels
from holoview.holograms.optimise.forward_model import ForwardModel
from holoview.holograms.optimise.hologram_job import RunOptions, optimise_hologram
from holoview.holograms.optimise.kernel_choice import Compiler, choose_kernels, load_kernels, will_compile
from holoview.holograms.optimise.problem import EvaluationRequest, Problem
from holoview.holograms.optimise.propagation import TORCH_KERNELS
from holoview.holograms.optimise.settings import LOSS_SPACES, Settings
from holoview.holograms.view import random_drive
from holoview.light.model import preset
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.util.errors import UserError

pytest.importorskip("numba")

Bench = Callable[..., System]
Noise = Callable[..., torch.Tensor]
UNIT = 2.0**-53
"""Rounding of one operation in float64."""
LASERS, SOURCES, ROWS, SAMPLES = 3, 2, 5, 37
_PIXELS = {"pitch": 8e-6, "shape": (12, 16), "stroke": 800e-9}
_CHAIN_KEYS: dict[str, Any] = {
    "elements": [{"kind": "phase"} | _PIXELS, {"kind": "mask", "pattern": "random"} | _PIXELS],
    "planes_m": [0.4e-3, 0.5e-3],
}


@pytest.fixture(scope="module")
def compiled() -> CompiledKernels:
    return CompiledKernels()


def _fields(noise: Noise, layout: str) -> torch.Tensor:
    """Fields (laser, source, row, x) with rows of other lengths than `SAMPLES`, as a padded FFT leaves them."""
    order = {"beam by beam": (LASERS, SOURCES, ROWS), "row by row": (ROWS, LASERS, SOURCES)}[layout]
    real, imaginary = (noise(seed, *order, SAMPLES + 6) - 0.5 for seed in (0, 1))
    fields = torch.complex(real, imaginary)[..., :SAMPLES]
    return fields if layout == "beam by beam" else fields.movedim(0, 2)


LAYOUTS = pytest.mark.parametrize("layout", ["beam by beam", "row by row"])
CHANNELS = pytest.mark.parametrize("channels", [1, 3])


@LAYOUTS
@CHANNELS
def test_images_are_equal_to_rounding(layout: str, channels: int, noise: Noise, compiled: CompiledKernels) -> None:
    fields, weights = _fields(noise, layout), noise(2, LASERS * SOURCES, channels) - 0.3
    expected = TORCH_KERNELS.mix(fields, weights)
    power = fields.abs().square().flatten(0, 1)
    # Each of n terms is rounded by its square, its sum and its weight, and by n sums: in both, in any order.
    count = LASERS * SOURCES
    bound = 2 * (count + 4) * UNIT * torch.einsum("bc,byx->cyx", weights.abs(), power)
    assert bool(((compiled.mix(fields, weights) - expected).abs() <= bound).all())


@LAYOUTS
@CHANNELS
def test_gradients_are_equal_to_rounding_and_nothing_else_is_written(
    layout: str, channels: int, noise: Noise, compiled: CompiledKernels
) -> None:
    weights, slopes = noise(2, LASERS * SOURCES, channels) - 0.3, noise(3, channels, ROWS, SAMPLES) - 0.5
    before, found, expected = (_fields(noise, layout) for _ in range(3))
    compiled.replace_by_adjoint(found, weights, slopes)
    TORCH_KERNELS.replace_by_adjoint(expected, weights, slopes)
    largest = torch.einsum("bc,cyx->byx", 2 * weights.abs(), slopes.abs()).view(LASERS, SOURCES, ROWS, SAMPLES)
    bound = 2 * (channels + 3) * UNIT * largest * before.abs()
    assert bool(((found - expected).abs() <= bound).all())
    torch.testing.assert_close(
        expected.flatten(0, 1),
        2 * torch.einsum("bc,cyx->byx", weights, slopes) * before.conj().resolve_conj().flatten(0, 1),
        rtol=1e-13,
        atol=1e-15,
    )
    beyond, untouched = (f.as_strided((6,), (1,), f[0, 0, 0].storage_offset() + SAMPLES) for f in (found, before))
    assert torch.equal(beyond, untouched)


@LAYOUTS
def test_sums_of_imaginary_parts_are_equal_to_rounding(layout: str, noise: Noise, compiled: CompiledKernels) -> None:
    products, factors = _fields(noise, layout), noise(2, LASERS) - 0.5
    before = noise(3, ROWS, SAMPLES) - 0.5
    found, expected = before.clone(), before.clone()
    compiled.add_imaginary(products, factors, found)
    TORCH_KERNELS.add_imaginary(products, factors, expected)
    terms = factors.abs()[:, None, None, None] * products.imag.abs()
    # each of n terms is rounded by its factor and by n sums, in both
    bound = 2 * (LASERS * SOURCES + 1) * UNIT * (before.abs() + terms.sum(dim=(0, 1)))
    assert bool(((found - expected).abs() <= bound).all())
    whole = before.numpy() + np.einsum("l,lsyx->yx", factors.numpy(), products.imag.numpy())
    assert bool(((expected - torch.from_numpy(whole)).abs() <= bound).all())


@CHANNELS
def test_residuals_are_equal_to_rounding(channels: int, noise: Noise, compiled: CompiledKernels) -> None:
    """Of a part of an image, as a region cuts it, whose values lie below 0 and above 1 too."""
    target = (noise(5, channels, ROWS + 3, SAMPLES + 4) * 3 - 1)[:, 1 : ROWS + 1, 2 : SAMPLES + 2]
    shown = noise(4, channels, ROWS + 2, SAMPLES) * 3 - 1
    found, expected = shown.clone()[:, :ROWS], shown.clone()[:, :ROWS]
    norms = compiled.replace_by_residual(found, target, 0.7)
    expected_norms = TORCH_KERNELS.replace_by_residual(expected, target, 0.7)
    torch.testing.assert_close(found, 0.7 * (shown[:, :ROWS] - target), rtol=4 * UNIT, atol=4 * UNIT)
    torch.testing.assert_close(expected, found, rtol=4 * UNIT, atol=4 * UNIT)
    terms = channels * ROWS * SAMPLES  # of a sum of squares, each of which is rounded
    for norm, other in zip(norms, expected_norms, strict=True):
        assert float(norm) == pytest.approx(float(other), rel=(terms + 4) * UNIT)


REQUEST = EvaluationRequest(path_gradient=True, optimal_amplitudes=True)
BENCHES: dict[str, dict[str, Any]] = {
    "padded": {},
    "first orders": {"relay1.square": "first order", "relay2.square": "first order"},
    "sources, two frames": {
        "source": {"directions": [[0, 0], [0.01, -0.02]]},
        "amplitudes": [[1.0, 0.5, 0.0], [0.7, 0.9, 1.2]],
    },
    "three samples a pixel": {"upsample": 3},
    "bands off the centre": {"relay1.square": "first order", "relay1.centre_na": [0, 0.01], "relay2.iris_na": 0.02},
    "a last band off the centre": {"relay2.iris_na": 0.03, "relay2.centre_na": [0.01, -0.02]},
    "glass": {"relay2": {"iris_na": 0.04, "apodisation_na": 0.03, "aberration": {"Z4": "70 nm", "Z8": "40 nm"}}},
    "an eye": {"eye": {"eyepiece": "5 mm", "pupil": "0.5 mm", "pupil_x": "0.1 mm", "accommodation": ["3 D", "9 D"]}},
    "rows that fill no vector": {"shape": (17, 19)},
}


@pytest.mark.parametrize("name", BENCHES)
def test_rows_of_a_transfer_function_that_are_equal_are_stored_once(
    name: str, bench: Bench, compiled: CompiledKernels
) -> None:
    plan = make_plan(bench(**BENCHES[name]))
    folded = ForwardModel(plan, kernels=compiled).transfer_functions
    whole = ForwardModel(plan).transfer_functions
    shares = [len(block[0, 0]) / len(folded.plane_rows) for block in folded.planes]
    is_even = name not in ("a last band off the centre", "glass", "an eye")
    assert all(0.5 <= share < 0.6 if is_even else share == 1 for share in shares)
    every = slice(0, len(plan.system.wavelengths_m))
    for plane in range(len(plan.planes_m)):
        found = torch.cat([folded.of_plane(block, every, plane) for block in range(len(folded.planes))], dim=-1)
        expected = torch.cat([whole.of_plane(block, every, plane) for block in range(len(whole.planes))], dim=-1)
        assert torch.equal(found, expected)


@pytest.mark.parametrize("loss", ["linear-srgb", "mono"])
@pytest.mark.parametrize("name", BENCHES)
def test_the_pass_from_lines_to_the_loss_and_back_is_that_of_torch(
    name: str, loss: str, bench: Bench, noise: Noise, compiled: CompiledKernels
) -> None:
    system = bench(**BENCHES[name])
    grid = make_plan(system).grid
    stack = np.random.default_rng(3).uniform(0.1, 0.6, (len(system.planes_m), *grid.shape, 3))
    found, expected = (
        Problem(system, stack, Settings(loss=loss), double=True, kernels=kernels).evaluate(
            noise(0, *system.drive_shape) * 825e-9, np.array(system.amplitudes), REQUEST
        )
        for kernels in (compiled, TORCH_KERNELS)
    )
    near = 1e-12  # sums of some thousand terms in another order: 1e3·2⁻⁵³
    assert found.loss == pytest.approx(expected.loss, rel=near)
    assert found.psnr_db == pytest.approx(expected.psnr_db, rel=near)
    np.testing.assert_allclose(found.picture(), expected.picture(), rtol=1e-9, atol=near)
    assert found.path_gradient is not None and expected.path_gradient is not None
    difference = float((found.path_gradient - expected.path_gradient).norm())
    assert difference <= near * float(expected.path_gradient.norm())
    assert found.optimal_amplitudes is not None and expected.optimal_amplitudes is not None
    np.testing.assert_allclose(found.optimal_amplitudes, expected.optimal_amplitudes, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("name", BENCHES)
@pytest.mark.parametrize("loss", LOSS_SPACES)
def test_loss_gradient_and_amplitudes_are_those_of_torch(
    loss: str, name: str, bench: Bench, noise: Noise, compiled: CompiledKernels
) -> None:
    system = bench(**BENCHES[name])
    grid = make_plan(system).grid
    stack = np.random.default_rng(3).uniform(0.1, 0.6, (len(system.planes_m), *grid.shape, 3))
    settings = Settings(loss=loss, region=(3, 2, grid.shape[1] - 5, grid.shape[0] - 4))
    found, expected = (
        Problem(system, stack, settings, double=True, kernels=kernels).evaluate(
            noise(0, *system.drive_shape) * 825e-9, np.array(system.amplitudes), REQUEST
        )
        for kernels in (compiled, TORCH_KERNELS)
    )
    # Sums of some thousand terms in another order: 1e3·2⁻⁵³. The slope of encoded sRGB is at most 12.92 and the
    # derivatives of structure divide by variances of its windows, from 1e-3 on.
    near = 1e-12 if not LOSS_SPACES[loss].is_encoded else 1e-9
    assert found.loss == pytest.approx(expected.loss, rel=near)
    assert found.path_gradient is not None and expected.path_gradient is not None
    difference = float((found.path_gradient - expected.path_gradient).norm())
    assert difference <= near * float(expected.path_gradient.norm())
    assert found.optimal_amplitudes is not None and expected.optimal_amplitudes is not None
    np.testing.assert_allclose(found.optimal_amplitudes, expected.optimal_amplitudes, rtol=1e-6, atol=1e-9)


# --- the choice ------------------------------------------------------------------------------------------------------


@pytest.fixture
def cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty cache folder; nothing is remembered from other tests, nor afterwards."""
    monkeypatch.setattr(module, "cache_dir", lambda: tmp_path)
    choose_kernels.cache_clear()
    yield tmp_path
    choose_kernels.cache_clear()


def test_the_choice_is_measured_once_and_remembered(cache_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr(module, "_faster_name", lambda: asked.append("") or "torch")
    assert will_compile("cpu")
    assert choose_kernels("cpu") is TORCH_KERNELS
    choose_kernels.cache_clear()  # as in another process
    assert choose_kernels("cpu") is TORCH_KERNELS
    assert len(asked) == 1
    assert not will_compile("cpu")
    (path,) = cache_folder.iterdir()
    assert list(json.loads(path.read_text()).values()) == ["torch"]


@pytest.mark.parametrize("content", ["", "[]", "{", '{"other machine": "torch"}', "\x00"])
def test_a_file_that_says_nothing_is_measured_again(
    content: str, cache_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (cache_folder / module._FILE).write_text(content)
    monkeypatch.setattr(module, "_faster_name", lambda: "compiled")
    assert isinstance(choose_kernels("cpu"), CompiledKernels)


def test_the_faster_of_both_is_chosen(cache_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for faster, slower in (("torch", "compiled"), ("compiled", "torch")):
        times = {faster: 1.0, slower: 2.0}
        monkeypatch.setattr(module, "_seconds", lambda kernels, times=times: times[kernels.name])
        assert module._faster_name() == faster


def test_where_numba_fails_or_is_missing_torch_computes(cache_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: CompiledKernels) -> None:
        raise RuntimeError("no compiler for this processor")

    monkeypatch.setattr(CompiledKernels, "__init__", fail)
    assert choose_kernels("cpu") is TORCH_KERNELS
    choose_kernels.cache_clear()
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    assert not will_compile("cpu")
    assert choose_kernels("cpu") is TORCH_KERNELS


def test_other_devices_than_the_cpu_compute_by_torch(cache_folder: Path) -> None:
    assert choose_kernels("cuda:1") is TORCH_KERNELS
    assert not will_compile("cuda")
    assert list(cache_folder.iterdir()) == []


def test_what_was_loaded_beforehand_is_all_that_an_iteration_needs(
    cache_folder: Path, bench: Bench, noise: Noise, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_faster_name", lambda: "compiled")
    choose_kernels("cpu")
    load_kernels("cpu")
    loaded = _machine_code()
    assert sum(loaded.values()) >= 8  # as many passes are there
    system = bench()
    stack = np.full((len(system.planes_m), *make_plan(system).grid.shape, 3), 0.3, np.float32)
    problem = Problem(system, stack, Settings(), kernels=choose_kernels("cpu"))
    problem.evaluate(noise(0, *system.drive_shape).float() * 825e-9, np.array(system.amplitudes), REQUEST)
    assert _machine_code() == loaded


def test_what_was_compiled_beforehand_is_all_that_a_chain_needs(
    cache_folder: Path, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_faster_name", lambda: "compiled")
    assert will_compile("cpu", chains=True)
    choose_kernels("cpu")
    assert will_compile("cpu", chains=True) and not will_compile("cpu")
    module.compile_all("cpu")
    assert not will_compile("cpu", chains=True)
    compiled = _machine_code()
    chain = System(bench().wavelengths_m, bench().amplitudes, **_CHAIN_KEYS)
    stack = np.full((2, *make_plan(chain).grid.shape, 3), 0.3, np.float32)
    list(solve.iterate(chain, stack, Settings(iterations=2, eyebox=0.1)))
    assert _machine_code() == compiled


@pytest.mark.parametrize("is_chain", [False, True])
def test_patterns_to_begin_with_that_do_not_fit_are_refused_before_anything_is_told_or_compiled(
    is_chain: bool, cache_folder: Path, bench: Bench
) -> None:
    system, told = bench(), list[str]()
    if is_chain:
        system = System(system.wavelengths_m, system.amplitudes, **_CHAIN_KEYS)
    larger = system.edit({"elements.phase.shape": (24, 16)}) if is_chain else system.with_(shape=(64, 64))
    other = Hologram(random_drive(larger), larger)
    stack, settings = np.full((len(system.planes_m), *make_plan(system).grid.shape, 3), 0.3, np.float32), Settings()
    with pytest.raises(UserError, match="drive"):
        optimise_hologram(system, stack, settings, RunOptions(initial_hologram=other), tell=told.append)
    with pytest.raises(UserError, match="drive"):
        next(iter(solve.iterate(system, stack, settings, other.drive)))
    assert told == [] and list(cache_folder.iterdir()) == []


def _machine_code() -> dict[str, int]:
    """For how many types each pass is compiled."""
    passes = vars(vector_kernels) | vars(chain_kernels)
    return {name: len(getattr(value, "signatures", ())) for name, value in passes.items()}


def test_loading_beforehand_never_compiles(cache_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_faster_name", lambda: pytest.fail("compiles"))
    load_kernels("cpu")
    load_kernels("cuda:0")
    assert list(cache_folder.iterdir()) == []


# --- compiled beside the first iterations ----------------------------------------------------------------------------

BESIDE = 4
"""Iterations that torch computes meanwhile, here."""


class SlowCompiler:
    """One that ends when it is waited for."""

    is_done = False

    def wait(self, meanwhile: Callable[[], None]) -> None:
        meanwhile()
        self.is_done = True


@pytest.fixture
def slow_compiler(monkeypatch: pytest.MonkeyPatch, compiled: CompiledKernels) -> SlowCompiler:
    """The kernels are yet to be compiled; `slow_compiler.is_done` says when they are."""
    slow = SlowCompiler()
    monkeypatch.setattr(module, "compiler", lambda: slow)
    for user in (module, solve, chain_loop):
        monkeypatch.setattr(user, "will_compile", lambda device, chains=False: not slow.is_done)
    monkeypatch.setattr(solve.Optimiser, "_beside", BESIDE)
    monkeypatch.setattr(chain_loop.ChainProblem, "iterations_beside", BESIDE)
    for user in ("problem", "chain_loop"):
        monkeypatch.setattr(f"holoview.holograms.optimise.{user}.choose_kernels", lambda device: compiled)
    return slow


Run = Callable[..., tuple[list[float], list[Checkpoint]]]


@pytest.fixture(params=["short form", "chain"])
def run(request: pytest.FixtureRequest, bench: Bench, stack_for: Callable[..., np.ndarray]) -> Run:
    """The losses of ten iterations beside a compiler, and the checkpoint after each."""
    base = bench()
    if request.param == "chain":
        base = System(base.wavelengths_m, base.amplitudes, **_CHAIN_KEYS)

    def losses(
        resume: Checkpoint | None = None, before: Callable[[int], None] = lambda iteration: None, **arguments: Any
    ) -> tuple[list[float], list[Checkpoint]]:
        system, found, kept = base, [], []
        arguments = {"beside": lambda text: None} | arguments
        for state in solve.iterate(system, stack_for(system), Settings(iterations=10), None, resume, **arguments):
            found.append(state.loss)
            kept.append(state.checkpoint())
            before(state.iteration + 1)
        return found, kept

    return losses


def test_the_first_iterations_are_those_of_torch_and_the_rest_those_of_compiled_kernels(
    run: Run, slow_compiler: SlowCompiler, monkeypatch: pytest.MonkeyPatch
) -> None:
    used: list[str] = []
    evaluate = Problem.evaluate
    monkeypatch.setattr(
        Problem, "evaluate", lambda self, *args: used.append(self.model.kernels.name) or evaluate(self, *args)
    )
    of_chain = chain_loop.ChainProblem.evaluate
    monkeypatch.setattr(
        chain_loop.ChainProblem, "evaluate", lambda self, *args: used.append(self.kernels.name) or of_chain(self, *args)
    )
    told: list[str] = []
    beside, _ = run(beside=told.append)
    count = used.index("compiled")
    assert count in (BESIDE, BESIDE + 1)  # the first iteration of the short form evaluates twice
    assert used[:count] == ["torch"] * count
    assert set(used[count:]) == {"compiled"}
    assert slow_compiler.is_done  # it was waited for
    assert [text.split()[0] for text in told] == ["compiling", "waiting"]
    # Without `beside` it compiles first: other rounding, which Adam enlarges but little in ten iterations.
    assert run(beside=None)[0] == pytest.approx(beside, rel=1e-4)


def test_the_result_does_not_depend_on_when_the_compiler_ends(run: Run, slow_compiler: SlowCompiler) -> None:
    late, _ = run()
    for early in range(1, BESIDE):
        slow_compiler.is_done = False

        def end(iteration: int, early: int = early) -> None:
            slow_compiler.is_done = slow_compiler.is_done or iteration == early

        assert run(before=end)[0] == late


@pytest.mark.parametrize("interrupted", [1, BESIDE, BESIDE + 2])
@pytest.mark.parametrize("is_done", [False, True], ids=["still compiling", "compiled meanwhile"])
def test_it_is_resumed_bit_for_bit(
    interrupted: int, is_done: bool, run: Run, slow_compiler: SlowCompiler, tmp_path: Path
) -> None:
    whole, checkpoints = run()
    checkpoints[interrupted - 1].save(tmp_path / "run.safetensors")
    slow_compiler.is_done = is_done
    assert run(load_checkpoint(tmp_path / "run.safetensors"))[0] == whole[interrupted:]


@pytest.mark.explores
def test_another_process_compiles_and_remembers(cache_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache_folder))
    monkeypatch.setattr(module, "cache_dir", lambda: cache_folder / "holoview")
    assert will_compile("cpu")
    work = Compiler()
    assert work.is_busy
    work.wait()
    assert not work.is_busy
    assert not will_compile("cpu", chains=True)
    assert any((cache_folder / "holoview" / "numba").iterdir())


@pytest.mark.parametrize(("iterations", "tells"), [(3, False), (3000, True)])
def test_compiling_is_told_only_of_an_optimisation_that_lasts_until_it_is_done(
    iterations: int, tells: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(solve, "will_compile", lambda device: True)
    monkeypatch.setattr(module, "_WORK_BESIDE", 1e6)
    system = preset.load("holochrome-8").with_(shape=[16, 24], planes=["10 mm"])
    stack, told = np.full((1, *make_plan(system).grid.shape, 3), 0.2, np.float32), list[str]()
    next(iter(solve.iterate(system, stack, Settings(iterations=iterations), beside=told.append)))
    assert [text.startswith("compiling for this processor") for text in told] == [True] * tells
