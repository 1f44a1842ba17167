r"""Lasers and a stage at a serial line, whose commands rig.toml states.

    [lasers]
    device = "serial"
    port = "/dev/ttyUSB0"               # or "COM3", or any address of pyserial, such as "socket://10.0.0.7:4000"
    baud = 115200                       # default 9600
    timeout = 2.0                       # s, until a command is done
    start = "*CLS\n"                    # sent first of all
    on = ["L{number}:POW {power:.1f}\n", "L{number}:ON\n"]
    off = "ALL:OFF\n"
    full_power = 20.0                   # what {power} is at relative power 1; default 1
    done = "OK"                         # how the line begins that answers a command; default: none is waited for
    failed = "ERR"                      # how one begins that refuses it
    [stage]
    device = "serial"
    port = "/dev/ttyUSB1"
    timeout = 60.0
    move = "G0 X{mm:.4f}\n"
    done = "ok"
    ask = "M114\n"                      # default: the position isn't asked for
    position = "X:([-+0-9.]+)"          # finds it in the answer, in mm
    zero = "12.5 mm"                    # and reversed, tolerance: see `AXIS_OPTIONS`

A command is a template of Python's `str.format`, or a list of them, each of which is answered. Lasers know {number}
(from 1, by wavelength), {nm} and {power}; a stage {mm}, {um} and {m}. Before one laser is switched on, all are switched
off.
"""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from typing import Any

from holoview.bench.rig.description import DeviceSpec, RigDescription
from holoview.bench.rig.devices import DeviceError, call_device
from holoview.bench.rig.kinds.checks import (
    AXIS_OPTIONS,
    Parse,
    StageAxis,
    open_or_close,
    option_place,
    parse_options,
    require_device,
    text,
    texts,
)
from holoview.light.model.fields import Integer, Number
from holoview.util.errors import UserError
from holoview.util.packages import import_optional

_LINE: dict[str, Parse] = {
    "port": text,
    "baud": Integer(low=50, high=10_000_000).parse,
    "timeout": Number(low=0.0, high=1e4).parse,
    "start": texts,
    "done": text,
    "failed": text,
}
_LASERS: dict[str, Parse] = {**_LINE, "on": texts, "off": texts, "full_power": Number(low=0.0, high=1e9).parse}
_STAGE: dict[str, Parse] = {**_LINE, "move": texts, "ask": text, "position": text, **AXIS_OPTIONS}
_REMEDY = "see that it is on and connected, and that port, baud and commands in rig.toml are right"
_OFF_REMEDY = "make sure by hand that all lasers are off"
_TIMEOUT_S, _BAUD = 2.0, 9600
_MAX_SHOWN = 3  # answers that an error quotes


def open_serial(rig: RigDescription, spec: DeviceSpec) -> Any:
    """Opens lasers or a stage. Raises UserError for wrong options, DeviceError for a line that can't be opened."""
    return require_device(rig, spec, {"lasers": _open_lasers, "stage": _open_stage})(rig, spec)


class SerialLine:
    """Commands over a serial line, and answers. name: of the device. options: parsed ones."""

    def __init__(self, name: str, options: Mapping[str, Any]) -> None:
        library = import_optional("serial", f'{name}: device = "serial"')
        self._name, self._timeout_s = name, float(options.get("timeout", _TIMEOUT_S))
        self._done, self._failed = options.get("done"), options.get("failed")
        port, baud = options["port"], options.get("baud", _BAUD)
        self._port = call_device(
            name,
            f'open "{port}"',
            _REMEDY,
            lambda: library.serial_for_url(port, baudrate=baud, write_timeout=self._timeout_s),
        )

    def command(self, templates: tuple[str, ...], fields: Mapping[str, float], remedy: str = _REMEDY) -> None:
        """Sends commands one after the other, each when the one before is done."""
        for template in templates:
            sent = self._send(template, fields, remedy)
            if self._done is not None:
                self._wait_for(sent, lambda line: line.startswith(self._done), remedy)

    def ask(self, template: str, answer: re.Pattern[str]) -> str:
        """Sends a question; returns the first group of the answer that matches."""
        sent = self._send(template, {}, _REMEDY)
        line = self._wait_for(sent, lambda line: answer.search(line) is not None, _REMEDY)
        match = answer.search(line)
        assert match is not None
        return match.group(1)

    def close(self) -> None:
        """Closes the line."""
        self._port.close()

    def _send(self, template: str, fields: Mapping[str, float], remedy: str) -> str:
        sent = template.format(**fields)

        def write() -> None:
            self._port.reset_input_buffer()
            self._port.write(sent.encode("utf-8"))
            self._port.flush()

        call_device(self._name, f"take {sent!r}", remedy, write)
        return sent

    def _wait_for(self, sent: str, is_answer: Any, remedy: str) -> str:
        """The line that answers. Raises DeviceError for a refusal, and if none comes in time."""
        end, received, begun = time.monotonic() + self._timeout_s, [], b""
        while (left := end - time.monotonic()) > 0:
            self._port.timeout = left
            begun += call_device(self._name, f"answer {sent!r}", remedy, self._port.readline)
            if not begun.endswith(b"\n"):
                continue
            line, begun = begun.decode("utf-8", "replace").strip(), b""
            if self._failed is not None and line.startswith(self._failed):
                raise DeviceError(self._name, f"refused {sent!r}: {line}", remedy=remedy)
            if is_answer(line):
                return line
            received.append(line)
        found = f"didn't answer {sent!r} within {self._timeout_s:g} s"
        if received:
            found += f", but sent {', '.join(repr(line) for line in received[-_MAX_SHOWN:])}"
        raise DeviceError(self._name, found, remedy=remedy)


class SerialLasers:
    """Lasers at a serial line; they are switched off when it is opened."""

    def __init__(self, rig: RigDescription, options: Mapping[str, Any], line: SerialLine) -> None:
        self.wavelengths_m, self._line = rig.wavelengths_m, line
        self._on, self._off, self._full = options["on"], options["off"], options.get("full_power", 1.0)
        try:
            line.command(options.get("start", ()), {})
        finally:
            self.switch_off()

    def switch_on(self, wavelength_m: float, power: float) -> None:
        """Switches all off, then one on."""
        self.switch_off()
        number = self.wavelengths_m.index(wavelength_m) + 1
        self._line.command(self._on, _laser_fields(number, wavelength_m, power * self._full))

    def switch_off(self) -> None:
        """Switches all off."""
        self._line.command(self._off, {}, _OFF_REMEDY)

    def close(self) -> None:
        """Switches all off and closes the line."""
        try:
            self.switch_off()
        finally:
            self._line.close()


class SerialStage:
    """A stage at a serial line."""

    def __init__(self, rig: RigDescription, options: Mapping[str, Any], line: SerialLine) -> None:
        self.range_m, self._line, self._axis = rig.stage_m, line, StageAxis.of(options)
        self._move, self._ask = options["move"], options.get("ask")
        self._answer = re.compile(options.get("position", ""))
        line.command(options.get("start", ()), {})

    def move_to(self, distance_m: float) -> float:
        """Moves there; returns where it stopped, or the target where the position isn't asked for."""
        self._line.command(self._move, _stage_fields(self._axis.position_m(distance_m)))
        if self._ask is None:
            return distance_m
        read = self._line.ask(self._ask, self._answer)
        try:
            found_m = self._axis.distance_m(float(read) * 1e-3)
        except ValueError as error:
            raise DeviceError(
                "stage", f"sent the position {read!r}", expected="a number of mm", remedy=_REMEDY
            ) from error
        self._axis.require_arrived(found_m, distance_m)
        return found_m

    def close(self) -> None:
        """Closes the line."""
        self._line.close()


def _open_lasers(rig: RigDescription, spec: DeviceSpec) -> SerialLasers:
    options = parse_options(rig, spec, _LASERS, required=("port", "on", "off"))
    where, fields = option_place(rig, spec), _laser_fields(1, rig.wavelengths_m[0], 0.5)
    _check_templates(where, options, {"start": {}, "off": {}, "on": fields})
    line = SerialLine(spec.name, options)
    return open_or_close(line, lambda: SerialLasers(rig, options, line))


def _open_stage(rig: RigDescription, spec: DeviceSpec) -> SerialStage:
    options = parse_options(rig, spec, _STAGE, required=("port", "move"))
    where = option_place(rig, spec)
    _check_templates(where, options, {"start": {}, "ask": {}, "move": _stage_fields(0.0)})
    if ("ask" in options) != ("position" in options):
        raise UserError(f"{where}.ask", "stands without its partner", expected="`ask` and `position` together")
    try:
        groups = re.compile(options.get("position", "()")).groups
    except re.error as error:
        raise UserError(f"{where}.position", f"{error}", expected="a regular expression") from error
    if groups != 1:
        raise UserError(f"{where}.position", f"has {groups} groups", expected="one in parentheses, the position in mm")
    line = SerialLine(spec.name, options)
    return open_or_close(line, lambda: SerialStage(rig, options, line))


def _laser_fields(number: int, wavelength_m: float, power: float) -> dict[str, float]:
    return {"number": number, "nm": wavelength_m * 1e9, "power": power}


def _stage_fields(position_m: float) -> dict[str, float]:
    return {"mm": position_m * 1e3, "um": position_m * 1e6, "m": position_m}


def _check_templates(where: str, options: Mapping[str, Any], fields: Mapping[str, Mapping[str, float]]) -> None:
    """Raises UserError for a template that can't be filled. fields: known to each option's templates."""
    for key, known in fields.items():
        for template in texts(options[key], key) if isinstance(options.get(key), str) else options.get(key, ()):
            try:
                template.format(**known)
            except (KeyError, IndexError, ValueError, AttributeError) as error:
                expected = f"a template that knows {', '.join(f'{{{name}}}' for name in known) or 'no fields'}"
                found = f"{template!r} can't be filled: {type(error).__name__}: {error}"
                raise UserError(f"{where}.{key}", found, expected=expected) from error
