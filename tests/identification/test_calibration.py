"""A known rule tells where the sensor sits on the tool, and how late its rotations are."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import noslip as ns
from measures import rms, speed_along
from noslip.identification import synchronized, time_offset, tool_frame
from refusals import refusal

POSITION_NOISE, ROTATION_NOISE = 1e-4, 1e-3
FRAMES = {
    "near": (Rotation.from_rotvec([0.02, -0.03, 0.05]), (0.052, 0.01, 0.013)),
    "anyhow": (Rotation.from_rotvec([1.2, -0.8, 2.0]), (-0.1, 0.07, 0.2)),
}
SPEEDS: dict[str, tuple[Any, tuple[float, ...], tuple[float, ...]]] = {
    "blade": (ns.Blade(), (0.05, 0.0, 0.03), (0.6, 0.6, 0.9)),
    "other axes": (ns.Blade("z", "-x", (0.01, 0.0, 0.02)), (-0.05, 0.03, 0.0), (0.6, 0.6, 0.9)),
    "needle": (ns.Needle(), (0.05, 0.0, 0.0), (0.6, 0.6, 0.9)),
    "wheel": (ns.Wheel(), (0.3, 0.0, 0.0), (0.0, 0.0, 0.9)),
}
"""A rule, and the speeds of its point (m/s) and of the turning (rad/s) along the tool's axes."""


@cache
def ridden(kind: str, seed: int) -> ns.PoseTrajectory:
    """The tool's own motion under its rule, at 100 Hz."""
    constraint, linear, angular = SPEEDS[kind]
    rng = np.random.default_rng(seed)
    count, step = 1501, 0.01
    t = step * (np.arange(count - 1) + 0.5)
    speeds = np.array([np.sin(rng.uniform(1, 2.5) * t + rng.uniform(0, 6)) for _ in range(6)]).T
    speeds *= [*linear, *angular]
    speeds[:, 0] = linear[0]
    yaw = Rotation.from_euler("z", rng.uniform(0, 6))
    turns = [yaw if kind == "wheel" else Rotation.random(random_state=rng)]
    places = [rng.normal(size=3)]
    for row in speeds:
        middle = turns[-1] * Rotation.from_rotvec(step / 2 * row[3:])
        places.append(places[-1] + step * middle.apply(row[:3]))
        turns.append(turns[-1] * Rotation.from_rotvec(step * row[3:]))
    body = Rotation.concatenate(turns)
    origins = np.array(places) - body.apply(constraint.reference_point)
    times = step * np.arange(count)
    return ns.PoseTrajectory(times, origins, body, name=f"{kind} {seed}")


def sensed(tool: ns.PoseTrajectory, frame: str, seed: int, late: float = 0.0) -> ns.PoseTrajectory:
    """What a sensor says whose pose is ``T_ws = T_wb T_sb^-1``, with noise, its rotations late."""
    turn, place = FRAMES[frame]
    rng = np.random.default_rng(seed)
    rotations = tool.rotations * turn.inv()
    positions = tool.positions - rotations.apply(place)
    times = tool.times
    read = Slerp(times, rotations)(np.clip(times - late, times[0], times[-1]))
    return ns.PoseTrajectory(
        times,
        positions + POSITION_NOISE * rng.normal(size=positions.shape),
        read * Rotation.from_rotvec(ROTATION_NOISE * rng.normal(size=positions.shape)),
        name=tool.name,
    )


def recorded(kind: str, frame: str, late: float = 0.0) -> list[ns.PoseTrajectory]:
    return [sensed(ridden(kind, seed), frame, seed + 90, late) for seed in range(3)]


def slip(motion: ns.PoseTrajectory, constraint: Any) -> float:
    """Share of its speed that the rule's point moves sideways, as means over 0.2 s."""
    aside, ahead = (
        np.convolve(
            speed_along(motion, axis, constraint.reference_point), np.ones(20) / 20, "valid"
        )
        for axis in (constraint.edge.frame[1], constraint.edge.frame[0])
    )
    return rms(aside) / rms(ahead)


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("kind", SPEEDS)
def test_the_frame_is_found_in_which_the_rule_holds(kind: str, frame: str) -> None:
    constraint = SPEEDS[kind][0]
    recordings = recorded(kind, frame)
    found = tool_frame(recordings, constraint)
    turn, place = FRAMES[frame]
    for recording in recordings:
        assert slip(ns.prepare(recording, tool_frame=found.matrix), constraint) < 0.06
        # Nothing but noise: in the frame that is true there is as much.
        true = np.eye(4)
        true[:3, :3], true[:3, 3] = turn.as_matrix(), place
        left = slip(ns.prepare(recording, tool_frame=true), constraint)
        assert slip(ns.prepare(recording, tool_frame=found.matrix), constraint) < 1.05 * left
    # The axes and the point that the rule tells, in the sensor's frame.
    read = Rotation.from_matrix(found.matrix[:3, :3])
    told = [1] if kind in ("blade", "other axes") else [0] if kind == "needle" else [0, 1, 2]
    for axis in constraint.edge.frame[told]:
        # A blade is the same the other way round.
        aligned = abs(read.apply(axis) @ turn.apply(axis))
        assert np.degrees(np.arccos(min(aligned, 1.0))) < 0.1
    point = constraint.reference_point
    off = read.apply(point) + found.matrix[:3, 3] - turn.apply(point) - place
    off -= found.unknown.T @ (found.unknown @ off)
    assert np.linalg.norm(off) < 1e-4
    spread = np.sqrt(np.trace(found.covariance[3:, 3:]))
    assert np.linalg.norm(off) < 4 * spread
    assert found.slip < 0.1 and found.holdout < 0.1


@pytest.mark.parametrize(("kind", "late"), [("blade", 0.02), ("blade", 0.0), ("needle", -0.035)])
def test_rotations_that_come_late_are_told_and_put_right(kind: str, late: float) -> None:
    recordings = recorded(kind, "near", late)
    offset = time_offset(recordings, SPEEDS[kind][0])
    assert offset == pytest.approx(late, abs=1e-3)
    right = [synchronized(recording, offset) for recording in recordings]
    for before, after, tool in zip(
        recordings, right, map(ridden, [kind] * 3, range(3)), strict=True
    ):
        assert len(before) - len(after) == pytest.approx(abs(late) / 0.01, abs=2)
        here = np.searchsorted(tool.times, after.times - 1e-6)
        truth = tool.rotations[here] * FRAMES["near"][0].inv()
        assert (after.rotations * truth.inv()).magnitude().max() < 8e-3


def test_what_makes_no_sense_is_refused() -> None:
    (recording,) = recorded("blade", "near")[:1]
    for call in (tool_frame, time_offset):
        message = refusal(ns.errors.InputError, call, recording, ns.SpeedLimit())
        assert "Blade, a Needle or a Wheel" in message
    assert "leaves nothing" in refusal(ns.errors.InputError, synchronized, recording, 20.0)
