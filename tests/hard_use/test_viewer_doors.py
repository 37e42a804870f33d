"""Who gets into the viewer: its own page, and no page of another site."""

from __future__ import annotations

import http.client
from collections.abc import Iterator

import pytest

pytest.importorskip("viser")

from noslip.viewer import serving


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    server = serving.serve(serving.LOOPBACK, 0)
    yield server.get_port()
    serving.stop(server)


def answer(port: int, host: str, origin: str | None, *, socket: bool) -> int:
    upgrade = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }
    headers = {"Host": host.format(port), **(upgrade if socket else {})}
    if origin is not None:
        headers["Origin"] = origin.format(port)
    connection = http.client.HTTPConnection(serving.LOOPBACK, port, timeout=60)
    try:
        connection.request("GET", "/", headers=headers)
        return connection.getresponse().status
    finally:
        connection.close()


@pytest.mark.parametrize("socket", [True, False])
@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("127.0.0.1:{}", "http://evil.example"),
        ("127.0.0.1:{}", "http://127.0.0.1:1"),
        ("127.0.0.1:{}", "null"),
        ("evil.example:{}", "http://evil.example:{}"),
        ("evil.example", None),
    ],
)
def test_pages_of_other_sites_are_refused(port: int, host: str, origin: str, socket: bool) -> None:
    assert answer(port, host, origin, socket=socket) == 403


@pytest.mark.parametrize("name", ["127.0.0.1:{}", "localhost:{}"])
def test_its_own_page_is_let_in(port: int, name: str) -> None:
    assert answer(port, name, None, socket=False) == 200
    assert answer(port, name, f"http://{name}", socket=True) == 101
