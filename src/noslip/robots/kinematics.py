"""Differential inverse kinematics of one step, with the tool's constraint as a row of the joints.

The unknown is the joints' velocity ``x`` over a step of length ``h``.  The quadratic program

    ``min |W (J x - e / h)|^2 + eps |x - x_pref|^2``   subject to   ``A_v J_v x + A_w J_w x = b``

and to bounds (position, velocity, acceleration of each joint) and one row a near pair of bodies,
is solved by DAQP (Arnström et al. 2022).  Where the arm may fall behind, the target's clock is an
unknown too: a share ``y`` of the step that it waits takes ``y`` of the target's own velocity off
``e / h``, at a small price.  The row is that of the *step*, as everywhere in this library
(:meth:`ConstraintSystem.of_step`): from the tool's pose before it to the one after it, with
``v = (p+ - p) / h`` and ``w = Log(R+ R^T) / h``; so it is linearized at the iterate and
solved again until the forward kinematics themselves satisfy it.  What joints cannot track
therefore falls into directions that the constraint allows and, if the clock may wait, into delay.

Without rows and bounds this is mink's ``FrameTask``; the program is put together here because the
row of a step, and bounds of accelerations, refer to the step's beginning wherever the iterate is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from noslip._typing import Floats
from noslip.constraints.system import ConstraintSystem
from noslip.robots.model import NEAR, Robot, required
from noslip.rotations import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_product,
    rotation_matrix,
)

LEVER = 0.2
"""Meters that weigh as much as a radian: about the length of a hand and its tool."""
WEIGHTS = np.array([1.0, 1.0, 1.0, LEVER, LEVER, LEVER])
"""Of a pose's error: m, then rad."""
REGULAR = 1e-6
"""Weight of the preferred velocity over that of the tool's (eps): it decides where the tool leaves
a choice, and nowhere else."""
WAITING = 1e-6
"""Weight of the clock's waiting over that of the tool's velocity: waiting comes before leaving the
path."""
POSTURE_RATE, SETTLING_RATE = 2.0, 20.0
"""How fast free joints return to the posture they rest in, and how fast they come to rest (1/s):
slow beside the work; within the time that is left for it."""
ITERATIONS = 5
"""Of a step, at most: each linearizes anew, so that the error squares."""
EXACT = 1e-9
"""Residual of a row (its unit, over the step at position level) at which a step is done."""
LINEAR = 1e-8
"""Pose (m, rad) that linearizing may have missed when a step is done."""
PRIMAL_TOLERANCE = 1e-11
"""Of the quadratic program: below EXACT, by which its rows are judged."""
APART = 0.005
"""Least distance that is left between a pair of bodies (m): room for what a model of the arm leaves
out."""
APPROACH_RATE = 10.0
"""How fast what is left of a distance may shrink (1/s): a time constant of a tenth of a second."""
BRAKE_SHARE = 0.9
"""Share of the acceleration that the bounds near a range's end count on: the rest makes up for
braking that begins late by a rounding."""
_EQUAL = 5
"""DAQP's mark of an equality."""
_DEPENDENT = 1e-9
"""A row this much smaller than the largest is left out: rounding of rows that say the same."""


class Chord:
    """Residual of a step's constraints and its rows, as a function of the step's end."""

    def __init__(self, system: ConstraintSystem, offset: Floats, turn: Floats) -> None:
        """Take equalities, and where their frame lies: its origin and quaternion in the base's."""
        self.size = system.size
        names = ("t", "h", "p", "q", "p0", "q0")
        widths = (1, 1, 3, 4, 3, 4)
        t, h, p, q, p0, q0 = (ca.SX.sym(n, w) for n, w in zip(names, widths, strict=True))
        moved = ca.SX.sym("d", 6)
        back = quaternion_conjugate(ca.DM(turn.tolist()))
        R = rotation_matrix(back)
        end_p = p + moved[:3]
        end_q = quaternion_product(quaternion_exp(moved[3:]), q)
        v = (end_p - p0) / h
        w = quaternion_log(quaternion_product(end_q, quaternion_conjugate(q0))) / h
        begin_p = R @ (p0 - ca.DM(offset.tolist()))
        phi = system.of_step(t - h, h, begin_p, quaternion_product(back, q0), R @ v, R @ w)
        scale = [1 / h if level == "position" else 1 for level in system.row_levels]
        phi = ca.vertcat(ca.SX(0, 1), *(scale[i] * phi[i] for i in range(self.size)))
        rows = h * ca.jacobian(phi, moved)
        outputs = [ca.substitute(e, moved, ca.SX.zeros(6)) for e in (phi, rows.T)]
        function = ca.Function(
            "chord", [t, h, p, q, p0, q0], [ca.densify(e) for e in ca.cse(outputs)]
        )
        self._given: list[Any] = [np.zeros(width) for width in widths]
        self.residual, self.rows = np.zeros(self.size), np.zeros((self.size, 6))
        results: list[Any] = [self.residual, self.rows.reshape(-1)]
        # A function's buffers are called in a microsecond, and the function itself in a hundred.
        self._buffer, self._evaluate = function.buffer()
        if self.size:
            for k, given in enumerate(self._given):
                self._buffer.set_arg(k, memoryview(given))
            for k, result in enumerate(results):
                self._buffer.set_res(k, memoryview(result))

    def __call__(self, *given: Any) -> None:
        """Evaluate ``residual`` and ``rows``: at (time, step, pose, pose before)."""
        if self.size:
            for array, value in zip(self._given, given, strict=True):
                array[:] = value
            self._evaluate()


@dataclass
class Bounds:
    """Bounds of the joints' velocity over a step, by what sets them; arrays of shape (n,)."""

    lower: Floats
    upper: Floats
    by_kind: dict[str, tuple[Floats, Floats]]

    def tightest(self, joint: int, above: bool) -> str:
        """Kind that binds a joint from above or below."""
        side = {k: pair[1][joint] if above else -pair[0][joint] for k, pair in self.by_kind.items()}
        return min(side, key=lambda kind: side[kind])


@dataclass
class Solved:
    """A step: where the joints come to, and what of it is left.

    Attributes
    ----------
    positions, velocities : array, shape (n,)
    error : array, shape (6,)
        From the tool to its target: m, rad; base frame.
    residual : array, shape (m,)
    distance, pair : float, two of str
        Between the nearest pair of bodies (m), ``NEAR`` at most; and the pair.
    waited : float
        Share of the step that the target's clock waited.
    """

    positions: Floats
    velocities: Floats
    error: Floats
    residual: Floats
    distance: float
    pair: tuple[str, str]
    waited: float = 0.0


class InverseKinematics:
    """Steps of one arm along a path; keeps scratch memory, so one a thread."""

    def __init__(
        self,
        robot: Robot,
        chord: Chord | None = None,
        rest: Floats | None = None,
        *,
        rates: bool = True,
        apart: bool = True,
    ) -> None:
        """Take the arm, its rows and the posture that free joints return to, by default home.

        ``rates`` and ``apart`` say whether limits of velocity and acceleration, and distances of
        bodies, take part.
        """
        self.mujoco, self.daqp = required("mujoco"), required("daqp")
        self.robot, self.rest = robot, robot.home if rest is None else rest
        self.chord = chord or Chord(ConstraintSystem(), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        self.apart = apart
        self.model = robot.near
        self.data = self.mujoco.MjData(self.model)
        n = robot.size
        self.velocity_limits = robot.velocity_limits if rates else np.full(n, np.inf)
        self.acceleration_limits = robot.acceleration_limits if rates else np.full(n, np.inf)
        self.jacobian = np.zeros((6, n))
        self.position, self.quaternion = np.zeros(3), np.zeros(4)
        self._between, self._turn = np.zeros(4), np.zeros(3)
        self._one, self._other = np.zeros((3, n)), np.zeros((3, n))

    # ---------------------------------------------------------------- where the tool is

    def move(self, q: Floats) -> None:
        """Set pose, Jacobian and pairs of bodies to those at joint positions."""
        model, data, mujoco = self.model, self.data, self.mujoco
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        self.position[:] = data.site_xpos[self.robot.site]
        mujoco.mju_mat2Quat(self.quaternion, data.site_xmat[self.robot.site])
        mujoco.mj_jacSite(model, data, self.jacobian[:3], self.jacobian[3:], self.robot.site)

    def error(self, position: Floats, quaternion: Floats) -> Floats:
        """From the tool to a target pose: m and rad, base frame, shape (6,)."""
        mujoco = self.mujoco
        mujoco.mju_negQuat(self._between, self.quaternion)
        mujoco.mju_mulQuat(self._between, quaternion, self._between)
        mujoco.mju_quat2Vel(self._turn, self._between, 1.0)
        return np.concatenate([position - self.position, self._turn])

    def manipulability(self) -> float:
        """Yoshikawa's, with lengths over ``LEVER``."""
        J = self.jacobian.copy()
        J[:3] /= LEVER
        return float(np.sqrt(max(np.linalg.det(J @ J.T), 0.0)))

    def distance_at(self, q: Floats) -> float:
        """Distance of the nearest pair of bodies at joint positions (m, ``NEAR`` at most)."""
        self.move(q)
        return self.nearest()[0]

    def nearest(self) -> tuple[float, tuple[str, str]]:
        """Distance of the nearest pair of bodies (m, ``NEAR`` at most), and their names."""
        contacts = self.data.contact
        if not self.data.ncon:
            return NEAR, ("", "")
        distances = contacts.dist
        k = int(np.argmin(distances))
        return min(float(distances[k]), NEAR), self._pair(contacts.geom[k])

    def _pair(self, geoms: Any) -> tuple[str, str]:
        model = self.model
        names = [
            model.geom(int(g)).name or model.body(int(model.geom_bodyid[g])).name for g in geoms
        ]
        return names[0], names[1]

    def _near_rows(self, x: Floats, h: float) -> tuple[Floats, Floats]:
        """Rows N and least values such that ``N x >= least`` keeps bodies apart.

        The distance may shrink by a share of what it was before the step.
        """
        contacts, mujoco = self.data.contact, self.mujoco
        count, n = self.data.ncon, self.robot.size
        N = np.zeros((count, n))
        geoms, frames, places = contacts.geom, contacts.frame, contacts.pos
        for k in range(count):
            bodies = self.model.geom_bodyid[geoms[k]]
            mujoco.mj_jac(self.model, self.data, self._one, None, places[k], bodies[0])
            mujoco.mj_jac(self.model, self.data, self._other, None, places[k], bodies[1])
            N[k] = frames[k, :3] @ (self._other - self._one)
        before = contacts.dist - h * (N @ x)
        return N, -APPROACH_RATE * (before - APART)

    # ---------------------------------------------------------------- one step

    def bounds(self, q: Floats, velocities: Floats, h: float) -> Bounds:
        """Velocities that a step from q may have, after a step of these velocities."""
        robot = self.robot
        a = self.acceleration_limits
        brake = np.where(np.isfinite(a), BRAKE_SHARE * a, 0.0)
        ranges = []
        for sign, room in ((-1.0, q - robot.lower), (1.0, robot.upper - q)):
            room = np.maximum(room, 0.0)
            half = brake * h / 2
            # Braking ends with a step of less than the full deceleration: an eighth of a step's
            # change at most, and nothing where that one step suffices.
            room_before = np.maximum(room - half * h / 4, 0.0)
            with np.errstate(invalid="ignore"):
                steps = np.sqrt(half**2 + 2 * brake * room_before) - half
                one_step = np.minimum(room / h, brake * h)
                stopping = np.where(brake > 0, np.maximum(steps, one_step), np.inf)
            ranges.append(sign * np.minimum(room / h, stopping))
        by_kind = {
            "position": (ranges[0], ranges[1]),
            "velocity": (-self.velocity_limits, self.velocity_limits),
            "acceleration": (velocities - a * h, velocities + a * h),
        }
        lower = np.max([pair[0] for pair in by_kind.values()], axis=0)
        upper = np.min([pair[1] for pair in by_kind.values()], axis=0)
        # Where braking comes a rounding too late, the acceleration's bound counts.
        lower = np.minimum(lower, by_kind["acceleration"][1])
        upper = np.maximum(upper, by_kind["acceleration"][0])
        return Bounds(lower, np.maximum(lower, upper), by_kind)

    def step(
        self,
        q: Floats,
        velocities: Floats,
        before: tuple[Floats, Floats],
        target: tuple[Floats, Floats],
        time: float,
        h: float,
        *,
        bounded: bool = True,
        pace: Floats | None = None,
        settling: bool = False,
    ) -> Solved | None:
        """Lead the tool towards a target pose; None if the rows cannot hold within the bounds.

        The joints' positions and velocities q, of shape (n,), and the tool's pose are those before
        a step of length h (s) that ends at a time (s) since the motion began; poses are position
        and quaternion in the base frame.  Unbounded, without bounds and distances, it is what the
        path would ask for.  With a pace, the target's velocity (m/s, rad/s) over the step, of shape
        (6,), its clock may wait.  Settling, free joints come to rest instead of returning to their
        posture.
        """
        n = self.robot.size
        limits = self.bounds(q, velocities, h)
        lower, upper = limits.lower, limits.upper
        if not bounded:
            lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
        pull = -SETTLING_RATE * velocities
        if not settling:
            pull = POSTURE_RATE**2 * (self.rest - q) - 2 * POSTURE_RATE * velocities
        preferred = velocities + h * pull
        x = np.minimum(np.maximum(velocities, lower), upper)
        # The share of the step that the clock waits is one more unknown, the last.
        waits = pace is not None
        size = n + waits
        weights = np.full(size, REGULAR)
        if waits:
            weights[n] = WAITING
            preferred = np.append(preferred, 0.0)
            lower, upper = np.append(lower, 0.0), np.append(upper, 1.0)
        waited = 0.0
        self.move(q + h * x)
        error = self.error(*target)
        self.chord(time, h, self.position, self.quaternion, *before)
        for _ in range(ITERATIONS):
            J = self.jacobian
            wanted = J @ x + error / h
            rows, values = self._independent(self.chord.rows @ J, -self.chord.residual)
            values = values + rows @ x
            G, least = rows[:0], values[:0]
            if self.apart and bounded and self.data.ncon:
                G, least = self._near_rows(x, h)
            A = np.concatenate([rows, G])
            if pace is not None:
                J = np.column_stack([J, pace])
                A = np.column_stack([A, np.zeros(len(A))])
            weighted = WEIGHTS[:, None] * J
            H = weighted.T @ weighted
            H.flat[:: size + 1] += weights
            f = -(weighted.T @ (WEIGHTS * wanted)) - weights * preferred
            sense = np.zeros(size + len(A), dtype=np.int32)
            sense[size : size + len(rows)] = _EQUAL
            found, _, flag, _ = self.daqp.solve(
                H,
                f,
                A,
                np.concatenate([upper, values, np.full(len(G), 1e30)]),
                np.concatenate([lower, values, least]),
                sense,
                primal_tol=PRIMAL_TOLERANCE,
            )
            if flag < 0:
                return None
            if waits:
                found, waited = found[:n], float(np.clip(found[n], 0.0, 1.0))
            expected = error - h * (self.jacobian @ (found - x))
            x = found
            self.move(q + h * x)
            error = self.error(*target)
            self.chord(time, h, self.position, self.quaternion, *before)
            exact = not self.chord.size or np.abs(self.chord.residual).max() <= EXACT
            if exact and np.abs(error - expected).max() <= LINEAR:
                break
        distance, pair = self.nearest()
        residual = self.chord.residual.copy()
        return Solved(q + h * x, x, error, residual, distance, pair, waited)

    def _independent(self, rows: Floats, values: Floats) -> tuple[Floats, Floats]:
        """Rows that say the same without saying anything twice."""
        if not len(rows):
            return rows, values
        if len(rows) == 1:
            norm = float(np.sqrt(rows[0] @ rows[0]))
            return (rows / norm, values / norm) if norm > _DEPENDENT else (rows[:0], values[:0])
        U, s, Vt = np.linalg.svd(rows, full_matrices=False)
        kept = s > _DEPENDENT * max(float(s[0]), 1.0)
        return Vt[kept], (U.T @ values)[kept] / s[kept]
