"""A step of LeRobot's processor pipelines that keeps constraints (lerobot 0.4 and later).

It stands between what makes poses of the end effector (a policy, a teleoperator,
``EEReferenceAndDelta``) and the inverse kinematics, where ``EEBoundsAndSafety`` clips::

    RobotProcessorPipeline[tuple[RobotAction, RobotObservation], RobotAction](
        steps=[ShieldActionStep(["blade(lateral='y')"], rate=30), InverseKinematicsEEToJoints(...)],
        to_transition=robot_action_observation_to_transition,
        to_output=transition_to_robot_action,
    )

Of a policy that gives whole chunks, :class:`noslip.shielding.ActionShield` sees what is to come.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._extras import need
from noslip._turns import Turn
from noslip._typing import Floats
from noslip.constraints.catalog import parse_constraint, restore, specification
from noslip.constraints.declaration import Constraint
from noslip.errors import InputError
from noslip.projection.metric import Metric
from noslip.shielding.shield import Shield

need("noslip.shielding.lerobot", "lerobot.processor", "lerobot")

from lerobot.processor import (  # noqa: E402 - need says what is missing
    ProcessorStepRegistry,
    RobotActionProcessorStep,
    TransitionKey,
)

KEYS = ("ee.x", "ee.y", "ee.z", "ee.wx", "ee.wy", "ee.wz")
"""Position (m) and rotation vector of the end effector, as LeRobot's steps name them."""
_ROTVEC = Turn("rotvec", degrees=False)


@ProcessorStepRegistry.register("noslip_shield")
@dataclass
class ShieldActionStep(RobotActionProcessorStep):  # type: ignore[misc]
    """Turns each pose of the end effector into one that keeps the constraints.

    ``ee.gripper_pos`` and all else of the action pass through.

    Parameters
    ----------
    constraints, limits : sequence of str, Constraint or dict
        What holds, as on the command line (``"blade(lateral='y')"``), as objects, or as
        ``get_config`` gives them.
    rate : float
        Actions a second (Hz).
    metric : "auto", "position", "shared" or 6 positive weights
        Of :class:`noslip.Shield`.
    measured : bool
        Whether the observation has the same keys, measured: the shield then waits for a tool that
        is held up.

    Raises
    ------
    InputError
        If an action lacks a key, or holds a number that is not finite.
    """

    constraints: Sequence[str | Constraint | dict[str, Any]]
    rate: float
    metric: Metric = "auto"
    limits: Sequence[str | Constraint | dict[str, Any]] = ()
    measured: bool = False

    def __post_init__(self) -> None:
        self.constraints, self.limits = (
            [_constraint(each) for each in given] for given in (self.constraints, self.limits)
        )
        self.shield = Shield(
            self.constraints, rate=self.rate, metric=self.metric, limits=self.limits
        )

    def action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Return an action with another pose."""
        wanted, here = _pose("action", action), None
        if self.measured:
            observed = self.transition.get(TransitionKey.OBSERVATION) or {}
            here = _placed(_pose("observation", observed))
        state = self.shield.step(_placed(wanted), here)
        quaternion = state.rotation.as_quat(scalar_first=True)
        turn = _ROTVEC.numbers(quaternion[None], wanted[None, 3:])[0]
        return action | dict(zip(KEYS, map(float, (*state.position, *turn)), strict=True))

    def reset(self) -> None:
        """Begin an episode: from wherever its first action is."""
        self.shield.reset()

    def get_config(self) -> dict[str, Any]:
        """Return what makes the same step again, as plain data."""
        constraints, limits = (
            [specification(each) for each in given]  # type: ignore[arg-type]
            for given in (self.constraints, self.limits)
        )
        metric = self.metric if isinstance(self.metric, str) else list(map(float, self.metric))
        return {
            "constraints": constraints,
            "rate": self.rate,
            "metric": metric,
            "limits": limits,
            "measured": self.measured,
        }

    def transform_features(self, features: Any) -> Any:
        """Return the features as they are: the keys stay."""
        return features


def _constraint(given: str | Constraint | dict[str, Any]) -> Constraint:
    if isinstance(given, str):
        return parse_constraint(given)
    return restore(given) if isinstance(given, dict) else given


def _pose(where: str, of: dict[str, Any]) -> Floats:
    missing = [key for key in KEYS if of.get(key) is None]
    if missing:
        raise InputError(
            f"{where}: no {', '.join(missing)}; put the shield after the step that makes poses of "
            "the end effector, and before the inverse kinematics"
        )
    return np.array([_arguments.finite(f"{where}: {key}", of[key]) for key in KEYS])


def _placed(pose: Floats) -> tuple[Floats, Rotation]:
    return pose[:3], Rotation.from_rotvec(pose[3:])
