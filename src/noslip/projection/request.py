"""What a trajectory projection solves: a reference, what it must satisfy and what it must reach."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import Value
from noslip.boundary import Boundary, End, end_twist, sample_of
from noslip.constraints.system import ConstraintSystem
from noslip.errors import InputError

FEWEST_SAMPLES = 4
"""Second differences of both ends must not share all of their samples."""
FEWEST_IN_PERIOD = 6
"""Second differences around one sample must not meet those on the other side."""
_ROUNDED = 0.05
"""Most of what a correction costs that the rounding of its fourth differences may come to: with six
times as much the first guess is off by a tenth of a radian."""
MAX_ITERATIONS = 40
"""Ten times what a Newton iteration usually takes that converges at all."""


@dataclass(frozen=True)
class Weights:
    """Weights of the cost that a trajectory projection minimizes; that of the rotation is 1.

    Parameters
    ----------
    position : float
        w_p: of the squared displacement over the path's length.
    position_smoothing, rotation_smoothing : float
        mu_p and mu_R: of the squared accelerations of the correction, time over the duration.
    """

    position: float
    position_smoothing: float
    rotation_smoothing: float

    def __post_init__(self) -> None:
        for name, checked in (
            ("position", _arguments.positive("position_weight", self.position)),
            (
                "position_smoothing",
                _arguments.not_negative("position_smoothing", self.position_smoothing),
            ),
            (
                "rotation_smoothing",
                _arguments.positive("rotation_smoothing", self.rotation_smoothing),
            ),
        ):
            object.__setattr__(self, name, checked)

    def smoother(self, factor: float) -> Weights:
        """Return them with the smoothing of the rotation multiplied."""
        return replace(self, rotation_smoothing=factor * self.rotation_smoothing)

    @property
    def most_samples(self) -> int:
        """Of a trajectory that can be smoothed so much.

        The terms of the smoothing grow with the fourth power of the count, and so does their
        rounding.
        """
        strength = max(self.rotation_smoothing, self.position_smoothing / self.position)
        return int((_ROUNDED / (np.finfo(float).eps * strength)) ** 0.25)


LEARNING = Weights(1e5, 1e-6, 1e-6)
"""For demonstrations: the rotation gives way first, by a third of a radian before a path of a meter
gives way by a millimeter (w_p = 0.1 / 1 mm^2); what is smoothed of it is shorter than a fifth of
the motion, where mu_R (2 pi / x)^4 = 1."""
ADAPTING = Weights(10.0, 1e-2, 1e-4)
"""For other ends: the path must be reshaped, so a millimeter costs no more than 3 mrad, and the
reshaping is smooth over the whole motion."""
_SAME = 1e-9
"""Of the path's length: a position that differs by less is that of the reference, resampled."""


@dataclass(frozen=True, eq=False)
class Request(Value):
    """What a trajectory projection solves.

    Parameters
    ----------
    reference : PoseTrajectory or Trajectory
        In the system's space.  Uniformly sampled, 4 samples or more; the result is the nearest to
        it.
    system : ConstraintSystem
        Equalities and limits that the result satisfies.
    boundaries : tuple of Boundary
        Each of another sample.  One with a twist is an end's, and names a whole pose or is at rest.
    weights : Weights
    hold_position : bool
        Only the orientation gives way; no boundary then has another position than the reference.
    begin : float
        Time at the first sample (s), for constraints that depend on it.
    max_iterations : int
        Newton steps in the first attempt.
    clearance : float
        Kept from limits that the reference violates, where they are lengths (m).
    length : float
        L (m); 0 is the reference's path.
    is_periodic : bool
        Whether the last sample is the first one again, and a step leads on from it: the reference's
        is, to rounding, and no boundary has a twist.
    is_hurried : bool
        Whether limits are heeded in the first attempt or not at all.

    Raises
    ------
    InputError
        If the samples are not uniform or too many for so much smoothing, or boundaries contradict
        each other or ``hold_position``.
    """

    reference: Any
    system: ConstraintSystem
    boundaries: tuple[Boundary, ...] = ()
    weights: Weights = LEARNING
    hold_position: bool = False
    begin: float = 0.0
    max_iterations: int = MAX_ITERATIONS
    clearance: float = 0.0
    length: float = 0.0
    is_hurried: bool = False
    is_periodic: bool = False
    tool_ends: tuple[End, ...] = ("free", "free")

    def __post_init__(self) -> None:
        reference = self.reference
        space, own = self.system.space, reference.positions.shape[1]
        if (own, reference.quaternions.shape[1]) != (space.linear, 4 * space.rotations):
            raise InputError(
                f"{reference.name}: {own} coordinates and {reference.quaternions.shape[1] // 4} "
                f"rotations a sample, but the constraints are declared of {space.linear} and "
                f"{space.rotations}"
            )
        if self.hold_position and not space.rotations and space.is_placed:
            raise InputError(
                f"{reference.name}: hold_position=True leaves the rotation to give way, and "
                "there is none; let the coordinates give way (hold_position=False)"
            )
        if not reference.is_uniform or len(reference) < FEWEST_SAMPLES:
            raise InputError(
                f"{reference.name}: a trajectory projection needs {FEWEST_SAMPLES} or more uniform "
                "samples; resample it first"
            )
        if len(reference) > (most := self.weights.most_samples):
            raise InputError(
                f"{reference.name}: {len(reference)} samples are more than so much smoothing "
                f"leaves digits for; resample it to {most} or fewer, or smooth less"
            )
        for boundary in self.boundaries:
            if not isinstance(boundary, Boundary):
                raise InputError(f"expected a Boundary, got {_arguments.short(boundary)}")
        if self.is_periodic:
            self._require_closed()
        most = _arguments.count("max_iterations", self.max_iterations)
        object.__setattr__(self, "max_iterations", most)
        for k, boundary in self.fixed.items():
            boundary.require_of(space)
            moved = boundary.position is not None and np.any(
                np.abs(boundary.position - reference.positions[k]) > _SAME * reference.path_length
            )
            if self.hold_position and (moved or boundary.linear_velocity is not None):
                raise InputError(
                    "hold_position=True keeps every position and velocity; no boundary can ask for "
                    "another one"
                )
            is_end = boundary.at in (0, 1) and (boundary.is_whole(space) or not boundary.moves)
            if boundary.has_twist and not is_end:
                raise InputError(
                    f"a velocity at {boundary.at:g} of the motion: it can be asked for at an end "
                    "(0 or 1) whose position and rotation are both given, or that is at rest"
                )

    def _require_closed(self) -> None:
        """Refuse what does not end where it begins, and what is asked of ends that it has not."""
        reference = self.reference
        if len(reference) < FEWEST_IN_PERIOD:
            raise InputError(
                f"{reference.name}: a period needs {FEWEST_IN_PERIOD} or more samples, got "
                f"{len(reference)}"
            )
        points, n = reference.points, self.system.space.linear
        gap = np.abs(self.system.space.difference(points[-1:], points[:1])[0])
        largest = np.abs(reference.positions).max()
        if gap[:n].max(initial=0) > _SAME * largest or gap[n:].max(initial=0) > _SAME:
            raise InputError(
                f"{reference.name}: a period ends where it begins, but this ends "
                f"{np.linalg.norm(gap[:n]):.3g} ({np.degrees(gap[n:].max(initial=0)):.3g} degrees) "
                "from there; close it first (noslip.demonstrations.cycles.closed)"
            )
        if any(boundary.has_twist for boundary in self.boundaries):
            raise InputError("a period has no ends; no boundary of it can ask for a velocity")
        if sum(boundary.at in (0, 1) and not boundary.is_free for boundary in self.boundaries) > 1:
            raise InputError("a period ends where it begins; ask for a start or an end, not both")

    @property
    def fixed(self) -> dict[int, Boundary]:
        """Boundaries by sample number, without those that ask for nothing."""
        count = len(self.reference)
        found: dict[int, Boundary] = {}
        for boundary in self.boundaries:
            if boundary.is_free:
                continue
            k = sample_of(boundary.at, count)
            if k in found or (k in (0, count - 1) and 0 < boundary.at < 1):
                what = "via" if 0 < boundary.at < 1 else "boundary"
                raise InputError(
                    f"{what} at {boundary.at:g} falls on an end or on another "
                    f"{what}; {count} samples tell {1 / (count - 1):.2g} of the motion apart"
                )
            found[k] = boundary
        return found

    @property
    def twists(self) -> dict[int, tuple[Floats, Floats]]:
        """Linear and angular velocity asked for, by sample; the reference's where not named."""
        return {
            k: boundary.twist_or(*end_twist(self.reference, boundary.at))
            for k, boundary in self.fixed.items()
            if boundary.has_twist
        }

    @property
    def time_step(self) -> float:
        """Seconds between samples."""
        return float(self.reference.duration) / (len(self.reference) - 1)
