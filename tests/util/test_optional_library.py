"""Libraries that a plain installation leaves out: each is declared, and its absence names the extra."""

from __future__ import annotations

import asyncio
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

import holoview as hv
from holoview.commands.cli import main
from holoview.util.errors import UserError
from holoview.util.packages import EXTRAS, import_optional
from holoview.viewer.app.serve import Address, serve
from tests.patience import PATIENCE_S

PROJECT = tomllib.loads((Path(hv.__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
COMMANDS: dict[str, tuple[str, str]] = {
    "diagnose none.h5 --report seen": ("matplotlib.figure", "plots"),
    "contrast none.png --plot p.png": ("matplotlib.figure", "plots"),
    "calibrate lut none.csv --plot p.png": ("matplotlib.figure", "plots"),
    "calibrate none.h5 -o c.toml --pictures seen": ("matplotlib.figure", "plots"),
    "study schemes --quick -o seen": ("matplotlib.figure", "plots"),
    "study schemes --quick -o seen --scheduler tcp://127.0.0.1:1": ("distributed", "cluster"),
    "view --serve 127.0.0.1:0": ("uvicorn", "serve"),
}
"""Commands whose files don't exist, with the module that each needs before it reads them, and its extra."""

DISTRIBUTIONS = {
    "flip_evaluator": "flip-evaluator",
    "pycvvdp": "cvvdp",
    "pymmcore_plus": "pymmcore-plus",
    "serial": "pyserial",
    "skimage": "scikit-image",
}
"""Distributions that aren't called as their modules are."""


_COMPILED = ("chain_kernels", "compiled_chain", "compiled_model", "vector_fft", "vector_kernels")
COMPILED = tuple(f"holoview.holograms.optimise.{name}" for name in _COMPILED)
"""Modules of what numba compiles, which are imported only where it is installed (`choose_kernels`)."""


def _distributions(requirements: list[str]) -> set[str]:
    return {re.split(r"[<>=!;\[ ]", text)[0].lower() for text in requirements}


def test_every_optional_library_is_in_the_extra_that_its_error_names_and_in_no_plain_installation() -> None:
    extras = PROJECT["optional-dependencies"]
    for module, extra in EXTRAS.items():
        distribution = DISTRIBUTIONS.get(module, module)
        assert distribution in _distributions(extras[extra])
        assert distribution not in _distributions(PROJECT["dependencies"])
    assert extras["all"] == [f"holoview[{','.join(name for name in extras if name not in ('all', 'docs', 'dev'))}]"]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_names_the_extra_that_it_needs_before_it_begins(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module, extra = COMMANDS[command]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, module, None)
    assert main(command.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{module.partition('.')[0]} isn't installed" in line
    assert f'pip install "holoview[{extra}]"' in line
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_uvicorn_without_websockets_is_refused_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "websockets", None)
    with pytest.raises(UserError, match=r"websockets isn't installed.*holoview\[serve\]"):
        serve(Address(), began=lambda url: None)


def test_a_notebook_without_anywidget_names_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "anywidget", None)

    async def show() -> None:
        hv.show("holochrome-8")

    with pytest.raises(UserError, match=r"anywidget isn't installed.*holoview\[notebook\]"):
        asyncio.run(show())


def test_a_library_that_is_there_but_broken_is_not_called_missing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "av.py").write_text('raise ImportError("libx264.so.164: cannot open shared object file")\n')
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "av", raising=False)
    with pytest.raises(UserError, match=r"a film: av can't be loaded: libx264.so.164: cannot .*holoview\[export\]"):
        import_optional("av", "a film")


def test_a_library_that_does_not_fit_another_one_is_an_error_of_the_user_too(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "pycvvdp.py").write_text('raise RuntimeError("operator torchvision::nms does not exist")\n')
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pycvvdp", raising=False)
    with pytest.raises(UserError, match=r"pycvvdp can't be loaded: operator .*holoview\[perceptual\]"):
        import_optional("pycvvdp", "ColorVideoVDP")


@pytest.mark.long
def test_without_any_optional_library_every_module_is_imported() -> None:
    blocked = [*EXTRAS, "pyarrow", "simplejpeg"]
    program = (
        f"import importlib, pkgutil, sys; sys.modules.update(dict.fromkeys({blocked!r}))\n"
        "import holoview; found = pkgutil.walk_packages(holoview.__path__, 'holoview.')\n"
        "names = [info.name for info in found if not info.name.endswith('__main__')]\n"
        f"names = [name for name in names if name not in {COMPILED!r}]\n"
        "print(len([importlib.import_module(name) for name in names]))"
    )
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program], capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 300


@pytest.fixture
def without_imagecodecs(tmp_path: Path) -> Callable[[Path], Any]:
    """A function that reads a picture in a process without imagecodecs, and returns it or the UserError's text."""

    def read(path: Path) -> Any:
        program = (
            "import sys; sys.modules['imagecodecs'] = None\n"
            "import numpy as np; from pathlib import Path\n"
            "from holoview.holograms.files.image_reader import read_raster\n"
            "from holoview.util.errors import UserError\n"
            f"try: np.save({str(tmp_path / 'read.npy')!r}, read_raster(Path({str(path)!r})).values)\n"
            "except UserError as error: print(error)"
        )
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, timeout=PATIENCE_S, check=True
        )
        return done.stdout or np.load(tmp_path / "read.npy")

    return read


@pytest.mark.parametrize("compression", [None, "deflate", "packbits"])
def test_common_tiffs_need_no_extra(
    tmp_path: Path, compression: str | None, without_imagecodecs: Callable[[Path], Any]
) -> None:
    path, codes = tmp_path / "a.tif", np.arange(2 * 5 * 3, dtype=np.uint8).reshape(2, 5, 3)
    tifffile.imwrite(path, codes, photometric="rgb", compression=compression)
    assert (without_imagecodecs(path) == codes / 255).all()


@pytest.mark.parametrize("compression", ["lzw", "jpeg"])
def test_a_tiff_of_another_compression_names_its_extra(
    tmp_path: Path, compression: str, without_imagecodecs: Callable[[Path], Any]
) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.zeros((16, 16, 3), np.uint8), photometric="rgb", compression=compression)
    message = without_imagecodecs(path)
    assert "a.tif" in message and "imagecodecs isn't installed" in message and "holoview[images]" in message
