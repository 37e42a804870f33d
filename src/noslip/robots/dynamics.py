"""The arm under torque control in MuJoCo: what of a tracked motion its dynamics leave.

Computed torque cancels inertia and gravity by the model and drives the error like a critically
damped oscillator; joint impedance is a spring and a damper at each joint, with gravity and
velocity terms compensated.  Both know the nominal model; the simulated arm may be heavier by a
share, its sensors noisy, its measurements late, and its torques are limited.  No force acts on the
tool: tissue is not simulated.
"""

from __future__ import annotations

import copy
from collections import deque
from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

import numpy as np

from noslip import _arguments
from noslip._typing import Floats
from noslip.errors import ConvergenceError, InputError
from noslip.robots.executed import ToolErrors, TrackedMotion, slip, slip_distance, tool_errors
from noslip.robots.kinematics import InverseKinematics
from noslip.robots.model import mujoco_warnings, required
from noslip.trajectory import PoseTrajectory

Control = Literal["torque", "impedance"]
"""Computed torque, or joint impedance."""
CONTROL_PERIOD = 1e-3
"""Of the controller (s): that of the arms' own interfaces."""
SUBSTEPS = 4
"""Steps of the simulation in one of the controller, so that what is seen is the controller's error
and not the integration's."""
BANDWIDTH = 40.0
"""Of computed torque: natural frequency of the error (rad/s): fast beside a hand's motion, slow
beside the controller's period."""
STIFFNESS, LEAST_STIFFNESS = 8.0, 50.0
"""Of joint impedance: N m/rad for each N m of torque limit, so that strong joints are stiff, and
the least."""
POSITION_NOISE, VELOCITY_NOISE = 2e-5, 2e-3
"""Standard deviations of a joint's measured position (rad) and velocity (rad/s), with noise: a step
of an 18-bit encoder, and its change over 10 ms."""
DISTANCES = 5
"""Instants from one measurement of distances to the next: bodies move little in 5 ms."""
LONGEST_DELAY = 0.02
"""Beyond this, no such controller is stable (s)."""
LOST = 0.5
"""Error of a joint at which the arm counts as out of control (rad): no lag, but an arm that runs
away."""


@dataclass(frozen=True, eq=False)
class Execution:
    """A tracked motion as the arm's dynamics executed it; arrays at the controller's instants.

    Attributes
    ----------
    tracked : TrackedMotion
        What was commanded.
    control : str
    executed : PoseTrajectory
        Of the tool, seen from the base.
    joint_positions, joint_velocities : array, shape (N, n)
    torques : array, shape (N - 1, n)
        After their limits (N m).
    distance : float
        Between the nearest pair of bodies (m), 0.05 at most.
    saturated : float
        Share of the instants at which a torque was at its limit.
    """

    tracked: TrackedMotion
    control: str
    executed: PoseTrajectory
    joint_positions: Floats
    joint_velocities: Floats
    torques: Floats
    distance: float
    saturated: float

    @property
    def errors(self) -> ToolErrors:
        """Of the executed tool against the commanded one: along, lateral, depth, angle."""
        return tool_errors(self.tracked.commanded, self.executed)

    @property
    def slip(self) -> Floats:
        """Residuals of the executed tool's equalities at each step, shape (N - 1, m)."""
        return slip(self.tracked.placement.undo(self.executed), self.tracked.system)

    @property
    def slip_distance(self) -> Floats:
        """Way that the executed tool slipped, shape (m,): see :func:`slip_distance`."""
        return slip_distance(self.tracked.placement.undo(self.executed), self.tracked.system)

    @property
    def torque_share(self) -> Floats:
        """Largest share of each joint's torque limit, shape (n,)."""
        return np.asarray(np.abs(self.torques).max(axis=0) / self.tracked.robot.torque_limits)


def execute(
    tracked: TrackedMotion,
    *,
    control: Control = "torque",
    noise: float = 0.0,
    delay: float = 0.0,
    model_error: float = 0.0,
    seed: int = 0,
) -> Execution:
    """Let the arm's dynamics follow a tracked motion under closed-loop control at 1 kHz.

    Parameters
    ----------
    tracked : TrackedMotion
        At the controller's rate: a time step of 1 ms.
    control : "torque" or "impedance"
        Computed torque, or joint impedance.
    noise : float
        Of the joints' sensors, as a multiple of 2e-5 rad and 2e-3 rad/s (standard deviations).
    delay : float
        Of the measurements (s), rounded to the controller's period; the controller knows it.
    model_error : float
        Share by which the simulated arm is heavier than the controller believes.
    seed : int
        Of the noise.

    Returns
    -------
    Execution

    Raises
    ------
    InputError
        If an argument is not what it must be.
    ConvergenceError
        If the arm gets out of control.
    """
    if control not in get_args(Control):
        raise InputError(f"control must be 'torque' or 'impedance', got {control!r}")
    noise = _arguments.not_negative("noise", noise)
    if _arguments.not_negative("delay", delay) > LONGEST_DELAY:
        raise InputError(
            f"delay must be {LONGEST_DELAY:g} s or less for a loop to be stable, got {delay:g}"
        )
    late = round(delay / CONTROL_PERIOD)
    if not -0.5 <= _arguments.finite("model_error", model_error) <= 1.0:
        raise InputError(f"model_error must lie between -0.5 and 1, got {model_error:g}")
    h = np.diff(tracked.times)
    if not np.allclose(h, CONTROL_PERIOD, rtol=1e-6, atol=0):
        raise InputError(
            f"the controller runs at 1 kHz: track the motion with time_step={CONTROL_PERIOD:g}, "
            f"not {np.median(h):.3g}"
        )
    random = np.random.default_rng(seed)
    with mujoco_warnings() as warned:
        loop = _Loop(tracked, control, late, model_error)
        measured: deque[tuple[Floats, Floats]] = deque(maxlen=late + 1)
        for k in range(len(h)):
            off, rate_off = noise * random.normal(size=(2, tracked.robot.size))
            seen = loop.data.qpos + POSITION_NOISE * off, loop.data.qvel + VELOCITY_NOISE * rate_off
            measured.append(seen)
            loop.step(k, *measured[0])
            if warned or loop.lost(k + 1):
                reason = f": {warned[0]}" if warned else ""
                raise ConvergenceError(
                    f"the arm got out of control at {tracked.times[k]:.3g} s{reason}; with less "
                    "delay or noise, or control='torque', it may not"
                )
    return loop.result()


class _Loop:
    """Controller and simulated arm."""

    def __init__(
        self, tracked: TrackedMotion, control: Control, late: int, model_error: float
    ) -> None:
        self.mujoco = required("mujoco")
        self.tracked, self.control, self.late = tracked, control, late
        robot = tracked.robot
        # The controller's model: bodies do not touch in it.
        self.nominal = copy.copy(robot.model)
        self.believed = self.mujoco.MjData(self.nominal)
        self.model = copy.copy(robot.model)
        self.model.opt.timestep = CONTROL_PERIOD / SUBSTEPS
        self.model.body_mass[:] *= 1 + model_error
        self.model.body_inertia[:] *= 1 + model_error
        self.data = self.mujoco.MjData(self.model)
        self.data.qpos[:], self.data.qvel[:] = tracked.joint_positions[0], 0.0
        self.mujoco.mj_forward(self.model, self.data)
        limits = robot.torque_limits
        finite = np.where(np.isfinite(limits), limits, 100.0)
        self.stiffness = np.maximum(STIFFNESS * finite, LEAST_STIFFNESS)
        self.mujoco.mj_crb(self.nominal, self.believed)
        count = len(tracked.times)
        self.positions = np.empty((count, robot.size))
        self.velocities = np.zeros_like(self.positions)
        self.torques = np.empty((count - 1, robot.size))
        self.positions[0] = self.data.qpos
        velocities = np.vstack([tracked.joint_velocities, tracked.joint_velocities[-1:]])
        self.accelerations = np.diff(velocities, axis=0) / CONTROL_PERIOD

    def torque(self, k: int, q: Floats, dq: Floats) -> Floats:
        """Torque that leads from instant k on, at a measured state, before its limits."""
        tracked, mujoco = self.tracked, self.mujoco
        # What was measured late is compared with what was wanted then.
        then = max(k - self.late, 0)
        wanted, rate = tracked.joint_positions[then], tracked.joint_velocities[then]
        data = self.believed
        data.qpos[:], data.qvel[:] = q, dq
        mujoco.mj_fwdPosition(self.nominal, data)
        mujoco.mj_fwdVelocity(self.nominal, data)
        bias = data.qfrc_bias - data.qfrc_passive
        inertia = np.zeros((len(q), len(q)))
        mujoco.mj_fullM(self.nominal, data, inertia)
        if self.control == "torque":
            pull = BANDWIDTH**2 * (wanted - q) + 2 * BANDWIDTH * (rate - dq)
            return np.asarray(inertia @ (self.accelerations[k] + pull) + bias)
        # Of the inertia that a joint feels with the others free: late damping of more is unstable.
        damping = 2 * np.sqrt(self.stiffness / np.diag(np.linalg.inv(inertia)))
        spring = self.stiffness * (wanted - q) + damping * (rate - dq)
        return np.asarray(inertia @ self.accelerations[k] + spring + bias)

    def step(self, k: int, q: Floats, dq: Floats) -> None:
        """Control and simulate from instant k to the next, with measured positions and rates."""
        limits = self.tracked.robot.torque_limits
        self.torques[k] = np.clip(self.torque(k, q, dq), -limits, limits)
        self.data.qfrc_applied[:] = self.torques[k]
        self.mujoco.mj_step(self.model, self.data, SUBSTEPS)
        self.positions[k + 1], self.velocities[k + 1] = self.data.qpos, self.data.qvel

    def lost(self, k: int) -> bool:
        """Whether the arm is out of control."""
        off = np.abs(self.positions[k] - self.tracked.joint_positions[k])
        return not off.max() <= LOST

    def result(self) -> Execution:
        tracked = self.tracked
        limits = tracked.robot.torque_limits
        # Pairs that are near, not touching: the simulation itself looks for contacts alone.
        near = InverseKinematics(tracked.robot)
        return Execution(
            tracked=tracked,
            control=self.control,
            executed=PoseTrajectory(
                tracked.times,
                *tracked.robot.forward(self.positions),
                name=f"{tracked.robot.name}, {self.control} control",
                channels=tracked.commanded.channels,
            ),
            joint_positions=self.positions,
            joint_velocities=self.velocities,
            torques=self.torques,
            distance=min(near.distance_at(q) for q in self.positions[::DISTANCES]),
            saturated=float(np.mean(np.any(np.abs(self.torques) >= limits, axis=1))),
        )


def summary(tracked: TrackedMotion, execution: Execution | None = None) -> dict[str, Any]:
    """Return the figures of a tracked motion, and of its execution, as plain data (SI units)."""
    least, whose = tracked.margins.smallest
    names = tracked.system.equalities.row_names
    found: dict[str, Any] = {
        "robot": tracked.robot.name,
        "duration": float(tracked.times[-1]),
        "steps": len(tracked.times) - 1,
        "placement": {
            "position": tracked.placement.position.tolist(),
            "quaternion": tracked.placement.rotation.as_quat(scalar_first=True).tolist(),
        },
        "start": tracked.joint_positions[0].tolist(),
        "margins": asdict(tracked.margins) | {"smallest": least, "smallest_of": whose},
        "unknown_limits": list(tracked.robot.unknown_limits),
        "seconds_per_step": tracked.seconds_per_step,
        "kinematic": _figures(tracked.errors, tracked.slip, names),
    }
    if execution is not None:
        found["dynamic"] = _figures(execution.errors, execution.slip, names) | {
            "control": execution.control,
            "slip_distance": execution.slip_distance.tolist(),
            "torque_share": execution.torque_share.tolist(),
            "saturated": execution.saturated,
            "distance": execution.distance,
        }
    return found


def _figures(errors: ToolErrors, residuals: Floats, names: list[str]) -> dict[str, Any]:
    peaks = np.abs(residuals).max(axis=0, initial=0.0)
    kinds = ("position", "along", "lateral", "depth", "rotation")
    found = {f"{kind}_error": float(np.abs(getattr(errors, kind)).max()) for kind in kinds}
    return found | {"slip": dict(zip(names, peaks.tolist(), strict=True))}
