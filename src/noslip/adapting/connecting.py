"""Maneuvers that lead a law's motion to another goal, as references to be projected.

The demonstration's shape is kept as far as it goes: the first part of its motion, then the
maneuver that leads from there to the goal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip._values import Value
from noslip.boundary import Boundary
from noslip.constraints.declaration import Constraint
from noslip.constraints.edge_motion import edge_steps
from noslip.constraints.keep_out import KeepOut
from noslip.constraints.rates import AngularRateLimit
from noslip.constraints.system import ConstraintSystem
from noslip.constraints.travel import ForwardOnly, TurningRadius
from noslip.errors import ConvergenceError, InputError
from noslip.maneuvers.driving import Pace, driven, effort, time_needed
from noslip.maneuvers.maneuver import Maneuver, integrated
from noslip.maneuvers.steering import EASED, MARGIN, Steering
from noslip.projection.blend import through
from noslip.projection.heading import PLUNGING
from noslip.quaternions import inverse, product, turns_between
from noslip.runtime.motion import Motion
from noslip.trajectory import PoseTrajectory

Shape = Literal["demonstrated", "shortest"]
LONGER = 1.03
"""A motion so much longer than the shortest maneuver, and what the demonstration is longer than its
own, has gone astray."""
BACKED = 0.01
"""Share of its way that a tool may back up, beyond what it does anyway, before it is told."""
_STRAIGHT, _SHAPED = 0.01, 1.5
"""Share of its way by which a demonstration is longer than the shortest maneuver between its ends
if it has a shape of its own; and how much longer a motion may be then, to keep some of it."""
_HOPELESS = 1.5
"""A maneuver so much longer than the demonstration's motion, merely moved to the goal, is far from
it: what is found near that is rarely the way there, and takes as long as the rest."""
EXACT, EXACT_TURN = 1e-4, 1e-3
"""Share of the path, and turn (rad), by which a motion under a turning radius may end off its goal:
a maneuver ends nearer."""
_KEPT = (0.9, 0.75, 0.5, 0.25)
"""Shares of the demonstration's way that are kept, the most first; less of it shows no shape."""
_ROOMS, _SHARED = (0.04, 0.01), 0.5
"""Shares of the demonstration's way that are kept from what is in the way, since bends are eased
and projected, and a barrier brakes what heads for it; and of what the ends keep themselves."""
_MOST = 4
"""Maneuvers that are tried: where two lead nowhere, a third rarely does."""
_SAMPLED = 400
"""Steps in which a way is seen to be clear: those of the projection are judged again."""
_PIECES = 100
"""Of what is kept: as many as a law has basis functions, which know no more of it."""
_STILL = 0.2
"""Way (over the lever) that a radian counts for along a demonstration, so that turns take time."""


def eased(system: ConstraintSystem) -> ConstraintSystem:
    """Return a system whose turning radii have a margin (:data:`MARGIN`)."""
    if not any(isinstance(c, TurningRadius) for c in system.constraints):
        return system

    def wider(constraint: Constraint) -> Constraint:
        if not isinstance(constraint, TurningRadius):
            return constraint
        return replace(constraint, radius=EASED * constraint.radius)

    return ConstraintSystem([wider(c) for c in system.constraints])


@dataclass(frozen=True)
class Way:
    """A way to a goal: what is kept of the demonstration, then a maneuver.

    Attributes
    ----------
    maneuver : Maneuver
    steps : int
        That are kept of the demonstration.
    kept : float
        Share of its way that these are.
    room : float
        That it keeps from what must not be touched (m).
    """

    maneuver: Maneuver
    steps: int = 0
    kept: float = 0.0
    room: float = 0.0

    def __str__(self) -> str:
        if not self.kept:
            return str(self.maneuver)
        return f"{self.kept:.0%} of the demonstration, then {self.maneuver}"


@dataclass(frozen=True, eq=False)
class Connection(Value):
    """What leads from a start to a goal, for a tool that is steered.

    Attributes
    ----------
    steering : Steering
    own : PoseTrajectory
        The law's motion without constraints.
    first, last : Boundary
        Start and goal.
    system : ConstraintSystem
    vias : int
        How many places are to be passed on the way.
    """

    steering: Steering
    own: PoseTrajectory
    first: Boundary
    last: Boundary
    system: ConstraintSystem
    vias: int = 0

    @classmethod
    def of(
        cls,
        system: ConstraintSystem,
        own: PoseTrajectory,
        first: Boundary,
        last: Boundary,
        *,
        vias: int,
        reverse: bool | None,
    ) -> Connection | None:
        """Return it for what is declared; None where nothing says how the tool is steered.

        Raises
        ------
        InputError
            If it is to back up, and a constraint forbids that.
        """
        forward = [
            name
            for name, c in zip(system.names, system.constraints, strict=True)
            if isinstance(c, ForwardOnly) or (isinstance(c, TurningRadius) and not c.reverse)
        ]
        if reverse and forward:
            raise InputError(
                f"reverse=True, but {forward[0]!r} lets the tool move forward only; leave that out "
                "or declare TurningRadius(..., reverse=True)"
            )
        if reverse is None:
            radii = [c for c in system.constraints if isinstance(c, TurningRadius)]
            reverse = not forward and any(c.reverse for c in radii)
        steering = Steering.of(system, reverse)
        return None if steering is None else cls(steering, own, first, last, system, vias)

    def accepts(self, motion: Motion) -> bool:
        """Whether a motion went where it should: not astray, and not backwards unless asked to."""
        if self.steering.radius and (
            motion.end_error > EXACT * motion.path_length or motion.end_rotation_error > EXACT_TURN
        ):
            return False
        if np.isfinite(self.pace.rate) and motion.duration > LONGER * max(
            self.own.duration, self.time_needed(Way(self.proposals[0]))
        ):
            # A turn where the tool stands takes less time than one on the way.
            return False
        return self.backs_up(motion) == 0 and self._driven(motion) <= self.longest

    def _driven(self, motion: PoseTrajectory) -> float:
        """Way of the edge in a motion (m)."""
        edged = self.system.edged
        assert edged is not None
        speeds = np.linalg.norm(edge_steps(motion, edged).velocities, axis=1)
        return float(speeds @ np.diff(motion.times))

    @cached_property
    def _ends(self) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
        """Poses of the edge at the start and at the goal."""
        found = []
        for boundary in (self.first, self.last):
            assert boundary.position is not None and boundary.rotation is not None
            found.append(self.steering.seen(boundary.position, boundary.rotation))
        return found[0], found[1]

    @cached_property
    def _steps(self) -> Floats:
        """The law's motion as body twists of its edge, shape (N - 1, 6)."""
        points, axes = self.steering.seen(self.own.positions, self.own.rotations)
        back = inverse(axes[:-1])
        way = Rotation.from_quat(axes[:-1], scalar_first=True).inv().apply(np.diff(points, axis=0))
        turns = turns_between(np.tile([1.0, 0, 0, 0], (len(back), 1)), product(back, axes[1:]))
        # The chord of a step lies half of its turn ahead of where the step begins.
        return np.column_stack([Rotation.from_rotvec(-turns / 2).apply(way), turns])

    @cached_property
    def pace(self) -> Pace:
        """That of the law's motion."""
        way = np.linalg.norm(self._steps[:, :3], axis=1)
        angles = np.linalg.norm(self._steps[:, 3:], axis=1)
        # Of a demonstration that only turns, the way to the goal.
        length = float(way.sum()) or (self._distance if self._is_whole else 0.0) or 1.0
        done = np.maximum(way, _STILL * length / (2 * np.pi) * angles)
        shares = np.concatenate([[0.0], np.cumsum(done)])
        count = len(shares)
        shares = shares / shares[-1] if shares[-1] else np.linspace(0, 1, count)
        limits = self.system.constraints
        rates = [c.rate for c in limits if isinstance(c, AngularRateLimit)]
        return Pace(length, self.own.duration, shares, min(rates, default=np.inf) / MARGIN)

    @property
    def _is_whole(self) -> bool:
        """Whether it leads from a whole pose to another, and past nothing else."""
        return not self.vias and self.first.is_pose and self.last.is_pose

    @property
    def _distance(self) -> float:
        return float(np.linalg.norm(self._ends[1][0] - self._ends[0][0]))

    @cached_property
    def proposals(self) -> list[Maneuver]:
        """Maneuvers from the start to the goal, the shortest first.

        None where they are no whole poses, or more is to be passed.
        """
        if not self._is_whole:
            return []
        return self.steering.proposals(*self._ends)

    @cached_property
    def _detour(self) -> float:
        """How much longer the demonstration is than the shortest maneuver between its ends (m)."""
        points, axes = self.steering.seen(self.own.positions, self.own.rotations)
        found = self.steering.proposals((points[0], axes[0]), (points[-1], axes[-1]))
        shortest = self._length(found[0]) if found else self.pace.way
        return max(self.pace.way - shortest, 0.0)

    def _length(self, maneuver: Maneuver) -> float:
        return sum(effort(each, self.pace.lever) for each in maneuver.stretches)

    @property
    def is_near(self) -> bool:
        """Whether the goal may be reached by a motion near the demonstration's, moved there."""
        if not self._is_measured:
            return True
        moved = through(self.own, [self.first, self.last])
        return self.proposals[0].length <= _HOPELESS * (moved.path_length + self._detour)

    @property
    def longest(self) -> float:
        """Length beyond which a motion has gone astray (m)."""
        if not self._is_measured:
            return np.inf
        return self._longer * (self.proposals[0].length + self._detour)

    @property
    def _longer(self) -> float:
        """How much longer than the shortest a motion may be that keeps what it can of the shape."""
        return LONGER if self._detour <= _STRAIGHT * self.pace.way else _SHAPED

    @cached_property
    def _is_measured(self) -> bool:
        """Whether motions are measured by the shortest maneuver: one that is driven, and clear."""
        if not (self.proposals and self.steering.radius):
            return False
        return self._is_clear(Way(self.proposals[0]))

    def refused(self, error: ConvergenceError) -> ConvergenceError:
        """Return an error that tells where a needle comes to instead, which has no maneuver."""
        if not (self.steering.curvature and self._is_whole):
            return error
        return ConvergenceError(
            f"{error}; {self.steering.nearest(*self._ends)}",
            code=error.code,
            iterate=error.iterate,
            duration=error.duration,
        )

    def backs_up(self, motion: PoseTrajectory) -> float:
        """Way (m) that a motion backs up; 0 if that is asked for, or next to none."""
        if self.steering.reverse:
            return 0.0
        edged = self.system.edged
        assert edged is not None
        back = []
        for each in (motion, self.own):
            seen = edge_steps(each, edged)
            ahead = seen.forward_speed
            # A tool that plunges goes a hair backwards as often as forwards.
            goes_back = ahead < -PLUNGING * np.linalg.norm(seen.velocities, axis=1)
            back.append(float(-(ahead * np.diff(each.times))[goes_back].sum()))
        slack = BACKED * max(motion.path_length, self.pace.way)
        return back[0] if back[0] - back[1] > slack else 0.0

    def ways(self, shortest: bool) -> Iterator[Way]:
        """A few ways to the goal that are clear, the best first: around what is in the way."""
        if not self._kept_out.size:
            yield from islice(self._straightaway(shortest), _MOST)
            return
        least = min(self._margins(*map(np.atleast_2d, end))[0] for end in self._ends)
        for share in _ROOMS:
            room = float(min(share * self.pace.way, _SHARED * max(least, 0.0)))
            clear = (way for way in self._straightaway(shortest) if self._is_clear(way, room))
            for way in islice(clear, _MOST):
                yield replace(way, room=room)

            def margins(positions: Floats, quaternions: Floats, room: float = room) -> Floats:
                return self._margins(positions, quaternions) - room

            around = self.steering.around(*self._ends, margins, self._reach)
            if around is not None:
                yield Way(around, room=room)

    def _straightaway(self, shortest: bool) -> Iterator[Way]:
        if not self.proposals:
            return
        most = self._longer * (self._length(self.proposals[0]) + self._detour)
        # What is kept of an insertion leads a needle past what it could still reach.
        if not (shortest or self.steering.curvature):
            points, axes = integrated(self._steps, *self._ends[0])
            gone = np.linalg.norm(self._steps[:, :3], axis=1).cumsum()
            for share in _KEPT:
                k = int(np.searchsorted(gone, share * gone[-1]))
                found = self.steering.proposals((points[k + 1], axes[k + 1]), self._ends[1])
                if found and gone[k] + self._length(found[0]) <= most:
                    yield Way(found[0], k + 1, share)
                    break
        for maneuver in self.proposals:
            yield Way(maneuver)

    @cached_property
    def _kept_out(self) -> ConstraintSystem:
        """Hard limits of poses: what may be in the way."""
        limits = self.system.limits
        return limits.part([c.level == "position" and c.priority == 0 for c in limits.constraints])

    def _margins(self, points: Floats, axes: Floats) -> Floats:
        """Least margins (m) of poses of the edge, shape (N,)."""
        positions, rotations = self.steering.carried(points, axes)
        still, quaternions = np.zeros_like(positions), rotations.as_quat(scalar_first=True)
        least = np.full(len(positions), np.inf)
        fields = [c for c in self._kept_out.constraints if isinstance(c, KeepOut)]
        for each in fields:
            # Not through a graph: of thousands of poses it takes fifty times as long.
            least = np.minimum(least, each.margins(positions, rotations))
        others = self._kept_out.part([c not in fields for c in self._kept_out.constraints])
        if others.size:
            found = others.residuals(np.zeros(len(positions)), positions, quaternions, still, still)
            least = np.minimum(least, found.min(axis=1))
        return np.asarray(least)

    @property
    def _reach(self) -> float:
        """From the edge's point to the farthest point of the tool that is kept out (m)."""
        at = np.array(self.steering.edge.point)
        points = [getattr(c, "reference_point", at) for c in self._kept_out.constraints]
        spheres = [
            np.add(center, point)
            for c, point in zip(self._kept_out.constraints, points, strict=True)
            for center, _ in getattr(c, "spheres", ())
        ]
        return max(float(np.linalg.norm(p - at)) for p in [*points, *spheres])

    def _is_clear(self, way: Way, room: float = 0.0) -> bool:
        """Whether a way, as it is sampled, keeps so far (m) from what it must not touch."""
        if not self._kept_out.size:
            return True
        twists = driven(way.maneuver, self.pace, _SAMPLED, self._pieces(way.steps))
        return bool(np.all(self._margins(*integrated(twists, *self._ends[0])) >= room))

    def time_needed(self, way: Way) -> float:
        """Seconds that a way takes at the demonstration's pace."""
        return time_needed(way.maneuver, self.pace, self._pieces(way.steps))

    def reference(self, way: Way, duration: float, count: int) -> PoseTrajectory:
        """Return a way as samples in time.

        Easing leaves it a little beside the goal.
        """
        before = self._pieces(way.steps)
        twists = driven(way.maneuver, self.pace, count - 1, before)
        points, axes = integrated(twists, *self._ends[0])
        positions, rotations = self.steering.carried(points, axes)
        times = np.linspace(0.0, duration, count)
        return PoseTrajectory(times, positions, rotations, name=self.own.name)

    def _pieces(self, steps: int) -> Floats:
        """The kept part of the demonstration as a few body twists, shape (K, 6)."""
        if not steps:
            return np.zeros((0, 6))
        starts = np.unique(np.linspace(0, steps, _PIECES, endpoint=False).astype(int))
        return np.add.reduceat(self._steps[:steps], starts)
