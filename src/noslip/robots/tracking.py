"""A tool's motion as joints: tracked on time, without slip, within every limit, or refused."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Slerp

from noslip import _arguments
from noslip._files import write_beside
from noslip._typing import Floats
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.errors import InputError, NoslipError
from noslip.projection.trajectory import project_trajectory
from noslip.robots.kinematics import APART, Chord, InverseKinematics, Solved
from noslip.robots.model import NEAR, Robot
from noslip.robots.placement import (
    Candidate,
    Level,
    Placement,
    exact_start,
    place,
    postures,
)
from noslip.trajectory import PoseTrajectory

Constraints = ConstraintSystem | Constraint | Sequence[Constraint]
TIME_STEP = 1e-3
RESTING = 1e-3
"""Speed of joints at rest (rad/s)."""
SETTLING = 0.3
"""Time before the end over which free joints come to rest (s)."""
RAMP = 0.25
"""Time over which the motion's clock starts and stops (s)."""
POSITION_TOLERANCE, ROTATION_TOLERANCE = 1e-4, np.radians(0.05)
"""Largest error of a tracked pose (m, rad)."""
DISCRETE = 1e-7
"""Residual of the commanded motion above which it is projected onto the constraints anew."""
RETIMING = 1e-2
"""Residual above which a constraint does not stand the ramps."""
TRIED = 4
"""Candidates that are tracked, the best first."""
COARSE_SAMPLES = 1000
"""Samples of the tracking that looks for a feasible duration."""
LONGEST = 3.0
"""Of a motion whose clock may wait, over its own duration."""
SPARE = 1.05
"""Share by which an offered duration is longer than the one that just reaches a limit."""


class InfeasibleMotionError(NoslipError, RuntimeError):
    """A motion that an arm cannot execute, and what it could.

    Attributes
    ----------
    limit : str
        "position", "velocity", "acceleration", "reach" or "collision".
    joint : str
        The joint (out of reach, the one nearest to its range's end), or the pair of bodies.
    time : float
        When (s).
    margin : float
        Negative: what is missing, as a share of the limit; m for reach and collision.
    duration : float or None
        Of the motion, with which it is feasible (s).
    placement : Placement or None
        The nearest one found at which it is feasible.
    """

    page = "docs/arm.md"

    def __init__(
        self,
        message: str,
        *,
        limit: str,
        joint: str,
        time: float,
        margin: float,
        duration: float | None = None,
        placement: Placement | None = None,
    ) -> None:
        super().__init__(message)
        self.limit, self.joint, self.time, self.margin = limit, joint, time, margin
        self.duration, self.placement = duration, placement


@dataclass(frozen=True)
class Margins:
    """What is left of each limit where least is; 1 is in the middle or at rest, 0 at the limit.

    Attributes
    ----------
    position, velocity, acceleration : float
        Infinite limits count as 1.
    position_joint, velocity_joint, acceleration_joint : str
        Whose it is.
    distance : float
        Between the nearest pair of bodies (m), 0.05 at most.
    pair : tuple of str
    manipulability : float
        Yoshikawa's, lengths over 0.2 m; 0 at the edge of reach.
    """

    position: float
    position_joint: str
    velocity: float
    velocity_joint: str
    acceleration: float
    acceleration_joint: str
    distance: float
    pair: tuple[str, str]
    manipulability: float

    @property
    def smallest(self) -> tuple[float, str]:
        """Smallest margin, distances over 0.05 m among them, and what it is of."""
        return min(
            (self.position, f"position of {self.position_joint}"),
            (self.velocity, f"velocity of {self.velocity_joint}"),
            (self.acceleration, f"acceleration of {self.acceleration_joint}"),
            ((self.distance - APART) / (NEAR - APART), "distance of bodies"),
        )


@dataclass(frozen=True, eq=False)
class ToolErrors:
    """Of an executed path against the commanded one, at equal times.

    Attributes
    ----------
    along, lateral, depth : array, shape (N,)
        Along the commanded tool's x, y and z axis (m).
    rotation : array, shape (N,)
        Angle (rad).
    """

    along: Floats
    lateral: Floats
    depth: Floats
    rotation: Floats

    @property
    def position(self) -> Floats:
        """Distance, shape (N,) (m)."""
        return np.sqrt(self.along**2 + self.lateral**2 + self.depth**2)


@dataclass(frozen=True, eq=False)
class TrackedMotion:
    """A tool's motion as an arm's joints execute it.

    Attributes
    ----------
    robot : Robot
    system : ConstraintSystem
        Equalities and limits.
    placement : Placement
    commanded, executed : PoseTrajectory
        Of the tool, seen from the base: as asked for, and by the arm's forward kinematics.
    joint_positions, joint_velocities : array, shape (N, n)
        Velocities are those of the step that led to a sample; the arm starts at rest.
    margins : Margins
    seconds_per_step : float
        Median time that a step's inverse kinematics took (s).
    clock : array, shape (N,)
        Time along the motion (s): the times, unless the arm fell behind.
    """

    robot: Robot
    system: ConstraintSystem
    placement: Placement
    commanded: PoseTrajectory
    executed: PoseTrajectory
    joint_positions: Floats
    joint_velocities: Floats
    margins: Margins
    seconds_per_step: float
    clock: Floats

    @property
    def times(self) -> Floats:
        """Seconds, shape (N,)."""
        return self.commanded.times

    @cached_property
    def errors(self) -> ToolErrors:
        """Of the executed tool against the commanded one."""
        return tool_errors(self.commanded, self.executed)

    @cached_property
    def slip(self) -> Floats:
        """Residuals of the executed tool's equalities at each step, shape (N - 1, m)."""
        return slip(self.placement.undo(self.executed), self.system)

    def csv_text(self) -> str:
        """Return ``t,q1..,dq1..`` as text; a float read back is the float written."""
        n = self.robot.size
        header = ["t", *(f"q{k + 1}" for k in range(n)), *(f"dq{k + 1}" for k in range(n))]
        table = np.column_stack([self.times, self.joint_positions, self.joint_velocities])
        text = io.StringIO()
        text.write(",".join(header) + "\n")
        for row in table.tolist():
            text.write(",".join(map(repr, row)) + "\n")
        return text.getvalue()

    def to_csv(self, path: str | Path) -> Path:
        """Write :meth:`csv_text` to a file."""
        return write_beside(path, self.csv_text().encode())


def slip(motion: PoseTrajectory, constraints: Constraints) -> Floats:
    """Residuals of the equalities at each step of a motion, from its poses alone.

    Returns
    -------
    array, shape (N - 1, m)
        Of a blade the lateral speed (m/s).
    """
    system = as_system(constraints).equalities
    linear, angular = motion.step_velocities()
    return system.residuals(
        motion.clock[1:], motion.positions[1:], motion.quaternions[1:], linear, angular
    )


def slip_distance(motion: PoseTrajectory, constraints: Constraints) -> Floats:
    """Way that a tool slipped: the integral of each velocity-level residual's size.

    Returns
    -------
    array, shape (m,)
        One number a row (m, of a residual in m/s).
    """
    system = as_system(constraints).equalities
    sizes = np.abs(slip(motion, system))[:, system.row_is_velocity]
    return np.asarray(np.diff(motion.times) @ sizes)


def tool_errors(commanded: PoseTrajectory, executed: PoseTrajectory) -> ToolErrors:
    """Split what an executed path is off the commanded one, in the commanded tool's frame."""
    off = commanded.rotations.inv().apply(executed.positions - commanded.positions)
    angle = (executed.rotations * commanded.rotations.inv()).magnitude()
    return ToolErrors(off[:, 0], off[:, 1], off[:, 2], angle)


def track(
    robot: Robot,
    motion: PoseTrajectory,
    constraints: Constraints = (),
    *,
    placement: Placement | None = None,
    start: ArrayLike | None = None,
    level: Level = "recorded",
    duration: float | None = None,
    ramp: float = RAMP,
    time_step: float = TIME_STEP,
    refuse: bool = True,
    seed: int = 0,
) -> TrackedMotion:
    """Execute a tool's motion with an arm, kinematically.

    In each step the joints' velocities solve a quadratic program
    (:mod:`noslip.robots.kinematics`): the tool's equalities are rows of it, held exactly at the
    executed step; limits of joints and distances of bodies bound it.  The arm starts and ends at
    rest: the motion's clock starts and stops over a ramp, along the same path.

    Parameters
    ----------
    robot : Robot
    motion : PoseTrajectory
        Of the tool, in the frame that its constraints are written in.
    constraints : ConstraintSystem or constraints
        Equalities are held.
    placement : Placement, optional
        Where the motion's frame lies before the arm; by default searched (:func:`place`).
    start : array, shape (n,), optional
        Posture near which the arm starts; by default searched.
    level : "recorded" or "tool"
        For the search of a placement, see :meth:`Placement.of`.
    duration : float, optional
        Of the motion, without the ramps; by default its own (s).
    ramp : float
        Of the clock, at either end (s); 0 for a motion that begins and ends at rest, or whose
        constraints depend on time.
    time_step : float
        Of the joints' trajectory (s).
    refuse : bool
        Raise where the path cannot be tracked to 0.1 mm and 0.05 degrees.  Otherwise the motion's
        clock waits there: the tool falls behind, along its path and within all limits, and may
        take up to three times as long.
    seed : int
        Of the search.

    Returns
    -------
    TrackedMotion

    Raises
    ------
    InfeasibleMotionError
        If a limit is in the way; it names the joint, the time and the margin, and offers a
        duration or placement that is feasible, if one was found.
    InputError
        If an argument is not what it must be, or a constraint does not stand the ramps.
    """
    system = as_system(constraints)
    commanded = timed(motion, system, duration=duration, ramp=ramp, time_step=time_step)
    if start is not None:
        if placement is None:
            raise InputError("a start posture needs a placement too")
        given = np.asarray(start, dtype=np.float64)
        robot.forward(given)
        candidates = [Candidate(placement, given, 0.0)]
    elif placement is not None:
        candidates = postures(robot, commanded, placement, seed=seed)[:TRIED]
        candidates = candidates or [Candidate(placement, robot.home, 0.0)]
    else:
        candidates = place(robot, commanded, level=level, seed=seed)[:TRIED]
        if not candidates:
            candidates = [Candidate(_before(robot, commanded, level), robot.home, 0.0)]
    failures = []
    for candidate in candidates:
        run = _Run(robot, system, commanded, candidate, refuse=refuse)
        if run.failure is None:
            return run.result()
        failures.append(run)
    raise _refusal(failures[0], motion, duration, ramp, seed, searched=placement is None)


def timed(
    motion: PoseTrajectory,
    constraints: Constraints = (),
    *,
    duration: float | None = None,
    ramp: float = RAMP,
    time_step: float = TIME_STEP,
) -> PoseTrajectory:
    """Return a motion at an arm's rate, from rest to rest.

    The clock runs with a quintic step's smoothness from 0 to 1 over the ramp, and back at the end,
    so that a motion of duration T takes ``T + ramp``.  A path sampled anew fulfills constraints on
    its steps only to the order of the step: it is projected onto them
    (:func:`noslip.project_trajectory`).

    Raises
    ------
    InputError
        If a constraint does not stand another timing.
    """
    system = as_system(constraints).equalities
    duration = motion.duration if duration is None else _arguments.positive("duration", duration)
    ramp = min(_arguments.not_negative("ramp", ramp), duration)
    time_step = _arguments.positive("time_step", time_step)
    steps = _arguments.samples("time_step", np.ceil((duration + ramp) / time_step - 1e-9))
    times: Floats = time_step * np.arange(max(steps, 3) + 1.0)
    clock = _clock(np.minimum(times, duration + ramp), duration, ramp) / duration
    if (
        ramp == 0
        and len(times) == len(motion)
        and np.allclose(times, motion.clock, rtol=0, atol=1e-9)
    ):
        return motion
    sampled = motion.resampled(times=motion.times[0] + clock * motion.duration)
    moved = PoseTrajectory(times, sampled.positions, sampled.rotations, name=motion.name)
    if not system.size:
        return moved
    off = np.abs(slip(moved, system)).max(axis=0)
    linear, angular = moved.step_velocities()
    turned = np.linalg.norm(linear, axis=1).max() * np.linalg.norm(angular, axis=1).max()
    # Beside a step's length, which a coarser motion leaves.
    if off.max() > RETIMING + motion.period * turned:
        row = int(np.argmax(off))
        raise InputError(
            f"{motion.name}: {system.row_names[row]!r} is {off[row]:.3g} {system.row_units[row]} "
            "off when the motion is timed for an arm; it does not hold, or depends on time: give "
            "ramp=0 and the motion's own duration"
        )
    if off.max() <= DISCRETE:
        return moved
    return project_trajectory(moved, system).trajectory


def _clock(times: Floats, duration: float, ramp: float) -> Floats:
    """Time along the motion: its rate rises as a quintic step, and falls at the end."""
    if ramp == 0:
        return np.minimum(times, duration)

    def risen(u: Floats) -> Floats:
        u = np.clip(u, 0, 1)
        return np.asarray(ramp * u**4 * (2.5 - 3 * u + u**2))

    end = duration + ramp
    plain = np.clip(times - ramp, 0, duration - ramp)
    left = risen((end - times) / ramp)
    return np.asarray(np.clip(risen(times / ramp) + plain + ramp / 2 - left, 0, duration))


class _Run:
    """One candidate, tracked from the motion's start until its end or the first failure."""

    def __init__(
        self,
        robot: Robot,
        system: ConstraintSystem,
        commanded: PoseTrajectory,
        candidate: Candidate,
        *,
        refuse: bool = True,
        rates: bool = True,
        apart: bool = True,
    ) -> None:
        self.robot, self.system, self.placement = robot, system, candidate.placement
        self.asked = commanded
        self.commanded = placed = candidate.placement.apply(commanded)
        turn = candidate.placement.rotation.as_quat(scalar_first=True)
        chord = Chord(system.equalities, candidate.placement.position, turn)
        self.ik = ik = InverseKinematics(robot, chord, candidate.start, rates=rates, apart=apart)
        targets = list(zip(placed.positions, placed.quaternions, strict=True))
        q = exact_start(robot, ik, candidate.start, *targets[0])
        ik.move(q)
        self.joints = np.empty((len(placed), robot.size))
        self.rates = np.zeros_like(self.joints)
        self.distance, self.pair, self.able = *ik.nearest(), ik.manipulability()
        self.joints[0], x = q, self.rates[0]
        self.touched = 0 if self.distance < APART else None
        self.failure: tuple[str, str, int, float] | None = None
        if self._lost(ik.error(*targets[0])):
            self.failure = self._of_reach(0, q, ik.error(*targets[0]))
            return
        if apart and self.distance < APART:
            self.failure = "collision", " and ".join(self.pair), 0, self.distance - APART
            return
        if not refuse:
            self._fall_behind(q)
            return
        clock, spent = placed.clock, []
        here = ik.position.copy(), ik.quaternion.copy()
        for k in range(1, len(placed)):
            began = perf_counter()
            h = clock[k] - clock[k - 1]
            settling = clock[-1] - clock[k] < SETTLING
            solved = ik.step(q, x, here, targets[k], clock[k], h, settling=settling)
            spent.append(perf_counter() - began)
            if solved is None or self._lost(solved.error):
                self.failure = self._why(k, q, x, here, targets[k], h)
                return
            self._note(solved, k)
            q, x = solved.positions, solved.velocities
            self.joints[k], self.rates[k] = q, x
            here = ik.position.copy(), ik.quaternion.copy()
        self.seconds, self.clock = float(np.median(spent)), clock

    def _note(self, solved: Solved, k: int) -> None:
        if solved.distance < APART and self.touched is None:
            self.touched = k
        if solved.distance < self.distance:
            self.distance, self.pair = solved.distance, solved.pair
        self.able = min(self.able, self.ik.manipulability())

    def _fall_behind(self, q: Floats) -> None:
        """Track the motion at its own pace or, where that is too fast, slower."""
        ik, placed = self.ik, self.commanded
        end, h = float(placed.clock[-1]), placed.period
        path = CubicSpline(placed.clock, placed.positions)
        turns = Slerp(placed.clock, placed.rotations)
        clock, x = 0.0, np.zeros(self.robot.size)
        joints, rates, clocks, spent = [q], [x], [clock], []
        here = ik.position.copy(), ik.quaternion.copy()
        for k in range(1, int(LONGEST * len(placed))):
            began = perf_counter()
            ahead = min(clock + h, end)
            poses = turns([clock, ahead])
            target = path(ahead), poses[1].as_quat(scalar_first=True)
            moved = path(ahead) - path(clock)
            turned = (poses[1] * poses[0].inv()).as_rotvec()
            pace = np.concatenate([moved, turned]) / h
            settling = end - clock < SETTLING
            solved = ik.step(q, x, here, target, k * h, h, pace=pace, settling=settling)
            spent.append(perf_counter() - began)
            if solved is None:
                self.failure = self._why(k, q, x, here, target, h)
                return
            self._note(solved, k)
            clock += (1 - solved.waited) * (ahead - clock)
            q, x = solved.positions, solved.velocities
            joints.append(q)
            rates.append(x)
            clocks.append(clock)
            here = ik.position.copy(), ik.quaternion.copy()
            if end - clock < h / 2 and np.abs(x).max() <= RESTING:
                break
        self.joints, self.rates = np.array(joints), np.array(rates)
        self.clock, self.seconds = np.array(clocks), float(np.median(spent))
        # At equal times: the motion as it was asked for waits at its end.
        times: Floats = h * np.arange(float(len(joints)))
        asked = np.minimum(times, end)
        self.commanded = PoseTrajectory(times, path(asked), turns(asked), name=placed.name)

    @staticmethod
    def _lost(error: Floats) -> bool:
        return bool(
            np.linalg.norm(error[:3]) > POSITION_TOLERANCE
            or np.linalg.norm(error[3:]) > ROTATION_TOLERANCE
        )

    def _of_reach(self, k: int, q: Floats, error: Floats) -> tuple[str, str, int, float]:
        """Out of reach; the joint is the one that is nearest to its range's end."""
        joint = self.robot.joint_names[int(np.argmin(self._room(q)))]
        return "reach", joint, k, -float(np.linalg.norm(error[:3]))

    def _room(self, joints: Floats) -> Floats:
        """What is left of the joints' ranges: 1 in the middle, 0 at an end; 1 without a range."""
        lower, upper = self.robot.lower, self.robot.upper
        with np.errstate(invalid="ignore"):
            half = (upper - lower) / 2
            room = np.minimum(joints - lower, upper - joints) / half
        return np.asarray(np.where(np.isfinite(half), room, 1.0))

    def _why(
        self, k: int, q: Floats, x: Floats, here: Any, target: Any, h: float
    ) -> tuple[str, str, int, float]:
        """What is in the way of a step: kind, whose, sample, margin."""
        ik, robot = self.ik, self.robot
        bounds = ik.bounds(q, x, h)
        free = ik.step(q, x, here, target, k * h, h, bounded=False)
        if free is None:
            return self._of_reach(k, q, ik.error(*target))
        wanted = free.velocities
        over = np.maximum(wanted - bounds.upper, bounds.lower - wanted)
        scale = np.where(np.isfinite(robot.velocity_limits), robot.velocity_limits, 1.0)
        joint = int(np.argmax(over / scale))
        if over[joint] > 1e-6:
            above = wanted[joint] > bounds.upper[joint]
            kind = bounds.tightest(joint, above)
            half = (robot.upper[joint] - robot.lower[joint]) / 2
            scales = {
                "position": half / h,
                "velocity": ik.velocity_limits[joint],
                "acceleration": ik.acceleration_limits[joint] * h,
            }
            return kind, robot.joint_names[joint], k, -float(over[joint] / scales[kind])
        return self._of_reach(k, q, free.error)

    def demand(self) -> tuple[float, str, str, int]:
        """By how much limits of velocity and acceleration are exceeded, and who, most, when.

        A motion slowed down by this factor keeps all of them.
        """
        robot, times = self.robot, self.commanded.times
        h = np.diff(times)[:, None]
        speed = np.abs(self.rates[1:]) / robot.velocity_limits
        gain = np.abs(np.diff(self.rates, axis=0)) / h / robot.acceleration_limits
        found = []
        for kind, share in (("velocity", speed), ("acceleration", np.sqrt(gain))):
            k, joint = np.unravel_index(int(np.argmax(share)), share.shape)
            name = robot.joint_names[int(joint)]
            found.append((float(share[k, joint]), kind, name, int(k) + 1))
        return max(found)

    def result(self) -> TrackedMotion:
        """The arm's motion; every pose by forward kinematics of its own."""
        robot = self.robot
        positions, rotations = robot.forward(self.joints)
        executed = PoseTrajectory(
            self.commanded.times, positions, rotations, name=f"{robot.name}, kinematic"
        )
        return TrackedMotion(
            robot=robot,
            system=self.system,
            placement=self.placement,
            commanded=self.commanded,
            executed=executed,
            joint_positions=self.joints,
            joint_velocities=self.rates,
            margins=self.margins(),
            seconds_per_step=self.seconds,
            clock=self.clock,
        )

    def margins(self) -> Margins:
        """What is left of each limit."""
        robot = self.robot
        h = np.diff(self.commanded.times)[:, None]
        shares = {
            "position": self._room(self.joints),
            "velocity": 1 - np.abs(self.rates) / robot.velocity_limits,
            "acceleration": 1 - np.abs(np.diff(self.rates, axis=0)) / h / robot.acceleration_limits,
        }
        found: dict[str, Any] = {}
        for kind, share in shares.items():
            least = share.min(axis=0)
            found[kind] = float(least.min())
            found[f"{kind}_joint"] = robot.joint_names[int(np.argmin(least))]
        return Margins(**found, distance=self.distance, pair=self.pair, manipulability=self.able)


def _refusal(
    run: _Run,
    motion: PoseTrajectory,
    duration: float | None,
    ramp: float,
    seed: int,
    *,
    searched: bool,
) -> InfeasibleMotionError:
    """Say why a motion is refused, and offer what is feasible: more time, or another place."""
    assert run.failure is not None
    limit, joint, sample, margin = run.failure
    robot, system = run.robot, run.system
    time = float(run.commanded.clock[min(sample, len(run.commanded) - 1)])
    asked = motion.duration if duration is None else duration
    longer, place_found = None, None
    # More time helps exactly where the path can be tracked without limits of rates.
    start = Candidate(run.placement, run.joints[0], 0.0)
    factor = 1.0
    for _ in range(3):
        coarse = _coarse(motion, system, factor * asked, ramp)
        slow = _Run(robot, system, coarse, start, rates=False) if coarse is not None else None
        if slow is None or slow.failure is not None:
            break
        excess, kind, name, k = slow.demand()
        if factor == 1.0 and excess > 1:
            share = excess if kind == "velocity" else excess**2
            limit, joint, margin, time = kind, name, 1 - share, float(slow.commanded.clock[k])
        factor *= max(excess, 1.0) * SPARE
        coarse = _coarse(motion, system, factor * asked, ramp)
        if coarse is not None and _Run(robot, system, coarse, start).failure is None:
            longer = factor * asked
            break
    if longer is None and run.distance < NEAR:
        through = _Run(robot, system, run.asked, start, rates=False, apart=False)
        if through.failure is None and through.touched is not None:
            limit, joint = "collision", " and ".join(through.pair)
            margin, time = through.distance - APART, float(run.asked.clock[through.touched])
    if longer is None:
        again = _coarse(motion, system, asked, ramp)
        if again is not None:
            near = place(robot, again, near=run.placement, seed=seed)
            tracked = (c for c in near if _Run(robot, system, again, c).failure is None)
            best = next(tracked, None)
            place_found = best.placement if best else None
    what = {
        "reach": f"the pose is {-1e3 * margin:.3g} mm out of reach",
        "collision": f"{joint} come as near as {1e3 * (margin + APART):.3g} mm",
    }.get(limit, f"{joint} exceeds its limit of {limit} by {-margin:.0%}")
    if longer is not None:
        advice = f"feasible in {longer:.3g} s instead of {asked:.3g} s"
    elif place_found is not None:
        x, y, z = place_found.middle(motion)
        advice = (
            f"feasible with the path's middle at {x:.3f},{y:.3f},{z:.3f} m, turned by "
            f"{np.degrees((place_found.rotation * run.placement.rotation.inv()).magnitude()):.0f}°"
        )
    elif searched:
        advice = "no feasible placement was found: make the path smaller, or slower"
    else:
        advice = "no feasible duration or placement was found near it"
    return InfeasibleMotionError(
        f"{motion.name}: {robot.name} cannot follow it at {time:.3g} s: {what}; {advice}",
        limit=limit,
        joint=joint,
        time=time,
        margin=margin,
        duration=longer,
        placement=place_found,
    )


def _coarse(
    motion: PoseTrajectory, system: ConstraintSystem, duration: float, ramp: float
) -> PoseTrajectory | None:
    """The motion at a lower rate, if its constraints stand that."""
    try:
        return timed(
            motion,
            system,
            duration=duration,
            ramp=ramp,
            time_step=(duration + ramp) / COARSE_SAMPLES,
        )
    except NoslipError:
        return None


def _before(robot: Robot, motion: PoseTrajectory, level: Level) -> Placement:
    """The placement that is shown when none was found: the path's middle at the home posture."""
    where, _ = robot.forward(robot.home)
    return Placement.of(motion, where, level=level)
