"""Primitives from files."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

from noslip.document import Reader, read_document
from noslip.primitive import ConstrainedDMP
from noslip.provenance import LearningRecord, Origin, Verb


def load_primitive(path: str | Path) -> ConstrainedDMP:
    """Read a primitive that :meth:`ConstrainedDMP.save` wrote; its motion is the same to the bit.

    Raises
    ------
    InputError
        If the file is missing, is not a noslip primitive, was written by another version, was
        changed since, or lacks a field; the message names the file and the field.
    """
    content, read = read_document(path), Reader(Path(path))
    return ConstrainedDMP(
        law=read.law(content, "law"),
        rule=read.rule(content),
        demonstrated=read.law(content, "demonstrated"),
        record=tuple(_record(read, entry) for entry in read.parts(content, "record")),
        spread=read.spread(content),
        history=tuple(_origin(read, entry) for entry in read.parts(content, "history")),
    )


def _record(read: Reader, entry: dict[str, Any]) -> LearningRecord:
    values = {f.name: read.field(entry, f.name, lambda x: x) for f in fields(LearningRecord)}
    return LearningRecord(**values | {"left_out": read.field(entry, "left_out", tuple)})


def _origin(read: Reader, entry: dict[str, Any]) -> Origin:
    verb = read.field(entry, "verb", _verb)
    return Origin(verb, read.part(entry, "options"))


def _verb(value: Any) -> Verb:
    if value not in get_args(Verb):
        raise ValueError(f"one of {', '.join(get_args(Verb))} was expected, got {value!r}")
    return value  # type: ignore[no-any-return]
