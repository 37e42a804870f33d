"""A video of the arm, drawn without a window."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from noslip._extras import need
from noslip._files import scratch, write_beside
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
    writer = need("videos", "imageio.v2", "video")
    need("videos", "imageio_ffmpeg", "video")
    instants = np.arange(times[0], min(times[-1], times[0] + seconds), 1 / FRAMES_PER_SECOND)
    shown = joint_positions[np.searchsorted(times, instants)]
    beads, _ = robot.forward(joint_positions[:: max(1, len(times) // 120)])
    with scratch() as folder:
        file = folder / path.name
        with (
            _stage(robot, beads) as draw,
            writer.get_writer(
                file, fps=FRAMES_PER_SECOND, codec="libx264", macro_block_size=16
            ) as film,
        ):
            for q in shown:
                film.append_data(draw(q))
        return write_beside(path, file.read_bytes())


@contextmanager
def _stage(robot: Robot, beads: Floats) -> Iterator[Callable[[Floats], Any]]:
    """Yield what draws a posture, with the tool's path as beads, in MuJoCo's renderer."""
    mujoco = required("mujoco")
    # Drawn by the processor, shadows and smooth edges take most of the time.
    model = copy.copy(robot.model)
    model.vis.quality.offsamples, model.vis.quality.shadowsize = 1, 1024
    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    camera.lookat[:] = [0.2, 0.0, 0.35]
    camera.distance, camera.azimuth, camera.elevation = 1.9, 130, -22
    bead = mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, 0.003)
    look = np.eye(3).ravel(), np.array([0.84, 0.37, 0.0, 1.0], dtype=np.float32)

    def frame(q: Floats) -> Any:
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        renderer.update_scene(data, camera)
        scene = renderer.scene
        for place in beads[: scene.maxgeom - scene.ngeom]:
            mujoco.mjv_initGeom(scene.geoms[scene.ngeom], *bead, place, *look)
            scene.ngeom += 1
        return renderer.render()

    with mujoco_warnings():
        try:
            renderer = mujoco.Renderer(model, *SIZE)
        except Exception as error:
            raise MissingDependencyError(
                "no OpenGL without a window here: set MUJOCO_GL=egl or MUJOCO_GL=osmesa before "
                f"starting, and install that library ({' '.join(str(error).split())[:120]})"
            ) from error
        try:
            yield frame
        finally:
            renderer.close()
