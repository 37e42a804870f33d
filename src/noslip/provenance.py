"""How a primitive came about: every option that was given, and what each projection made of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from inspect import signature
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from noslip._values import Value, short_repr
from noslip.projection.result import ProjectedTrajectory
from noslip.trajectory import PoseTrajectory
from noslip.verification import Deviation

Verb = Literal["learn", "adapt", "replan", "improve"]


@dataclass(frozen=True, eq=False)
class Origin(Value):
    """A call that a primitive came from.

    Attributes
    ----------
    verb : "learn", "adapt", "replan" or "improve"
    options : mapping
        Its keyword arguments by name, defaults too, as plain data: numbers, texts, lists;
        rotations as quaternions (qw, qx, qy, qz).
    outcome : mapping
        What a search came to, by name, as plain data; empty of other calls.
    """

    verb: Verb
    options: Mapping[str, Any]
    outcome: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, verb: Verb, function: Callable[..., Any], *args: Any, **options: Any) -> Origin:
        """Return the call of a function with some arguments, and its defaults for the others.

        What it works on is left out, and so is what changes nothing, as ``progress`` does.
        """
        call = signature(function).bind(*args, **options)
        call.apply_defaults()
        left_out = {"law", "rule", "demonstrations", "constraints", "progress", "context"}
        left_out |= {"dmp", "cost", "executor"}
        given = {name: value for name, value in call.arguments.items() if name not in left_out}
        return cls(verb, {name: _plain(value) for name, value in given.items()})


def _plain(value: Any) -> Any:
    if isinstance(value, Rotation):
        return value.as_quat(scalar_first=True).tolist()
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    return [_plain(part) for part in value]


@dataclass(frozen=True)
class LearningRecord:
    """What became of one demonstration: how far the primitive follows it, how it was projected.

    Attributes
    ----------
    demonstration : str
    end_error, end_rotation_error, path_error, rotation_error : float
        Of the primitive's motion, from the demonstration, or from what an adapted motion was
        planned to be: at its end, and at most (m, rad).
    samples, iterations, backing : int
        ``backing`` counts stretches in which the demonstration moves backwards (left so).
    residual : float
        Largest residual of the projected trajectory, in the constraints' units.
    position_change, rotation_change : float
        Rms over the samples, meters and radians.
    smoothing : float
        Rotation smoothing with which it converged.
    left_out : tuple of str
        Limits that the projection could not heed; they hold at run time alone.
    maneuver : str
        That an adapted motion was planned from, such as "right-straight-left, 2.31 m"; empty of
        the demonstration's own motion, led elsewhere.
    """

    demonstration: str
    end_error: float
    end_rotation_error: float
    path_error: float
    rotation_error: float
    samples: int
    iterations: int = 0
    backing: int = 0
    residual: float = 0.0
    position_change: float = 0.0
    rotation_change: float = 0.0
    smoothing: float = 0.0
    left_out: tuple[str, ...] = ()
    maneuver: str = ""

    __repr__ = short_repr

    @classmethod
    def of(
        cls,
        demonstration: PoseTrajectory,
        projected: ProjectedTrajectory | None,
        deviation: Deviation,
        maneuver: str = "",
    ) -> LearningRecord:
        """Return the record of a demonstration, projected if there are constraints."""
        found = cls(
            demonstration.name,
            samples=len(demonstration),
            maneuver=maneuver,
            **asdict(deviation),
        )
        if projected is None:
            return found
        moved = projected.trajectory.positions - demonstration.positions
        return replace(
            found,
            iterations=projected.iterations,
            backing=projected.backing,
            residual=float(np.abs(projected.residuals[1:]).max(initial=0.0)),
            position_change=float(np.sqrt(np.mean(np.sum(moved**2, axis=1)))),
            rotation_change=float(np.sqrt(np.mean(np.sum(projected.turns**2, axis=1)))),
            smoothing=projected.smoothing,
            left_out=projected.left_out,
        )
