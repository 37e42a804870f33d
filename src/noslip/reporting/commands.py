"""The command lines that make a primitive again."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from inspect import signature
from pathlib import Path
from typing import Any

from noslip.adapting import adapt
from noslip.constraints.declaration import Constraint, given_arguments, is_registered
from noslip.constraints.expression import Instructions
from noslip.learning import learn
from noslip.primitive import ConstrainedDMP
from noslip.provenance import Origin

OWN = "YOUR_RULES.py:NAME"
"""Stands for a constraint declared in Python: a primitive keeps it, but not where it was."""


def declaration(constraint: Constraint) -> str:
    """Return what ``--constraint`` takes for a constraint; of a user's own, what it is called."""
    if _is_own(constraint):
        return repr(constraint)
    arguments = [
        f"{name}={declaration(value) if isinstance(value, Constraint) else value!r}"
        for name, value in given_arguments(constraint).items()
    ]
    name = constraint.known_as
    return f"{name}({', '.join(arguments)})" if arguments else name


def commands(
    dmp: ConstrainedDMP, primitive: str, recordings: Sequence[str], preparation: Sequence[str] = ()
) -> list[str]:
    """Return shell commands that make a primitive again, roll it out, check it and report it.

    What they make is the same to the bit, from the same recordings; what was re-planned in the
    middle of a motion is not on the command line, and a comment says so.

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
    lines: list[list[str]] = []
    comments: list[str] = []
    last = len(dmp.history) - 1
    files = [f"{Path(primitive).stem}-{k}.json" for k in range(last)] + [primitive]
    for k, origin in enumerate(dmp.history):
        if origin.verb == "learn":
            given = _options(origin, learn)
            lines.append(["learn", *recordings, *preparation, *constraints, *given])
        elif origin.verb == "adapt":
            lines.append(["adapt", files[k - 1], *_options(origin, adapt)])
        elif origin.verb == "improve":
            comments.append("# then improved in Python: what a motion costs is no option")
            break
        else:
            time = origin.options["state"]["time"]
            comments.append(f"# then re-planned in Python from its state at {time:g} s")
            break
        lines[-1] += ["--out", files[k]]
    made = [shlex.join(["noslip", *line]) for line in lines]
    lines = [
        ["rollout", primitive, "--out", "motion.csv"],
        ["report", primitive, *recordings, *preparation, "--out", "report.html"],
    ]
    if constraints:
        lines.insert(1, ["check", "motion.csv", *constraints])
    return [*made, *comments, *(shlex.join(["noslip", *line]) for line in lines)]


def _is_own(constraint: Constraint) -> bool:
    """Whether it holds code of a user's, of which only the expression is kept."""
    if not is_registered(constraint):
        return True
    values = vars(constraint).values()
    return any(
        _is_own(value) if isinstance(value, Constraint) else isinstance(value, Instructions)
        for value in values
    )


def _options(origin: Origin, function: Callable[..., Any]) -> list[str]:
    """Options that differ from their defaults, as one word each: values may begin with a minus."""
    known = signature(function).parameters
    words = []
    for name, value in origin.options.items():
        option = f"--{name.replace('_', '-')}"
        if value == known[name].default or (value == [] and not known[name].default):
            continue
        if name == "via":
            words += [f"{option}={_via(passed)}" for passed in value]
        else:
            words.append(option if value is True else f"{option}={_text(value)}")
    return words


def _text(value: Any) -> str:
    if isinstance(value, list):
        return ",".join(map(repr, value))
    return value if isinstance(value, str) else repr(value)


def _via(passed: Any) -> str:
    """``AT:X,Y,Z``, ``AT:QW,QX,QY,QZ`` or both, of what was given in either form."""
    if isinstance(passed, dict):
        passed = [passed["at"], passed["position"], passed["rotation"]]
    at, *parts = passed
    return f"{at!r}:" + ",".join(_text(part) for part in parts if part is not None)
