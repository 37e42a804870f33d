"""Rhythms in motion: onto their limit cycle, and other frequencies, amplitudes and baselines."""

from __future__ import annotations

from dataclasses import replace
from math import exp, log

import numpy as np
from numpy.typing import ArrayLike

from noslip import _arguments
from noslip.errors import InputError
from noslip.law.law import Law
from noslip.rule import Rule
from noslip.runtime.rollout import initial_state, rollout, step
from noslip.runtime.state import State

SETTLING = 8
"""Periods: what a start is off the limit cycle falls by exp(-12) in each, to rounding in three."""
_ROUNDS = 3
"""Of so many periods: the first two foretell the cycle, the last one begins on it."""
_SLOWEST = 0.9999
"""Share that a period leaves, beyond which none comes nearer: a blade that may not turn does not
move aside."""
_CORRECTIONS = 8
"""Of the velocity at the start: each leaves what damping takes of it in half a step, a sixteenth or
less of what is missed, of eight of them rounding."""


def settled(law: Law, rule: Rule) -> Law:
    """Return a rhythm that begins on the limit cycle which it comes to under a rule.

    Where constraints leave a motion hardly any way back to its cycle, what is left of the way there
    falls by the same share a period, and is added at once (Aitken 1926).

    Parameters
    ----------
    law : Law
    rule : Rule
    """
    for _ in range(_ROUNDS):
        motion = rollout(law, rule, cycles=SETTLING)
        points = motion.points[:: law.steps]
        after, before = law.space.difference(points[-2:], points[-3:-1])[::-1]
        share = float(after @ before) / max(float(before @ before), 1e-300)
        left = after * share / (1 - share) if 0 < share < _SLOWEST else np.zeros_like(after)
        point = law.space.moved(points[-1], left)
        velocities = motion.linear_velocities, motion.angular_velocities
        first = np.concatenate([v[-law.steps] for v in velocities])
        law = replace(law, start=point)
        for _ in range(_CORRECTIONS):
            # The rule takes something of it at the start, and something else in the first step.
            begun = step(law, rule, initial_state(law, rule), law.duration / law.steps)
            missed = first - np.concatenate([begun.linear_velocity, begun.angular_velocity])
            law = replace(law, start_velocity=law.start_velocity + law.duration * missed)
    return law


def retimed(state: State, period: float) -> State:
    """Return a state from which a motion goes on along the same path, at another frequency.

    All velocities scale alike, so the direction of travel and of turning stays; what a velocity
    constraint held before, it holds after.  Between two states of one step the twist is to change
    little: see :func:`modulated`, which leads there smoothly.

    Parameters
    ----------
    state : State
    period : float
        Seconds.
    """
    period = _arguments.positive("period", period, "seconds")
    factor = period / state.duration
    return replace(
        state,
        duration=period,
        previous_step=state.previous_step * factor,
        linear_velocity=state.linear_velocity / factor,
        angular_velocity=state.angular_velocity / factor,
        acceleration=state.acceleration / factor**2,
        pull_in=state.pull_in / factor,
        constraint_residuals=state.constraint_residuals / factor,
    )


def modulated(
    law: Law,
    state: State,
    time_step: float,
    *,
    within: float,
    period: float | None = None,
    amplitude: float | None = None,
    baseline: ArrayLike | None = None,
) -> State:
    """Lead a rhythm's state a step nearer to another period, amplitude or baseline.

    Called before each step, what is asked for is approached by ``exp(-3 t / within)``: by 95 % in
    that time (the filters of Ijspeert et al. 2013, section 2.2.5).  The period is approached in its
    logarithm, as a frequency is.

    Parameters
    ----------
    law : Law
        That of a rhythm.
    state : State
    time_step : float
        Of the step to come (s).
    within : float
        Seconds.
    period, amplitude : float, optional
        Seconds, and a factor on the demonstrated swing; as they are by default.
    baseline : array, shape (n,), optional
        About which it swings.

    Raises
    ------
    InputError
        If the law is no rhythm's, or a number is out of range.
    """
    if not law.clock.returns:
        raise InputError("modulated: this primitive runs once; learn it with rhythmic=True")
    step = _arguments.positive("time_step", time_step, "seconds")
    nearer = 1 - exp(-3 * step / _arguments.positive("within", within, "seconds"))
    if period is not None:
        period = _arguments.positive("period", period, "seconds")
        state = retimed(state, state.duration * exp(nearer * log(period / state.duration)))
    if amplitude is not None:
        aim = _arguments.not_negative("amplitude", amplitude)
        state = replace(state, amplitude=state.amplitude + nearer * (aim - state.amplitude))
    if baseline is not None:
        goal = _arguments.vector("baseline", baseline, size=law.space.linear)
        moved = state.goal_position + nearer * (goal - state.goal_position)
        state = replace(state, goal_position=moved, first_goal_position=moved)
    return state
