"""Who gets into the viewer, and what they can do there: neither end it nor fill the machine."""

from __future__ import annotations

import http.client
import io
import os
import signal
import subprocess
import sys
import threading
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import noslip as ns
from motions import gentle_cut
from waiting import PATIENCE, until

pytest.importorskip("viser")

import msgspec
import viser
import websockets.exceptions
import websockets.sync.client
from viser import _messages as messages

from noslip import strangers
from noslip.viewer import Page, serving, uploads


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    server, _ = serving.serve(serving.LOOPBACK, 0)
    yield server.get_port()
    serving.stop(server)


def response(
    port: int, path: str = "/", *, socket: bool, **headers: str
) -> http.client.HTTPResponse:
    upgrade = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }
    connection = http.client.HTTPConnection(serving.LOOPBACK, port, timeout=PATIENCE)
    try:
        connection.request("GET", path, headers=headers | (upgrade if socket else {}))
        return connection.getresponse()
    finally:
        connection.close()


def answer(port: int, host: str, origin: str | None, *, socket: bool) -> int:
    site = {} if origin is None else {"Origin": origin.format(port)}
    return response(port, socket=socket, Host=host.format(port), **site).status


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


# ---------------------------------------------------------------- beyond this machine


@pytest.fixture(scope="module")
def open_door() -> Iterator[tuple[int, str]]:
    """Port and token of a server for everyone."""
    server, address = serving.serve("0.0.0.0", 0)
    yield server.get_port(), address.partition("?token=")[2]
    serving.stop(server)


@pytest.mark.parametrize("socket", [True, False])
@pytest.mark.parametrize(
    ("path", "cookie"),
    [
        ("/", None),
        ("/?token=", None),
        ("/?token={half}", None),
        ("/?token={token}x", None),
        ("/?token=%C3%A9%FF", None),
        ("/?Token={token}", None),
        ("/{token}", None),
        ("/", "noslip-{port}="),
        ("/", "noslip-{port}={half}"),
        ("/", "noslip-1={token}"),
        ("/", "noslip={token}"),
        ("/", "{token}"),
    ],
)
def test_who_does_not_know_the_token_stays_outside(
    open_door: tuple[int, str], path: str, cookie: str | None, socket: bool
) -> None:
    port, token = open_door
    names = {"port": port, "token": token, "half": token[: len(token) // 2]}
    kept = {} if cookie is None else {"Cookie": cookie.format(**names)}
    assert response(port, path.format(**names), socket=socket, **kept).status == 403


def test_the_address_lets_in_and_leaves_a_cookie_that_lets_in(open_door: tuple[int, str]) -> None:
    port, token = open_door
    assert len(token) >= 40
    page = response(port, f"/?token={token}&fixedDpr=1", socket=False)
    assert page.status == 200
    # No script reads it, no other site sends it, and no link tells the address.
    kept = page.headers["Set-Cookie"]
    assert {"HttpOnly", "SameSite=Strict"} <= set(kept.split("; "))
    assert page.headers["Referrer-Policy"] == "no-referrer"
    for cookie in (kept.split(";")[0], f'other={{"x": 1}}; {kept.split(";")[0]}'):
        assert response(port, socket=True, Cookie=cookie).status == 101
        assert response(port, socket=False, Cookie=cookie).status == 200
    other = {"Origin": "http://evil.example", "Cookie": kept.split(";")[0]}
    assert response(port, socket=True, **other).status == 403


def test_two_servers_have_two_tokens(open_door: tuple[int, str]) -> None:
    server, address = serving.serve("0.0.0.0", 0)
    serving.stop(server)
    assert address.partition("?token=")[2] != open_door[1]


# ---------------------------------------------------------------- files


@pytest.fixture
def page() -> Iterator[Page]:
    page = Page({"cut.csv": gentle_cut()}, constraints=[ns.Blade()], port=0)
    yield page
    page.stop()


def told(page: Page, name: str, content: bytes) -> str:
    """Hand a file to the page, and return what it says of it."""
    page._upload_note.content = ""
    page.uploads.take(name, content)
    return answered(page)


def answered(page: Page) -> str:
    until(lambda: page._upload_note.content, "an answer")
    over = threading.Event()
    page.post("over", over.set)
    assert over.wait(PATIENCE)
    return page._upload_note.content


GOOD = gentle_cut().csv_text().encode()


def survives(page: Page) -> None:
    assert list(page.entries) == ["cut.csv"]
    assert "blade" in told(page, "good.csv", GOOD)
    assert list(page.entries) == ["cut.csv", "good.csv"] and page.chosen == "good.csv"


def npz_of(shape: str) -> bytes:
    """An npz whose arrays claim to be large, and are zeros that compress to little."""
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    array = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode()
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("times", "positions", "quaternions"):
            archive.writestr(f"{name}.npy", array + bytes(2**24))
    return content.getvalue()


SENT = [
    ("bomb.npz", npz_of("(9, 10000000000)")),
    ("deep.json", b"[" * 100_000),
    ("wide.csv", b"t," + b"x," * 200_000 + b"\n" + b"1," * 200_001),
    ("nul.csv", bytes(1_000_000)),
    ("empty.csv", b""),
    ("text.json", "\ufeff\u202e".encode()),
    ("x" * 5000 + ".csv", b"t"),
    ("..", b"t"),
    ("a\x1b[2Jb\n.csv", b"t"),
    ("\ud800.csv", b"t"),
]


def test_what_strangers_send_is_answered_in_a_line(
    page: Page, trials: Callable[[int], None]
) -> None:
    """One page gets all of it, and is none the worse."""
    trials(len(SENT))
    for name, content in SENT:
        found = told(page, name, content)
        assert "<br>" not in found and found.isprintable() and len(found) < 3000, name
        assert list(page.entries) == ["cut.csv"], name
    survives(page)


@pytest.fixture
def child(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Have files read by a process that does as bid; return the file that it has its id in."""
    (tmp_path / "badly.py").write_text(
        """
import os, pathlib, signal, sys, time
import noslip.strangers as strangers

def badly(path):
    (pathlib.Path(__file__).parent / "id").write_text(str(os.getpid()))
    what = path.read_text()
    while what == "spin":
        pass
    if what == "sleep":
        time.sleep(3600)
    if what == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "memory":
        bytearray(strangers.MEMORY)
    if what == "disk":
        with path.open("wb") as file:
            for _ in range(1000):
                file.write(bytes(2**20))
    if what == "fault":
        raise LookupError("of our own making\\n\\x1b[2J")
    if what == "exit":
        raise SystemExit(0)
    if what == "nothing":
        os._exit(0)
    if what == "garbage":
        (path.parent / "x").touch()
        pathlib.Path(sys.argv[2]).write_bytes(b"garbage")
        os._exit(0)

if __name__ == "__main__":
    strangers.load_demonstrations = badly
    os._exit(strangers._main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])))
"""
    )
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    )
    monkeypatch.setattr(strangers, "__name__", "badly")
    return tmp_path / "id"


FAILS = {
    "killed": "its reader ended",
    "memory": "needs more than 3 GiB",
    "disk": "cannot be read: OSError",
    "fault": "LookupError: of our own making",
    "exit": "its reader ended",
    "nothing": "its reader ended",
}
"""What a reader does, and what is told of it."""


def test_a_reader_that_fails_is_told_in_a_line(
    page: Page, child: Path, monkeypatch: pytest.MonkeyPatch, trials: Callable[[int], None]
) -> None:
    trials(len(FAILS))
    for what, expected in FAILS.items():
        found = told(page, "what.csv", what.encode())
        assert expected in found and "what.csv" in found, what
        assert "<br>" not in found and found.isprintable(), what
        assert list(page.entries) == ["cut.csv"], what
    monkeypatch.setattr(strangers, "__name__", "noslip.strangers")
    survives(page)


@pytest.mark.parametrize("what", ["spin", "sleep"])
def test_a_reader_that_never_ends_is_ended(
    page: Page, child: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    # In which an idle machine starts it three times.
    monkeypatch.setattr(strangers, "SECONDS", 3)
    assert "takes more than 3 s" in told(page, "what.csv", what.encode())
    if child.is_file():
        assert not Path(f"/proc/{child.read_text()}").exists()
    monkeypatch.undo()
    survives(page)


def lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    # Who died and was not waited for is no orphan.
    state = Path(f"/proc/{process}/stat")
    return not state.exists() or state.read_text().rpartition(")")[2].split()[0] != "Z"


def test_leaving_the_page_ends_what_is_being_read(page: Page, child: Path) -> None:
    page.uploads.take("what.csv", b"sleep")
    until(lambda: child.is_file() and child.read_text(), "the reader")
    page.stop()
    until(lambda: not lives(int(child.read_text())), "its end")


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_no_reader_outlives_its_page(child: Path, tmp_path: Path, how: signal.Signals) -> None:
    (tmp_path / "what.csv").write_text("sleep")
    code = (
        "import sys, pathlib, noslip.strangers as s; s.__name__ = 'badly'\n"
        "s.StrangersReader().read(pathlib.Path(sys.argv[1]))"
    )
    parent = subprocess.Popen([sys.executable, "-c", code, tmp_path / "what.csv"])
    until(lambda: child.is_file() and child.read_text(), "the reader")
    assert lives(int(child.read_text()))
    parent.send_signal(how)
    parent.wait(PATIENCE)
    until(lambda: not lives(int(child.read_text())), "its end")


def test_a_file_is_read_without_a_compiler(page: Page, tmp_path: Path) -> None:
    dmp = ns.learn(gentle_cut(), [ns.Blade()], basis_functions=5)
    assert "HOLDS" in told(page, "good.json", dmp.save(tmp_path / "good.json").read_bytes())
    assert page.entry.primitive is not None
    assert page.entry.primitive.law == dmp.law


# ---------------------------------------------------------------- what is sent


class Client:
    """Speaks to a page over a socket of its own, as the page's script does."""

    def __init__(self, page: Page) -> None:
        self.socket = websockets.sync.client.connect(
            page.address.replace("http", "ws"),
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
            max_size=None,
        )
        (self.button,) = (
            key
            for key, handle in page.server.gui._gui_input_handle_from_uuid.items()
            if isinstance(handle, viser.GuiUploadButtonHandle)
        )
        # Only who has said where it looks from is a client.
        self.send(
            messages.ViewerCameraMessage(
                wxyz=(1, 0, 0, 0),
                position=(1, 0, 0),
                fov=1,
                near=0.1,
                far=10,
                image_height=100,
                image_width=100,
                look_at=(0, 0, 0),
                up_direction=(0, 0, 1),
            )
        )
        until(page.server.get_clients, "the client")

    def coded(self, message: messages.Message) -> bytes:
        return msgspec.msgpack.encode({"type": type(message).__name__} | vars(message))

    def send(self, message: messages.Message) -> None:
        self.socket.send(self.coded(message))

    def begin(self, name: str, size: int, parts: int, transfer: str = "1") -> None:
        self.send(
            messages.FileTransferStartUpload(self.button, transfer, name, "text/csv", parts, size)
        )

    def part(self, content: bytes, index: int = 0, transfer: str = "1") -> None:
        self.send(messages.FileTransferPart(self.button, transfer, index, content))


@pytest.fixture
def client(page: Page) -> Iterator[Client]:
    client = Client(page)
    yield client
    client.socket.close()


def under_way(page: Page) -> int:
    return len(page.server.gui._current_file_upload_states)


def test_a_file_arrives_in_parts(page: Page, client: Client) -> None:
    half = len(GOOD) // 2
    client.begin("good.csv", len(GOOD), 2)
    client.part(GOOD[:half], 0)
    client.part(GOOD[half:], 1)
    assert "blade" in answered(page)
    assert list(page.entries) == ["cut.csv", "good.csv"] and not under_way(page)


def test_a_file_of_the_largest_size_is_begun(page: Page, client: Client) -> None:
    client.begin("large.csv", uploads.MOST_BYTES, 2 * uploads.MOST_BYTES // 2**20)
    until(lambda: under_way(page), "it to begin")
    assert not page._upload_note.content


TOO_LARGE = [
    (uploads.MOST_BYTES + 1, 1),
    (2**63, 1),
    (-1, 1),
    (10, 2 * uploads.MOST_BYTES // 2**20 + 1),
    (10, 10**9),
    (10, -1),
]
"""Bytes of a file, and in how many parts they are said to come."""


def test_too_large_a_file_is_refused_before_it_is_sent(
    page: Page, client: Client, trials: Callable[[int], None]
) -> None:
    trials(len(TOO_LARGE))
    for size, parts in TOO_LARGE:
        page._upload_note.content = ""
        client.begin("large.csv", size, parts)
        found = answered(page)
        assert "large.csv: " in found and "at most 33,554,432 are read" in found, (size, parts)
        # What is sent all the same is kept nowhere.
        client.part(bytes(2**19))
    page._upload_note.content = ""
    client.begin("good.csv", len(GOOD), 1, "2")
    client.part(GOOD, 0, "2")
    assert "blade" in answered(page) and not under_way(page)
    assert list(page.entries) == ["cut.csv", "good.csv"]


def test_files_that_are_begun_and_never_sent_are_few(page: Page, client: Client) -> None:
    for k in range(8):
        client.begin("half.csv", 10, 1, str(k))
    client.begin("one more.csv", 10, 1, "more")
    assert "one more.csv: 8 files are waiting" in answered(page) and under_way(page) == 8
    # Who leaves takes them along, and makes room for others.
    client.socket.close()
    until(lambda: not under_way(page), "them to be dropped")
    survives(page)


def test_files_that_wait_to_be_read_are_few(page: Page, client: Client, child: Path) -> None:
    # In one burst, of which nothing is counted before all of it is there.
    for k in range(9):
        client.begin(f"{k}.csv", 5, 1, str(k))
        client.part(b"sleep", 0, str(k))
    assert "8.csv: 8 files are waiting" in answered(page)
    assert not under_way(page) and list(page.entries) == ["cut.csv"]


@pytest.mark.parametrize("more", [0, 1])
def test_a_message_that_is_too_large_ends_its_own_connection_alone(
    page: Page, client: Client, more: int
) -> None:
    empty = client.coded(messages.FileTransferPart(client.button, "1", 0, bytes(2**16)))
    content = bytes(2**20 + more - len(empty) + 2**16)
    other = Client(page)
    client.part(content)
    if more:
        with pytest.raises(websockets.exceptions.ConnectionClosedError, match="1009"):
            while True:
                client.socket.recv(PATIENCE)
        client = other
    client.begin("large.csv", -1, 1)
    assert "large.csv" in answered(page)
    other.socket.close()
    survives(page)


# ---------------------------------------------------------------- drawing


UNDRAWN = [
    "drawing._add_lines",
    "drawing.add_parts",
    "drawing.server.scene.add_arrows",
    "drawing.put",
    "pushes.choose",
    "goals.choose",
    "_describe",
]
"""What may fail of a page as a motion is drawn."""


def test_a_motion_that_cannot_be_drawn_leaves_no_trace(
    page: Page, monkeypatch: pytest.MonkeyPatch, trials: Callable[[int], None]
) -> None:
    trials(len(UNDRAWN))
    longer = gentle_cut()
    slipping = ns.PoseTrajectory(2 * longer.times, longer.positions, longer.rotations[::-1])
    scene = page.server.scene._handle_from_node_name
    before = set(scene), page._legend.content, page._slider.max, page._worst
    for where in UNDRAWN:
        *path, name = where.split(".")
        holder: object = page
        for part in path:
            holder = getattr(holder, part)
        works = getattr(holder, name)

        def fails(
            *arguments: object, works: Callable[..., object] = works, **options: object
        ) -> object:
            if len(page.entries) > 1:
                raise RuntimeError("of our own making")
            return works(*arguments, **options)

        with monkeypatch.context() as patch:
            patch.setattr(holder, name, fails)
            found = told(page, "bad.csv", slipping.csv_text().encode())
        assert "bad.csv: cannot be shown: of our own making" in found, where
        after = set(scene), page._legend.content, page._slider.max, page._worst
        assert after == before, where
        assert page._choice.options == ("cut.csv",) and page._choice.value == "cut.csv", where
        assert set(page.drawing._nodes) == set(page.drawing._tracks) == {"cut.csv"}, where
    survives(page)
