"""Files that a person drops onto the page."""

from __future__ import annotations

import re
from dataclasses import replace

from noslip._files import scratch
from noslip.errors import InputError, NoslipError
from noslip.primitive import ConstrainedDMP
from noslip.recordings import load_demonstrations
from noslip.saving import load_primitive
from noslip.trajectory import PoseTrajectory


def read_upload(name: str, content: bytes) -> PoseTrajectory | ConstrainedDMP:
    """Read a recording (CSV, npz) or a primitive (JSON) from its content.

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
            if path.suffix.lower() == ".json":
                return load_primitive(path)
            (recording,) = load_demonstrations(path)
        except NoslipError as error:
            raise InputError(str(error).replace(f"{folder}/", "")) from None
    return replace(recording, name=plain)
