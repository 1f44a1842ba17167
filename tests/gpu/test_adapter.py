"""Adapters are enumerated from several threads at once, as jobs do that open devices."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cffi
import pytest
import wgpu

from holoview.light.gpu import adapter
from holoview.light.gpu.adapter import TESTED_VERSIONS, load_declarations, native_adapters, stored_declarations
from tests.patience import PATIENCE_S


def test_several_threads_may_look_for_adapters_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def enumerate_slowly() -> list[Any]:
        time.sleep(0.02)
        return []

    native_adapters()  # loads the library, which brings the function that is replaced
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr(wgpu.gpu, "enumerate_adapters_sync", enumerate_slowly)
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda _: native_adapters(), range(8))) == [[]] * 8
    assert "XDG_RUNTIME_DIR" not in os.environ


HEADER = "typedef struct { int x; double y[3]; } Point; typedef enum { Small = 3, Large } Size; int abs(int);"
CHANGED = "typedef struct { int x; double y[4]; } Point;"
LOAD = """
import sys, warnings
warnings.simplefilter("error")
from holoview.light.gpu.adapter import load_backend
load_backend()
import wgpu
assert wgpu.gpu.wgsl_language_features is not None
"""


OPEN_AT_ONCE = """
from threading import Thread
from holoview.light.gpu.device import open_device
threads = [Thread(target=lambda: [open_device() for _ in range(12)]) for _ in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
"""


@pytest.mark.gpu
def test_several_threads_may_open_devices_at_once() -> None:
    """A driver of OpenGL that two threads used at once, one releasing an adapter, ended the process most times."""
    done = subprocess.run([sys.executable, "-c", OPEN_AT_ONCE], capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr


def _run(program: str, cache: Path) -> subprocess.CompletedProcess[str]:
    """Runs a program in a process of its own, since a process loads wgpu's backend once."""
    environment = {"XDG_CACHE_HOME": str(cache), "LOCALAPPDATA": str(cache), "HOME": str(cache)}
    return subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


def test_the_installed_wgpu_is_one_that_was_tested() -> None:
    """If not, list it in TESTED_VERSIONS, run all tests, and check the comment on the backend in `adapter`."""
    assert wgpu.version_info[:2] in TESTED_VERSIONS


def test_declarations_from_the_file_are_those_of_the_header(tmp_path: Path) -> None:
    for _ in range(2):  # parsed, then read
        ffi = load_declarations(HEADER, tmp_path)
        assert ffi.sizeof("Point") == 32
        assert ffi.new("Point *", {"x": 3, "y": [1, 2, 3]}).y[2] == 3.0
        assert ffi.dlopen(None).abs(-4) == 4
        assert ffi.dlopen(None).Large == 4
    assert len(list(tmp_path.iterdir())) == 1


def test_another_header_has_another_file(tmp_path: Path) -> None:
    assert load_declarations(HEADER, tmp_path).sizeof("Point") == 32
    assert load_declarations(CHANGED, tmp_path).sizeof("Point") == 40


@pytest.mark.parametrize(
    "content", [b"", b"ffi = ", b"\0\0\0", b"\xff\xfe", b"import no_such_module", b"raise ValueError"]
)
def test_a_file_that_makes_no_sense_is_written_anew(tmp_path: Path, content: bytes) -> None:
    load_declarations(HEADER, tmp_path)
    (path,) = tmp_path.iterdir()
    sound = path.read_bytes()
    path.write_bytes(content)
    assert load_declarations(HEADER, tmp_path).sizeof("Point") == 32
    assert path.read_bytes() == sound


def test_a_folder_that_can_not_be_made_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert load_declarations(HEADER, tmp_path / "file" / "cache").sizeof("Point") == 32


def test_other_threads_declare_as_ever_meanwhile(tmp_path: Path) -> None:
    folder = tmp_path / "declarations"
    sizes: list[int] = []

    def declare() -> None:
        ffi = cffi.FFI()
        ffi.cdef(HEADER)
        sizes.append(ffi.sizeof("Point"))

    plain = cffi.FFI
    with stored_declarations(folder):
        thread = threading.Thread(target=declare)
        thread.start()
        thread.join()
        assert not folder.exists()
        declare()
    assert sizes == [32, 32]
    assert folder.exists()
    assert cffi.FFI is plain


def test_the_backend_loads_from_the_file_without_the_parser(tmp_path: Path) -> None:
    first = _run(LOAD, tmp_path)
    assert first.returncode == 0, first.stderr
    second = _run(f"{LOAD}\nassert 'pycparser' not in sys.modules", tmp_path)
    assert second.returncode == 0, second.stderr


def test_the_backend_loads_when_it_uses_cffi_in_another_way_and_says_so(tmp_path: Path) -> None:
    another_way = (
        "from holoview.light.gpu import adapter\nadapter.load_declarations = lambda header, folder: object()\n"
    )
    told = _run(another_way + LOAD, tmp_path)
    assert "RuntimeWarning" in told.stderr
    assert "starts slowly" in told.stderr
    works = _run(another_way + LOAD.replace('"error"', '"ignore"') + "\nassert 'pycparser' in sys.modules", tmp_path)
    assert works.returncode == 0, works.stderr


def test_a_version_that_was_not_tested_loads_as_it_is(tmp_path: Path) -> None:
    done = _run(f"from holoview.light.gpu import adapter\nadapter.TESTED_VERSIONS = ()\n{LOAD}", tmp_path)
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "holoview").exists()


def test_a_backend_that_is_loaded_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "wgpu.backends.wgpu_native", object())  # type: ignore[arg-type]
    monkeypatch.setattr(adapter, "import_module", lambda name: pytest.fail(name))
    adapter.load_backend()
