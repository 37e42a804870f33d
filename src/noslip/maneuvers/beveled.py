"""Ways of a needle with a beveled tip to a pose: its path bends everywhere alike, roll steers it.

Along its way s the tip's frame follows ``g' = g (e_x, (u(s), 0, kappa))``: it advances along its
shaft x, turns about its bevel axis z by kappa per meter, and rolls at the rate u (the unicycle
model of Webster et al., "Nonholonomic modeling of needle steering", 2006).  Sought are a roll rate
and a length l whose end is the pose that was asked for, with the least effort

    ``x_0^2 + sum (1 + (k / 3)^2) x_k^2 + (10 (l / d - 1))^2``,   ``u l = sum x_k cos(k pi s / l)``,

d being the pose's distance.  Cosines change nowhere abruptly, and not at all at both ends.

From a way without roll the end moves in four of six directions to first order: it cannot be brought
nearer to the shaft's line within the plane that it bends in, which takes roll one way and then back
(a bracket of the two controls).  So nothing starts there.  Of a fixed set of ways those that end
nearest to the pose are led to it together, by Newton steps on the end and, the effort being
quadratic, on its optimality.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import Value
from noslip.errors import InputError
from noslip.maneuvers.maneuver import Maneuver, Stretch

_COSINES = 20
"""Of the roll rate, up to nine waves and a half: enough to turn over within a tenth of the way, as
in a bend to one side, then to the other; with half as many one such pose in six is missed."""
_SLOW = 3.0
"""Half waves up to which a cosine costs about as much as a steady roll."""
_LENGTH_EFFORT = 10.0
"""Effort's root of a way twice as long as the distance: half a turn of roll for a third more."""
_SEARCHES = ((512, 12), (2048, 40))
"""Ways that are tried, and how many of them are led to the pose: of the first nine in ten arrive.
The second, four times as slow, is for poses that only a certain roll leads to."""
_LEAST_ROLL, _MOST_ROLL = 0.1, 10.0
"""Roll over those ways (rad): from nearly an arc to some turns."""
_SLACK = 0.15
"""Length over the distance that rolling needs at most, less one."""
_COARSE, _LEADING = 16, 32
"""Stretches of a way that is tried, and of one that is led: what it is off by then is made good."""
_STEPS, _ENOUGH = 30, 8
"""Newton steps at most, and how many settle the effort of those that arrive."""
_FAR = 4.0
"""Root of the effort that one step may take: the linearization holds for about a turn of roll."""
_EFFORT_SHARE = 0.6
"""Of the step to the least effort, taken at once with the one to the pose: the whole of it leads
past where the linearization holds."""
_DAMPING, _LEAST_DAMPING = 1e-2, 1e-13
"""On the matrix of a step, over its mean: times the squared distance from the pose, and what keeps
it definite at the pose."""
_NEAR, _ARRIVED = 1e-3, 1e-12
"""Off the pose (of its distance; rad): what the last steps make good, and what counts as none."""
_APPROACHING, _WAITING, _TRIED_LAST = 40, 8, 4
"""Last steps: they double their digits, or add one each where roll all but vanishes; after how many
nothing waits for the other ways if one has arrived; and how many ways are led nearest."""
_APART = 0.5
"""Roll's root mean square (rad) from which two ways count as different."""
_MOST_STRETCHES = 2000
"""More than a motion is planned on."""
_SMALL = 1e-4
"""Turns (rad) below which sine and cosine over them are their series."""
_STRAIGHT = 1e-9
"""Curvature (1/m) that bends nothing by a nanometer."""
_WEAK = 1e-2
"""How much less the end moves for an effort in a direction that counts as lost, over the most."""


@dataclass(frozen=True, eq=False)
class Nearest(Value):
    """Where a needle comes nearest to a pose that it was not led to.

    Attributes
    ----------
    maneuver : Maneuver
        The way there.
    moved, turned : float
        Distance (m) and angle (rad) from the pose.
    lost : array, shape (K, 6)
        Directions in which its end hardly moves, whatever the roll, edge's frame at the end: unit
        vectors of displacement, over the pose's distance, and turn (rad).
    """

    maneuver: Maneuver
    moved: float
    turned: float
    lost: Floats

    def __str__(self) -> str:
        """How near, and what keeps it from coming nearer."""
        text = f"{1e3 * self.moved:.3g} mm and {np.degrees(self.turned):.2g} degrees off"
        if not self.directions:
            return text
        return f"{text}, where its tip, whatever the roll, is hardly {' or '.join(self.directions)}"

    @property
    def directions(self) -> tuple[str, ...]:
        """The lost directions by their largest part: "moved along y", "turned about z"."""
        words = [f"moved along {axis}" for axis in "xyz"] + [f"turned about {a}" for a in "xyz"]
        return tuple(dict.fromkeys(words[int(np.argmax(np.abs(each)))] for each in self.lost))


def beveled(
    position: Sequence[float] | Floats,
    quaternion: Sequence[float] | Floats,
    curvature: float,
    *,
    stretches: int = 64,
    most: int = 4,
) -> list[Maneuver]:
    """Ways of a beveled needle to a pose, those of least effort first.

    Parameters
    ----------
    position, quaternion : 3 and 4 numbers
        The pose, in the edge's frame at the start (m).
    curvature : float
        kappa about the edge's z (1/m), of either sign but not 0.
    stretches : int
        Of a way: helices, from one to the next of which the roll rate changes a little.
    most : int
        Ways at most; any two of them roll differently.

    Returns
    -------
    list of Maneuver
        Each leads to the pose up to rounding; empty where none was found.
    """
    goal = _Goal.of(position, quaternion, curvature)
    stretches = _arguments.count("stretches", stretches, _MOST_STRETCHES)
    most = _arguments.count("most", most)
    if not goal.position.any():
        return _rolled(goal)
    for search in _SEARCHES:
        ways = np.array(_different(_led(goal, *search), most))
        ways, missed = _approached(goal, ways, stretches)
        if (missed <= _ARRIVED).any():
            break
    found = ways[missed <= _ARRIVED]
    return [_maneuver(goal, way, stretches) for way in found[np.argsort(goal.effort(found))]]


def nearest_beveled(
    position: Sequence[float] | Floats,
    quaternion: Sequence[float] | Floats,
    curvature: float,
    *,
    stretches: int = 64,
) -> Nearest:
    """Where a needle comes nearest to a pose, and where it cannot be moved to from there.

    The arguments are those of :func:`beveled`.
    """
    goal = _Goal.of(position, quaternion, curvature)
    stretches = _arguments.count("stretches", stretches, _MOST_STRETCHES)
    ways, missed = _approached(goal, _led(goal, *_SEARCHES[0])[:_TRIED_LAST], stretches)
    way = ways[int(np.argmin(missed))]
    off, slope = _linearized(goal, way[None], stretches)
    # Per root of effort, in the frame at the end, which is as far from the pose's as it is off.
    end = Rotation.from_rotvec(-off[0, 3:]).as_matrix() @ goal.rotation
    moves = np.kron(np.eye(2), end.T) @ slope[0] / np.sqrt(goal.efforts)
    directions, sizes, _ = np.linalg.svd(moves)
    moved, turned = np.linalg.norm(off[0].reshape(2, 3), axis=1)
    return Nearest(
        _maneuver(goal, way, stretches),
        float(moved * goal.distance / abs(goal.curvature)),
        float(turned),
        directions.T[sizes < _WEAK * sizes[0]],
    )


@dataclass(frozen=True, eq=False)
class _Goal:
    """A pose; lengths are in bends of a radian, so that the curvature is 1 to either side."""

    position: Floats
    rotation: Floats
    curvature: float

    @classmethod
    def of(
        cls,
        position: Sequence[float] | Floats,
        quaternion: Sequence[float] | Floats,
        curvature: float,
    ) -> _Goal:
        curvature = _arguments.finite("curvature", curvature)
        if abs(curvature) < _STRAIGHT:
            raise InputError(
                f"curvature is {curvature:g}/m; a needle that does not bend is turned from outside"
            )
        turn = _arguments.numbers("quaternion", quaternion)
        if turn.shape != (4,) or not 0 < np.linalg.norm(turn) < np.inf:
            raise InputError(
                "quaternion must be 4 finite numbers, not all 0, got "
                + _arguments.short(quaternion)
            )
        rotation = Rotation.from_quat(turn, scalar_first=True).as_matrix()
        return cls(_arguments.vector("position", position) * abs(curvature), rotation, curvature)

    @property
    def side(self) -> float:
        return float(np.sign(self.curvature))

    @property
    def distance(self) -> float:
        """Length that counts: a bend where the end is the start."""
        return float(np.linalg.norm(self.position)) or 1.0

    @property
    def efforts(self) -> Floats:
        """Of the cosines and of what the length is more than the distance, shape (21,)."""
        rolls = 1 + (np.arange(_COSINES) / _SLOW) ** 2
        return np.append(rolls, (_LENGTH_EFFORT / self.distance) ** 2)

    def effort(self, ways: Floats) -> Floats:
        """Effort of ways, shape (..., 21)."""
        return np.asarray(self.excess(ways) ** 2 @ self.efforts)

    def excess(self, ways: Floats) -> Floats:
        """Rolls, and length over the distance."""
        return np.asarray(ways - np.append(np.zeros(_COSINES), self.distance))


def _rolled(goal: _Goal) -> list[Maneuver]:
    """To where it is: rolled in place, if that is all."""
    turn = Rotation.from_matrix(goal.rotation).as_rotvec()
    if np.abs(turn[1:]).max() > _ARRIVED:
        return []
    return [Maneuver((Stretch("roll", 0.0, (float(turn[0]), 0.0, 0.0)),))]


def _maneuver(goal: _Goal, way: Floats, stretches: int) -> Maneuver:
    advance = float(way[-1]) / stretches
    return Maneuver(
        tuple(
            Stretch(
                "roll right" if roll > 0 else "roll left",
                advance / abs(goal.curvature),
                (roll, 0.0, goal.side * advance),
            )
            for roll in (_cosines(stretches) @ way[:-1]).tolist()
        )
    )


# ---------------------------------------------------------------- leading ways to a pose


def _different(ways: Floats, most: int) -> list[Floats]:
    """The first ways, of those that roll alike one."""
    kept: list[Floats] = []
    for way in ways:
        if len(kept) == most:
            break
        if all(np.linalg.norm((way - other)[:-1]) > _APART for other in kept):
            kept.append(way)
    return kept


def _led(goal: _Goal, tried: int, led: int) -> Floats:
    """Ways (led, 21): first those that all but arrive, by effort, then those that end nearest."""
    ways = _tried(goal, tried)
    missed = np.linalg.norm(_missed(goal, _chain(goal, ways, _COARSE)[-1]), axis=1)
    # Of two that end as near the shorter is nearer to what is sought.
    ways = ways[np.argsort(missed * ways[:, -1], kind="stable")[:led]]
    for step in range(_STEPS):
        off, slope = _linearized(goal, ways, _LEADING)
        missed = np.linalg.norm(off, axis=1)
        if step >= _ENOUGH and np.mean(missed < _NEAR) > 0.5:
            break
        ways = ways + _step(goal, ways, off, slope, _damping(missed), _EFFORT_SHARE)
    order = np.lexsort((goal.effort(ways), np.where(missed > _NEAR, missed, 0.0)))
    return np.asarray(ways[order])


def _approached(goal: _Goal, ways: Floats, stretches: int) -> tuple[Floats, Floats]:
    """Ways of so many stretches led as near to the pose as each comes, and what it misses (K,).

    By the method of Levenberg and Marquardt: damped more where a step leads away, less where not.
    """
    off, slope = _linearized(goal, ways, stretches)
    missed, more = np.linalg.norm(off, axis=1), np.ones(len(ways))
    for step in range(_APPROACHING):
        arrived = missed <= _ARRIVED
        if arrived.all() or (step > _WAITING and arrived.any()):
            break
        there = ways + _step(goal, ways, off, slope, more * _damping(missed), 0.0)
        moved, turned = _linearized(goal, there, stretches)
        left = np.linalg.norm(moved, axis=1)
        nearer = left < missed
        ways[nearer], off[nearer], slope[nearer] = there[nearer], moved[nearer], turned[nearer]
        missed = np.where(nearer, left, missed)
        more = np.where(nearer, np.maximum(more / 10, 1.0), 10 * more)
    return ways, missed


def _damping(missed: Floats) -> Floats:
    """What keeps far steps off directions that hardly move the end."""
    return np.asarray(_DAMPING * np.minimum(missed**2, 1.0) + _LEAST_DAMPING)


def _step(
    goal: _Goal, ways: Floats, off: Floats, slope: Floats, damping: Floats, share: float
) -> Floats:
    """Least effort, or a share of the way to it, whose end meets the pose to first order."""
    efforts = goal.efforts
    excess = share * goal.excess(ways)
    moves = slope / efforts
    matrix = moves @ slope.swapaxes(1, 2)
    mean = np.trace(matrix, axis1=1, axis2=2) / 6
    matrix += (damping * mean)[:, None, None] * np.eye(6)
    wanted = off[..., None] + slope @ excess[..., None]
    step = (np.linalg.solve(matrix, wanted).swapaxes(1, 2) @ moves)[:, 0] - excess
    size = np.sqrt(step**2 @ efforts)
    # A way must not become shorter than nothing.
    shorter = np.maximum(-step[:, -1] / ways[:, -1], 0.0)
    return np.asarray(step / np.maximum(1.0, np.maximum(size / _FAR, 2 * shorter))[:, None])


def _tried(goal: _Goal, count: int) -> Floats:
    """Ways to start from, shape (count, 21)."""
    rolls, straighter, longer = _starts(count)
    d = goal.distance
    # What an arc is longer than its chord is d^3 / 24.
    more = _SLACK * d * straighter + d**3 / 20 * longer
    return np.column_stack([rolls, d + more])


@lru_cache(maxsize=2)
def _starts(count: int) -> tuple[Floats, Floats, Floats]:
    """Rolls (count, 20) of ways to start from, and two numbers from 0 to 1 for their lengths."""
    random = np.random.default_rng(count)
    size = _LEAST_ROLL * (_MOST_ROLL / _LEAST_ROLL) ** random.uniform(size=(count, 1))
    rolls = size * random.normal(size=(count, _COSINES)) / (1 + np.arange(_COSINES))
    return rolls, random.uniform(size=count), random.uniform(size=count)


@lru_cache(maxsize=8)
def _cosines(stretches: int) -> Floats:
    """Roll of each stretch per cosine, shape (stretches, 20)."""
    middles = (np.arange(stretches) + 0.5) / stretches
    return np.cos(np.pi * np.arange(_COSINES) * middles[:, None]) / stretches


# ---------------------------------------------------------------- ends of ways


def _missed(goal: _Goal, ends: Floats) -> Floats:
    """What leads from ends (K, 4, 4) to the pose: over its distance, and turns (rad): (K, 6)."""
    turns = Rotation.from_matrix(goal.rotation @ ends[:, :3, :3].swapaxes(1, 2)).as_rotvec()
    return np.column_stack([(goal.position - ends[:, :3, 3]) / goal.distance, turns])


def _linearized(goal: _Goal, ways: Floats, stretches: int) -> tuple[Floats, Floats]:
    """What ways (K, 21) miss, shape (K, 6), and how their ends move with them, (K, 6, 21).

    A change of roll turns all that follows about the shaft there, a change of length pushes it
    along and turns it about the bevel axis: integrals over the way, by Simpson's rule in each
    stretch, whose error (1e-5 of the whole for half a radian) is the steps' alone.
    """
    poses = _chain(goal, ways, stretches)
    middles = poses[:-1] @ _helices(goal, ways, stretches, 0.5)
    end = poses[-1, :, :3, 3]
    per_roll, per_length = (
        (begins[:-1] + 4 * halfway + begins[1:]) / 6
        for begins, halfway in zip(
            _moves(goal, poses, end), _moves(goal, middles, end), strict=True
        )
    )
    by_cosine = np.tensordot(_cosines(stretches), per_roll, (0, 0)).transpose(1, 2, 0)
    slope = np.concatenate([by_cosine, per_length.mean(axis=0)[..., None]], axis=2)
    slope[:, :3] /= goal.distance
    return _missed(goal, poses[-1]), slope


def _moves(goal: _Goal, poses: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Twists of the end, shape (..., 6), per roll and per length at poses on the way."""
    shaft, bevel = poses[..., :3, 0], goal.side * poses[..., :3, 2]
    arm = end - poses[..., :3, 3]
    return (
        np.concatenate([np.cross(shaft, arm), shaft], axis=-1),
        np.concatenate([shaft + np.cross(bevel, arm), bevel], axis=-1),
    )


def _chain(goal: _Goal, ways: Floats, stretches: int) -> Floats:
    """Poses that ways lead through, shape (stretches + 1, K, 4, 4)."""
    steps = _helices(goal, ways, stretches)
    poses = np.empty((stretches + 1, *steps.shape[1:]))
    poses[0] = np.eye(4)
    for before, step, after in zip(poses[:-1], steps, poses[1:], strict=True):
        np.matmul(before, step, out=after)
    return poses


def _helices(goal: _Goal, ways: Floats, stretches: int, share: float = 1.0) -> Floats:
    """Poses at the end of each stretch, or at a share of it, as seen from its begin.

    Exponentials of twists ``(a, 0, 0; u, 0, kappa a)`` (Murray, Li and Sastry 1994, eq. 2.36),
    shape (stretches, K, 4, 4).
    """
    roll = share * (_cosines(stretches) @ ways[:, :-1].T)
    advance = np.broadcast_to(share / stretches * ways[:, -1], roll.shape)
    bend = goal.side * advance
    square = roll**2 + bend**2
    angle = np.sqrt(square)
    small = angle < _SMALL
    safe = np.where(small, 1.0, angle)
    one = np.where(small, 1 - square / 6, np.sin(safe) / safe)
    two = np.where(small, 0.5 - square / 24, (1 - np.cos(safe)) / safe**2)
    three = np.where(small, 1 / 6 - square / 120, (safe - np.sin(safe)) / safe**3)
    poses = np.zeros((*roll.shape, 4, 4))
    entries = (
        (1 - two * bend**2, -one * bend, two * roll * bend, advance * (1 - three * bend**2)),
        (one * bend, 1 - two * square, -one * roll, advance * two * bend),
        (two * roll * bend, one * roll, 1 - two * roll**2, advance * three * roll * bend),
        (0.0, 0.0, 0.0, 1.0),
    )
    for i, row in enumerate(entries):
        for j, entry in enumerate(row):
            poses[..., i, j] = entry
    return poses
