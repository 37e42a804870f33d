"""Chunks of actions, each projected as a whole and joined to what was executed of the last."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._typing import Floats
from noslip.boundary import Boundary
from noslip.constraints.check import quantity_text, sample_residuals
from noslip.constraints.system import ConstraintSystem
from noslip.errors import CompromiseWarning, ConstraintError, InputError, warn
from noslip.projection.feasibility import project_pose
from noslip.projection.request import FEWEST_SAMPLES, Request, Weights
from noslip.projection.trajectory import project
from noslip.runtime.motion import HELD, Commanded, Motion
from noslip.shielding.reference import JOINED, LEVER, PACE, SEEN, braked, drawn, joined, poses_of
from noslip.trajectory import PoseTrajectory

_BENT = 0.1
"""Seconds: a correction that changes within 2 pi of it costs more by its bending than by itself."""
_KEPT, _SLIP = 1e-9, 1e-10
"""Residual with which a chunk keeps the constraints as it is, and that of what is sent instead, in
the constraints' own units."""
_WILD = 4
"""Speed over the command's, or over :data:`PACE` if that is more, at which a motion is none."""
_GENTLE, _JOLT = 1.0, 2.0
"""Accelerations (m/s^2; of turning, over :data:`LEVER`) where chunks are joined: up to which one
goes on as it is, as hands do as much; and from which a motion is none: noise does a fourth."""
_FAR = 0.2
"""Radians, or levers, from the command at a chunk's end that are told: 11 degrees, 10 mm."""
_SPACED = 1e-3
"""Share of the period by which the poses of a chunk may be spaced otherwise."""
_MOST = 1000
"""Poses of a chunk: what smooths them is a matrix."""
_BRAKING = (1 / 2, 1 / 4, 1 / 8)
"""Shares of a chunk within which a tool comes to rest, the gentlest first."""


class Chunks:
    """Takes chunk after chunk.

    Parameters
    ----------
    system : ConstraintSystem
    period : float
        Seconds between poses.

    Attributes
    ----------
    compromise : str
        What the last chunk sent does not do as commanded; empty if nothing.
    """

    def __init__(self, system: ConstraintSystem, period: float) -> None:
        self.system, self.period, self.compromise = system, period, ""
        limits = system.limits
        self._hard = np.array(limits.per_row(c.priority == 0 for c in limits.constraints), bool)
        # What was sent, and what was to be followed: poses before a chunk, and then the chunk.
        self._sent: PoseTrajectory | None = None
        self._wanted: PoseTrajectory | None = None
        # Commands before the last chunk, and that chunk.
        self._past, self._asked = np.empty((0, 7)), np.empty((0, 7))

    def reset(self, position: Floats, rotation: Rotation) -> None:
        """Begin anew from a pose, at rest."""
        quaternion = rotation.as_quat(scalar_first=True)
        at = np.hstack(project_pose(self.system.equalities, 0.0, position, quaternion))
        still = poses_of(np.tile(at, (JOINED, 1)), (1 - JOINED) * self.period, self.period)
        self._sent = self._wanted = still
        self._past = self._asked = np.empty((0, 7))

    def next(self, poses: PoseTrajectory, executed: int | None = None) -> Motion:
        """Return the motion for a chunk; see :meth:`noslip.Shield.chunk`."""
        before, wanted, past = self._executed(executed)
        chunk = self._checked(poses, 0.0 if before is None else before.times[-1] + self.period)
        reference, text = chunk, ""
        motion = self._as_it_is(before, chunk)
        if motion is None:
            reference = joined(wanted, past, chunk)
            motion, text = self._made(before, chunk, reference)
            reference = reference[: len(chunk) + (0 if before is None else JOINED)]
        elif before is not None:
            reference = _together(before, chunk)
        if before is None:
            # As if it had always moved as it begins.
            before = braked(motion, JOINED, backwards=True)
            reference = _together(braked(reference, JOINED, backwards=True), reference)
        self._sent, self._wanted, self.compromise = _together(before, motion), reference, text
        self._past, self._asked = past, np.hstack([chunk.positions, chunk.quaternions])
        if text:
            warn(f"{chunk.name}: {text}", CompromiseWarning)
        return motion.with_channels(poses.channels and poses.channels.retimed(motion.times))

    def _checked(self, poses: PoseTrajectory, begin: float) -> PoseTrajectory:
        """The chunk in the shield's own time."""
        if not isinstance(poses, PoseTrajectory):
            raise InputError(f"chunk takes a PoseTrajectory, got {type(poses).__name__}")
        if not poses.is_uniform or abs(poses.period - self.period) > _SPACED * self.period:
            raise InputError(
                f"{poses.name}: its poses are {poses.period:.6g} s apart, not {self.period:.6g} s "
                f"as this shield's; resample it with rate={1 / self.period:.6g}"
            )
        if not FEWEST_SAMPLES <= len(poses) <= _MOST:
            raise InputError(
                f"{poses.name}: a chunk has {FEWEST_SAMPLES} to {_MOST} poses, got {len(poses)}; "
                "send single commands to step(), and recordings to project_trajectory"
            )
        times: Floats = begin + self.period * np.arange(len(poses), dtype=np.float64)
        return PoseTrajectory(times, poses.positions, poses.rotations, name=poses.name)

    def _executed(
        self, count: int | None
    ) -> tuple[PoseTrajectory | None, PoseTrajectory | None, Floats]:
        """The last poses that were carried out, what was to be followed, and was commanded."""
        most = 0 if self._sent is None else len(self._sent) - JOINED
        if count is None:
            count = most
        whole = isinstance(count, (int, np.integer)) and not isinstance(count, bool)
        if not whole or not 0 <= count <= most:
            raise InputError(
                f"executed must be a number of poses of the last chunk, 0 to {most}, got "
                f"{_arguments.short(count)}"
            )
        if self._sent is None or self._wanted is None:
            return None, None, self._past
        before, wanted = (each[count : count + JOINED] for each in (self._sent, self._wanted))
        past = np.vstack([self._past, self._asked[:count]])[-max(1, round(SEEN / self.period)) :]
        return before, drawn(wanted, before), past

    # ---------------------------------------------------------------- ways to go on

    def _as_it_is(self, before: PoseTrajectory | None, chunk: PoseTrajectory) -> Motion | None:
        """The chunk itself, if it keeps the constraints and goes on from what was executed."""
        whole = _together(before, chunk)
        try:
            motion = self._motion(whole, chunk)
        except ConstraintError:
            # Undefined there; what is sent in its place may not be.
            return None
        fits = self._keeps(motion, _KEPT) and (before is None or _goes_on(whole, _GENTLE))
        return motion[-len(chunk) :] if fits else None

    def _made(
        self, before: PoseTrajectory | None, chunk: PoseTrajectory, reference: PoseTrajectory
    ) -> tuple[Motion, str]:
        """The motion that follows what was executed, and what is to be told of it."""
        for whole, told in self._ways(before, chunk, reference):
            motion, text = self._motion(whole, chunk)[-len(chunk) :], told
            if self._keeps(motion, _SLIP):
                break
        off, turned = motion.end_error, motion.end_rotation_error
        if text or max(off / LEVER, turned) > _FAR:
            ends = f"ends {quantity_text(off, 'm')} and {np.degrees(turned):.2g} degrees off"
            text = f"{text or 'cannot follow the command'}; {ends}"
        return motion, text

    def _ways(
        self, before: PoseTrajectory | None, chunk: PoseTrajectory, reference: PoseTrajectory
    ) -> Iterator[tuple[PoseTrajectory, str]]:
        """Ways to go on, the best first, and what is to be told of each."""
        for turn in (False, True):
            for found, text in self._projected(before, reference, turn):
                whole = found[: len(before or ()) + len(chunk)]
                joins = before is None or _goes_on(whole, _JOLT, reference)
                if joins and _calm(whole, chunk):
                    yield whole, text
        text = f"no way near the command keeps {', '.join(self.system.names)}: "
        count, last = len(chunk), chunk if before is None else before
        for share in () if before is None else _BRAKING:
            whole = _together(before, braked(last, count, round(share * count)))
            yield whole, f"{text}brakes and holds"
            for projected, _ in self._projected(before, whole):
                yield projected, f"{text}brakes and holds"
        where = slice(-1, None) if before is not None else slice(1)
        pose = np.hstack([last.positions[where], last.quaternions[where]])
        still = poses_of(np.tile(pose, (count, 1)), chunk.times[0], self.period)
        yield _together(before, still), f"{text}holds at once"

    def _projected(
        self,
        before: PoseTrajectory | None,
        reference: PoseTrajectory,
        turn: bool = False,
    ) -> Iterator[tuple[PoseTrajectory, str]]:
        """The projection of a reference, if it converges."""
        last, bent, kept = len(reference) - 1, _BENT, []
        if before is not None:
            both = zip(before.positions, before.rotations, strict=True)
            kept = [Boundary(k / last, *pose) for k, pose in enumerate(both)]
            away = reference.positions[JOINED - 1] - before.positions[-1]
            bent = max(bent, float(np.linalg.norm(away)) / (2 * PACE))
        bending = (bent / reference.duration) ** 4
        request = Request(
            reference,
            self.system,
            tuple(kept),
            Weights(1.0, bending, bending),
            begin=float(reference.times[0]),
            length=LEVER,
        )
        try:
            found = project(request, turn=turn)
        except ConstraintError:
            # Undefined somewhere on its way.
            return
        if found.converged:
            left_out = " and ".join(found.left_out)
            yield found.trajectory, f"{left_out} cannot be kept and gives way" if left_out else ""

    # ---------------------------------------------------------------- motions

    def _motion(self, whole: PoseTrajectory, chunk: PoseTrajectory) -> Motion:
        """Poses with what the constraints say of each step."""
        count, equalities, limits = len(whole), self.system.equalities, self.system.limits
        linear, angular = (np.concatenate([v[:1], v]) for v in whole.step_velocities())
        none = np.zeros((count, 0))
        motion = Motion(
            times=whole.times,
            positions=whole.positions,
            rotations=whole.rotations,
            linear_velocities=linear,
            angular_velocities=angular,
            name=chunk.name,
            asked=Commanded(chunk),
            constraint_forces=np.zeros((count, 6)),
            constraint_residuals=none,
            multipliers=none,
        )
        return replace(
            motion,
            constraint_residuals=sample_residuals(motion, equalities),
            multipliers=np.zeros((count, equalities.size)),
            constraint_names=tuple(equalities.row_names),
            margins=sample_residuals(motion, limits),
            limit_multipliers=np.zeros((count, limits.size)),
            limit_names=tuple(limits.row_names),
            row_forces=np.zeros((count, self.system.size, 6)),
        )

    def _keeps(self, motion: Motion, most: float) -> bool:
        """Whether a motion satisfies equalities, but for so much, and hard limits."""
        left = np.abs(motion.constraint_residuals).max(initial=0.0)
        return bool(left <= most and motion.margins[:, self._hard].min(initial=0.0) >= -HELD)


def _together(before: PoseTrajectory | None, after: PoseTrajectory) -> PoseTrajectory:
    if before is None:
        return after
    return PoseTrajectory(
        np.concatenate([before.times, after.times]),
        np.concatenate([before.positions, after.positions]),
        Rotation.concatenate([before.rotations, after.rotations]),
        name=after.name,
    )


def _goes_on(
    motion: PoseTrajectory, acceleration: float, reference: PoseTrajectory | None = None
) -> bool:
    """Whether velocities change so much at most where a chunk is joined, or as they do elsewhere.

    Or twice as much as a reference's.
    """
    near, elsewhere = np.split(_jumps(motion)[:, JOINED - 2 :], [2], axis=1)
    most = np.maximum(acceleration * motion.period, elsewhere.max(axis=1, initial=0.0))
    if reference is not None:
        most = np.maximum(most, 2 * _jumps(reference)[:, JOINED - 2 : JOINED].max(axis=1))
    return bool(np.all(near.max(axis=1) <= most))


def _jumps(motion: PoseTrajectory) -> Floats:
    """Changes of linear and, as if at a lever, angular velocity at inner samples (m/s)."""
    both = zip(motion.step_velocities(), (1.0, LEVER), strict=True)
    return np.array([lever * np.linalg.norm(np.diff(v, axis=0), axis=1) for v, lever in both])


def _calm(motion: PoseTrajectory, chunk: PoseTrajectory) -> bool:
    """Whether it moves and turns not much faster than what is commanded."""
    both = zip(motion.step_velocities(), chunk.step_velocities(), (1.0, LEVER), strict=True)
    return all(
        lever * np.linalg.norm(own, axis=1).max()
        <= _WILD * max(PACE, lever * np.linalg.norm(asked, axis=1).max())
        for own, asked, lever in both
    )
