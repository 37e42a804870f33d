"""Position and orientation together: the primitive of a tool's pose."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.errors import InputError
from noslip.primitives.attractor import Attractor
from noslip.primitives.basis import Basis
from noslip.primitives.orientation import OrientationDMP
from noslip.primitives.phase import Phase
from noslip.primitives.position import PositionDMP
from noslip.primitives.stepping import AT_ONCE, CLOCK, KICK, STATE_SIZE, Stepper, step_table
from noslip.trajectory import PoseTrajectory

T = TypeVar("T")

SAMPLES_PER_BASIS_FUNCTION = 5
"""A demonstration with fewer samples is splined to this many before fitting."""
MOST_BASIS_FUNCTIONS = 2000
HELD = 1e-9
"""A margin above minus this counts as kept."""
ProjectStart = Literal["velocity", "pose", "nothing"]
HELD_RESIDUAL = 1e-12
"""Residual that rounding causes, over the largest velocity, or 1."""
DONE = 1 - 1e-9
"""Fraction of the duration from which on a motion has come to its end."""
SAME_STEP = 1e-6
"""Relative difference up to which a last step counts as equal: that of rounded times."""
FEWEST_STEPS = 200
"""A rollout takes at least this many steps unless told otherwise."""


class _Turn:
    """Field of a rotation that is made from a quaternion only when it is asked for.

    A control loop seldom asks, and making one takes longer than the step.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self._kept = f"_{name}"

    def __get__(self, state: Any, owner: type | None = None) -> Rotation:
        if state is None:
            # So that dataclasses take it for a field without default.
            raise AttributeError
        kept = state.__dict__[self._kept]
        if isinstance(kept, np.ndarray):
            kept = state.__dict__[self._kept] = Rotation.from_quat(kept, scalar_first=True)
        return kept

    def __set__(self, state: Any, value: Rotation | Floats) -> None:
        state.__dict__[self._kept] = value


@dataclass(frozen=True, eq=False, kw_only=True)
class State:
    """Everything that a primitive in motion knows; immutable, each step gives a new one.

    Attributes
    ----------
    time : float
        Since the start (s).
    phase : float
        From 1 down to ``exp(-alpha_s)`` at the end.
    position : array, shape (3,)
        Meters.
    rotation : Rotation
        Or a unit quaternion (qw, qx, qy, qz) where one is made; also ``goal_rotation``.
    linear_velocity, angular_velocity : array, shape (3,)
        Of the step that led here (at the start: of that instant); m/s and rad/s, world frame.
    previous_step : float
        Length of that step (s); 0 at the start.
    duration : float
        tau (s).
    goal_position : array, shape (3,)
    goal_rotation : Rotation
    pull_in : float
        Rate at which a violation decays (1/s).
    steering : array, shape (3,)
        Turn of the orientation's target (rad, world frame), see :mod:`noslip.runtime.steering`.
    constraint_residuals, multipliers : array, shape (m,)
        Of the equalities.
    margins, limit_multipliers : array, shape (k,)
        Of the limits.
    acceleration : array, shape (6,)
        Of that step: linear (m/s^2), then angular (rad/s^2), world frame.
    constraint_forces : array, shape (6,)
        What the constraints added to it.
    done : bool
        Whether the motion has come to its end.
    """

    time: float
    phase: float
    position: Floats
    rotation: _Turn = _Turn()
    linear_velocity: Floats
    angular_velocity: Floats
    previous_step: float
    duration: float
    goal_position: Floats
    goal_rotation: _Turn = _Turn()
    pull_in: float = 0.0
    steering: Floats = field(default_factory=lambda: np.zeros(3))
    constraint_residuals: Floats = field(default_factory=lambda: np.zeros(0))
    multipliers: Floats = field(default_factory=lambda: np.zeros(0))
    margins: Floats = field(default_factory=lambda: np.zeros(0))
    limit_multipliers: Floats = field(default_factory=lambda: np.zeros(0))
    acceleration: Floats = field(default_factory=lambda: np.zeros(6))
    constraint_forces: Floats = field(default_factory=lambda: np.zeros(6))
    done: bool = False

    @property
    def quaternion(self) -> Floats:
        """Of the rotation: (qw, qx, qy, qz)."""
        kept = self.__dict__["_rotation"]
        if isinstance(kept, np.ndarray):
            return kept
        return np.asarray(kept.as_quat()[[3, 0, 1, 2]])

    def vector(self) -> Floats:
        """Pose and velocities as the stepper's state vector."""
        return np.concatenate(
            [self.position, self.quaternion, self.linear_velocity, self.angular_velocity]
        )


@dataclass(frozen=True)
class GaveWay:
    """A limit that did not hold throughout.

    Attributes
    ----------
    name : str
    amount : float
        Largest violation, in the margin's unit.
    time : float
        When (s).
    share : float
        Share of the samples in violation.
    """

    name: str
    amount: float
    time: float
    share: float


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Motion(PoseTrajectory):
    """A rolled-out motion and what the constraints did to it.

    ``linear_velocities[k]`` and ``angular_velocities[k]`` belong to the step that led to sample k,
    so that ``positions[k+1] == positions[k] + dt * linear_velocities[k+1]``.

    Attributes
    ----------
    constraint_residuals : array, shape (N, m)
        m/s, or the constraint's own unit; one column a row of the equalities.
    multipliers : array, shape (N, m)
        Lagrange multipliers lambda of the accelerations.
    constraint_forces : array, shape (N, 6)
        ``a - a_unconstrained``: linear (m/s^2), then angular (rad/s^2), world frame.
    constraint_names : tuple of str
        One a column.
    margins, limit_multipliers : array, shape (N, k)
        The same of the limits; a margin below zero is a violation, a multiplier above zero a push.
    limit_names : tuple of str
    row_forces : array, shape (N, m + k, 6)
        The part of ``constraint_forces`` that each equality, then each limit, causes.
    """

    constraint_residuals: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    multipliers: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    constraint_forces: Floats = field(default_factory=lambda: np.zeros((0, 6)))
    constraint_names: tuple[str, ...] = ()
    margins: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    limit_multipliers: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    limit_names: tuple[str, ...] = ()
    row_forces: Floats = field(default_factory=lambda: np.zeros((0, 0, 6)))

    def __post_init__(self) -> None:
        super().__post_init__()
        rows, limits = len(self.constraint_names), len(self.limit_names)
        self._freeze("constraint_residuals", self.constraint_residuals, (rows,))
        self._freeze("multipliers", self.multipliers, (rows,))
        self._freeze("constraint_forces", self.constraint_forces, (6,))
        if not limits and not len(self.margins):
            none = np.zeros((len(self.times), 0))
            object.__setattr__(self, "margins", none)
            object.__setattr__(self, "limit_multipliers", none)
        if not len(self.row_forces):
            object.__setattr__(self, "row_forces", np.zeros((len(self.times), rows + limits, 6)))
        self._freeze("margins", self.margins, (limits,))
        self._freeze("limit_multipliers", self.limit_multipliers, (limits,))
        self._freeze("row_forces", self.row_forces, (rows + limits, 6))

    @classmethod
    def of_steps(
        cls,
        times: Floats,
        states: Floats,
        outputs: dict[str, Floats],
        constraint_names: tuple[str, ...],
        limit_names: tuple[str, ...],
    ) -> Motion:
        """Return what a stepper has made, which takes it over: only NaN is looked for.

        Parameters
        ----------
        times : array, shape (N,)
        states : array, shape (N, 13)
        outputs : dict of array, shape (N, ...)
            Named as :func:`noslip.primitives.stepping.output_columns` does.
        constraint_names, limit_names : tuple of str
            One a row.
        """
        for part in (states, outputs["values"]):
            if not np.isfinite(part).all():
                row = int(np.argmin(np.isfinite(part).all(axis=1)))
                raise InputError(
                    f"the motion is not finite from {times[row]:.6g} s on; start, goal or "
                    "constraints are out of what can be computed with"
                )
        rows, values, multipliers = (
            len(constraint_names),
            outputs["values"],
            outputs["multipliers"],
        )
        motion = object.__new__(cls)
        arrays = {
            "times": times,
            "positions": states[:, 0:3],
            "linear_velocities": states[:, 7:10],
            "angular_velocities": states[:, 10:13],
            "constraint_residuals": values[:, :rows],
            "multipliers": multipliers[:, :rows],
            "constraint_forces": outputs["force"],
            "margins": values[:, rows:],
            "limit_multipliers": multipliers[:, rows:],
            "row_forces": outputs["parts"].reshape(len(times), rows + len(limit_names), 6),
        }
        for array in arrays.values():
            array.flags.writeable = False
        motion.__dict__.update(
            arrays,
            # Each step has normalized them; SciPy would take a fifth of the rollout's time.
            rotations=Rotation(states[:, [4, 5, 6, 3]], normalize=False, copy=False),
            constraint_names=constraint_names,
            limit_names=limit_names,
            name="rollout",
        )
        return motion

    @property
    def clock(self) -> Floats:
        """Times as constraints see them: its own, which begin where a re-planned motion does."""
        return self.times

    def force_of(self, name: str) -> Floats:
        """What one constraint or limit added to the acceleration, shape (N, 6).

        Parameters
        ----------
        name : str
            Of a constraint, all of its rows together, or of a single row ("needle [0]").
        """
        names = (*self.constraint_names, *self.limit_names)
        columns = [i for i, row in enumerate(names) if row == name or row.startswith(f"{name} [")]
        if not columns:
            raise InputError(f"no constraint {name!r} took part; there are {', '.join(names)}")
        return np.asarray(self.row_forces[:, columns].sum(axis=1))

    @property
    def gave_way(self) -> tuple[GaveWay, ...]:
        """Limits that did not hold throughout, and by how much; empty if all did."""
        found = []
        for name, margin in zip(self.limit_names, self.margins.T, strict=True):
            worst = int(np.argmin(margin))
            if margin[worst] < -HELD:
                share = float(np.mean(margin < -HELD))
                found.append(GaveWay(name, float(-margin[worst]), float(self.times[worst]), share))
        return tuple(found)


@dataclass(frozen=True, eq=False, repr=False)
class PoseDMP:
    """A pose primitive without coupling: position and orientation driven by one phase.

    Attributes
    ----------
    position : PositionDMP
    orientation : OrientationDMP
    phase : Phase
    duration : float
        Demonstrated (mean), seconds: the default tau.
    steps : int
        Steps of a rollout by default: the demonstration's own, 200 or more.
    """

    position: PositionDMP
    orientation: OrientationDMP
    phase: Phase
    duration: float
    steps: int

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({self.position.forcing.basis.count} basis functions, "
            f"{self.duration:.6g} s, {self.steps} steps)"
        )

    # ---------------------------------------------------------------- learning

    @classmethod
    def fit(
        cls,
        demonstrations: PoseTrajectory | Iterable[PoseTrajectory],
        *,
        basis_functions: int = 100,
        alpha: float = 25.0,
        beta: float = 6.25,
        alpha_s: float = 1.0,
        ridge: float = 1e-6,
    ) -> PoseDMP:
        """Fit one primitive to one demonstration or several, by ridge regression.

        Each demonstration is taken over its own duration and to its own goal; the primitive gets
        their mean start, goal and duration.

        Parameters
        ----------
        demonstrations : PoseTrajectory or several
            Any rate and start time; irregular ones are splined to their median rate, short ones
            to 5 samples a basis function.
        basis_functions : int
        alpha, beta, alpha_s : float
            The paper's constants, 25, 6.25 and 1 by default.
        ridge : float
            Regularization, relative to the basis functions' mean square.

        Raises
        ------
        InputError
            If there is no demonstration or a constant is out of range.
        """
        recorded = as_demonstrations(demonstrations)
        basis_functions = _arguments.count("basis_functions", basis_functions, MOST_BASIS_FUNCTIONS)
        ridge = _arguments.not_negative("ridge", ridge)
        phase = Phase(_arguments.positive("alpha_s", alpha_s))
        basis = Basis(basis_functions, phase)
        attractor = Attractor(alpha, beta)
        sampled = [evenly_sampled(d, basis_functions) for d in recorded]
        durations = [d.duration for d in recorded]
        return cls(
            PositionDMP.fit(
                attractor,
                basis,
                [d.positions for d in sampled],
                ridge=ridge,
            ),
            OrientationDMP.fit(
                attractor,
                basis,
                [d.rotations for d in sampled],
                ridge=ridge,
            ),
            phase,
            float(np.mean(durations)),
            default_steps(recorded[0]),
        )

    # ---------------------------------------------------------------- motion

    def rollout(
        self,
        *,
        goal_position: ArrayLike | None = None,
        goal_rotation: Rotation | None = None,
        start_position: ArrayLike | None = None,
        start_rotation: Rotation | None = None,
        duration: float | None = None,
        time_step: float | None = None,
        project_start: ProjectStart = "velocity",
        pull_in: float | None = None,
    ) -> Motion:
        """Integrate the primitive from its start to the end of its duration.

        Parameters
        ----------
        goal_position, start_position : array, shape (3,), optional
            Meters; the demonstrated ones by default.
        goal_rotation, start_rotation : Rotation, optional
        duration : float, optional
            tau (s).  The motion keeps its shape; only its speed changes.
        time_step : float, optional
            Seconds.  By default the motion has as many samples as the demonstration (200 or more),
            whatever its duration.  If the duration is no multiple of it, the last step is shorter.
        project_start : "velocity", "pose" or "nothing"
            What of a start that violates the constraints is replaced by the nearest that does not.
            By default the velocity (as in the paper).
        pull_in : float, optional
            Rate (1/s) at which what is still violated then decays, as ``exp(-rate t)``; by default
            the primitive's ``stabilization`` over the duration.

        Returns
        -------
        Motion
            ``times`` start at 0, or where a re-planned motion begins.
        """
        state = self.initial_state(
            goal_position=goal_position,
            goal_rotation=goal_rotation,
            start_position=start_position,
            start_rotation=start_rotation,
            duration=duration,
            project_start=project_start,
            pull_in=pull_in,
        )
        if time_step is None:
            steps = self.steps
            time_step = state.duration / steps
        else:
            time_step = _arguments.positive("time_step", time_step, "seconds")
            if time_step > state.duration * (1 + 1e-9):
                raise InputError(
                    f"time_step of {time_step:g} s is longer than the motion of "
                    f"{state.duration:g} s; make it shorter"
                )
            wanted = np.ceil(state.duration / time_step * (1 - 1e-12) - 1e-9)
            steps = max(1, _arguments.samples(f"time_step={time_step:g}", wanted))
        times: Floats = state.time + time_step * np.arange(steps + 1, dtype=np.float64)
        times[-1] = state.time + state.duration
        first = state.vector()
        states = np.empty((steps + 1, STATE_SIZE))
        # The acceleration of the first sample is that of the step which leaves it.
        outputs = np.empty((steps + 1, self.stepper.outputs["end"].stop))
        states[0] = first
        self.stepper.run(first, self._table(state, times, time_step), states[1:], outputs[1:])
        outputs[0] = outputs[1]
        column, names = self.stepper.outputs, self._constraint_names
        outputs[0, column["values"]] = np.concatenate([state.constraint_residuals, state.margins])
        return Motion.of_steps(
            times,
            states,
            {name: outputs[:, part] for name, part in column.items()},
            names,
            self._limit_names,
        )

    def initial_state(
        self,
        *,
        goal_position: ArrayLike | None = None,
        goal_rotation: Rotation | None = None,
        start_position: ArrayLike | None = None,
        start_rotation: Rotation | None = None,
        duration: float | None = None,
        project_start: ProjectStart = "velocity",
        pull_in: float | None = None,
    ) -> State:
        """Return the state to :meth:`step` from; the arguments are those of :meth:`rollout`."""
        if project_start not in get_args(ProjectStart):
            raise InputError(
                f"project_start is one of {', '.join(get_args(ProjectStart))}; got "
                f"{project_start!r}"
            )

        def chosen(check: Callable[[str, Any], T], name: str, value: Any, default: T) -> T:
            return default if value is None else check(name, value)

        tau = self.duration
        if duration is not None:
            tau = _arguments.positive("duration", duration, "seconds")
        start, goal = self.position.start, self.position.goal
        turned, turned_goal = self.orientation.start, self.orientation.goal
        return self._admissible(
            State(
                time=self._begin,
                phase=1.0,
                position=chosen(_arguments.vector, "start_position", start_position, start),
                rotation=chosen(_arguments.rotation, "start_rotation", start_rotation, turned),
                linear_velocity=self.position.start_velocity / tau,
                angular_velocity=self.orientation.start_velocity / tau,
                previous_step=0.0,
                duration=tau,
                goal_position=chosen(_arguments.vector, "goal_position", goal_position, goal),
                goal_rotation=chosen(
                    _arguments.rotation, "goal_rotation", goal_rotation, turned_goal
                ),
                pull_in=chosen(
                    _arguments.not_negative, "pull_in", pull_in, self._residual_rate / tau
                ),
            ),
            project_start,
        )

    def step(self, state: State, time_step: float) -> State:
        """Carry a state over one time step (s); the same motion as :meth:`rollout`.

        Steps may differ in length.
        """
        time_step = _arguments.positive("time_step", time_step, "seconds")
        before, table = state.vector(), self.steps_ahead(state, 1, time_step)
        column = self.stepper.outputs
        vector, outputs = np.empty(STATE_SIZE), np.empty((1, column["end"].stop))
        self.stepper.run(before, table, vector[None], outputs)
        phase = state.phase * self.phase.decay(time_step / state.duration)
        rows = len(self._constraint_names)
        values, multipliers = outputs[0, column["values"]], outputs[0, column["multipliers"]]
        return replace(
            state,
            time=state.time + time_step,
            phase=phase,
            position=vector[0:3],
            rotation=vector[3:7],
            linear_velocity=vector[7:10],
            angular_velocity=vector[10:13],
            previous_step=time_step,
            acceleration=(vector[7:] - before[7:]) / table[0, KICK],
            constraint_residuals=values[:rows],
            multipliers=multipliers[:rows],
            margins=values[rows:],
            limit_multipliers=multipliers[rows:],
            constraint_forces=outputs[0, column["force"]],
            done=self.phase.fraction(phase) >= DONE,
        )

    def compile(self) -> bool:
        """Compile the step and wait for it; whether a C compiler was there.

        Without this it happens in the background once a primitive is rolled out a second time.  The
        motion is the same to the bit.
        """
        return self.stepper.native.wait() is not None

    # ---------------------------------------------------------------- inside

    def _admissible(self, state: State, project: ProjectStart) -> State:
        """State that a motion may start in, nearest to a given one."""
        return state

    @cached_property
    def stepper(self) -> Stepper:
        """What carries a state over the rows of a step table."""
        return _UNCOUPLED

    @cached_property
    def offset_weights(self) -> Floats:
        """Weights of both forces over ``alpha beta``: what they add to the goals, shape (K, 6)."""
        parts = (self.position, self.orientation)
        return np.hstack([p.forcing.weights / p.attractor.stiffness for p in parts])

    @property
    def _begin(self) -> float:
        """Time at the start (s)."""
        return 0.0

    @property
    def _residual_rate(self) -> float:
        """How fast a residual present at the start decays, per duration."""
        return 0.0

    @property
    def _barrier_rate(self) -> float:
        """How fast the margin of a limit may shrink, per duration."""
        return 0.0

    @property
    def _constraint_names(self) -> tuple[str, ...]:
        return ()

    @property
    def _limit_names(self) -> tuple[str, ...]:
        return ()

    def _table(self, state: State, times: Floats, time_step: float) -> Floats:
        """Rows of equal steps, and of a last one that may be shorter."""
        steps, rest = len(times) - 1, times[-1] - state.time - (len(times) - 2) * time_step
        if steps == 1 or abs(rest - time_step) <= SAME_STEP * time_step:
            return self.steps_ahead(state, steps, time_step)
        done = self.phase.fraction(state.phase) + (steps - 1) * time_step / state.duration
        late = replace(
            state, time=times[-2], phase=float(self.phase.at(done)), previous_step=time_step
        )
        return np.vstack(
            [self.steps_ahead(state, steps - 1, time_step), self.steps_ahead(late, 1, rest)]
        )

    def steps_ahead(self, state: State, steps: int, time_step: float) -> Floats:
        """Return what depends on the phase alone in the coming steps, a row a step."""
        basis, tau = self.position.forcing.basis, state.duration
        begin = self.phase.fraction(state.phase)
        offsets = basis.stepping_forces(
            begin,
            steps,
            time_step / tau,
            self.position.attractor.alpha,
            self.offset_weights,
            starting=state.previous_step == 0.0,
        )
        # What violates a constraint from the start is pulled in; what was pushed off it, or was
        # measured to be, goes on without slip at once.
        fast = max(1.0, *map(abs, state.linear_velocity), *map(abs, state.angular_velocity))
        held = np.abs(state.constraint_residuals).max(initial=0.0) <= HELD_RESIDUAL * fast
        started = state.previous_step > 0
        slip_rate = AT_ONCE if held and started else state.pull_in
        # The first kick begins in the middle of the step before; the others are alike.
        kicks = np.array([(state.previous_step + time_step) / 2, time_step])
        decay, gain = self.position.attractor.factors(kicks / tau)
        table, column = step_table(steps)
        for rows, kick in ((slice(None), 1), (slice(1), 0)):
            table[rows, : len(CLOCK)] = (
                time_step,
                kicks[kick],
                time_step if kick else state.previous_step,
                0.0,
                state.pull_in,
                slip_rate,
                self._barrier_rate / tau,
                decay[kick],
                gain[kick] / kicks[kick],
            )
        column["time"][:] = state.time + np.arange(1, steps + 1) * time_step
        column["position_target"][:] = state.goal_position + offsets[:, :3]
        column["rotation_goal"][:] = self.orientation.winding.along(
            begin, steps, time_step / tau, state.goal_rotation
        )
        column["rotation_offset"][:] = offsets[:, 3:] + state.steering
        return table


_UNCOUPLED = Stepper()


def as_demonstrations(
    demonstrations: PoseTrajectory | Iterable[PoseTrajectory],
) -> list[PoseTrajectory]:
    """Return a list of demonstrations, checked."""
    if isinstance(demonstrations, PoseTrajectory):
        return [demonstrations]
    try:
        recorded = list(demonstrations)
    except TypeError:
        recorded = [demonstrations]
    for item in recorded:
        if not isinstance(item, PoseTrajectory):
            raise InputError(
                f"demonstrations are PoseTrajectory objects, got {type(item).__name__}; "
                "read files with load_demonstrations"
            )
    if not recorded:
        raise InputError("no demonstration given; at least one is needed")
    return recorded


def evenly_sampled(demonstration: PoseTrajectory, basis_functions: int) -> PoseTrajectory:
    """Return a demonstration with uniform samples, enough of them for the basis functions.

    The first and the last sample stay where they are.
    """
    fewest = SAMPLES_PER_BASIS_FUNCTION * basis_functions + 1
    if demonstration.is_uniform and len(demonstration) >= fewest:
        return demonstration
    intervals = round(demonstration.duration / demonstration.period)
    count = max(intervals + 1, len(demonstration), fewest)
    times = np.linspace(demonstration.times[0], demonstration.times[-1], count)
    return demonstration.resampled(times=times)


def default_steps(demonstration: PoseTrajectory) -> int:
    """Return the demonstration's own number of steps, multiplied until there are enough."""
    own = max(1, round(demonstration.duration / demonstration.period))
    return own * -(-FEWEST_STEPS // own)
