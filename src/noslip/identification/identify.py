"""Which constraint holds in recordings, and about which point.

The velocity level is fitted here, from the rows of :mod:`noslip.identification.rows`; the position
level by ``noslip.identification.places.fit_places(trajectories, noise)``, a list of
:class:`~noslip.identification.identified.Place`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from noslip._typing import Floats
from noslip.constraints.blade import Blade
from noslip.constraints.declaration import Constraint
from noslip.constraints.needle import Needle
from noslip.constraints.travel import TurningRadius
from noslip.constraints.wheel import Wheel
from noslip.demonstrations._several import several
from noslip.errors import InputError
from noslip.identification.bent import BentTrial, bent_needle
from noslip.identification.identified import Identified, Row
from noslip.identification.places import fit_places
from noslip.identification.rows import NOTHING, Evidence, Trial, evidence, means, screws, tried
from noslip.identification.twists import FEWEST_SAMPLES, Steps, steps_of
from noslip.scale import require_motion
from noslip.trajectory import PoseTrajectory

HELD = 0.125
"""Share of its speed that a tool may slip along a row, on recordings that the row was not fitted
to.  Hands that follow a contour slip 3 to 9 %, a robot that drives a needle 7 to 11 %; a peg being
aligned, free to go where it likes, 27 % and more along its stillest direction."""
ALIKE = 3.0
"""A row is not believed that slips more than so many times another: it is a habit, as that of a
blade which hardly plunges."""
NEGLIGIBLE = 0.01
"""Share of the speed below which slips are alike."""
TURNED = 0.05
"""Radians (rms) that a row's direction must have turned in the world: one that kept its direction
may be a wall's, or a habit."""
LEVEL = 0.1
"""Of the largest turn of a body axis in the world, that of the ground's normal: floors and trolleys
tilt."""
GAINED = 0.8
"""Of the slip held out that a needle's tip beside the body's origin must leave at most."""
LONGEST = 0.5, 0.05
"""Meters, and share of the path: a point farther from the body's origin is none of the tool."""
TIGHTEST = 0.95
"""Quantile of the path's curvatures that counts as the largest: noise makes some larger."""
SATURATED = 0.35
"""Share of the way's time in bends within a tenth of the tightest, from which on that is a bound:
of a sine of steering it is 0.29, of a wheel turned at random below it (95 of 100), of a car that
is often at the stop of its steering above 0.36 (95 of 100)."""
STANDING = 0.3
"""Share of its speed (rms) below which a bend is not told, and backwards a tool does back up."""
_PARTS = 10, 5
"""Most parts that are held out in turn; and those of a single recording, blocks of its time."""


def identify(
    trajectories: PoseTrajectory | Iterable[PoseTrajectory],
    *,
    noise: tuple[float, float] | None = None,
) -> Identified:
    """Find which constraint the tool of recordings obeys, and about which of its points.

    Parameters
    ----------
    trajectories : PoseTrajectory or several
        Of one tool and one sensor on it; in any body frame, at any rates.
    noise : (float, float), optional
        Standard deviation of a sample's position (m) and rotation (rad, about each axis); by
        default estimated from the recordings.

    Raises
    ------
    InputError
        If they are no recordings, stand still or are too short.
    """
    recordings = moving(trajectories, "identify")
    parts = parts_of(recordings, noise)
    told = evidence(parts)
    tool = _tool(told, recordings)
    noises = np.median([steps.noise for part in parts for steps in part], axis=0)
    # A needle that bends is near some sphere all along, and a vehicle's floor is in its own rule.
    places = fit_places(
        recordings, (float(noises[0]), float(noises[1])), surfaces=not tool.constraints
    )
    placed = [place for place in places if place.holds]
    if placed:
        # Reason enough: a disc that rolls does not slip along its axle either.
        tool = Tool(tool.trial, tool.axes)
    holds = bool(tool.constraints)
    points = [place.values.get("reference_point") for place in placed]
    constraints = tool.constraints or tuple(c for place in placed for c in place.constraints)
    return Identified(
        constraints=constraints,
        kinds=tuple(type(constraint).name for constraint in constraints),
        travel=tool.axes[-1] if holds else None,
        lateral=tool.axes[0] if holds else None,
        reference_point=tool.trial.fit.point if holds else (points[-1] if points else None),
        rows=tuple(_row(tool, axis) for axis in tool.axes[: tool.rows]),
        candidates=tuple(_row(tool, axis) for axis in tool.axes),
        surfaces=tuple(places),
        curvature=tool.curvature,
        curvature_error=tool.curvature_error,
        turning_radius=tool.turning_radius,
        noise=(float(noises[0]), float(noises[1])),
        speed=float(np.sqrt(max(np.trace(told.fast.total[:3, :3]), 0.0))),
        names=tuple(recording.name for recording in recordings),
        recordings=tuple(recordings),
        notes=tool.notes,
    )


# ---------------------------------------------------------------- what is told


def moving(
    trajectories: PoseTrajectory | Iterable[PoseTrajectory], what: str
) -> list[PoseTrajectory]:
    """Return a list of recordings, each of which moves; an error says for what they are needed."""
    # Of joints, what they carry.
    recordings = [each.tool for each in several(trajectories, 1, what)]
    for recording in recordings:
        require_motion(recording)
    return recordings


def parts_of(
    recordings: Sequence[PoseTrajectory], noise: tuple[float, float] | None
) -> list[list[Steps]]:
    """Parts that are held out in turn: recordings, or blocks of time of a single one."""
    most, blocks = _PARTS
    each = [pieces for recording in recordings if (pieces := steps_of(recording, noise))]
    if not each:
        raise InputError(
            f"{recordings[0].name}: {len(recordings[0])} samples tell nothing of noise; give a "
            f"recording of {FEWEST_SAMPLES} poses or more"
        )
    if len(each) == 1:
        count = sum(len(steps.ways) for steps in each[0])
        each = [
            [Steps(ways, periods, steps.noise)]
            for steps in each[0]
            for ways, periods in zip(
                *(
                    np.array_split(values, max(2, round(blocks * len(steps.ways) / count)))
                    for values in (steps.ways, steps.periods)
                ),
                strict=True,
            )
        ]
    return [
        [steps for piece in each[k::most] for steps in piece] for k in range(min(most, len(each)))
    ]


def _sweeps(recordings: Sequence[PoseTrajectory]) -> Floats:
    """How far the body's axes turn in the world: ``a . S a`` is the mean square of a's way (rad^2).

    From their mean direction in each recording, by the way that the body went.
    """
    total, ways = np.zeros((3, 3)), 0.0
    for recording in recordings:
        weights = np.linalg.norm(np.diff(recording.positions, axis=0), axis=1)
        turns = recording.step_middles()[2].as_matrix()
        away = turns - np.average(turns, axis=0, weights=weights + 1e-12)
        total += np.einsum("k,kij,kil->jl", weights, away, away)
        ways += weights.sum()
    return np.asarray(total / max(ways, 1e-12))


def _normal(recordings: Sequence[PoseTrajectory], ground: Floats) -> Floats | None:
    """World direction of a body's axis, shape (3,); None, if recordings differ in it."""
    means = np.array([recording.rotations.apply(ground).mean(axis=0) for recording in recordings])
    mean = means.mean(axis=0)
    length = np.linalg.norm(mean)
    return mean / length if length > np.cos(2 * LEVEL) else None


# ---------------------------------------------------------------- what holds


@dataclass(frozen=True, eq=False)
class Tool:
    """What holds at velocity level: orthonormal `axes`, shape (3, 3), of which the first `rows` are
    free of slip: the lateral axis is the first, and the travel axis the last.  `tilt` is the
    covariance of a turn (rad^2, body frame) by which a ground may be otherwise.
    """

    trial: Trial
    axes: Floats
    rows: int = 0
    constraints: tuple[Constraint, ...] = ()
    curvature: float | None = None
    curvature_error: float | None = None
    turning_radius: float | None = None
    notes: tuple[str, ...] = ()
    tilt: Floats | None = None


def _tool(told: Evidence, recordings: Sequence[PoseTrajectory]) -> Tool:
    """Choose between needle, wheel, blade and nothing."""
    longest = max(LONGEST[0], LONGEST[1] * sum(recording.path_length for recording in recordings))
    sweeps = _sweeps(recordings)
    turned = np.linalg.eigvalsh(sweeps)
    one = _best(told, 1, longest)
    if turned[2] < TURNED**2:
        degrees = np.degrees(np.sqrt(max(turned[2], 0.0)))
        note = f"turned by {degrees:.1f} degrees (rms) only: turn the tool as it moves"
        return Tool(one, tool_axes(one), notes=(note,))
    bent = _bent(told, longest)
    if bent and _holds(bent.trial, HELD):
        return _needle(bent.trial, bent.bent.frame, bent.bent.curvature, bent.error)
    if turned[0] < LEVEL**2 * turned[2]:
        wheel = _wheel(told, recordings, sweeps, longest)
        if wheel:
            return wheel
    else:
        two = _best(told, 2, longest)
        if _holds(two, max(ALIKE * one.worst, NEGLIGIBLE + two.doubt)):
            return _needle(two, tool_axes(two))
    if _holds(one, HELD) and one.fit.axes[0] @ sweeps @ one.fit.axes[0] > TURNED**2:
        axes = tool_axes(one)
        lateral, _, travel = map(_numbers, axes)
        blade = Blade(lateral, travel, _numbers(one.fit.point))
        return Tool(one, axes, 1, (blade,))
    return Tool(one, tool_axes(one), notes=("slips along every direction",))


def _best(told: Evidence, rows: int, longest: float, ground: Floats | None = None) -> Trial:
    """Fit rows, about the body's origin if another point is too far or does worse held out."""
    found = tried(told, rows, ground=ground)
    rigid = tried(told, rows, np.eye(3), ground)
    far = np.linalg.norm(found.fit.point) > longest
    return rigid if far or found.worst > 1.2 * rigid.worst + found.doubt else found


def _bent(told: Evidence, longest: float) -> BentTrial | None:
    """Fit a bent needle, about the body's origin unless another point does better held out."""
    rigid, free = (bent_needle(told, HELD, unknown) for unknown in (np.eye(3), NOTHING))
    if free and np.linalg.norm(free.bent.tip) < longest:
        gained = not rigid or free.trial.worst < GAINED * rigid.trial.worst
        rigid = free if gained else rigid
    return rigid if rigid and rigid.error < HELD * rigid.bent.curvature else None


def _holds(trial: Trial, most: float) -> bool:
    return max(trial.worst, trial.doubt) < min(HELD, most)


def _needle(
    trial: Trial, axes: Floats, curvature: float | None = None, error: float | None = None
) -> Tool:
    needle = Needle(
        shaft=_numbers(axes[2]),
        curvature=curvature,
        bevel=_numbers(axes[1]),
        reference_point=_numbers(trial.fit.point),
    )
    return Tool(trial, axes, 2, (needle,), curvature, error)


def _wheel(
    told: Evidence, recordings: Sequence[PoseTrajectory], sweeps: Floats, longest: float
) -> Tool | None:
    """Find a wheel on a ground whose normal the body keeps; None, if it slips or lifts off."""
    turned, directions = np.linalg.eigh(sweeps)
    ground = directions[:, 0]
    # A line fitted to how the body's other axes swept the ground.
    spread = np.diag([0.0, *(max(turned[0], 0.0) / turned[1:])]) / sum(map(len, recordings))
    turns = np.cross(ground, directions.T).T
    tilt = turns @ spread @ turns.T
    trial = _best(told, 1, longest, ground)
    if not _holds(trial, HELD) or trial.share(ground) > HELD:
        return None
    normal = _normal(recordings, ground)
    if (ground if normal is None else normal)[2] < 0:
        ground, normal = -ground, None if normal is None else -normal
    lateral = trial.fit.axes[0]
    axes = np.array([lateral, ground, np.cross(lateral, ground)])
    axes[[0, 2]] *= np.sign(told.net_way(axes[2], trial.fit.point)) or 1.0
    axle, _, travel = map(_numbers, axes)
    up = None if normal is None else _numbers(normal)
    wheel = Wheel(axle, travel, up, _numbers(trial.fit.point))
    bound = _turning_radius(trial, axes)
    if bound is None:
        return Tool(trial, axes, 2, (wheel,), tilt=tilt)
    return Tool(trial, axes, 2, (wheel, bound), turning_radius=bound.radius, tilt=tilt)


def _turning_radius(trial: Trial, axes: Floats) -> TurningRadius | None:
    """Find a bound of the bends both ways, if a tool that only goes forward often keeps to it.

    Along the axle, its point is where both are as tight.
    """
    told, (axle, up, travel) = trial.evidence, axes
    twists = np.vstack([means(s, told.fast.window)[0] for part in told.parts for s in part])
    point, turns = trial.fit.point, twists[:, 3:] @ up
    forward = twists @ screws(travel[None], point)[0]
    radii = []
    for side in (turns, -turns):
        bends = side[side > 0] / np.maximum(forward[side > 0], 1e-9)
        if len(bends) < SATURATED / 2 * len(turns):
            return None
        radii.append(1 / float(np.quantile(bends, TIGHTEST)))
    point = point + axle * (radii[0] - radii[1]) / 2
    forward = twists @ screws(travel[None], point)[0]
    usual, radius = float(np.sqrt(np.mean(forward**2))), sum(radii) / 2
    moving = forward > STANDING * usual
    near = radius * np.abs(turns[moving]) > 0.9 * forward[moving]
    if forward.min() < -STANDING * usual or np.mean(near) < SATURATED:
        return None
    return TurningRadius(radius, _numbers(travel), _numbers(up), _numbers(point))


def tool_axes(trial: Trial) -> Floats:
    """Lateral axis, the one across both, and the travel axis, shape (3, 3), right-handed."""
    rows, point = trial.fit.axes, trial.fit.point
    if len(rows) == 2:
        travel = np.cross(*rows)
        # Of a shaft's two, the lateral axis is the body's y, as near as may be.
        near = np.eye(3)[1 if abs(travel[1]) < np.sqrt(0.5) else 2]
        lateral = near - travel * (near @ travel)
        lateral /= np.linalg.norm(lateral)
    else:
        lateral = rows[0] * (np.sign(rows[0][np.argmax(np.abs(rows[0]))]))
        across = np.linalg.svd(lateral[None])[2][1:]
        lines = screws(across, point)
        moved = lines @ trial.evidence.fast.total @ lines.T
        travel = np.linalg.eigh(moved)[1][:, -1] @ across
    travel = travel * (np.sign(trial.evidence.net_way(travel, point)) or 1.0)
    return np.array([lateral, np.cross(travel, lateral), travel])


def _row(tool: Tool, axis: Floats) -> Row:
    trial, found = tool.trial, tool.trial.fit
    across = np.eye(3) - found.unknown.T @ found.unknown
    free = np.eye(3)
    if tool.curvature is None:
        # Rows about one point may be turned into each other: about the shaft, or the only axis.
        kept = found.axes[0] if len(found.axes) == 1 else np.cross(*found.axes)
        free -= np.outer(kept, kept)
    turn = -np.cross(np.eye(3), axis)
    turned = free @ found.covariance[:3, :3] @ free.T
    if tool.tilt is not None:
        turned = turned + tool.tilt
    return Row(
        axis=axis,
        point=found.point,
        axis_covariance=turn @ turned @ turn.T,
        point_covariance=across @ found.covariance[3:, 3:] @ across,
        unknown=found.unknown,
        given=trial.share(axis, np.zeros(3)),
        slip=trial.share(axis),
        holdout=trial.holdout(axis),
    )


def _numbers(vector: Floats) -> tuple[float, ...]:
    return tuple(vector.tolist())
