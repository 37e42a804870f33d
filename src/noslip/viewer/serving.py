"""Starting and stopping viser's server, without its messages, and who gets in."""

from __future__ import annotations

import contextlib
import hmac
import io
import secrets
import socket
import threading
from collections.abc import Iterator, Sequence
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, urlsplit

import viser
import websockets.asyncio.server

from noslip.errors import InputError
from noslip.viewer.shell import amended_response

LOOPBACK = "127.0.0.1"
"""This machine alone: what is served elsewhere is asked for."""
_LOCAL = (LOOPBACK, "localhost", "::1")
_DOOR = threading.Lock()
"""One server starts at a time, since all share what starts them."""
MOST_IN_A_MESSAGE = 2**20
"""Bytes: the page sends files in pieces of half of it, and nothing else is as large."""


def serve(host: str, port: int) -> tuple[viser.ViserServer, str]:
    """Return a running server and its address; a port that is taken gives way to the next one.

    Where more than this machine is served, the address has a token, without which nobody gets in.

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
    token = "" if host in _LOCAL else secrets.token_urlsafe()
    with _DOOR, guarded(host, token), contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=host, port=port, label="noslip", verbose=False)
    place = f"http://{f'[{host}]' if ':' in host else host}:{server.get_port()}"
    return server, f"{place}/?token={token}" if token else place


@contextlib.contextmanager
def guarded(host: str, token: str = "") -> Iterator[None]:
    """Have servers that start meanwhile refuse strangers, and pages of other sites.

    What a browser opens names its site (Origin), which must be the address that it was sent to
    (Host); and where only this machine is served, that must be a name of it, lest another site's
    name be turned to this address.  A token, if there is one, must be in the address or in the
    cookie that is set where it was, since viser's page connects without what follows its address.
    viser has no option for any of it.  Its page is served as :mod:`noslip.viewer.shell` amends it.
    """
    serve = websockets.asyncio.server.serve

    def guarding(*args: Any, process_request: Any, **options: Any) -> Any:
        def process(connection: Any, request: Any) -> Any:
            headers = request.headers
            # A browser sends a cookie to all ports of a machine: others have their own name.
            port = connection.local_address[1]
            given = _tokens(request.path, headers.get_all("Cookie"), f"noslip-{port}")
            if not (
                allowed(host, headers.get_all("Host"), headers.get_all("Origin"))
                and (not token or any(hmac.compare_digest(token.encode(), t) for t in given))
            ):
                return connection.respond(HTTPStatus.FORBIDDEN, "noslip: not from this page\n")
            response = process_request(connection, request)
            if response is not None and response.headers.get("Content-Type", "").startswith(
                "text/html"
            ):
                encoding = response.headers.get("Content-Encoding")
                response.body = amended_response(response.body, encoding)
                # Set, a header would be there twice.
                del response.headers["Content-Length"]
                response.headers["Content-Length"] = str(len(response.body))
            if token and response is not None:
                response.headers["Referrer-Policy"] = "no-referrer"
                response.headers["Set-Cookie"] = (
                    f"noslip-{port}={token}; Path=/; HttpOnly; SameSite=Strict"
                )
            return response

        options["max_size"] = MOST_IN_A_MESSAGE
        return serve(*args, process_request=process, **options)

    websockets.asyncio.server.serve = guarding  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]


def _tokens(path: str, cookies: Sequence[str], name: str) -> list[bytes]:
    """Return the tokens in an address, and those in the cookies of a name."""
    kept = [pair.strip().partition("=") for cookie in cookies for pair in cookie.split(";")]
    found = parse_qs(path.partition("?")[2]).get("token", [])
    found += [value for key, _, value in kept if key == name]
    return [token.encode(errors="replace") for token in found]


def allowed(host: str, hosts: Sequence[str], origins: Sequence[str]) -> bool:
    """Whether a request was sent to this server, and by its own page or by no page at all."""
    if len(hosts) != 1 or any(urlsplit(o).netloc.lower() != hosts[0].lower() for o in origins):
        return False
    return host not in _LOCAL or urlsplit(f"//{hosts[0]}").hostname in _LOCAL


def stop(server: viser.ViserServer) -> None:
    """Stop a server and its threads."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()
