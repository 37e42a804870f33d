"""Rules of a user's own that several tests declare."""

from __future__ import annotations

from typing import Any

import casadi as ca

from noslip import position_constraint, velocity_constraint
from noslip.constraints import Instant


@velocity_constraint
def needle(motion: Instant) -> Any:
    return motion.rotation[:, 1:].T @ motion.linear_velocity


@velocity_constraint
def no_roll(motion: Instant) -> Any:
    return ca.dot(motion.rotation[:, 0], motion.angular_velocity)


@position_constraint
def table(motion: Instant) -> Any:
    return motion.position[2]


@position_constraint
def ceiling(motion: Instant) -> Any:
    return motion.position[2] - 1
