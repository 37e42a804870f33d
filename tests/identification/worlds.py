"""Exact motions of tools under known rules, as a sensor somewhere on the tool records them.

None of it uses the library's projections: what has a parametrized pose is written down, the others
are integrated from twists of the body (Magnus, order 4, four times per sample).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from noslip import Blade, Constraint, Needle, PoseTrajectory, Wheel
from noslip._typing import Floats
from noslip.constraints import (
    CylinderContact,
    FixedPoint,
    PlaneContact,
    RemoteCenter,
    RollingDisc,
    RollingSphere,
    SphereContact,
    ToolAxis,
    TurningRadius,
)
from strategies import triple, unit

RADIUS = 0.06
"""Of spheres, cylinders and all that rolls (m)."""
CURVATURE = 8.0
"""Of the beveled needle (1/m)."""
TIGHTEST = 0.08
"""Turning radius of the car (m)."""


@dataclass(frozen=True)
class World:
    """A recording, and what is true of it, in the sensor's frame and the recording's world.

    Attributes
    ----------
    trajectory : PoseTrajectory
        With noise.
    exact : PoseTrajectory
        Without.
    constraints : tuple of Constraint
        That hold, about the sensor's frame.
    point, axes : array, shape (3,), (3, 3)
        Origin of the tool and its x, y, z axes as rows, in the sensor's frame.
    center, normal : array, shape (3,)
        Of the surface or the pivot, in the recording's world (m), and its normal or axis.
    """

    trajectory: PoseTrajectory
    exact: PoseTrajectory
    constraints: tuple[Constraint, ...]
    point: Floats
    axes: Floats
    center: Floats
    normal: Floats


def world(
    kind: str,
    seed: int,
    noise: tuple[float, float] = (0.0, 0.0),
    *,
    rate: float = 100.0,
    frame: bool = True,
) -> World:
    """Record a random motion of a kind, 5 to 10 s long.

    Noise is the standard deviation of positions (m) and of rotations about each axis (rad), white.
    Without `frame` the sensor is the tool's frame, and the world is not turned.
    """
    rng = np.random.default_rng([list(KINDS).index(kind), seed])
    duration = rng.uniform(5, 10)
    count = round(duration * rate) + 1
    times = np.arange(count) / rate
    matrices = KINDS[kind](rng, times)
    turn, offset, shift = Rotation.identity(), np.zeros(3), np.zeros(3)
    if frame:
        turn = Rotation.random(rng=rng)
        offset = unit(rng) * rng.uniform(0.04, 0.1)
        base, shift = Rotation.random(rng=rng), rng.uniform(-1, 1, 3)
    else:
        base = Rotation.identity()
    # The sensor's pose in the tool's frame is (turn, offset).
    held = Rotation.from_matrix(matrices[:, :3, :3])
    positions = base.apply(matrices[:, :3, 3] + held.apply(offset)) + shift
    rotations = base * held * turn
    name = f"{kind} {seed}"
    exact = PoseTrajectory(times, positions, rotations, name=name)
    shaken = PoseTrajectory(
        times,
        positions + noise[0] * rng.normal(size=(count, 3)),
        rotations * Rotation.from_rotvec(noise[1] * rng.normal(size=(count, 3))),
        name=name,
    )
    axes = turn.inv().apply(np.eye(3))
    point = turn.inv().apply(-offset)
    normal = base.apply([0.0, 0.0, 1.0])
    return World(
        shaken if any(noise) else exact,
        exact,
        _rules(kind, point, axes, shift, normal),
        point,
        axes,
        shift,
        normal,
    )


def _rules(
    kind: str, r: Floats, axes: Floats, center: Floats, normal: Floats
) -> tuple[Constraint, ...]:
    """What holds: each kind is about the tool's origin, the world's origin and its z axis."""
    x, y, z = map(triple, axes)
    at, middle, up = triple(r), triple(center), triple(normal)
    wheel = Wheel(axle=y, edge=x, normal=up, reference_point=at)
    return {
        "none": (),
        "blade": (Blade(lateral=y, edge=x, reference_point=at),),
        "needle": (Needle(shaft=x, bevel=z, reference_point=at),),
        "bevel": (Needle(shaft=x, bevel=z, curvature=CURVATURE, reference_point=at),),
        "wheel": (wheel,),
        "car": (wheel, TurningRadius(TIGHTEST, edge=x, up=z, reference_point=at)),
        "plane": (PlaneContact(middle, up, at),),
        "sphere": (SphereContact(middle, RADIUS, at),),
        "cylinder": (CylinderContact(middle, up, RADIUS, at),),
        "remote center": (RemoteCenter(middle, z, at),),
        "fixed point": (FixedPoint(middle, at),),
        "fixed axis": (FixedPoint(middle, at), ToolAxis(z, up)),
        "rolling disc": (RollingDisc(RADIUS, y, up, at),),
        "rolling sphere": (RollingSphere(RADIUS, up, at),),
    }[kind]


# ---------------------------------------------------------------- motions


def _wave(rng: np.random.Generator, times: Floats, sizes: Floats | list[float] | float) -> Floats:
    """Random smooth functions of time with a root mean square of `sizes`, shape (N, k)."""
    sizes = np.atleast_1d(np.asarray(sizes, float))
    found = np.zeros((len(times), len(sizes)))
    for wave in range(1, 5):
        rate = 2 * np.pi * (wave + rng.uniform(-0.3, 0.3, len(sizes))) / 8.0
        phase = rng.uniform(0, 2 * np.pi, len(sizes))
        found += rng.normal(size=len(sizes)) / wave * np.sin(np.outer(times, rate) + phase)
    return np.asarray(found / np.sqrt(np.mean(found**2, axis=0)) * sizes)


def _matrices(rotations: Rotation, positions: Floats) -> Floats:
    found = np.tile(np.eye(4), (len(positions), 1, 1))
    found[:, :3, :3] = rotations.as_matrix()
    found[:, :3, 3] = positions
    return found


def _turning(rng: np.random.Generator, times: Floats, size: float = 0.35) -> Rotation:
    """Turns to and fro about all axes."""
    return Rotation.from_rotvec(_wave(rng, times, [size] * 3))


def _integrated(times: Floats, twists: Callable[[Floats], Floats]) -> Floats:
    """Poses of a body whose twist in its own frame (linear, angular), shape (N, 6), is given."""
    parts = 4
    h = float(times[1] - times[0]) / parts
    begins = np.arange((len(times) - 1) * parts) * h
    nodes = np.sqrt(3) / 6
    one, two = (_hats(twists(begins + h * (0.5 + side * nodes))) for side in (-1, 1))
    # Of dT/dt = T V: the fourth-order Magnus expansion.
    steps = h / 2 * (one + two) + np.sqrt(3) / 12 * h**2 * (one @ two - two @ one)
    steps = _exponentials(steps)
    poses = [np.eye(4)]
    for step in steps:
        poses.append(poses[-1] @ step)
    found = np.array(poses[::parts])
    found[:, :3, 3] -= found[:, :3, 3].mean(axis=0)
    return found


def _hats(twists: Floats) -> Floats:
    found = np.zeros((len(twists), 4, 4))
    found[:, :3, :3] = np.cross(np.eye(3), twists[:, None, 3:])
    found[:, :3, 3] = twists[:, :3]
    return found


def _exponentials(matrices: Floats) -> Floats:
    """Of small ones, by their series."""
    found, term = np.tile(np.eye(4), (len(matrices), 1, 1)), np.eye(4)
    for k in range(1, 9):
        term = term @ matrices / k
        found = found + term
    return found


Draws = Callable[[np.random.Generator, Floats], Floats]


def _driven(speeds: list[float], turns: list[float], spin: float = 0.0) -> Draws:
    """A body driven by speeds and turns with root mean squares along and about its axes.

    It always advances along x, by 0.05 m/s more, and spins about y.
    """

    def draw(rng: np.random.Generator, times: Floats) -> Floats:
        grid = np.linspace(-0.1, times[-1] + 0.1, 4000)
        values = _wave(rng, grid, [*speeds, *turns]) + [0.05, 0, 0, 0, spin, 0]
        spline = _spline(grid, values)
        return _integrated(times, spline)

    return draw


def _spline(times: Floats, values: Floats) -> Callable[[Floats], Floats]:
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(times, values)
    return lambda at: np.asarray(spline(at))


def _bevel(rng: np.random.Generator, times: Floats) -> Floats:
    grid = np.linspace(-0.1, times[-1] + 0.1, 4000)
    forward, roll = _wave(rng, grid, [0.015, 0.5]).T
    forward = forward + 0.05
    zero = np.zeros_like(grid)
    return _integrated(
        times,
        _spline(grid, np.column_stack([forward, zero, zero, roll, zero, CURVATURE * forward])),
    )


def _car(rng: np.random.Generator, times: Floats) -> Floats:
    grid = np.linspace(-0.1, times[-1] + 0.1, 4000)
    forward, steering = _wave(rng, grid, [0.02, 2.0]).T
    # Forward, and often at the stop of its steering.
    forward = 0.02 + np.abs(forward + 0.04)
    yaw = forward / TIGHTEST * np.tanh(steering)
    zero = np.zeros_like(grid)
    return _integrated(
        times, _spline(grid, np.column_stack([forward, zero, zero, zero, zero, yaw]))
    )


def _plane(rng: np.random.Generator, times: Floats) -> Floats:
    return _matrices(_turning(rng, times), _wave(rng, times, [0.06, 0.06, 0.0]) * [1, 1, 0])


def _sphere(rng: np.random.Generator, times: Floats) -> Floats:
    where = Rotation.from_rotvec(_wave(rng, times, [0.5, 0.5, 0.0]) * [1, 1, 0])
    return _matrices(_turning(rng, times), RADIUS * where.apply([0.0, 0.0, 1.0]))


def _cylinder(rng: np.random.Generator, times: Floats) -> Floats:
    along, angle = _wave(rng, times, [0.08, 0.8]).T
    circle = RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])
    return _matrices(_turning(rng, times), np.column_stack([circle, along]))


def _remote_center(rng: np.random.Generator, times: Floats) -> Floats:
    held = _turning(rng, times)
    depth = 0.08 + _wave(rng, times, 0.03)
    return _matrices(held, depth * held.apply([0.0, 0.0, 1.0]))


def _fixed_point(rng: np.random.Generator, times: Floats) -> Floats:
    return _matrices(_turning(rng, times), np.zeros((len(times), 3)))


def _fixed_axis(rng: np.random.Generator, times: Floats) -> Floats:
    angle = _wave(rng, times, 0.6)
    return _matrices(Rotation.from_rotvec(angle * [0.0, 0.0, 1.0]), np.zeros((len(times), 3)))


def _rolling_disc(rng: np.random.Generator, times: Floats) -> Floats:
    """A disc that leans a little as it rolls; its center follows from its turning."""
    fine = np.linspace(0, times[-1], 8 * (len(times) - 1) + 1)
    lean, steer = _wave(rng, fine, [0.15, 0.6]).T
    rolled = 1.2 * fine + _wave(rng, fine, 0.3)[:, 0]
    held = Rotation.from_euler("ZXY", np.column_stack([steer, lean, rolled]))
    rise = np.column_stack([0 * lean, -np.sin(lean), np.cos(lean)])
    above = Rotation.from_euler("Z", steer[:, None]).apply(rise)
    return _rolled(fine, held, RADIUS * above)


def _rolling_sphere(rng: np.random.Generator, times: Floats) -> Floats:
    fine = np.linspace(0, times[-1], 8 * (len(times) - 1) + 1)
    held = Rotation.from_rotvec(_wave(rng, fine, [0.7, 0.7, 0.5]))
    return _rolled(fine, held, np.broadcast_to([0.0, 0.0, RADIUS], (len(fine), 3)))


def _rolled(fine: Floats, held: Rotation, above: Floats) -> Floats:
    """Poses, one in eight, of a body whose point below its center, `above` it, is at rest."""
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import RotationSpline

    spin = held.apply(RotationSpline(fine, held)(fine, 1))
    ways = CubicSpline(fine, np.cross(spin, above)).antiderivative()(fine)
    # The center is as high as the disc stands.
    ways[:, 2] += above[0, 2] - ways[0, 2]
    return _matrices(held, ways)[::8]


KINDS: dict[str, Draws] = {
    "none": _driven([0.03, 0.03, 0.03], [0.4, 0.4, 0.4]),
    "blade": _driven([0.02, 0.0, 0.015], [0.4, 0.4, 0.4]),
    "needle": _driven([0.02, 0.0, 0.0], [0.4, 0.4, 0.4]),
    "bevel": _bevel,
    "wheel": _driven([0.02, 0.0, 0.0], [0.0, 0.0, 0.7]),
    "car": _car,
    "plane": _plane,
    "sphere": _sphere,
    "cylinder": _cylinder,
    "remote center": _remote_center,
    "fixed point": _fixed_point,
    "fixed axis": _fixed_axis,
    "rolling disc": _rolling_disc,
    "rolling sphere": _rolling_sphere,
}
"""Motions of the tool's frame in a world whose origin and z axis the rule is about."""
