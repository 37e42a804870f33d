"""Recordings that tell little or nothing: that is said, in numbers, and none of it is believed."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip._typing import Floats
from refusals import refusal

T = np.linspace(0, 5, 501)
CIRCLE = np.column_stack([np.cos(T), np.sin(T), 0 * T])
LINE = np.outer(T, [0.1, 0.0, 0.0])
RNG = np.random.default_rng(0)


def motion(positions: Floats, rotations: Rotation | None = None) -> ns.PoseTrajectory:
    count = len(positions)
    return ns.PoseTrajectory(T[:count], positions, rotations or Rotation.identity(count), name="x")


NOTHING = {
    "a line": motion(LINE),
    "to and fro": motion(np.outer(np.sin(3 * T), [0.1, 0, 0])),
    "a circle that never turns": motion(CIRCLE),
    "noise": motion(1e-4 * RNG.normal(size=(501, 3))),
    "a random walk": motion(
        np.cumsum(1e-3 * RNG.normal(size=(501, 3)), axis=0),
        Rotation.from_rotvec(np.cumsum(1e-2 * RNG.normal(size=(501, 3)), axis=0)),
    ),
    "twenty poses": motion(LINE[:20]),
}


@pytest.mark.parametrize("name", NOTHING)
def test_nothing_is_found_in_what_tells_nothing(name: str) -> None:
    found = ns.identify(NOTHING[name])
    assert found.constraints == ()
    assert str(found).startswith("no constraint in 1 recording\n")
    json.dumps(found.to_dict(), allow_nan=False)
    found.plot().canvas.draw()


@pytest.mark.parametrize("size", [0.0, 1e-6])
def test_what_turns_on_the_spot_is_a_hinge(size: float) -> None:
    found = ns.identify(motion(size * CIRCLE, Rotation.from_euler("z", T + np.pi / 2)))
    assert found.kinds == ("fixed-point", "tool-axis")
    json.dumps(found.to_dict(), allow_nan=False)
    found.plot().canvas.draw()


def test_a_wheel_on_a_circle_hides_its_point() -> None:
    found = ns.identify(motion(CIRCLE, Rotation.from_euler("z", T + np.pi / 2)))
    assert found.travel is not None
    np.testing.assert_allclose(found.travel, [1, 0, 0], atol=1e-3)
    assert "nothing tells where" in str(found)


def test_what_stands_still_or_is_no_motion_is_refused() -> None:
    still, pair = motion(0 * LINE), motion(LINE[:2])
    assert "does not move" in refusal(ns.errors.InputError, ns.identify, still)
    assert "tell nothing of noise" in refusal(ns.errors.InputError, ns.identify, pair)
    assert "needs 1" in refusal(ns.errors.InputError, ns.identify, [])
