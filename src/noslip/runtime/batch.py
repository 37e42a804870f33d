"""Thousands of motions of one primitive at once: other goals, starts and durations."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import Value
from noslip.bodies import Bodies
from noslip.codegen.library import Library
from noslip.errors import InputError
from noslip.law.channels import Channels
from noslip.law.entry import GoalForm
from noslip.law.law import Law
from noslip.law.layout import STATE, layouts
from noslip.law.points import rotation_of
from noslip.rule import Rule
from noslip.runtime.lost import require_defined
from noslip.runtime.motion import parts_of
from noslip.runtime.numbers import Struct
from noslip.runtime.rollout import ProjectStart, initial_state, steps_ahead
from noslip.runtime.stepper import stepper_of
from noslip.space import POSE, Space
from noslip.trajectory import PoseTrajectory
from noslip.vectors import Trajectory

_TOGETHER = 64
"""Motions a call: few enough for progress to be seen, enough for the call not to count."""


@dataclass(frozen=True, eq=False, repr=False)
class Motions(Value):
    """Motions of equally many samples, in one array.

    Attributes
    ----------
    durations : array, shape (M,)
        Seconds.
    begin : float
        Time at the start of each (s).
    states : array, shape (M, N, ...)
        Position, quaternion (qw, qx, qy, qz), linear and angular velocity, of each sample; of other
        spaces as :class:`noslip.law.layout.Layouts` says.
    constraint_residuals : array, shape (M, N, m)
    margins : array, shape (M, N, k)
        Of the limits.
    goals : array, shape (M, n + 4 b)
        Where each should end: position (m), quaternion (qw, qx, qy, qz).
    space : Space
        What moves.
    channels : Channels or None
        What goes with each of them.
    """

    durations: Floats
    begin: float
    states: Floats
    constraint_residuals: Floats
    margins: Floats
    goals: Floats
    space: Space = POSE
    channels: Channels | None = None

    def __repr__(self) -> str:
        return f"Motions({len(self)} of {self.states.shape[1]} samples)"

    def __len__(self) -> int:
        return len(self.states)

    @property
    def times(self) -> Floats:
        """Of the samples (s), shape (M, N)."""
        fractions = np.linspace(0.0, 1.0, self.states.shape[1])
        return self.begin + self.durations[:, None] * fractions

    @property
    def positions(self) -> Floats:
        """Meters, or the coordinates' own units, shape (M, N, n)."""
        return self.states[:, :, self._part("position")]

    @property
    def values(self) -> Floats:
        """The coordinates, shape (M, N, n)."""
        return self.positions

    def _part(self, name: str) -> slice:
        return layouts(self.space).state[name]

    @property
    def quaternions(self) -> Floats:
        """(qw, qx, qy, qz), shape (M, N, 4 b)."""
        return self.states[:, :, self._part("quaternion")]

    @property
    def linear_velocities(self) -> Floats:
        """Of the step that led to each sample (m/s), shape (M, N, n)."""
        return self.states[:, :, self._part("linear_velocity")]

    @property
    def angular_velocities(self) -> Floats:
        """Of the step that led to each sample (rad/s), world frame, shape (M, N, 3 b)."""
        return self.states[:, :, self._part("angular_velocity")]

    @property
    def path_lengths(self) -> Floats:
        """Of the polyline through the positions of each (m), shape (M,)."""
        lengths = np.empty(len(self))
        # A few at a time: thousands of motions are not copied.
        for first in range(0, len(self), _TOGETHER):
            steps = np.diff(self.positions[first : first + _TOGETHER], axis=1)
            squares = np.einsum("ijk,ijk->ij", steps, steps)
            lengths[first : first + _TOGETHER] = np.sqrt(squares).sum(axis=1)
        return lengths

    @property
    def end_errors(self) -> Floats:
        """Distance of each from its last sample to its goal (m), shape (M,)."""
        off = self.positions[:, -1] - self.goals[:, : self.space.linear]
        return np.asarray(np.linalg.norm(off, axis=1))

    @property
    def end_rotation_errors(self) -> Floats:
        """The same of the rotation (rad), shape (M,)."""
        n, b = self.space.linear, self.space.rotations
        ends = np.hstack([self.goals[:, :n], self.quaternions[:, -1]])
        turns = self.space.difference(ends, self.goals)[:, n:].reshape(len(self), b, 3)
        return np.asarray(np.linalg.norm(turns, axis=2).max(axis=1, initial=0.0))

    def __getitem__(self, index: int) -> PoseTrajectory:
        """One of them; of vectors a Trajectory, of several bodies Bodies."""
        states = self.states[index]
        fractions = np.linspace(0.0, 1.0, len(states))
        times = self.begin + self.durations[index] * fractions
        if not self.space.rotations:
            place, space = layouts(self.space).state, self.space
            values, rates = states[:, place["position"]], states[:, place["linear_velocity"]]
            name = f"rollout {index}"
            found = Trajectory(
                times, values, space.coordinates, rates, space.units, name, space.carrier
            )
            return cast("PoseTrajectory", found)
        if self.space.rotations > 1:
            both = Bodies(parts_of(times, states, self.space), name=f"rollout {index}")
            return cast("PoseTrajectory", both)
        motion = PoseTrajectory(
            times,
            states[:, STATE["position"]],
            Rotation.from_quat(states[:, STATE["quaternion"]], scalar_first=True),
            states[:, STATE["linear_velocity"]],
            states[:, STATE["angular_velocity"]],
            name=f"rollout {index}",
        )
        return motion.with_channels(None if self.channels is None else self.channels.along(motion))


def rollout_many(
    law: Law,
    rule: Rule,
    *,
    goals: ArrayLike | None = None,
    goal_rotations: Rotation | None = None,
    starts: ArrayLike | None = None,
    start_rotations: Rotation | None = None,
    durations: ArrayLike | None = None,
    steps: int | None = None,
    project_start: ProjectStart = "velocity",
    pull_in: float | None = None,
    goal_form: GoalForm = "minimum-jerk",
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Motions:
    """Roll a primitive out many times.

    Each motion is that of ``rollout(goal_position=goals[i], ...)`` to 1e-12.  With a C compiler
    all cores work on them; without one they are rolled out one after another.

    Parameters
    ----------
    law : Law
    rule : Rule
    goals, starts : array, shape (M, n), optional
        Meters, or the coordinates' own units; those of the primitive by default.
    goal_rotations, start_rotations : Rotation, M of them, optional
    durations : array, shape (M,), optional
        Seconds.  What is given at all is given for each motion.
    steps : int, optional
        Of each motion; the primitive's own by default.
    project_start, pull_in, goal_form
        As for :func:`noslip.runtime.rollout.rollout`.
    jobs : int, optional
        Threads; by default as many as this process may use cores.
    progress : callable, optional
        Called with (motions done, all).

    Raises
    ------
    InputError
        If an argument is not what it must be, or a motion does not stay finite.
    """
    places, n = layouts(law.space), law.space.linear
    beginning, size = places.beginning, places.state.size
    if law.space.rotations != 1 and not (goal_rotations is None and start_rotations is None):
        raise InputError("rotations: of many motions they are asked for where one thing turns")
    given = {
        "goals": None if goals is None else _rows("goals", goals, n),
        "goal_rotations": _quaternions("goal_rotations", goal_rotations),
        "starts": None if starts is None else _rows("starts", starts, n),
        "start_rotations": _quaternions("start_rotations", start_rotations),
        "durations": None if durations is None else _rows("durations", durations, 0),
    }
    counts = {name: len(values) for name, values in given.items() if values is not None}
    if not counts:
        raise InputError("nothing differs; give goals, starts, rotations of either or durations")
    count = max(counts.values())
    for name, found in counts.items():
        if found != count:
            longest = max(counts, key=lambda key: counts[key])
            raise InputError(f"{name} has {found} rows, but {longest} has {count}")
    if (taus := given["durations"]) is not None and not np.all(taus > 0):
        raise InputError(f"durations[{int(np.argmin(taus))}] is not positive (seconds)")
    steps = law.steps if steps is None else _arguments.count("steps", steps)
    workers = cores() if jobs is None else _arguments.count("jobs", jobs, 1024)

    firsts, beginnings = _beginnings(law, rule, count, given, project_start, pull_in, goal_form)
    states = np.empty((count, steps + 1, firsts.shape[1]))
    states[:, 0] = firsts
    library = stepper_of(rule).native.wait()
    tell = progress or (lambda done, total: None)
    if library is None:
        _one_by_one(law, rule, beginnings, states, tell)
    else:
        _together(law, rule, library, beginnings, states, workers, tell)
    for first in range(0, count, _TOGETHER):
        chunk = states[first : first + _TOGETHER]
        if not np.isfinite(chunk).all():
            finite = np.isfinite(chunk).all(axis=(1, 2))
            lost = first + int(np.argmin(finite))
            duration = beginnings[lost, beginning.index("duration")]
            times = np.linspace(law.begin, law.begin + duration, len(states[lost]))
            require_defined(rule.system, times, states[lost])
            raise InputError(
                f"motion {lost} is not finite; its start, goal or duration is out of what can be "
                "computed with"
            )
    margins = size + rule.system.equalities.size
    return Motions(
        beginnings[:, beginning.index("duration")].copy(),
        law.begin,
        states[..., :size],
        states[..., size:margins],
        states[..., margins:],
        beginnings[:, beginning.span("goal_position", "goal_quaternion")].copy(),
        law.space,
    )


def _rows(name: str, values: ArrayLike, columns: int) -> Floats:
    array = _arguments.numbers(name, values)
    shape = f"(M, {columns})" if columns else "(M,)"
    if array.ndim != (2 if columns else 1) or (columns and array.shape[1] != columns):
        raise InputError(f"{name} must have shape {shape}, got {array.shape}")
    if not len(array):
        raise InputError(f"{name} is empty; at least one row is needed")
    if not np.isfinite(array).all():
        row = int(np.argwhere(~np.isfinite(array))[0][0])
        raise InputError(f"{name}[{row}] is not finite")
    return array


def _quaternions(name: str, rotations: Rotation | None) -> Floats | None:
    if rotations is None:
        return None
    if not isinstance(rotations, Rotation) or rotations.single:
        raise InputError(f"{name} must be a SciPy Rotation of several, one a motion")
    return np.asarray(rotations.as_quat(scalar_first=True))


def cores() -> int:
    """How many cores this process may use."""
    # Those that this process may run on, where the system tells.
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _beginnings(
    law: Law,
    rule: Rule,
    count: int,
    given: dict[str, Floats | None],
    project_start: ProjectStart,
    pull_in: float | None,
    goal_form: GoalForm,
) -> tuple[Floats, Floats]:
    """First samples, as steps carry them, and what else ``noslip_rollouts`` wants of each."""

    def column(name: str, default: ArrayLike) -> Floats:
        values = given[name]
        if values is None:
            values = np.broadcast_to(
                np.asarray(default, dtype=np.float64), (count, np.size(default))
            )
        return values.reshape(count, -1)

    own, n, size = initial_state(law, rule), law.space.linear, law.space.point_size
    starts = np.hstack(
        [
            column("starts", own.position),
            column("start_rotations", own.quaternion),
            column("durations", [law.duration]),
        ]
    )
    # Projected once where they are the same; goals do not matter there.
    different, which = np.unique(starts, axis=0, return_inverse=True)
    found = []
    for start in different:
        state = initial_state(
            law,
            rule,
            start_position=start[:n],
            start_rotation=rotation_of(start[n:size]) if law.space.rotations else None,
            duration=start[size],
            project_start=project_start,
            pull_in=pull_in,
        )
        first = state.first_goal_quaternion
        clock = [state.duration, state.pull_in]
        found.append([*state.first_goal_position, *first, *clock, *state.carried(rule.system)])
    begun = np.array(found)[which.ravel()]
    goals = np.hstack(
        [
            column("goals", law.goal_position),
            column("goal_rotations", law.goal.quaternions),
        ]
    )
    beginning = layouts(law.space).beginning
    own_columns, firsts = np.split(begun, [beginning.size - goals.shape[1]], axis=1)
    beginnings = np.hstack([goals, own_columns])
    if goal_form == "paper":
        beginnings[:, beginning.span("first_goal_position", "first_goal_quaternion")] = goals
    return firsts, beginnings


def _together(
    law: Law,
    rule: Rule,
    library: Library,
    beginnings: Floats,
    states: Floats,
    workers: int,
    tell: Callable[[int, int], None],
) -> None:
    count, steps = len(states), states.shape[1] - 1
    struct = Struct(law, rule)
    drives = np.empty((steps, layouts(law.space).drive.size))
    windings = np.empty((steps, 4 * law.space.rotations))
    library.drives(struct.address, steps, drives.ctypes.data, windings.ctypes.data)

    def run(first: int) -> int:
        last = min(first + _TOGETHER, count)
        library.rollouts(
            struct.address,
            drives.ctypes.data,
            windings.ctypes.data,
            beginnings[first:last].ctypes.data,
            last - first,
            steps,
            states[first:last].ctypes.data,
        )
        return last - first

    done = 0
    with ThreadPoolExecutor(workers) as pool:
        for size in pool.map(run, range(0, count, _TOGETHER)):
            done += size
            tell(done, count)


def _one_by_one(
    law: Law,
    rule: Rule,
    beginnings: Floats,
    states: Floats,
    tell: Callable[[int, int], None],
) -> None:
    steps, stepper, own = states.shape[1] - 1, stepper_of(rule), initial_state(law, rule)
    outputs = np.empty((steps, stepper.outputs.size))
    places = layouts(law.space)
    size, beginning = places.state.size, places.beginning
    residuals = slice(size, size + rule.system.equalities.size)
    for index, row in enumerate(beginnings):
        begun = {name: row[beginning[name]] for name in beginning}
        state = replace(
            own,
            goal_position=begun["goal_position"],
            goal_rotation=begun["goal_quaternion"],
            first_goal_position=begun["first_goal_position"],
            first_goal_rotation=begun["first_goal_quaternion"],
            duration=begun["duration"].item(),
            pull_in=begun["pull_in"].item(),
            constraint_residuals=states[index, 0, residuals],
        )
        table = steps_ahead(law, rule, state, steps, state.duration / steps)
        stepper.run(states[index, 0], table, states[index, 1:], outputs)
        tell(index + 1, len(states))
