"""Files that a person drops onto the page: few at a time, none too large, read apart."""

from __future__ import annotations

import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import viser
from viser import _messages as messages
from viser.infra import ClientId

from noslip._files import scratch
from noslip.errors import InputError, NoslipError, one_line
from noslip.primitive import ConstrainedDMP
from noslip.strangers import StrangersReader
from noslip.trajectory import PoseTrajectory
from noslip.viewer.serving import MOST_IN_A_MESSAGE

MOST_BYTES = 2**25
"""Of a file: 200 000 samples as text, 200 s of a robot at 1 kHz, which are read in 2 s."""
_MOST_PARTS = 2 * MOST_BYTES // MOST_IN_A_MESSAGE
"""Of a file: the page sends half of the largest message at a time."""
MOST_WAITING = 8
"""Files on their way or not yet read: as many as a person drops at once; more fill the memory."""

Upload = tuple[PoseTrajectory | ConstrainedDMP, list[str]]
"""What was in a file, and what it draws warnings for."""


def read_upload(name: str, content: bytes, reader: StrangersReader) -> Upload:
    """Read a recording or a primitive (JSON) from its content.

    Raises
    ------
    InputError
        In one line that names the file as it was called where it came from.
    """
    # What the browser calls the file must not lead out of the folder.
    plain = re.sub(r"[^\w.+ -]", "_", re.split(r"[/\\]", name)[-1]).lstrip(".")[-100:] or "upload"
    with scratch() as folder:
        path = folder / plain
        path.write_bytes(content)
        try:
            found, warned = reader.read(path)
        except NoslipError as error:
            raise InputError(str(error).replace(f"{folder}/", "")) from None
        warned = [warning.replace(f"{folder}/", "") for warning in warned]
    return (replace(found, name=plain) if isinstance(found, PoseTrajectory) else found), warned


def _too_many(name: str) -> str:
    return one_line(f"{name}: {MOST_WAITING} files are waiting; send it when they were read")


class Uploads:
    """Files that come in by a page's button, read one after the other.

    Parameters
    ----------
    server, button
        Of the page.
    add : callable
        Called with the name of a file, and with what is in it.
    refuse : callable
        Called with the reason, one line, for which a file was not read.  Either is called once for
        each file, by another thread than the page's.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        button: viser.GuiUploadButtonHandle,
        add: Callable[[str, Upload], None],
        refuse: Callable[[str], None],
    ) -> None:
        self._add, self._refuse = add, refuse
        self._reader, self._waiting = StrangersReader(), 0
        self._thread = ThreadPoolExecutor(1, "noslip-uploads")
        self._cap(server)

        @button.on_upload
        async def _(event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
            self.take(event.target.value.name, event.target.value.content)

    def take(self, name: str, content: bytes) -> None:
        """Have a file read; what came in one burst was not yet counted when it was begun."""
        if self._waiting >= MOST_WAITING:
            self._refuse(_too_many(name))
        else:
            self._waiting += 1
            self._thread.submit(self._read, name, content)

    def stop(self) -> None:
        """Read no more, and end what is being read."""
        self._thread.shutdown(wait=False, cancel_futures=True)
        self._reader.close()

    def _read(self, name: str, content: bytes) -> None:
        try:
            found = read_upload(name, content, self._reader)
        except Exception as error:
            # Whatever a stranger's file does, it is answered, and the next one is read.
            told = isinstance(error, NoslipError)
            self._refuse(str(error) if told else one_line(f"{name}: cannot be read: {error!r}"))
        else:
            self._add(name, found)
        finally:
            self._waiting -= 1

    def _cap(self, server: viser.ViserServer) -> None:
        """Refuse what is too large, or too many, before it is sent; viser has no option for it."""
        gui, connection = server.gui, server._websock_server
        start = gui._handle_file_transfer_start

        def checked(client: ClientId, message: messages.FileTransferStartUpload) -> None:
            size, name = message.size_bytes, message.filename
            if not (0 <= size <= MOST_BYTES and 0 <= message.part_count <= _MOST_PARTS):
                told = (
                    f"{name}: {size:,} bytes, at most {MOST_BYTES:,} are read here; split it, or "
                    "check it with noslip check"
                )
            elif len(gui._current_file_upload_states) + self._waiting >= MOST_WAITING:
                told = _too_many(name)
            else:
                start(client, message)
                return
            self._refuse(one_line(told))
            # So that the page's bar of progress goes.
            connection.queue_message(
                messages.FileTransferPartAck(
                    message.source_component_uuid, message.transfer_uuid, size, size
                )
            )

        kind = messages.FileTransferStartUpload
        connection.unregister_handler(kind, start)
        connection.register_handler(kind, checked)
