"""Values that hold arrays: equal by content, and sent without what was built from them."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, fields
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation


def with_unit(number: str, unit: str) -> str:
    """Return a number with its unit, unless that is 1."""
    return number if unit == "1" else f"{number} {unit}"


class Value:
    """Base of frozen dataclasses (``eq=False``) whose fields may be arrays and rotations.

    Two are equal if they are of one type and all fields are equal, number by number.  Copies and
    pickles carry the fields alone: what a cached property holds is found again when it is needed.
    Their repr is one short line, without what fields have by default.
    """

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        keep_repr(cls)

    def __repr__(self) -> str:
        return short_repr(self)

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


LONGEST_REPR = 118
"""A line of a terminal or a log."""


def keep_repr(cls: type) -> None:
    """Make a class's repr its own: a dataclass then writes no other."""
    cls.__repr__ = cls.__repr__  # type: ignore[method-assign]


def short_repr(value: Any) -> str:
    """Return a dataclass's type and fields in one line; of large arrays the shape."""
    given = {
        f.name: getattr(value, f.name) for f in fields(value) if f.repr and _is_given(value, f)
    }
    return call_text(type(value).__name__, given)


def call_text(name: str, arguments: Mapping[str, Any]) -> str:
    """Return a call in one line, its last arguments left out where it grows too long."""
    texts = [f"{key}={_short(value)}" for key, value in arguments.items()]
    line = f"{name}({', '.join(texts)})"
    while len(line) > LONGEST_REPR and texts:
        texts.pop()
        line = f"{name}({', '.join([*texts, '...'])})"
    return line


def _is_given(value: Any, f: Field[Any]) -> bool:
    default = f.default if f.default_factory is MISSING else f.default_factory()
    return default is MISSING or not is_same(getattr(value, f.name), default)


def _short(value: Any) -> str:
    if isinstance(value, Rotation):
        turn = value.as_rotvec(degrees=True)
        return f"Rotation({_short(turn)}°)" if turn.ndim == 1 else f"{len(turn)} rotations"
    if isinstance(value, np.ndarray):
        if value.ndim != 1 or value.size > 7:
            return f"array{value.shape}"
        # Not -0.
        return f"({', '.join(f'{number:.4g}' for number in np.round(value, 12) + 0.0)})"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (tuple, list)) and value and all(isinstance(v, float) for v in value):
        return _short(np.array(value))
    if isinstance(value, (tuple, list, Mapping)) and len(value) > 3:
        return f"<{len(value)}>"
    return str(value) if isinstance(value, np.generic) else shortened(repr(value))


def shortened(text: str, longest: int = 80) -> str:
    """Return a text, its middle left out where it is long; what matters of paths is at the ends."""
    half = longest // 2
    return text if len(text) <= longest else f"{text[: half - 3]}...{text[-half:]}"


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


def html_table(heading: str, rows: Iterable[Sequence[str]]) -> str:
    """Return a small table of texts for a notebook; what names hold is told, not run."""
    cells = (
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><caption>{html.escape(heading)}</caption>{''.join(cells)}</table>"
