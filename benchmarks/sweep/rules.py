"""Rules as the command line takes them, each with a formula in NumPy of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.sweep.track import Floats, Instants, Track

AXES = np.eye(3)
"""x, y and z of a body."""


@dataclass(frozen=True)
class Rule:
    """What must hold.

    Attributes
    ----------
    text : str
        As ``--constraint`` takes it.
    values : callable
        Of a motion, shape (K, rows): residuals, zero where an equality holds, or margins, not
        negative where a limit does.
    is_limit : bool
    is_soft : bool
        Whether it may give way to others.
    is_timed : bool
        Whether a longer duration alone can make it hold.
    of_poses : bool
        Whether it says which poses there may be.
    """

    text: str
    values: Callable[[Track], Floats]
    is_limit: bool = False
    is_soft: bool = False
    is_timed: bool = False
    of_poses: bool = False

    @property
    def name(self) -> str:
        """As the program names it."""
        return self.text.partition("(")[0]

    def softened(self) -> Rule:
        """The same with a priority of 1."""
        given = self.text.removesuffix(")").removesuffix("(")
        joint = ", " if "(" in given else "("
        return replace(self, text=f"{given}{joint}priority=1)", is_soft=True)


def _rows(*rows: Floats) -> Floats:
    return np.column_stack(rows)


def _along(body: Floats, velocity: Floats, at: Instants) -> Floats:
    return np.asarray(np.sum(at.axis(body) * velocity, axis=1))


def _numbers(values: Floats) -> str:
    return "(" + ", ".join(f"{value!r}" for value in np.asarray(values).tolist()) + ")"


def blade(offset: Floats) -> Rule:
    """No speed along y of a point of the tool."""
    y = AXES[1]

    def values(motion: Track) -> Floats:
        at = motion.steps
        return _rows(_along(y, at.velocity(offset), at))

    return Rule(f"blade(reference_point={_numbers(offset)})", values)


def needle() -> Rule:
    """No speed along y and z."""

    def values(motion: Track) -> Floats:
        at = motion.steps
        return _rows(*(_along(axis, at.linear, at) for axis in AXES[1:]))

    return Rule("needle", values)


def wheel() -> Rule:
    """No speed along y of the body and along z of the world."""

    def values(motion: Track) -> Floats:
        at = motion.steps
        return _rows(_along(AXES[1], at.linear, at), at.linear[:, 2])

    return Rule("wheel", values)


def _height(point: Floats, normal: Floats) -> Callable[[Track], Floats]:
    unit = normal / np.linalg.norm(normal)
    return lambda motion: _rows((motion.positions - point) @ unit)


def plane_contact(point: Floats, normal: Floats) -> Rule:
    """A height of zero."""
    return Rule(
        f"plane-contact(point={_numbers(point)}, normal={_numbers(normal)})",
        _height(point, normal),
        of_poses=True,
    )


def speed(most: float) -> Rule:
    """A largest speed (m/s)."""
    return Rule(
        f"speed-limit(speed={most!r})",
        lambda motion: _rows(most - np.linalg.norm(motion.steps.linear, axis=1)),
        is_limit=True,
        is_timed=True,
    )


def angular_rate(most: float) -> Rule:
    """A largest angular speed (rad/s)."""
    return Rule(
        f"angular-rate-limit(rate={most!r})",
        lambda motion: _rows(most - np.linalg.norm(motion.steps.angular, axis=1)),
        is_limit=True,
        is_timed=True,
    )


def acceleration(most: float) -> Rule:
    """A largest acceleration (m/s^2)."""
    return Rule(
        f"acceleration-limit(linear={most!r})",
        lambda motion: _rows(most - np.linalg.norm(motion.accelerations[0], axis=1)),
        is_limit=True,
        is_timed=True,
    )


def half_space(point: Floats, normal: Floats) -> Rule:
    """A height of zero or more."""
    return Rule(
        f"half-space(point={_numbers(point)}, normal={_numbers(normal)})",
        _height(point, normal),
        is_limit=True,
        of_poses=True,
    )


def box(lower: Floats, upper: Floats) -> Rule:
    """Between two corners."""
    return Rule(
        f"box(lower={_numbers(lower)}, upper={_numbers(upper)})",
        lambda motion: np.hstack([motion.positions - lower, upper - motion.positions]),
        is_limit=True,
        of_poses=True,
    )


def sphere(center: Floats, radius: float) -> Rule:
    """Out of a ball."""
    return Rule(
        f"keep-out-sphere(center={_numbers(center)}, radius={radius!r})",
        lambda motion: _rows(np.linalg.norm(motion.positions - center, axis=1) - radius),
        is_limit=True,
        of_poses=True,
    )


def capsule(start: Floats, end: Floats, radius: float) -> Rule:
    """Out of what lies near a line segment."""
    axis = end - start

    def values(motion: Track) -> Floats:
        along = np.clip((motion.positions - start) @ axis / (axis @ axis), 0, 1)
        nearest = start + along[:, None] * axis
        return _rows(np.linalg.norm(motion.positions - nearest, axis=1) - radius)

    text = f"keep-out-capsule(start={_numbers(start)}, end={_numbers(end)}, radius={radius!r})"
    return Rule(text, values, is_limit=True, of_poses=True)


def forward_only() -> Rule:
    """No speed against x of the body."""

    def values(motion: Track) -> Floats:
        at = motion.steps
        return _rows(_along(AXES[0], at.linear, at))

    return Rule("forward-only()", values, is_limit=True)


def turning_radius(radius: float) -> Rule:
    """No tighter bend about z of the body."""

    def values(motion: Track) -> Floats:
        at = motion.steps
        forward, turning = _along(AXES[0], at.linear, at), _along(AXES[2], at.angular, at)
        return _rows(forward - radius * np.abs(turning))

    return Rule(f"turning-radius(radius={radius!r})", values, is_limit=True)
