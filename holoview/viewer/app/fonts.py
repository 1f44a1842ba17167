"""Fonts of this machine for names in scripts that the shipped fonts lack, and what to install where there are none.

It imports no window library: as a program (`python -m holoview.viewer.app.fonts`) it prints the Debian packages that
are missing, which `.ci/fonts` installs.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_FOLDERS = (
    Path("/usr/share/fonts"),
    Path("/usr/local/share/fonts"),
    Path.home() / ".local/share/fonts",
    Path("/System/Library/Fonts"),
    Path("/Library/Fonts"),
    Path(os.environ.get("WINDIR", "C:/Windows")) / "Fonts",
)


@dataclass(frozen=True)
class Scripts:
    """Scripts that belong together: their names in words, fonts that have them, and the characters by which they count.

    files: names of the fonts' files in lower case, the best first. package: of Debian and Ubuntu, with one of them; ""
    where the font is optional. blocks: the first and the last character of each of their blocks in Unicode.
    """

    words: str
    files: tuple[str, ...]
    package: str = ""
    blocks: tuple[tuple[int, int], ...] = ()


_WHOLE = ("notosanscjk-regular.ttc", "notosanscjksc-regular.otf", "sourcehansans-regular.ttc", "wqy-microhei.ttc")
_SMALL = "fonts-wqy-microhei"  # 1.6 MB; fonts-droid-fallback has no Korean, fonts-noto-cjk 57 MB
ALL = (
    Scripts(
        "Chinese or Japanese",
        (
            *_WHOLE,
            "droidsansfallbackfull.ttf",
            "wqy-zenhei.ttc",
            "hiragino sans gb.ttc",
            "arial unicode.ttf",
            "msyh.ttc",
            "yugothm.ttc",
        ),
        _SMALL,
        ((0x2E80, 0x312F), (0x3190, 0xA4CF), (0xF900, 0xFAFF), (0xFE30, 0xFE4F), (0xFF00, 0xFFEF), (0x20000, 0x3FFFF)),
    ),
    Scripts(
        "Korean",
        (*_WHOLE, "wqy-zenhei.ttc", "nanumgothic.ttf", "applesdgothicneo.ttc", "malgun.ttf"),
        _SMALL,
        ((0x1100, 0x11FF), (0x3130, 0x318F), (0xA960, 0xA97F), (0xAC00, 0xD7FF)),
    ),
    Scripts("Arabic, Armenian, Georgian, Hebrew", ("dejavusans.ttf", "notosans-regular.ttf", "segoeui.ttf")),
    Scripts(  # without their colours
        "emoji",
        ("notoemoji-regular.ttf", "symbola.ttf", "symbola_hint.ttf", "seguiemj.ttf", "apple symbols.ttf"),
        "fonts-symbola",
        ((0x2600, 0x27BF), (0x2B00, 0x2BFF), (0x1F000, 0x1FAFF)),
    ),
)


def fonts_of_scripts(folders: Sequence[Path] | None = None) -> list[Path]:
    """The first font of this machine, by its name, of each of `ALL`; one that several have counts once.

    folders: where to look, by default where the system and the user have their fonts.
    """
    files = _files(folders)
    return list(dict.fromkeys(path for scripts in ALL if (path := _first(scripts, files)) is not None))


def missing_packages(folders: Sequence[Path] | None = None) -> list[str]:
    """The Debian packages with fonts of scripts for which this machine has none. folders: as of `fonts_of_scripts`."""
    files = _files(folders)
    lacking = (scripts.package for scripts in ALL if scripts.package and _first(scripts, files) is None)
    return list(dict.fromkeys(lacking))


def advice(undrawn: str) -> str:
    """What to do about characters that no font has: a sentence; "" where there are none of scripts with a package."""
    lacking = [of for of in ALL if any(low <= ord(sign) <= high for sign in undrawn for low, high in of.blocks)]
    if not lacking:
        return ""
    words, packages = " and ".join(of.words for of in lacking), " ".join(dict.fromkeys(of.package for of in lacking))
    return (
        f"No font of this machine has the {words} signs of a name, which are drawn as �. Install one (Debian, Ubuntu: "
        f"apt install {packages}) and start the viewer again."
    )


def _files(folders: Sequence[Path] | None) -> dict[str, Path]:
    """The fonts in some folders by their names in lower case."""
    there = [folder for folder in (_FOLDERS if folders is None else folders) if folder.is_dir()]
    return {path.name.lower(): path for folder in there for path in sorted(folder.rglob("*.[to]t[fc]"))}


def _first(scripts: Scripts, files: dict[str, Path]) -> Path | None:
    path = next((files[name] for name in scripts.files if name in files), None)
    return path if path is not None and _is_font(path) else None


def _is_font(path: Path) -> bool:
    """Whether a file begins as fonts do; ImGui ends the program at any other."""
    with suppress(OSError), path.open("rb") as file:
        return file.read(4) in (b"\x00\x01\x00\x00", b"OTTO", b"ttcf", b"true")
    return False


if __name__ == "__main__":
    print(*missing_packages())
