"""A distribution of motions that all keep the constraints."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from noslip import _arguments
from noslip._typing import Floats
from noslip._values import Value
from noslip.boundary import Boundary, End, sample_of
from noslip.constraints.system import ConstraintSystem
from noslip.distribution.arrays import in_cache
from noslip.distribution.conditions import checked, exactly, merged, noise_of
from noslip.distribution.curves import Curves
from noslip.distribution.demonstrated import Tangent, context_of, deviations, projected
from noslip.distribution.estimation import (
    FEWEST,
    context_rows,
    estimate,
    freedom_of,
    log_likelihood,
)
from noslip.distribution.gaussian import Gaussian
from noslip.distribution.impedance import Impedance
from noslip.distribution.kernels import Kernels
from noslip.distribution.retraction import TOGETHER, Retraction, kernels_of
from noslip.distribution.stored import boundary_to_data
from noslip.document import write_document
from noslip.errors import CompromiseWarning, InputError, warn
from noslip.law.channels import Channels
from noslip.law.fitting import Recorded, as_demonstrations, fit
from noslip.primitive import ConstrainedDMP
from noslip.projection.request import ADAPTING, Request
from noslip.projection.trajectory import project_heeding_what_it_can, project_trajectory
from noslip.provenance import LearningRecord
from noslip.runtime.batch import Motions
from noslip.space import Space
from noslip.spread import Spread
from noslip.trajectory import PoseTrajectory
from noslip.verification import Deviation, verify

UNLIKELY = 1e-3
"""Share of the demonstrations' own kind that would be farther off: beyond it a condition asks for
what they do not show."""
KEPT = 1e-8
"""Violation of a limit that is none, as in a trajectory projection."""
_STARTING_CURVES = 12
"""Weights of a curve before their number is chosen."""
_TOGETHER = 64
"""Samples that compiled code makes at once: a row of them fills the first cache."""

ContextValues = Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class MotionDistribution(Value):
    """Motions that a rule allows, and how likely each is.

    A motion is a smooth curve of deviations from a reference, ``(p - p_ref, Log(R R_ref^T))`` at
    equal fractions of the duration, whose weights are normally distributed, together with the
    context that the motion was made in (Paraschos et al. 2013, of poses).  Demonstrations are
    projected onto the constraints before their weights are found, and every sample is again: all
    motions are feasible.

    Attributes
    ----------
    primitive : ConstrainedDMP
        Learned from the same demonstrations.
    reference : PoseTrajectory or Trajectory
        Its motion, uniformly sampled.
    curves : Curves
        Of the deviations.
    gaussian : Gaussian
        Of the weights, channel after channel (m, rad), then of the context.
    noise : array, shape (n + 3 b,)
        Standard deviation of what curves leave of a demonstration (m, rad; of vectors their units).
    score : float
        Log-likelihood of each demonstration under the others, nats a value.
    demonstrations : int
        How many; three or more.
    context : tuple of str
        Names of what the motions depend on.
    kept : tuple of Boundary
        What all motions pass exactly.
    ends : pair of "free", "position", "rotation" or "pose"
        What a sample keeps of its own first and last pose when it is projected.
    """

    primitive: ConstrainedDMP
    reference: PoseTrajectory
    curves: Curves
    gaussian: Gaussian
    noise: Floats
    score: float
    demonstrations: int
    context: tuple[str, ...] = ()
    kept: tuple[Boundary, ...] = ()
    ends: tuple[End, End] = ("free", "position")

    def __repr__(self) -> str:
        kept = f", {len(self.kept)} kept" if self.kept else ""
        of = f" by {', '.join(self.context)}" if self.context else ""
        return (
            f"{type(self).__name__}({self.demonstrations} demonstrations{of}, "
            f"{len(self.gaussian.mean)} weights{kept})"
        )

    # ---------------------------------------------------------------- made from

    @classmethod
    def about(
        cls,
        primitive: ConstrainedDMP,
        demonstrations: Sequence[PoseTrajectory],
        context: Mapping[str, Sequence[float]] | None = None,
        ends: tuple[End, End] = ("free", "position"),
    ) -> MotionDistribution:
        """Distribution of demonstrations about a primitive that was learned from them.

        Parameters
        ----------
        primitive : ConstrainedDMP
        demonstrations : sequence of PoseTrajectory or Trajectory
            Three or more, projected onto the primitive's constraints.
        context : mapping of name to numbers, optional
            Of each demonstration, such as the size of its workpiece.
        ends : pair of End
            What samples keep of their own first and last pose.
        """
        if len(demonstrations) < FEWEST:
            raise InputError(
                f"a distribution needs {FEWEST} demonstrations or more, got {len(demonstrations)}"
            )
        if primitive.law.clock.returns:
            raise InputError(
                "a distribution is of motions that end: its curves begin and end apart, which "
                "would tear a rhythm; learn one period without rhythmic=True"
            )
        names, numbers = context_of(context or {}, len(demonstrations))
        reference = reference_of(primitive)
        values = np.array([deviations(d, reference) for d in demonstrations])
        curves = Curves.along(reference.positions, _STARTING_CURVES)
        tangent = Tangent(reference, primitive.system, primitive.law.begin)
        found = estimate(values, numbers, curves, tangent)
        return cls(
            primitive,
            reference,
            curves.of(found.shape.weights),
            found.gaussian,
            found.noise,
            found.score,
            len(demonstrations),
            names,
            ends=ends,
        )

    # ---------------------------------------------------------------- what it is

    @property
    def system(self) -> ConstraintSystem:
        """The constraints that all motions keep."""
        return self.primitive.system

    @property
    def space(self) -> Space:
        """What moves."""
        return self.primitive.law.space

    @property
    def duration(self) -> float:
        """Of all motions (s)."""
        return self.reference.duration

    @cached_property
    def motion(self) -> PoseTrajectory:
        """The mean motion, projected onto the constraints; as many samples as the reference."""
        points = self._points(self.gaussian.mean[None, : self._weights])
        mean = self.trajectory(points[:, :, 0], "mean")
        if not self.system.size:
            return mean
        request = Request(
            mean, self.system, self.boundaries(mean), ADAPTING, begin=self.primitive.law.begin
        )
        result = project_heeding_what_it_can(request)
        turned = float(np.sqrt(np.mean(np.sum(result.turns**2, axis=1))))
        spread = self._turning
        if turned > spread:
            warn(
                f"the constraints turn the mean motion by {np.degrees(turned):.2g} degrees (rms), "
                f"more than motions differ ({np.degrees(spread):.2g}): what it is conditioned on "
                "does not go together with the demonstrated turning; condition on a rotation too, "
                "or with noise",
                CompromiseWarning,
            )
        found: PoseTrajectory = result.trajectory
        return found

    @cached_property
    def mean(self) -> ConstrainedDMP:
        """A primitive of the mean motion, with this distribution's spread.

        Raises
        ------
        MissedError
            If its own motion misses what is kept, or breaks a hard limit.
        """
        law, motion = self.primitive.law, self.motion
        fitted = fit(
            motion,
            basis_functions=law.basis.count,
            alpha=law.attractor.alpha,
            beta=law.attractor.beta,
            alpha_s=law.clock.alpha_s,
        )
        fitted = replace(fitted, duration=law.duration, steps=law.steps, begin=law.begin)
        goal = Boundary(1.0, fitted.goal_position, fitted.goal_rotation)
        kept = [boundary for boundary in self.kept if 0 < boundary.at < 1]
        rolled, compromise = verify(fitted, self.primitive.rule, [goal, *kept])
        if compromise:
            warn(compromise, CompromiseWarning)
        record = LearningRecord.of(motion, None, Deviation.between(rolled, motion))
        return replace(
            self.primitive, law=fitted, demonstrated=fitted, record=(record,), spread=self.spread
        )

    @cached_property
    def spread(self) -> Spread:
        """Covariance of the motions along the way, as figures draw it."""
        covariances = self._covariances()
        n = self.space.linear
        return Spread(self.demonstrations, covariances[:, :n, :n], covariances[:, n:, n:])

    @property
    def middle(self) -> Floats:
        """Mean deviation from the reference at even fractions, shape (101, n + 3 b): m, rad."""
        channels = self.gaussian.mean[: self._weights].reshape(self.space.velocity_size, -1)
        return np.asarray(self.curves.values @ channels.T)

    def interval(self, level: float = 0.95, confidence: float | None = None) -> Floats:
        """Half widths within which a motion stays of the mean, at each fraction and axis by itself.

        By Student's distribution: the covariance is itself known from few demonstrations.  So wide,
        they hold the level on average over all sets of demonstrations that there might have been;
        of a particular set they may hold less.  With a confidence they are wide enough for that
        share of the sets (a tolerance interval; Howe 1969).

        Parameters
        ----------
        level : float
            Share of motions that stay, between 0 and 1.
        confidence : float, optional
            Share of sets of demonstrations whose intervals hold the level, between 0 and 1.

        Returns
        -------
        array, shape (101, n + 3 b)
            Position (m) and rotation vector (rad), world frame, at even fractions of the duration.
        """
        level = _arguments.inside("level", level)
        variances = np.diagonal(self._covariances(), axis1=1, axis2=2) + self.noise**2
        width = scipy.stats.t.ppf((1 + level) / 2, self._freedom)
        if confidence is not None:
            short = scipy.stats.chi2.isf(_arguments.inside("confidence", confidence), self._freedom)
            width = scipy.stats.norm.ppf((1 + level) / 2) * np.sqrt(self._freedom / short)
        return np.asarray(width * np.sqrt(variances))

    def impedance(self, **options: Any) -> Impedance:
        """Return the mean motion with an impedance from the spread; see :meth:`Impedance.of`.

        Raises
        ------
        InputError
            If what moves is no pose.
        """
        if not isinstance(self.motion, PoseTrajectory):
            raise InputError("an impedance is that of a tool's pose; what moves here has none")
        return Impedance.of(self.motion, self.spread, **options)

    def held(self, **options: Any) -> ConstrainedDMP:
        """Return :attr:`mean` with its impedance as channels: they follow its phase.

        Its rollouts, adapted motions, files and bags then have them beside the pose.

        Parameters
        ----------
        **options
            Of :meth:`Impedance.of`.
        """
        mean = self.mean
        found = Channels.fit(mean.law.basis, [self.impedance(**options).channels])
        return replace(
            mean, channels=found if mean.channels is None else _both(mean.channels, found)
        )

    # ---------------------------------------------------------------- what is known of a motion

    def condition(
        self,
        *boundaries: Boundary,
        noise: float | Sequence[float] = 0.0,
        context: ContextValues | None = None,
    ) -> MotionDistribution:
        """Return the distribution of motions that pass some poses, in some context.

        Parameters
        ----------
        *boundaries : Boundary
            Poses, or parts of them, at fractions of the duration; taken at the nearest sample.
        noise : float or two
            Standard deviation of what is asked for: of positions (m) and of rotation vectors
            (rad).  0 has it passed exactly, by every motion.
        context : mapping of name to number, optional
            What the motions depend on, as named when it was learned.

        Raises
        ------
        InputError
            If a boundary asks for a velocity or for nothing, a name is unknown, or something is
            asked for that is known exactly already.

        Warns
        -----
        CompromiseWarning
            If what is asked for lies far from all demonstrations (Mahalanobis distance): motions
            are then extrapolated.
        """
        deviation = noise_of(noise)
        asked = [checked(b, len(self.reference), self.space) for b in boundaries]
        parts = [self._seen(boundary, deviation) for boundary in asked]
        parts += self._seen_context(context or {})
        if not parts:
            raise InputError("condition on at least one boundary or a context")
        rows, values, noises = (np.concatenate(each) for each in zip(*parts, strict=True))
        conditioned = self.gaussian.given(rows, values, noises)
        distance, size = self.gaussian.surprise(rows, values, noises)
        usual = float(np.sqrt(scipy.stats.chi2.isf(UNLIKELY, max(1, size))))
        if distance > usual:
            warn(
                f"what is asked for lies {distance:.3g} standard deviations from what was "
                f"demonstrated; of such motions all but {UNLIKELY:.1%} lie within {usual:.2g}: it "
                "is extrapolated, demonstrate one like it",
                CompromiseWarning,
            )
        exact = [exactly(boundary, deviation) for boundary in asked]
        kept = merged((*self.kept, *exact), len(self.reference))
        return replace(self, gaussian=conditioned, kept=kept)

    def log_likelihood(self, trajectory: PoseTrajectory) -> float:
        """Log-density of a motion, projected onto the constraints as demonstrations are.

        Returns
        -------
        float
            Nats a value: over the numbers (m, rad) at 101 even fractions of its duration.
        """
        functions = self.primitive.law.basis.count
        motion = projected(trajectory, self.system, self.ends, functions)
        values = deviations(motion, self.reference)
        known = self.gaussian
        own = Gaussian(
            known.mean[: self._weights], known.covariance[: self._weights, : self._weights]
        )
        return log_likelihood(own, self.noise, values, self.curves, self._freedom)

    # ---------------------------------------------------------------- samples

    def sample(
        self,
        count: int,
        *,
        seed: int | np.random.Generator = 0,
        progress: Callable[[int, int], None] | None = None,
    ) -> Motions:
        """Draw motions: all keep the constraints, and pass what is kept.

        Parameters
        ----------
        count : int
        seed : int or Generator
            The first motions of a seed are alike for any count.
        progress : callable, optional
            Called with (motions drawn, all).

        Raises
        ------
        ConvergenceError
            If one cannot be projected onto the constraints.

        Warns
        -----
        CompromiseWarning
            If the constraints turn many of them farther than motions differ from each other.
        """
        count = _arguments.count("sample: count", count)
        weights = self._draw(count, seed)
        steps, law, system = len(self.reference), self.primitive.law, self.system
        states = np.empty((count, steps, self.space.point_size + self.space.velocity_size))
        residuals = np.empty((count, steps, system.equalities.size))
        margins = np.empty((count, steps, system.limits.size))
        far, lot = 0, TOGETHER if self._kernels is None else _TOGETHER
        for first in range(0, count, lot):
            part = slice(first, first + lot)
            drawn = self._points(weights[part])
            points = self._feasible(drawn)
            far += int((_turned(self.space, drawn, points) > self._turning).sum())
            self._with_velocities(points, states[part])
            if residuals.size:
                residuals[part] = self.retraction.residuals(points).transpose(2, 0, 1)
            margins[part] = self._margins(states[part])
            if progress is not None:
                progress(min(first + lot, count), count)
        if far > count / 2:
            warn(
                f"the constraints turn {far} of {count} samples by more than motions differ from "
                "each other; condition on less, or with noise",
                CompromiseWarning,
            )
        durations = np.full(count, self.duration)
        goals = states[:, -1, : self.space.point_size].copy()
        beside = self.primitive.channels
        return Motions(durations, law.begin, states, residuals, margins, goals, self.space, beside)

    def drawn(self, count: int, *, seed: int | np.random.Generator = 0) -> Floats:
        """Return what :meth:`sample` draws before it is projected: points, (count, N, n + 4 b)."""
        weights = self._draw(_arguments.count("drawn: count", count), seed)
        return np.ascontiguousarray(self._points(weights).transpose(2, 0, 1))

    def _draw(self, count: int, seed: int | np.random.Generator) -> Floats:
        return self.gaussian.draw(count, np.random.default_rng(seed))[:, : self._weights]

    def _feasible(self, drawn: Floats) -> Floats:
        """Return motions on the constraints; exactly projected where it takes that."""
        if not self.system.size:
            return drawn
        moved = self.retraction(drawn)
        points, lost = moved.points, ~moved.arrived
        if self.system.limits.size:
            width = self.space.point_size + self.space.velocity_size
            states = np.empty((points.shape[2], len(points), width))
            self._with_velocities(points, states)
            lost |= ~(self._margins(states).min(axis=(1, 2)) >= -KEPT)
        for k in np.flatnonzero(lost):
            trajectory = self.trajectory(drawn[:, :, k], f"sample {k}")
            ends = self.boundaries(trajectory)
            result = project_trajectory(
                trajectory,
                self.system,
                boundaries=ends,
                begin=self.primitive.law.begin,
                position_weight=ADAPTING.position,
                position_smoothing=ADAPTING.position_smoothing,
                rotation_smoothing=ADAPTING.rotation_smoothing,
            )
            points[:, :, k] = result.trajectory.points
        return points

    @property
    def _kernels(self) -> Kernels | None:
        system = self.system.equalities
        return kernels_of(system) if system.size else None

    @cached_property
    def retraction(self) -> Retraction:
        """What moves samples onto the equalities; what does not arrive is projected exactly."""
        request = Request(
            self.motion,
            self.system.equalities,
            self.boundaries(self.motion),
            ADAPTING,
            begin=self.primitive.law.begin,
        )
        return Retraction(request)

    def _with_velocities(self, points: Floats, states: Floats) -> None:
        """Write points, motions last, and the velocities of the steps that lead to them, as states.

        Parameters
        ----------
        states : array, shape (S, N, ...)
            As :class:`noslip.runtime.batch.Motions` has them.
        """
        count, size, several = points.shape
        kernels = self._kernels
        if kernels is not None:
            kernels.states(self.duration / (count - 1), points, states)
            return
        states[:, :, :size] = points.transpose(2, 0, 1)
        for rows in in_cache(count - 1, several):
            before, after = points[rows], points[rows.start + 1 : rows.stop + 1]
            moving = self.space.difference(after, before, 1) * ((count - 1) / self.duration)
            states[:, rows.start + 1 : rows.stop + 1, size:] = moving.transpose(2, 0, 1)
        states[:, 0, size:] = states[:, 1, size:]

    def _margins(self, states: Floats) -> Floats:
        """Margins of the limits, shape (S, N, k); infinite where they are not asked for."""
        limits = self.system.limits
        found = np.full((*states.shape[:2], limits.size), np.inf)
        if not limits.size:
            return found
        on_poses = np.array(limits.row_levels) == "position"
        on_steps = np.array(limits.row_levels) != "acceleration"
        steps = states.shape[1] - 1
        h = self.duration / steps
        times = self.primitive.law.begin + h * np.arange(steps + 1)
        parts = np.cumsum([self.space.linear, 4 * self.space.rotations, self.space.linear])
        for state, margin in zip(states, found, strict=True):
            position, quaternion, linear, angular = np.split(state, parts, axis=1)
            pose, moving = (position, quaternion), (linear[1:], angular[1:])
            changes = [np.pad(np.diff(v, axis=0) / h, ((0, 1), (0, 0))) for v in moving]
            margin[1:] = limits.of_steps(times, *pose, *moving, *changes)
            # The last step is followed by none.
            margin[-1, ~on_steps] = np.inf
            first = limits.residuals(
                times[:1], *(each[:1] for each in (position, quaternion, linear, angular))
            )
            margin[0, on_poses] = first[0, on_poses]
        return found

    # ---------------------------------------------------------------- files

    def save(self, path: str | Path) -> Path:
        """Write it as JSON, with its primitive; :func:`noslip.saving.load_distribution` reads it.

        To :func:`noslip.load_primitive`, and to all commands, the file is that of the primitive.
        Samples, intervals and likelihoods of what is read back are the same.
        """
        return write_document(path, self.as_data())

    def as_data(self) -> dict[str, Any]:
        """Return what :meth:`save` writes, as plain data."""
        own = {
            "curves": self.curves.count,
            "mean": self.gaussian.mean.tolist(),
            "covariance": self.gaussian.covariance.tolist(),
            "noise": self.noise.tolist(),
            "score": self.score,
            "demonstrations": self.demonstrations,
            "context": list(self.context),
            "kept": [boundary_to_data(boundary) for boundary in self.kept],
            "ends": list(self.ends),
        }
        return self.primitive.as_data() | {"distribution": own}

    # ---------------------------------------------------------------- inside

    @property
    def _freedom(self) -> int:
        return freedom_of(self.demonstrations, len(self.context))

    @property
    def _weights(self) -> int:
        return self.space.velocity_size * self.curves.count

    @cached_property
    def _basis(self) -> Floats:
        return self.curves.at(np.linspace(0.0, 1.0, len(self.reference)))

    @cached_property
    def _turning(self) -> float:
        """How far motions turn from each other (rad), rms along the way."""
        return float(np.sqrt(np.mean(np.sum(self.spread.rotation_deviation**2, axis=1))))

    def _points(self, weights: Floats) -> Floats:
        """Motions of weights, shape (S, D): points, (N, n + 4 b, S), on what is kept exactly."""
        n, space = self.space.linear, self.space
        shaped = weights.T.reshape(space.velocity_size, self.curves.count, -1)
        reference = self.reference.points[:, :, None]
        kernels = self._kernels
        if kernels is not None:
            changes = np.matmul(self._basis, shaped).swapaxes(0, 1)
            points = kernels.moved(self.reference.points, changes)
        else:
            points = np.empty((*reference.shape[:2], len(weights)))
            for rows in in_cache(len(points), len(weights)):
                changes = np.matmul(self._basis[rows], shaped).swapaxes(0, 1)
                points[rows] = space.moved(reference[rows], changes, 1)
        for boundary in self.kept:
            k = sample_of(boundary.at, len(points))
            if boundary.position is not None:
                points[k, :n] = boundary.position[:, None]
            if boundary.quaternion is not None:
                for first in range(0, 4 * space.rotations, 4):
                    kept = boundary.quaternion[first : first + 4]
                    own = points[k, n + first : n + first + 4]
                    own[:] = kept[:, None] * np.where(kept @ own < 0, -1.0, 1.0)
        return points

    def trajectory(self, points: Floats, name: str) -> PoseTrajectory:
        """Return points, shape (N, n + 4 b), as a trajectory."""
        return replace(self.reference.with_points(points), name=name)

    def boundaries(self, motion: PoseTrajectory) -> tuple[Boundary, ...]:
        """What a motion keeps: its own ends, and what all pass."""
        own = [
            Boundary.keeping(motion, at, end) for at, end in zip((0.0, 1.0), self.ends, strict=True)
        ]
        return merged((*own, *self.kept), len(motion))

    def _covariances(self) -> Floats:
        """Of the deviations at each of the fractions, shape (101, n + 3 b, n + 3 b)."""
        size, values, channels = self.curves.count, self.curves.values, self.space.velocity_size
        weights = self.gaussian.covariance[: self._weights, : self._weights]
        shaped = weights.reshape(channels, size, channels, size)
        found = np.einsum("sk,ikjl,sl->sij", values, shaped, values, optimize=True)
        found = (found + found.swapaxes(1, 2)) / 2
        # What is known exactly has rounding for a variance.
        diagonal = np.arange(channels)
        found[:, diagonal, diagonal] = np.maximum(found[:, diagonal, diagonal], 0.0)
        return np.asarray(found)

    def _seen(self, boundary: Boundary, noise: Floats) -> tuple[Floats, Floats, Floats]:
        """Rows, values and noise of what a boundary says of the weights."""
        k = sample_of(boundary.at, len(self.reference))
        space, own = self.space, self.reference.points[k]
        sizes, point = (space.linear, space.angular), own.copy()
        if boundary.position is not None:
            point[: space.linear] = boundary.position
        if boundary.quaternion is not None:
            point[space.linear :] = boundary.quaternion
        values = space.difference(point[None], own[None])[0]
        asked = np.repeat([boundary.position is not None, boundary.rotation is not None], sizes)
        rows = np.zeros((space.velocity_size, len(self.gaussian.mean)))
        for channel in range(space.velocity_size):
            first = channel * self.curves.count
            rows[channel, first : first + self.curves.count] = self._basis[k]
        return rows[asked], values[asked], np.repeat(noise, sizes)[asked]

    def _seen_context(self, context: ContextValues) -> list[tuple[Floats, Floats, Floats]]:
        rows = context_rows(self.gaussian, len(self.context))
        found = []
        for name, value in context.items():
            if name not in self.context:
                known = f"there are {', '.join(self.context)}" if self.context else "it has none"
                raise InputError(f"context {_arguments.short(name)} is unknown: {known}")
            number = _arguments.finite(f"context {name}", value)
            at = self.context.index(name)
            found.append((rows[at : at + 1], np.array([number]), np.zeros(1)))
        return found


def reference_of(primitive: ConstrainedDMP) -> PoseTrajectory:
    """Return the motion of a primitive that others are told apart from, of equal steps."""
    rolled = primitive.rollout()
    # Times of a rollout are sums.
    times = np.linspace(rolled.times[0], rolled.times[-1], len(rolled))
    found: PoseTrajectory = replace(rolled.with_points(rolled.points, times), name="reference")
    return found


def _both(one: Channels, other: Channels) -> Channels:
    """Channels of one basis beside each other."""
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(one, name), getattr(other, name)], axis=-1)
        for name in ("trend", "weights", "least", "most")
    }
    return replace(one, **arrays, names=one.names + other.names, units=one.units + other.units)


def learn_distribution(
    primitive: ConstrainedDMP,
    demonstrations: Recorded | Iterable[Recorded],
    *,
    context: Mapping[str, Sequence[float]] | None = None,
    ends: tuple[End, End] = ("free", "position"),
) -> MotionDistribution:
    """Learn how the demonstrations of a primitive are distributed.

    Parameters
    ----------
    primitive : ConstrainedDMP
        Learned from them.
    demonstrations : several PoseTrajectory or Trajectory
        Three or more, of any rate; each is projected onto the primitive's constraints.
    context : mapping of name to numbers, optional
        What the motions depend on, a number a demonstration, such as the size of a workpiece;
        :meth:`MotionDistribution.condition` then takes it.
    ends : pair of "free", "position", "rotation" or "pose"
        What a projection keeps of each demonstration's, and each sample's, first and last pose.

    Raises
    ------
    InputError
        If there are fewer than three, or a context does not have a number of each.
    ConvergenceError
        If a projection does not converge.
    """
    recorded = as_demonstrations(demonstrations)
    feasible = [projected(d, primitive.system, ends, primitive.law.basis.count) for d in recorded]
    return MotionDistribution.about(primitive, feasible, context, ends)


def _turned(space: Space, before: Floats, after: Floats) -> Floats:
    """How far each motion was turned (rad), rms along the way; by a few degrees, or more."""
    squares = np.zeros((len(before), before.shape[2]))
    for first in range(space.linear, space.point_size, 4):
        one, other = (points[:, first : first + 4] for points in (before, after))
        # Of half an angle h, 1 - cos h is h^2 / 2.
        squares += 8 * np.maximum(0.0, 1 - np.abs(np.einsum("nqs,nqs->ns", one, other)))
    return np.asarray(np.sqrt(squares.mean(axis=0)))
