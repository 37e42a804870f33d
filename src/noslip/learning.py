"""Demonstrations and constraints -> a primitive that cannot break them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial, wraps
from itertools import compress
from pathlib import Path
from typing import Any, Literal, ParamSpec, Protocol, TypedDict, Unpack, cast, overload

import numpy as np

from noslip import _arguments
from noslip._supplied import Supplied
from noslip.boundary import Boundary, End, kept_twist
from noslip.chain import Chain
from noslip.constraints.check import quantity_text
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem, as_system
from noslip.demonstrations.agreement import require_agreement
from noslip.demonstrations.alignment import align as bring_into_step
from noslip.demonstrations.cycles import closed, periods
from noslip.distribution import MotionDistribution
from noslip.errors import CompromiseWarning, ConvergenceError, InputError, warn
from noslip.law.channels import Channels
from noslip.law.fitting import (
    MOST_BASIS_FUNCTIONS,
    Recorded,
    as_demonstrations,
    default_steps,
    evenly_sampled,
    fit,
)
from noslip.law.law import Law
from noslip.primitive import ConstrainedDMP
from noslip.projection.feasibility import project_pose, require_consistent
from noslip.projection.metric import Metric, inverse_metric
from noslip.projection.pointwise import project_velocities
from noslip.projection.request import LEARNING, Request, Weights
from noslip.projection.result import ProjectedTrajectory
from noslip.projection.tool_first import kept_ends, projected_tool, tool_of
from noslip.projection.trajectory import project_heeding_what_it_can
from noslip.provenance import LearningRecord, Origin
from noslip.rule import BARRIER_RATE, STABILIZATION, Rule, no_rule
from noslip.runtime.motion import Motion
from noslip.runtime.rhythm import settled
from noslip.runtime.rollout import ProjectStart, require_choice, rollout
from noslip.runtime.timing import stretched, unhurried
from noslip.scale import require_motion
from noslip.series import Series
from noslip.spread import Spread
from noslip.trajectory import PoseTrajectory
from noslip.vectors import Trajectory
from noslip.verification import FOLLOWED, Deviation, followed_with, verify

P = ParamSpec("P")

_PAPERS = 100
"""Basis functions in the paper."""
FAR_SHARE = 0.05
"""Share of the path by which a primitive may leave its one demonstration without a warning: more is
seen with the eye."""
FAR_FROM_MEAN = 0.25
"""The same with several, whose mean it is: eight cuts by one hand lie up to 11 % off it."""
FAR_TURN = 67.5
"""Degrees (rms) by which the constraint may turn the tool without a warning: three quarters of what
a wrong axis does; the numerical example, which never turns its tool, is turned by 65."""
MOVED = 1e-3
"""Share of the path by which a limit may move an end without a warning: less is no obstacle."""
AWAY = 90.0
"""Degrees between a primitive's end and that of one of several demonstrations: beyond, it faces
away, and the mean of what ends so has no meaning."""

Fitted = tuple[Law, float, list[PoseTrajectory], list[ProjectedTrajectory | None]]
"""A law, how far it leaves what it follows, that, and the projections that led there."""


class Learning(TypedDict, total=False):
    """Options of :func:`learn` that say how, which other functions have too."""

    robot: Chain | str | Path | None
    basis_functions: int | Literal["auto"]
    alpha: float
    beta: float
    alpha_s: float
    ridge: float
    hold_position: bool
    start: End
    end: End | Literal["auto"]
    position_weight: float
    position_smoothing: float
    rotation_smoothing: float
    metric: Metric
    metric_length: float | None
    stabilization: float
    barrier_rate: float
    align: bool
    rhythmic: bool
    period: float | None
    project_start: ProjectStart


class _Options(Learning, total=False):
    """Options of :func:`learn`, but the one that says what it returns."""

    period: float | None
    context: Mapping[str, Sequence[float]] | None
    progress: Callable[[int, int], None] | None


class _Learning(Protocol):
    """What :func:`learn` is to a type checker: a distribution where one is asked for."""

    @overload
    def __call__(
        self,
        demonstrations: Recorded | Iterable[Recorded],
        constraints: ConstraintSystem | Constraint | Sequence[Constraint] = (),
        *,
        distribution: Literal[True],
        **options: Unpack[_Options],
    ) -> MotionDistribution: ...

    @overload
    def __call__(
        self,
        demonstrations: Recorded | Iterable[Recorded],
        constraints: ConstraintSystem | Constraint | Sequence[Constraint] = (),
        *,
        distribution: Literal[False] = False,
        **options: Unpack[_Options],
    ) -> ConstrainedDMP: ...


def _noted(learning: Callable[P, ConstrainedDMP | MotionDistribution]) -> _Learning:
    """Let what is learned hold the options that it was learned with."""

    @wraps(learning)
    def noted(*args: P.args, **options: P.kwargs) -> ConstrainedDMP | MotionDistribution:
        learned = learning(*args, **options)
        history = (Origin.of("learn", learning, *args, **options),)
        if isinstance(learned, MotionDistribution):
            return replace(learned, primitive=replace(learned.primitive, history=history))
        return replace(learned, history=history)

    return cast("_Learning", noted)


@_noted
def learn(
    demonstrations: Recorded | Iterable[Recorded],
    constraints: ConstraintSystem | Constraint | Sequence[Constraint] = (),
    *,
    robot: Chain | str | Path | None = None,
    basis_functions: int | Literal["auto"] = "auto",
    alpha: float = 25.0,
    beta: float = 6.25,
    alpha_s: float = 1.0,
    ridge: float = 1e-6,
    hold_position: bool = False,
    start: End = "free",
    end: End | Literal["auto"] = "auto",
    position_weight: float = LEARNING.position,
    position_smoothing: float = LEARNING.position_smoothing,
    rotation_smoothing: float = LEARNING.rotation_smoothing,
    metric: Metric = "auto",
    metric_length: float | None = None,
    stabilization: float = STABILIZATION,
    barrier_rate: float = BARRIER_RATE,
    align: bool = False,
    rhythmic: bool = False,
    period: float | None = None,
    distribution: bool = False,
    context: Mapping[str, Sequence[float]] | None = None,
    project_start: ProjectStart = "nothing",
    progress: Callable[[int, int], None] | None = None,
) -> ConstrainedDMP | MotionDistribution:
    """Learn a primitive from demonstrations that holds constraints exactly.

    Each demonstration is projected onto the constraints (the nearest trajectory that satisfies
    them), one primitive is fitted to all projected ones, and the Udwadia-Kalaba coupling term keeps
    its motion on the constraints at every step.

    Time gives way before the path: where the demonstrations' timing breaks a limit on speeds, rates
    or accelerations, the primitive takes the least duration, its law's, in which its motion keeps
    it; a warning tells both.

    Parameters
    ----------
    demonstrations : PoseTrajectory, Trajectory, or several of one kind
        Any rate, any start time.  Their channels are learned in phase with them.  Of vectors,
        constraints are declared of the coordinates, or of the tool that they carry as joints.
    constraints : Constraint or several
        Equalities, zero along the motion, and limits, not negative; none gives an ordinary pose
        primitive.
    robot : Chain, name or path of a model, optional
        That carries the tool, where demonstrations are of its joints; see
        :func:`noslip.robots.chain`.
    basis_functions : int or "auto"
        By default 100, as in the paper, and more where the primitive else leaves its projected
        demonstration by more than a thousandth of the path.
    alpha, beta, alpha_s, ridge : float
        As for :func:`noslip.law.fit`.
    hold_position : bool
        Project by the orientation alone, as in the paper.  By default the position gives way too,
        by a fraction of a thousandth of the path, which spares the tool sharp turns.
    start, end : "free", "position", "rotation" or "pose"
        What of the demonstrations' first and last sample the projection must keep.  By default the
        position where each ends ("auto"), unless a constraint on poses may want another.
    position_weight, position_smoothing, rotation_smoothing : float
        See :func:`noslip.project_trajectory`.
    metric : "auto", "position", "shared" or 6 positive weights
        Who gives way at run time: M of Gauss's principle, see :mod:`noslip.projection.metric`.
        "auto" is the position, as in the paper, where that can hold every constraint all along the
        demonstrations and no limit is about turning; else both.  Of a rhythm whose velocities are
        constrained it is both: so it turns back to its cycle.
    metric_length : float, optional
        Meters that weigh as much as a radian; by default the length of a mean step, twice the lever
        of a turn in it: with the lever itself, a tool turns 1.2 to 1.7 times as fast through a rest
        that its orientation was not made for, and is turned off its way round obstacles.
    stabilization : float
        Rate at which a violation present at the start decays, per duration.
    barrier_rate : float
        Rate at which the margins of limits may shrink that name none of their own, per duration.
    align : bool
        Bring several demonstrations into step first, see
        :func:`noslip.demonstrations.alignment.align`.
    rhythmic : bool
        Each demonstration is one period of a cycle, whose last sample is the first again, or holds
        several, which are learned together: the primitive goes round for ever.  Each period is
        projected as a cycle, which closes.
    period : float, optional
        Of a rhythm whose demonstrations hold several periods: seconds of one, about.  By default it
        is found, and told by a warning; see :func:`noslip.demonstrations.cycles.periods`.
    distribution : bool
        Return a :class:`noslip.distribution.MotionDistribution` of three demonstrations or more,
        to condition and to sample; its ``mean`` is a primitive.
    context : mapping of name to numbers, optional
        What the motions of a distribution depend on, a number a demonstration, such as the size of
        a workpiece.
    project_start : "velocity", "pose" or "nothing"
        What of the demonstrated start is replaced by the nearest that satisfies the constraints:
        its velocity (the paper's eq. 22), as a rollout does by itself, or its pose too; the
        unconstrained law then has it too.
    progress : callable, optional
        Called with (demonstrations done, all) after each projection.

    Raises
    ------
    InputError, ConstraintError
        If demonstrations or constraints are not what they must be: a demonstration stands still or
        turns by more than a third of a turn between samples, or two run in opposite directions.
    ConvergenceError
        If a projection does not converge; the message says what to change.
    MissedError
        If the primitive's own motion misses its goal or breaks a hard limit; says what helps.

    Warns
    -----
    RecordingWarning
        If several demonstrations start apart or are out of step, so that their mean follows none,
        or one is hardly in seconds, meters and radians.
    CompromiseWarning
        If the primitive leaves its demonstration, or the projection turns the tool far.
    """
    if rhythmic and distribution:
        raise InputError(
            "distribution=True is of motions that end, a rhythm does not: leave out rhythmic, of "
            "one period"
        )
    require_choice("project_start", project_start, ProjectStart)
    if context is not None and not distribution:
        raise InputError("context is what a distribution depends on; give distribution=True")
    if period is not None and not rhythmic:
        raise InputError("period is of a rhythm; give rhythmic=True, or leave it out")
    if rhythmic:
        unused = {
            "start": start != "free",
            "end": end != "auto",
            "alpha_s": alpha_s != 1,
            "project_start": project_start != "nothing",
        }
        for name, is_given in unused.items():
            if is_given:
                raise InputError(
                    f"{name} is of motions that end, and a rhythm goes round for ever; leave it out"
                )
    recorded = as_demonstrations(demonstrations)
    if robot is not None:
        recorded = _carried_by(robot, recorded)
    for demonstration in recorded:
        require_motion(demonstration)
    if rhythmic:
        recorded = [each for one in recorded for each in periods(one, period)]
    require_agreement(recorded, aligned=align)
    space = recorded[0].space
    if rhythmic:
        recorded = [closed(demonstration) for demonstration in recorded]
    system = as_system(constraints, space)
    if align:
        recorded = bring_into_step(recorded)
    beside = _channels_of(recorded)
    if beside:
        recorded = [d.with_channels(None) for d in recorded]
    fewest = _PAPERS
    if basis_functions != "auto":
        fewest = _arguments.count("basis_functions", basis_functions, MOST_BASIS_FUNCTIONS)
    mean_step = recorded[0].path_length / default_steps(recorded[0], fewest)

    def rule_along(demonstrations: Sequence[PoseTrajectory]) -> Rule:
        return Rule(
            system,
            inverse_metric(
                system, metric, metric_length, mean_step, demonstrations, returns=rhythmic
            ),
            stabilization=stabilization,
            barrier_rate=barrier_rate,
        )

    # What is out of range is refused before the projections take their time.
    rule_along(())
    for demonstration in recorded:
        require_consistent(system, demonstration)
    weights = Weights(position_weight, position_smoothing, rotation_smoothing)

    sampled = [evenly_sampled(d, fewest) for d in recorded]
    most = MOST_BASIS_FUNCTIONS if basis_functions == "auto" else fewest
    duration = float(np.mean([d.duration for d in recorded]))
    # A tool at rest does not turn.
    still = np.zeros(space.angular) if space.rotations else None
    turning = {
        at: None if any(np.any(np.hstack(kept_twist(d, at))) for d in recorded) else still
        for at in (0.0, 1.0)
    }

    def projected(
        demonstration: PoseTrajectory, shaping: ConstraintSystem, last: End
    ) -> ProjectedTrajectory:
        kept, of_tool = kept_ends(demonstration, space, start, last)
        ends = tuple(replace(end, angular_velocity=turning[end.at]) for end in kept)
        request = Request(demonstration, shaping, ends, weights, hold_position, tool_ends=of_tool)
        return project_heeding_what_it_can(request)

    def nearest(demonstration: PoseTrajectory, shaping: ConstraintSystem) -> ProjectedTrajectory:
        if rhythmic:
            cycle = Request(demonstration, shaping, (), weights, hold_position, is_periodic=True)
            return project_heeding_what_it_can(cycle)
        if end != "auto":
            return projected(demonstration, shaping, end)
        try:
            return projected(demonstration, shaping, _kept_end(system, demonstration))
        except ConvergenceError:
            # A rule that says how fast to go says how far.
            return projected(demonstration, shaping, "free")

    def fitted(several: Sequence[PoseTrajectory], count: int, factor: float = 1.0) -> Law:
        law = fit(
            several,
            basis_functions=count,
            alpha=alpha,
            beta=beta,
            alpha_s=alpha_s,
            ridge=ridge,
            rhythmic=rhythmic,
        )
        law = replace(law, duration=factor * duration, steps=default_steps(recorded[0], count))
        return _begun_on(law, system, project_start)

    def carried_out(shaping: ConstraintSystem, factor: float) -> Fitted:
        """Learn under what shapes the path, run through slower by a factor."""
        results = []
        for index, demonstration in enumerate(stretched(d, factor) for d in sampled):
            results.append(nearest(demonstration, shaping) if system.size else None)
            if progress is not None:
                progress(index + 1, len(recorded))
        followed = [d if r is None else r.trajectory for d, r in zip(sampled, results, strict=True)]
        slower = partial(fitted, factor=factor)
        law, off = followed_with(slower, followed, fewest, most)
        if system.size and len(followed) > 1:
            # Feasible motions have a mean that is not: it is projected as they were.
            mean: PoseTrajectory = rollout(
                law, no_rule(law.space), time_step=law.duration / (len(followed[0]) - 1)
            )
            if rhythmic:
                # It begins where they do in the mean, from which its cycle is a little off.
                mean = closed(mean)
            law = slower([nearest(mean, shaping).trajectory], law.basis.count)
        return law, off, followed, results

    def own_motion(found: Fitted, timeless: ConstraintSystem) -> Motion:
        return rollout(found[0], replace(rule_along(found[2]), system=timeless))

    (law, off, followed, results), pace = unhurried(system, carried_out, own_motion)
    if pace.factor > 1:
        warn(pace.told(law.duration), CompromiseWarning)
    count = law.basis.count
    rule = rule_along(followed)
    goal = Boundary(1.0, law.goal_position, law.goal_rotation)
    if rhythmic:
        law = settled(law, rule)
        goal = Boundary(1.0, law.start_position, law.start_rotation)
    # With fewer basis functions than it takes, by choice, it comes as near as these can.
    by_choice = basis_functions != "auto" and off > FOLLOWED
    motion, compromise = verify(law, rule, [goal], strict=not by_choice)
    if compromise:
        warn(compromise, CompromiseWarning)
    # Of joints that carry a tool, its path is what matters.
    seen = [tool_of(d, space) for d in sampled]
    seen_results = [
        r and projected_tool(r, d, space) for d, r in zip(sampled, results, strict=True)
    ]
    followed_by = tool_of(motion, space)
    record = tuple(
        LearningRecord.of(d, r, Deviation.between(followed_by, d))
        for d, r in zip(seen, seen_results, strict=True)
    )
    if off > FOLLOWED:
        remedy = "give more basis functions, or none for as many as it takes"
        if basis_functions == "auto":
            remedy = "low-pass the recording, let the position give way, or lower alpha_s"
        warn(
            f"{count} basis functions leave the demonstration by {off:.2g} of its path or turning; "
            f"{remedy}",
            CompromiseWarning,
        )
    _tell(record, sampled, system, rotation_smoothing, followed_by)
    demonstrated = fitted(sampled, count, pace.factor) if system.size else law
    channels = Channels.fit(law.basis, beside, ridge=ridge) if beside else None
    spread = Spread.about(law, followed)
    learned = ConstrainedDMP(law, rule, demonstrated, record, spread, channels=channels)
    if not distribution:
        return learned
    last = _kept_end(system, recorded[0]) if end == "auto" else end
    return MotionDistribution.about(learned, followed, context, (start, last))


def _channels_of(demonstrations: Sequence[PoseTrajectory]) -> list[Series]:
    """What demonstrations recorded beside their poses; empty if none did."""
    for one in demonstrations:
        if named := [name for name, part in getattr(one, "parts", {}).items() if part.channels]:
            raise InputError(
                f"{one.name}: {named[0]} has channels, which go with the pose of one body alone; "
                f"leave them out, {named[0]}.with_channels(None)"
            )
    found = [d.channels for d in demonstrations if isinstance(d, PoseTrajectory) and d.channels]
    if found and len(found) < len(demonstrations):
        without = next(d for d in demonstrations if getattr(d, "channels", None) is None)
        raise InputError(
            f"{without.name}: has no channels, but {found[0].name} has; read the same of all "
            "demonstrations"
        )
    return found


def _carried_by(
    robot: Chain | str | Path, demonstrations: list[PoseTrajectory]
) -> list[PoseTrajectory]:
    """Demonstrations of joints, as those of a robot that carries a tool."""
    chain: Chain = robot if isinstance(robot, Chain) else Supplied.functions["robots.chain"](robot)
    found: list[Any] = []
    for demonstration in demonstrations:
        if not isinstance(demonstration, Trajectory):
            raise InputError(
                f"{demonstration.name}: robot is for demonstrations of joints, a Trajectory; this "
                "one is of poses, which need none"
            )
        found.append(demonstration.on(chain))
    return found


def _kept_end(system: ConstraintSystem, demonstration: PoseTrajectory) -> End:
    """What of its last sample a demonstration keeps by default."""
    poses, last, space = system.of_poses, demonstration[-2:], system.space
    if poses.equalities.size:
        return "free"
    still = np.zeros((2, space.linear)), np.zeros((2, space.angular))
    margins = poses.residuals(last.clock, last.positions, last.quaternions, *still)
    return "position" if np.all(margins[-1] > 0) else "free"


def _in_the_way(
    system: ConstraintSystem, demonstration: PoseTrajectory, at: slice = slice(None)
) -> list[str]:
    """Names of the limits on poses that a demonstration does not keep, at some of its samples."""
    limits, space, times = system.of_poses.limits, system.space, demonstration.clock[at]
    poses = times, demonstration.positions[at], demonstration.quaternions[at]
    still = np.zeros((len(times), space.linear)), np.zeros((len(times), space.angular))
    broken = limits.residuals(*poses, *still).min(axis=0) < 0
    return list(dict.fromkeys(compress(limits.per_row(limits.names), broken)))


def _tell(
    record: Sequence[LearningRecord],
    demonstrations: Sequence[PoseTrajectory],
    system: ConstraintSystem,
    smoothing: float,
    motion: PoseTrajectory,
) -> None:
    """Warn of what a person should look at before trusting the primitive and its motion."""
    remedy = "low-pass the recording, give the tool's frame, or check the constraint's axes"
    for one in record:
        if np.degrees(one.rotation_change) > FAR_TURN:
            warn(
                f"{one.demonstration}: the constraint turns the tool by "
                f"{np.degrees(one.rotation_change):.0f} degrees (rms); {remedy}",
                CompromiseWarning,
            )
        if one.left_out:
            warn(
                f"{one.demonstration}: its projection cannot keep {', '.join(one.left_out)}; left "
                "to the run time: demonstrate a motion within the limits",
                CompromiseWarning,
            )
        if one.smoothing > 1.5 * smoothing:
            warn(
                f"{one.demonstration}: converged only with "
                f"{one.smoothing / smoothing:.0f} times the smoothing; {remedy}",
                CompromiseWarning,
            )
    several = len(record) > 1
    if several and (away := [r for r in record if np.degrees(r.end_rotation_error) > AWAY]):
        worst = max(away, key=lambda r: r.end_rotation_error)
        warn(
            f"the primitive ends facing away from {len(away)} of {len(record)} demonstrations, the "
            f"most {worst.demonstration}, by {np.degrees(worst.end_rotation_error):.0f} degrees; "
            "learn from each alone, or from those that end alike",
            CompromiseWarning,
        )
    far = FAR_FROM_MEAN if several else FAR_SHARE
    tools = [tool_of(each, system.space) for each in demonstrations]
    lengths, unit = [each.path_length for each in tools], tools[0].unit
    for where, at in (("starts", slice(0, 1)), ("ends", slice(-1, None))):
        mean = np.mean([each.positions[at] for each in tools], axis=0)
        moved = float(np.linalg.norm(motion.positions[at] - mean))
        broken = {name: None for each in demonstrations for name in _in_the_way(system, each, at)}
        if broken and moved > MOVED * min(lengths):
            warn(
                f"the primitive {where} {quantity_text(moved, unit)} from where demonstrations do, "
                f"which break {', '.join(broken)} there; loosen that, or demonstrate a motion that "
                f"{where} clear of it",
                CompromiseWarning,
            )
    left = [(r, n) for r, n in zip(record, lengths, strict=True) if r.path_error > far * n]
    if left:
        worst, length = max(left, key=lambda pair: pair[0].path_error)
        which = f"{len(left)} of {len(record)} demonstrations, the most " if several else ""
        if several:
            remedy = "learn from each alone, or from those that lie together"
        elif names := _in_the_way(system, demonstrations[0]):
            remedy = f"{', '.join(names)} in its way: loosen that, or demonstrate the way round"
        warn(
            f"the primitive leaves {which}{worst.demonstration} by "
            f"{quantity_text(worst.path_error, unit)} of a path of {quantity_text(length, unit)}; "
            f"{remedy}",
            CompromiseWarning,
        )


def _begun_on(law: Law, system: ConstraintSystem, what: ProjectStart) -> Law:
    """Return a law whose start satisfies the constraints: its velocity, or its pose too."""
    if what == "nothing" or not system.size:
        return law
    start, velocity, n = law.start, law.start_velocity / law.duration, law.space.linear
    if what == "pose":
        start = np.concatenate(project_pose(system, law.begin, start[:n], start[n:]))
    linear, angular, _ = project_velocities(
        system, 0.0, start[:n], start[n:], velocity[:n], velocity[n:]
    )
    velocity = law.duration * np.concatenate([linear, angular])
    return replace(law, start=start, start_velocity=velocity)
