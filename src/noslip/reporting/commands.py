"""The command lines that make a primitive again."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Sequence
from typing import Literal

from noslip.constraints.declaration import Constraint, described, is_registered
from noslip.constraints.expression import Instructions
from noslip.edge import Edge
from noslip.primitive import ConstrainedDMP
from noslip.projection.metric import inverse_metric
from noslip.projection.request import LEARNING
from noslip.rule import BARRIER_RATE

BASIS_FUNCTIONS = 100
"""Of ``noslip learn``, unless said otherwise."""
OWN = "YOUR_RULES.py:NAME"
"""Stands for a constraint declared in Python: a primitive keeps it, but not where it was."""


def declaration(constraint: Constraint) -> str:
    """Return what ``--constraint`` takes for a constraint; of a user's own, what it is called."""
    if _is_own(constraint):
        return described(constraint)
    # What a constraint is about comes first, what all limits share last.
    fields = sorted(dataclasses.fields(constraint), key=lambda f: bool(f.kw_only))  # type: ignore[arg-type]
    arguments = []
    for field in fields:
        value = getattr(constraint, field.name)
        factory = field.default_factory
        default = field.default if factory is dataclasses.MISSING else factory()
        if isinstance(value, Edge):
            value = value.travel
        if value != default:
            text = declaration(value) if isinstance(value, Constraint) else value
            arguments.append(f"{field.name}={text!r}")
    name = type(constraint).name
    return f"{name}({', '.join(arguments)})" if arguments else name


def commands(
    dmp: ConstrainedDMP, primitive: str, recordings: Sequence[str], preparation: Sequence[str] = ()
) -> list[str]:
    """Return shell commands that learn a primitive again, roll it out, check it and report it.

    Parameters
    ----------
    dmp : ConstrainedDMP
    primitive : str
        Its file.
    recordings : sequence of str
    preparation : sequence of str
        Options of ``noslip learn`` that prepare the recordings.
    """
    constraints = [
        word
        for constraint in dmp.constraints
        for word in ("--constraint", OWN if _is_own(constraint) else declaration(constraint))
    ]
    learned = ["learn", *recordings, *preparation, *constraints, *_settings(dmp)]
    report = ["report", primitive, *recordings]
    lines = [
        [*learned, "--out", primitive],
        ["rollout", primitive, "--out", "motion.csv"],
        [*report, *preparation, "--out", "report.html"],
    ]
    if constraints:
        lines.insert(2, ["check", "motion.csv", *constraints])
    return [shlex.join(["noslip", *line]) for line in lines]


def _is_own(constraint: Constraint) -> bool:
    """Whether it holds code of a user's, of which only the expression is kept."""
    if not is_registered(constraint):
        return True
    values = vars(constraint).values()
    return any(
        _is_own(value) if isinstance(value, Constraint) else isinstance(value, Instructions)
        for value in values
    )


def _settings(dmp: ConstrainedDMP) -> list[str]:
    """Options of ``noslip learn`` that are not its own."""
    options = []
    count = dmp.law.basis.count
    if count != BASIS_FUNCTIONS:
        options += ["--basis-functions", str(count)]
    moved = any(record.position_change for record in dmp.record)
    if not moved and any(record.rotation_change for record in dmp.record):
        options += ["--hold-position"]
    smoothing = min(
        (record.smoothing for record in dmp.record), default=LEARNING.rotation_smoothing
    )
    if smoothing != LEARNING.rotation_smoothing:
        options += ["--smoothing", repr(smoothing)]
    options += _metric(dmp)
    if dmp.rule.barrier_rate != BARRIER_RATE:
        options += ["--barrier-rate", repr(dmp.rule.barrier_rate)]
    return options


def _metric(dmp: ConstrainedDMP) -> list[str]:
    length = dmp.rule.inverse_metric[3] ** -0.5 if dmp.rule.inverse_metric[3] else 1.0
    names: tuple[Literal["auto", "position", "shared"], ...] = ("auto", "position", "shared")
    for name in names:
        if _same(inverse_metric(dmp.system, name, length, length), dmp.rule.inverse_metric):
            option = [] if name == "auto" else ["--metric", name]
            return (
                [*option, "--metric-length", repr(length)] if dmp.rule.inverse_metric[3] else option
            )
    weights = ",".join(repr(1 / weight) if weight else "inf" for weight in dmp.rule.inverse_metric)
    return ["--metric", weights, "--metric-length", "1"]


def _same(a: Sequence[float], b: Sequence[float]) -> bool:
    return all(abs(x - y) <= 1e-9 * max(abs(x), abs(y)) for x, y in zip(a, b, strict=True))
