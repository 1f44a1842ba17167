"""Fields from other running programs: a listener on this machine, and `push`, which sends a field to it.

A program sends a field in one HTTP request, which every language can make; no file is written and nothing is executed:

    PUT /fields/NAME?pitch=8um&wavelength=532nm&distance=20cm
    Host: 127.0.0.1:PORT        Authorization: Bearer TOKEN
    body: a .npy file, or bare numbers with &dtype=complex64&shape=1080,1920 (little-endian, the last axis fastest)

| key | meaning |
| --- | --- |
| `pitch` | distance between samples, "8um", or two of them, "8um,4um", for y and x |
| `wavelength` | once for each wavelength of the field, in its order |
| `distance` | to where the image is expected, negative before the plane; 0 if absent |
| `dtype`, `shape` | of bare numbers: complex64, complex128, float32 or float64; 2 to 4 sizes, as of `push` |

The answer is JSON: {"received": NAME}, or {"error": sentence} with a status of 400 and above. `holoview view --listen`
prints the address and the token. It also writes them to a file that only its user can read, where `push` finds them.

The listener answers on the loopback address only, to requests with the token and its own name as host. It refuses
requests of web pages, which carry an origin, and bodies beyond the memory that is free.
"""

from __future__ import annotations

import http.client
import io
import json
import math
import secrets
import urllib.parse
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from socket import create_connection
from threading import BoundedSemaphore, Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.fields.wavefield import Wavefield
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder, write_file
from holoview.util.files import cache_dir, read_limited
from holoview.util.memory_limit import require_memory
from holoview.util.plain_arrays import read_npy_header

HOST = "127.0.0.1"
LARGEST_BYTES = 8 << 30
_TYPES = ("complex64", "complex128", "float32", "float64")
_KEYS = ("pitch", "wavelength", "distance", "dtype", "shape")
_LONGEST_NAME = 200
_LONGEST_ANNOUNCEMENT = 1000  # bytes
_AT_ONCE = 4  # requests whose bodies are in memory
_SILENT_S = 10.0  # after which a connection that sends nothing is closed
_COPIES = 3  # of a body, while it becomes a complex64 field
_PREFIX = "/fields/"


@dataclass(frozen=True)
class Listener:
    """The address at which a viewer listens.

    port: on the loopback address. token: a request has to bear it.
    """

    port: int
    token: str

    @property
    def address(self) -> str:
        """The address with the token, as `push` takes it: "http://127.0.0.1:PORT/#TOKEN"."""
        return f"http://{HOST}:{self.port}/#{self.token}"

    @classmethod
    def parse(cls, address: str) -> Listener:
        """The listener at an address that a viewer printed. Raises UserError for another text."""
        parts = urllib.parse.urlsplit(address)
        with suppress(ValueError):
            if parts.hostname in (HOST, "localhost") and parts.port and parts.fragment:
                return cls(parts.port, parts.fragment)
        raise UserError(
            "address", f'"{address}"', expected=f"http://{HOST}:PORT/#TOKEN, as holoview view --listen prints it"
        )


def announcement_path() -> Path:
    """The file in which a listening viewer tells programs of the same user its address."""
    return cache_dir() / "listener.json"


def announced_listener() -> Listener:
    """The listener that a viewer has announced. Raises UserError if there is none."""
    try:
        content = json.loads(read_limited(announcement_path(), "a listener", _LONGEST_ANNOUNCEMENT))
        return Listener(int(content["port"]), str(content["token"]))
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise _no_listener() from error


def push(
    field: Any,
    name: str = "field",
    *,
    pitch: float | str | Sequence[float | str] | None = None,
    wavelengths: float | str | Sequence[float | str] | None = None,
    distance: float | str = 0.0,
    to: str | None = None,
) -> None:
    """Shows a field in a running viewer, which was started with `holoview view --listen`.

    field: a `Wavefield`, or an array or a tensor (y, x), (wavelength, y, x) or (frame, wavelength, y, x), complex, or
    real amplitudes.
    name: a field of the same name in the viewer is replaced, so that a loop shows its newest one.
    pitch: distance between samples, metres or text such as "8 um"; two of them for y and x. Of an array only.
    wavelengths: one for each wavelength of the array, metres or text such as "532 nm". Of an array only.
    distance: from the field to where its image is expected, metres or text; negative before it. Of an array only.
    to: the address that the viewer printed; the viewer of this user on this machine when None.

    Returns when the viewer has the field; it is displayed when the viewer is ready for it. Raises UserError when no
    viewer listens, or for a field that it refuses.

    >>> import holoview as hv, numpy as np
    >>> try:
    ...     hv.push(np.ones((4, 4), complex), pitch="8 um", wavelengths="532 nm", to="http://127.0.0.1:9/#token")
    ... except hv.UserError as error:
    ...     print(error.found)
    no viewer listens
    """
    listener = announced_listener() if to is None else Listener.parse(to)
    wavefield = field if isinstance(field, Wavefield) else _wavefield(field, name, pitch, wavelengths, distance)
    query = [("pitch", ",".join(f"{value!r}m" for value in map(float, wavefield.pitch_m)))]
    query += [("wavelength", f"{value!r}m") for value in map(float, wavefield.wavelengths_m)]
    query += [("distance", f"{float(wavefield.distance_m)!r}m"), ("dtype", "complex64")]
    query += [("shape", ",".join(map(str, wavefield.values.shape)))]
    path = f"{_PREFIX}{urllib.parse.quote(name, safe='')}?{urllib.parse.urlencode(query)}"
    body = np.ascontiguousarray(wavefield.values, dtype="<c8").reshape(-1).view(np.uint8).data
    connection = http.client.HTTPConnection(HOST, listener.port, timeout=60)
    try:
        connection.request("PUT", path, body, {"Authorization": f"Bearer {listener.token}"})
        answer = connection.getresponse()
        content = json.loads(answer.read())
    except (OSError, http.client.HTTPException, ValueError) as error:
        raise _no_listener(error) from error
    finally:
        connection.close()
    if answer.status >= 400:
        raise UserError(f"push {name}", str(content.get("error", answer.reason)))


def _no_listener(error: Exception | None = None) -> UserError:
    reason = f" ({error})" if error else ""
    return UserError("push", "no viewer listens", remedy=f"start one with: holoview view --listen{reason}")


def _wavefield(field: Any, name: str, pitch: Any, wavelengths: Any, distance: float | str) -> Wavefield:
    """The field of an array or a tensor. Raises UserError where the caller left out a property of an array."""
    for key, value in (("pitch", pitch), ("wavelengths", wavelengths)):
        if value is None:
            raise UserError(key, "is missing", expected=f"{key} of the array, such as {_EXAMPLES[key]}")
    array = field.detach().cpu().numpy() if hasattr(field, "detach") else np.asarray(field)
    lengths = [units.parse(value, "wavelengths") for value in _as_list(wavelengths)]
    pitches = [units.parse(value, "pitch") for value in _as_list(pitch)]
    return Wavefield.of_array(array, pitches, lengths, units.parse(distance, "distance"), name)


_EXAMPLES = {"pitch": '"8 um"', "wavelengths": '"532 nm"'}


def _as_list(value: Any) -> list[Any]:
    return [value] if isinstance(value, str | float | int | np.number) else list(value)


# --- the listener -----------------------------------------------------------------------------------------------------


class FieldListener:
    """Receives fields on the loopback address and hands each one to `receive`, on a thread of its own.

    port: 0 takes a free one. Use as a context manager, or call `close`. listener: where it listens, and its token,
    which it announces to programs of the same user. Raises UserError when the port is in use.
    """

    def __init__(self, receive: Callable[[Wavefield], None], port: int = 0) -> None:
        try:
            self._server = _Server((HOST, port), receive)
        except (OSError, OverflowError) as error:
            raise UserError(
                "--listen", f"port {port}: {error}", remedy="choose another port; 0 takes a free one"
            ) from error
        self.listener = Listener(self._server.server_address[1], self._server.token)
        content = json.dumps({"port": self.listener.port, "token": self.listener.token})
        try:
            make_folder(announcement_path().parent)
            write_file(announcement_path(), content, is_private=True)
        except UserError:
            self._server.server_close()
            raise
        self._thread = Thread(target=self._server.serve, name="holoview: listener", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends the listener and takes its announcement back."""
        self._server.end()
        self._thread.join()
        self._server.server_close()
        with suppress(UserError):
            if announced_listener() == self.listener:  # another viewer may have announced itself since
                announcement_path().unlink(missing_ok=True)

    def __enter__(self) -> FieldListener:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, address: tuple[str, int], receive: Callable[[Wavefield], None]) -> None:
        super().__init__(address, _RequestHandler)
        self.receive, self.token = receive, secrets.token_urlsafe(18)
        self.places = BoundedSemaphore(_AT_ONCE)
        self._is_open = True

    def serve(self) -> None:
        """Answers until `end`, and rests meanwhile: `serve_forever` looks twice a second whether it shall end."""
        while self._is_open:
            self.handle_request()

    def end(self) -> None:
        """Ends `serve`, which a connection wakes."""
        self._is_open = False
        with suppress(OSError):
            create_connection((HOST, self.server_address[1])).close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that goes away in the middle of a request is no error of the viewer."""


class _RequestHandler(BaseHTTPRequestHandler):
    server: _Server
    timeout = _SILENT_S
    protocol_version = "HTTP/1.1"
    server_version = "holoview"
    sys_version = ""

    def do_PUT(self) -> None:
        """Receives a field."""
        if self._is_refused():
            return
        try:
            with self.server.places:
                name, wavefield = self._read_field()
                self.server.receive(wavefield)
        except UserError as error:
            self._answer(400, {"error": str(error)})
        except OSError:
            self.close_connection = True
        except (ValueError, TypeError, OverflowError, MemoryError) as error:  # of the parsers of URLs and arrays
            self._answer(400, {"error": f"the field is damaged: {error or type(error).__name__}"})
        else:
            self._answer(200, {"received": name})

    def log_message(self, format: str, *args: Any) -> None:
        """Requests aren't printed."""

    def _is_refused(self) -> bool:
        """Answers requests without the token, under another name, or of a web page; whether it was such a request."""
        port = self.server.server_address[1]
        hosts = {f"{host}:{port}" for host in (HOST, "localhost")}
        given = self.headers.get("Authorization", "").encode("utf-8", "replace")
        if self.headers.get("Host") not in hosts or "Origin" in self.headers:
            self._answer(403, {"error": "only programs on this machine may send fields"})
        elif not secrets.compare_digest(given, f"Bearer {self.server.token}".encode()):
            self._answer(401, {"error": "the token is missing or wrong; holoview view --listen prints it"})
        else:
            return False
        return True

    def _read_field(self) -> tuple[str, Wavefield]:
        url = urllib.parse.urlsplit(self.path)
        name = urllib.parse.unquote(url.path.removeprefix(_PREFIX))
        if not url.path.startswith(_PREFIX) or not 0 < len(name) <= _LONGEST_NAME:
            raise UserError(url.path[:80], "isn't known here", expected=f"{_PREFIX}NAME")
        query = urllib.parse.parse_qs(url.query, keep_blank_values=True)
        if unknown := sorted(set(query) - set(_KEYS)):
            raise UserError(unknown[0], "is no key of a field", expected=", ".join(_KEYS))
        pitches = [units.parse(text, "pitch") for text in _one(query, "pitch").split(",")]
        lengths = [units.parse(text, "wavelength") for text in query.get("wavelength", [])]
        distance_m = units.parse(_one(query, "distance", "0m"), "distance")
        array = self._read_array(query)
        return name, Wavefield.of_array(array, pitches, lengths, distance_m, name)

    def _read_array(self, query: dict[str, list[str]]) -> NDArray[Any]:
        """The numbers in the body, a .npy file or bare; their memory is asked for before they are read."""
        size = self.headers.get("Content-Length", "")
        if not (size.isdecimal() and len(size) < 16 and 0 < int(size) <= LARGEST_BYTES):
            raise UserError("body", f'Content-Length "{size[:20]}"', expected=f"1 to {LARGEST_BYTES} bytes")
        require_memory("a field from another program", _COPIES * int(size), remedy="send fewer samples")
        if "dtype" not in query:
            return _parse_npy(self._read_body(int(size)))
        shape, dtype = _parse_shape(_one(query, "shape")), _one(query, "dtype")
        if dtype not in _TYPES:
            raise UserError("dtype", f'"{dtype}"', expected=", ".join(_TYPES))
        expected = math.prod(shape) * np.dtype(dtype).itemsize
        if expected != int(size):
            raise UserError("body", f"{size} bytes", expected=f"{expected} for {shape} of {dtype}")
        return np.frombuffer(self._read_body(expected), np.dtype(dtype).newbyteorder("<")).reshape(shape)

    def _read_body(self, size: int) -> bytes:
        body = self.rfile.read(size)
        if len(body) != size:
            raise UserError("body", f"ended after {len(body)} bytes", expected=f"{size} bytes")
        return body

    def _answer(self, status: int, content: dict[str, str]) -> None:
        body = json.dumps(content).encode()
        if status >= 400:
            self.close_connection = True  # the rest of the request isn't read
        with suppress(OSError):
            self.send_response(status)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(body)))
            if self.close_connection:
                self.send_header("Connection", "close")
            self.end_headers()
            self.wfile.write(body)


def _one(query: dict[str, list[str]], key: str, default: str | None = None) -> str:
    """The value of a key that is given once."""
    values = query.get(key, [] if default is None else [default])
    if len(values) != 1:
        raise UserError(key, f"given {len(values)} times", expected="once")
    return values[0]


def _parse_shape(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    if not (2 <= len(parts) <= 4 and all(part.isdecimal() and len(part) < 8 and int(part) > 0 for part in parts)):
        raise UserError("shape", f'"{text[:80]}"', expected="2 to 4 whole numbers above 0, such as 1080,1920")
    return tuple(map(int, parts))


def _parse_npy(body: bytes) -> NDArray[Any]:
    header = read_npy_header(io.BytesIO(body), len(body), "body, a .npy file")
    return header.array(memoryview(body)[header.offset :])
