"""A video of the arm, drawn without a window."""

from __future__ import annotations

import copy
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from noslip._files import write_beside
from noslip._typing import Floats
from noslip.errors import InputError, MissingDependencyError
from noslip.robots.model import Robot, mujoco_warnings, required

FRAMES_PER_SECOND = 30
"""What every player plays."""
SIZE = (480, 640)
"""Height and width (pixels): the buffer that every MuJoCo model has."""


def render(
    robot: Robot, times: Floats, joint_positions: Floats, path: str | Path, *, seconds: float = 60.0
) -> Path:
    """Write a video (MP4) of joints' positions over time, with the tool's path as beads.

    Parameters
    ----------
    robot : Robot
    times : array, shape (N,)
    joint_positions : array, shape (N, n)
    path : path
        Ends in ``.mp4``.
    seconds : float
        Longest video.

    Raises
    ------
    InputError
        If the file's name does not end in .mp4.
    MissingDependencyError
        Without imageio (extra ``video``), or where OpenGL cannot draw without a window.
    """
    path = Path(path)
    if path.suffix != ".mp4":
        raise InputError(f"{path}: a video ends in .mp4")
    try:
        writer = required("imageio.v2")
        required("imageio_ffmpeg")
    except MissingDependencyError as error:
        raise MissingDependencyError("videos need imageio: pip install 'noslip[video]'") from error
    instants = np.arange(times[0], min(times[-1], times[0] + seconds), 1 / FRAMES_PER_SECOND)
    shown = joint_positions[np.searchsorted(times, instants)]
    beads, _ = robot.forward(joint_positions[:: max(1, len(times) // 120)])
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / path.name
        with (
            _Stage(robot) as stage,
            writer.get_writer(
                file, fps=FRAMES_PER_SECOND, codec="libx264", macro_block_size=16
            ) as film,
        ):
            for q in shown:
                film.append_data(stage.frame(q, beads))
        return write_beside(path, file.read_bytes())


class _Stage:
    """MuJoCo's renderer, with the tool's path."""

    def __init__(self, robot: Robot) -> None:
        self.mujoco = required("mujoco")
        # Drawn by the processor, shadows and smooth edges take most of the time.
        self.model = copy.copy(robot.model)
        self.model.vis.quality.offsamples, self.model.vis.quality.shadowsize = 1, 1024
        self.data = self.mujoco.MjData(self.model)
        self.camera = self.mujoco.MjvCamera()
        self.camera.lookat[:] = [0.2, 0.0, 0.35]
        self.camera.distance, self.camera.azimuth, self.camera.elevation = 1.9, 130, -22

    def __enter__(self) -> _Stage:
        self._warned = mujoco_warnings()
        self._warned.__enter__()
        try:
            self.renderer: Any = self.mujoco.Renderer(self.model, *SIZE)
        except Exception as error:
            self._warned.__exit__(None, None, None)
            raise MissingDependencyError(
                "no OpenGL without a window here: set MUJOCO_GL=egl or MUJOCO_GL=osmesa before "
                f"starting, and install that library ({' '.join(str(error).split())[:120]})"
            ) from error
        return self

    def __exit__(self, *what: object) -> None:
        self.renderer.close()
        self._warned.__exit__(None, None, None)

    def frame(self, q: Floats, beads: Floats) -> Any:
        """Picture of a posture."""
        self.data.qpos[:] = q
        self.mujoco.mj_forward(self.model, self.data)
        self.renderer.update_scene(self.data, self.camera)
        scene = self.renderer.scene
        for bead in beads[: scene.maxgeom - scene.ngeom]:
            self.mujoco.mjv_initGeom(
                scene.geoms[scene.ngeom],
                self.mujoco.mjtGeom.mjGEOM_SPHERE,
                np.full(3, 0.003),
                bead,
                np.eye(3).ravel(),
                np.array([0.84, 0.37, 0.0, 1.0], dtype=np.float32),
            )
            scene.ngeom += 1
        return self.renderer.render()
