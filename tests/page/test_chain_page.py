"""The page of a chain of elements shows what `hv.simulate` computes, and changes what can be changed."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.holograms.targets.focal_stack import Target
from holoview.light.engine.shader_structs import PROPAGATION, dense_transmission, propagation_uniform, support_table
from holoview.light.gpu.device import Device
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.exports import save_page
from holoview.viewer.document.file_loader import read_content
from holoview.viewer.page.link import shown_by_link
from holoview.viewer.page.page import export_html, page_html, read_page
from tests.chromium import Browser, needs_chromium
from tests.page.pages import claims_of, drag_right, open_page, page_pixels, set_state, webgpu_browser
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.gpu
UM, MM, NM = 1e-6, 1e-3, 1e-9
LASERS = [480 * NM, 540 * NM, 620 * NM]


@pytest.fixture(scope="module")
def browser(device: Device) -> Iterator[Browser]:
    """Chromium with WebGPU on the processor."""
    with webgpu_browser() as browser:
        yield browser


def pixels(kind: str, **keys: Any) -> dict[str, Any]:
    """An element of the pixels of all modulators here: two samples each."""
    return {"kind": kind, "pitch": 8 * UM, "shape": (30, 24)} | keys


def bench(*elements: dict[str, Any], **changes: Any) -> System:
    """A bench with these elements, two frames and three lasers, of which one is off in the first frame."""
    values: dict[str, Any] = {"planes_m": [2 * MM, 3 * MM, 4 * MM], "amplitudes": [[1.0, 0.0, 0.8], [0.7, 1.2, 1.0]]}
    return System(LASERS, elements=elements, **(values | changes))


def every_kind(rng: np.random.Generator, mask: Path) -> System:
    """Nine elements, the last two side by side, and two spaces, of every kind; the mask has paths and amplitudes."""
    values = np.stack([rng.uniform(-1e-6, 1e-6, (60, 48)), rng.uniform(0.3, 1, (60, 48))])
    np.save(mask, values)
    return bench(
        pixels("phase", stroke=rng.uniform(600, 900) * NM, levels=16),
        {"kind": "space", "name": "way 1", "distance": rng.uniform(0.5, 1.5) * MM, "iris_na": 0.04},
        pixels("complex", stroke=rng.uniform(500, 700) * NM),
        {"kind": "mask", "pitch": 4 * UM, "file": str(mask)},
        {"kind": "lens", "focal_length": rng.uniform(15, 40) * MM, "abbe": 40.0},
        {"kind": "space", "name": "way 2", "distance": rng.uniform(1, 2) * MM},
        pixels("amplitude", pitch=24 * UM, shape=(8, 8), offset=[0.0, 24 * UM], range=[0.3, 1.0], name="coarse"),
        {"kind": "fourier", "focal_length": rng.uniform(2.33, 2.44) * MM},
        pixels("amplitude", levels=2, name="binary", shared=True),
        {"kind": "mask", "pitch": 8 * UM, "shape": (30, 24), "pattern": "grating", "period": 64 * UM, "name": "grid"},
        pixels("phase", stroke=700 * NM, beside="grid"),
        {"kind": "space", "square": "first order of binary"},
    )


def drawn(system: System, seed: int = 1) -> hv.Hologram:
    """A hologram of random patterns."""
    return hv.Hologram(hv.random_drive(system, seed=seed), system)


def is_equal(page: Any, hologram: hv.Hologram, system: System, plane_m: float, *far_m: float) -> None:
    """Within 1 of 255 in 99.9 % of the samples: float32 sums differ in their order between devices.

    far_m: the farthest plane that the page can show, from which compact padding follows.
    """
    view = hv.simulate(system, hologram.drive, planes=[plane_m, *far_m], backend="torch64")
    shown = page_pixels(page)
    difference = np.abs(shown.astype(int) - view.srgb8[0].astype(int)).max(axis=-1)
    assert shown.std() > 5
    assert np.mean(difference <= 1) >= 0.999


def refusal(page: Any, **changes: Any) -> str:
    """What the page says of changes that it refuses."""
    said = page.evaluate("changes => window.holoview.set(changes).then(() => '', error => error.message)", changes)
    return str(said)


@pytest.mark.long
@needs_chromium
def test_a_chain_of_every_kind_is_shown_as_simulate_computes_it(browser: Browser, tmp_path: Path) -> None:
    system = every_kind(np.random.default_rng(3), tmp_path / "mask.npy")
    hologram = drawn(system)
    page = open_page(browser, export_html(tmp_path / "chain.html", hologram, backend="torch"))
    is_equal(page, hologram, system, 3 * MM)
    set_state(page, plane_m=2.3 * MM, powers=[1.5, 1.0, 0.5])
    brighter = system.edit({"amplitudes": system.amplitudes * [1.5, 1.0, 0.5]})
    is_equal(page, hologram, brighter, 2.3 * MM)
    set_state(page, powers=[1.0, 1.0, 1.0], lasers=[True, False, True], spaces={"way 1": 1.7 * MM})
    moved = system.edit({"elements.way 1.distance": 1.7 * MM, "amplitudes": system.amplitudes * [1.0, 0.0, 1.0]})
    is_equal(page, hologram, moved, 2.3 * MM)
    wavelengths = [480 * NM, 540 * NM, 628 * NM]
    set_state(page, lasers=[True] * 3, wavelengths_m=wavelengths)
    moved = system.edit({"elements.way 1.distance": 1.7 * MM}).with_(wavelengths=wavelengths)
    is_equal(page, hologram, moved, 2.3 * MM)
    for wavelengths, says in (  # 60 samples of 4 µm and pixels of 8 µm hold 2.46 mm at 390 nm, and 2.32 mm at 829 nm
        ([390 * NM, 540 * NM, 628 * NM], "wavelength 1: at this wavelength the samples can't hold a focal length of"),
        ([480 * NM, 540 * NM, 829 * NM], "wavelength 3: at this wavelength the Fourier plane behind a focal length of"),
    ):
        assert refusal(page, wavelengths_m=wavelengths).startswith(says)
        with pytest.raises(hv.UserError, match="focal_length"):
            system.with_(wavelengths=wavelengths)
    link = page.evaluate("() => toHash(window.holoview.viewer.state, window.holoview.viewer.bench)")
    shown = shown_by_link(hologram, link.removeprefix("#"))
    assert shown.plane_m == pytest.approx(2.3 * MM)
    assert shown.hologram.system.way.distances_m == pytest.approx(moved.way.distances_m)
    assert browser.close_pages() == []


@needs_chromium
@pytest.mark.explores
@pytest.mark.parametrize(
    "name",
    [
        "high-contrast",
        "etendue-expander",
        "etendue-expander-2",
        "dynamic-fourier",
        "holochrome-8-static",
        "binary-amplitude",
        "michelson-complex",
    ],
)
def test_each_preset_of_a_chain_is_shown_as_simulate_computes_it(browser: Browser, tmp_path: Path, name: str) -> None:
    system = hv.load(name)
    hologram = drawn(system)
    plane_m = float(system.planes_m[-1])
    page = open_page(browser, export_html(tmp_path / "preset.html", hologram, backend="torch", plane_m=plane_m))
    is_equal(page, hologram, system, plane_m)
    set_state(page, plane_m=1.05 * plane_m)
    is_equal(page, hologram, system, 1.05 * plane_m)
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_tables_that_the_page_computes_are_those_of_python(browser: Browser, tmp_path: Path) -> None:
    """Supports and fixed point exactly. A path of 1 µm is kept in float32, to 6e-14 m, which are 2π·6e-14/620e-9 = 6e-7
    of the light; numbers in float32, to 6e-8; kernels are sums of up to 60 of them, computed in float64."""
    system = every_kind(np.random.default_rng(7), tmp_path / "mask.npy")
    hologram = drawn(system)
    page = open_page(browser, export_html(tmp_path / "chain.html", hologram, backend="torch", plane_m=3 * MM))
    plan = hv.make_plan(system, [3 * MM])
    inputs = FrameInputs(plan, hologram.drive)
    read = lambda label, dtype: np.frombuffer(base64.b64decode(page.evaluate(_TABLE, label)), dtype)  # noqa: E731
    last_frame = system.frames - 1
    for number in range(len(plan.way.transmissions)):
        expected = dense_transmission(inputs, last_frame, [number], 2)
        found = read(f"dense {inputs.shown_first(last_frame, number)} {number} 2", np.complex64)
        np.testing.assert_allclose(found.reshape(expected.shape), expected, rtol=0, atol=7e-7)
    for relay in range(len(plan.relays)):
        step = plan.transfer(relay, 2)
        assert np.array_equal(read(f"support {relay} 2 0", np.int32).reshape(-1, 4), support_table(step, plan.grid))
        words = np.frombuffer(PROPAGATION.pack(**propagation_uniform(step)), np.uint32)
        found = read(f"transmit {relay} 2 0", np.uint32)[: len(words)]
        assert np.abs(found.astype(np.int64) - words.astype(np.int64)).max() <= 1  # float32 may round differently once
        if plan.way.kernel(relay) is not None:
            kernel = inputs.pupils[relay][2].numpy().ravel()
            error = np.abs(read(f"pupil {relay} 2", np.complex64) - kernel)
            assert error.max() < 3e-7 * np.abs(kernel).max()
    assert browser.close_pages() == []


_TABLE = """async label => {
    const bytes = await window.holoview.viewer.holograms[0].full.replay.read(label)
    let text = ""
    for (let i = 0; i < bytes.length; i += 32768) text += String.fromCharCode(...bytes.subarray(i, i + 32768))
    return btoa(text)
}"""


@pytest.mark.long
@needs_chromium
def test_another_strategy_a_quick_image_and_fields_that_are_not_kept_show_the_same(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = "holoview.viewer.page.frame_recording"
    monkeypatch.setattr(f"{recording}._QUICK_SAMPLES", 0)
    monkeypatch.setattr(f"{recording}._KEPT_BYTES", 0)
    system = bench(
        pixels("phase", stroke=800 * NM),
        {"kind": "space", "name": "way", "distance": 1 * MM},
        pixels("amplitude", pitch=24 * UM, shape=(10, 8), name="coarse"),
        {"kind": "space", "iris_na": 0.03},
    )
    hologram = drawn(system)
    page = open_page(browser, export_html(tmp_path / "quick.html", hologram, backend="torch"))
    is_equal(page, hologram, system, 3 * MM)
    quick = page.evaluate("async () => [...await window.holoview.viewer.holograms[0].quick.rgba(PAGE.xyz_to_srgb, 0)]")
    view = hv.simulate(system.with_(propagation="compact"), hologram.drive, planes=[3 * MM, 5 * MM], backend="torch64")
    difference = np.abs(np.array(quick).reshape(60, 48, 4)[..., :3] - view.srgb8[0].astype(int)).max(axis=-1)
    assert np.mean(difference <= 1) >= 0.999
    names = page.evaluate(
        """async () => {
            const { full } = window.holoview.viewer.holograms[0]
            full.use(await full.open(full.heads.at(-1)))
            return full.heads.map(head => `${head.strategy} ${head.is_kept}`)
        }"""
    )
    assert names == ["passes false", "workgroup false"]
    set_state(page, plane_m=2.6 * MM)
    is_equal(page, hologram, system, 2.6 * MM)
    assert browser.close_pages() == []


def test_a_chain_of_the_short_form_has_the_page_of_its_short_form() -> None:
    short = hv.load("holochrome-8").with_(shape=[24, 32], planes=["9 mm"])
    texts = [
        page_html({"it": hv.Hologram(hv.random_drive(short, seed=2), system)}, backend="torch")
        for system in (short, short.with_(elements=short.elements))
    ]
    assert texts[0] == texts[1]


@pytest.mark.long
@needs_chromium
def test_planes_told_from_an_element_stay_when_a_space_behind_it_changes(browser: Browser, tmp_path: Path) -> None:
    system = bench(
        pixels("phase", stroke=800 * NM),
        {"kind": "space", "name": "way", "distance": 1 * MM},
        pixels("amplitude", pitch=24 * UM, shape=(10, 8), name="coarse"),
        planes_from="phase",
    )
    hologram = drawn(system)
    page = open_page(browser, export_html(tmp_path / "from.html", hologram, backend="torch"))
    is_equal(page, hologram, system, 3 * MM)
    assert "2 mm" in page.locator("#bench text[data-key=planes]").all_text_contents()
    set_state(page, spaces={"way": 1.8 * MM})
    is_equal(page, hologram, system.edit({"elements.way.distance": 1.8 * MM}), 3 * MM)
    texts = page.locator("#bench text").all_text_contents()
    assert {"1.2 mm", "1.8 mm", "1.8 mm more from phase"} <= set(texts)
    assert refusal(page, plane_m=1.5 * MM) == "plane_m: expected 1.800 mm or more, where the last element stands."
    assert refusal(page, spaces={"phase": 1 * MM}).startswith("spaces: expected metres from 0 to 0.003 of way")
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_an_eye_behind_a_chain_sees_what_it_sees_in_simulate(browser: Browser, tmp_path: Path) -> None:
    """A lens first, two spaces in a row, two directions of the source, a stop of its own element, compact padding."""
    system = bench(
        {"kind": "lens", "focal_length": 60 * MM},
        pixels("phase", stroke=800 * NM),
        {"kind": "space", "name": "one", "distance": 0.6 * MM},
        {"kind": "space", "name": "two", "distance": 0.4 * MM, "square": "first order"},
        {"kind": "mask", "name": "mask", "pitch": 4 * UM, "shape": (60, 48), "pattern": "random", "stroke": 400 * NM},
        {"kind": "space", "square": "first order of phase", "dc_block_na": 0.001},
    ).edit({"eye": {"pupil": "2 mm"}, "source.directions": [["0 mrad", "2 mrad"], ["-3 mrad", "0 mrad"]]})
    system = system.with_(propagation="compact")
    hologram = drawn(system)
    page = open_page(browser, export_html(tmp_path / "eye.html", hologram, backend="torch"))
    is_equal(page, hologram, system, 3 * MM, 5 * MM)
    set_state(page, spaces={"two": 0.7 * MM}, eye={"pupil_m": 1.2 * MM, "chromatic": False}, plane_m=2.5 * MM)
    moved = system.edit({"elements.two.distance": 0.7 * MM, "eye.pupil": "1.2 mm", "eye.chromatic": False})
    is_equal(page, hologram, moved, 2.5 * MM, 5 * MM)
    assert "1.3 mm" in page.locator("#bench text").all_text_contents()  # both spaces, which are one in the drawing
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_with_effects_on_elements_planes_and_lasers_are_the_nominal_ones(browser: Browser, tmp_path: Path) -> None:
    effects = {
        "leakage": {"element": "coarse", "amplitude": 0.2},
        "misplaced": {"element": "coarse", "shift_z": "0.2 mm", "shift_x": "5 um"},
    }
    system = bench(
        pixels("phase", stroke=800 * NM),
        {"kind": "space", "name": "way", "distance": 1 * MM, "iris_na": 0.03, "aberration": {"Z5": 60 * NM}},
        pixels("amplitude", pitch=24 * UM, shape=(10, 8), name="coarse"),
    ).edit({"effects": effects})
    hologram = drawn(system)
    page = open_page(browser, export_html(tmp_path / "effects.html", hologram, backend="torch"))
    is_equal(page, hologram, system, 3 * MM)
    set_state(page, plane_m=2.2 * MM, lasers=[True, False, True])
    is_equal(page, hologram, system.edit({"amplitudes": system.amplitudes * [1.0, 0.0, 1.0]}), 2.2 * MM)
    assert "effects or aberrations were computed for them" in refusal(
        page, wavelengths_m=[480 * NM, 540 * NM, 630 * NM]
    )
    assert refusal(page, spaces={"way": 2 * MM}) == "spaces: expected none: of this bench no space can be changed here."
    page.locator("#bench rect.part[aria-label='1 mm']").focus()
    page.keyboard.press("Enter")
    assert "can't be changed on a page" in page.inner_text("#part-note")
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_a_space_is_dragged_and_typed_in_the_drawing_and_is_in_the_link(browser: Browser, tmp_path: Path) -> None:
    """A drag of 30 of 300 pixels is a tenth of its range, three times its length."""
    system = every_kind(np.random.default_rng(4), tmp_path / "mask.npy").edit({"elements.way 1.distance": "1 mm"})
    hologram, file = drawn(system), tmp_path / "chain.html"
    page = open_page(browser, export_html(file, hologram, backend="torch"), "#space.way%202=1.1mm&plane=3.1mm")
    assert page.evaluate("() => window.holoview.state.spaces['way 2']") == pytest.approx(1.1 * MM)
    is_at = lambda length_m: page.wait_for_function(  # noqa: E731
        f"() => Math.abs(window.holoview.state.spaces['way 1'] - {length_m}) < 1e-9"
    )
    room = page.locator("#bench rect.part[aria-label='way 1'][tabindex='0']")
    drag_right(page, room, 30)
    is_at(1.3 * MM)
    page.keyboard.press("Enter")
    page.keyboard.type("1.2 mm")
    page.keyboard.press("Enter")
    is_at(1.2 * MM)
    page.wait_for_function("() => location.hash.includes('space.way%201=1.2mm&space.way%202=1.1mm')")
    moved = system.edit({"elements.way 1.distance": 1.2 * MM, "elements.way 2.distance": 1.1 * MM})
    is_equal(page, hologram, moved, 3.1 * MM)
    page.locator("#bench rect.part[aria-label^='coarse']").focus()
    page.keyboard.press("Enter")
    assert page.inner_text("#part-note").startswith("coarse, amplitude, 8 × 8, 24 µm pitch: can't be changed on a page")
    for link, says in (("#space.way=1mm", "spaces: expected metres"), ("#space.way%201=1", "a length with its unit")):
        page = open_page(browser, file, link)
        assert says in page.inner_text("#link-note")
    assert browser.close_pages() == []


@pytest.mark.long
@needs_chromium
def test_a_chain_beside_its_field_and_a_target_makes_claims_that_the_page_computes(
    browser: Browser, tmp_path: Path
) -> None:
    system = every_kind(np.random.default_rng(8), tmp_path / "mask.npy").with_(planes=["3 mm"])
    hologram = drawn(system)
    rgb = np.clip(hv.simulate(hologram, backend="torch").rgb, 0, None)
    shown = 0.2 + 0.8 * rgb / rgb.max()  # bright, as the page's target has 8 bits
    target = Target(shown.astype(np.float32), (3 * MM,), "light of the chain")
    both = {"chain": hologram, "its field": hv.as_field(hologram)}
    page = open_page(
        browser, export_html(tmp_path / "both.html", both, target=target, region=(5, 5, 40, 40), backend="torch")
    )
    said = claims_of(page)
    claims = re.findall(r": ([^:]*) in the file, ([^:]*) computed here", said)
    assert len(claims) == 2 and all(stated.split(" ± ")[0] == found for stated, found in claims)
    set_state(page, view="hologram 2", spaces={"way 1": 0.4 * MM})
    is_equal(page, both["its field"], both["its field"].system, 3 * MM)  # which knows no spaces
    set_state(page, view="hologram 1")
    is_equal(page, hologram, system.edit({"elements.way 1.distance": "0.4 mm"}), 3 * MM)
    assert browser.close_pages() == []


def test_the_page_of_a_chain_is_read_as_data(tmp_path: Path) -> None:
    system = every_kind(np.random.default_rng(5), tmp_path / "mask.npy")
    hologram = drawn(system)
    ((name, found),) = read_page(export_html(tmp_path / "chain.html", {"it": hologram}, backend="torch")).items()
    assert name == "it" and found.system == system and list(found.drive) == list(hologram.drive)
    for element, drive in hologram.drive.items():
        assert np.array_equal(found.drive[element], drive.astype(found.drive[element].dtype))


@pytest.mark.parametrize("link", ["space.way 3=1mm", "space.way 1=1kg", "space.coarse=1mm", "space.=1mm"])
def test_a_link_to_a_space_that_cannot_be_gets_a_sentence(tmp_path: Path, link: str) -> None:
    hologram = drawn(every_kind(np.random.default_rng(6), tmp_path / "mask.npy"))
    with pytest.raises(hv.UserError):
        shown_by_link(hologram, link)
    short = hv.load("holochrome-8").with_(shape=[8, 12])
    with pytest.raises(hv.UserError, match="it has none"):
        shown_by_link(drawn(short), "space.relay1=1mm")


def test_the_window_saves_the_page_of_a_chain_and_opens_it_with_its_link(tmp_path: Path) -> None:
    session = EditingSession(every_kind(np.random.default_rng(9), tmp_path / "mask.npy"))
    save_page(session, tmp_path / "chain.html")
    assert session.wait_until_idle(PATIENCE_S)
    (hologram,) = read_page(tmp_path / "chain.html").values()
    assert hologram.system == session.system
    content = read_content(f"{tmp_path / 'chain.html'}#space.way%201=0.3mm&laser2=off", session.system)
    assert content.system is not None and content.system.way.distances_m[0] == pytest.approx(0.3 * MM)
    assert not content.system.amplitudes[:, 1].any()
