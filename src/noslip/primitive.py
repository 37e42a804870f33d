"""A movement primitive under constraints: its law, its rule, and how it came about."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypedDict, TypeVar, Unpack

from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip._values import Value, html_table, shortened
from noslip.adapting import Adapted, adapt, compiled, replan
from noslip.constraints.declaration import Constraint
from noslip.constraints.system import ConstraintSystem
from noslip.control.controller import Controller
from noslip.control.coordinates import SpaceController
from noslip.document import (
    channels_to_data,
    law_to_data,
    rule_to_data,
    spread_to_data,
    write_document,
)
from noslip.exporting import Exported, export_c
from noslip.law.channels import Channels
from noslip.law.law import Law
from noslip.law.scaling import scaled
from noslip.provenance import LearningRecord, Origin, Verb
from noslip.rule import Rule, no_rule
from noslip.runtime.batch import rollout_many
from noslip.runtime.rhythm import modulated
from noslip.runtime.rollout import initial_state, rollout, step
from noslip.runtime.state import State
from noslip.runtime.stepper import stepper_of
from noslip.spread import Spread
from noslip.verification import Deviation, require_hard_limits, tell, tell_many

P = ParamSpec("P")
T = TypeVar("T")


def _method(
    function: Callable[Concatenate[Law, Rule, P], T],
) -> Callable[Concatenate[ConstrainedDMP, P], T]:
    """Return a function of a law and a rule as a method of what has both."""

    def method(self: ConstrainedDMP, /, *args: P.args, **options: P.kwargs) -> T:
        return function(self.law, self.rule, *args, **options)

    return _described(method, function)


def _telling(
    function: Callable[Concatenate[Law, Rule, P], T], tell: Callable[[Law, Rule, T], None]
) -> Callable[Concatenate[Law, Rule, P], T]:
    """Return a rollout that tells what it misses."""

    @wraps(function)
    def telling(law: Law, rule: Rule, /, *args: P.args, **options: P.kwargs) -> T:
        found = function(law, rule, *args, **options)
        if any(option is not None for option in options.values()):
            tell(law, rule, found)
        return found

    return telling


def _with_channels(
    method: Callable[Concatenate[ConstrainedDMP, P], T], give: Callable[[T, Channels], T]
) -> Callable[Concatenate[ConstrainedDMP, P], T]:
    """Return a rollout whose motion has the primitive's channels."""

    @wraps(method)
    def channeled(self: ConstrainedDMP, /, *args: P.args, **options: P.kwargs) -> T:
        found = method(self, *args, **options)
        return found if self.channels is None else give(found, self.channels)

    return channeled


def _adapting(
    verb: Verb, function: Callable[Concatenate[Law, Rule, P], Adapted]
) -> Callable[Concatenate[ConstrainedDMP, P], ConstrainedDMP]:
    """Return a function that adapts a law as a method that returns a primitive."""

    def method(self: ConstrainedDMP, /, *args: P.args, **options: P.kwargs) -> ConstrainedDMP:
        adapted = function(self.law, self.rule, *args, **options)
        return self._with(adapted, Origin.of(verb, function, None, None, *args, **options))

    return _described(method, function)


def _described(
    method: Callable[Concatenate[ConstrainedDMP, P], T], function: Callable[..., Any]
) -> Callable[Concatenate[ConstrainedDMP, P], T]:
    """Give a method the name, signature and docstring of the function that it calls."""
    wraps(function)(method)
    own = signature(function)
    _, itself, *others = own.parameters.values()
    method.__signature__ = own.replace(  # type: ignore[attr-defined]
        parameters=[itself.replace(name="self", annotation=Parameter.empty), *others]
    )
    method.__doc__ = (function.__doc__ or "").replace("law : Law\n    rule : Rule\n    ", "")
    return method


class Controlling(TypedDict, total=False):
    """Options of what steps a primitive in a control loop."""

    follows: bool
    lag: float | None
    tolerance: ArrayLike | None
    angle_tolerance: float
    bias: float
    faster: float
    samples: int
    replan: bool
    plan_within: float
    real_time: bool
    braking: float


@dataclass(frozen=True, eq=False, repr=False)
class ConstrainedDMP(Value):
    """A primitive with the Udwadia-Kalaba coupling term (the paper's eq. 19).

    Its rollouts satisfy the constraints at every step; with the orientation learned from the
    projected demonstrations, the coupling term has next to nothing to do.

    Attributes
    ----------
    law : Law
        What it wants.
    rule : Rule
        What it must; empty for a primitive without constraints.
    demonstrated : Law
        Fitted to the demonstrations as they are; by default the law itself.
    record : tuple of LearningRecord
        What the projections made of the demonstrations.
    spread : Spread or None
        How far the demonstrations lie apart, if there were several.
    history : tuple of Origin
        The calls that it came from, the first one first.
    channels : Channels or None
        What the demonstrations recorded beside their poses; it follows the phase, and no goal
        changes it.
    """

    law: Law
    rule: Rule = field(default_factory=Rule)
    demonstrated: Law = None  # type: ignore[assignment]
    record: tuple[LearningRecord, ...] = ()
    spread: Spread | None = None
    history: tuple[Origin, ...] = ()
    channels: Channels | None = None

    def __post_init__(self) -> None:
        if self.demonstrated is None:
            object.__setattr__(self, "demonstrated", self.law)

    def __repr__(self) -> str:
        held = ", ".join(self.system.names) or "no constraints"
        if self.system.size:
            held += f"; {self.rule.yielding} gives way"
        return (
            f"{type(self).__name__}({self.law.basis.count} basis functions, {self.duration:.6g} s, "
            f"{self.steps} steps, {shortened(held, 58)})"
        )

    def _repr_html_(self) -> str:
        start, goal = (
            " ".join(f"{x:.4g}" for x in p) for p in (self.start_position, self.goal_position)
        )
        rows = {
            "constraints": ", ".join(map(repr, self.constraints)) or "none",
            "gives way": self.rule.yielding if self.system.size else "",
            "duration": f"{self.duration:.4g} s, {self.steps} steps",
            "from, to": f"{start}; {goal} m",
            "basis functions": f"{self.law.basis.count}",
            **({} if self.channels is None else {"channels": ", ".join(self.channels.names)}),
            "made by": ", ".join(origin.verb for origin in self.history),
        }
        return html_table(type(self).__name__, rows.items())

    # ---------------------------------------------------------------- what it is

    @property
    def duration(self) -> float:
        """The default tau (s)."""
        return self.law.duration

    @property
    def steps(self) -> int:
        """Steps of a rollout by default."""
        return self.law.steps

    @property
    def start_position(self) -> Floats:
        """Where it starts, meters, shape (3,)."""
        return self.law.start_position

    @property
    def start_rotation(self) -> Rotation:
        """The same of the rotation."""
        return self.law.start_rotation

    @property
    def goal_position(self) -> Floats:
        """Where it ends, meters, shape (3,)."""
        return self.law.goal_position

    @property
    def goal_rotation(self) -> Rotation:
        """The same of the rotation."""
        return self.law.goal_rotation

    @property
    def system(self) -> ConstraintSystem:
        """The constraints, stacked."""
        return self.rule.system

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """What it holds."""
        return self.system.constraints

    @property
    def regular(self) -> ConstrainedDMP:
        """The paper's first comparison: fitted to the demonstrations as they are, no coupling."""
        return ConstrainedDMP(self.demonstrated, no_rule(self.law.space), channels=self.channels)

    @property
    def constrained(self) -> ConstrainedDMP:
        """The paper's second comparison: coupled, with the orientation as demonstrated."""
        return replace(self, law=self.demonstrated)

    # ---------------------------------------------------------------- motion

    rollout = _with_channels(
        _method(_telling(rollout, tell)),
        lambda motion, channels: motion.accompanied(channels),
    )
    initial_state = _method(initial_state)
    step = _method(step)

    def modulated(
        self,
        state: State,
        time_step: float,
        *,
        within: float,
        period: float | None = None,
        amplitude: float | None = None,
        baseline: ArrayLike | None = None,
    ) -> State:
        """Lead a rhythm's state a step nearer to another period, amplitude or baseline.

        See :func:`noslip.runtime.rhythm.modulated`, whose arguments and errors these are.
        """
        return modulated(
            self.law,
            state,
            time_step,
            within=within,
            period=period,
            amplitude=amplitude,
            baseline=baseline,
        )

    rollout_many = _with_channels(
        _method(_telling(rollout_many, tell_many)),
        lambda motions, channels: replace(motions, channels=channels),
    )

    def export_c(
        self, folder: str | Path, *, name: str = "primitive", prefix: str = "noslip"
    ) -> Exported:
        """Write the primitive as C99, with its channels; see :func:`noslip.exporting.export_c`.

        Parameters
        ----------
        folder : path
            Made if it is missing.
        name : str
            Of the primitive in C, and of its files.
        prefix : str
            Of all other names: two exports with different ones can be linked into one program.

        Raises
        ------
        InputError
            If a name is no C identifier or is taken, or the folder is a file.
        MissedError
            If its motion breaks a hard limit.
        """
        require_hard_limits(self.law, self.rule)
        return export_c(
            self.law, self.rule, folder, name=name, prefix=prefix, channels=self.channels
        )

    def controller(
        self, *, time_step: float, **options: Unpack[Controlling]
    ) -> Controller | SpaceController:
        """Return what steps this primitive in a control loop.

        Of a pose that comes to an end a :class:`noslip.Controller`, which plans; of all else a
        :class:`~noslip.control.coordinates.SpaceController`.
        """
        plans = self.law.space.is_pose and not self.law.clock.returns
        kind: Any = Controller if plans else SpaceController
        made: Controller | SpaceController = kind(self, time_step=time_step, **options)
        return made

    def compile(self) -> bool:
        """Compile the step, and what plans, and wait for it; whether a C compiler was there.

        Without this the step is compiled in the background once a primitive is rolled out a second
        time, and its motion is the same to the bit; what plans, when it first does.
        """
        compiled.compile_for(self.rule)
        return stepper_of(self.rule).native.wait() is not None

    # ---------------------------------------------------------------- new goals

    adapt = _adapting("adapt", adapt)
    replan = _adapting("replan", replan)

    def _with(self, adapted: Adapted, origin: Origin) -> ConstrainedDMP:
        """Return this primitive with an adapted law."""
        law, scaling = adapted.law, origin.options.get("scaling", "none")
        demonstrated = scaled(
            self.demonstrated,
            scaling,
            start_position=law.start_position,
            goal_position=law.goal_position,
        ).rotated_to(law.start_rotation, law.goal_rotation)
        # Of the whole motion, along its demonstrated way.
        channels = self.channels
        if channels is not None and origin.verb == "replan":
            channels = channels.after(self.law.clock.fraction(origin.options["state"]["phase"]))
        spread = self.spread if origin.verb == "adapt" and scaling == "none" else None
        return replace(
            self,
            law=law,
            demonstrated=replace(demonstrated, duration=law.duration, begin=law.begin),
            record=(
                LearningRecord.of(
                    adapted.request.reference,
                    adapted.projected,
                    Deviation.between(adapted.motion, adapted.projected.trajectory),
                    adapted.maneuver,
                ),
            ),
            spread=spread,
            channels=channels,
            history=(*self.history, origin),
        )

    # ---------------------------------------------------------------- files

    def save(self, path: str | Path) -> Path:
        """Write the primitive as JSON; :func:`noslip.load_primitive` reads it back.

        The motion of what is read back is the same to the last bit.
        """
        return write_document(path, self.as_data())

    def as_data(self) -> dict[str, Any]:
        """Return what :meth:`save` writes, as plain data."""
        return {
            "law": law_to_data(self.law),
            "demonstrated": law_to_data(self.demonstrated),
            "rule": rule_to_data(self.rule),
            "spread": None if self.spread is None else spread_to_data(self.spread),
            "record": [asdict(record) for record in self.record],
            "history": [asdict(origin) for origin in self.history],
            **({} if self.channels is None else {"channels": channels_to_data(self.channels)}),
        }
