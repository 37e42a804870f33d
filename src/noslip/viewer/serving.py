"""Starting and stopping viser's server, without its messages on standard output."""

from __future__ import annotations

import contextlib
import io
import socket
import threading
from collections.abc import Iterator, Sequence
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

import viser
import websockets.asyncio.server

from noslip.errors import InputError

LOOPBACK = "127.0.0.1"
"""This machine alone: what is served elsewhere is asked for."""
_LOCAL = (LOOPBACK, "localhost", "::1")
_DOOR = threading.Lock()
"""One server starts at a time, since all share what starts them."""


def serve(host: str, port: int) -> viser.ViserServer:
    """Return a running server; a port that is taken gives way to the next one that is free.

    Raises
    ------
    InputError
        If nothing can be served at that address.
    """
    try:
        # viser itself would try one port after the other, for ever.
        family, kind, *_, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.bind(address)
    except OSError as error:
        raise InputError(
            f"--host: nothing can be served at {host} ({error.strerror or error}); give an address "
            f"of this machine, such as {LOOPBACK}"
        ) from error
    with _DOOR, guarded(host), contextlib.redirect_stdout(io.StringIO()):
        return viser.ViserServer(host=host, port=port, label="noslip", verbose=False)


@contextlib.contextmanager
def guarded(host: str) -> Iterator[None]:
    """Have servers that start meanwhile refuse pages of other sites, which a browser lets connect.

    What a browser opens names its site (Origin), which must be the address that it was sent to
    (Host); and where only this machine is served, that must be a name of it, lest another site's
    name be turned to this address.  viser has no option for it.
    """
    serve = websockets.asyncio.server.serve

    def guarding(*args: Any, process_request: Any, **options: Any) -> Any:
        def process(connection: Any, request: Any) -> Any:
            if not allowed(
                host, request.headers.get_all("Host"), request.headers.get_all("Origin")
            ):
                return connection.respond(HTTPStatus.FORBIDDEN, "noslip: not from this page\n")
            return process_request(connection, request)

        return serve(*args, process_request=process, **options)

    websockets.asyncio.server.serve = guarding  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]


def allowed(host: str, hosts: Sequence[str], origins: Sequence[str]) -> bool:
    """Whether a request was sent to this server, and by its own page or by no page at all."""
    if len(hosts) != 1 or any(urlsplit(o).netloc.lower() != hosts[0].lower() for o in origins):
        return False
    return host not in _LOCAL or urlsplit(f"//{hosts[0]}").hostname in _LOCAL


def stop(server: viser.ViserServer) -> None:
    """Stop a server and its threads."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()
