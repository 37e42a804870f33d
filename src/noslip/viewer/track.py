"""One motion as the viewer shows it, in numbers: nothing here knows of a browser.

Velocities are those of the steps between samples, the residuals those that :func:`noslip.check`
reports, so that the angle between the drawn velocity and the drawn lateral axis is a right one
exactly where the constraint holds.  Of a constraint in a moving frame, the velocity is the one
relative to that frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.bodies import Bodies
from noslip.constraints.check import (
    CheckReport,
    check,
    quantity_text,
    residual_text,
    sample_residuals,
)
from noslip.constraints.declaration import UNITS, Constraint
from noslip.constraints.edge_motion import EdgeMotion, edge_motion, edge_steps, work_moves
from noslip.constraints.system import ConstraintSystem
from noslip.edge import Edge
from noslip.errors import InputError
from noslip.merit import figures_of_merit
from noslip.runtime.motion import Motion
from noslip.runtime.state import State
from noslip.space import IN
from noslip.trajectory import PoseTrajectory
from noslip.vectors import Trajectory
from noslip.viewer.colors import Bytes, slip_colors

Moving = PoseTrajectory | Trajectory | Bodies
"""What may move: a tool, joints or a point, several tools."""

MOST_SEGMENTS = 1000
"""Of a trail, so that ten motions of any length stay fluid; of what is longer the worst violations
stay."""
SLOW = 1e-3
"""Share of the peak speed below which the direction of travel is that of rounding."""
LEAST_ANGLE = 1e-3
"""Degrees of slip that are told: what is less is rounding, and a blade's width."""
ARROW = 0.15
"""Length of the longest arrow, over the scene's size: it ends within the picture."""
LONGEST = 2.0
"""Times that, of an arrow beside the motion at most: what holds a dragged tool back may be any
force."""


@dataclass(frozen=True, eq=False)
class Track:
    """One motion, and what of it is drawn.

    It is checked against the system, which may be empty, and compared with a reference, drawn as
    a ghost; ``against`` says what that is.  Of joints, or of several bodies, that is the motion of
    the tool, ``whole`` is all that moves, which is checked, and ``beside`` the other bodies.
    """

    name: str
    motion: PoseTrajectory
    system: ConstraintSystem
    reference: PoseTrajectory | None = None
    against: str = "the demonstration"
    whole: Moving | None = None
    beside: Mapping[str, PoseTrajectory] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        name: str,
        moving: Moving,
        system: ConstraintSystem,
        reference: Moving | None = None,
        against: str = "the demonstration",
    ) -> Track:
        """Return the track of whatever moves, if it has a place.

        Raises
        ------
        InputError
            If it has none.
        """
        body = "" if system.edged is None else system.edged.body
        tool, beside = placed(name, moving, body)
        ghost = None if reference is None else placed(name, reference, body)[0]
        whole = None if moving is tool else moving
        return cls(name, tool, system, ghost, against, whole, beside)

    # ---------------------------------------------------------------- along the motion

    @cached_property
    def rows(self) -> Floats:
        """Residuals and margins at each sample, shape (N, m)."""
        return sample_residuals(self._checked, self.system)

    @cached_property
    def sizes(self) -> dict[str, Floats]:
        """Size of each equality's residual, by name, each of shape (N,)."""
        return {
            name: np.linalg.norm(rows, axis=1)
            for name, constraint, rows in self._parts
            if constraint.relation == "zero"
        }

    @cached_property
    def margins(self) -> dict[str, Floats]:
        """Least margin over the rows of each limit, by name, each of shape (N,)."""
        return {
            name: rows.min(axis=1)
            for name, constraint, rows in self._parts
            if constraint.relation == "nonnegative"
        }

    @cached_property
    def violation(self) -> Floats:
        """The largest violation of any constraint at each sample, in its own unit, shape (N,)."""
        limits = [np.maximum(-margin, 0.0) for margin in self.margins.values()]
        sizes = [np.zeros(len(self.motion)), *self.sizes.values(), *limits]
        return np.asarray(np.max(sizes, axis=0))

    @cached_property
    def forces(self) -> Floats | None:
        """Linear part of the constraint force (m/s^2), shape (N, 3); None of a recording."""
        if isinstance(self.motion, Motion) and self.motion.row_forces.size:
            return self.motion.constraint_forces[:, :3]
        return None

    @cached_property
    def report(self) -> CheckReport | None:
        """The verdict of :func:`noslip.check`; None if there is nothing to check."""
        return check(self._checked, self.system) if self.system.constraints else None

    @property
    def _checked(self) -> Any:
        return self.motion if self.whole is None else self.whole

    @property
    def _parts(self) -> list[tuple[str, Constraint, Floats]]:
        parts = np.split(self.rows, np.cumsum(self.system.rows)[:-1], axis=1)
        return list(zip(self.system.names, self.system.constraints, parts, strict=False))

    # ---------------------------------------------------------------- at one instant

    def sample(self, time: float) -> int:
        """Return the last sample at or before a time (s) since the motion began."""
        k = int(np.searchsorted(self.clock, time + 1e-9, side="right")) - 1
        return min(max(k, 0), len(self.motion) - 1)

    @cached_property
    def clock(self) -> Floats:
        """Seconds since the motion began, shape (N,)."""
        return np.asarray(self.motion.times - self.motion.times[0])

    @property
    def edged(self) -> Constraint | None:
        """The constraint that says where the tool's edge is, and what moves under it."""
        return self.system.edged

    @property
    def edge(self) -> Edge:
        """The tool's edge; its origin, where no constraint names one."""
        return Edge(lateral=None) if self.edged is None else cast(Edge, self.edged.edge)

    @cached_property
    def points(self) -> Floats:
        """The edge's point, world frame (m), shape (N, 3)."""
        return self.edge.points(self.motion.positions, self.motion.rotations)

    @cached_property
    def velocities(self) -> Floats:
        """Velocity of that point on the step to each sample (m/s), shape (N, 3).

        Relative to the work, along the axes of the world.
        """
        linear, _ = self.motion.step_velocities()
        return _from_first(linear if self._steps is None else self._steps.world_velocities)

    @cached_property
    def lateral_axes(self) -> Floats | None:
        """The lateral axis in the world on that step, shape (N, 3); None without one."""
        if self._steps is None or self.edge.lateral is None:
            return None
        return _from_first(self._steps.world_lateral_axes)

    @cached_property
    def _steps(self) -> EdgeMotion | None:
        if self.edged is None:
            return None
        if self.whole is None or IN not in self.edged.body:
            return edge_steps(self.motion, self.edged)
        # As another body sees it: its world is that body.
        steps = edge_steps(self.whole.body(self.edged.body), self.edged)
        assert isinstance(self.whole, Bodies)
        work = self.whole.parts[self.edged.body.split(IN)[1]]
        _, _, turns = work.step_middles()
        return replace(steps, work=turns * steps.work)

    @cached_property
    def peak_speed(self) -> float:
        """Largest speed of the point (m/s)."""
        return float(np.linalg.norm(self.velocities, axis=1).max())

    def slip_angle(self, sample: int) -> float | None:
        """Angle between the velocity and the blade's plane (rad); None where it hardly moves."""
        if self._steps is None or self.edge.lateral is None:
            return None
        if np.linalg.norm(self.velocities[sample]) <= SLOW * self.peak_speed:
            return None
        # The first sample has those of the first step.
        return float(self._steps.slip_angles[max(sample - 1, 0)])

    def arrows(self, sample: int, size: float) -> dict[str, Floats]:
        """Start and end of each arrow at a sample, world frame (m), each of shape (2, 3).

        ``lateral``, the axis; ``velocity``, relative to the peak speed; and ``force``, relative to
        the peak acceleration of the motion, so that a force that does nothing is not seen.  The
        longest has a fixed share of the scene's size (m).
        """
        lateral = None if self.lateral_axes is None else self.lateral_axes[sample]
        force = None if self.forces is None else self.forces[sample]
        return self._arrows(self.points[sample], self.velocities[sample], lateral, force, size)

    def arrows_in(self, state: State, size: float) -> dict[str, Floats]:
        """Return the same arrows of a state beside the motion, such as a pushed tool's."""
        point = self.edge.points(state.position, state.rotation)
        axes, velocity = None, state.linear_velocity
        if self.edged is not None:
            # As along the motion: in the middle of the step that led to it.
            half = state.previous_step / 2
            step = edge_motion(
                self.edged,
                state.time - half,
                state.position - half * state.linear_velocity,
                Rotation.from_rotvec(-half * state.angular_velocity) * state.rotation,
                state.linear_velocity,
                state.angular_velocity,
            )
            velocity = step.world_velocities[0]
            axes = step.world_lateral_axes[0] if self.edge.lateral else None
        force = None if self.forces is None else state.constraint_forces[:3]
        return self._arrows(point, velocity, axes, force, size)

    def _arrows(
        self,
        at: Floats,
        velocity: Floats,
        lateral: Floats | None,
        force: Floats | None,
        size: float,
    ) -> dict[str, Floats]:
        shown = {
            "lateral": (lateral, 1.0),
            "velocity": (velocity, self.peak_speed),
            "force": (force, self._peak_acceleration),
        }
        arrows = {}
        for name, (vector, longest) in shown.items():
            if vector is not None and longest > 0:
                scale = ARROW * size / max(longest, float(np.linalg.norm(vector)) / LONGEST)
                arrows[name] = np.array([at, at + scale * vector])
        return arrows

    def readout(self, time: float) -> dict[str, str]:
        """What is told of an instant, as label and text."""
        k = self.sample(time)
        texts = {
            "time": f"{self.clock[k]:.3f} s",
            # Rounded first, and not -0.
            "position": ", ".join(
                f"{x:.2f}" for x in np.round(1e3 * self.motion.positions[k], 2) + 0.0
            )
            + " mm",
            "speed in the moving frame" if self.edged and work_moves(self.edged) else "speed": (
                f"{1e3 * np.linalg.norm(self.velocities[k]):.3g} mm/s"
            ),
        }
        angle = self.slip_angle(k)
        if self.lateral_axes is not None:
            texts["slip angle"] = "at rest" if angle is None else _angle_text(angle)
        for name, sizes in self.sizes.items():
            texts[f"{name}: residual"] = residual_text(float(sizes[k]), self.units[name])
        for name, margins in self.margins.items():
            texts[f"{name}: margin"] = quantity_text(float(margins[k]), self.units[name])
        if self.forces is not None:
            texts["constraint force"] = f"{np.linalg.norm(self.forces[k]):.3g} m/s²"
        return texts

    # ---------------------------------------------------------------- as a whole

    def merits(self) -> dict[str, str]:
        """Figures of merit against the reference, as label and text; empty without one."""
        if self.reference is None:
            return {}
        held = self.system if self.whole is None else ()
        found = figures_of_merit(self.motion, self.reference, held)
        texts = {
            "position, rms": f"{1e3 * found.position_rms:.3g} mm",
            "position, at the end": f"{1e3 * found.end_error:.3g} mm",
            "rotation, rms": f"{np.degrees(found.rotation_rms):.3g}°",
            "angular speed, peak": f"{found.angular_speed_peak:.3g} rad/s",
            "angular acceleration, peak": f"{found.angular_acceleration_peak:.3g} rad/s²",
        }
        if found.slowest_edge_speed is not None:
            texts["speed along the edge, least"] = f"{1e3 * found.slowest_edge_speed:.3g} mm/s"
        return texts

    def trail(self, worst: float) -> tuple[Floats, Bytes]:
        """Segments of the path, shape (S, 2, 3), and their colors, shape (S, 2, 3) of bytes.

        The violation ``worst`` has the last color.
        """
        last = len(self.points) - 1
        cuts = group_starts(last, MOST_SEGMENTS)
        ends = self.points[np.append(cuts, last)]
        segments = np.stack([ends[:-1], ends[1:]], axis=1)
        # A step belongs to the sample where it ends.
        sizes = np.maximum.reduceat(self.violation[1:], cuts)
        colors = slip_colors(sizes, worst)
        return segments, np.repeat(colors[:, None], 2, axis=1)

    # ---------------------------------------------------------------- inside

    @cached_property
    def _peak_acceleration(self) -> float:
        changes = (
            np.diff(self.motion.linear_velocities, axis=0) / np.diff(self.motion.times)[:, None]
        )
        return float(np.linalg.norm(changes, axis=1).max())

    @cached_property
    def units(self) -> dict[str, str]:
        """Of each constraint, by name; where its rows differ, that of the first."""
        held = zip(self.system.names, self.system.constraints, strict=True)
        return {name: constraint.unit or UNITS[constraint.level] for name, constraint in held}


def placed(
    name: str, moving: Moving, body: str = ""
) -> tuple[PoseTrajectory, dict[str, PoseTrajectory]]:
    """Return the motion of the body that a constraint names, "" the first, and of the others.

    Raises
    ------
    InputError
        If nothing of it has a place in a scene.
    """
    if isinstance(moving, PoseTrajectory):
        return moving, {}
    if isinstance(moving, Bodies):
        tool = body.split(IN)[0] or moving.names[0]
        others = {other: part for other, part in moving.parts.items() if other != tool}
        return moving.parts[tool], others
    if not moving.space.bodies:
        raise InputError(
            f"{name}: moves {', '.join(moving.names)}, which have no place in a scene; see it with "
            "noslip plot, or name the robot whose joints they are"
        )
    return moving.tool, {}


def _angle_text(angle: float) -> str:
    degrees = float(np.degrees(angle))
    if abs(degrees) < LEAST_ANGLE:
        return f"below {LEAST_ANGLE:g}°"
    return f"{degrees:.2g}°"


def _from_first(steps: Floats) -> Floats:
    """Values of the step to each sample; the first sample has those of the first step."""
    return np.concatenate([steps[:1], steps])


def group_starts(count: int, most: int) -> NDArray[np.intp]:
    """Where ``count`` samples begin anew when they are put into at most ``most`` groups."""
    groups = min(count, most)
    return np.arange(groups) * count // groups
