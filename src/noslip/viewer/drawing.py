"""The scene on the page: tools, trails, arrows and shapes, moved to an instant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import viser
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from noslip._typing import Floats
from noslip.figures.style import PALETTE
from noslip.runtime.state import State
from noslip.trajectory import PoseTrajectory
from noslip.viewer.arm import Arm
from noslip.viewer.colors import rgb
from noslip.viewer.shapes import COLORS, OPACITIES, Shape
from noslip.viewer.tool import Part, add_mesh, rod
from noslip.viewer.track import Track

ARROW_COLORS = {"lateral": "purple", "velocity": "green", "force": "black"}
"""Of :meth:`noslip.viewer.track.Track.arrows`, by their names in the palette."""
GHOST, GHOST_OPACITY = rgb(PALETTE["gray"]), 0.3
"""Color and opacity of what a motion is compared with: seen, and seen through."""
ROD_LENGTH = 0.3
"""Of what stands for a body beside the tool, over the scene's size: shorter than the scalpel."""
PANEL = 400
"""Pixels at the right of a window that the panel covers: viser's large one, and its margin."""
COVERED = 0.36, 0.5
"""Shares of a window's width that it is taken to cover at least, and at most.  A dense screen tells
of more pixels than those that a page counts in, and a window that wide has room; of one that is
narrower than two panels not even half would be left."""
REACH = 0.95
"""From the scene's middle to the ends of its handles at either side, over the scene's size, as far
away as the camera looks."""
ABOVE = 0.18
"""Share of an upright window's height by which the scene is above its middle: a panel that is
unfolded covers the lower three fifths."""
TRAIL_WIDTH, GHOST_WIDTH = 3.5, 1.5
"""Pixels: what a motion is compared with is thinner."""


class Follower(Protocol):
    """What moves along with a motion's tool, such as an arm that holds it."""

    def add(self, scene: viser.SceneApi, node: str) -> None:
        """Draw it once, under a node of its own; the node's frame is the world's."""

    def show(self, motion: PoseTrajectory, sample: int) -> None:
        """Move it to where the tool is at a sample of the motion."""


class Drawing:
    """What a viser server's scene shows.

    Parameters
    ----------
    server : viser.ViserServer
    tool : sequence of Part
        In the tool's frame; drawn once a motion; an arm has its own.
    center : array, shape (3,)
        Of the scene (m).
    size : float
        Of the scene (m): of the arrows, the camera's distance, the grid.
    floor : float
        Height of the grid (m).  Its cells are 1 cm wide, or 1 mm, 10 cm, as suits the size.
    arm : array, shape (K, 3), optional
        Points of an arm (m), its base first: the camera stands across from that and sees all.

    Attributes
    ----------
    middle : array, shape (3,)
        Of what is seen first (m): of the scene, or of the arm and its work.
    reach : float
        How far to either side of the middle that reaches (m).
    """

    def __init__(
        self,
        server: viser.ViserServer,
        tool: Sequence[Part],
        *,
        center: Floats,
        size: float,
        floor: float = 0.0,
        arm: Floats | None = None,
    ) -> None:
        self.server, self.tool, self.size = server, tool, size
        self._followers: dict[str, Follower] = {}
        self._tracks: dict[str, Track] = {}
        self._nodes: dict[str, dict[str, Any]] = {}
        self._visible = {"ghost": True, "arrows": True, "shapes": True}
        self._shapes: list[tuple[Any, Shape]] = []
        cell = 10 ** float(np.floor(np.log10(size / 2)))
        server.scene.add_grid(
            "/grid",
            width=4 * size,
            height=4 * size,
            cell_size=cell,
            section_size=10 * cell,
            cell_color=(225, 225, 225),
            section_color=(205, 205, 205),
            position=(center[0], center[1], floor),
            infinite_grid=False,
        )
        camera = server.initial_camera
        # To the left of the middle, for on the right is the panel.
        camera.look_at = center + size * np.array([0.35, 0.0, 0.1])
        camera.position = center + size * np.array([0.15, -1.4, 1.15])
        self.middle: Floats = center
        self.reach = REACH * size
        if arm is not None:
            camera.look_at, camera.position = _across(center, arm)
            points = np.vstack([arm, center])
            self.middle = points.mean(axis=0)
            self.reach = float(np.linalg.norm(points - self.middle, axis=1).max())
        away = float(np.linalg.norm(np.subtract(camera.position, camera.look_at)))
        camera.near, camera.far = 0.01 * size, max(100 * size, 10 * away)
        camera.fov = np.radians(50)

        @server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            self._place(client)

            @client.camera.on_update
            def _(_: viser.CameraHandle) -> None:
                # The browser goes there once the scene is loaded, which may be after it was
                # placed, and when a person resets the view.
                if np.allclose(client.camera.position, camera.position, atol=1e-4 * size):
                    self._place(client)

    def _place(self, client: viser.ClientHandle) -> None:
        """Move the camera of a window to where one of its size stands first."""
        place, look_at = self.first_camera(client.camera.aspect, client.camera.image_width)
        with client.atomic():
            client.camera.position, client.camera.look_at = place, look_at

    def first_camera(self, aspect: float, width: float) -> tuple[Floats, Floats]:
        """Where the camera of a window stands first (m), and looks.

        Parameters
        ----------
        aspect : float
            Width of the window over its height.
        width : float
            In pixels of its picture.
        """
        if aspect < 1:
            return self.upright_camera(aspect)
        return self.wide_camera(aspect, float(np.clip(PANEL / width, *COVERED)))

    def wide_camera(self, aspect: float, covered: float) -> tuple[Floats, Floats]:
        """Where a camera stands (m), and looks, in a window that is wider than high.

        What is seen first lies in the middle of what the panel leaves free, and fits there.

        Parameters
        ----------
        aspect : float
            Width of the window over its height.
        covered : float
            Share of the width, at the right, that the panel covers.
        """
        camera = self.server.initial_camera
        away = np.subtract(camera.position, camera.look_at)
        far = float(np.linalg.norm(away))
        right = np.cross(np.array([0.0, 0.0, 1.0]), away)
        right /= np.linalg.norm(right)
        seen = far * np.tan(camera.fov / 2) * aspect
        back = max(1.0, self.reach / (seen * (1 - covered)))
        aside = np.subtract(camera.look_at, self.middle)
        look_at = self.middle + aside + (back * covered * seen - aside @ right) * right
        return look_at + back * away, look_at

    def upright_camera(self, aspect: float) -> tuple[Floats, Floats]:
        """Where a camera stands (m), and looks, in a window whose width is a share of its height.

        Its width sees what is seen in one that is as wide as it is high; the middle of the scene is
        above the window's, for below is the panel.
        """
        camera = self.server.initial_camera
        away = np.subtract(camera.position, self.middle)
        far = float(np.linalg.norm(away))
        up = np.array([0.0, 0.0, 1.0]) - away[2] * away / far**2
        down = -ABOVE * 2 * np.tan(camera.fov / 2) * far * up / np.linalg.norm(up)
        return self.middle + (away + down) / aspect, self.middle + down / aspect

    # ---------------------------------------------------------------- what there is

    def add_shapes(self, shapes: Iterable[Shape]) -> None:
        """Draw constraints' surfaces and zones."""
        for number, shape in enumerate(shapes):
            node = f"/constraints/{number}_{shape.name.replace('/', '_')}"
            color, opacity = COLORS[shape.kind], OPACITIES[shape.kind]
            drawn = add_mesh(self.server.scene, node, shape, color, opacity=opacity)
            self._shapes.append((drawn, shape))

    def put(self, name: str, track: Track, worst: float, follower: Follower | None = None) -> None:
        """Draw a motion, or draw it anew where there is one of that name.

        ``worst`` is the violation that has the last color.  What moves along is drawn with the
        motion's first drawing.
        """
        self._tracks[name] = track
        points, colors = track.trail(worst)
        colors = _linear(colors)
        if name in self._nodes:
            with self.server.atomic():
                trail = self._nodes[name]["trail"]
                trail.points, trail.colors = points.astype(np.float32), colors
            return
        scene = self.server.scene
        scene.add_frame(f"/motions/{name}", show_axes=False)
        # An arm's model has its own.
        tool = () if isinstance(follower, Arm) else self.tool
        nodes: dict[str, Any] = {
            "trail": self._add_lines(f"/motions/{name}/trail", points, colors, TRAIL_WIDTH),
            "tool": self.add_parts(f"/motions/{name}/tool", tool),
        }
        if track.reference is not None:
            path = track.reference.positions[:: max(1, len(track.reference) // 500)]
            segments = np.stack([path[:-1], path[1:]], axis=1)
            node = f"/motions/{name}/demonstration"
            nodes["ghost trail"] = self._add_lines(node, segments, GHOST, GHOST_WIDTH)
            nodes["ghost"] = self.add_parts(f"/motions/{name}/ghost", tool, ghost=True)
        for body, motion in track.beside.items():
            node = f"/motions/{name}/beside_{body.replace('/', '_')}"
            nodes[f"beside {body}"] = self.add_parts(node, rod(ROD_LENGTH * self.size))
            scene.add_label(f"{node}/name", body, font_screen_scale=0.9, anchor="top-center")
            path = motion.positions[:: max(1, len(motion) // 500)]
            segments = np.stack([path[:-1], path[1:]], axis=1)
            self._add_lines(f"{node}_trail", segments, rgb(PALETTE["sky"]), GHOST_WIDTH)
        for arrow in track.arrows(0, self.size):
            nodes[arrow] = scene.add_arrows(
                f"/motions/{name}/{arrow}",
                np.zeros((1, 2, 3)),
                rgb(PALETTE[ARROW_COLORS[arrow]]),
                shaft_radius=0.004 * self.size,
                head_radius=0.01 * self.size,
                head_length=0.03 * self.size,
                visible=False,
            )
        self._nodes[name] = nodes
        if follower is not None:
            self._followers[name] = follower
            follower.add(scene, f"/motions/{name}/follower")

    def remove(self, name: str) -> None:
        """Remove a motion, or what there is of it after its drawing failed."""
        for held in (self._tracks, self._nodes, self._followers):
            held.pop(name, None)
        self.server.scene.remove_by_name(f"/motions/{name}")

    def draw_path(self, name: str, points: Floats) -> None:
        """Draw a line beside a motion's own trail: where a pushed tool went."""
        segments = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
        nodes = self._nodes[name]
        if "pushed" in nodes:
            nodes["pushed"].points = segments
        else:
            green = rgb(PALETTE["green"])
            nodes["pushed"] = self._add_lines(
                f"/motions/{name}/pushed", segments, green, TRAIL_WIDTH
            )

    def clear_path(self, name: str) -> None:
        """Remove that line, if there is one."""
        if "pushed" in self._nodes.get(name, {}):
            self._nodes[name].pop("pushed").remove()

    def show_found(self, name: str, carried: Sequence[Part], placed: Sequence[Part]) -> None:
        """Draw what was found in a motion: what its tool carries, and what is in the world."""
        self.clear_found(name)
        for node, parts in (("tool/found", carried), ("found", placed)):
            self._nodes[name][node] = self.add_parts(f"/motions/{name}/{node}", parts)

    def clear_found(self, name: str) -> None:
        """Remove that, if there is any."""
        for node in ("tool/found", "found"):
            if node in self._nodes.get(name, {}):
                self._nodes[name].pop(node).remove()

    # ---------------------------------------------------------------- moving it

    def move(self, time: float) -> None:
        """Move everything to a time (s); a motion that is over stays at its end."""
        with self.server.atomic():
            self._move_shapes(time)
            for name, track in self._tracks.items():
                self._move(name, track, time)

    def tool_pose(self, name: str) -> tuple[Floats, Rotation]:
        """Where a motion's tool is drawn: position (m) and rotation."""
        return pose(self._nodes[name]["tool"])

    def place_tool(self, name: str, state: State) -> None:
        """Move one motion's tool to a state beside it, until the next :meth:`move`."""
        nodes = self._nodes[name]
        with self.server.atomic():
            self._move_shapes(state.time)
            place(nodes["tool"], state.position, state.rotation)
            self._draw_arrows(nodes, self._tracks[name].arrows_in(state, self.size))

    def show(self, what: str, visible: bool) -> None:
        """Show or hide ``ghost``, ``arrows`` or ``shapes``."""
        self._visible[what] = visible
        for node, _ in self._shapes:
            node.visible = self._visible["shapes"]
        for nodes in self._nodes.values():
            for part in ("ghost", "ghost trail"):
                if part in nodes:
                    nodes[part].visible = self._visible["ghost"]

    def _move_shapes(self, time: float) -> None:
        for node, shape in self._shapes:
            if shape.frame is not None:
                place(node, *shape.pose(time))

    def _move(self, name: str, track: Track, time: float) -> None:
        nodes, k = self._nodes[name], track.sample(time)
        place(nodes["tool"], track.motion.positions[k], track.motion.rotations[k])
        if track.reference is not None:
            done = min(time / track.motion.duration, 1.0)
            g = round(done * (len(track.reference) - 1))
            place(nodes["ghost"], track.reference.positions[g], track.reference.rotations[g])
        for body, motion in track.beside.items():
            place(nodes[f"beside {body}"], motion.positions[k], motion.rotations[k])
        self._draw_arrows(nodes, track.arrows(k, self.size))
        if name in self._followers:
            self._followers[name].show(track.motion, k)

    def _draw_arrows(self, nodes: dict[str, Any], arrows: Mapping[str, Floats]) -> None:
        for arrow, ends in arrows.items():
            # Shorter than its own head, an arrow shows nothing.
            seen = np.linalg.norm(ends[1] - ends[0]) > 1e-3 * self.size
            nodes[arrow].visible = bool(seen and self._visible["arrows"])
            if seen:
                nodes[arrow].points = ends[None].astype(np.float32)

    def _add_lines(self, node: str, segments: NDArray[Any], colors: Any, width: float) -> Any:
        return self.server.scene.add_line_segments(
            node, segments, colors, thickness=width, thickness_units="screen"
        )

    def add_parts(self, node: str, parts: Sequence[Part], *, ghost: bool = False) -> Any:
        """Draw parts under a node that moves with its parent; return it."""
        frame = self.server.scene.add_frame(node, show_axes=False)
        for number, part in enumerate(parts):
            color, opacity = (GHOST, GHOST_OPACITY) if ghost else (part.color, part.opacity)
            look = {"opacity": opacity, "flat_shading": True}
            add_mesh(self.server.scene, f"{node}/{number}", part, color, **look)
        return frame


def place(node: Any, position: Floats, rotation: Rotation) -> None:
    """Move a node of the scene."""
    node.position, node.wxyz = position, rotation.as_quat(scalar_first=True)


def pose(node: Any) -> tuple[Floats, Rotation]:
    """Return position (m) and rotation of a node of the scene."""
    return np.array(node.position), Rotation.from_quat(np.array(node.wxyz), scalar_first=True)


def _across(center: Floats, arm: Floats) -> tuple[Floats, Floats]:
    """Where a camera looks, and stands, that sees an arm behind its work."""
    points = np.vstack([arm, center])
    low, high = points.min(axis=0), points.max(axis=0)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    up = np.array([0.0, 0.0, 1.0])
    ahead = (center - arm[0]) * (1 - up)
    far = float(np.linalg.norm(ahead))
    ahead = ahead / far if far > 0 else np.array([1.0, 0.0, 0.0])
    place = middle + 1.3 * size * (0.75 * ahead + 0.6 * np.cross(ahead, up) + 0.35 * up)
    right = np.cross(middle - place, up)
    # To the left of the middle, for on the right is the panel.
    return middle + 0.3 * size * right / np.linalg.norm(right), place


def _linear(colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colors of corners as viser's lines take them: they are not converted from sRGB there."""
    share = colors / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.round(255 * linear), dtype=np.uint8)


def legend(worst: float, unit: str, arrows: Mapping[str, object]) -> str:
    """Return what the colors mean, as HTML."""
    stops = ", ".join(PALETTE[name] for name in ("blue", "orange", "vermillion"))
    lines = [
        f'<div style="height:8px;border-radius:4px;background:linear-gradient(to right,{stops})">'
        f'</div><div style="display:flex;justify-content:space-between"><span>0</span>'
        f"<span>violation along the trail</span><span>{worst:.2g} {unit}</span></div>"
    ]
    names = {"lateral": "lateral axis", "velocity": "velocity", "force": "constraint force"}
    lines += [
        f'<span style="color:{PALETTE[color]}">&#10142;</span> {names[arrow]}&ensp;'
        for arrow, color in ARROW_COLORS.items()
        if arrow in arrows
    ]
    return "".join(lines)
