"""Where each number of a step stands: the one table for Python, expression graph and C.

``noslip.h`` and the offsets in ``noslip.c`` are written from it (:mod:`noslip.codegen.c99`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from noslip._typing import Floats


class Layout:
    """Names for the parts of a row of numbers, in order.

    Parameters
    ----------
    **widths : int
        How many numbers each part has.

    Attributes
    ----------
    size : int
        Of the row.
    """

    def __init__(self, **widths: int) -> None:
        self._parts: dict[str, slice] = {}
        self.size = 0
        for name, width in widths.items():
            self._parts[name] = slice(self.size, self.size + width)
            self.size += width

    def __getitem__(self, name: str) -> slice:
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def width(self, name: str) -> int:
        """How many numbers a part has."""
        return self[name].stop - self[name].start  # type: ignore[no-any-return]

    def index(self, name: str) -> int:
        """Where a part begins: its place, if it is a single number."""
        return self[name].start  # type: ignore[no-any-return]

    def span(self, first: str, last: str) -> slice:
        """All from one part up to another one, both included."""
        return slice(self[first].start, self[last].stop)

    def views(self, rows: Floats) -> dict[str, Floats]:
        """Return views of the parts of rows, shape (N, size); single numbers as (N,)."""
        return {
            name: rows[:, part.start] if part.stop == part.start + 1 else rows[:, part]
            for name, part in self._parts.items()
        }


STATE = Layout(position=3, quaternion=4, linear_velocity=3, angular_velocity=3)
"""What moves: a point of the space (a pose; quaternion w first) and its velocity."""
POINT, VELOCITY = (
    STATE.span("position", "quaternion"),
    STATE.span("linear_velocity", "angular_velocity"),
)
"""The two halves of it."""
FORCE = Layout(linear=3, angular=3)
"""A velocity, acceleration, force or learned weight; also its world-frame axes."""
DRIVE = Layout(linear=3, angular=3, drawn=1)
"""What drives a step by the phase alone: the learned force over ``alpha beta``, and how a new goal
draws (:mod:`noslip.law.entry`)."""
STEP = Layout(
    time_step=1,
    kick=1,
    previous_step=1,
    time=1,
    residual_rate=1,
    slip_rate=1,
    barrier_rate=1,
    decay=1,
    gain=1,
    position_target=3,
    rotation_goal=4,
    rotation_offset=3,
)
"""What depends on the phase alone in one step; see :class:`noslip.law.step.StepSymbols`."""
CLOCK = STEP.span("time_step", "gain")
"""The part of it that is alike in all spaces."""
BEGINNING = Layout(
    goal_position=3,
    goal_quaternion=4,
    first_goal_position=3,
    first_goal_quaternion=4,
    duration=1,
    pull_in=1,
)
"""What one motion of many has of its own, besides where it starts."""


def carried_layout(rows: int) -> Layout:
    """What a step of so many constraint rows carries: the state, and its residuals and margins."""
    return Layout(**{name: STATE.width(name) for name in STATE}, values=rows)


def output_layout(rows: int) -> Layout:
    """What it returns besides."""
    return Layout(force=FORCE.size, multipliers=rows, yielding=rows, parts=FORCE.size * rows)


@dataclass(frozen=True)
class Field:
    """A field of a struct in C.

    Attributes
    ----------
    name : str
    shape : tuple of int
        Empty for a single number.
    comment : str
        Its unit or meaning.
    kind : "real", "int", "array"
        An array of any length stands behind a pointer, its rows of the given shape.
    """

    name: str
    shape: tuple[int, ...] = ()
    comment: str = ""
    kind: Literal["real", "int", "array"] = "real"

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return int(np.prod(self.shape, dtype=int))


PRIMITIVE = (
    Field("basis_functions", kind="int"),
    Field("centers", kind="array", comment="in phase"),
    Field("widths", kind="array", comment="standard deviations, in phase"),
    Field("weights", (FORCE.size,), "over alpha beta: what they add to the goals", kind="array"),
    Field("alpha"),
    Field("beta"),
    Field("alpha_s"),
    Field("knots", comment="of the winding; 1: the goal is fixed", kind="int"),
    Field("knot_quaternions", (4,), kind="array"),
    Field(
        "knot_splines",
        (12,),
        "of each interval: rotation vector, cubic first",
        kind="array",
    ),
    Field("steps", comment="of its own motion", kind="int"),
    Field("duration", comment="s"),
    Field("residual_rate", comment="per duration"),
    Field("barrier_rate", comment="per duration"),
    Field("begin", comment="time at the start, s"),
    Field("start_position", (3,)),
    Field("start_quaternion", (4,)),
    Field("start_linear_velocity", (3,)),
    Field("start_angular_velocity", (3,)),
    Field("goal_position", (3,)),
    Field("goal_quaternion", (4,)),
)
"""``noslip_primitive``: parameters of a primitive."""


def memory_fields(rows: int) -> tuple[Field, ...]:
    """``noslip_state`` of so many constraint rows: all that a primitive in motion knows."""
    # C knows no empty arrays.
    rows = max(1, rows)
    return (
        Field("time", comment="s"),
        Field("fraction", comment="of the motion: 0 at the start, 1 at the end"),
        *(Field(name, (STATE.width(name),)) for name in STATE),
        Field("previous_step", comment="s; 0 at the start"),
        Field("duration", comment="s"),
        Field("pull_in", comment="1/s"),
        Field("braking", comment="s, to come to rest in after the end; 0: at once"),
        Field("goal_position", (3,)),
        Field("goal_quaternion", (4,)),
        Field(
            "first_goal_position",
            (3,),
            "from where the goal moves; the goal itself: as in the paper",
        ),
        Field("first_goal_quaternion", (4,)),
        Field("acceleration", (FORCE.size,), "of the last step, m/s^2 and rad/s^2"),
        Field("force", (FORCE.size,), "the constraints' part of it"),
        Field("values", (rows,), "residuals, then margins"),
        Field("multipliers", (rows,)),
        Field("known_fraction", comment="what drives the next step of the same length"),
        Field("known_step", comment="again; not to be written to"),
        Field("known", (2, DRIVE.size)),
        Field("known_winding", (4,)),
        Field("known_turn", (3,)),
        Field("known_lengths", (2,), "the last step and the one before, fractions"),
        Field("known_factors", (4,), "of such steps"),
    )


def memory_layout(rows: int) -> Layout:
    """``noslip_state`` as a row of numbers."""
    return Layout(**{field.name: field.size for field in memory_fields(rows)})
