"""Where each number of a step stands: the one table for Python, expression graph and C.

``noslip.h`` and the offsets in ``noslip.c`` are written from it (:mod:`noslip.codegen.c99`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from noslip.space import POSE, Space


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
        """How many numbers it has; one of none stands in no struct."""
        return int(np.prod(self.shape, dtype=int))


class Layouts:
    """Where each number of a step stands, in a space.

    Parameters
    ----------
    space : Space

    Attributes
    ----------
    state : Layout
        What moves: a point of the space (coordinates, then quaternions, w first) and its velocity.
    point, velocity : slice
        The two halves of it.
    force : Layout
        A velocity, acceleration, force or learned weight.
    drive : Layout
        What drives a step by the phase alone: the learned force over ``alpha beta``, and how a new
        goal draws (:mod:`noslip.law.entry`).
    step : Layout
        What depends on the phase alone in one step; see :class:`noslip.law.step.StepSymbols`.
    beginning : Layout
        What one motion of many has of its own, besides where it starts.
    """

    def __init__(self, space: Space) -> None:
        n, b = space.linear, space.rotations
        self.space = space
        self.state = Layout(position=n, quaternion=4 * b, linear_velocity=n, angular_velocity=3 * b)
        self.point = self.state.span("position", "quaternion")
        self.velocity = self.state.span("linear_velocity", "angular_velocity")
        self.force = Layout(linear=n, angular=3 * b)
        self.drive = Layout(linear=n, angular=3 * b, drawn=1)
        self.step = Layout(
            time_step=1,
            kick=1,
            previous_step=1,
            time=1,
            residual_rate=1,
            slip_rate=1,
            barrier_rate=1,
            decay=1,
            gain=1,
            position_target=n,
            rotation_goal=4 * b,
            rotation_offset=3 * b,
        )
        self.beginning = Layout(
            goal_position=n,
            goal_quaternion=4 * b,
            first_goal_position=n,
            first_goal_quaternion=4 * b,
            duration=1,
            pull_in=1,
        )

    def carried(self, rows: int) -> Layout:
        """What a step of so many constraint rows carries: state, and its residuals and margins."""
        return Layout(**{name: self.state.width(name) for name in self.state}, values=rows)

    def output(self, rows: int) -> Layout:
        """What it returns besides."""
        size = self.force.size
        return Layout(force=size, multipliers=rows, yielding=rows, parts=size * rows)

    @property
    def primitive(self) -> tuple[Field, ...]:
        """``noslip_primitive``: parameters of a primitive."""
        n, b = self.space.linear, self.space.rotations
        return (
            Field("basis_functions", kind="int"),
            Field("centers", kind="array", comment="in phase"),
            Field("widths", kind="array", comment="standard deviations, in phase"),
            Field(
                "weights",
                (self.force.size,),
                "over alpha beta: what they add to the goals",
                kind="array",
            ),
            Field("alpha"),
            Field("beta"),
            Field("alpha_s", comment="0: a cycle"),
            Field("knots", comment="of the winding; 1: the goal is fixed", kind="int"),
            Field("knot_quaternions", (4 * b,), kind="array"),
            Field(
                "knot_splines",
                (12 * b,),
                "of each interval: rotation vector, cubic first",
                kind="array",
            ),
            Field("steps", comment="of its own motion", kind="int"),
            Field("duration", comment="s"),
            Field("residual_rate", comment="per duration"),
            Field("barrier_rate", comment="per duration"),
            Field("begin", comment="time at the start, s"),
            Field("start_position", (n,)),
            Field("start_quaternion", (4 * b,)),
            Field("start_linear_velocity", (n,)),
            Field("start_angular_velocity", (3 * b,)),
            Field("goal_position", (n,)),
            Field("goal_quaternion", (4 * b,)),
            Field("channels", comment="that follow the phase beside it", kind="int"),
            Field("channel_functions", kind="int"),
            Field("channel_centers", kind="array"),
            Field("channel_widths", kind="array"),
            Field("channel_weights", kind="array", comment="of each function a row of channels"),
            Field("channel_trend", kind="array", comment="at the start, and its change to the end"),
            Field("channel_least", kind="array"),
            Field("channel_most", kind="array"),
            Field("channel_begin", comment="fraction of the demonstrated motion at the start"),
        )

    def memory_fields(self, rows: int) -> tuple[Field, ...]:
        """``noslip_state`` of so many constraint rows: all that a primitive in motion knows."""
        n, b = self.space.linear, self.space.rotations
        # C knows no empty arrays.
        rows = max(1, rows)
        return (
            Field("time", comment="s"),
            Field("fraction", comment="of the motion: 0 at the start, 1 at the end"),
            *(Field(name, (self.state.width(name),)) for name in self.state),
            Field("previous_step", comment="s; 0 at the start"),
            Field("duration", comment="s"),
            Field("pull_in", comment="1/s"),
            Field("braking", comment="s, to come to rest in after the end; 0: at once"),
            Field("amplitude", comment="factor on the learned force"),
            Field("goal_position", (n,)),
            Field("goal_quaternion", (4 * b,)),
            Field(
                "first_goal_position",
                (n,),
                "from where the goal moves; the goal itself: as in the paper",
            ),
            Field("first_goal_quaternion", (4 * b,)),
            Field("acceleration", (self.force.size,), _ACCELERATION[self.space.is_pose]),
            Field("force", (self.force.size,), "the constraints' part of it"),
            Field("values", (rows,), "residuals, then margins"),
            Field("multipliers", (rows,)),
            Field("known_fraction", comment="what drives the next step of the same length"),
            Field("known_step", comment="again; not to be written to"),
            Field("known", (2, self.drive.size)),
            Field("known_winding", (4 * b,)),
            Field("known_turn", (3 * b,)),
            Field("known_lengths", (2,), "the last step and the one before, fractions"),
            Field("known_factors", (4,), "of such steps"),
        )

    def memory(self, rows: int) -> Layout:
        """``noslip_state`` as a row of numbers."""
        return Layout(**{field.name: field.size for field in self.memory_fields(rows)})


_ACCELERATION = {True: "of the last step, m/s^2 and rad/s^2", False: "of the last step"}


@lru_cache(maxsize=64)
def layouts(space: Space) -> Layouts:
    """Return the layouts of a space."""
    return Layouts(space)


_POSE = layouts(POSE)
STATE, FORCE, DRIVE, STEP, BEGINNING = (
    _POSE.state,
    _POSE.force,
    _POSE.drive,
    _POSE.step,
    _POSE.beginning,
)
"""Those of a pose."""
POINT, VELOCITY = _POSE.point, _POSE.velocity
CLOCK = STEP.span("time_step", "gain")
"""The part of a step that is alike in all spaces."""
