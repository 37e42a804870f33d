"""What a constraint is written in: one instant of a motion, as expressions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import casadi as ca

from noslip._typing import Expression
from noslip.errors import ConstraintError, did_you_mean


@dataclass(frozen=True)
class Instant:
    """What a constraint may be written in: CasADi expressions of one instant of the motion.

    Attributes
    ----------
    time : expression, scalar
        Seconds since the motion began.
    position : expression, shape (3,)
        Of the tool's frame, meters, world frame.
    rotation : expression, shape (3, 3)
        Body to world; ``rotation[:, 1]`` is the body's y axis in the world.
    linear_velocity, angular_velocity : expression, shape (3,)
        Meters and radians per second, world frame; ``dR/dt = [w] R``.
    """

    time: Expression
    position: Expression
    rotation: Expression
    linear_velocity: Expression
    angular_velocity: Expression

    def at(self, reference_point: Sequence[float]) -> Instant:
        """Motion of the frame moved to a body-fixed point: ``p + R r`` and ``v + w x R r``.

        Parameters
        ----------
        reference_point : 3 numbers
            r, in the body's frame (m).
        """
        if not any(reference_point):
            return self
        arm = ca.mtimes(self.rotation, ca.DM(list(reference_point)))
        return replace(
            self,
            position=self.position + arm,
            linear_velocity=self.linear_velocity + ca.cross(self.angular_velocity, arm),
        )

    # Type checkers find by themselves what it does not have.
    if not TYPE_CHECKING:

        def __getattr__(self, name):
            """Refuse what a motion does not have."""
            known = [each.name for each in fields(self)]
            hint = did_you_mean(name, known)
            if "acceleration" in name:
                hint = (
                    "; accelerations follow from the constraint (a limit on them is declared with "
                    'keep_nonnegative(level="acceleration"))'
                )
            raise ConstraintError(f"a motion has {', '.join(known)}, but no {name!r}{hint}")


@dataclass(frozen=True)
class AcceleratedInstant(Instant):
    """A motion whose accelerations are known too, for inequalities at acceleration level.

    Attributes
    ----------
    linear_acceleration, angular_acceleration : expression, shape (3,)
        Of the step (m/s^2, rad/s^2), world frame, of the tool's frame.
    """

    linear_acceleration: Expression
    angular_acceleration: Expression

    def at(self, reference_point: Sequence[float]) -> AcceleratedInstant:
        """Motion of a body-fixed point: its acceleration is ``a + alpha x R r + w x (w x R r)``."""
        if not any(reference_point):
            return self
        arm = ca.mtimes(self.rotation, ca.DM(list(reference_point)))
        turning = ca.cross(self.angular_velocity, arm)
        return replace(
            self,
            position=self.position + arm,
            linear_velocity=self.linear_velocity + turning,
            linear_acceleration=self.linear_acceleration
            + ca.cross(self.angular_acceleration, arm)
            + ca.cross(self.angular_velocity, turning),
        )


@dataclass(frozen=True)
class Coordinates:
    """An instant of a motion of coordinates, such as joints, of which a limit may be declared.

    Attributes
    ----------
    time : expression, scalar
        Seconds since the motion began.
    values, rates, accelerations : expression, shape (n,)
        In the coordinates' own units, over s and s^2.
    """

    time: Expression
    values: Expression
    rates: Expression
    accelerations: Expression


def coordinate_symbols(count: int) -> Coordinates:
    """One instant of so many coordinates, as symbols."""
    return Coordinates(
        ca.SX.sym("t"), *(ca.SX.sym(name, count) for name in ("x", "rate", "acceleration"))
    )


def motion_symbols() -> AcceleratedInstant:
    """One instant of a motion, as symbols."""
    return AcceleratedInstant(
        ca.SX.sym("t"),
        ca.SX.sym("p", 3),
        ca.SX.sym("R", 3, 3),
        ca.SX.sym("v", 3),
        ca.SX.sym("w", 3),
        ca.SX.sym("a", 3),
        ca.SX.sym("alpha", 3),
    )
