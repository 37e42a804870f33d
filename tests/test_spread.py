"""How far demonstrations lie apart: against a direct oracle, and whatever must not matter."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import eased
from noslip._typing import Floats
from noslip.spread import Spread
from refusals import refusal

pytestmark = pytest.mark.filterwarnings("ignore:.*starts lie:noslip.errors.RecordingWarning")
"""They do so on purpose: a spread is about the primitive moved to each demonstration."""
SAMPLES = 301
SHARE = np.linspace(0, 1, SAMPLES)
BLEND = eased(SHARE)
"""Minimum jerk (Flash and Hogan 1985)."""
BUMP = (4 * SHARE * (1 - SHARE)) ** 3
"""A deviation that leaves start and goal, and the velocities there, as they are."""
PATH = np.column_stack([0.3 * SHARE, 0.05 * np.sin(4 * SHARE), 0.02 * SHARE**2])
TURN = Rotation.from_euler("ZYX", np.column_stack([SHARE, 0.3 * SHARE**2, -0.2 * SHARE]))


def demonstration(
    aside: Sequence[float] = (0, 0, 0),
    turned: Sequence[float] = (0, 0, 0),
    *,
    ends: tuple[Floats, Floats] | None = None,
    duration: float = 2.0,
    begin: float = 0.0,
) -> ns.PoseTrajectory:
    """One path with a bump aside (m) and turned (rad), between other ends, each of shape (2, 3)."""
    positions = PATH + np.outer(BUMP, aside)
    rotations = Rotation.from_rotvec(np.outer(BUMP, turned)) * TURN
    if ends is not None:
        moved, spun = (np.outer(1 - BLEND, pair[0]) + np.outer(BLEND, pair[1]) for pair in ends)
        positions, rotations = positions + moved, rotations * Rotation.from_rotvec(spun)
    return ns.PoseTrajectory(begin + duration * SHARE, positions, rotations)


def bumps(count: int = 5, seed: int = 0) -> tuple[Floats, Floats]:
    """Deviations of position (m) and rotation (rad), shape (count, 3) each."""
    rng = np.random.default_rng(seed)
    return 4e-3 * rng.normal(size=(count, 3)), 0.05 * rng.normal(size=(count, 3))


def learned_spread(
    demonstrations: Sequence[ns.PoseTrajectory], constraints: Any = (), **options: Any
) -> Spread:
    spread = ns.learn(demonstrations, constraints, basis_functions=30, **options).spread
    assert spread is not None
    return spread


def in_other_places(
    aside: Floats, turned: Floats, seed: int = 1, far: float = 0.05, spun: float = 0.1
) -> list[ns.PoseTrajectory]:
    """The same deviations with starts and goals, durations and clocks of their own."""
    rng = np.random.default_rng(seed)
    return [
        demonstration(
            a,
            t,
            ends=(far * rng.normal(size=(2, 3)), spun * rng.normal(size=(2, 3))),
            duration=rng.uniform(1, 6),
            begin=rng.uniform(-5, 100),
        )
        for a, t in zip(aside, turned, strict=True)
    ]


def together(aside: Floats, turned: Floats) -> list[ns.PoseTrajectory]:
    return [demonstration(a, t) for a, t in zip(aside, turned, strict=True)]


# -------------------------------------------------------------------- what it is


def test_it_is_the_covariance_about_the_primitive_moved_to_each_demonstration() -> None:
    demonstrations = in_other_places(*bumps())
    dmp = ns.learn(demonstrations, basis_functions=30)
    spread = dmp.spread
    assert spread is not None and spread.demonstrations == len(demonstrations)
    at = spread.fractions
    blend = eased(at)
    mean = dmp.rollout().resampled(times=dmp.duration * at)
    apart: list[Floats] = []
    for k in range(len(at)):
        rows = []
        for demo in demonstrations:
            theirs = demo.resampled(times=demo.times[0] + demo.duration * at)
            shift = theirs.positions[[0, -1]] - mean.positions[[0, -1]]
            turn = (mean.rotations[[0, -1]].inv() * theirs.rotations[[0, -1]]).as_rotvec()
            weights = np.array([1 - blend[k], blend[k]])
            own = mean.rotations[k] * Rotation.from_rotvec(weights @ turn)
            moved = theirs.positions[k] - mean.positions[k] - weights @ shift
            rows.append(np.r_[moved, (theirs.rotations[k] * own.inv()).as_rotvec()])
        apart.append(np.cov(np.array(rows), rowvar=False))
    expected = np.array(apart)
    np.testing.assert_allclose(spread.positions, expected[:, :3, :3], rtol=0, atol=1e-12)
    np.testing.assert_allclose(spread.rotations, expected[:, 3:, 3:], rtol=0, atol=1e-10)


def test_it_is_that_of_the_deviations_put_in() -> None:
    aside, turned = bumps(count=7)
    spread = learned_spread(together(aside, turned))
    height = (4 * spread.fractions * (1 - spread.fractions)) ** 3
    for found, put_in in ((spread.positions, aside), (spread.rotations, turned)):
        expected = height[:, None, None] ** 2 * np.cov(put_in, rowvar=False)
        np.testing.assert_allclose(found, expected, rtol=0, atol=0.02 * expected.max())
    largest = np.std(aside, axis=0, ddof=1)
    np.testing.assert_allclose(spread.position_deviation.max(axis=0), largest, rtol=1e-4)
    assert spread.position_deviation.shape == spread.rotation_deviation.shape


def test_covariances_are_symmetric_and_not_negative() -> None:
    # Of two demonstrations they have rank one.
    for count in (2, 3, 8):
        spread = learned_spread(in_other_places(*bumps(count)))
        for covariances in (spread.positions, spread.rotations):
            np.testing.assert_array_equal(covariances, covariances.transpose(0, 2, 1))
            values = np.linalg.eigvalsh(covariances)
            assert values.min() >= -1e-14 * values.max()
            if count == 2:
                assert values[:, 1].max() <= 1e-12 * values.max()


def test_starts_and_goals_are_no_spread() -> None:
    spread = learned_spread(in_other_places(*bumps()))
    for deviation in (spread.position_deviation, spread.rotation_deviation):
        assert deviation[[0, -1]].max() < 1e-12 < deviation.max()


# -------------------------------------------------------------------- what must not matter


def test_identical_demonstrations_have_none() -> None:
    spread = learned_spread([demonstration()] * 4)
    assert spread.demonstrations == 4
    assert spread.position_deviation.max() < 1e-12
    assert spread.rotation_deviation.max() < 1e-12


def test_one_demonstration_has_no_spread() -> None:
    assert ns.learn(demonstration(), basis_functions=30).spread is None
    assert Spread.about(ns.learn(demonstration()), [demonstration()]) is None


@pytest.mark.parametrize("seed", range(3))
def test_starts_goals_durations_and_clocks_do_not_matter(seed: int) -> None:
    aside, turned = bumps(seed=seed)
    plain = learned_spread(together(aside, turned))
    moved = learned_spread(in_other_places(aside, turned, seed=seed + 10))
    size = plain.position_deviation.max()
    np.testing.assert_allclose(
        moved.position_deviation, plain.position_deviation, rtol=0, atol=1e-9 * size
    )
    # Turns do not commute: what is left is of second order in them.
    size = plain.rotation_deviation.max()
    np.testing.assert_allclose(
        moved.rotation_deviation, plain.rotation_deviation, rtol=0, atol=0.02 * size
    )


def test_the_same_motion_to_other_goals_has_next_to_none() -> None:
    none = np.zeros((6, 3))
    spread = learned_spread(in_other_places(none, none, far=0.1, spun=0.1))
    assert spread.position_deviation.max() < 1e-12
    assert spread.rotation_deviation.max() < 0.02 * 0.1


def test_the_number_of_samples_and_the_order_do_not_matter() -> None:
    demonstrations = together(*bumps())
    spread = learned_spread(demonstrations)
    finer = [d.resampled(times=np.linspace(0, 2, 1201)) for d in demonstrations]
    for other in (learned_spread(finer), learned_spread(demonstrations[::-1])):
        for name in ("positions", "rotations"):
            found, expected = getattr(other, name), getattr(spread, name)
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * expected.max())


def test_twice_the_deviations_are_twice_the_spread() -> None:
    aside, turned = bumps()
    once, twice = (learned_spread(together(k * aside, k * turned)) for k in (1, 2))
    np.testing.assert_allclose(
        twice.position_deviation, 2 * once.position_deviation, rtol=0, atol=1e-10
    )
    size = once.rotation_deviation.max()
    np.testing.assert_allclose(
        twice.rotation_deviation, 2 * once.rotation_deviation, rtol=0, atol=0.02 * size
    )


def test_of_constraints_it_is_the_projected_demonstrations_that_count() -> None:
    contact = ns.constraints.PlaneContact(point=(0, 0, 0))
    spread = learned_spread(together(*bumps()), contact, position_weight=1.0)
    assert spread.position_deviation[:, 2].max() < 1e-9 < spread.position_deviation[:, :2].max()


# -------------------------------------------------------------------- what it takes


@pytest.mark.parametrize("count", [1, 0, -3])
def test_fewer_than_two_demonstrations_are_refused(count: int) -> None:
    with pytest.raises(ns.errors.InputError, match="2 demonstrations or more"):
        Spread(count, np.zeros((5, 3, 3)), np.zeros((5, 3, 3)))


@pytest.mark.parametrize("name", ["positions", "rotations"])
@pytest.mark.parametrize(
    "wrong", [np.zeros((5, 3)), np.zeros((5, 3, 4)), np.full((5, 3, 3), np.nan)]
)
def test_arrays_of_another_shape_or_not_finite_are_refused(name: str, wrong: Floats) -> None:
    arrays = {"positions": np.zeros((5, 3, 3)), "rotations": np.zeros((5, 3, 3)), name: wrong}
    with pytest.raises(ns.errors.InputError, match=name):
        Spread(3, **arrays)


def test_it_cannot_be_changed() -> None:
    mine = np.zeros((5, 3, 3))
    spread = Spread(3, mine, mine)
    mine[:] = 1
    assert not spread.positions.any()
    with pytest.raises(ValueError, match="read-only"):
        spread.positions[0] = 1


# -------------------------------------------------------------------- in files


@pytest.fixture(scope="module")
def dmp() -> ns.ConstrainedDMP:
    return ns.learn(in_other_places(*bumps()), [ns.Blade()], basis_functions=20)


def rewritten(path: Path, change: Callable[[dict[str, Any]], Any]) -> Path:
    """Change the content of a file and sign it again, as a program that writes such files would."""
    document = json.loads(path.read_text())
    change(document["content"])
    text = json.dumps(document["content"], sort_keys=True, separators=(",", ":"))
    document["checksum"] = "sha256:" + hashlib.sha256(text.encode()).hexdigest()
    path.write_text(json.dumps(document))
    return path


def assert_same(a: Spread | None, b: Spread | None) -> None:
    assert a is not None and b is not None
    assert a.demonstrations == b.demonstrations
    np.testing.assert_array_equal(a.positions, b.positions)
    np.testing.assert_array_equal(a.rotations, b.rotations)


def test_it_is_saved_and_loaded_to_the_bit(dmp: ns.ConstrainedDMP, tmp_path: Path) -> None:
    path = dmp.save(tmp_path / "cut.json")
    again = ns.load_primitive(path)
    assert_same(again.spread, dmp.spread)
    assert again.save(tmp_path / "again.json").read_bytes() == path.read_bytes()


def test_none_is_saved_and_loaded_too(dmp: ns.ConstrainedDMP, tmp_path: Path) -> None:
    path = replace(dmp, spread=None).save(tmp_path / "cut.json")
    assert ns.load_primitive(path).spread is None


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("spread", ...),
        ("spread", 3),
        ("spread", "wide"),
        ("demonstrations", ...),
        ("demonstrations", "five"),
        ("demonstrations", 2.5),
        ("demonstrations", 1),
        ("positions", ...),
        ("positions", "far"),
        ("positions", [[1.0, 2.0, 3.0]]),
        ("rotations", ...),
        ("rotations", [[[None] * 3] * 3]),
        ("rotations", []),
    ],
)
def test_a_damaged_field_is_named(
    dmp: ns.ConstrainedDMP, tmp_path: Path, field: str, value: Any
) -> None:
    def damage(content: dict[str, Any]) -> None:
        part = content if field == "spread" else content["spread"]
        if value is ...:
            del part[field]
        else:
            part[field] = value

    path = rewritten(dmp.save(tmp_path / "cut.json"), damage)
    message = refusal(ns.errors.InputError, ns.load_primitive, path)
    assert message.startswith(f"{path}: ") and field in message


# -------------------------------------------------------------------- a primitive in other places


def off(adapted: ns.PoseTrajectory, shown: ns.PoseTrajectory, at: Floats) -> tuple[Floats, Floats]:
    """Distance along (m) and about (rad) each axis at fractions of the durations, (K, 3) each."""
    mine, theirs = (m.resampled(times=m.times[0] + m.duration * at) for m in (adapted, shown))
    return (
        theirs.positions - mine.positions,
        (theirs.rotations * mine.rotations.inv()).as_rotvec(),
    )


def assert_within(
    dmp: ns.ConstrainedDMP, demonstrations: Sequence[ns.PoseTrajectory], share: float, turn: float
) -> None:
    """Adapted to each demonstration's ends and duration, it is as near as demonstrations are.

    Of n samples none is further from their mean than (n - 1) / sqrt(n) standard deviations; beyond
    that, a share of the path's length and a turn (rad) are left to fitting and projection.
    """
    spread, count = dmp.spread, len(demonstrations)
    assert spread is not None
    widest = (count - 1) / np.sqrt(count)
    squares = []
    for shown in demonstrations:
        adapted = dmp.adapt(
            start_position=shown.positions[0],
            start_rotation=shown.rotations[0],
            goal_position=shown.positions[-1],
            goal_rotation=shown.rotations[-1],
            duration=shown.duration,
        )
        motion = adapted.rollout()
        assert motion.duration == pytest.approx(shown.duration)
        moved, turned = off(motion, shown, spread.fractions)
        room = share * shown.path_length
        assert np.all(np.abs(moved) <= widest * spread.position_deviation + room)
        assert np.all(np.abs(turned) <= widest * spread.rotation_deviation + turn)
        squares.append(moved**2)
        assert_same(adapted.spread, spread)
    rms = np.sqrt(np.sum(squares, axis=0).mean() / (count - 1))
    expected = np.sqrt(np.mean(spread.position_deviation**2))
    assert rms == pytest.approx(expected, rel=0.1)


def test_adapted_to_each_demonstration_it_stays_within_their_spread() -> None:
    demonstrations = in_other_places(*bumps())
    dmp = ns.learn(demonstrations, basis_functions=60)
    assert_within(dmp, demonstrations, share=1e-5, turn=np.radians(0.3))


def test_so_it_does_under_a_constraint() -> None:
    """Demonstrations that keep it already, each a path of its own with the blade along it."""
    rng = np.random.default_rng(4)
    demonstrations = []
    for _ in range(6):
        goal = [0.3, 0.1, 0.0] + 0.02 * rng.normal(size=3)
        path = np.outer(SHARE, goal) + np.outer(BUMP, 0.01 * rng.normal(size=3))
        path += 0.02 * rng.normal(size=3)
        along = np.gradient(path, SHARE, axis=0)
        yaw = np.arctan2(along[:, 1], along[:, 0])
        demonstrations.append(
            ns.PoseTrajectory(rng.uniform(2, 5) * SHARE, path, Rotation.from_euler("z", yaw))
        )
    dmp = ns.learn(demonstrations, ns.Blade(), basis_functions=60)
    assert_within(dmp, demonstrations, share=1e-3, turn=np.radians(1))


# -------------------------------------------------------------------- recordings


def contour(recordings: Path, *names: str) -> list[ns.PoseTrajectory]:
    folder = recordings / "contour_following"
    raw = ns.load_demonstrations([folder / f"data_demo_{name}.csv" for name in names])
    return [ns.prepare(run, trim_speed=0.05, rate=120, lowpass=4.8) for run in raw]


@pytest.mark.recordings
@pytest.mark.parametrize(
    ("names", "moved", "turned"),
    [
        # The contour stood turned from a to b to c: a fifth of their extent, in world axes.
        (("a_1", "a_2", "b_1", "b_2", "c_1"), (0.03, 0.1), (15, 45)),
        (("c_1", "c_2", "d_1", "d_2"), (0.004, 0.02), (3, 10)),
    ],
)
def test_recordings_have_a_spread_of_plausible_size(
    recordings: Path,
    names: tuple[str, ...],
    moved: tuple[float, float],
    turned: tuple[float, float],
) -> None:
    demonstrations = contour(recordings, *names)
    dmp = ns.learn(demonstrations, ns.Blade())
    spread = dmp.spread
    assert spread is not None and spread.demonstrations == len(names)
    assert moved[0] < spread.position_deviation.max() < moved[1]
    assert turned[0] < np.degrees(spread.rotation_deviation.max()) < turned[1]
    assert spread.position_deviation[[0, -1]].max() < 1e-9


@pytest.mark.recordings
def test_adapted_to_each_recording_it_stays_within_their_spread(recordings: Path) -> None:
    # All of one placement, as they are without slip: the spread is that of these.
    blade = ns.Blade()
    demonstrations = contour(recordings, "c_1", "c_2", "d_1", "d_2")
    dmp = ns.learn(demonstrations, blade)
    # With their ends kept, as learning does.
    projected = [
        ns.project_trajectory(shown, blade, end="position").trajectory for shown in demonstrations
    ]
    assert_within(dmp, projected, share=5e-3, turn=np.radians(1))
    assert_within(dmp, demonstrations, share=5e-3, turn=np.radians(8))
