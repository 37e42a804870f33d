"""One command after another, followed under constraints; the law is in ``following.py``."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from math import inf, isfinite
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.codegen.library import Native, built, function
from noslip.constraints.system import ConstraintSystem
from noslip.control.observer import SEEN
from noslip.errors import InputError
from noslip.law.layout import STATE, STEP, VELOCITY
from noslip.projection.metric import Metric, inverse_metric
from noslip.rule import Rule
from noslip.runtime.lost import require_defined
from noslip.runtime.state import State, write_pose
from noslip.runtime.stepper import stepper_of
from noslip.shielding.following import GIVEN, HEARD, PULL_IN, SLOWEST, follow_function
from noslip.shielding.sources import NO_TOOL, SMALLEST, memory_layout, observer_of, sources

LENGTH = 0.1
"""m that weigh as much as a radian, where rotation shares a correction: a hand's and a tool's."""
_BUILT = ("_native", "_bound", "_run")
"""What a copy builds anew."""
_NOT_FINITE = (
    "the step is not finite: the command is out of what can be computed with; the state is kept"
)
_PACE, _SAMPLES = SEEN.index("pace"), SEEN.index("place_samples")
Pose = State | tuple[Any, Rotation]


class Follower:
    """Follows commands under constraints, a period a step.

    Parameters
    ----------
    system : ConstraintSystem
    period : float
        Between two commands (s).
    metric : "auto", "position", "shared" or 6 positive weights

    Attributes
    ----------
    data : array
        What ``noslip_shield`` holds (``shield.h``); places as
        :func:`noslip.shielding.sources.memory_layout` says.
    begun : bool
        Whether there is a pose to go on from.
    """

    def __init__(self, system: ConstraintSystem, period: float, metric: Metric) -> None:
        self.rule = Rule(system, inverse_metric(system, metric, None, LENGTH))
        self.period, self.begun = period, False
        self._places = memory_layout(system.size)
        self.data = np.zeros(self._places.size)
        self._command, self._measured = np.zeros(7), np.zeros(7)
        self._build()

    def _build(self) -> None:
        rule, period = self.rule, self.period
        self._native = rule.system.owned(
            ("shield", rule.inverse_metric, rule.push, period),
            lambda: Native(lambda: _library(rule, period)),
        )
        # Nothing is bound yet; who sends chunks alone never steps.
        self._bound: Callable[..., int] | bool | None = False

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in _BUILT}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._build()

    def wait(self) -> bool:
        """Wait for the machine code; whether there is any."""
        return self._native.wait() is not None

    def reset(self, pose: Any) -> None:
        """Begin anew from a pose, at rest."""
        given = np.zeros(7)
        write_pose("pose", pose, given)
        _require_finite("pose", given)
        self.data[:], self.begun = 0.0, True
        given[3:] /= np.linalg.norm(given[3:])
        places = self._places
        for first, last in (
            ("position", "quaternion"),
            ("command", "command"),
            ("heard", "heard"),
            ("hand_position", "hand_quaternion"),
        ):
            self.data[places.span(first, last)] = given
        self.data[places["gap"]] = self.period
        self.data[places.span("linear_peak", "angular_peak")] = SLOWEST
        self.data[places["seen"]] = observer_of(self.period).seen

    def step(self, command: Pose | None = None, measured: Pose | None = None) -> State:
        """Go on by a period; see :meth:`noslip.Shield.step`."""
        if command is not None:
            write_pose("command", command, self._command)
            _require_finite("command", self._command)
            if not self.begun:
                self.reset(command)
        elif not self.begun:
            raise InputError("command: none came yet; give the first, or the pose at a reset")
        if measured is not None:
            write_pose("measured", measured, self._measured)
        if self._bound is False:
            # A loop is not to wait for the compiler: until then the same graphs run as they are.
            self._native.begin()
        library = self._native.library
        if library is not self._bound:
            self._bind(library)
        if not self._run(command is not None, measured is not None):
            # Whose fault it is, if it is a constraint's.
            moving = self.data[self._places.span("position", "angular_velocity")]
            states = np.stack([moving, np.full(STATE.size, np.nan)])
            times = self.data[self._places["time"]] + np.array([0.0, self.period])
            require_defined(self.rule.system, times, states)
            raise InputError(_NOT_FINITE)
        return self.state

    def _bind(self, library: Callable[..., int] | None) -> None:
        self._bound = library
        arrays = self.data, self._command, self._measured
        if library is None:
            self._run: Callable[[bool, bool], bool] = _Virtual(self.rule, self.period, *arrays).step
            return
        data, command, measured = (array.ctypes.data for array in arrays)

        def run(has_command: bool, has_measured: bool) -> bool:
            return not library(
                data, command if has_command else None, measured if has_measured else None
            )

        self._run = run

    @property
    def state(self) -> State:
        """What is commanded now; a copy."""
        data, places = self.data.copy(), self._places
        equalities, rows = self.rule.system.equalities.size, self.rule.system.size
        values, multipliers = (data[places[name]] for name in ("values", "multipliers"))
        goal, turned = data[places["command"]][:3], data[places["command"]][3:]
        # The frozen dataclass sets its fields one by one, which takes longer than the step itself.
        state = object.__new__(State)
        state.__dict__.update(
            time=data.item(places.index("time")),
            phase=1.0,
            position=data[places["position"]],
            _rotation=data[places["quaternion"]],
            linear_velocity=data[places["linear_velocity"]],
            angular_velocity=data[places["angular_velocity"]],
            previous_step=self.period,
            duration=inf,
            goal_position=goal,
            _goal_rotation=turned,
            first_goal_position=goal,
            _first_goal_rotation=turned,
            pull_in=PULL_IN,
            braking=0.0,
            constraint_residuals=values[:equalities],
            multipliers=multipliers[:equalities],
            margins=values[equalities:rows],
            limit_multipliers=multipliers[equalities:rows],
            acceleration=data[places["acceleration"]],
            constraint_forces=data[places["force"]],
            done=False,
        )
        return state

    @property
    def distance(self) -> float:
        """From what is commanded to the last command (m)."""
        command, position = (self.data[self._places[name]] for name in ("command", "position"))
        return float(np.linalg.norm(command[:3] - position))

    @property
    def angle(self) -> float:
        """The same of the orientation (rad)."""
        command, mine = (self.data[self._places[name]] for name in ("command", "quaternion"))
        turns = Rotation.from_quat([command[3:], mine], scalar_first=True)
        return float((turns[0] * turns[1].inv()).magnitude())


class _Virtual:
    """The same steps in CasADi's virtual machine, as ``shield.c`` makes them."""

    def __init__(
        self, rule: Rule, period: float, data: Floats, command: Floats, measured: Floats
    ) -> None:
        stepper, places = stepper_of(rule), memory_layout(rule.system.size)
        following = rule.system.owned(
            ("follow", period), lambda: follow_function(rule.system, period)
        )
        self._data, self._command, self._measured = data, command, measured
        self._period, self._outputs = period, stepper.outputs
        self._at = {name: data[places[name]] for name in places}
        self._pose, heard = (
            data[places.span(first, last)]
            for first, last in (("position", "quaternion"), ("command", "angular_peak"))
        )
        self._carried = data[places.index("position") :][: stepper.carried.size]
        self._before, self._given = np.zeros(7), np.zeros(GIVEN.size)
        self._row = np.zeros(STEP.size)
        self._heard, self._heard_after = heard, np.zeros(HEARD.size)
        self._after, self._output = np.zeros(stepper.carried.size), np.zeros(stepper.outputs.size)
        self._observer = observer_of(period)
        self._observer.seen = self._at["seen"]
        self._observer.bind(self._pose, self._before, measured)
        self._graphs = []
        for graph, given, found in (
            (
                following,
                (self._carried, heard, self._given),
                (self._heard_after, self._row),
            ),
            (stepper.function, (self._carried, self._row), (self._after, self._output)),
        ):
            buffer, evaluate = graph.buffer()
            for k, array in enumerate(given):
                buffer.set_arg(k, array.data)
            for k, array in enumerate(found):
                buffer.set_res(k, array.data)
            self._graphs.append((buffer, evaluate))

    def step(self, has_command: bool, has_measured: bool) -> bool:
        """Go on by a period; whether that could be."""
        kept, at, seen = self._data.copy(), self._at, self._at["seen"]
        command = self._command if has_command else at["command"]
        if not _is_pose(command):
            return False
        if has_measured and self._is_tool():
            self._observer.measured(seen.item(_PACE) >= 1)
        self._given[GIVEN["command"]] = command
        self._given[GIVEN["time"]], self._given[GIVEN["pace"]] = at["time"], seen[_PACE]
        self._before[:] = self._pose
        for _, evaluate in self._graphs:
            evaluate()
        if not isfinite(self._after[: STATE.size].sum() + self._heard_after.sum()):
            self._data[:] = kept
            return False
        velocity = self._carried[VELOCITY]
        at["acceleration"][:] = (self._after[VELOCITY] - velocity) / self._period
        self._carried[:], self._heard[:] = self._after, self._heard_after
        at["force"][:] = self._output[self._outputs["force"]]
        multipliers = self._output[self._outputs["multipliers"]]
        at["multipliers"][: len(multipliers)] = multipliers
        at["time"] += self._period
        if seen.item(_SAMPLES) > 0:
            self._observer.moved(self._period)
        return True

    def _is_tool(self) -> bool:
        """Whether what was measured may be the tool."""
        away = np.abs(self._measured[:3] - self._pose[:3]).max()
        return bool(away <= NO_TOOL) and _is_pose(self._measured)


def _is_pose(pose: Floats) -> bool:
    square = float(pose[3:] @ pose[3:])
    # Written so that NaN fails.
    return bool(np.isfinite(pose).all()) and SMALLEST < square < 1 / SMALLEST


def _require_finite(name: str, pose: Floats) -> None:
    if not isfinite(sum(pose.tolist())):
        told = ", ".join(f"{x:g}" for x in pose.tolist())
        raise InputError(f"{name}: not finite: x, y, z, qw, qx, qy, qz = {told}")


def _library(rule: Rule, period: float) -> Callable[..., int]:
    # A step is over before another thread could have taken its turn.
    library = ctypes.PyDLL(str(built("shield", sources(rule, period))))
    pointer = ctypes.c_void_p
    return function(library, "noslip_shield_step", *[pointer] * 3, result=ctypes.c_int)
