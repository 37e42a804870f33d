"""Primitives and distributions from files."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any

from noslip import _arguments
from noslip.adapting import adapt, replan
from noslip.distribution import MotionDistribution
from noslip.distribution.curves import Curves
from noslip.distribution.distribution import reference_of
from noslip.distribution.stored import read as read_distribution
from noslip.document import Reader, one_of, plain, read_document
from noslip.improving import improve
from noslip.learning import learn
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
    return _primitive(read_document(path), Reader(Path(path)))


def load_distribution(path: str | Path) -> MotionDistribution:
    """Read a distribution that :meth:`~noslip.distribution.MotionDistribution.save` wrote.

    Its samples, intervals and likelihoods are the same.

    Raises
    ------
    InputError
        As :func:`load_primitive`; if the file holds a primitive alone; or if a covariance, a size
        or a name is not what it must be.
    """
    content, read = read_document(path), Reader(Path(path))
    primitive = _primitive(content, read)
    stored = read_distribution(read, content, primitive.law.space)
    reference = reference_of(primitive)
    stored["curves"] = Curves.along(reference.positions, stored["curves"])
    return MotionDistribution(primitive, reference, **stored)


def _primitive(content: dict[str, Any], read: Reader) -> ConstrainedDMP:
    law = read.law(content, "law")
    return ConstrainedDMP(
        law=law,
        rule=read.rule(content, law.space),
        demonstrated=read.law(content, "demonstrated"),
        record=tuple(read.values(LearningRecord, entry) for entry in read.parts(content, "record")),
        spread=read.spread(content, law.space),
        history=tuple(_origin(read, entry) for entry in read.parts(content, "history")),
        channels=read.channels(content),
    )


_CALLS: dict[Verb, Callable[..., Any]] = {
    "learn": learn,
    "adapt": adapt,
    "replan": replan,
    "improve": improve,
}


def _origin(read: Reader, entry: dict[str, Any]) -> Origin:
    verb: Verb = read.field(entry, "verb", partial(one_of, Verb))
    read.part(entry, "options")
    options = read.field(entry, "options", partial(_options, verb))
    # Written since there are searches.
    outcome = read.field(entry, "outcome", plain) if "outcome" in entry else {}
    return Origin(verb, options, outcome)


def _options(verb: Verb, given: Any) -> dict[str, Any]:
    """Return options that a call of this verb can have had."""
    options: dict[str, Any] = plain(given)
    known = signature(_CALLS[verb]).parameters
    if unknown := [name for name in options if name not in known]:
        raise ValueError(f"{verb} has no option {unknown[0]!r}")
    vias = options.get("via") or []
    complete = {"at", "position", "rotation"}
    if not isinstance(vias, list) or not all(
        (isinstance(via, dict) and complete <= set(via)) or (isinstance(via, list) and len(via) > 1)
        for via in vias
    ):
        raise ValueError(f"via must be a list of poses to pass, got {_arguments.short(vias)}")
    if verb == "replan":
        state = options.get("state")
        time = state.get("time") if isinstance(state, dict) else None
        _arguments.finite("the state's time", time)
    return options
