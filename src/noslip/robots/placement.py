"""Where the work lies before the arm, and how the arm stands there, so that a motion is feasible.

A placement is tried by leading the tool, from the path's middle to both of its ends, along a few
dozen samples with damped least squares; what is left of every limit there is its margin.  Random
placements and postures are tried, and the best handed on: only tracking the whole motion
(:func:`noslip.robots.track`) tells whether one is feasible.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.robots.kinematics import APART, WEIGHTS, InverseKinematics
from noslip.robots.model import NEAR, Robot
from noslip.trajectory import PoseTrajectory

Level = Literal["recorded", "tool"]
"""Whether the work keeps the recorded direction of gravity, or lies as the tool at home."""
SAMPLES = 30
"""Of the path at which a placement is judged: the whole is tracked afterwards."""
CANDIDATES = 200
"""Placements or postures tried, at random: more are surer and slower."""
IMPROVED, IMPROVEMENTS = 3, 40
"""Placements that are improved by small moves, and how many of these are tried with each: the best
are worth more of the search than the rest."""
POSTURES = 24
"""Postures tried for a placement that is given: more than the sixteen in which six joints may reach
a pose."""
CLOSE = 1e-4
"""Pose (m, rad over the lever) at which a sample is reached: a tenth of a millimeter, as for the
tracking."""
DAMPING = 1e-4
"""Of the normal equations: past a singular posture, steps stay short."""
MOST_STEPS, FIRST_STEPS = 8, 60
"""Iterations to a sample from its neighbor, and to the first from anywhere."""
LARGEST_STEP = 0.3
"""Of a joint in one iteration (rad): beyond, the linearization points elsewhere."""
PULL = 0.05
"""Share of the way to the middle of their ranges that free joints go in an iteration: little, so
that the pose is still reached."""
SHARE_OF_RANGE = 0.35
"""Of each joint's range, on either side of its middle, that random postures are drawn from: room is
left to move."""
FRONT, CLEARANCE = np.radians(60), 0.8
"""Where work lies unless told: this far to either side of the tool at home, and from the base's
axis at least this share of the tool's distance at home."""
FIRST_MOVE = 0.15
"""Of an improvement (m, and twice that in rad): as large as a hand's work; later moves are
smaller."""
DRAWS = 100
"""Postures drawn, at most, for one that reaches there: a search for what is out of reach ends."""


@dataclass(frozen=True, eq=False)
class Placement:
    """Where the motion's world lies, seen from the arm's base: ``p_base = R p + position``.

    Attributes
    ----------
    position : array, shape (3,)
        Meters.
    rotation : Rotation
    """

    position: Floats
    rotation: Rotation

    @classmethod
    def of(
        cls,
        motion: PoseTrajectory,
        middle: ArrayLike,
        *,
        yaw: float = 0.0,
        level: Level = "recorded",
    ) -> Placement:
        """Place a motion by the middle of its path.

        Parameters
        ----------
        motion : PoseTrajectory
        middle : array, shape (3,)
            Where the middle of the path's box comes to lie (m, the base's frame).
        yaw : float
            Turn about the vertical (rad).
        level : "recorded" or "tool"
            Whether the motion's z axis is vertical, or first turned such that the tool is, on
            average, upright: for recordings whose tracker stood askew.

        Raises
        ------
        InputError
            If a number is not finite.
        """
        if level not in ("recorded", "tool"):
            raise InputError(f"level must be 'recorded' or 'tool', got {level!r}")
        turn = Rotation.from_rotvec([0, 0, _arguments.finite("yaw", yaw)])
        if level == "tool":
            turn = turn * _upright(motion)
        return cls(_arguments.vector("placement", middle) - turn.apply(_center(motion)), turn)

    def apply(self, motion: PoseTrajectory) -> PoseTrajectory:
        """Return a motion as the arm's base sees it."""
        return PoseTrajectory(
            times=motion.times,
            positions=self.rotation.apply(motion.positions) + self.position,
            rotations=self.rotation * motion.rotations,
            linear_velocities=self.rotation.apply(motion.linear_velocities),
            angular_velocities=self.rotation.apply(motion.angular_velocities),
            name=motion.name,
            channels=motion.channels,
        )

    def undo(self, motion: PoseTrajectory) -> PoseTrajectory:
        """Return a motion of the base's frame as the motion's own world sees it."""
        back = self.rotation.inv()
        return Placement(-back.apply(self.position), back).apply(motion)

    def middle(self, motion: PoseTrajectory) -> Floats:
        """Where the middle of a motion's path lies (m, the base's frame)."""
        return np.asarray(self.rotation.apply(_center(motion)) + self.position)

    def numbers(self, motion: PoseTrajectory, level: Level = "recorded") -> tuple[Floats, float]:
        """Middle (m) and yaw (rad) from which :meth:`of` makes this placement of a motion."""
        turn = self.rotation
        if level == "tool":
            turn = turn * _upright(motion).inv()
        return self.middle(motion), float(turn.as_rotvec()[2])

    @property
    def yaw(self) -> float:
        """Heading of the motion's x axis about the vertical (rad)."""
        x = self.rotation.apply([1.0, 0.0, 0.0])
        return float(np.arctan2(x[1], x[0]))


@dataclass(frozen=True, eq=False)
class Candidate:
    """A placement and posture that a few samples of the path let pass.

    Attributes
    ----------
    placement : Placement
    start : array, shape (n,)
        Of the joints, at the motion's start.
    margin : float
        Smallest of the margins, 1 is far and 0 at a limit.
    """

    placement: Placement
    start: Floats
    margin: float


def _center(motion: PoseTrajectory) -> Floats:
    """Middle of the box around a path."""
    return np.asarray((motion.positions.min(axis=0) + motion.positions.max(axis=0)) / 2)


def place(
    robot: Robot,
    motion: PoseTrajectory,
    *,
    level: Level = "recorded",
    near: Placement | None = None,
    candidates: int = CANDIDATES,
    seed: int = 0,
) -> list[Candidate]:
    """Search for placements at which an arm has most to spare.

    Parameters
    ----------
    robot : Robot
    motion : PoseTrajectory
        Of the tool, timed as it is to be executed.
    level : "recorded" or "tool"
        See :meth:`Placement.of`.
    near : Placement, optional
        Search around this one, farther and farther away, instead of everywhere.
    candidates : int
        How many are tried.
    seed : int
        The same seed finds the same placements.

    Returns
    -------
    list of Candidate
        The best first; around a placement the nearest first.  Empty if none was feasible.
    """
    search = _Search(robot, motion)
    random = np.random.default_rng(_seed(seed))
    found = []
    for k in range(_arguments.count("candidates", candidates)):
        posture = search.random_posture(random)
        if near is None:
            posture = search.posture_in_front(random)
            where, _ = robot.forward(posture)
            yaw = random.uniform(-np.pi, np.pi)
            placement = Placement.of(motion, where, yaw=yaw, level=level)
        else:
            placement = _moved(near, motion, random, 0.4 * (k + 1) / candidates)
        tried = search.attempt(placement, posture)
        if tried is not None:
            found.append(tried)
            if near is not None and len(found) == 3:
                return found
    if near is not None or not found:
        return found
    found.sort(key=lambda one: -one.margin)
    return search.improved(found[:IMPROVED], motion, random) + found[IMPROVED:]


def postures(
    robot: Robot,
    motion: PoseTrajectory,
    placement: Placement,
    *,
    candidates: int = POSTURES,
    seed: int = 0,
) -> list[Candidate]:
    """Search for postures with which an arm follows a motion that is placed; the best first."""
    search = _Search(robot, motion)
    random = np.random.default_rng(_seed(seed))
    drawn = [robot.home, *(search.random_posture(random) for _ in range(candidates - 1))]
    tried = (search.attempt(placement, posture) for posture in drawn)
    return sorted((one for one in tried if one is not None), key=lambda one: -one.margin)


class _Search:
    """Tries placements of one motion."""

    def __init__(self, robot: Robot, motion: PoseTrajectory) -> None:
        self.robot = robot
        picked = np.unique(np.linspace(0, len(motion) - 1, SAMPLES).round().astype(int))
        self.times = motion.times[picked]
        self.positions = motion.positions[picked]
        self.rotations = motion.rotations[picked]
        self.ik = InverseKinematics(robot)
        ranged = np.isfinite(robot.upper - robot.lower)
        self.half = np.where(ranged, robot.upper - robot.lower, 2 * np.pi) / 2
        with np.errstate(invalid="ignore"):
            middle = (robot.upper + robot.lower) / 2
        self.middle = np.where(ranged, middle, robot.home)
        self.ik.move(robot.home)
        self.usual = max(self.ik.manipulability(), 1e-6)
        self.at_home = self.ik.position.copy()

    def random_posture(self, random: np.random.Generator) -> Floats:
        spread = SHARE_OF_RANGE * 2 * self.half
        return self.middle + spread * random.uniform(-1, 1, self.robot.size)

    def posture_in_front(self, random: np.random.Generator) -> Floats:
        """Random posture whose tool is where work may lie."""
        posture = self.robot.home
        for _ in range(DRAWS):
            posture = self.random_posture(random)
            self.ik.move(posture)
            if self._in_front(self.ik.position):
                break
        return posture

    def _in_front(self, position: Floats) -> bool:
        home = self.at_home[:2]
        far, usual = float(np.linalg.norm(position[:2])), float(np.linalg.norm(home))
        if far < CLEARANCE * usual:
            return False
        return bool(position[:2] @ home >= np.cos(FRONT) * far * usual)

    def improved(
        self, found: list[Candidate], motion: PoseTrajectory, random: np.random.Generator
    ) -> list[Candidate]:
        """Candidates moved to where more is left, by smaller and smaller steps; best first."""
        better = []
        for one in found:
            for k in range(IMPROVEMENTS):
                placement = _moved(one.placement, motion, random, FIRST_MOVE * 0.95**k)
                if not self._in_front(placement.middle(motion)):
                    continue
                tried = self.attempt(placement, one.start)
                if tried is not None and tried.margin > one.margin:
                    one = tried
            better.append(one)
        return sorted(better, key=lambda one: -one.margin)

    def attempt(self, placement: Placement, posture: Floats) -> Candidate | None:
        """Follow the path from its middle both ways; None where the arm cannot."""
        positions = placement.rotation.apply(self.positions) + placement.position
        quaternions = (placement.rotation * self.rotations).as_quat(scalar_first=True)
        count, half_way = len(positions), len(positions) // 2
        path = np.empty((count, self.robot.size))
        distance, able = NEAR, np.inf
        orders = (range(half_way, count), range(half_way - 1, -1, -1))
        for order in orders:
            q = posture if order[0] == half_way else path[half_way]
            for k in order:
                steps = FIRST_STEPS if k == half_way else MOST_STEPS
                reached = self.reach(q, positions[k], quaternions[k], steps)
                if reached is None:
                    return None
                q = path[k] = reached
                nearest, _ = self.ik.nearest()
                if nearest < APART:
                    return None
                distance, able = min(distance, nearest), min(able, self.ik.manipulability())
        spline = scipy.interpolate.CubicSpline(self.times, path)
        inner = np.linspace(self.times[0], self.times[-1], 4 * count)
        margin = min(
            float(self.robot.room(path).min()),
            1 - float((np.abs(spline(inner, 1)) / self.robot.velocity_limits).max()),
            1 - float((np.abs(spline(inner, 2)) / self.robot.acceleration_limits).max()),
            (distance - APART) / (NEAR - APART),
            able / self.usual,
        )
        return Candidate(placement, path[0], margin) if margin > 0 else None

    def reach(self, q: Floats, position: Floats, quaternion: Floats, steps: int) -> Floats | None:
        """Joint positions near q that bring the tool to a pose; None if they are not found."""
        for _ in range(steps):
            self.ik.move(q)
            error = self.ik.error(position, quaternion)
            if np.abs(WEIGHTS * error).max() <= CLOSE:
                return q
            q = damped_step(self.robot, self.ik, q, error, PULL * (self.middle - q))
        return None


def damped_step(
    robot: Robot, ik: InverseKinematics, q: Floats, error: Floats, pull: Floats
) -> Floats:
    """Joint positions nearer to a pose: damped least squares, with a pull on what is free."""
    weighted = WEIGHTS * error
    J = WEIGHTS[:, None] * ik.jacobian
    normal = J @ J.T
    normal.flat[::7] += DAMPING * min(1.0, float(weighted @ weighted) + 1e-3)
    change = J.T @ np.linalg.solve(normal, weighted - J @ pull) + pull
    change *= min(1.0, LARGEST_STEP / max(float(np.abs(change).max()), 1e-12))
    return np.clip(q + change, robot.lower, robot.upper)


def exact_start(
    robot: Robot, ik: InverseKinematics, q: Floats, position: Floats, quaternion: Floats
) -> Floats:
    """Joint positions next to q that bring the tool exactly to a pose, or as near as they can."""
    still = np.zeros(robot.size)
    for _ in range(FIRST_STEPS):
        ik.move(q)
        error = ik.error(position, quaternion)
        if np.abs(error).max() <= CLOSE:
            change = np.linalg.lstsq(ik.jacobian, error, rcond=1e-6)[0]
            if np.abs(change).max() <= 1e-13:
                break
            q = np.clip(q + change, robot.lower, robot.upper)
        else:
            q = damped_step(robot, ik, q, error, still)
    return q


def _moved(
    near: Placement, motion: PoseTrajectory, random: np.random.Generator, far: float
) -> Placement:
    """Return a placement that lies up to so far (m, and twice that in rad) from another."""
    turn = Rotation.from_rotvec([0, 0, 2 * far * random.uniform(-1, 1)])
    middle = near.middle(motion)
    moved = middle + far * random.uniform(-1, 1, 3)
    return Placement(turn.apply(near.position - middle) + moved, turn * near.rotation)


def _upright(motion: PoseTrajectory) -> Rotation:
    """Shortest turn that brings the tool's mean z axis to the vertical."""
    mean = motion.rotations.apply([0.0, 0.0, 1.0]).mean(axis=0)
    size = float(np.linalg.norm(mean))
    if size < 1e-3:
        raise InputError(
            f"{motion.name}: the tool's z axis has no mean direction; use level='recorded'"
        )
    mean = mean / size
    axis = np.cross(mean, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return Rotation.from_rotvec([0.0 if mean[2] > 0 else np.pi, 0.0, 0.0])
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, mean[2]))


def _seed(seed: int) -> int:
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise InputError(f"seed must be a whole number, 0 or more, got {seed!r}")
    return int(seed)
