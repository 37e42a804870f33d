"""Poses that no motion from a start reaches, proven from what constraints forbid everywhere.

What the rows of velocities forbid at every pose alike adds up.  Where ``c . v = 0`` however the
tool stands, its way along c is 0: a wheel stays at its height.  Where no turn is free, or none but
those about one axis, the rotation stays the start's, or differs from it by a turn about that axis;
then the rows are asked at those rotations alone, which may forbid more.  Where a hard limit asks
``c . v >= 0`` of all that is left, the way along c is not negative.

"At every pose" is seen at random ones: what smooth arithmetic has in common there, it has in
common everywhere.  Constraints that are put together from pieces are left out, and so are rows that
are not homogeneous in the velocities: they ask for one.  So much that is impossible is not seen,
and nothing is that is not: no search is taken for a proof.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.boundary import Boundary
from noslip.constraints.declaration import Constraint, residual_instructions
from noslip.constraints.expression import Instructions
from noslip.constraints.system import ConstraintSystem
from noslip.errors import ConstraintError, Refusal

_POSES = 8
"""Random ones at which rows are asked: more than any system has rows."""
_DRAWS = 3 * _POSES
"""Of them, until so many are found at which all rows are defined."""
_SAME = 1e-9
"""Difference of unit vectors, and rest of a row over its size, that is rounding."""
_APART = 1e-7
"""Displacement (m) or turn (rad) that is one: above what a plan that converged leaves of it, and
below any tool's play."""
_LEVER = 1e-2
"""Displacement of a point of the tool over its lever: steps that turn by 0.1 rad make a thousandth
of it for each radian, since the rows are asked in their middles."""
_VANISHES = 1e-100
"""Size of a row that is none."""
_PIECES = {
    *("NOT", "FLOOR", "CEIL", "FABS", "SIGN", "LT", "LE", "EQ", "NE", "AND", "OR", "FMOD"),
    *("REMAINDER", "COPYSIGN", "IF_ELSE_ZERO", "FMIN", "FMAX", "ERFINV"),
}
"""Operations that may do at one pose what they do not at another."""


@dataclass(frozen=True)
class _Ways:
    """What is common to all motions from a start.

    Attributes
    ----------
    spins : array, shape (n, 3)
        Axes about which it may turn, world frame: all three, one or none.
    tied : list of (point, directions)
        Points of the tool, shape (3,), and directions along which they keep their places, world
        frame, shape (n, 3).
    onward : array, shape (n, 3)
        Directions along which the tool's origin never moves back, world frame.
    """

    spins: Floats
    tied: list[tuple[Floats, Floats]]
    onward: Floats


def require_reachable(
    system: ConstraintSystem, start: Boundary, other: Boundary, what: str = "goal"
) -> None:
    """Refuse a pose, or a part of one, that provably no motion from a start comes to.

    Parameters
    ----------
    system : ConstraintSystem
    start, other : Boundary
        A start that is no whole pose says nothing.
    what : str
        Of the other, for the message.

    Raises
    ------
    ConstraintError
        With the code ``IMPOSSIBLE``, naming the fewest constraints that forbid it.
    """
    off = _off(system, start, other)
    if not off:
        return
    kept = [True] * len(system.constraints)
    for k in range(len(kept)):
        rest = [*kept[:k], False, *kept[k + 1 :]]
        if told := _off(system.part(rest), start, other):
            kept, off = rest, told
    names = [repr(name) for name in system.part(kept).names]
    rule, them = ("rules", "it") if len(names) == 1 else ("together rule", "them")
    raise ConstraintError(
        f"{what} {off}, which {' and '.join(names)} {rule} out; no motion that satisfies {them} "
        f"{'ends' if what == 'goal' else 'passes'} there",
        code=Refusal.IMPOSSIBLE,
    )


def _off(system: ConstraintSystem, start: Boundary, other: Boundary) -> str:
    """Say in what a pose differs from a start that no motion changes; nothing where it does not."""
    if not (system.space.is_pose and system.constraints):
        return ""
    if start.position is None or start.rotation is None:
        return ""
    ways = system.owned("ways", lambda: _ways(system, (0.0, 0.0, 0.0, 1.0)))
    if len(ways.spins) < 3:
        ways = _ways(system, tuple(start.rotation.as_quat().tolist()))
    turn = None if other.rotation is None else other.rotation * start.rotation.inv()
    if turn is not None and len(ways.spins) == 0 and turn.magnitude() > _APART:
        return f"is turned by {np.degrees(turn.magnitude()):.3g} degrees from the start"
    if turn is not None and len(ways.spins) == 1:
        (axis,) = ways.spins
        tilt = 2 * np.arcsin(min(1.0, float(np.linalg.norm(turn.apply(axis) - axis)) / 2))
        if tilt > _APART:
            return f"is tilted by {np.degrees(tilt):.3g} degrees from the start, off {_text(axis)}"
    if other.position is None:
        return ""
    for point, directions in ways.tied:
        moved = other.position - start.position
        if point.any():
            if other.rotation is None:
                continue
            moved = moved + other.rotation.apply(point) - start.rotation.apply(point)
        along = directions.T @ (directions @ moved)
        away = float(np.linalg.norm(along))
        if away > _APART + _LEVER * np.linalg.norm(point):
            where = f"with its point {_text(point)} " if point.any() else ""
            return f"{where}lies {away:.3g} m from the start along {_text(along / away)}"
    back = ways.onward @ (other.position - start.position)
    if len(back) and back.min() < -_APART:
        return f"lies {-back.min():.3g} m from the start along {_text(-ways.onward[back.argmin()])}"
    return ""


def _text(vector: Floats) -> str:
    # Rounded before it is printed, and + 0, so that nothing reads -0.
    return f"({', '.join(f'{x:.3g}' for x in np.round(vector, 6) + 0.0)})"


# Of one start many goals are asked.
@lru_cache(maxsize=16)
def _ways(system: ConstraintSystem, quaternion: tuple[float, ...]) -> _Ways:
    """What is common to all motions from a start of a rotation (its scalar last).

    If all three spins are free, it is common to those from any start.
    """
    rotation = Rotation.from_quat(quaternion)
    equalities, limits = system.owned("told for certain", lambda: _certain(system))
    # It turns about what is free; then it may be seen that less is.
    spins, rng = np.eye(3), np.random.default_rng(0)
    while True:
        samples = _samples(equalities, limits, rotation, spins, rng)
        if samples is None:
            return _Ways(np.eye(3), [], np.empty((0, 3)))
        rotations, rows, bounds = samples
        fewer = _spins(rows, rotations, rotation, spins)
        if len(fewer) == len(spins):
            break
        spins = fewer
    points = {(0.0, 0.0, 0.0)} | {tuple(c.edge.point) for c in equalities.constraints if c.edge}
    tied = []
    for point in map(np.array, sorted(points)):
        levers = [turned.apply(point) for turned in rotations]
        directions = alone(common_rows(list(map(seen_at, rows, levers))))
        if len(directions):
            tied.append((point, directions))
    return _Ways(spins, tied, _onward(bounds, common_rows(rows)))


def _certain(system: ConstraintSystem) -> tuple[ConstraintSystem, ConstraintSystem]:
    """Equalities, and hard limits on velocities, of smooth arithmetic."""

    def is_certain(constraint: Constraint) -> bool:
        told = residual_instructions(constraint)
        if not isinstance(told, Instructions) or _PIECES & {step[0] for step in told.steps}:
            return False
        is_hard = constraint.priority == 0 and constraint.level == "velocity"
        return constraint.relation == "zero" or is_hard

    system = system.part([is_certain(c) for c in system.constraints])
    return system.equalities, system.limits


def _samples(
    equalities: ConstraintSystem,
    limits: ConstraintSystem,
    rotation: Rotation,
    spins: Floats,
    rng: np.random.Generator,
) -> tuple[list[Rotation], list[Floats], list[Floats]] | None:
    """Rotations, rows of equalities, shape (m, 6), and of limits at random poses.

    Of equalities ``phi = J xi``, xi the velocities, as of all that are homogeneous in them (Euler):
    a sum of rows that is the same everywhere then is 0 along every motion.  Of limits with a
    constant besides that is not positive.  Turns that are not free are rows too.  None where too
    few poses are found at which all are defined.
    """
    rotations, rows, bounds = list[Rotation](), list[Floats](), list[Floats]()
    drifts = list[Floats]()
    fixed = np.hstack([np.zeros((3, 3)), np.eye(3) - spins.T @ spins])
    for _ in range(_DRAWS):
        turned = Rotation.from_rotvec(spins.T @ rng.uniform(-np.pi, np.pi, len(spins))) * rotation
        if len(spins) == 3:
            turned = Rotation.random(rng=rng)
        place = rng.normal(), rng.normal(size=3), turned.as_quat(scalar_first=True)
        twist = rng.normal(size=6)
        try:
            found = [part.instant(*place, *np.split(twist, 2))[1:] for part in (equalities, limits)]
        except ConstraintError:
            continue
        value, jacobian = (np.concatenate(parts) for parts in zip(*found, strict=True))
        size = np.maximum(np.linalg.norm(jacobian, axis=1), _VANISHES)
        drifts.append((value - jacobian @ twist) / size)
        rotations.append(turned)
        rows.append(jacobian[: equalities.size])
        bounds.append(jacobian[equalities.size :])
        if len(rows) == _POSES:
            held, given = np.split(np.array(drifts), [equalities.size], axis=1)
            counts = np.abs(held).max(axis=0) <= _SAME
            leads = (np.abs(given - given[0]).max(axis=0) <= _SAME) & (given[0] <= _SAME)
            return (
                rotations,
                [np.vstack([row[counts], fixed]) for row in rows],
                [row[leads] for row in bounds],
            )
    return None


def _spins(
    rows: Sequence[Floats], rotations: Sequence[Rotation], start: Rotation, spins: Floats
) -> Floats:
    """Axes about which what the rows leave may turn; those that were free if no fewer are seen."""
    # An axis stays the same in the world, or in the tool, which for a turn about it is the same.
    in_tool = [
        np.hstack([turned.inv().apply(part) for part in np.split(row, 2, axis=1)])
        for row, turned in zip(rows, rotations, strict=True)
    ]
    for seen, frame in ((rows, Rotation.identity()), (in_tool, start)):
        forbidden = alone(common_rows([np.roll(row, 3, axis=1) for row in seen]))
        if len(forbidden) >= 2 and 3 - len(forbidden) < len(spins):
            left = np.linalg.svd(forbidden)[2][len(forbidden) :]
            return np.asarray(frame.apply(left), dtype=np.float64).reshape(-1, 3)
    return spins


def seen_at(rows: Floats, lever: Floats) -> Floats:
    """Rows on the velocity of the origin as rows on that of a point at a lever, shape (m, 6)."""
    # v = v_r - w x r, so that a . v = a . v_r - (r x a) . w.
    return np.hstack([rows[:, :3], rows[:, 3:] - np.cross(lever, rows[:, :3])])


def common_rows(several: Sequence[Floats]) -> Floats:
    """Orthonormal rows, shape (k, 6), of the space that lies in the span of each of several."""
    spans = np.zeros((6, 6))
    for rows in several:
        sizes = np.linalg.norm(rows, axis=1, keepdims=True)
        _, sizes, span = np.linalg.svd(rows / np.where(sizes > 0, sizes, 1.0), full_matrices=False)
        span = span[sizes > 1e-9 * sizes.max(initial=0.0)]
        spans += span.T @ span / len(several)
    shares, directions = np.linalg.eigh(spans)
    return np.asarray(directions[:, shares > 1 - 1e-9].T)


def alone(rows: Floats) -> Floats:
    """Of the space that rows span, what has but a first half: orthonormal, shape (k, 3)."""
    mixed, sizes, _ = np.linalg.svd(rows[:, 3:])
    return np.asarray(mixed[:, np.count_nonzero(sizes > _SAME) :].T @ rows[:, :3])


def _onward(bounds: Sequence[Floats], tied: Floats) -> Floats:
    """Directions, shape (n, 3), that limits, but for what is tied, ask to move along everywhere."""
    left = np.array([rows - rows @ tied.T @ tied for rows in bounds])
    sizes = np.linalg.norm(left, axis=2, keepdims=True)
    unit = left / np.where(sizes > _SAME, sizes, np.inf)
    same = np.abs(unit - unit[0]).max(axis=(0, 2)) <= _SAME
    moves = np.abs(unit[0, :, 3:]).max(axis=1) <= _SAME
    counts = same & moves & np.asarray(unit[0].any(axis=1))
    return np.asarray(unit[0, counts, :3])
