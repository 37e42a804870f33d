"""A stream of commands, followed: what a tool under constraints makes of a hand, each period.

Three things in a row:

- The *command heard*: the command's own increments, but for jumps, which no hand makes in so short
  a time.  A jump is made up for no faster than the hand has moved.
- The *hand*: a critically damped follower of that, ``T^2 x'' + 2 T x' + x = heard``, stepped with
  its own poles, as :class:`noslip.law.attractor.Attractor` is.  It lags by ``2 T``.  T shrinks with
  its speed, so that a slow hand does not tremble and a fast one is not late (the 1 euro filter:
  Casiez et al., CHI 2012).
- The *tool*: the hand's velocity, and towards the hand.  What constraints forbid of the way there
  is made up for by steering along the line of sight (Fossen, *Handbook of Marine Craft
  Hydrodynamics and Motion Control*, 2011, chapter 10).  With e the error across the path, theta
  the angle from the hand's course to the tool's, V the hand's speed and l the length of a maneuver,
  ``theta' = V / l (e / l - 2 theta)``: e is critically damped over the way traveled, at any speed,
  and a hand at rest turns nothing.  Slow, its heading takes the place of its course.

The velocities found so go through the same step as those of a primitive (:mod:`noslip.law.step`).
No smooth feedback brings a tool that must not slip to rest at whatever pose (Brockett 1983).
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from noslip._typing import Expression
from noslip.constraints.system import ConstraintSystem
from noslip.law.layout import STATE, STEP, Layout
from noslip.rotations import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_product,
)

FAST_SMOOTH, STILL_SMOOTH = 0.03, 0.1
"""s, T of a fast hand and of one at rest: of 0.5 mm and 0.3 degrees of noise at 1 kHz 1.5 mm/s and
0.03 rad/s are left, or 0.25 mm/s and 0.005 rad/s."""
SLOW = 0.02, 0.2
"""m/s and rad/s at which T is halfway between."""
CATCH_UP = 0.1
"""s in which a tool comes after the hand along its path, and jumps are made up for: more than the
hand's own, which then is not taken for faster than it is."""
MANEUVER = 0.3
"""s that a maneuver takes at the hand's peak speed; l is the way in it.  At 0.25 noise turns
recorded wheels 1.5 times as fast as their hand, at 0.35 1.4 times; recorded blades leave their
hand's path by 2.1 and 2.9 mm."""
FASTER = 1.8
"""Times the hand's own peak speeds that the tool may be moved and turned at."""
FARTHEST_ASIDE = 1.0
"""rad off the hand's heading that a tool is steered, however far aside the hand is."""
SLOWEST = 0.05, 0.05
"""m/s and rad/s, taken for the peaks of a hand that has not moved faster yet."""
HASTE, JITTER = 4.0, (4e-3, 0.05)
"""Times its peak speeds, besides so many m and rad, that a hand may have moved between two
commands; farther is a jump.  Twice that is the noise of a poor sensor."""
LONGEST_GAP = 0.1
"""s between two commands of a stream, at most; after more it has paused."""
PULL_IN = 20.0
"""1/s at which a tool that begins off a surface comes onto it: within a quarter of a second."""
BARRIER_RATE = 100.0
"""1/s of limits that name none: felt in the last hundredths of a second before them."""
_AT_ONCE = 1e18
"""1/s: a rate that leaves nothing after any step."""
_TINY = 1e-12
_DEPENDENT = 1e-9
"""Added to rows' products, their linear parts of order 1: rows that repeat others do no harm."""

HEARD = Layout(
    command=7,
    since=1,
    gap=1,
    heard=7,
    hand_position=3,
    hand_quaternion=4,
    hand_linear=3,
    hand_angular=3,
    linear_peak=1,
    angular_peak=1,
)
"""What is kept of the commands: the last one, the time since it changed and the mean time between
two changes (s), that heard, the hand, and the peaks of its own speed."""
GIVEN = Layout(command=7, time=1, pace=1)
"""What a period is given: the command (its quaternion of any length), the time (s), and 1, or less
for a tool that is to wait for itself."""


def follow_function(system: ConstraintSystem, period: float) -> ca.Function:
    """Return the graph (state, heard, given) -> (heard, row of the step table).

    Parameters
    ----------
    system : ConstraintSystem
        Whose rows of velocities say what must be steered.
    period : float
        Between two commands (s).
    """
    h = period
    symbols = [
        ca.SX.sym(n, k) for n, k in (("s", STATE.size), ("x", HEARD.size), ("g", GIVEN.size))
    ]
    state, heard, given = symbols
    x = {name: heard[HEARD[name]] for name in HEARD}
    command, time, pace = (given[GIVEN[name]] for name in GIVEN)
    command = ca.vertcat(command[:3], command[3:] / ca.norm_2(command[3:]))
    before = [x["linear_peak"], x["angular_peak"]]

    # As it was given, but for jumps; and towards it.
    since = x["since"] + h
    moves = ca.norm_inf(command - x["command"]) > 0
    gap = x["gap"] + 0.1 * moves * (ca.fmin(since, LONGEST_GAP) - x["gap"])
    within = ca.fmin(since, 2 * gap)
    increments = [
        _shortened(by, HASTE * peak * within + jitter)
        for by, peak, jitter in zip(_between(x["command"], command), before, JITTER, strict=True)
    ]
    pose = _moved(x["heard"], increments)
    made_up = [
        _shortened(left * (h / CATCH_UP), h * peak)
        for left, peak in zip(_between(pose, command), before, strict=True)
    ]
    pose = _moved(pose, made_up)

    # The hand, and its own speed: without what it makes up for.
    hand = ca.vertcat(x["hand_position"], x["hand_quaternion"])
    twist, peaks = [], []
    for name, pull, slow, peak, way in zip(
        ("hand_linear", "hand_angular"), _between(hand, pose), SLOW, before, made_up, strict=True
    ):
        smooth = FAST_SMOOTH + (STILL_SMOOTH - FAST_SMOOTH) / (1 + _length(x[name]) / slow)
        left = ca.exp(-h / smooth)
        twist.append(left**2 * x[name] + (1 - left) ** 2 / h * pull)
        peaks.append(ca.fmax(peak, _length(twist[-1]) - _length(way) / h))
    hand = _moved(hand, [h * v for v in twist])

    # The tool.
    back = -ca.expm1(-h / CATCH_UP) / h
    off = _between(state[: STATE["quaternion"].stop], hand)
    linear = pace * _shortened(twist[0] + back * off[0], FASTER * peaks[0])
    rows = _rows(system, time, state, linear, twist[1])
    turn = back * off[1]
    if rows.shape[0]:
        turn = _steering(rows, pace * twist[0], off, MANEUVER * peaks[0], h)
    angular = pace * _shortened(twist[1] + turn, FASTER * peaks[1])

    kept = [command, (1 - moves) * since, gap, pose, hand, *twist, *peaks]
    step = {
        **dict.fromkeys(("time_step", "kick", "previous_step"), h),
        "time": time + h,
        "residual_rate": PULL_IN,
        "slip_rate": _AT_ONCE,
        "barrier_rate": BARRIER_RATE,
        # The attractor's part is done: these are its velocities.
        "decay": 0.0,
        "gain": 1.0,
        "position_target": state[STATE["position"]] + linear,
        "rotation_goal": state[STATE["quaternion"]],
        "rotation_offset": angular,
    }
    found = [ca.vertcat(*kept), ca.vertcat(*(step[name] for name in STEP))]
    return ca.Function(
        "follow", [state, heard, given], ca.cse([ca.densify(each) for each in found])
    )


def _rows(
    system: ConstraintSystem,
    time: Expression,
    state: Expression,
    linear: Expression,
    angular: Expression,
) -> Expression:
    """Derivatives of the velocity-level equalities with respect to the velocities, shape (m, 6)."""
    equalities, v = system.equalities, ca.SX.sym("v", 6)
    chosen = [i for i, is_velocity in enumerate(equalities.row_is_velocity) if is_velocity]
    residual = equalities.residual(time, state[:3], state[3:7], v[:3], v[3:])
    rows = ca.jacobian(residual, v)
    # What does not turn with the tool, such as a height, no steering makes up for.
    turning = ca.which_depends(rows @ v, state[3:7], 1, True)
    rows = rows[[i for i in chosen if turning[i]], :]
    return ca.substitute(rows, v, ca.vertcat(linear, angular))


def _steering(
    rows: Expression,
    velocity: Expression,
    off: Sequence[Expression],
    length: Expression,
    h: float,
) -> Expression:
    """Angular velocity (rad/s) that makes up for what rows forbid of the way to the hand.

    Parameters
    ----------
    rows : expression, shape (m, 6)
    velocity : expression, shape (3,)
        Of the hand.
    off : two expressions, shape (3,)
        From the tool to the hand: way (m) and turn (rad).
    length : expression
        l (m).
    h : float
        The period (s).
    """
    across = rows[:, :3]
    normal = across @ across.T + _DEPENDENT * ca.SX.eye(rows.shape[0])

    def forbidden(x: Expression) -> Expression:
        return across.T @ ca.solve(normal, across @ x)

    # Both at the point that must not slip.
    error = across.T @ ca.solve(normal, rows @ ca.vertcat(*off))
    drift, turned = forbidden(velocity), off[1]
    along = velocity - drift
    speed = _length(along)
    ahead = along / speed
    # How far to the side the hand heads, and how far it goes, which near rest is noise.
    heading = forbidden(ca.cross(turned, ahead))
    square = ca.sumsqr(velocity)
    trusted = square / (square + SLOW[0] ** 2)
    course = trusted * drift / _length(velocity) + (1 - trusted) * heading
    aside = heading + _shortened(course - heading + error / (2 * length), FARTHEST_ASIDE)
    turn = ca.cross(ahead, aside) + turned - ca.cross(ahead, heading)
    return 2 * speed * turn / (length + 2 * speed * h)


def _between(one: Expression, other: Expression) -> tuple[Expression, Expression]:
    """Way and turn from one pose to another."""
    turn = quaternion_product(other[3:], quaternion_conjugate(one[3:]))
    return other[:3] - one[:3], quaternion_log(turn)


def _moved(pose: Expression, by: Sequence[Expression]) -> Expression:
    """A pose moved by a way and a turn."""
    quaternion = quaternion_product(quaternion_exp(by[1]), pose[3:])
    return ca.vertcat(pose[:3] + by[0], quaternion / ca.norm_2(quaternion))


def _length(x: Expression) -> Expression:
    return ca.sqrt(ca.sumsqr(x) + _TINY**2)


def _shortened(x: Expression, most: Expression) -> Expression:
    return x * ca.fmin(1, most / _length(x))
