"""The numbers that a page computes after a change are those of the plan, over benches drawn at random."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import holoview.viewer.page
from holoview.light import colour
from holoview.light.engine.shader_structs import (
    PLANE_WAVE,
    pixel_spectra,
    plane_wave_uniform,
    propagation_uniform,
    support_table,
)
from holoview.light.model.bench_parts import Modulator, Relay, Sampling, Source
from holoview.light.model.eye import Eye
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.stops import SquareStop
from holoview.light.model.system import System
from holoview.viewer.page.frame_recording import bench_numbers
from holoview.viewer.page.page import FIRST_SCRIPTS, SCRIPTS
from tests.chromium import needs_chromium, started_browser

BENCHES, MORE_BENCHES = 60, 3000
FOLDER = Path(holoview.viewer.page.__file__).parent
_LAYOUTS = """
const encode = array => {
    const bytes = new Uint8Array(array.buffer)
    let text = ""
    for (let i = 0; i < bytes.length; i += 32768) text += String.fromCharCode(...bytes.subarray(i, i + 32768))
    return btoa(text)
}
function computed({ bench, λ, distances }) {
    const out = []
    for (const relay of bench.gap_m === null ? [1] : [0, 1]) {
        const eye = relay === 1 ? bench.eye : null
        const { uniform, support } = transfer(bench, stopRows(bench, bench.relays[relay], λ), λ, distances[relay], eye)
        out.push({ uniform, support: encode(support) })
    }
    const { uniform, slopes } = planeWave(bench, bench.sines[0][0], λ)
    const colour = observerWeights(bench.observer, λ)
    return { relays: out, wave: uniform, spectra: encode(pixelSpectra(bench, slopes)), colour }
}
"""


def drawn_relay(rng: np.random.Generator) -> Relay:
    """A relay with some of all kinds of stops."""
    iris = float(rng.uniform(0.005, 0.05)) if rng.random() < 0.5 else None
    squares = [
        None,
        SquareStop(),
        SquareStop(wavelength_m=650e-9),
        SquareStop(half_side_na=float(rng.uniform(0.01, 0.05))),
    ]
    square = squares[rng.integers(len(squares))]
    has_stop = iris is not None or square is not None
    centre = tuple(rng.uniform(-0.004, 0.004, 2).tolist()) if has_stop and rng.random() < 0.5 else (0.0, 0.0)
    block = float(rng.uniform(1e-4, 2e-3)) if rng.random() < 0.3 else None
    return Relay(iris_na=iris, square=square, centre_na=centre, dc_block_na=block)


def drawn_bench(rng: np.random.Generator) -> tuple[System, float]:
    """A bench of one wavelength, and another wavelength to which it is moved."""
    count = int(rng.integers(1, 3))
    shape = tuple(int(n) for n in rng.integers(4, 40, 2))
    modulator = Modulator(pitch_m=float(rng.uniform(3e-6, 12e-6)), shape=shape, stroke_m=825e-9)
    eye = None
    if rng.random() < 0.4:
        eye = Eye(
            pupil_m=float(rng.uniform(1e-3, 4e-3)),
            pupil_x_m=float(rng.uniform(-1e-3, 1e-3)),
            pupil_y_m=float(rng.uniform(-1e-3, 1e-3)),
            chromatic=bool(rng.random() < 0.7),
            chromatic_axis=str(rng.choice(["eyepiece", "pupil"])),
        )
    first, moved = rng.uniform(430e-9, 680e-9, 2).tolist()
    system = System(
        wavelengths_m=np.array([first]),
        amplitudes=np.ones((1, 1)),
        modulators=(modulator,) * count,
        gap_m=float(rng.uniform(1e-4, 5e-3)) if count == 2 else None,
        planes_m=np.array([rng.uniform(6e-3, 40e-3)]),
        relay1=drawn_relay(rng) if count == 2 else Relay(),
        relay2=drawn_relay(rng),
        source=Source(directions_rad=rng.uniform(-0.01, 0.01, (1, 2)) if rng.random() < 0.5 else np.zeros((1, 2))),
        sampling=Sampling(
            upsample=int(rng.integers(1, 4)), propagation=str(rng.choice(["linear", "compact", "periodic"]))
        ),
        observer=str(rng.choice(["eye", "cie1931", "mono"])),
        eye=eye,
    )
    return system, moved


def is_same(plan: Plan, found: dict[str, Any]) -> None:
    """Compares the numbers of a plan at its only wavelength with those of the page."""
    relays = [1] if plan.system.gap_m is None else [0, 1]
    for relay, values in zip(relays, found["relays"], strict=True):
        step = plan.transfer(relay, 0)
        expected = propagation_uniform(step)
        for name in ("paraxial_y", "paraxial_x", "shift"):
            assert np.array_equal(values["uniform"][name], np.asarray(expected[name])), name
        np.testing.assert_array_max_ulp(
            np.float32(values["uniform"]["sine_step2"]), np.float32(expected["sine_step2"]), 1
        )
        assert np.float32(values["uniform"]["distance_waves"]) == np.float32(expected["distance_waves"])
        support = np.frombuffer(base64.b64decode(values["support"]), np.int32).reshape(-1, 4)
        assert np.array_equal(support, support_table(step, plan.grid))
    wave = plane_wave_uniform(plan, 0, 0)
    assert PLANE_WAVE.pack(
        **{name: np.array(value, np.uint32) for name, value in found["wave"].items()}
    ) == PLANE_WAVE.pack(**wave)
    spectra = np.frombuffer(base64.b64decode(found["spectra"]), np.complex64)
    np.testing.assert_allclose(spectra, pixel_spectra(plan, 0, 0), atol=4 * np.finfo(np.float32).eps)
    np.testing.assert_allclose(
        found["colour"], colour.observer_weights(plan.system.observer, plan.system.wavelengths_m)[0], atol=1e-14
    )


@needs_chromium
@pytest.mark.parametrize("count", [BENCHES, pytest.param(MORE_BENCHES, marks=pytest.mark.explores)])
def test_the_pages_numbers_are_those_of_the_plan(count: int) -> None:
    """Fixed point and supports in all bits; float32 of a product of three factors may round differently once."""
    rng = np.random.default_rng(20 + count)
    script = (FOLDER / "bench.js").read_text(encoding="utf-8") + _LAYOUTS
    with started_browser() as browser:
        page = browser.open("about:blank")
        page.add_script_tag(content=script)
        done = 0
        while done < count:
            system, moved = drawn_bench(rng)
            try:
                plan = make_plan(system)
                there = make_plan(system.with_(wavelengths=[moved]))
            except holoview.UserError:
                continue
            bench = bench_numbers(plan, (1e-3, float(system.planes_m[0])))
            distances = [float(system.gap_m or 0.0), float(plan.planes_m[0])]
            for at, λ in ((plan, float(system.wavelengths_m[0])), (there, moved)):
                if at.grid != plan.grid:  # a compact grid depends on the wavelength
                    continue
                given = json.loads(json.dumps({"bench": bench, "λ": λ, "distances": distances}))
                is_same(at, page.evaluate("given => computed(given)", given))
                done += 1


@pytest.mark.parametrize("name", [*FIRST_SCRIPTS, *SCRIPTS])
def test_scripts_load_nothing(name: str) -> None:
    text = (FOLDER / name).read_text(encoding="utf-8")
    assert not [
        word for word in ("fetch(", "XMLHttpRequest", "import(", "eval(", "innerHTML", "https:") if word in text
    ]


def test_the_twin_is_short() -> None:
    lines = (FOLDER / "bench.js").read_text(encoding="utf-8").splitlines()
    assert len([line for line in lines if line.strip() and not line.strip().startswith("//")]) < 200
