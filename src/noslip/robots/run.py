"""One candidate of posture and placement, tracked along a motion until it ends or fails."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np
import scipy
from scipy.spatial.transform import Slerp

from noslip._typing import Floats
from noslip.constraints.system import ConstraintSystem
from noslip.robots.executed import Margins, TrackedMotion
from noslip.robots.kinematics import APART, Chord, InverseKinematics, Solved
from noslip.robots.model import Robot
from noslip.robots.placement import Candidate, exact_start
from noslip.trajectory import PoseTrajectory

RESTING = 1e-3
"""Speed of joints at rest (rad/s): a meter away, a millimeter a second."""
SETTLING = 0.3
"""Time before the end over which free joints come to rest (s): longer than the ramp."""
POSITION_TOLERANCE, ROTATION_TOLERANCE = 1e-4, np.radians(0.05)
"""Largest error of a tracked pose (m, rad): what such an arm repeats."""
LONGEST = 3.0
"""Of a motion whose clock may wait, over its own duration: one that takes longer is stuck."""


class Run:
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
        self.spent: list[float] = []
        if self._lost(ik.error(*targets[0])):
            self.failure = self._of_reach(0, q, ik.error(*targets[0]))
            return
        if apart and self.distance < APART:
            self.failure = "collision", " and ".join(self.pair), 0, self.distance - APART
            return
        if not refuse:
            self._fall_behind(q)
            return
        clock = self.clock = placed.clock
        for k in range(1, len(placed)):
            h = clock[k] - clock[k - 1]
            settling = clock[-1] - clock[k] < SETTLING
            solved = self._advance(k, q, x, targets[k], clock[k], h, settling=settling)
            if solved is None:
                return
            q, x = self.joints[k], self.rates[k] = solved.positions, solved.velocities

    @property
    def seconds(self) -> float:
        """Median time of a step's inverse kinematics (s)."""
        return float(np.median(self.spent))

    def _advance(
        self, k: int, q: Floats, x: Floats, target: Any, time: float, h: float, **options: Any
    ) -> Solved | None:
        """Do step k, and note what it came to; without a pace, a lost target is a failure too."""
        ik = self.ik
        here = ik.position.copy(), ik.quaternion.copy()
        began = perf_counter()
        solved = ik.step(q, x, here, target, time, h, **options)
        self.spent.append(perf_counter() - began)
        if solved is None or ("pace" not in options and self._lost(solved.error)):
            self.failure = self._why(k, q, x, here, target, h)
            return None
        if solved.distance < APART and self.touched is None:
            self.touched = k
        if solved.distance < self.distance:
            self.distance, self.pair = solved.distance, solved.pair
        self.able = min(self.able, ik.manipulability())
        return solved

    def _fall_behind(self, q: Floats) -> None:
        """Track the motion at its own pace or, where that is too fast, slower."""
        placed = self.commanded
        end, h = float(placed.clock[-1]), placed.period
        path = scipy.interpolate.CubicSpline(placed.clock, placed.positions)
        turns = Slerp(placed.clock, placed.rotations)
        clock, x = 0.0, np.zeros(self.robot.size)
        joints, rates, clocks = [q], [x], [clock]
        for k in range(1, int(LONGEST * len(placed))):
            ahead = min(clock + h, end)
            poses = turns([clock, ahead])
            target = path(ahead), poses[1].as_quat(scalar_first=True)
            moved = path(ahead) - path(clock)
            turned = (poses[1] * poses[0].inv()).as_rotvec()
            pace = np.concatenate([moved, turned]) / h
            settling = end - clock < SETTLING
            solved = self._advance(k, q, x, target, k * h, h, pace=pace, settling=settling)
            if solved is None:
                return
            clock += (1 - solved.waited) * (ahead - clock)
            q, x = solved.positions, solved.velocities
            joints.append(q)
            rates.append(x)
            clocks.append(clock)
            if end - clock < h / 2 and np.abs(x).max() <= RESTING:
                break
        self.joints, self.rates, self.clock = np.array(joints), np.array(rates), np.array(clocks)
        # At equal times: the motion as it was asked for waits at its end.
        times: Floats = h * np.arange(float(len(joints)))
        asked = np.minimum(times, end)
        beside = placed.channels and placed.channels.between(placed.times[0] + asked, times)
        self.commanded = PoseTrajectory(
            times, path(asked), turns(asked), name=placed.name, channels=beside
        )

    @staticmethod
    def _lost(error: Floats) -> bool:
        return bool(
            np.linalg.norm(error[:3]) > POSITION_TOLERANCE
            or np.linalg.norm(error[3:]) > ROTATION_TOLERANCE
        )

    def _of_reach(self, k: int, q: Floats, error: Floats) -> tuple[str, str, int, float]:
        """Out of reach; the joint is the one that is nearest to its range's end."""
        joint = self.robot.joint_names[int(np.argmin(self.robot.room(q)))]
        return "reach", joint, k, -float(np.linalg.norm(error[:3]))

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
            self.commanded.times,
            positions,
            rotations,
            name=f"{robot.name}, kinematic",
            channels=self.commanded.channels,
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
            "position": robot.room(self.joints),
            "velocity": 1 - np.abs(self.rates) / robot.velocity_limits,
            "acceleration": 1 - np.abs(np.diff(self.rates, axis=0)) / h / robot.acceleration_limits,
        }
        found: dict[str, Any] = {}
        for kind, share in shares.items():
            least = share.min(axis=0)
            found[kind] = float(least.min())
            found[f"{kind}_joint"] = robot.joint_names[int(np.argmin(least))]
        return Margins(**found, distance=self.distance, pair=self.pair, manipulability=self.able)
