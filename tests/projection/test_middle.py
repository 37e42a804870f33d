"""What the middle of the step is for: feasible motions are found, left and made feasible.

At any rate of a recording, at any step of a rollout, and between its samples.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

import noslip as ns
from learned import Goal, cutting, numerical
from measures import apart, degrees, residuals
from motions import cut
from noslip._typing import Floats
from noslip.constraints import InMovingFrame, Instant

RATES = [20.0, 28.6, 100.0, 1000.0]
"""Of recordings (Hz), slow cameras and fast controllers among them."""
BELT = InMovingFrame(ns.Blade(), amplitude=(0, 0, 0), velocity=(0, 0.3, 0))

Exact = tuple[ns.PoseTrajectory, ns.Constraint]


def top_speed(motion: ns.PoseTrajectory) -> float:
    return float(np.linalg.norm(motion.step_velocities()[0], axis=1).max())


# -------------------------------------------------------------------- exactly feasible motions


def samples(rate: float, duration: float = 2.1) -> Floats:
    return np.arange(round(duration * rate) + 1) / rate


def circle(rate: float) -> Exact:
    """A blade tangent to its circle."""
    t = samples(rate)
    turn = 2.5 * t
    path = 0.3 * np.column_stack([np.sin(turn), 1 - np.cos(turn), 0 * turn])
    return ns.PoseTrajectory(t, path, Rotation.from_euler("z", turn[:, None])), ns.Blade()


def on_a_belt(rate: float) -> Exact:
    """The circle, on a belt."""
    motion, _ = circle(rate)
    carried = motion.positions + np.outer(motion.times, BELT.velocity)
    return ns.PoseTrajectory(motion.times, carried, motion.rotations), BELT


def helix(rate: float) -> Exact:
    """A needle of constant twists in its own frame, along the chords of a helix."""
    t, radius, turning, climbing = samples(rate), 0.2, 2.0, 0.1
    turn = turning * t
    path = np.column_stack([radius * np.sin(turn), radius * (1 - np.cos(turn)), climbing * t])
    speed = float(np.linalg.norm(path[1] - path[0])) * rate
    pitch = np.arcsin(climbing / speed)
    held = Rotation.from_euler("ZY", np.column_stack([turn, np.full_like(turn, -pitch)]))
    needle = ns.Needle(curvature=float(turning * np.cos(pitch) / speed))
    return ns.PoseTrajectory(t, path, held), needle


exactly_feasible = pytest.mark.parametrize("feasible", [circle, on_a_belt, helix])


@exactly_feasible
@pytest.mark.parametrize("rate", RATES)
def test_an_exactly_feasible_motion_is_found_feasible_at_any_rate(
    feasible: Callable[[float], Exact], rate: float
) -> None:
    motion, constraint = feasible(rate)
    assert ns.check(motion, constraint).peak <= 1e-9 * top_speed(motion)


@exactly_feasible
@pytest.mark.parametrize("rate", RATES)
def test_an_exactly_feasible_motion_is_projected_onto_itself(
    feasible: Callable[[float], Exact], rate: float
) -> None:
    motion, constraint = feasible(rate)
    moved, turned = apart(ns.project_trajectory(motion, constraint).trajectory, motion)
    assert moved <= 1e-12
    assert np.radians(turned) <= 1e-9


def tangent_cut(rate: float) -> ns.PoseTrajectory:
    """An S-cut of 132 mm in 2 s, its edge along the tangent at each sample."""
    t = samples(rate, 2.0)
    length, side, turn = 0.12, 0.0128, np.pi * t
    path = np.column_stack([length * t / 2, side * np.sin(turn), 0 * t])
    heading = np.arctan2(2 * np.pi * side * np.cos(turn), length)
    return ns.PoseTrajectory(t, path, Rotation.from_euler("z", heading[:, None]))


def test_a_tangent_cut_slips_by_the_square_of_its_step() -> None:
    """What a chord and the tangent in its middle differ by."""
    assert tangent_cut(1000.0).path_length == pytest.approx(0.132, abs=1e-3)
    peaks = np.array([ns.check(tangent_cut(28.6 * 2**k), ns.Blade()).peak for k in range(4)])
    assert peaks[0] <= 2e-4
    assert np.all(np.diff(np.log2(peaks)) <= -1.9), peaks


# -------------------------------------------------------------------- rollouts


@cache
def needle() -> ns.ConstrainedDMP:
    return ns.learn(cut(), [ns.Needle(curvature=None)], basis_functions=40)


@cache
def belted() -> ns.ConstrainedDMP:
    return ns.learn(cut(), [BELT], basis_functions=40)


@ns.velocity_constraint
def rolling_less(motion: Instant) -> Any:
    """A roll in proportion to how fast the tool moves aside, by less and less along x."""
    return (0.5 - motion.position[0]) * motion.linear_velocity[1] - 0.1 * motion.angular_velocity[0]


@cache
def of_ones_own() -> ns.ConstrainedDMP:
    """Under a rule of which the position holds nothing somewhere."""
    dmp = ns.learn(cut(), [rolling_less], basis_functions=40)
    assert dmp.rule.inverse_metric[3] > 0
    return dmp


Learned = Callable[[], ns.ConstrainedDMP]


@pytest.mark.parametrize("learned", [numerical, cutting, needle, belted, of_ones_own])
@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_each_step_of_a_rollout_holds_in_its_middle(learned: Learned, step: float) -> None:
    dmp = learned()
    motion = dmp.rollout(time_step=step)
    top = top_speed(motion)
    assert np.abs(motion.constraint_residuals).max() <= 1e-12 * top
    # Computed again from the poses alone, whose rounding a step is divided by.
    found = residuals(motion, dmp.rule.system.constraints)
    assert np.abs(found).max() <= 1e-12 * top + 1e-14 / step


def splined_slip(motion: ns.PoseTrajectory) -> float:
    """Most slip (m/s) of a blade between its samples, at 10 kHz."""
    t = np.arange(motion.times[0], motion.times[-1], 1e-4)
    velocities = CubicSpline(motion.times, motion.positions)(t, 1)
    lateral = RotationSpline(motion.times, motion.rotations)(t).apply([0, 1, 0])
    return float(np.abs(np.sum(lateral * velocities, axis=1)).max())


@pytest.mark.parametrize("learned", [cutting, numerical])
def test_between_its_samples_a_rollout_slips_by_the_square_of_its_step(learned: Learned) -> None:
    steps = np.array([10e-3, 5e-3, 2e-3])
    slips = np.array([splined_slip(learned().rollout(time_step=h)) for h in steps])
    orders = np.diff(np.log(slips)) / np.diff(np.log(steps))
    assert np.all(orders >= 1.8), (orders, slips)


# -------------------------------------------------------------------- adapted goals


TIMES = np.array([0.1, 1.0, 4.0, 10.0])
"""The learned step, which a rollout's is a multiple of."""


def ends(
    learned: Learned, goals: int = 10, *, farthest: float = 0.5, turned: float = 45.0
) -> tuple[Floats, Floats]:
    """How far rollouts end off random goals, over their paths and in degrees, (goals, TIMES)."""
    dmp, rng = learned(), np.random.default_rng(0)
    length = dmp.rollout().path_length
    moved, turns = np.empty((2, goals, len(TIMES)))
    for i in range(goals):
        goal = Goal.beside(dmp, rng, length, farthest=farthest, turned=turned)
        new = dmp.adapt(goal_position=goal.position, goal_rotation=goal.rotation)
        step = np.diff(new.rollout().times)[0]
        for j, times in enumerate(TIMES):
            motion = new.rollout(time_step=times * step)
            moved[i, j] = np.linalg.norm(motion.positions[-1] - goal.position) / motion.path_length
            turns[i, j] = degrees(motion.rotations[-1], goal.rotation)
    return moved, turns


@pytest.mark.parametrize("learned", [numerical, cutting, needle, of_ones_own])
def test_adapted_goals_are_reached_at_any_step(learned: Learned) -> None:
    """To what the fit leaves up to the learned step, beyond that to the square of the step.

    Four steps at once are 75 for the whole of a bent path of a meter, 250 for the example.
    """
    moved, turned = (errors.max(axis=0) for errors in ends(learned))
    assert np.all(moved[:2] <= 1e-5), moved
    assert np.all(turned[:2] <= 2e-3), turned
    assert moved[2] <= 1e-4, moved
    assert turned[2] <= 2e-2, turned
    for errors in (moved, turned):
        order = np.log(errors[3] / errors[2]) / np.log(TIMES[3] / TIMES[2])
        assert order >= 1.8, errors
