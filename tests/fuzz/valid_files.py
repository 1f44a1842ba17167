"""Small valid files of every kind that holoview reads, from which hostile ones are made."""

from __future__ import annotations

import shutil
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
import OpenEXR
import tifffile
from PIL import Image

import holoview as hv
from holoview.bench.calibrate.train import CalibrationCheckpoint, CalibrationSettings, TrainingProgress
from holoview.bench.rig.registration import Registration, UncertainValue, write_registration
from holoview.evidence.study.runner import ResultStore
from holoview.evidence.study.study import JobResult, StudyJob
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.holograms.targets.picture import read_picture
from holoview.light.model import preset
from holoview.light.model.effects.learned_maps import LearnedMaps, MapLayout, write_calibration
from holoview.light.model.system import System
from holoview.viewer.document.archive import SessionArchive, SessionData
from holoview.viewer.document.editing_session import EditingSession
from tests.fuzz.field_files import make_fields
from tests.pattern_file import write_pattern
from tests.rig.conftest import write_rig

SHAPE = (12, 16)
BENCH = """
name = "small"
wavelengths = ["460 nm", "532 nm"]
amplitudes = [[1.0, 0.5]]
planes = ["3 mm"]
[[modulators]]
pitch = "8 um"
shape = [12, 16]
stroke = "825 nm"
levels = 16
"""
CAPTURES = 8
"""Of the valid capture file."""


def small_system() -> System:
    """A bench with one modulator of few pixels."""
    return preset.loads(BENCH)


def _hologram(folder: Path) -> None:
    system = small_system()
    hv.Hologram(hv.random_drive(system), system).save(folder / "hologram.safetensors")


def _checkpoint(folder: Path) -> None:
    system = small_system()
    (folder / "bench.toml").write_text(BENCH, encoding="utf-8")
    picture(folder)
    stack = hv.target_for(system, read_picture(folder / "picture.png")).stack
    state = next(iter(iterate(system.with_(propagation="compact"), stack, Settings(iterations=3))))
    state.checkpoint().save(folder / "checkpoint.safetensors")


def _maps(folder: Path) -> None:
    layout = MapLayout(1, 532e-9, (460e-9, 532e-9), knots=4, source_nodes=(3, 4), noll2=(4, 5), sine2=0.04)
    write_calibration(folder / "maps.safetensors", LearnedMaps.nominal(layout), {"scores": []})
    text = f'{BENCH}\n[effects.calibrated]\nfile = "maps.safetensors"\n'
    (folder / "calibrated.toml").write_text(text, encoding="utf-8")


def _captures(folder: Path) -> None:
    rng = np.random.default_rng(1)
    with h5py.File(folder / "captures.h5", "w") as h5:
        h5.attrs["format"], h5.attrs["version"] = "holoview-captures", 1
        levels = rng.integers(0, 16, (CAPTURES, *SHAPE), dtype=np.uint8)
        images = rng.integers(64, 900, (CAPTURES, 2 * SHAPE[0], 2 * SHAPE[1]), dtype=np.uint16)
        h5.create_dataset("slm1/levels", data=levels, compression="gzip")
        h5["slm1"].attrs.update(pitch=8e-6, num_levels=16, opd_range=780e-9)
        h5.create_dataset("camera/images", data=images, compression="gzip")
        h5["camera"].attrs.update(pitch=4e-6, bit_depth=12, electrons_per_count=4.0, read_noise=3.0, black_level=64.0)
        h5["wavelength"] = np.repeat([460e-9, 532e-9], CAPTURES // 2)
        for name, value in (("distance", 3e-3), ("power", 1.0), ("exposure", 0.01)):
            h5[name] = np.full(CAPTURES, value)
        h5.create_group("geometry").attrs["iris2_na"] = 0.03


def _calibration_checkpoint(folder: Path) -> None:
    """Of the valid captures; only its reading is tried, as training takes long."""
    from holoview.bench.captures import read_captures

    _captures(folder)
    captures = read_captures(folder / "captures.h5")
    layout = MapLayout(1, 500e-9, (460e-9, 532e-9), knots=4, source_nodes=(3, 4), noll2=(4, 5), sine2=0.03)
    names = [name for name, shape in layout.shapes().items() if 0 not in shape]
    tensors = {name + part: np.zeros(layout.shapes()[name], np.float32) for name in names for part in _PARTS}
    tensors |= {f"{name}.count": np.ones(1, np.int64) for name in names}
    tensors["mismatch"] = np.ones(CAPTURES)
    progress = TrainingProgress(1, 1.0, 2.0)
    checkpoint = CalibrationCheckpoint.create(captures, {}, layout, CalibrationSettings(), progress, tensors)
    checkpoint.save(folder / "calibration.safetensors")


_PARTS = ("", ".best", ".first", ".second")


def picture(folder: Path) -> None:
    """picture.png, .jpg, .tif and .exr, depth.npy and depth.png."""
    rng = np.random.default_rng(2)
    pixels = rng.integers(0, 256, (24, 32, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(folder / "picture.png")
    Image.fromarray(pixels).save(folder / "picture.jpg")
    tifffile.imwrite(folder / "picture.tif", pixels, photometric="rgb", compression="zlib")
    tifffile.imwrite(folder / "pages.tif", np.stack([pixels, pixels]), photometric="rgb")
    rows = rng.random((24, 32), dtype=np.float32)
    OpenEXR.File({}, {"R": rows, "G": rows, "B": rows}).write(str(folder / "picture.exr"))
    np.save(folder / "depth.npy", rows)
    Image.fromarray((rows * 65535).astype(np.uint16)).save(folder / "depth.png")
    (folder / "bench.toml").write_text(BENCH, encoding="utf-8")


def _pattern(folder: Path) -> None:
    write_pattern(folder / "pattern.png", np.random.default_rng(3).random(SHAPE))
    (folder / "bench.toml").write_text(BENCH, encoding="utf-8")


def _session(folder: Path) -> None:
    session = EditingSession(small_system())
    try:
        session.edit("exposure", view_settings=session.view_settings.with_(exposure_stops=1.0))
        data = SessionData(session.history, session.history_position, session.snapshots)
        SessionArchive(folder / "session").write(data, {"title": "small", "when": 0.0})
    finally:
        session.close()


def _folder(folder: Path) -> None:
    rng = np.random.default_rng(4)
    for number in range(2):
        Image.fromarray(rng.integers(64, 900, (24, 32), dtype=np.uint16)).save(folder / f"seen{number}.png")
        Image.fromarray(rng.integers(0, 16, SHAPE, dtype=np.uint8)).save(folder / f"sent{number}.png")
    rows = [f"seen{n}.png,sent{n}.png,520 nm,4 mm,1,0.01" for n in range(2)]
    text = "\n".join(["image,slm1,wavelength,distance,power,exposure", *rows])
    (folder / "captures.csv").write_text(text + "\n", encoding="utf-8")
    (folder / "bench.toml").write_text(
        '[slm1]\npitch = "8 um"\nnum_levels = 16\nopd_range = "825 nm"\n[camera]\npitch = "4 um"\nbit_depth = 12\n'
        "electrons_per_count = 4.0\nread_noise = 3.0\nblack_level = 64\n",
        encoding="utf-8",
    )


def _sweep(folder: Path) -> None:
    shutil.copy(Path(__file__).parents[1] / "data" / "lcos_820nm_first_order_power.csv", folder / "sweep.csv")


def _rig(folder: Path) -> None:
    """rig.toml, its placement and hidden table, a plan, exposures, and captures for a diagnosis with the placement."""
    write_rig(folder / "rig.toml", {"slm2": None, "geometry": {}, "virtual": {"bench": "hidden.toml"}})
    (folder / "hidden.toml").write_text(
        'seed = 3\nprnu = 0.01\n[effects.distance]\ndistance_error = "0.1 mm"\n[faults]\nlatency = 0.001\n',
        encoding="utf-8",
    )
    (folder / "plan.toml").write_text(_PLAN, encoding="utf-8")
    (folder / "exposures.csv").write_text(_EXPOSURES, encoding="utf-8")
    write_registration(folder / "rig.placement.toml", _PLACEMENT)
    _captures(folder)


_HIDDEN = """
seed = 3
prnu = 0.01
[effects.distance]
distance_error = "0.1 mm"
[faults]
latency = 0.001
"""
_PLAN = """
each = 2
seed = 1
wavelengths = ["450 nm", "638 nm"]
distances = ["3 mm", "4 mm"]
"""
_EXPOSURES = "wavelength_nm,power,exposure_s\n450,0.5,0.01\n638,1,0.02\n"
_MEASURED = {
    **dict.fromkeys(("rotation", "shift_y", "shift_x", "walk_y", "walk_x", "stage_offset"), UncertainValue(1e-6, 1e-7)),
    "stage_scale": UncertainValue(0.01, 0.001),
    "pitch": UncertainValue(3.9e-6, 1e-9),
}
_PLACEMENT = Registration("rotate_180", None, (0, 0), (32, 48), (16, 24), (32, 48), _MEASURED)


def _job(folder: Path) -> None:
    job, picture = StudyJob("one", "a job", {}), np.full((4, 5, 3), 7, np.uint8)
    ResultStore(folder).save(job, JobResult({"psnr": 20.0}, {"seen": picture}))
    (folder / f"{job.key}.json").rename(folder / "job.json")


def _light(folder: Path) -> None:
    """Light at a plane as numbers, in every format that is read back, and a Radiance picture."""
    system = small_system()
    view = hv.simulate(system, hv.random_drive(system), backend="torch")  # cases are forked, which no GPU survives
    for suffix in ("npz", "npy", "exr", "tif"):
        hv.save(view, folder / f"light.{suffix}")
    rows = np.random.default_rng(5).integers(1, 256, (24, 32, 4), dtype=np.uint8)
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 24 +X 32\n"
    (folder / "light.hdr").write_bytes(head + rows.tobytes())


def _web_page(folder: Path) -> None:
    system = small_system()
    hv.export_html(folder / "page.html", hv.Hologram(hv.random_drive(system), system), backend="torch")


_MAKERS = {
    "web page": _web_page,
    "hologram": _hologram,
    "checkpoint": _checkpoint,
    "calibration checkpoint": _calibration_checkpoint,
    "maps": _maps,
    "captures": _captures,
    "picture": picture,
    "pattern": _pattern,
    "session": _session,
    "folder": _folder,
    "sweep": _sweep,
    "job": _job,
    "rig": _rig,
    "field": make_fields,
    "light": _light,
}


@cache
def _contents(kind: str) -> dict[str, bytes]:
    with TemporaryDirectory() as name:
        _MAKERS[kind](Path(name))
        paths = [path for path in Path(name).rglob("*") if path.is_file()]
        return {str(path.relative_to(name)): path.read_bytes() for path in paths}


def valid(kind: str) -> dict[str, bytes]:
    """The content of the files of a kind, {path in their folder: bytes}."""
    return dict(_contents(kind))


def write(folder: Path, files: dict[str, bytes]) -> None:
    """Writes files, {path in the folder: bytes}."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
