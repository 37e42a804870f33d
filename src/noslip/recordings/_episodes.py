"""Which of a data set's episodes to read."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from noslip.errors import RecordingError


def chosen_episodes(
    path: Path, episode: int | Iterable[int] | None, available: list[int]
) -> list[int]:
    """Return the episodes asked for, or all; refuse what is not there."""
    if episode is None:
        return available
    asked = list(dict.fromkeys(episode if isinstance(episode, Iterable) else [episode]))
    missing = [number for number in asked if number not in set(available)]
    if missing:
        held = f"{min(available)} to {max(available)}" if available else "none"
        raise RecordingError(
            f"{path}: no episode {missing[0]}; there are {len(available)} episodes, {held}"
        )
    return asked
