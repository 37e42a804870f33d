"""Motions that every generator is to reproduce, and what must not slip in them."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

import noslip as ns
from benchmarks.feedback.poses import Floats, Pose
from benchmarks.perturbation import RECORDINGS

X, Y, Z = np.eye(3)
NOMINAL_STEPS = 4000
"""Of the path that executed ones are compared with."""


class Task:
    """A primitive as learned.

    Parameters
    ----------
    name : str
    dmp : ConstrainedDMP
    body_axes, world_axes : arrays, shape (3,)
        Directions in which the tool must not move.

    Attributes
    ----------
    duration, length : float
        Of its own motion (s, m).
    path : array, shape (N, 3)
        Densely.
    start, goal : Pose
    """

    def __init__(
        self,
        name: str,
        dmp: ns.ConstrainedDMP,
        body_axes: tuple[Floats, ...],
        world_axes: tuple[Floats, ...] = (),
    ) -> None:
        self.name, self.dmp = name, dmp
        self.body_axes, self.world_axes = body_axes, world_axes
        motion = dmp.rollout(time_step=dmp.duration / NOMINAL_STEPS)
        self.duration, self.length = dmp.duration, motion.path_length
        self.path = motion.positions
        self.start, self.goal = (
            Pose(motion.positions[k], motion.quaternions[k].copy()) for k in (0, -1)
        )
        self._peaks: dict[float, Floats] = {}

    def peaks(self, period: float) -> Floats:
        """Linear and angular speed, then accelerations, at most, in cycles of a period (s)."""
        if period not in self._peaks:
            motion = self.dmp.rollout(time_step=period)
            # The last step is shorter.
            rates = np.stack([motion.linear_velocities[1:-1], motion.angular_velocities[1:-1]])
            changes = np.diff(rates, axis=1) / period
            self._peaks[period] = np.concatenate(
                [np.linalg.norm(values, axis=2).max(axis=1) for values in (rates, changes)]
            )
        return self._peaks[period]


def eased(s: Floats) -> Floats:
    """Rise from 0 to 1 at rest at both ends, over s from 0 to 1."""
    return np.asarray(s**3 * (10 - 15 * s + 6 * s * s))


def s_cut() -> Task:
    """A blade along an S of 0.1 m in 2 s."""
    s = np.linspace(0, 1, 201)
    a = eased(s)
    path = np.column_stack([0.1 * a, 0.02 * np.sin(2 * np.pi * a), 0 * a])
    heading = np.unwrap(np.arctan2(0.04 * np.pi * np.cos(2 * np.pi * a), 0.1))
    turns = Rotation.from_euler("z", heading[:, None])
    return Task("s-cut", ns.learn(ns.PoseTrajectory(2 * s, path, turns), ns.Blade()), (Y,))


def needle() -> Task:
    """A flexible needle on its way around a bend that is no plane's: 0.1 m in 3 s."""
    return Task("needle", ns.learn(_bent(curvature=5.0, roll=np.pi), ns.Needle()), (Y, Z))


def beveled_needle() -> Task:
    """The same way by a beveled tip, which is rolled by half a turn."""
    motion = _bent(curvature=5.0, roll=np.pi)
    return Task("beveled needle", ns.learn(motion, ns.Needle(curvature=5.0)), (Y, Z))


def _bent(curvature: float, roll: float) -> ns.PoseTrajectory:
    """Along x of a body that turns about its z axis with its way, and about x in time."""
    s = np.linspace(0, 1, 601)
    pushed, rolled = 0.1 * np.diff(eased(s)), roll * np.diff(eased(s))
    positions, turns = [np.zeros(3)], [Rotation.identity()]
    for way, turn in zip(pushed, rolled, strict=True):
        body = np.array([turn, 0.0, curvature * way])
        middle = turns[-1] * Rotation.from_rotvec(body / 2)
        positions.append(positions[-1] + way * middle.apply(X))
        turns.append(turns[-1] * Rotation.from_rotvec(body))
    return ns.PoseTrajectory(3 * s, np.array(positions), Rotation.concatenate(turns))


def wheel() -> Task:
    """A vehicle around a bend and back: 1.1 m in 4 s."""
    s = np.linspace(0, 1, 401)
    a = eased(s)
    path = np.column_stack([a, 0.15 * (1 - np.cos(2 * np.pi * a)), 0 * a])
    heading = np.arctan2(0.3 * np.pi * np.sin(2 * np.pi * a), 1.0)
    turns = Rotation.from_euler("z", heading[:, None])
    motion = ns.PoseTrajectory(4 * s, path, turns)
    return Task("wheel", ns.learn(motion, ns.Wheel()), (Y,), (Z,))


def _contour(name: str) -> Task:
    (recording,) = ns.load_demonstrations(RECORDINGS / f"data_demo_{name}.csv")
    motion = ns.prepare(recording, trim_speed=0.05, rate=120, lowpass=4.8)
    return Task(f"contour {name}", ns.learn(motion, ns.Blade()), (Y,))


TASKS: dict[str, Callable[[], Task]] = {
    "s-cut": s_cut,
    "contour a_1": lambda: _contour("a_1"),
    "contour c_1": lambda: _contour("c_1"),
    "needle": needle,
    "beveled needle": beveled_needle,
    "wheel": wheel,
}


KEEPS_ITS_GOAL = "beveled needle"
"""No motion leads it to a goal that steps aside late but one that draws it back first."""


@lru_cache
def task(name: str) -> Task:
    """One of the tasks, learned once in each process."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ns.NoslipWarning)
        return TASKS[name]()


def missing(name: str) -> str:
    """Why a task cannot be run here; empty if it can."""
    if name.startswith("contour") and not RECORDINGS.is_dir():
        return f"{name} is left out: there are no recordings in {RECORDINGS}"
    return ""
