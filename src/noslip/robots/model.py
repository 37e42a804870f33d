"""The arm: a MuJoCo model, its tool's frame, and the limits of its joints."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from ctypes.util import find_library
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._extras import need
from noslip._typing import Floats
from noslip.errors import InputError, did_you_mean

TABLE_SIZE = (1.2, 1.2, 0.02)
"""Half sizes of the table (m): wider than an arm of a meter reaches to one side."""
NEAR = 0.05
"""Distance up to which bodies are looked at (m): ten times what must be left, so that there is time
to brake."""
TABLE, TOOL_SITE = "table", "noslip tool"
"""Names in the model, by which they are found again."""
_WARNED = threading.Lock()
"""MuJoCo tells all warnings of the process in one place: one model is built at a time."""


def required(module: str) -> Any:
    """Import a library of the extra ``robots``."""
    if module == "mujoco" and module not in sys.modules:
        _choose_drawing()
    return need("arms", module, "robots")


def _choose_drawing() -> None:
    """Let MuJoCo draw without a window where there is no display.

    It chooses when it is first imported, and would choose windows.
    """
    if sys.platform != "linux" or {"MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ):
        return
    for library in ("EGL", "OSMesa"):
        if find_library(library):
            os.environ["MUJOCO_GL"] = library.lower()
            return


@contextmanager
def mujoco_warnings() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings, which it would write to a log in the current folder."""
    mujoco = required("mujoco")
    found: list[str] = []
    with _WARNED:
        before = mujoco.get_mju_user_warning()
        mujoco.set_mju_user_warning(found.append)
        try:
            yield found
        finally:
            mujoco.set_mju_user_warning(before)


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm with a tool: joints in a chain from the base, and a frame at the tool's end.

    The base's frame is the model's world.  Arrays have one number a joint, from the base on.

    Attributes
    ----------
    name : str
    model : mujoco.MjModel
        Of the chain's joints alone; all others stand still.
    near : mujoco.MjModel
        The same, for kinematics: its collisions include pairs of bodies that are near.
    site : int
        Of the tool's frame: x along the edge's travel, y lateral, z out of the work.
    joint_names : tuple of str
    lower, upper : array, shape (n,)
        Positions (rad; m for a slide); infinite where the model gives none.
    velocity_limits, acceleration_limits, torque_limits : array, shape (n,)
        Infinite where unknown (rad/s, rad/s^2, N m).
    home : array, shape (n,)
        A posture to start searches from: the model's first keyframe, or the middle of the ranges.
    """

    name: str
    model: Any
    near: Any
    site: int
    joint_names: tuple[str, ...]
    lower: Floats
    upper: Floats
    velocity_limits: Floats
    acceleration_limits: Floats
    torque_limits: Floats
    home: Floats

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, {self.size} joints: {', '.join(self.joint_names)})"

    @property
    def size(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def unknown_limits(self) -> tuple[str, ...]:
        """Kinds of limits that the model does not give, and nobody therefore keeps."""
        kinds = {
            "position": self.upper - self.lower,
            "velocity": self.velocity_limits,
            "acceleration": self.acceleration_limits,
            "torque": self.torque_limits,
        }
        return tuple(kind for kind, limits in kinds.items() if not np.all(np.isfinite(limits)))

    def room(self, joint_positions: Floats) -> Floats:
        """What is left of the joints' ranges: 1 in the middle, 0 at an end; 1 without a range."""
        with np.errstate(invalid="ignore"):
            half = (self.upper - self.lower) / 2
            room = np.minimum(joint_positions - self.lower, self.upper - joint_positions) / half
        return np.asarray(np.where(np.isfinite(half), room, 1.0))

    def with_limits(
        self,
        *,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        torque: ArrayLike | None = None,
    ) -> Robot:
        """Return the arm with other limits: a number for all joints, or one each."""
        given = {
            "velocity_limits": velocity,
            "acceleration_limits": acceleration,
            "torque_limits": torque,
        }
        changed: dict[str, Any] = {
            field: _limits(f"{self.name}: {field}", value, self.size)
            for field, value in given.items()
            if value is not None
        }
        return replace(self, **changed)

    def forward(self, joint_positions: ArrayLike) -> tuple[Floats, Rotation]:
        """Forward kinematics of the tool's frame, seen from the base.

        Parameters
        ----------
        joint_positions : array, shape (n,) or (N, n)

        Returns
        -------
        positions : array, shape (3,) or (N, 3)
            Meters.
        rotations : Rotation
            Tool to base; one, or N.

        Raises
        ------
        InputError
            If the number of joints is another one, or a number is not finite.
        """
        mujoco = required("mujoco")
        q = np.asarray(joint_positions, dtype=np.float64)
        if q.shape[-1:] != (self.size,) or q.ndim > 2 or not np.all(np.isfinite(q)):
            raise InputError(
                f"{self.name}: joint positions must be {self.size} finite numbers a row, "
                f"got shape {q.shape}"
            )
        data = mujoco.MjData(self.model)
        several = np.atleast_2d(q)
        positions, matrices = np.empty((len(several), 3)), np.empty((len(several), 3, 3))
        for k, row in enumerate(several):
            data.qpos[:] = row
            mujoco.mj_kinematics(self.model, data)
            positions[k] = data.site_xpos[self.site]
            matrices[k] = data.site_xmat[self.site].reshape(3, 3)
        rotations = Rotation.from_matrix(matrices)
        return (positions, rotations) if q.ndim == 2 else (positions[0], rotations[0])


def panda(*, table: float | None = 0.0) -> Robot:
    """Return a 7-joint arm with a scalpel: Franka's published kinematics and limits.

    Kinematics, ranges, rates, accelerations and torques are those that the manufacturer publishes;
    shapes are capsules of this library's own, and masses approximate.

    Parameters
    ----------
    table : float, optional
        Height of a table's top (m); the base stands at 0, through it if it is higher.  ``None``
        for none.

    Raises
    ------
    MissingDependencyError
        Without MuJoCo.
    """
    text = files("noslip.robots").joinpath("panda.xml").read_text(encoding="utf-8")
    spec = required("mujoco").MjSpec.from_string(text)
    return _robot("panda", spec, "tool", table)


def load(
    path: str | Path,
    *,
    tool: str,
    table: float | None = None,
    velocity_limits: ArrayLike | None = None,
    acceleration_limits: ArrayLike | None = None,
    torque_limits: ArrayLike | None = None,
) -> Robot:
    """Read an arm from MJCF or URDF.

    Rates and accelerations are no part of MJCF: they are read from ``<custom>`` numerics named
    ``velocity_limits`` and ``acceleration_limits``, of a number a joint, or given here.  Torques
    are the joints' ``actuatorfrcrange``; a URDF's effort becomes that.

    Parameters
    ----------
    path : path
    tool : str
        Site or body that is the tool's frame: x along the edge's travel, y lateral, z out.
    table : float, optional
        Height of a table's top, seen from the model's world (m).
    velocity_limits, acceleration_limits, torque_limits : array, shape (n,), optional
        In place of the model's own; a number is for all joints.

    Raises
    ------
    InputError
        If the file cannot be read, has no such frame (the message names those it has), or the way
        to it is not one of hinges and slides.
    MissingDependencyError
        Without MuJoCo.
    """
    mujoco = required("mujoco")
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; give a robot's MJCF or URDF")
    try:
        with mujoco_warnings():
            spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{path}: not understood as MJCF or URDF: {_one_line(error)}") from error
    robot = _robot(path.name, spec, tool, table)
    return robot.with_limits(
        velocity=velocity_limits, acceleration=acceleration_limits, torque=torque_limits
    )


def named(name: str, *, model: str | Path | None = None, tool: str | None = None) -> Robot:
    """Return the arm that a name, or a model's file and the tool's frame in it, stand for."""
    if model is not None:
        if tool is None:
            raise InputError(f"{model}: name the tool's site or body too")
        return load(model, tool=tool)
    if name != "panda":
        near = did_you_mean(name, ["panda"])
        raise InputError(
            f"robot {name!r} is not known{near}; there is panda, or give a model's file"
        )
    return panda()


def _robot(name: str, spec: Any, tool: str, table: float | None) -> Robot:
    """Compile the chain of joints that leads to the tool."""
    mujoco = required("mujoco")
    body = _tool_body(name, spec, tool)
    chain: list[Any] = []
    while body is not None and body.name != "world":
        chain = [*body.joints, *chain]
        body = body.parent
    if not chain:
        raise InputError(f"{name}: no joint moves {tool!r}")
    kinds = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    for joint in chain:
        if joint.type not in kinds:
            raise InputError(
                f"{name}: joint {joint.name!r} on the way to {tool!r} is neither a hinge nor a "
                "slide; an arm stands on a fixed base"
            )
    home = _keyframe(spec, chain)
    # What does not lead to the tool stands still; torques are applied to joints directly.
    kept = {joint.name for joint in chain}
    unwanted = [spec.keys, spec.actuators, spec.sensors, spec.tendons, spec.equalities]
    for element in [e for several in unwanted for e in several]:
        spec.delete(element)
    for joint in [j for j in spec.joints if j.name not in kept]:
        spec.delete(joint)
    if table is not None:
        # The base may stand through it, and so may the link that turns on the base.
        spec.add_exclude(bodyname1=TABLE, bodyname2=chain[0].parent.name)
        spec.worldbody.add_body(name=TABLE).add_geom(
            name=TABLE,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=TABLE_SIZE,
            pos=[0, 0, _arguments.finite("table", table) - TABLE_SIZE[2]],
            rgba=[0.55, 0.6, 0.62, 1],
            mass=0,
        )
    try:
        with mujoco_warnings():
            model = spec.compile()
            for geom in spec.geoms:
                geom.margin = NEAR
            near = spec.compile()
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{name}: cannot be compiled: {_one_line(error)}") from error
    limited = model.jnt_limited.astype(bool)
    strong = model.jnt_actfrclimited.astype(bool)
    lower = np.where(limited, model.jnt_range[:, 0], -np.inf)
    upper = np.where(limited, model.jnt_range[:, 1], np.inf)
    middle = np.where(limited, model.jnt_range.mean(axis=1), 0.0)
    size = model.nv
    return Robot(
        name=name,
        model=model,
        near=near,
        site=mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, TOOL_SITE),
        joint_names=tuple(model.joint(k).name for k in range(size)),
        lower=lower,
        upper=upper,
        velocity_limits=_numeric(name, model, "velocity_limits"),
        acceleration_limits=_numeric(name, model, "acceleration_limits"),
        torque_limits=np.where(strong, model.jnt_actfrcrange[:, 1], np.inf),
        home=np.clip(middle if home is None else home, lower, upper),
    )


def _tool_body(name: str, spec: Any, tool: str) -> Any:
    """Body that carries the tool's frame; a site of our own marks the frame there."""
    sites = {site.name: site for site in spec.sites if site.name}
    bodies = {body.name: body for body in spec.bodies if body.name and body.name != "world"}
    if tool in sites:
        site = sites[tool]
        site.parent.add_site(name=TOOL_SITE, pos=site.pos, quat=site.quat, group=4)
        return site.parent
    if tool in bodies:
        bodies[tool].add_site(name=TOOL_SITE, group=4)
        return bodies[tool]
    raise InputError(
        f"{name}: no site or body is called {tool!r}{did_you_mean(tool, [*sites, *bodies])}; "
        f"sites: {', '.join(sites) or 'none'}; bodies: {', '.join(bodies) or 'none'}"
    )


def _keyframe(spec: Any, chain: Sequence[Any]) -> Floats | None:
    """Positions of the chain's joints in the first keyframe, where all joints are scalar."""
    scalar = (required("mujoco").mjtJoint.mjJNT_HINGE, required("mujoco").mjtJoint.mjJNT_SLIDE)
    joints = list(spec.joints)
    if not spec.keys or any(joint.type not in scalar for joint in joints):
        return None
    qpos = np.array(spec.keys[0].qpos, dtype=np.float64)
    if len(qpos) != len(joints):
        return None
    places = {joint.name: k for k, joint in enumerate(joints)}
    return np.array([qpos[places[joint.name]] for joint in chain])


def _numeric(name: str, model: Any, field: str) -> Floats:
    try:
        given = model.numeric(field).data
    except KeyError:
        return np.full(model.nv, np.inf)
    return _limits(f"{name}: {field}", given, model.nv)


def _limits(name: str, value: ArrayLike, size: int) -> Floats:
    try:
        limits = np.asarray(value, dtype=np.float64)
        limits = np.array(np.broadcast_to(limits, (size,)))
    except (TypeError, ValueError):
        raise InputError(f"{name} must be {size} numbers, one a joint, got {value!r}") from None
    if not np.all(limits > 0):
        raise InputError(f"{name} must be positive, got {limits.tolist()}")
    return limits


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
