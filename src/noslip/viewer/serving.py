"""Starting and stopping viser's server, without its messages on standard output."""

from __future__ import annotations

import contextlib
import io
import socket

import viser

from noslip.errors import InputError

LOOPBACK = "127.0.0.1"
"""This machine alone: what is served elsewhere is asked for."""


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
    with contextlib.redirect_stdout(io.StringIO()):
        return viser.ViserServer(host=host, port=port, label="noslip", verbose=False)


def stop(server: viser.ViserServer) -> None:
    """Stop a server and its threads."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()
