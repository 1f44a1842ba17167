"""Where and to whom the viewer is served: address, names it answers to, clients, what they may do, and TLS."""

from __future__ import annotations

import ipaddress
import re
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path

from holoview.util.errors import UserError

CLIENTS = 8
"""Clients at a time unless told."""
_MOST_CLIENTS = 1000
_LONGEST_IDLE_MIN = 7 * 24 * 60.0
ANY_ADDRESS = ("0.0.0.0", "::")
"""Addresses that can be listened at, but not opened in a browser."""
_LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
_HOST_NAME = re.compile(r"[a-z0-9]([a-z0-9-]*[a-z0-9])?(\.[a-z0-9]([a-z0-9-]*[a-z0-9])?)*")


@dataclass(frozen=True)
class Address:
    """Where to serve: a host name or IP address, and a port; port 0 chooses a free one."""

    host: str = "127.0.0.1"
    port: int = 0

    @classmethod
    def parse(cls, text: str) -> Address:
        """Parses "HOST:PORT", ":PORT" or "PORT". Raises UserError for anything else."""
        host, _, port = text.strip().rpartition(":")
        if not port.isdecimal() or not 0 <= int(port) < 65536:
            raise UserError("--serve", f'"{text}"', expected="HOST:PORT, e.g. 127.0.0.1:8080")
        return cls(host.strip("[]") or "127.0.0.1", int(port))

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach it."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    @property
    def warning(self) -> str:
        """The risk of serving to other machines without encryption; empty if only this machine can reach it."""
        if self.is_loopback:
            return ""
        return (
            f"warning: {self.host} can be reached from other machines, and the connection is not encrypted. Whoever "
            "listens on the network can read the token and all that is shown, and can then open and write files as "
            f"you. Safer: --serve 127.0.0.1:{self.port}, and from there ssh -L {self.port}:127.0.0.1:{self.port} HOST"
        )

    def url(self, port: int, token: str, scheme: str = "http") -> str:
        """The URL to open in a browser, for the port that was chosen."""
        host = socket.gethostname() if self.host in ANY_ADDRESS else self.host
        return f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}/?token={token}"


@dataclass(frozen=True)
class ServeOptions:
    """To whom the viewer is served.

    clients: the most connections of pages at a time. idle_min: minutes without input after which one is closed, 0 for
    never. is_read_only: whether pages can't open, save or export files nor end the viewer. host_names: names beside
    those of the address by which browsers reach it, as behind a reverse proxy. certificate, key: PEM files for TLS, or
    none; the key may stand in the file of the certificate.

    Raises UserError for values out of range and for files that don't make a certificate with its key.
    """

    clients: int = CLIENTS
    idle_min: float = 60.0
    is_read_only: bool = False
    host_names: tuple[str, ...] = ()
    certificate: Path | None = None
    key: Path | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.clients <= _MOST_CLIENTS:
            raise UserError("--clients", f"{self.clients}", expected=f"from 1 to {_MOST_CLIENTS}")
        if not 0 <= self.idle_min <= _LONGEST_IDLE_MIN:
            raise UserError("--idle", f"{self.idle_min:g}", expected=f"minutes from 0 (never) to {_LONGEST_IDLE_MIN:g}")
        for name in self.host_names:
            if not _HOST_NAME.fullmatch(name.lower()):
                raise UserError(
                    "--host-name", f'"{name}"', expected="a name without scheme and port: viewer.example.org"
                )
        _check_certificate(self.certificate, self.key)

    @property
    def scheme(self) -> str:
        """Of the URL: "https" with a certificate."""
        return "http" if self.certificate is None else "https"

    def warning(self, address: Address) -> str:
        """The risk of serving at an address, in words; empty if only this machine can reach it."""
        if address.is_loopback:
            return ""
        may = "see and change what is shown" if self.is_read_only else "open and write files as you"
        if self.certificate is None:
            return address.warning.replace("open and write files as you", may)
        return f"warning: {address.host} can be reached from other machines. Whoever has the token can {may}."

    def answers_to(self, address: Address, host: str) -> bool:
        """Whether a name or IP address by which a browser reached the viewer is one of its own.

        A page of another site that has its own name resolved to this machine (DNS rebinding) comes with that name. IP
        addresses can't be rebound, so that one that is listened at may have any.
        """
        host = host.lower().rstrip(".")
        if host in {name.lower() for name in self.host_names} or host == address.host.lower():
            return True
        if address.is_loopback:
            return host in _LOOPBACK_NAMES
        return address.host in ANY_ADDRESS and (host == socket.gethostname().lower() or _is_ip_address(host))


def _is_ip_address(text: str) -> bool:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True


def _check_certificate(certificate: Path | None, key: Path | None) -> None:
    if certificate is None:
        if key is not None:
            raise UserError("--key", "without --certificate", expected="--certificate with it")
        return
    for flag, path in (("--certificate", certificate), ("--key", key)):
        if path is not None and not path.is_file():
            raise UserError(flag, f"{path} isn't a file", expected="a file in PEM")
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password=lambda: "")
    except (ssl.SSLError, OSError) as error:
        raise UserError(
            "--certificate",
            f"{certificate} with {key or 'the key in it'}: {error}",
            expected="a certificate and its own key in PEM, the key without a password",
        ) from error
