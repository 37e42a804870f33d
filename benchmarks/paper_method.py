"""The method of the paper, written from its text (sections III and IV-A) to be compared with.

Two uncoupled primitives are fitted, one of the position and one of the orientation.  At every time
step SciPy's BFGS then looks for the angular velocity that minimises

    ``L(w) = ||f_con(w)||_2 + ||R - R_opt(w)||_F``,  ``R_opt(w) = Exp(w dt) R_opt,previous``,
    ``f_con(w) = c^+ (b - c^T p'')``,  ``c = R_opt(w) y_b``,  ``b = -(w x c)^T p'``

starting from the last step's w, with gradients by finite differences as SciPy takes them by
default.  The position is integrated with the coupling term ``f_con`` of that orientation.

Where the text leaves a choice, the one that serves the method best is taken: the primitives are
fitted to the steps that they will take (so that they follow the demonstration to the basis
functions' error), with the same basis functions and regression as noslip; the attractor has tau
squared; Exp has the angle ``||w|| dt``.  The loss is evaluated in plain floating-point numbers:
NumPy on three components takes several times as long.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from benchmarks.example import ALPHA, ALPHA_S, BASIS_FUNCTIONS, BETA
from noslip import PoseTrajectory
from noslip.primitives.basis import Basis
from noslip.primitives.phase import Phase

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
    """The constrained motion and what the optimiser did.

    Attributes
    ----------
    motion : PoseTrajectory
    evaluations : int
        Of the loss, all steps together.
    unconverged : int
        Steps at which BFGS reports that it did not reach its tolerance: the norms of the loss
        have a kink where they vanish.
    """

    motion: PoseTrajectory
    evaluations: int
    unconverged: int


def run(demonstration: PoseTrajectory, basis_functions: int = BASIS_FUNCTIONS) -> PaperResult:
    """Learn and roll out: the paper's method as a whole."""
    return rollout(UncoupledPrimitives.fit(demonstration, basis_functions))


def rollout(primitives: UncoupledPrimitives) -> PaperResult:
    """Integrate both primitives, the orientation optimised and the position coupled to it."""
    given = primitives.demonstration
    count, tau = len(given), given.duration
    dt = tau / (count - 1)
    orientations = orientation_rollout(primitives)
    forces = primitives.forces[:, :3]
    goal = given.positions[-1]

    turn: Quaternion = orientations[0]
    position = given.positions[0].copy()
    lateral = np.array(_rotate(turn, (0.0, 1.0, 0.0)))
    # The method assumes a start on the constraint; the paper projects the velocity for it.
    velocity = given.linear_velocities[0] - lateral * (lateral @ given.linear_velocities[0])
    w = np.zeros(3)
    positions, turns = np.empty((count, 3)), np.empty((count, 4))
    positions[0], turns[0] = position, turn
    evaluations = unconverged = 0
    for k in range(count - 1):
        free = (ALPHA * (BETA * (goal - position) - tau * velocity) + forces[k]) / tau**2
        loss = loss_of_step(turn, orientations[k + 1], velocity, free, dt)
        found = minimize(loss, w, method="BFGS")
        evaluations += found.nfev
        unconverged += not found.success
        w = found.x
        turn = _normalised(_multiply(_exp(w * dt), turn))
        c = np.array(_rotate(turn, (0.0, 1.0, 0.0)))
        b = -np.array(_cross(tuple(w.tolist()), tuple(c.tolist()))) @ velocity
        # c has unit length and is its own pseudo-inverse.
        velocity = velocity + dt * (free + c * (b - c @ free))
        position = position + dt * velocity
        positions[k + 1], turns[k + 1] = position, turn
    motion = PoseTrajectory(
        times=np.arange(count, dtype=np.float64) * dt,
        positions=positions,
        rotations=Rotation.from_quat(turns, scalar_first=True),
        name="the paper's method",
    )
    return PaperResult(motion, evaluations, unconverged)


def orientation_rollout(primitives: UncoupledPrimitives) -> list[Quaternion]:
    """Integrate the orientation primitive by itself; a quaternion a sample."""
    given, forces = primitives.demonstration, primitives.forces[:, 3:]
    tau, dt = given.duration, given.duration / (len(given) - 1)
    turn: Quaternion = tuple(given.rotations[0].as_quat(scalar_first=True).tolist())
    goal: Quaternion = tuple(given.rotations[-1].as_quat(scalar_first=True).tolist())
    w = given.angular_velocities[0]
    turns = [turn]
    for force in forces:
        to_goal = np.array(_log(_multiply(goal, _conjugate(turn))))
        w = w + dt * (ALPHA * (BETA * to_goal - tau * w) + force) / tau**2
        turn = _normalised(_multiply(_exp(w * dt), turn))
        turns.append(turn)
    return turns


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


def _normalised(q: Quaternion) -> Quaternion:
    scale = 1 / sqrt(sum(x * x for x in q))
    return q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale


def _rotate(q: Quaternion, v: Vector) -> Vector:
    _, x, y, z = _multiply(_multiply(q, (0.0, *v)), _conjugate(q))
    return x, y, z


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
