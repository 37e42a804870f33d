"""An arm that executed a motion: its shapes as triangles, and where they are at each sample.

All of it lies in the motion's own world, in which its constraints are written: the arm's base is
put there by the inverse of the placement.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from noslip import robots
from noslip._pose_checks import Source
from noslip._typing import Floats
from noslip.constraints.declaration import Constraint
from noslip.errors import InputError
from noslip.named_columns import NamedColumns, listed
from noslip.robots.executed import joint_columns
from noslip.robots.folder import SUMMARY, read_folder
from noslip.robots.model import required
from noslip.trajectory import PoseTrajectory
from noslip.viewer.tool import Part, add_mesh

if TYPE_CHECKING:
    import viser

DRAWN_GROUPS = 3
"""MuJoCo's viewer shows groups 0 to 2; collision shapes are in later ones by custom."""
DEFAULT_COLOR = (0.5, 0.5, 0.5, 1.0)
"""MuJoCo's gray of a geom that was given none; it then has its material's."""


class Arm:
    """An arm's shapes along its joints' motion; a :class:`~noslip.viewer.drawing.Follower`.

    Parameters
    ----------
    robot : Robot
    joint_positions : array, shape (N, n)
        At the samples of the motion that it follows.
    placement : Placement
        Where the motion's world lies, seen from the base.

    Attributes
    ----------
    parts : list of Part
        One a geom of the model, in the geom's own frame; hidden geoms and height fields are left
        out.
    moving : array of bool, shape (G,)
        Which of them joints move.
    position : array, shape (3,)
        Of the base in the motion's world (m).
    rotation : Rotation
        Base to the motion's world.
    """

    def __init__(
        self, robot: robots.Robot, joint_positions: ArrayLike, placement: robots.Placement
    ) -> None:
        self.joint_positions = np.atleast_2d(np.asarray(joint_positions, dtype=np.float64))
        # Refuses what no joints of this arm can be.
        robot.forward(self.joint_positions)
        self.robot = robot
        self.rotation = placement.rotation.inv()
        self.position: Floats = -self.rotation.apply(placement.position)
        self._mujoco = required("mujoco")
        self._data = self._mujoco.MjData(robot.model)
        self._geoms, self.parts = self._drawn()
        bodies = robot.model.geom_bodyid[self._geoms]
        self.moving = np.asarray(robot.model.body_weldid[bodies] != 0)
        self._nodes: list[Any] = []

    def poses(self, sample: int) -> tuple[Floats, Floats]:
        """Where the parts are at a sample, seen from the base, by forward kinematics.

        Returns
        -------
        positions : array, shape (G, 3)
            Meters.
        quaternions : array, shape (G, 4)
            Unit, scalar first.
        """
        self._data.qpos[:] = self.joint_positions[sample]
        self._mujoco.mj_kinematics(self.robot.model, self._data)
        matrices = self._data.geom_xmat[self._geoms].reshape(-1, 3, 3)
        quaternions = Rotation.from_matrix(matrices).as_quat(scalar_first=True)
        return self._data.geom_xpos[self._geoms].copy(), quaternions

    @property
    def points(self) -> Floats:
        """The base, and the middles of what moves at the beginning and at the end, world frame."""
        middles = [self.poses(sample)[0][self.moving] for sample in (0, -1)]
        return np.asarray(self.rotation.apply(np.vstack([np.zeros(3), *middles])) + self.position)

    # ---------------------------------------------------------------- on the page

    def add(self, scene: viser.SceneApi, node: str) -> None:
        """Draw it once, its base where the placement puts it."""
        base = self.rotation.as_quat(scalar_first=True)
        scene.add_frame(node, show_axes=False, position=self.position, wxyz=base)
        positions, quaternions = self.poses(0)
        placed = zip(self.parts, positions, quaternions, strict=True)
        self._nodes = [
            add_mesh(scene, f"{node}/{k}", part, part.color, position=position, wxyz=turn)
            for k, (part, position, turn) in enumerate(placed)
        ]

    def show(self, motion: PoseTrajectory, sample: int) -> None:
        """Move it to a sample."""
        positions, quaternions = self.poses(sample)
        for number in np.flatnonzero(self.moving):
            node = self._nodes[number]
            node.position, node.wxyz = positions[number], quaternions[number]

    # ---------------------------------------------------------------- shapes

    def _drawn(self) -> tuple[NDArray[np.intp], list[Part]]:
        model = self.robot.model
        shown = model.geom_group < DRAWN_GROUPS
        # A model whose shapes are all for collisions shows those.
        chosen = np.flatnonzero(shown if shown.any() else ~shown)
        geoms, parts = [], []
        for geom in chosen.tolist():
            color, material = model.geom_rgba[geom], model.geom_matid[geom]
            if material >= 0 and np.allclose(color, DEFAULT_COLOR):
                color = model.mat_rgba[material]
            mesh = self._mesh(geom) if color[3] > 0 else None
            if mesh is not None:
                red, green, blue = (round(255 * float(share)) for share in color[:3])
                geoms.append(geom)
                parts.append(Part(*mesh, (red, green, blue)))
        return np.array(geoms, dtype=np.intp), parts

    def _mesh(self, geom: int) -> tuple[Floats, NDArray[np.int64]] | None:
        """Triangles of a geom in its own frame; None of a kind that is not drawn."""
        model, kinds = self.robot.model, self._mujoco.mjtGeom
        size, kind = model.geom_size[geom], kinds(int(model.geom_type[geom]))
        if kind == kinds.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            vertices = model.mesh_vert[first : first + count].astype(np.float64)
            first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
            return vertices, model.mesh_face[first : first + count].astype(np.int64)
        if kind == kinds.mjGEOM_PLANE:
            x, y = (half if half > 0 else 1.0 for half in size[:2])
            corners = [[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]]
            return np.array(corners), np.array([[0, 1, 2], [0, 2, 3]])
        if kind == kinds.mjGEOM_CAPSULE:
            made = trimesh.creation.capsule(height=2 * size[1], radius=size[0], count=(24, 24))
            # It is made along z, from its first hemisphere on.
            made.apply_translation([0.0, 0.0, -made.bounds[:, 2].mean()])
        elif kind == kinds.mjGEOM_CYLINDER:
            made = trimesh.creation.cylinder(radius=size[0], height=2 * size[1])
        elif kind == kinds.mjGEOM_BOX:
            made = trimesh.creation.box(extents=2 * size)
        elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
            made = trimesh.creation.icosphere(subdivisions=3)
            made.apply_scale(size if kind == kinds.mjGEOM_ELLIPSOID else size[0])
        else:
            return None
        return np.array(made.vertices, dtype=np.float64), np.array(made.faces, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Simulation:
    """A motion that an arm executed, in the motion's own world.

    Attributes
    ----------
    executed, commanded : PoseTrajectory
        Of the tool; and where the commanded joints lead it.
    constraints : tuple of Constraint
        Of the primitive.
    arm : Arm
        As it executed it.
    """

    executed: PoseTrajectory
    commanded: PoseTrajectory
    constraints: tuple[Constraint, ...]
    arm: Arm


def read_simulation(folder: str | Path) -> Simulation:
    """Read a folder that ``noslip simulate`` wrote.

    Raises
    ------
    InputError
        If a file or a field is missing or damaged, or the arm's model is no longer where it was.
    MissingDependencyError
        Without MuJoCo.
    """
    folder = Path(folder)
    written = read_folder(folder)
    model = written.summary["model"]
    if model is not None and not Path(model).is_file():
        raise InputError(f"{folder / SUMMARY}: field model: {model} is not there; simulate again")
    robot = robots.named(written.summary["robot"], model=model, tool=written.summary["tool"])

    times, commanded = _joints(folder / "joints.csv", robot)
    joints = commanded
    if "dynamic" in written.summary:
        _, joints = _joints(folder / "executed.csv", robot)
    executed = written.executed
    if not len(executed) == len(joints) == len(commanded):
        raise InputError(
            f"{folder}: {len(executed)} poses of the tool, {len(commanded)} of the commanded and "
            f"{len(joints)} of the executed joints; simulate again"
        )
    wanted = written.placement.undo(PoseTrajectory(times, *robot.forward(commanded)))
    arm = Arm(robot, joints, written.placement)
    return Simulation(executed, wanted, written.constraints, arm)


def _joints(file: Path, robot: robots.Robot) -> tuple[Floats, Floats]:
    """Times, shape (N,), and joint positions, shape (N, n), of ``t,q1..,dq1..``."""
    table = NamedColumns.open(file, plain=True)
    names = joint_columns(robot)
    if table.names != names:
        raise InputError(
            f"{file}: expected the columns {', '.join(names)} of {robot.name}, found "
            f"{listed(table.names)}; simulate again"
        )
    lines, of, _ = table.read(names)
    Source(file, "", "", lines).check_finite({f"column {name}": of[name] for name in names})
    if len(lines) < 2:
        raise InputError(f"{file}: {len(lines)} rows, at least 2 are needed; simulate again")
    return of["t"], np.column_stack([of[name] for name in names[1 : 1 + robot.size]])
