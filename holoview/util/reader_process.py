"""Reads a stranger's file in a child process, so that a library that crashes or doesn't end becomes a sentence.

Libraries in C and C++ that read HDF5, TIFF, OpenEXR and pictures have ended the process on damaged files, by a signal
or by never returning. On Linux they run in a fork of this process with limits of processor time, time and address
space, which sends back what it has read. It is no sandbox: the child has the rights of its parent.

Elsewhere (on Windows there is no fork, on macOS one isn't safe beside the system's libraries, and a system may have no
place for another process) they run in this process.
"""

from __future__ import annotations

import faulthandler
import gc
import os
import pickle
import signal
import socket
import struct
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, NoReturn, TypeVar

import psutil

from holoview.util.errors import UserError
from holoview.util.memory_limit import FREE_SHARE, allowed_bytes
from holoview.util.processes import ENDING

if sys.platform == "linux":
    import resource

Answer = Callable[[Any], Any]
"""Gives the answer to a request; both can be pickled."""

T = TypeVar("T")

CAN_FORK = sys.platform == "linux"
"""Whether readers run in a child process here."""

_CPU_S, _BYTES_A_SECOND = 15.0, 2e6
"""Processor time of the child for one request: so many seconds, and one more for each so many bytes of the file."""
_WALL_FACTOR = 8  # of that time on the clock: other programs run too
_LENGTHS = struct.Struct("<QQ")  # of a message: bytes of its pickle, and the number of buffers beside it


@contextmanager
def in_child(where: str, path: Path, serve: Callable[[], AbstractContextManager[Answer]]) -> Iterator[Answer]:
    """Enters `serve` in a child process; yields a function that sends it requests and returns its answers.

    where: names the file in errors. path: the file, whose size says how long reading it may take. serve: as it would be
    entered here; the answers may hold arrays of any size. Answers come one at a time, also to several threads.

    The function raises what the answering one raised, and UserError when the child was ended by a signal or took longer
    than is allowed.
    """
    if not CAN_FORK or _child.is_this:
        with serve() as answer:
            yield answer
        return
    ours, theirs = socket.socketpair()
    allowed_s = _CPU_S + path.stat().st_size / _BYTES_A_SECOND
    try:
        pid = _fork()
        if pid is None:
            with serve() as answer:
                yield answer
            return
        if pid == 0:
            ours.close()
            _serve(theirs, serve, allowed_s)
        theirs.close()
        ours.settimeout(_WALL_FACTOR * allowed_s)
        connection = _Connection(where, pid, ours, Lock())
        try:
            yield connection.ask
        finally:
            connection.end()
    finally:
        ours.close()
        theirs.close()


def call_in_child(where: str, path: Path, work: Callable[[], T]) -> T:
    """The result of `work` in a child process; where, path and errors as of `in_child`."""
    with in_child(where, path, lambda: nullcontext(lambda _: work())) as ask:
        result: T = ask(None)
        return result


@dataclass
class _Child:
    """is_this: whether this process is the child of another one, which reads for it."""

    is_this: bool = False


_child = _Child()


def _fork() -> int | None:
    """As `os.fork`; None where the system has no place for another process."""
    with warnings.catch_warnings(), suppress(OSError):
        warnings.simplefilter(
            "ignore", DeprecationWarning
        )  # of a fork beside threads: the child takes none of their locks
        return os.fork()
    return None


# --- the parent -------------------------------------------------------------------------------------------------------


@dataclass
class _Connection:
    where: str
    pid: int
    socket: socket.socket
    lock: Lock
    status: int | None = None

    def ask(self, request: Any) -> Any:
        with self.lock:
            try:
                _send(self.socket, request)
                is_answer, result = _receive(self.socket)
            except TimeoutError as error:
                waited_s = self.socket.gettimeout()
                self.end()
                raise UserError(
                    self.where,
                    f"couldn't be read: its reader gave no answer for {waited_s:.0f} s",
                    remedy="try again when the machine has less to do; if it fails again, save or copy the file again",
                ) from error
            except (EOFError, OSError) as error:
                self.end()
                raise self._error(self._reason()) from error
        if is_answer:
            return result
        raise result

    def _reason(self) -> str:
        code = 0 if self.status is None else os.waitstatus_to_exitcode(self.status)
        if code == -signal.SIGXCPU:
            return "takes too long to read"
        name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return f"crashed the library that reads it ({name})"

    def _error(self, found: str) -> UserError:
        return UserError(self.where, f"is damaged: it {found}", remedy="save or copy the file again")

    def end(self) -> None:
        """Ends the child, unless it has ended."""
        if self.status is not None:
            return
        self.socket.close()  # a child that waits for a request ends
        with suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)
        self.status = os.waitpid(self.pid, 0)[1]


# --- the child --------------------------------------------------------------------------------------------------------


def _serve(
    connection: socket.socket, serve: Callable[[], AbstractContextManager[Answer]], allowed_s: float
) -> NoReturn:
    """Answers requests until the parent closes the connection or is gone."""
    try:
        _child.is_this = True
        gc.freeze()  # the parent's garbage isn't collected here: its end may wait for a lock that no thread gives back
        faulthandler.disable()
        for number in ENDING:  # which the parent handles
            signal.signal(number, signal.SIG_IGN)
        _limit_memory()
        try:
            _limit_time(allowed_s)
            with serve() as answer:
                while True:
                    request = _receive(connection)
                    _limit_time(allowed_s)
                    _reply(connection, answer, request)
        except EOFError:
            pass
        except BaseException as error:
            _receive(connection)
            _send(connection, (False, _portable(error)))
    finally:
        os._exit(0)


def _reply(connection: socket.socket, answer: Answer, request: Any) -> None:
    try:
        _send(connection, (True, answer(request)))
    except Exception as error:
        _send(connection, (False, _portable(error)))


def _portable(error: BaseException) -> BaseException:
    """The error alone, or one with its text if it can't be pickled.

    Libraries such as dask's make an error's cause a part of its pickle, and causes of decoders can't be restored.
    """
    error.__cause__ = error.__context__ = None
    try:
        pickle.loads(pickle.dumps(error))
    except Exception as problem:
        return RuntimeError(f"{type(error).__name__}: {error} (which can't be sent on: {problem})")
    return error


def _limit_memory() -> None:
    """As much more address space as memory is free: the same needs are refused by their numbers as in the parent."""
    _set_limit(resource.RLIMIT_AS, psutil.Process().memory_info().vms + int(allowed_bytes() / FREE_SHARE))
    _set_limit(resource.RLIMIT_CORE, 0)


def _limit_time(allowed_s: float) -> None:
    """So much processor time from now on; the system then ends the process by SIGXCPU."""
    _set_limit(resource.RLIMIT_CPU, int(sum(os.times()[:2]) + allowed_s + 1))


def _set_limit(kind: int, soft: int) -> None:
    hard = resource.getrlimit(kind)[1]
    resource.setrlimit(kind, (soft if hard == resource.RLIM_INFINITY else min(soft, hard), hard))


# --- messages ---------------------------------------------------------------------------------------------------------


def _send(connection: socket.socket, message: Any) -> None:
    """A pickle, and the numbers of its arrays beside it, which are not copied."""
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(message, protocol=5, buffer_callback=buffers.append)
    views = [buffer.raw() for buffer in buffers]
    connection.sendall(_LENGTHS.pack(len(pickled), len(views)))
    connection.sendall(struct.pack(f"<{len(views)}Q", *(view.nbytes for view in views)))
    connection.sendall(pickled)
    for view in views:
        connection.sendall(view)


def _receive(connection: socket.socket) -> Any:
    """The message that the other process sent. Raises EOFError where it closed the connection."""
    length, count = _LENGTHS.unpack(_read(connection, _LENGTHS.size))
    sizes = struct.unpack(f"<{count}Q", _read(connection, 8 * count))
    pickled = _read(connection, length)
    return pickle.loads(pickled, buffers=[_read(connection, size) for size in sizes])


def _read(connection: socket.socket, size: int) -> bytearray:
    data = bytearray(size)
    left = memoryview(data)
    while left:
        got = connection.recv_into(left)
        if got == 0:
            raise EOFError
        left = left[got:]
    return data
