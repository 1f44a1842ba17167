"""Makes the pictures of the viewer in README and manual: `python -m docs._hooks.pictures`, on an idle machine.

Each script draws a viewer off screen and writes PNG pictures; they are kept as JPEG in docs/images. The status bar of a
picture states times of the machine, so that no other program should run. The first minute of an optimisation is
recorded as it passes, as an animated WebP; `python -m docs._hooks.pictures first-minute` records it alone.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image
from rendercanvas.offscreen import OffscreenRenderCanvas

from docs._hooks.repository import ROOT
from holoview.light.gpu.device import open_device
from holoview.light.model import preset
from holoview.viewer.app.app import App
from holoview.viewer.app.script import InputDriver
from holoview.viewer.document.example import EXAMPLE_PRESET, new_session
from holoview.viewer.document.optimisation_job import last_optimisation

DOCS = ROOT / "docs"
SCRIPTS = {
    "viewer-tour.txt": (),
    "viewer-tour-strip.txt": ("high-contrast",),
    "viewer-tour-rig.txt": ("--rig", str(DOCS / "viewer-tour-rig.toml")),
}
"""The scripts of the viewer, each with further options of `holoview view`."""
_QUALITY = 88
_FIRST_MINUTE = "first-minute"
_MOMENTS_S = (*np.arange(0, 6, 0.5), *np.arange(6, 20, 1.0), *np.arange(20, 61, 4.0))
"""When a frame of the first minute is kept: at first, when most changes, more often."""
_FRAME_PX, _FRAME_QUALITY, _LAST_FRAME_S = (1040, 650), 60, 5.0


def main() -> None:
    """Runs every script in a folder of its own, with the assets of the repository, and converts its pictures."""
    _record_first_minute(DOCS / "images" / f"{_FIRST_MINUTE}.webp")
    if _FIRST_MINUTE in sys.argv[1:]:
        return
    for script, options in SCRIPTS.items():
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "assets").symlink_to(ROOT / "assets")
            view = (sys.executable, "-m", "holoview", "view", *options, "--new", "--offscreen")
            subprocess.run([*view, "--script", str(DOCS / script)], cwd=folder, check=True)
            for picture in sorted(Path(folder).glob("*.png")):
                target = DOCS / "images" / f"{picture.stem}.jpg"
                Image.open(picture).convert("RGB").save(target, quality=_QUALITY, optimize=True)
                print(target)


def _record_first_minute(target: Path) -> None:
    """Records the window from Ctrl+Enter on, at the first start, until the optimisation has ended or a minute is over.

    Each frame stays for as long as it did.
    """
    app = App(new_session(preset.load(EXAMPLE_PRESET)), open_device(None), OffscreenRenderCanvas(size=(1280, 800)))
    try:
        driver = InputDriver(app)
        driver.draw_until_idle()
        frames, shown_s, waiting = [driver.draw_frames(2)], [0.0], list(_MOMENTS_S)
        begun = time.perf_counter()
        driver.press_chord("Ctrl+Enter")
        while waiting and app.session.jobs.active:
            app.compute_slice()
            if time.perf_counter() - begun >= waiting[0]:
                frames.append(driver.draw_frames())
                shown_s.append(time.perf_counter() - begun)
                waiting = [moment for moment in waiting if moment > shown_s[-1]]
            else:
                driver.process_frames()
        frames.append(driver.draw_until_idle())
        shown_s.append(time.perf_counter() - begun)
    finally:
        app.close()
    job = last_optimisation(app.session)
    assert job is not None and job.latest is not None, "the optimisation failed"
    pictures = [Image.fromarray(frame).resize(_FRAME_PX, Image.Resampling.LANCZOS) for frame in frames]
    lasts_ms = [round(1e3 * seconds) for seconds in (1.0, *np.diff(shown_s[1:]), _LAST_FRAME_S)]
    options = {"append_images": pictures[1:], "duration": lasts_ms, "quality": _FRAME_QUALITY, "method": 6, "loop": 0}
    pictures[0].save(target, save_all=True, **options)
    print(f"{target}: {len(frames)} frames, {shown_s[-1]:.0f} s, {target.stat().st_size / 1e6:.2f} MB, {job.latest}")


if __name__ == "__main__":
    main()
