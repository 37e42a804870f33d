"""Arrays of actions: poses keep the constraint in any layout, all else is the same to the bit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import planar_cut
from noslip.errors import CompromiseWarning, InputError
from noslip.shielding import ActionShield
from refusals import refusal

RATE = 30.0
CUT = planar_cut(beside=0.1, count=61).resampled(rate=RATE)
"""Its blade stands beside its path: it slips by a tenth of its speed."""
TIPPED = Rotation.from_rotvec([0.3, -0.5, 0.2])
"""So that no rotation is about a coordinate axis."""


def six(rotations: Rotation) -> np.ndarray:
    """The first two rows of the matrices, as PyTorch3D's matrix_to_rotation_6d has them."""
    return rotations.as_matrix()[:, :2, :].reshape(-1, 6)


def of_six(numbers: np.ndarray) -> Rotation:
    rows = numbers.reshape(-1, 2, 3)
    third = np.cross(rows[:, 0], rows[:, 1])
    return Rotation.from_matrix(np.concatenate([rows, third[:, None]], axis=1))


LAYOUTS = {
    "rotvec": (Rotation.as_rotvec, Rotation.from_rotvec),
    "xyzw": (Rotation.as_quat, Rotation.from_quat),
    "wxyz": (
        lambda r: r.as_quat(scalar_first=True),
        lambda q: Rotation.from_quat(q, scalar_first=True),
    ),
    "euler:xyz": (lambda r: r.as_euler("xyz"), lambda a: Rotation.from_euler("xyz", a)),
    "euler:ZYX:deg": (
        lambda r: r.as_euler("ZYX", degrees=True),
        lambda a: Rotation.from_euler("ZYX", a, degrees=True),
    ),
    "matrix:rows": (
        lambda r: r.as_matrix().reshape(-1, 9),
        lambda m: Rotation.from_matrix(m.reshape(-1, 3, 3)),
    ),
    "6d": (six, of_six),
}
"""How each is written and read, by SciPy alone."""


def poses(first: int = 0, count: int = 16) -> tuple[np.ndarray, Rotation]:
    part = CUT[first : first + count]
    return TIPPED.apply(part.positions), TIPPED * part.rotations


def slip(positions: np.ndarray, rotations: Rotation) -> float:
    motion = ns.PoseTrajectory(np.arange(len(positions)) / RATE, positions, rotations)
    return float(np.abs(motion.body_velocities[:, 1]).max())


def shield(**more: object) -> ns.Shield:
    return ns.Shield([ns.Blade()], rate=RATE, **more)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_chunk_keeps_the_constraint_in_the_layout_in_which_it_came(layout) -> None:
    write, read = LAYOUTS[layout]
    positions, rotations = poses()
    beside = np.random.default_rng(0).normal(size=(16, 2))
    out = ActionShield(shield(), layout)(np.hstack([positions, write(rotations), beside]))
    assert slip(positions, rotations) > 1e-3
    assert slip(out[:, :3], read(out[:, 3:-2])) < 1e-10
    np.testing.assert_array_equal(out[:, -2:], beside)
    assert np.abs(out[:, :3] - positions).max() < 0.01


@pytest.mark.parametrize("layout", LAYOUTS)
def test_all_layouts_come_to_the_same_motion(layout) -> None:
    filters = [ActionShield(shield(), name) for name in ("rotvec", layout)]
    for first in (0, 8):
        positions, rotations = poses(first)
        for each, name in zip(filters, ("rotvec", layout), strict=True):
            each(np.hstack([positions, LAYOUTS[name][0](rotations)]), 8)
    motions = [each.motion for each in filters]
    np.testing.assert_allclose(motions[1].positions, motions[0].positions, atol=1e-9)
    assert (motions[1].rotations * motions[0].rotations.inv()).magnitude().max() < 1e-9


def test_it_is_what_the_shield_says_of_the_poses() -> None:
    positions, rotations = poses()
    chunk = ns.PoseTrajectory(np.arange(16) / RATE, positions, rotations)
    wanted = shield().chunk(chunk)
    out = ActionShield(shield())(np.hstack([positions, rotations.as_rotvec()]))
    np.testing.assert_allclose(out[:, :3], wanted.positions, atol=1e-12)


def test_two_arms_each_have_their_shield() -> None:
    positions, rotations = poses()
    one = np.hstack([positions, rotations.as_rotvec(), np.ones((16, 1))])
    both = np.hstack([one, one])
    right = ActionShield(shield(), columns=range(7, 13))(both)
    np.testing.assert_array_equal(right[:, :7], one)
    np.testing.assert_array_equal(right[:, 13], 1.0)
    np.testing.assert_array_equal(right[:, 7:13], ActionShield(shield())(one)[:, :6])


def test_numbers_keep_their_type() -> None:
    positions, rotations = poses()
    actions = np.hstack([positions, rotations.as_rotvec(), np.ones((16, 1))])
    single = ActionShield(shield())(actions.astype(np.float32))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, ActionShield(shield())(actions), atol=1e-5)
    assert ActionShield(shield())(actions.tolist()).dtype == np.float64


SCALE = (0.05, 0.5)
"""Of robosuite's OSC_POSE."""


def changes(positions: np.ndarray, rotations: Rotation, start: tuple) -> np.ndarray:
    """Actions as a delta controller takes them, from the pose before the first."""
    places = np.vstack([start[0], positions])
    turns = Rotation.concatenate([start[1], rotations])
    rotvec = (turns[1:] * turns[:-1].inv()).as_rotvec()
    return np.hstack([np.diff(places, axis=0) / SCALE[0], rotvec / SCALE[1]])


def carried_out(actions: np.ndarray, start: tuple) -> tuple[np.ndarray, Rotation]:
    """What such a controller makes of them: each change from the goal before."""
    position, rotation = start
    places, turns = [], []
    for action in actions:
        position = position + SCALE[0] * action[:3]
        rotation = Rotation.from_rotvec(SCALE[1] * action[3:6]) * rotation
        places.append(position)
        turns.append(rotation)
    return np.array(places), Rotation.concatenate(turns)


def test_changes_of_the_pose_keep_the_constraint_from_chunk_to_chunk() -> None:
    positions, rotations = poses(count=41)
    start = positions[0], rotations[0]
    each = ActionShield(shield(), delta=SCALE)
    each.reset(start)
    here, executed = start, []
    for first in (1, 9, 17):
        chunk = slice(first, first + 16)
        before = positions[first - 1], rotations[first - 1]
        given = changes(positions[chunk], rotations[chunk], before)
        out = each(np.hstack([given, np.ones((16, 1))]), 8 if first > 1 else None)
        np.testing.assert_array_equal(out[:, 6], 1.0)
        made = carried_out(out, here)
        np.testing.assert_allclose(made[0], each.motion.positions, atol=1e-12)
        executed.append((made[0][:8], made[1][:8]))
        here = made[0][7], made[1][7]
    places = np.vstack([start[0], *(p for p, _ in executed)])
    turns = Rotation.concatenate([start[1], *(r for _, r in executed)])
    assert slip(positions, rotations) > 1e-3
    assert slip(places, turns) < 1e-10


def test_a_change_that_a_controller_would_clip_is_told() -> None:
    positions, rotations = poses()
    start = positions[0], rotations[0]
    each = ActionShield(shield(), delta=(1e-4, 0.5))
    each.reset(start)
    given = changes(positions, rotations, start) * [500, 500, 500, 1, 1, 1]
    with pytest.warns(CompromiseWarning, match="beyond the 1 where controllers clip"):
        each(given)


def test_what_is_no_chunk_is_refused_and_nothing_has_moved() -> None:
    positions, rotations = poses()
    actions = np.hstack([positions, rotations.as_rotvec()])
    each = ActionShield(shield())
    broken = actions.copy()
    broken[3, 4] = np.nan
    assert "actions: row 3 is not finite" in refusal(InputError, each, broken)
    assert "expected shape (T, D)" in refusal(InputError, each, actions[None])
    assert "expected shape (T, D)" in refusal(InputError, each, actions[:, :5])
    np.testing.assert_array_equal(each(actions), ActionShield(shield())(actions))
    assert "changes begin at a pose" in refusal(
        InputError, ActionShield(shield(), delta=SCALE), actions
    )
    assert "give that" in refusal(InputError, ActionShield, shield(), "6d", delta=SCALE)
    assert "rotation in space" in refusal(InputError, ActionShield, shield(), "planar")
    assert "takes 9 columns" in refusal(InputError, ActionShield, shield(), "6d", columns=[0, 1, 2])
