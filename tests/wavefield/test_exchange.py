"""Programs send fields to a viewer on the same machine; whatever else is sent is refused in a sentence."""

from __future__ import annotations

import http.client
import io
import json
import re
import stat
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.holograms.fields.exchange import (
    HOST,
    FieldListener,
    Listener,
    announced_listener,
    announcement_path,
    push,
)
from holoview.holograms.fields.wavefield import Wavefield
from holoview.util.errors import UserError
from tests.patience import PATIENCE_S

PATH = "/fields/run?pitch=8um&wavelength=532nm"
FIELD = (np.arange(12, dtype=np.float32) * (1 + 2j)).reshape(3, 4).astype(np.complex64)


@pytest.fixture
def received() -> list[Wavefield]:
    return []


@pytest.fixture
def listening(received, tmp_path, monkeypatch) -> Iterator[FieldListener]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    with FieldListener(received.append) as listening:
        yield listening


def _npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def _send(listening: FieldListener, path: str, body: bytes, **headers: str) -> tuple[int, dict[str, str]]:
    """What a program without holoview sends."""
    listener = listening.listener
    connection = http.client.HTTPConnection(HOST, listener.port, timeout=PATIENCE_S)
    try:
        connection.request("PUT", path, body, {"Authorization": f"Bearer {listener.token}"} | headers)
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())
    finally:
        connection.close()


@pytest.mark.parametrize("field", [FIELD, torch.from_numpy(FIELD).requires_grad_(), FIELD.astype(complex)])
def test_a_field_arrives_as_it_was_sent(listening, received, field) -> None:
    push(field, "iteration/5", pitch="8 um", wavelengths="532 nm", distance="-20 cm")
    seen = received[-1]
    assert np.array_equal(seen.values, FIELD[None, None])
    assert (seen.name, seen.pitch_m, seen.distance_m) == ("iteration/5", (8e-6, 8e-6), -0.2)
    assert seen.wavelengths_m.tolist() == [532e-9]


RECIPES = dict(
    re.findall(
        r"^\| ([\w -]+) \| `(hv\.push\(.*?\))`",
        (Path(__file__).parents[2] / "docs" / "push.md").read_text("utf-8"),
        re.MULTILINE,
    )
)


@pytest.mark.parametrize("library", ["torch", "odak", "HoloTorch", "slmsuite", "neural-3d-holography"])
def test_the_recipes_of_the_manual_send_the_field_behind_the_modulator(listening, received, library: str) -> None:
    """slmsuite itself, where it is installed; stand-ins with the arrays of the others: odak 0.2.7 gives complex (y, x),
    HoloTorch (batch, time, pupil, colour, y, x), neural-3d-holography a phase (1, 1, y, x) with gradients."""
    phase = torch.from_numpy(np.random.default_rng(4).uniform(0, 6, (12, 16)))
    field = torch.exp(1j * phase)
    names = {"hv": hv, "np": np, "torch": torch, "phase": phase, "slm_phase": phase[None, None].requires_grad_()}
    wave = SimpleNamespace(generate_complex_field=lambda amplitude, phase: amplitude * torch.exp(1j * phase))
    names["odak"] = SimpleNamespace(learn=SimpleNamespace(wave=wave))
    names["field"] = SimpleNamespace(data=field[None, None, None, None])
    expected = field.numpy()
    if library == "slmsuite":
        algorithms = pytest.importorskip("slmsuite.holography.algorithms")
        names["hologram"] = algorithms.Hologram(np.eye(16))
        expected = np.exp(1j * names["hologram"].get_phase())
    eval(RECIPES[library], names)
    seen = received[-1].values
    assert seen.shape[:2] == (1, 1)
    assert np.abs(seen[0, 0] - expected).max() < 1e-5


def test_a_wavefield_arrives_with_all_it_says(listening, received) -> None:
    values = np.stack([FIELD, 2 * FIELD])[None]
    push(Wavefield(values, (8e-6, 4e-6), np.array([640e-9, 473e-9]), 0.1), to=listening.listener.address)
    assert np.array_equal(received[-1].values, values)
    assert (received[-1].pitch_m, received[-1].distance_m) == ((8e-6, 4e-6), 0.1)


def test_programs_without_holoview_send_npy_or_bare_numbers(listening, received) -> None:
    assert _send(listening, PATH, _npy(FIELD)) == (200, {"received": "run"})
    bare = FIELD.astype("<c16").tobytes()
    assert _send(listening, f"{PATH}&dtype=complex128&shape=3,4", bare)[0] == 200
    for seen in received:
        assert np.array_equal(seen.values[0, 0], FIELD)


def test_several_fields_go_through_one_connection(listening, received) -> None:
    connection = http.client.HTTPConnection(HOST, listening.listener.port, timeout=PATIENCE_S)
    for _ in range(3):
        connection.request("PUT", PATH, _npy(FIELD), {"Authorization": f"Bearer {listening.listener.token}"})
        assert json.loads(connection.getresponse().read()) == {"received": "run"}
    connection.close()
    assert len(received) == 3


@pytest.mark.parametrize(
    ("path", "body", "words"),
    [
        (PATH, b"no array", ".npy"),
        (PATH, _npy(FIELD)[:-3], ".npy"),
        (
            PATH,
            _npy(FIELD).replace(b"(3, 4), }    ", b"(99999, 4), }"),
            "3199968 bytes for an array of shape (99999, 4)",
        ),
        (PATH, _npy(np.array([[1, 2]])), "complex"),
        (PATH, _npy(np.full((2, 2), np.nan)), "finite"),
        (PATH, _npy(np.ones((2, 3, 4))), "wavelengths"),
        (f"{PATH}&dtype=complex64&shape=3,5", FIELD.tobytes(), "120"),
        (f"{PATH}&dtype=object&shape=3,4", b"x", "dtype"),
        (f"{PATH}&dtype=complex64&shape=3,-4", b"x", "shape"),
        (f"{PATH}&dtype=complex64&shape=9999999,9999999,9999999", b"x", "bytes"),
        (f"{PATH}&colour=red", _npy(FIELD), "colour"),
        ("/fields/run?wavelength=532nm", _npy(FIELD), "pitch"),
        ("/fields/run?pitch=8kg&wavelength=532nm", _npy(FIELD), "pitch"),
        ("/other", _npy(FIELD), "/fields/NAME"),
        (PATH, b"", "Content-Length"),
    ],
)
def test_what_is_no_field_is_refused_in_a_sentence(listening, received, path, body, words) -> None:
    status, answer = _send(listening, path, body)
    assert status == 400
    assert words in answer["error"]
    assert not received


def test_objects_in_a_file_are_never_loaded(listening, received) -> None:
    file = io.BytesIO()
    np.save(file, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    status, answer = _send(listening, PATH, file.getvalue())
    assert status == 400
    assert "pickled Python objects" in answer["error"]
    assert not received


def test_a_body_beyond_the_memory_is_refused_before_it_is_sent(listening, received) -> None:
    status, _ = _send(listening, PATH, b"", **{"Content-Length": str(1 << 60)})
    assert status == 400
    assert not received


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Authorization": "Bearer wrong"}, 401),
        ({"Authorization": ""}, 401),
        ({"Origin": "https://example.org"}, 403),
        ({"Host": "example.org"}, 403),
    ],
)
def test_strangers_and_web_pages_are_refused(listening, received, headers, status) -> None:
    assert _send(listening, PATH, _npy(FIELD), **headers)[0] == status
    assert not received


def test_the_announcement_is_private_and_ends_with_the_listener(listening) -> None:
    assert announced_listener() == listening.listener
    if sys.platform != "win32":
        assert stat.S_IMODE(announcement_path().stat().st_mode) == 0o600
    listening.close()
    assert not announcement_path().exists()
    with pytest.raises(UserError, match="holoview view --listen"):
        push(FIELD, pitch="8 um", wavelengths="532 nm")


def test_the_address_of_another_machine_is_no_address(listening) -> None:
    assert Listener.parse(listening.listener.address) == listening.listener
    for address in ("http://example.org:80/#token", "http://127.0.0.1:80/", "http://127.0.0.1:x/#t", "viewer"):
        with pytest.raises(UserError, match="PORT"):
            Listener.parse(address)


def test_what_an_array_can_t_say_is_asked_for(listening) -> None:
    with pytest.raises(UserError, match="pitch: is missing"):
        push(FIELD, wavelengths="532 nm")
    with pytest.raises(UserError, match="wavelengths: is missing"):
        push(FIELD, pitch="8 um")
