"""Chains of joints from models of robots: what a primitive must know of an arm, and no more."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from noslip.chain import Chain, Joint, Offset
from noslip.errors import InputError
from noslip.robots.model import Robot, named, required


def chain(
    robot: Robot | str | Path = "panda",
    *,
    tool: str | None = None,
    joints: Iterable[str] | None = None,
    held: Mapping[str, float] | None = None,
) -> Chain:
    """Return the chain of joints from a robot's base to its tool.

    Parameters
    ----------
    robot : Robot, str or path
        A robot, one by its name, or an MJCF or URDF file.
    tool : str, optional
        Of a file: the site or body that is the tool's frame.
    joints : names, optional
        Those that move, in the chain's order whatever the order here; by default all that lead to
        the tool.  All others stand still.
    held : dict, optional
        Positions of joints that stand still (rad, m); by default those of the robot's home.

    Returns
    -------
    Chain
        With the model's bounds of positions, and its velocities and accelerations where it gives
        any.

    Raises
    ------
    InputError
        If the file cannot be read, has no such frame or joint, or no joint is left.
    MissingDependencyError
        Without MuJoCo.
    """
    if not isinstance(robot, Robot):
        is_file = isinstance(robot, Path) or bool(Path(robot).suffix)
        robot = named("" if is_file else str(robot), model=robot if is_file else None, tool=tool)
    whole = _whole(robot)
    still = dict(held or {})
    if joints is not None:
        moving = set(joints)
        unknown = moving - set(whole.joint_names)
        if unknown or moving & set(still):
            odd = sorted(unknown or moving & set(still))[0]
            why = "does not lead to the tool" if unknown else "cannot both move and be held"
            raise InputError(
                f"{robot.name}: joint {odd!r} {why}; there are {', '.join(whole.joint_names)}"
            )
        home = dict(zip(whole.joint_names, robot.home.tolist(), strict=True))
        still = {name: still.get(name, home[name]) for name in home if name not in moving}
    return whole.held(still) if still else whole


def _whole(robot: Robot) -> Chain:
    """All joints that lead to the tool; MuJoCo's own order of operations (``mj_kinematics``)."""
    model, hinge = robot.model, required("mujoco").mjtJoint.mjJNT_HINGE
    bodies = []
    body = int(model.site_bodyid[robot.site])
    while body:
        bodies.append(body)
        body = int(model.body_parentid[body])
    joints, at = [], Offset()
    for body in reversed(bodies):
        at = at.then(model.body_pos[body], model.body_quat[body])
        first = int(model.body_jntadr[body])
        for k in range(first, first + int(model.body_jntnum[body])):
            anchor = model.jnt_pos[k]
            at = at.then(anchor)
            joints.append(
                Joint(
                    robot.joint_names[k] or f"joint{k + 1}",
                    "hinge" if model.jnt_type[k] == hinge else "slide",
                    model.jnt_axis[k],
                    at.position,
                    at.quaternion,
                    float(model.qpos0[k]),
                    float(robot.lower[k]),
                    float(robot.upper[k]),
                    float(robot.velocity_limits[k]),
                    float(robot.acceleration_limits[k]),
                )
            )
            at = Offset().then(-anchor)
    at = at.then(model.site_pos[robot.site], model.site_quat[robot.site])
    return Chain(tuple(joints), at.position, at.quaternion, robot.name)
