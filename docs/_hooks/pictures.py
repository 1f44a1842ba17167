"""Makes the pictures of the viewer in README and manual: `python -m docs._hooks.pictures`, on an idle machine.

Each script draws a viewer off screen and writes PNG pictures; they are kept as JPEG in docs/images. The status bar of a
picture states times of the machine, so that no other program should run.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from docs._hooks.repository import ROOT

DOCS = ROOT / "docs"
SCRIPTS = {
    "viewer-tour.txt": (),
    "viewer-tour-strip.txt": ("high-contrast",),
    "viewer-tour-rig.txt": ("--rig", str(DOCS / "viewer-tour-rig.toml")),
}
"""The scripts of the viewer, each with further options of `holoview view`."""
_QUALITY = 88


def main() -> None:
    """Runs every script in a folder of its own, with the assets of the repository, and converts its pictures."""
    for script, options in SCRIPTS.items():
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "assets").symlink_to(ROOT / "assets")
            view = (sys.executable, "-m", "holoview", "view", *options, "--new", "--offscreen")
            subprocess.run([*view, "--script", str(DOCS / script)], cwd=folder, check=True)
            for picture in sorted(Path(folder).glob("*.png")):
                target = DOCS / "images" / f"{picture.stem}.jpg"
                Image.open(picture).convert("RGB").save(target, quality=_QUALITY, optimize=True)
                print(target)


if __name__ == "__main__":
    main()
