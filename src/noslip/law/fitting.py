"""Demonstrations -> a law."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from noslip import _arguments
from noslip._typing import Floats
from noslip.bodies import Bodies
from noslip.errors import InputError
from noslip.law import points as points_of
from noslip.law.attractor import Attractor
from noslip.law.basis import Basis
from noslip.law.clock import Clock, Cycle, Phase
from noslip.law.forcing import RIDGE, ForcingTerm
from noslip.law.law import Law
from noslip.law.points import Goal
from noslip.space import POSE, Space
from noslip.timed import Timed
from noslip.trajectory import PoseTrajectory
from noslip.vectors import Trajectory

Recorded = PoseTrajectory | Trajectory | Bodies
"""What a law is learned from."""
SAMPLES_PER_BASIS_FUNCTION = 4
"""A demonstration with fewer samples is splined to a multiple of its own before fitting: with fewer
a function is not told from its neighbors, and a plan on longer steps ends more than 1e-5 of the
path off where shorter ones run it."""
_ONCE = Phase()
MOST_BASIS_FUNCTIONS = 2000
"""More take minutes to fit, and follow nothing that a recording holds."""
FEWEST_STEPS = 200
"""A rollout takes at least this many steps unless asked otherwise: its error is then 3e-5 of the
path."""


def fit(
    demonstrations: Recorded | Iterable[Recorded],
    *,
    basis_functions: int = 100,
    alpha: float = 25.0,
    beta: float = 6.25,
    alpha_s: float = 1.0,
    ridge: float = RIDGE,
    rhythmic: bool = False,
) -> Law:
    """Fit one law to one demonstration or several, by ridge regression.

    Each demonstration is taken over its own duration and to its own goal; the law gets their mean
    start, goal and duration.

    Parameters
    ----------
    demonstrations : PoseTrajectory, Trajectory, Bodies, or several of one kind
        Any rate and start time; irregular ones are splined to their median rate, short ones
        to 4 samples a basis function.
    basis_functions : int
    alpha, beta, alpha_s : float
        The paper's constants, 25, 6.25 and 1 by default.
    ridge : float
        Regularization, relative to the basis functions' mean square.
    rhythmic : bool
        Whether each demonstration is one period of a cycle, its last sample the first again.

    Raises
    ------
    InputError
        If there is no demonstration or a constant is out of range.
    """
    recorded = as_demonstrations(demonstrations)
    basis_functions = _arguments.count("basis_functions", basis_functions, MOST_BASIS_FUNCTIONS)
    ridge = _arguments.not_negative("ridge", ridge)
    basis = Basis(basis_functions, Cycle() if rhythmic else Phase(alpha_s))
    attractor = Attractor(alpha, beta)
    space = recorded[0].space
    sampled = [evenly_sampled(d, basis_functions).points for d in recorded]
    goal = (points_of.around if rhythmic else points_of.goal)(space, sampled)
    forces = [
        demonstrated_forces(attractor, goal, points, space, basis.phase) for points in sampled
    ]
    forcing = ForcingTerm.fit(basis, attractor, forces, ridge=ridge)
    velocities = [_start_velocity(attractor, forcing, goal, points, space) for points in sampled]
    return Law(
        attractor,
        forcing,
        points_of.mean(space, [points[0] for points in sampled]),
        np.mean(velocities, axis=0),
        goal,
        float(np.mean([d.duration for d in recorded])),
        default_steps(recorded[0], basis_functions),
        space=space,
    )


def demonstrated_forces(
    attractor: Attractor, goal: Goal, points: Floats, space: Space = POSE, clock: Clock = _ONCE
) -> Floats:
    """Forces under which the steps reproduce a demonstration, led to its own end.

    Parameters
    ----------
    points : array, shape (N, n + 4 b)
        Evenly spaced from its first sample to its last.
    clock : Clock
        Which says of which samples the force is known: of a cycle, of all.

    Returns
    -------
    array, shape (N - 2, n + 3 b), or (N - 1, n + 3 b) of a cycle
        Time normalized by the duration.
    """
    fraction = 1.0 / (len(points) - 1)
    velocities = space.difference(points[1:], points[:-1]) / fraction
    first, count = clock.sampled(len(velocities))
    # The step before the first sample of a cycle is its last one.
    before = np.roll(velocities, 1, axis=0)[first : first + count]
    pull = attractor.demonstrated_pull(before, velocities[first : first + count], fraction)
    own = own_goal(goal, points, space, clock)
    led = goal.pull(points, attractor, len(points) - 1, own, 0.0 if first else fraction)
    return attractor.stiffness * (pull - led[first : first + count])


def own_goal(goal: Goal, points: Floats, space: Space, clock: Clock) -> Floats:
    """What a demonstration is drawn to: where it ends, or what its cycle goes around."""
    if not clock.returns:
        return np.asarray(points[-1])
    own = points_of.baseline(space, points)
    for k, winding in enumerate(goal.windings):
        if len(winding.quaternions) > 1:
            at = space.linear + 4 * k
            own[at : at + 4] = winding.quaternions[-1]
    return own


def _start_velocity(
    attractor: Attractor, forcing: ForcingTerm, goal: Goal, points: Floats, space: Space
) -> Floats:
    """Velocity, per duration, with which the first step is the demonstrated one."""
    fraction = 1.0 / (len(points) - 1)
    end = own_goal(goal, points, space, forcing.basis.phase)
    pull = goal.pull(points, attractor, 1, end)[0]
    pull = pull + forcing.at_start(fraction, attractor) / attractor.stiffness
    first = space.difference(points[1:2], points[:1])[0] / fraction
    return attractor.demonstrated_start(pull, first, fraction)


def as_demonstrations(demonstrations: Recorded | Iterable[Recorded]) -> list[PoseTrajectory]:
    """Return a list of demonstrations, checked: all of one space."""
    if isinstance(demonstrations, Timed):
        recorded: list[Any] = [demonstrations]
    else:
        try:
            recorded = list(demonstrations)
        except TypeError:
            recorded = [demonstrations]
    for item in recorded:
        if not isinstance(item, Timed):
            raise InputError(
                "demonstrations are PoseTrajectory, Trajectory or Bodies objects, got "
                f"{type(item).__name__}; read files with load_demonstrations, make arrays "
                "Trajectory(times, values)"
            )
        if item.space != recorded[0].space:
            both = (", ".join(each.space.coordinates) for each in (recorded[0], item))
            raise InputError(
                f"{recorded[0].name} and {item.name} move in different spaces ({' and '.join(both)}"
                f"; {recorded[0].space.rotations} and {item.space.rotations} rotations); learn one "
                "primitive of each kind"
            )
    if not recorded:
        raise InputError("no demonstration given; at least one is needed")
    return recorded


def evenly_sampled(demonstration: PoseTrajectory, basis_functions: int) -> PoseTrajectory:
    """Return a demonstration with a sample a step of its default rollout.

    The first and the last sample stay where they are.
    """
    count = default_steps(demonstration, basis_functions) + 1
    if demonstration.is_uniform and len(demonstration) == count:
        return demonstration
    times = np.linspace(demonstration.times[0], demonstration.times[-1], count)
    return demonstration.resampled(times=times)


def default_steps(demonstration: PoseTrajectory, basis_functions: int) -> int:
    """Return the demonstration's own number of steps, multiplied until there are enough.

    What is planned on the steps that are run ends where it was planned to end.
    """
    own = max(len(demonstration) - 1, round(demonstration.duration / demonstration.period))
    return own * -(-fewest_steps(basis_functions) // own)


def fewest_steps(basis_functions: int) -> int:
    """Return how many steps a motion takes at least unless asked otherwise."""
    return max(FEWEST_STEPS, SAMPLES_PER_BASIS_FUNCTION * basis_functions)
