"""A motion led to other ends: near the demonstration's, or by a maneuver."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip.adapting import compiled
from noslip.adapting.around import Around, samples_of
from noslip.adapting.connecting import Connection, Shape, Way, eased
from noslip.adapting.constants import MOST_SAMPLES
from noslip.adapting.ends import Velocity, asked, moving, placed, require_feasible
from noslip.adapting.impossible import require_reachable
from noslip.adapting.plan import (
    Adapted,
    Plan,
    Planning,
    Projecting,
    at_usual_speed,
    carried_out,
    giving_time,
    projected_along,
    projected_onto,
)
from noslip.boundary import Boundary, End, Point
from noslip.constraints.check import quantity_text
from noslip.constraints.system import ConstraintSystem
from noslip.errors import ConvergenceError, InputError, MissedError, Refusal
from noslip.law.fitting import fewest_steps
from noslip.law.law import Law
from noslip.law.scaling import Scaling, scaled
from noslip.projection.blend import through
from noslip.projection.request import ADAPTING, Request, Weights
from noslip.rule import Rule, no_rule
from noslip.runtime.motion import Motion
from noslip.runtime.rollout import initial_state, motion_from, point_or_parts, velocity_of
from noslip.runtime.state import State

_PER_GAP = 2
"""Basis functions from one place to pass to the next, which are to be told apart."""


def adapt(
    law: Law,
    rule: Rule,
    *,
    goal: Point | State | None = None,
    goal_position: ArrayLike | None = None,
    goal_rotation: Rotation | None = None,
    goal_velocity: Velocity = None,
    start_position: ArrayLike | None = None,
    start_rotation: Rotation | None = None,
    start_velocity: Velocity = None,
    duration: float | None = None,
    via: Iterable[Boundary | Sequence[Any]] = (),
    scaling: Scaling = "none",
    shape: Shape = "demonstrated",
    reverse: bool | None = None,
    start: End | State = "pose",
    end: End = "pose",
    samples: int | None = None,
    position_weight: float = ADAPTING.position,
    position_smoothing: float = ADAPTING.position_smoothing,
    rotation_smoothing: float = ADAPTING.rotation_smoothing,
) -> Adapted:
    """Find a law that starts, passes and ends elsewhere, and keeps the constraints.

    The law is rolled out without constraints, its motion moved to the new boundary values,
    projected onto the constraints with these values fixed, and fitted again.  Where that leads
    nowhere, backs up unasked, or goes astray, as it does to a goal behind a car, the motion is
    planned from a maneuver: the demonstration as far as it leads on, then arcs and straights in
    closed form, projected likewise.  ``record`` names it.

    Parameters
    ----------
    law : Law
    rule : Rule
    goal : array, shape (n,), or a pair (position, Rotation), optional
        A point of what moves: coordinates such as joints, or a pose; of several bodies a mapping of
        names to such pairs, in which those that are left out stay where the law has them.  Or the
        State that another motion begins in, or is in: it is reached with its velocity.
    goal_position, start_position : array, shape (n,), optional
        Meters, or the coordinates' own units; those of the law by default.
    goal_rotation, start_rotation : Rotation, optional
        Of a rhythm the goal is the baseline that it goes around; a rotation turns its path along.
    goal_velocity, start_velocity : 0, array of shape (n,) or (n + 3 b,), or "free", optional
        At rest (0), or linear velocity (m/s), then angular (rad/s), world frame; projected onto
        the constraints.  By default that of the law, turned with the tool where constraints tie
        velocities to it: what rests at an end rests there, and a blade that ends moving forward
        moves forward in its new heading.  "free" is whatever suits the motion; so it is by default
        where the motion does not rest at an end of which ``start`` or ``end`` keeps but a part.
    duration : float, optional
        tau (s).  By default that of the law, or what it takes to a goal so far that the motion
        would be more than twice as fast; and as much longer as limits on speeds, rates and
        accelerations need that the path stays as it is, told by a warning.  If given, the path is
        reshaped for such limits.
    via : sequence of (at, position), (at, position, rotation) or Boundary
        Points or poses to pass, at fractions of the duration.
    scaling : "none", "difference" or "rotation-dilation"
        How the path follows a new goal before it is projected, see
        :func:`noslip.law.scaling.scaled`.  Without scaling the displacement
        grows along the motion by minimum jerk.  Where the path turns, orientations that are
        not named turn along.
    shape : "demonstrated" or "shortest"
        Whether the demonstration's shape is kept as far as it leads to the goal, or the motion is
        planned from the shortest maneuver.
    reverse : bool, optional
        Whether the tool may back up where that is shorter; by default where a
        :class:`noslip.constraints.TurningRadius` that is declared lets it.
    start, end : "free", "position", "rotation" or "pose"
        What of the start and the goal is kept to; all of it by default.  What is not named in
        the call is that of the law.  The start may be the State that another motion is in: this
        one takes over from it, in its pose, with its velocity, at its time.
    samples : int, optional
        Of the projection; by default one a step, from 4 a basis function up to 2001.
    position_weight, position_smoothing, rotation_smoothing : float
        Of the projection, see :func:`noslip.project_trajectory`.

    Raises
    ------
    InputError, ConstraintError
        If an argument is not what it must be, or no motion under the constraints can end there.
    ConvergenceError
        If the projection does not converge.
    MissedError
        If the law's motion misses the goal, a via point or a hard limit, or such a limit cannot be
        kept in the duration given; the message says in which it can.
    """
    if duration is not None:
        duration = _arguments.positive("duration", duration, "seconds")
    if shape not in get_args(Shape):
        raise InputError(f"shape must be demonstrated or shortest, got {_arguments.short(shape)}")
    goal_velocity = _velocity_of(law, "goal", goal, goal_velocity)
    goal_position, goal_rotation = point_or_parts(law, "goal", goal, goal_position, goal_rotation)
    if isinstance(start, State):
        start_velocity = _velocity_of(law, "start", start, start_velocity)
        parts = point_or_parts(law, "start", start, start_position, start_rotation)
        start_position, start_rotation = parts
        law, start = replace(law, begin=start.time), "pose"
    named = {
        "start": (start_position, start_rotation, start_velocity),
        "goal": (goal_position, goal_rotation, goal_velocity),
    }
    weights = Weights(position_weight, position_smoothing, rotation_smoothing)
    if law.clock.returns:
        others = (*named["start"], goal_velocity, reverse, *via)
        if any(each is not None for each in others) or (scaling, shape) != ("none", "demonstrated"):
            raise InputError(
                "a rhythm is led to another baseline, goal_position and goal_rotation, in another "
                "period, duration; it starts, passes and ends nowhere else"
            )
        to = Around(law, rule, goal_position, goal_rotation, weights, samples)
        return giving_time(to.planned, law, rule, duration).told()
    passed, kept = Boundary.vias(via, rule.system.space), {"start": start, "goal": end}
    task = _Task(law, rule, named, kept, passed, weights, scaling, samples)

    def planned(planning: Planning) -> Adapted:
        return giving_time(planning, law, rule, duration)

    connection = task.connection(duration or law.duration, reverse)
    found: Adapted | None = None
    failed: ConvergenceError | MissedError | None = None
    if connection is not None and connection.proposals:
        if shape == "demonstrated" and connection.is_near:
            try:
                found = planned(partial(task.nearby, False))
            except (ConvergenceError, MissedError) as error:
                # There is a way, so that another that is refused tells less.
                failed = error if error.code == Refusal.TOO_FAST else None
            if found is not None and found.is_exact and connection.accepts(found.motion):
                return found.told()
        for way in connection.ways(shape == "shortest"):
            try:
                driven = planned(partial(task.driven, connection, way))
                if driven.is_exact:
                    return driven.told()
                found = found or driven
            except (ConvergenceError, MissedError) as error:
                failed = failed or error
                if error.code == Refusal.TOO_FAST:
                    break
    if found is None:
        try:
            found = planned(partial(task.nearby, True))
        except ConvergenceError as error:
            raise failed or (connection.refused(error) if connection else error) from error
        except MissedError as error:
            raise failed or error from error
    if connection is not None and (back := connection.backs_up(found.motion)):
        told = (
            f"the motion backs up along {quantity_text(back, 'm')}; declare ForwardOnly where it "
            "must not, or ask for it (reverse=True)"
        )
        found = replace(found, notes=(*found.notes, told))
    return found.told()


def _velocity_of(law: Law, name: str, point: Any, given: Velocity) -> Velocity:
    """The velocity of an end that is given as a state, or as it is given."""
    if not isinstance(point, State):
        return given
    if given is not None:
        raise InputError(f"{name}_velocity is given twice; {name} is a state, which has one")
    return velocity_of(law.space, name, point)


_Named = Mapping[str, tuple[ArrayLike | None, Rotation | None, Velocity]]


@dataclass(frozen=True, eq=False)
class _Task:
    """What an adaptation is asked for, and the ways to plan it.

    Attributes
    ----------
    law, rule
    named : mapping
        Position, rotation and velocity that are asked for at the start and at the goal.
    kept : mapping
        What is kept of each.
    passed : tuple of Boundary
        On the way.
    weights : Weights
    scaling : Scaling
    samples : int or None
    """

    law: Law
    rule: Rule
    named: _Named
    kept: Mapping[str, End]
    passed: tuple[Boundary, ...]
    weights: Weights
    scaling: Scaling
    samples: int | None

    def __post_init__(self) -> None:
        # What is wrong with them is said before anything is planned.
        assert self.free and self.count

    @cached_property
    def free(self) -> Law:
        """The law as its path follows the new ends before it is projected."""
        if self.scaling == "none":
            return self.law
        to = {f"{name}_position": named[0] for name, named in self.named.items()}
        return scaled(self.law, self.scaling, **to)

    @cached_property
    def functions(self) -> int:
        """Basis functions: as many as tell the places to pass apart."""
        found = self.law.basis.count
        gap = np.diff([0.0, *(place.at for place in self.passed), 1.0]).min()
        while found * gap < _PER_GAP and 2 * fewest_steps(found) < MOST_SAMPLES:
            found *= 2
        return found

    @cached_property
    def steps(self) -> int:
        """Of the motion that is found."""
        return self.law.steps * -(-fewest_steps(self.functions) // self.law.steps)

    @cached_property
    def count(self) -> int:
        """Samples of the projection."""
        return samples_of(self.functions, self.steps, self.samples)

    def own_motion(self, tau: float) -> Motion:
        """Return the law's motion in a duration, without constraints."""
        begun = initial_state(self.free, self.rule, duration=tau)
        alone = no_rule(self.law.space)
        return motion_from(self.free, alone, begun, tau / (self.count - 1))

    def ends(self, own: Motion, rule: Rule, tau: float) -> tuple[Boundary, Boundary]:
        """Return start and goal, of which what is not named is the law's own."""
        law, system = self.law, rule.system

        def reached(name: Literal["start", "goal"], *of_law: Any, at: float) -> Boundary:
            wanted = asked(name, *self.named[name], space=law.space)
            place = placed(wanted, of_law, system, rule.inverse_metric, at)
            if self.named[name][2] is not None:
                return place.part(self.kept[name])
            return moving(place, own, rule, at, self.kept[name])

        turns = (self.free.start_rotation, self.free.goal_rotation)
        start_turn, goal_turn = turns if law.space.rotations else (None, None)
        first = reached("start", law.start_position, start_turn, at=law.begin)
        last = reached("goal", law.goal_position, goal_turn, at=law.begin + tau)
        require_reachable(system, first, last)
        return first, last

    def connection(self, tau: float, reverse: bool | None) -> Connection | None:
        """Return what leads from start to goal; None where nothing says how the tool is steered."""
        own = self.own_motion(tau)
        ends = self.ends(own, self.rule, tau)
        if not self.law.space.is_pose:
            return None
        return Connection.of(self.rule.system, own, *ends, vias=len(self.passed), reverse=reverse)

    def nearby(self, patient: bool, system: ConstraintSystem, seconds: float | None) -> Plan:
        """Plan a motion near the law's own, merely led to the new ends.

        One that C does not find, or no first attempt, is looked for by who is patient.
        """
        law, held = self.law, replace(self.rule, system=system)

        def planned(tau: float) -> Plan:
            if made := self._compiled(held, tau):
                return made
            if self._is_for_c(held) and not patient:
                raise ConvergenceError(
                    "no motion near the demonstration's found", code=Refusal.NOT_FOUND
                )
            own = self.own_motion(tau)
            first, last = self.ends(own, held, tau)
            boundaries = (first, *self.passed, last)
            request = Request(
                own,
                system,
                boundaries,
                self.weights,
                begin=law.begin,
                # C, which plans where nothing is in the way, takes all its attempts.
                is_hurried=not patient and "position" in system.limits.row_levels,
            )
            for place in self.passed:
                time = request.begin + place.at * tau
                require_feasible(system, f"via at {place.at:g}", time, place)
                require_reachable(system, first, place, f"via at {place.at:g}")
            request = replace(request, reference=through(own, request.boundaries))
            return self._carried_out(held, request, self.steps, tau, projected_onto)

        return at_usual_speed(planned, law, seconds)

    def _is_for_c(self, held: Rule) -> bool:
        """Whether C plans it: a whole pose at the goal, and nothing else."""
        is_plain = set(self.kept.values()) == {"pose"} and not self.passed
        others = (*self.named["start"], self.named["goal"][2])
        is_plain &= all(value is None for value in others)
        is_plain &= self.law.space.is_pose
        return is_plain and compiled.is_ready(held, self.weights)

    def _compiled(self, held: Rule, tau: float) -> Plan | None:
        if not self._is_for_c(held):
            return None
        position, rotation, _ = self.named["goal"]
        to = asked("goal", position, rotation).pose_or(
            self.law.goal_position, self.free.goal_rotation
        )
        made = compiled.made(
            self.free, held, to, self.weights, duration=tau, samples=self.count, steps=self.steps
        )
        return None if made is None else Plan(made.law, made.request, made.projected)

    def driven(
        self, connection: Connection, way: Way, system: ConstraintSystem, seconds: float | None
    ) -> Plan:
        """Plan a motion from a maneuver."""
        law, held = self.law, replace(self.rule, system=system)

        def planned(tau: float) -> Plan:
            boundaries = self.ends(self.own_motion(tau), held, tau)
            reference = connection.reference(way, tau, self.count)
            request = Request(
                through(reference, boundaries),
                eased(system),
                boundaries,
                self.weights,
                begin=law.begin,
                # Half of it, for bends to be eased in.
                clearance=way.room / 2,
            )
            # Of steps as short as the law's.
            steps = round(self.steps * max(1.0, tau / law.duration))
            steps = min(steps, max(self.steps, MOST_SAMPLES - 1))
            found = self._carried_out(held, request, steps, tau, projected_along)
            return replace(found, maneuver=str(way))

        needed = connection.time_needed(way)
        if seconds is not None or needed <= law.duration:
            return at_usual_speed(planned, law, seconds)
        return planned(needed).noting(
            f"the motion takes {needed:.3g} s, not {law.duration:.3g}, at the pace of its law: "
            f"{way}; give a duration if it may be faster"
        )

    def _carried_out(
        self, held: Rule, request: Request, steps: int, tau: float, project: Projecting
    ) -> Plan:
        # A velocity that is merely kept gives way, by some 1e-4 of its peak, to the plan's first
        # step; else the motion would end 5e-6 of its path off.
        exact = self.named["start"][2] is not None or not request.boundaries[0].moves
        return carried_out(
            self.free,
            held,
            request,
            steps,
            tau,
            functions=self.functions,
            exact_start=exact,
            project=project,
        )
