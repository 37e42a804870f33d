"""What a primitive wants: the motion that it would make if nothing held it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip._values import Value
from noslip.errors import InputError
from noslip.law.attractor import Attractor
from noslip.law.basis import Basis
from noslip.law.clock import Clock
from noslip.law.entry import goal_entry
from noslip.law.forcing import ForcingTerm
from noslip.law.points import Goal, each_of, frozen, quaternions_of, rotation_of
from noslip.law.winding import Winding
from noslip.space import POSE, Space
from noslip.trajectory import continuous_quaternions


@dataclass(frozen=True, eq=False, repr=False)
class Law(Value):
    """A movement primitive: an attractor to a goal and a learned force, driven by one phase.

    ``tau^2 p'' = alpha (beta (p_g - p) - tau p') + f_p(s)``
    ``tau^2 w'  = alpha (beta Log(R_g R^T) - tau w) + f_q(s)``

    (the paper's eqs. 1 and 4).  There is no goal scaling: a new goal moves the attractor
    (:mod:`noslip.law.entry`), the learned force stays, so a goal equal to the start is like any
    other.

    Attributes
    ----------
    attractor : Attractor
    forcing : ForcingTerm
        A column a coordinate (m), then those of rotation vectors (rad, world frame); time
        normalized by the duration.
    start : array, shape (n + 4 b,)
        Where the demonstrations begin (mean): position (m) and quaternion (qw, qx, qy, qz).  Kept
        as numbers, since SciPy's rotations change their last bits when written and read.
    start_velocity : array, shape (n + 3 b,)
        Meters and radians per duration, world frame.
    goal : Goal
        Where they end (mean).
    duration : float
        Demonstrated (mean), seconds: the default tau.
    steps : int
        Steps of a rollout by default: the demonstration's own, or a multiple.
    begin : float
        Time at its start (s), for constraints that depend on it; that of the state from which it
        was re-planned.
    space : Space
    """

    attractor: Attractor
    forcing: ForcingTerm
    start: Floats
    start_velocity: Floats
    goal: Goal
    duration: float
    steps: int
    begin: float = 0.0
    space: Space = POSE

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", frozen("start", self.start, self.space.point_size))
        velocity = frozen("start_velocity", self.start_velocity, self.space.velocity_size)
        object.__setattr__(self, "start_velocity", velocity)

    def __repr__(self) -> str:
        return f"Law({self.basis.count} basis functions, {self.duration:.6g} s, {self.steps} steps)"

    @property
    def basis(self) -> Basis:
        """Of the learned force."""
        return self.forcing.basis

    @property
    def clock(self) -> Clock:
        """What drives it."""
        return self.forcing.basis.phase

    @cached_property
    def start_position(self) -> Floats:
        """Where the demonstrations begin (mean), meters, shape (n,)."""
        return self.start[: self.space.linear]

    @cached_property
    def start_rotation(self) -> Rotation:
        """The same of the rotation."""
        return rotation_of(self.start[self.space.linear :])

    @property
    def goal_position(self) -> Floats:
        """Where they end (mean), meters, shape (n,)."""
        return self.goal.position

    @property
    def goal_rotation(self) -> Rotation:
        """The same of the rotation."""
        return self.goal.rotation

    @cached_property
    def offset_weights(self) -> Floats:
        """Weights over ``alpha beta``: what they add to the goals, shape (K, n + 3 b)."""
        return self.forcing.weights / self.attractor.stiffness

    def require_end(self, what: str) -> None:
        """Refuse a rhythm, which comes to no goal.

        Parameters
        ----------
        what : str
            That needs one.

        Raises
        ------
        InputError
        """
        if self.clock.returns:
            raise InputError(
                f"{what} needs a motion with an end, and a rhythm goes round for ever; give "
                "rollout or step another goal (its baseline), amplitude or duration (its period)"
            )

    def targets(
        self,
        begin: float,
        steps: int,
        step_fraction: float,
        goal_position: Floats,
        goal_rotation: Rotation,
        first_goal_position: Floats,
        first_goal_rotation: Rotation,
        before: float,
        amplitude: float = 1.0,
    ) -> dict[str, Floats]:
        """Where each of the coming steps is drawn to.

        Parameters
        ----------
        begin : float
            Fraction of the duration at which the first step begins.
        steps : int
        step_fraction : float
            ``dt / tau``.
        goal_position, goal_rotation : array, shape (n,), and Rotation
            To end at.
        first_goal_position, first_goal_rotation : array, shape (n,), and Rotation
            From where they move there, see :mod:`noslip.law.entry`.
        before : float
            The step before the first one, over tau; 0 at the start of the motion.
        amplitude : float
            Factor on the learned force.

        Returns
        -------
        dict of array, shape (steps, d)
            The columns of a step (:class:`noslip.law.layout.Layouts`) that belong to the space.
        """
        offsets = self.basis.stepping_forces(
            begin,
            steps,
            step_fraction,
            self.attractor,
            before,
            self.offset_weights,
        )
        if amplitude != 1:
            offsets = amplitude * offsets
        n, position = self.space.linear, goal_position
        moved = goal_position - first_goal_position
        turns = _turns(first_goal_rotation, goal_rotation, self.space.rotations)
        entered, drawn = np.zeros((steps, 1)), np.ones((steps, 1))
        if moved.any() or turns.any():
            entry = goal_entry(self.attractor, begin, steps, step_fraction, before)
            entered, drawn = (column[:, None] for column in entry)
            position = goal_position + moved * (drawn - 1)
        goals, pulls = [np.zeros((steps, 0))], [np.zeros((steps, 0))]
        firsts = each_of(first_goal_rotation)
        for k, (winding, turn) in enumerate(zip(self.goal.windings, turns, strict=True)):
            rotations, left_out = winding.along(
                begin, steps, step_fraction, self.attractor, before, firsts[k]
            )
            offset = offsets[:, n + 3 * k : n + 3 * k + 3] + left_out
            if turn.any():
                turned = Rotation.from_rotvec(entered * turn)
                leading = turned * Rotation.from_quat(rotations, scalar_first=True)
                rotations = np.asarray(leading.as_quat(scalar_first=True))
                offset = turned.apply(offset) + (drawn - entered) * turn
            goals.append(rotations)
            pulls.append(offset)
        return {
            "position_target": position + offsets[:, :n],
            "rotation_goal": np.hstack(goals),
            "rotation_offset": np.hstack(pulls),
        }

    def turned(self, turn: Rotation) -> Law:
        """Return the law of a pose whose rotations are ``turn R(t)``, turned in the world frame."""
        n = self.space.linear
        knots = turn * Rotation.from_quat(self.goal.winding.quaternions, scalar_first=True)
        matrix = turn.as_matrix()
        weights, velocity, start = (
            np.array(x) for x in (self.forcing.weights, self.start_velocity, self.start)
        )
        weights[:, n:] = weights[:, n:] @ matrix.T
        velocity[n:] = matrix @ velocity[n:]
        start[n:] = (turn * self.start_rotation).as_quat(scalar_first=True)
        return replace(
            self,
            forcing=ForcingTerm(self.basis, weights),
            start=start,
            start_velocity=velocity,
            goal=Goal(
                self.goal_position,
                Winding(continuous_quaternions(knots), self.goal.winding.is_cyclic),
            ),
        )

    def rotated_to(self, start: Rotation, goal: Rotation) -> Law:
        """Return the law with another rotation at its start and goal; the learned force stays."""
        if not self.space.rotations:
            return self
        turns = self.goal_rotation.inv() * goal
        windings = []
        for winding, turn in zip(self.goal.windings, each_of(turns), strict=True):
            knots = Rotation.from_quat(winding.quaternions, scalar_first=True) * turn
            windings.append(Winding(continuous_quaternions(knots), winding.is_cyclic))
        point = np.array(self.start)
        point[self.space.linear :] = quaternions_of(self.space, start)
        return replace(self, start=point, goal=Goal(self.goal_position, *windings))


def _turns(begins: Rotation, ends: Rotation, count: int) -> Floats:
    """Rotation vectors that lead from rotations to others, shape (b, 3)."""
    if begins is ends or not count:
        return np.zeros((count, 3))
    return np.reshape((ends * begins.inv()).as_rotvec(), (count, 3))
