"""Runs text scripts in a viewer that draws off screen, one action for each line, e.g. for pictures of the manual.

open still-life.png          a preset, file or picture, as the window opens it
set gap = "3 mm"             a key of the bench, as --set takes it
look exposure_stops = 1      a field of the look
command Pin a snapshot       a command by its name
show Gamut                   a panel by its title
key Ctrl+Z                   keys
type 550                     text, into what has the focus
click image 0.5 0.5          a marked item, and where in it; 0.5 0.5 if absent
drag image 0.2 0.2 0.8 0.8   from there to there
wheel image 0.5 0.5 2        the wheel, by notches
wait                         until everything is computed, all jobs have ended, and a rig has obeyed
screenshot FILE.png          the whole window
"""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from holoview.app.input_driver import InputDriver
from holoview.io.pictures import write_png
from holoview.util.errors import UserError, suggest_matches
from holoview.util.tables import parse_toml_value

_TIMEOUT_S = 600.0
_POLL_S = 0.02


def run_script(driver: InputDriver, text: str, where: str = "script") -> None:
    """Runs the lines of a script. Raises UserError that names the line which is wrong or fails."""
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.strip()
        if not words or words.startswith("#"):
            continue
        try:
            _run(driver, words)
        except UserError as error:
            raise error.inside(f"{where}:{number}: ") from error


def _run(driver: InputDriver, line: str) -> None:
    verb, _, rest = line.partition(" ")
    verbs: dict[str, Callable[[InputDriver, str], None]] = {
        "open": _open,
        "set": _set,
        "look": _look,
        "command": lambda driver, name: driver.context.commands.run(name),
        "show": lambda driver, title: driver.context.show_panel(title),
        "key": lambda driver, chord: driver.press_chord(chord),
        "type": lambda driver, text: driver.type_text(text),
        "click": _click,
        "drag": _drag,
        "wheel": _wheel,
        "wait": lambda driver, _: wait_until_idle(driver),
        "screenshot": lambda driver, path: screenshot(driver, Path(path)),
    }
    if verb not in verbs:
        raise UserError(f'"{verb}"', "unknown", remedy=suggest_matches(verb, verbs))
    verbs[verb](driver, rest.strip())
    driver.draw_frames(2)
    _raise_errors(driver)


def wait_until_idle(driver: InputDriver) -> None:
    """Draws until everything is computed and all jobs have ended."""
    driver.draw_until_idle(_TIMEOUT_S)
    if not driver.app.session.wait_until_idle(_TIMEOUT_S):
        raise UserError("wait", f"jobs still run after {_TIMEOUT_S:g} s")
    _wait_for_rig(driver)
    driver.draw_until_idle(_TIMEOUT_S)


def _wait_for_rig(driver: InputDriver) -> None:
    """Draws until the devices of a rig have done what they were asked for, and the picture is of that."""
    until = time.monotonic() + _TIMEOUT_S
    while (rig := driver.context.opened_rig) is not None and rig.is_busy:
        if time.monotonic() > until:
            raise UserError("wait", rig.waiting or "the rig is busy")
        time.sleep(_POLL_S)
        driver.draw_frames()


def screenshot(driver: InputDriver, path: Path) -> None:
    """Writes the whole window as PNG."""
    write_png(path, driver.draw_frames(2), {})


def _raise_errors(driver: InputDriver) -> None:
    """Raises the failure of a panel, or a UserError for an error message: nobody reads messages of a script."""
    for guarded in driver.app.panels:
        if guarded.failure is not None:
            raise guarded.failure
    wrong = [message for message in driver.app.session.messages.all if message.kind == "error"]
    if wrong:
        raise UserError("the viewer", wrong[-1].text)


def _open(driver: InputDriver, names: str) -> None:
    driver.context.loader.open(shlex.split(names))
    wait_until_idle(driver)


def _set(driver: InputDriver, text: str) -> None:
    for key, value in _parse_assignment(text).items():
        driver.app.session.change(f"Set {key}", {key: value})


def _look(driver: InputDriver, text: str) -> None:
    driver.app.session.edit_view("Look", **_parse_assignment(text))


def _parse_assignment(text: str) -> dict[str, Any]:
    """Parses KEY = VALUE with a TOML value, else a plain string; dots are part of the key."""
    key, equals, value = text.partition("=")
    if not equals:
        raise UserError(text, "isn't KEY = VALUE")
    return {key.strip(): parse_toml_value(value, key.strip())}


def _split_numbers(text: str, count: int, default: tuple[float, ...]) -> tuple[str, list[float]]:
    """Splits the name of an item from `count` numbers after it; with fewer numbers, all words are the name."""
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise UserError(text, "a quotation mark that isn't closed") from error
    last = words[-count:]
    if len(words) <= count or not all(map(_is_number, last)):
        return " ".join(words), list(default)
    return " ".join(words[:-count]), [float(word) for word in last]


def _is_number(word: str) -> bool:
    return word.lstrip("-").replace(".", "", 1).isdigit()


def _click(driver: InputDriver, text: str) -> None:
    name, (x, y) = _split_numbers(text, 2, (0.5, 0.5))
    driver.click(driver.item_position(name, x, y))


def _drag(driver: InputDriver, text: str) -> None:
    name, numbers = _split_numbers(text, 4, ())
    if len(numbers) != 4:
        raise UserError(f"drag {text}", "isn't ITEM X0 Y0 X1 Y1")
    x0, y0, x1, y1 = numbers
    driver.drag(driver.item_position(name, x0, y0), driver.item_position(name, x1, y1), steps=6)


def _wheel(driver: InputDriver, text: str) -> None:
    name, numbers = _split_numbers(text, 3, ())
    if len(numbers) != 3:
        raise UserError(f"wheel {text}", "isn't ITEM X Y NOTCHES")
    driver.wheel(driver.item_position(name, *numbers[:2]), float(np.clip(numbers[2], -100, 100)))
