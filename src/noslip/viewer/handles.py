"""What poses are dragged by: gizmos with a name, beside what they move where it would hide them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import viser
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.figures.style import PALETTE
from noslip.viewer.actions import Actions
from noslip.viewer.colors import rgb
from noslip.viewer.drawing import place, pose

GIZMO = 0.15
"""Length of a handle's arrows, over the scene's size: large enough to be hit."""
TURNING = 1.75
"""Size of what turns, over that of what moves: viser draws arcs at 0.65 of it, beyond the arrows'
tips, which they would cover."""
ASIDE = 0.22
"""Distance of a handle from what it moves, over the scene's size: its arrows and arcs, along any
axis, end before the tool."""


class Handle:
    """A gizmo that moves, one around it that turns, their name, and a line to what they move.

    Parameters
    ----------
    scene : viser.SceneApi
    node : str
        In the scene.
    label : str
        What is told of it.
    size : float
        Of the scene (m).
    turns : bool
        Whether it turns the pose too.
    """

    def __init__(
        self, scene: viser.SceneApi, node: str, label: str, size: float, *, turns: bool = True
    ) -> None:
        look: dict[str, Any] = {"line_width": 3.0, "depth_test": False, "visible": False}
        self.gizmo: Any = scene.add_transform_controls(
            f"/{node}", scale=GIZMO * size, disable_rotations=True, **look
        )
        self._turning: Any = None
        if turns:
            self._turning = scene.add_transform_controls(
                f"/{node} turning",
                scale=TURNING * GIZMO * size,
                disable_axes=True,
                disable_sliders=True,
                **look,
            )
        scene.add_label(f"/{node}/label", label, font_screen_scale=0.9, anchor="top-center")
        self._line: Any = scene.add_line_segments(
            f"/{node} line",
            np.zeros((1, 2, 3), dtype=np.float32),
            rgb(PALETTE["gray"]),
            thickness=1.5,
            thickness_units="screen",
            visible=False,
        )
        self.aside: Floats = np.zeros(3)

    @property
    def visible(self) -> bool:
        """Whether it can be dragged."""
        return bool(self.gizmo.visible)

    @visible.setter
    def visible(self, value: bool) -> None:
        self.gizmo.visible = value
        if self._turning is not None:
            self._turning.visible = value
        self._line.visible = value and bool(self.aside.any())

    @property
    def position(self) -> Floats:
        """Of the pose (m), shape (3,)."""
        return np.array(self.gizmo.position) - self.aside

    @position.setter
    def position(self, value: Floats) -> None:
        self.gizmo.position = np.asarray(value) + self.aside
        self._follow()

    @property
    def pose(self) -> tuple[Floats, Rotation]:
        """Position (m), shape (3,), and rotation."""
        return self.position, pose(self.gizmo)[1]

    def place(self, position: Floats, rotation: Rotation) -> None:
        """Put it to a pose."""
        place(self.gizmo, position + self.aside, rotation)
        self._follow()

    def _follow(self) -> None:
        """Bring what turns, and the line, to where the gizmo is."""
        if self._turning is not None:
            self._turning.position, self._turning.wxyz = self.gizmo.position, self.gizmo.wxyz
        if self.aside.any():
            ends = np.array([[self.position, self.gizmo.position]], dtype=np.float32)
            self._line.points = ends

    def on_drag(self, actions: Actions, key: str, action: Callable[[bool], None]) -> None:
        """Do something when it is dragged; it is called with whether it was released."""

        def dragged(released: bool) -> None:
            self._follow()
            action(released)

        def turned(released: bool) -> None:
            self.gizmo.wxyz = self._turning.wxyz
            action(released)

        actions.on_drag(self.gizmo, key, dragged)
        if self._turning is not None:
            actions.on_drag(self._turning, f"{key}, turned", turned)
