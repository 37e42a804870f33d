"""Demonstrations that several tests learn from or project."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from noslip import PoseTrajectory
from noslip._typing import Floats


def eased(s: Floats) -> Floats:
    """Rise from 0 to 1 that begins and ends at rest, over s from 0 to 1."""
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


def along(x: Floats, s: Floats) -> Rotation:
    """Rotations whose x axis follows a path and whose y axis stays level."""
    v = np.gradient(x, s, axis=0)
    yaw, pitch = np.arctan2(v[:, 1], v[:, 0]), -np.arctan2(v[:, 2], np.hypot(v[:, 0], v[:, 1]))
    return Rotation.from_euler("ZY", np.column_stack([np.unwrap(yaw), pitch]))


def arc(height: float = 0.1) -> tuple[Floats, Floats]:
    """A bent path of about a meter, flat if the height is 0, and the share of it that is done."""
    s = np.linspace(0, 1, 301)
    return s, np.column_stack([s, 0.2 * np.sin(2 * s), height * np.sin(3 * s)])


def cut(height: float = 0.1) -> PoseTrajectory:
    """The arc in 2 s, with the edge askew by up to 10 degrees."""
    s, x = arc(height)
    error = np.outer(0.17 * np.sin(2.5 * s), [0, 0, 1])
    return PoseTrajectory(2 * s, x, Rotation.from_rotvec(error) * along(x, s), name="cut")


def planar_cut(
    bend: float = 0.6, *, beside: float = 0.0, wavering: float = 0.0, count: int = 121
) -> PoseTrajectory:
    """A curved planar cut of 0.1 m in 2 s; its blade is beside its path by angles (rad)."""
    t = np.linspace(0.0, 2.0, count)
    heading = bend * np.sin(np.pi * t / 2)
    # Each step goes along the blade as it stands in the step's middle.
    middle = (heading[1:] + heading[:-1]) / 2
    ways = (
        0.05 * np.diff(t)[:, None] * np.column_stack([np.cos(middle), np.sin(middle), 0 * middle])
    )
    positions = np.vstack([np.zeros(3), np.cumsum(ways, axis=0)])
    held = Rotation.from_euler("z", heading + beside + wavering * np.sin(3 * t))
    return PoseTrajectory(t, positions, held)


def gentle_cut() -> PoseTrajectory:
    """A curved cut of 0.1 m in 1.5 s, the blade turned only roughly into it."""
    s = np.linspace(0, 1, 151)
    u = eased(s)
    path = np.column_stack([0.1 * u, 0.02 * np.sin(np.pi * u), 0 * u])
    yaw = Rotation.from_euler("z", 0.4 * np.cos(np.pi * s))
    return PoseTrajectory(1.5 * s, path, yaw, name="cut.csv")


def waving(rng: np.random.Generator, s: Floats, waves: int = 3) -> Floats:
    """A random Fourier path along x, of 1.5 m."""
    x = np.outer(s, [1.5, 0, 0])
    for k in range(1, waves + 1):
        phase, size = rng.uniform(0, 6), rng.normal(size=3)
        x += np.outer(np.sin(np.pi * k * s + phase), size / np.linalg.norm(size)) * 0.12 / k
    return x


def facing(
    seed: int, count: int = 201, *, askew: float = 0.4, flat: bool = False, duration: float = 1.0
) -> PoseTrajectory:
    """A random smooth cut; its edge follows the path up to a random, smooth error (rad).

    The edge is nowhere perpendicular to the path, so which way it leads is never in doubt.
    """
    rng = np.random.default_rng(seed)
    s = np.linspace(0, 1, count)
    x = waving(rng, s)
    if flat:
        x[:, 2] = 0.0
    axis = rng.normal(size=3)
    wave = np.sin(np.pi * rng.uniform(0.5, 2) * s + rng.uniform(0, 6))
    error = Rotation.from_rotvec(askew * np.outer(wave, axis / np.linalg.norm(axis)))
    held = error * along(x, s) * Rotation.from_euler("Y", 0.6)
    return PoseTrajectory(duration * s, x, held, name=f"cut {seed}")


def held_askew(seed: int = 0) -> PoseTrajectory:
    """A random curved cut of a meter in 1 s, pitched by 0.3 to 0.5 rad, its yaw beside its path."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0, 1, 301)
    waves = [0.1 * np.outer(np.sin(np.pi * k * s), rng.normal(size=3)) / k for k in (1, 2)]
    positions = np.column_stack([s, 0.3 * s**2, 0 * s]) + sum(waves) * [1, 1, 0.3]
    v = np.gradient(positions, s, axis=0)
    angles = np.column_stack([np.arctan2(v[:, 1], v[:, 0]) + 0.3 * np.sin(4 * s), 0.3 + 0.2 * s])
    return PoseTrajectory(times=s, positions=positions, rotations=Rotation.from_euler("ZY", angles))


def numerical_example(count: int = 1000) -> PoseTrajectory:
    """The paper's numerical example: a planar contour in 1 s, traced with the wrong yaw."""
    t = np.arange(count) / count
    x, y = np.sin(np.pi * t) ** 2, np.sin(np.pi * t / 2) ** 3
    angles = np.column_stack([0 * t, np.full(count, np.pi / 4), np.arctan2(y, x)])
    return PoseTrajectory(
        times=t,
        positions=np.column_stack([x, y, 0 * t]),
        rotations=Rotation.from_euler("xyz", angles),
        name="numerical example",
    )


BLADE_AT = np.array([0.052, -0.01, 0.013])
BLADE_TURNED = Rotation.from_rotvec([0.01, -0.02, 0.03])
"""The edge's point (m) and frame in that of the sensor on the knife."""


def sensed_blade(
    seed: int, turning: Sequence[float] = (0.6, 0.6, 0.9), free: float = 0.0
) -> PoseTrajectory:
    """A blade that plunges and turns about its axes (rad/s), for 12 s, as a sensor on it says.

    `free` is a speed sideways (m/s), by which it is no blade.
    """
    rng = np.random.default_rng(seed)
    count, step = 1201, 0.01
    t = step * (np.arange(count - 1) + 0.5)
    waves = [np.sin(rng.uniform(0.8, 2) * t + rng.uniform(0, 6)) for _ in range(6)]
    turns = [Rotation.random(random_state=rng)]
    places = [rng.normal(size=3)]
    for k in range(count - 1):
        spin = np.array(turning) * [wave[k] for wave in waves[:3]]
        velocity = [0.05, free * waves[3][k], 0.02 * waves[4][k]]
        middle = turns[-1] * Rotation.from_rotvec(step / 2 * spin)
        places.append(places[-1] + step * middle.apply(velocity))
        turns.append(turns[-1] * Rotation.from_rotvec(step * spin))
    body = Rotation.concatenate(turns) * BLADE_TURNED.inv()
    positions = np.array(places) - body.apply(BLADE_AT) + 5e-5 * rng.normal(size=(count, 3))
    noisy = body * Rotation.from_rotvec(5e-4 * rng.normal(size=(count, 3)))
    return PoseTrajectory(step * np.arange(count), positions, noisy, name=f"cut {seed}")
