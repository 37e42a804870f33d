"""Values that hold arrays: equal by content, and sent without what was built from them."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from types import MethodType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation


class Value:
    """Base of frozen dataclasses (``eq=False``) whose fields may be arrays and rotations.

    Two are equal if they are of one type and all fields are equal, number by number.  Copies and
    pickles carry the fields alone: what a cached property holds is found again when it is needed.
    """

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return self is other or all(
            is_same(getattr(self, f.name), getattr(other, f.name))
            for f in fields(self)  # type: ignore[arg-type]
        )

    def __hash__(self) -> int:
        return hash((type(self), *(_hashable(getattr(self, f.name)) for f in fields(self))))  # type: ignore[arg-type]

    def __getstate__(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)


def is_same(a: Any, b: Any) -> bool:
    """Whether two fields are equal: arrays and rotations number by number, others by ``==``."""
    if isinstance(a, Rotation) and isinstance(b, Rotation):
        return np.array_equal(a.as_quat(canonical=True), b.as_quat(canonical=True))
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.array_equal(a, b)
    return bool(a == b)


def _hashable(value: Any) -> Any:
    if isinstance(value, Rotation):
        value = value.as_quat(canonical=True)
    if isinstance(value, Mapping):
        return frozenset((key, _hashable(part)) for key, part in value.items())
    if isinstance(value, (list, tuple)):
        return tuple(map(_hashable, value))
    # -0.0 and 0.0 are equal: so must their hashes be.
    return (value.shape, (value + 0.0).tobytes()) if isinstance(value, np.ndarray) else value


class Supplied:
    """A method that a higher layer supplies: a motion can be drawn, and knows nothing of drawing.

    Parameters
    ----------
    doc : str
        What it does.
    """

    def __init__(self, doc: str) -> None:
        self.__doc__ = doc
        self.function: Callable[..., Any]

    def __get__(self, instance: Any, owner: type) -> Any:
        return self if instance is None else MethodType(self.function, instance)


def html_table(heading: str, rows: Iterable[Sequence[str]]) -> str:
    """Return a small table of texts for a notebook; what names hold is told, not run."""
    cells = (
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><caption>{html.escape(heading)}</caption>{''.join(cells)}</table>"
