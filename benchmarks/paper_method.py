"""The method of the paper, written from its text (sections III and IV-A) to be compared with.

Two uncoupled primitives are fitted, one of the position and one of the orientation.  At every time
step SciPy's BFGS then looks for the angular velocity that minimizes

    ``L(w) = ||f_con(w)||_2 + ||R - R_opt(w)||_F``,  ``R_opt(w) = Exp(w dt) R_opt,previous``,
    ``f_con(w) = c^+ (b - c^T p'')``,  ``c = R_opt(w) y_b``,  ``b = -(w x c)^T p'``

starting from the last step's w, with gradients by finite differences as SciPy takes them by
default.  The position is integrated with the coupling term ``f_con`` of that orientation.

A goal may be another from the start, and a state may be pushed: the steps simply go on from there,
the orientation's goal as demonstrated.  The orientation found for one motion can also be kept for
another, which leaves the coupling term alone to adapt it, as the trained primitive of the paper.

Where the text leaves a choice, the one that serves the method best is taken: the primitives are
fitted to the steps that they will take (so that they follow the demonstration to the basis
functions' error), with the same basis functions and regression as noslip; the attractor has tau
squared; Exp has the angle ``||w|| dt``.  The loss is evaluated in plain floating-point numbers:
NumPy on three components takes several times as long.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from benchmarks.example import ALPHA, ALPHA_S, BASIS_FUNCTIONS, BETA
from noslip import PoseTrajectory
from noslip.law.basis import Basis
from noslip.law.clock import Phase

Floats = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]

RIDGE = 1e-6
"""Relative to the basis functions' mean square, as for noslip."""


@dataclass(frozen=True, eq=False)
class UncoupledPrimitives:
    """A position and an orientation primitive, and where they start.

    Attributes
    ----------
    forces : array, shape (N - 1, 6)
        Forcing terms at the samples of the rollout: position (m), then orientation (rad).
    """

    demonstration: PoseTrajectory
    forces: Floats

    @classmethod
    def fit(
        cls, demonstration: PoseTrajectory, basis_functions: int = BASIS_FUNCTIONS
    ) -> UncoupledPrimitives:
        """Fit both to a uniformly sampled demonstration, by ridge regression."""
        tau, count = demonstration.duration, len(demonstration)
        dt = tau / (count - 1)
        steps = np.hstack(demonstration.step_velocities())
        start = np.hstack([demonstration.linear_velocities[0], demonstration.angular_velocities[0]])
        before = np.vstack([start, steps[:-1]])
        accelerations = (steps - before) / dt
        rotations = demonstration.rotations
        to_goal = np.hstack(
            [
                demonstration.positions[-1] - demonstration.positions[:-1],
                (rotations[-1] * rotations[:-1].inv()).as_rotvec(),
            ]
        )
        wanted = tau**2 * accelerations - ALPHA * (BETA * to_goal - tau * before)
        phase = Phase(ALPHA_S)
        basis = Basis(basis_functions, phase)
        activations = basis.activations(phase.at(np.arange(count - 1) / (count - 1)))
        normal = activations.T @ activations
        normal.flat[:: basis_functions + 1] += RIDGE * np.trace(normal) / basis_functions
        weights = cho_solve(cho_factor(normal), activations.T @ wanted)
        return cls(demonstration, activations @ weights)


@dataclass(frozen=True, eq=False)
class PaperResult:
    """The constrained motion and what the optimizer did.

    Attributes
    ----------
    motion : PoseTrajectory
    turning : array, shape (N - 1, 3)
        Angular velocity of each step, as optimized (rad/s).
    evaluations : int
        Of the loss, all steps together.
    unconverged : int
        Steps at which BFGS reports that it did not reach its tolerance: the norms of the loss
        have a kink where they vanish.
    """

    motion: PoseTrajectory
    turning: Floats
    evaluations: int
    unconverged: int


def run(demonstration: PoseTrajectory, basis_functions: int = BASIS_FUNCTIONS) -> PaperResult:
    """Learn and roll out: the paper's method as a whole."""
    return rollout(UncoupledPrimitives.fit(demonstration, basis_functions))


def rollout(
    primitives: UncoupledPrimitives,
    *,
    goal_position: Floats | None = None,
    turning: Floats | None = None,
) -> PaperResult:
    """Integrate both primitives, the orientation optimized and the position coupled to it.

    Parameters
    ----------
    goal_position : array, shape (3,), optional
        Meters; the demonstrated one by default.
    turning : array, shape (N - 1, 3), optional
        Angular velocities (rad/s) to keep to, instead of optimizing them.
    """
    stepping = Stepping(primitives, goal_position=goal_position, turning=turning)
    state = stepping.start()
    states = [state]
    for _ in primitives.forces:
        state = stepping.step(state)
        states.append(state)
    turning = np.array([state.w for state in states[1:]])
    return PaperResult(stepping.motion(states), turning, stepping.evaluations, stepping.unconverged)


@dataclass(frozen=True, eq=False)
class PaperState:
    """Where the method is: after how many steps, its pose, and the velocities that led there."""

    taken: int
    position: Floats
    velocity: Floats
    turn: Quaternion
    w: Floats


class Stepping:
    """The method, step by step; :func:`rollout` has the parameters.

    Beyond the end there is no force: the attractor alone goes on towards the goal.

    Attributes
    ----------
    evaluations, unconverged : int
        See :class:`PaperResult`.
    """

    def __init__(
        self,
        primitives: UncoupledPrimitives,
        *,
        goal_position: Floats | None = None,
        turning: Floats | None = None,
    ) -> None:
        self.given, self.turning = primitives.demonstration, turning
        self.goal = self.given.positions[-1] if goal_position is None else goal_position
        self.time_step = self.given.duration / (len(self.given) - 1)
        self.forces = primitives.forces[:, :3]
        self.orientations = _Orientations(primitives)
        self.evaluations = self.unconverged = 0

    def start(self) -> PaperState:
        """Return the demonstration's start."""
        turn = self.orientations[0]
        lateral = np.array(_rotate(turn, (0.0, 1.0, 0.0)))
        # The method assumes a start on the constraint; the paper projects the velocity for it.
        velocity = self.given.linear_velocities[0]
        velocity = velocity - lateral * (lateral @ velocity)
        return PaperState(0, self.given.positions[0].copy(), velocity, turn, np.zeros(3))

    def step(self, state: PaperState) -> PaperState:
        """Return the next state."""
        tau, dt, k = self.given.duration, self.time_step, state.taken
        position, velocity, turn = state.position, state.velocity, state.turn
        free = ALPHA * (BETA * (self.goal - position) - tau * velocity) / tau**2
        if k < len(self.forces):
            free = free + self.forces[k] / tau**2
        w = self._turning(state, free)
        turn = _normalized(_multiply(_exp(w * dt), turn))
        c = np.array(_rotate(turn, (0.0, 1.0, 0.0)))
        b = -np.array(_cross(tuple(w.tolist()), tuple(c.tolist()))) @ velocity
        # c has unit length and is its own pseudo-inverse.
        velocity = velocity + dt * (free + c * (b - c @ free))
        return PaperState(k + 1, position + dt * velocity, velocity, turn, w)

    def motion(self, states: Sequence[PaperState]) -> PoseTrajectory:
        """Return states, a step apart, as a trajectory."""
        return PoseTrajectory(
            times=np.arange(len(states), dtype=np.float64) * self.time_step,
            positions=np.array([state.position for state in states]),
            rotations=Rotation.from_quat([state.turn for state in states], scalar_first=True),
            name="the paper's method",
        )

    def _turning(self, state: PaperState, free: Floats) -> Floats:
        if self.turning is not None:
            return self.turning[state.taken] if state.taken < len(self.turning) else np.zeros(3)
        wanted = self.orientations[state.taken + 1]
        loss = loss_of_step(state.turn, wanted, state.velocity, free, self.time_step)
        found = minimize(loss, state.w, method="BFGS")
        self.evaluations += found.nfev
        self.unconverged += not found.success
        return np.asarray(found.x)


class _Orientations:
    """The orientation primitive, integrated by itself as far as it is asked for."""

    def __init__(self, primitives: UncoupledPrimitives) -> None:
        self.given, self.forces = primitives.demonstration, primitives.forces[:, 3:]
        ends = self.given.rotations[[0, -1]].as_quat(scalar_first=True)
        start, self.goal = (tuple(turn.tolist()) for turn in ends)
        self.w = self.given.angular_velocities[0]
        self.turns: list[Quaternion] = [start]

    def __getitem__(self, k: int) -> Quaternion:
        tau, dt = self.given.duration, self.given.duration / (len(self.given) - 1)
        while len(self.turns) <= k:
            turn, taken = self.turns[-1], len(self.turns) - 1
            to_goal = np.array(_log(_multiply(self.goal, _conjugate(turn))))
            force = self.forces[taken] if taken < len(self.forces) else np.zeros(3)
            self.w = self.w + dt * (ALPHA * (BETA * to_goal - tau * self.w) + force) / tau**2
            self.turns.append(_normalized(_multiply(_exp(self.w * dt), turn)))
        return self.turns[k]


def orientation_rollout(primitives: UncoupledPrimitives) -> list[Quaternion]:
    """Integrate the orientation primitive by itself; a quaternion a sample."""
    turns = _Orientations(primitives)
    return [turns[k] for k in range(len(primitives.demonstration))]


def loss_of_step(
    previous: Quaternion, wanted: Quaternion, velocity: Floats, free: Floats, dt: float
) -> Callable[[Floats], float]:
    """L(w) of one step.

    Parameters
    ----------
    previous : quaternion
        R_opt of the last step.
    wanted : quaternion
        R of the orientation primitive.
    velocity, free : array, shape (3,)
        p' and the unconstrained p''.

    Notes
    -----
    Rotations that differ by an angle theta are ``2 sqrt(2) sin(theta / 2)`` apart in Frobenius'
    norm, and ``sin(theta / 2)`` is the length of the vector part of the quaternion between them.
    """
    cx, cy, cz = _rotate(previous, (0.0, 1.0, 0.0))
    ow, ox, oy, oz = _multiply(previous, _conjugate(wanted))
    vx, vy, vz = velocity.tolist()
    ax, ay, az = free.tolist()
    root8 = sqrt(8.0)

    def loss(w: Floats) -> float:
        wx, wy, wz = w.tolist()
        speed = sqrt(wx * wx + wy * wy + wz * wz)
        half = 0.5 * dt * speed
        # e: the quaternion of Exp(w dt)
        scale = sin(half) / speed if speed > 0.0 else 0.5 * dt
        ew, ex, ey, ez = cos(half), scale * wx, scale * wy, scale * wz
        # lateral axis after the step, c = e c_previous e*
        tx, ty, tz = 2 * (ey * cz - ez * cy), 2 * (ez * cx - ex * cz), 2 * (ex * cy - ey * cx)
        nx = cx + ew * tx + ey * tz - ez * ty
        ny = cy + ew * ty + ez * tx - ex * tz
        nz = cz + ew * tz + ex * ty - ey * tx
        b = -((wy * nz - wz * ny) * vx + (wz * nx - wx * nz) * vy + (wx * ny - wy * nx) * vz)
        force = b - (nx * ax + ny * ay + nz * az)
        # vector part of the quaternion from R to R_opt
        dx = ew * ox + ow * ex + ey * oz - ez * oy
        dy = ew * oy + ow * ey + ez * ox - ex * oz
        dz = ew * oz + ow * ez + ex * oy - ey * ox
        value: float = abs(force) + root8 * sqrt(dx * dx + dy * dy + dz * dz)
        return value

    return loss


# ---------------------------------------------------------------- quaternions (w, x, y, z)


def _exp(turn: Floats) -> Quaternion:
    x, y, z = turn.tolist()
    angle = sqrt(x * x + y * y + z * z)
    scale = sin(angle / 2) / angle if angle > 0.0 else 0.5
    return cos(angle / 2), scale * x, scale * y, scale * z


def _log(q: Quaternion) -> Vector:
    w, x, y, z = q if q[0] >= 0 else (-q[0], -q[1], -q[2], -q[3])
    length = sqrt(x * x + y * y + z * z)
    scale = 2 * float(np.arctan2(length, w)) / length if length > 0.0 else 2.0
    return scale * x, scale * y, scale * z


def _multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + bw * ax + ay * bz - az * by,
        aw * by + bw * ay + az * bx - ax * bz,
        aw * bz + bw * az + ax * by - ay * bx,
    )


def _conjugate(q: Quaternion) -> Quaternion:
    return q[0], -q[1], -q[2], -q[3]


def _normalized(q: Quaternion) -> Quaternion:
    scale = 1 / sqrt(sum(x * x for x in q))
    return q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale


def _rotate(q: Quaternion, v: Vector) -> Vector:
    _, x, y, z = _multiply(_multiply(q, (0.0, *v)), _conjugate(q))
    return x, y, z


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
