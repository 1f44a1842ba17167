"""Serves the viewer to a browser by HTTP and WebSocket, protected by a token in the address.

rendercanvas streams images and receives events. Whoever has the token can open and write files as the user who started
the viewer, unless it is served to look at. Therefore it is served to this machine only, unless another address is
given; requests under other names are refused, and so are WebSocket connections from pages of other sites, although the
browser would send them the cookie with the token. docs/security.md has the whole threat model.
"""

from __future__ import annotations

import secrets
import socket
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from holoview.app.client_places import ClientPlaces
from holoview.app.serve_guard import Application, HostGuard, TokenGuard
from holoview.app.serve_options import Address, ServeOptions
from holoview.util.errors import UserError
from holoview.util.packages import import_optional

__all__ = ["Address", "ServeOptions", "TokenGuard", "guarded", "require_serving_libraries", "serve"]


def guarded(application: Application, token: str, cookie: str, address: Address, options: ServeOptions) -> Application:
    """An application behind all guards: names, token and origin, and the number of clients.

    cookie: the name of the cookie that holds the token.
    """
    places = ClientPlaces(application, options.clients, 60 * options.idle_min)
    return HostGuard(TokenGuard(places, token, cookie, options.host_names), partial(options.answers_to, address))


def serve(
    address: Address,
    began: Callable[[str], None],
    is_over: Callable[[], bool] = lambda: False,
    token: str | None = None,
    options: ServeOptions | None = None,
) -> None:
    """Serves the canvas of `rendercanvas.http` until it is interrupted or `is_over` returns true.

    began: called with the URL, and before that with a warning if other machines can reach the address. token: a random
    one when None. options: `ServeOptions()` when None. Raises UserError if a library isn't installed or the address is
    in use.
    """
    require_serving_libraries()
    from rendercanvas.http import asgi

    from holoview.app.serve_connections import make_server

    options = options or ServeOptions()
    token = secrets.token_urlsafe(18) if token is None else token
    with _listening(address) as listener:
        port = listener.getsockname()[1]
        cookie = f"holoview-{port}"  # cookies know hosts, not ports
        application = guarded(asgi, token, cookie, address, options)
        server = make_server(application, options.clients, options.certificate, options.key, is_over=is_over)
        if warning := options.warning(address):
            began(warning)
        began(address.url(port, token, options.scheme))
        with suppress(KeyboardInterrupt):
            server.run(sockets=[listener])


def require_serving_libraries() -> None:
    """Raises UserError if a library of the extra "serve" isn't installed."""
    for library in ("uvicorn", "websockets"):
        import_optional(library, "--serve")


def _listening(address: Address) -> socket.socket:
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    try:
        return socket.create_server((address.host, address.port), family=family)
    except OSError as error:
        remedy = "choose another port; 0 takes a free one"
        raise UserError("--serve", f"{address.host}:{address.port}: {error.strerror}", remedy=remedy) from error
