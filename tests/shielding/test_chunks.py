"""Chunks of actions: what comes back keeps the constraints, goes on smoothly and stays near."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from measures import apart, assert_same_poses, forward_speed, residuals, rms, slip, steps
from noslip._typing import Floats
from noslip.constraints.declaration import CATALOG
from noslip.errors import CompromiseWarning, InputError
from noslip.projection.trajectory import project
from noslip.shielding import chunks
from refusals import refusal

RATE = 30.0
NOISE, TURN_NOISE = 1e-3, np.radians(0.6)
BLADE = ns.Blade()


@dataclass(frozen=True)
class Sent:
    """A chunk, what it was before noise, what came back, and how much of it was executed."""

    meant: ns.PoseTrajectory
    asked: ns.PoseTrajectory
    motion: ns.Motion
    executed: int
    told: str


def timed(positions: Floats, rotations: Rotation) -> ns.PoseTrajectory:
    return ns.PoseTrajectory(np.arange(len(positions)) / RATE, positions, rotations)


def noisy(motion: ns.PoseTrajectory, rng: np.random.Generator) -> ns.PoseTrajectory:
    shifts, turns = rng.normal(size=(2, len(motion), 3))
    rotations = Rotation.from_rotvec(TURN_NOISE * turns) * motion.rotations
    return replace(motion, positions=motion.positions + NOISE * shifts, rotations=rotations)


def sent(
    shield: ns.Shield,
    motion: ns.PoseTrajectory,
    size: int,
    *,
    rng: np.random.Generator | None = None,
    executed: int | None = None,
) -> Iterator[Sent]:
    """Chunks of a motion one after another, with noise and random shares executed."""
    k, done = 0, None
    while k + size <= len(motion):
        meant = asked = motion[k : k + size]
        share = executed or size
        if rng is not None:
            asked, share = noisy(meant, rng), executed or int(rng.integers(1, size + 1))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CompromiseWarning)
            found = shield.chunk(asked, done)
        yield Sent(meant, asked, found, share, shield.compromise)
        k, done = k + share, share


def executed(parts: list[Sent]) -> ns.PoseTrajectory:
    """The motion that a tool makes of them."""
    times, positions, quaternions = (
        np.concatenate([getattr(each.motion, name)[: each.executed] for each in parts])
        for name in ("times", "positions", "quaternions")
    )
    return ns.PoseTrajectory(times, positions, Rotation.from_quat(quaternions, scalar_first=True))


def together(one: ns.PoseTrajectory, other: ns.PoseTrajectory) -> ns.PoseTrajectory:
    turns = np.vstack([one.quaternions, other.quaternions])
    return timed(
        np.vstack([one.positions, other.positions]),
        Rotation.from_quat(turns, scalar_first=True),
    )


def wandering(seed: int, count: int = 240) -> ns.PoseTrajectory:
    """A blade that cuts along random curves, exactly, with changes of speed and rests."""
    rng, t = np.random.default_rng(seed), np.arange(count) / RATE
    waves, phases = rng.uniform(0.5, 2.5, (2, 3)), rng.uniform(0, 6, (2, 3))
    turns = rng.uniform(0.2, 0.8, 3) * np.sin(np.outer(t, waves[0]) + phases[0])
    speeds = 0.08 * np.maximum(np.sin(waves[1, 0] * t + phases[1, 0]) + 0.6, 0.0)
    plunges = 0.02 * np.sin(waves[1, 1] * t)
    return cutting(Rotation.from_rotvec(turns), np.column_stack([speeds, 0 * t, plunges])[1:])


def cutting(rotations: Rotation, velocities: Floats) -> ns.PoseTrajectory:
    """A tool with these velocities in its own frame in the middle of each step (m/s)."""
    turns = (rotations[1:] * rotations[:-1].inv()).as_rotvec()
    middles = Rotation.from_rotvec(turns / 2) * rotations[:-1]
    ways = np.cumsum(middles.apply(velocities), axis=0) / RATE
    return timed(np.vstack([np.zeros(3), ways]), rotations)


def straight(count: int = 120, speed: float = 0.1) -> ns.PoseTrajectory:
    """Along x, and the blade too."""
    t = np.arange(count) / RATE
    return timed(np.outer(speed * t, [1, 0, 0]), Rotation.identity(count))


def placed(motion: ns.PoseTrajectory, shift: Floats, turn: Rotation) -> ns.PoseTrajectory:
    """The same motion in another frame."""
    return replace(
        motion,
        positions=turn.apply(motion.positions) + shift,
        rotations=turn * motion.rotations,
        linear_velocities=None,
        angular_velocities=None,
    )


# ---------------------------------------------------------------- noise, joins


@pytest.mark.parametrize("size", [16, 50, 100])
def test_noisy_chunks_go_on_without_slip_or_jolt_and_near_what_was_meant(size: int) -> None:
    moved, turned, off, turned_off = [], [], [], []
    at_joins, elsewhere = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        parts = list(sent(ns.Shield(BLADE, rate=RATE), wandering(seed), size, rng=rng))
        assert not any(each.told for each in parts)
        motion = executed(parts)
        np.testing.assert_allclose(motion.times, np.arange(len(motion)) / RATE, atol=1e-12)
        assert np.abs(slip(motion)).max() <= 1e-10
        joined, rest = jumps(motion, parts)
        at_joins.append(joined)
        elsewhere.append(rest)
        for each in parts:
            for reference, far, angles in (
                (each.asked, moved, turned),
                (each.meant, off, turned_off),
            ):
                far.extend(np.linalg.norm(each.motion.positions - reference.positions, axis=1))
                angles.extend((each.motion.rotations * reference.rotations.inv()).magnitude())
    assert np.quantile(moved, 0.95) < 3 * NOISE
    assert np.quantile(turned, 0.95) < 3 * TURN_NOISE
    # Nearer to what was meant than the command is, whose noise is as large along each axis.
    assert rms(np.array(off)) < 0.5 * np.sqrt(3) * NOISE
    assert rms(np.array(turned_off)) < 0.6 * np.sqrt(3) * TURN_NOISE
    # The twist changes where chunks are joined as it does elsewhere.
    joined, rest = np.vstack(at_joins), np.vstack(elsewhere)
    for k in range(2):
        assert rms(joined[:, k]) < 1.3 * rms(rest[:, k])
        assert joined[:, k].max() < 1.3 * rest[:, k].max()


def jumps(motion: ns.PoseTrajectory, parts: list[Sent]) -> tuple[Floats, Floats]:
    """Changes of linear and angular velocity, shape (N, 2): where chunks are joined, elsewhere."""
    found = steps(motion)
    changes = np.column_stack(
        [np.linalg.norm(np.diff(v, axis=0), axis=1) for v in (found.linear, found.angular)]
    )
    # Step k - 1 leads across the join before sample k.
    joined = np.zeros(len(changes), dtype=bool)
    for k in np.cumsum([each.executed for each in parts])[:-1]:
        joined[max(k - 2, 0) : k] = True
    return changes[joined], changes[~joined]


def test_a_tool_at_rest_is_not_turned_by_noise() -> None:
    rng = np.random.default_rng(0)
    rest = timed(np.tile([0.5, 0.1, 0.2], (150, 1)), Rotation.identity(150))
    for size in (16, 50):
        parts = list(sent(ns.Shield(BLADE, rate=RATE), rest, size, rng=rng))
        motion = executed(parts)
        assert np.degrees(motion.rotations.magnitude().max()) < 3.0
        assert np.linalg.norm(motion.positions - rest.positions[0], axis=1).max() < 3 * NOISE
        assert np.abs(slip(motion)).max() <= 1e-10


def test_a_blade_that_backs_up_stays_as_it_is_held() -> None:
    rng, t = np.random.default_rng(0), np.arange(240) / RATE
    there_and_back = timed(np.outer(0.05 * np.sin(1.5 * t), [1, 0, 0]), Rotation.identity(len(t)))
    motion = executed(list(sent(ns.Shield(BLADE, rate=RATE), there_and_back, 16, rng=rng)))
    assert np.degrees(motion.rotations.magnitude().max()) < 3.0
    assert forward_speed(motion).min() < -0.05
    assert np.abs(slip(motion)).max() <= 1e-10


@pytest.mark.parametrize(("rate", "size"), [(5, 4), (10, 4), (30, 4), (100, 8), (200, 16)])
def test_short_chunks_of_any_rate_do_not_run_away(rate: float, size: int) -> None:
    # All of each is executed: nothing of it is ever commanded again.
    rng, motion = np.random.default_rng(0), wandering(1).resampled(rate=rate)
    chunks = sent(ns.Shield(BLADE, rate=rate), motion[: 80 * size], size, rng=rng, executed=size)
    ends = np.array([each.motion.end_error for each in chunks])
    assert ends[len(ends) // 2 :].max() < 15 * NOISE


# ---------------------------------------------------------------- what fits is left alone


@given(seed=st.integers(0, 2**32 - 1), size=st.integers(4, 60))
def test_what_keeps_the_constraints_comes_back_as_it_is(seed: int, size: int) -> None:
    motion = wandering(seed, count=120)
    for each in sent(ns.Shield(BLADE, rate=RATE), motion, size, executed=max(3, size // 2)):
        assert apart(each.motion, each.asked)[0] <= 1e-9
        assert (each.motion.rotations * each.asked.rotations.inv()).magnitude().max() <= 1e-9
        assert not each.told


def test_a_chunk_that_begins_elsewhere_is_led_to_though_it_fits_by_itself() -> None:
    motion, shield = straight(), ns.Shield(BLADE, rate=RATE)
    first = shield.chunk(motion[:30])
    ahead = replace(motion[30:60], positions=motion.positions[30:60] + [0.02, 0, 0])
    second = shield.chunk(ahead)
    speeds = np.linalg.norm(np.diff(np.vstack([first.positions, second.positions]), axis=0), axis=1)
    assert speeds.max() * RATE < 0.2
    assert np.abs(np.diff(speeds)).max() * RATE < 0.06
    assert second.end_error < 1e-3


@given(seed=st.integers(0, 2**32 - 1))
def test_the_frame_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    motion = noisy(wandering(seed, count=60), rng)
    shift, turn = rng.uniform(-1, 1, 3), Rotation.random(rng=rng)
    one, other = ns.Shield(BLADE, rate=RATE), ns.Shield(BLADE, rate=RATE)
    for k in (0, 20):
        part = motion[k : k + 40]
        done = 20 if k else None
        found = one.chunk(part, done)
        again = other.chunk(placed(part, shift, turn), done)
        back = placed(again, -turn.inv().apply(shift), turn.inv())
        assert apart(back, found)[0] < 1e-6
        assert (back.rotations * found.rotations.inv()).magnitude().max() < 1e-5


def test_how_often_it_is_asked_hardly_matters() -> None:
    # No noise, but a blade that is held up to 3 degrees beside its path.
    t = np.arange(240) / RATE
    turns = np.outer(0.5 * np.sin(0.8 * t), [0, 0, 1])
    aside = Rotation.from_rotvec(np.outer(0.05 * np.sin(0.5 * t), [0, 0, 1]))
    exact = cutting(Rotation.from_rotvec(turns), np.tile([0.1, 0, 0], (len(t) - 1, 1)))
    motion = timed(exact.positions, aside * exact.rotations)
    often, seldom = (
        executed(list(sent(ns.Shield(BLADE, rate=RATE), motion, 60, executed=share)))
        for share in (10, 30)
    )
    count = min(len(often), len(seldom))
    far, angle = apart(often[:count], seldom[:count])
    assert far < 1e-3
    assert angle < 1.0


# ---------------------------------------------------------------- bookkeeping


def test_it_goes_on_from_the_last_executed_pose() -> None:
    motion, shield = noisy(straight(), np.random.default_rng(0)), ns.Shield(BLADE, rate=RATE)
    first = shield.chunk(motion[:16])
    second = shield.chunk(motion[10:26], 10)
    assert first.times[0] == 0.0
    assert second.times[0] == pytest.approx(10 / RATE)
    assert np.abs(slip(together(first[:10], second))).max() <= 1e-10
    # Of the motion itself as well: its first step leads from there.
    np.testing.assert_allclose(
        second.linear_velocities[0], (second.positions[0] - first.positions[9]) * RATE, atol=1e-12
    )
    # None was carried out: once more from there.
    assert_same_poses(shield.chunk(motion[10:26], 0), second)


def test_it_begins_near_its_own_first_pose_or_at_rest_where_it_is_put() -> None:
    motion = noisy(straight(), np.random.default_rng(0))
    shield = ns.Shield(BLADE, rate=RATE)
    assert np.linalg.norm(shield.chunk(motion[:16]).positions[0] - motion.positions[0]) < 3 * NOISE
    position, rotation = np.array([0.0, 0.003, 0.0]), Rotation.from_euler("z", 2, degrees=True)
    shield.reset((position, rotation))
    found = shield.chunk(motion[:16])
    assert found.times[0] == pytest.approx(1 / RATE)
    assert np.linalg.norm(found.positions[0] - position) * RATE < 0.05
    assert np.degrees((found.rotations[0] * rotation.inv()).magnitude()) < 0.5
    shield.reset()
    assert shield.chunk(motion[:16]).times[0] == 0.0


def test_what_is_said_of_a_motion() -> None:
    motion = noisy(straight(), np.random.default_rng(0))[:30]
    found = ns.Shield(BLADE, rate=RATE, limits=ns.SpeedLimit(speed=0.5)).chunk(motion)
    assert found.constraint_names == ("blade",)
    assert found.limit_names == ("speed-limit",)
    assert np.abs(found.constraint_residuals).max() <= 1e-10
    assert found.margins.min() > 0
    far = np.linalg.norm(found.positions - motion.positions, axis=1)
    assert found.path_error == pytest.approx(far.max())
    assert found.end_error == pytest.approx(far[-1])
    assert found.end_rotation_error == pytest.approx(
        (found.rotations[-1] * motion.rotations[-1].inv()).magnitude()
    )
    assert ns.check(found, [BLADE]).satisfied


@pytest.mark.parametrize("count", [-1, 17, 2.5, True, "all"])
def test_more_cannot_be_executed_than_was_sent(count: object) -> None:
    shield = ns.Shield(BLADE, rate=RATE)
    shield.chunk(straight()[:16])
    said = refusal(InputError, shield.chunk, straight()[:16], count)
    assert "0 to 16" in said


def test_chunks_of_another_rate_or_too_short_are_refused() -> None:
    shield = ns.Shield(BLADE, rate=20)
    assert "rate=20" in refusal(InputError, shield.chunk, straight()[:16])
    assert "step()" in refusal(InputError, ns.Shield(BLADE, rate=RATE).chunk, straight()[:3])
    assert "4 to 1000" in refusal(InputError, ns.Shield(BLADE, rate=RATE).chunk, straight(1001))
    assert "PoseTrajectory" in refusal(InputError, shield.chunk, np.zeros((16, 7)))


# ---------------------------------------------------------------- what cannot be followed


def require_calm(motion: ns.PoseTrajectory) -> None:
    """Moves and turns no faster than may be of a hand's pace: four times 0.1 m/s, 2 rad/s.

    A command that jumps by 0.1 m makes it 0.7 m/s, smoothed.
    """
    assert np.linalg.norm(steps(motion).linear, axis=1).max() < 0.7
    assert np.linalg.norm(steps(motion).angular, axis=1).max() < 8.0
    assert np.linalg.norm(np.diff(steps(motion).angular, axis=0), axis=1).max() < 2.0


@pytest.mark.parametrize("size", [16, 50])
def test_a_goal_that_jumps_aside_is_steered_to_gently_and_told(size: int) -> None:
    count = 450
    meant = straight(count)
    aside = np.where(np.arange(count)[:, None] >= 90, [0.0, 0.1, 0.0], 0.0)
    motion = replace(meant, positions=meant.positions + aside)
    rng = np.random.default_rng(0)
    parts = list(sent(ns.Shield(BLADE, rate=RATE), motion, size, rng=rng, executed=size // 2))
    found = executed(parts)
    assert any("off" in each.told for each in parts)
    assert np.abs(slip(found)).max() <= 1e-10
    off = np.linalg.norm(found.positions - motion.positions[: len(found)], axis=1)
    assert off[-1] < 0.03
    require_calm(found)


@pytest.mark.parametrize("size", [16, 50])
def test_a_blade_that_is_sent_across_is_told_and_stays_calm(size: int) -> None:
    count = 300
    across = timed(np.outer(np.arange(count) / RATE, [0, 0.1, 0]), Rotation.identity(count))
    rng = np.random.default_rng(0)
    parts = list(sent(ns.Shield(BLADE, rate=RATE), across, size, rng=rng, executed=size // 2))
    found = executed(parts)
    assert all(each.told for each in parts[4:])
    assert np.abs(slip(found)).max() <= 1e-10
    require_calm(found)


@ns.position_constraint
def nowhere(motion: ns.constraints.Instant) -> Floats:
    return motion.position[2] ** 2 + 1


def test_where_nothing_keeps_the_constraints_it_holds_and_says_so() -> None:
    motion = noisy(straight(), np.random.default_rng(0))
    shield = ns.Shield(nowhere, rate=RATE)
    with pytest.warns(CompromiseWarning, match="nowhere: holds at once"):
        found = shield.chunk(motion[:16])
    assert np.ptp(found.positions, axis=0).max() == 0.0
    assert "holds" in shield.compromise


def test_where_no_projection_converges_it_brakes_along_its_constraints_and_rests(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    motion, shield = wandering(3), ns.Shield(BLADE, rate=RATE)
    first = shield.chunk(motion[:30])
    monkeypatch.setattr(
        chunks, "project", lambda request, **_: replace(project(request), converged=False)
    )
    with pytest.warns(CompromiseWarning, match="blade: brakes and holds"):
        second = shield.chunk(noisy(motion[30:60], np.random.default_rng(0)))
    found = steps(both := together(first, second))
    assert np.abs(slip(both)).max() <= 1e-10
    assert not found.linear[-8:].any()
    assert not found.angular[-8:].any()
    for velocities in (found.linear, found.angular):
        changes = np.linalg.norm(np.diff(velocities, axis=0), axis=1)
        assert changes[29:].max() < 3 * changes[:28].max()


# ---------------------------------------------------------------- limits


def test_a_sphere_in_the_way_is_passed() -> None:
    sphere = ns.KeepOutSphere(center=(0.2, 0.01, 0.0), radius=0.02)
    rng = np.random.default_rng(0)
    shield = ns.Shield(BLADE, rate=RATE, limits=sphere)
    parts = list(sent(shield, straight(150), 30, rng=rng, executed=15))
    motion = executed(parts)
    away = np.linalg.norm(motion.positions - sphere.center, axis=1)
    assert away.min() >= sphere.radius - 1e-9
    assert np.abs(slip(motion)).max() <= 1e-10
    assert parts[-1].motion.end_error < 0.01


def test_before_a_wall_the_tool_waits_and_is_told_of() -> None:
    wall = ns.constraints.HalfSpace(point=(0.2, 0.0, 0.0), normal=(-1.0, 0.0, 0.0))
    rng = np.random.default_rng(0)
    shield = ns.Shield(BLADE, rate=RATE, limits=[wall])
    parts = list(sent(shield, straight(150), 16, rng=rng, executed=8))
    motion = executed(parts)
    assert motion.positions[:, 0].max() <= 0.2 + 1e-9
    assert motion.positions[-1, 0] > 0.195
    assert "off" in parts[-1].told
    assert np.abs(slip(motion)).max() <= 1e-10


def test_a_speed_limit_makes_it_late_not_faster() -> None:
    rng = np.random.default_rng(0)
    shield = ns.Shield(BLADE, rate=RATE, limits=ns.SpeedLimit(speed=0.08))
    motion = executed(list(sent(shield, straight(150), 16, rng=rng, executed=8)))
    assert np.linalg.norm(steps(motion).linear, axis=1).max() <= 0.08 + 1e-9
    assert np.linalg.norm(steps(motion).linear, axis=1).mean() > 0.075


def test_an_acceleration_limit_holds_across_joins() -> None:
    rng, limit = np.random.default_rng(0), 0.15
    shield = ns.Shield(BLADE, rate=RATE, limits=ns.constraints.AccelerationLimit(linear=limit))
    motion = executed(list(sent(shield, straight(100), 20, rng=rng, executed=10)))
    changes = np.linalg.norm(np.diff(steps(motion).linear, axis=0), axis=1) * RATE
    assert changes.max() <= limit + 1e-6


@pytest.mark.parametrize("name", sorted(set(CATALOG) - {"joint-limits"}))
def test_each_constraint_is_kept(name: str) -> None:
    rng, constraint = np.random.default_rng(0), CATALOG[name]()
    motion = placed(wandering(2, count=70), np.array([0.02, 0.01, 0.3]), Rotation.identity())
    shield = ns.Shield(constraint, rate=RATE)
    for each in sent(shield, motion, 16, rng=rng, executed=12):
        assert "holds at once" not in each.told
        assert np.abs(each.motion.constraint_residuals).max(initial=0.0) <= 1e-10
        assert each.motion.margins.min(initial=0.0) >= -1e-9


# ---------------------------------------------------------------- recordings


@pytest.mark.recordings
@pytest.mark.parametrize(
    ("folder", "constraint", "loading"),
    [
        ("contour_following", BLADE, {}),
        ("needle_insertion", ns.Needle(shaft="-x", curvature=None), {"rate": 14.5}),
        ("wheeled_robots", ns.Wheel(), {}),
    ],
)
def test_recorded_tools_are_shielded(
    folder: str, constraint: ns.Constraint, loading: dict[str, float], recordings: Path
) -> None:
    files = sorted((recordings / folder).glob("*.csv"))[:3]
    moved, turned = [], []
    for seed, recorded in enumerate(ns.load_demonstrations(files, **loading)):
        rng, motion = np.random.default_rng(seed), recorded.resampled(rate=RATE)[:300]
        for size in (16, 50, 100):
            parts = list(sent(ns.Shield(constraint, rate=RATE), motion, size, rng=rng))
            assert np.abs(residuals(executed(parts), [constraint])).max() <= 1e-10
            for each in parts:
                far = np.linalg.norm(each.motion.positions - each.asked.positions, axis=1)
                moved.extend(far)
                between = each.motion.rotations * each.asked.rotations.inv()
                turned.extend(between.magnitude())
    # The recordings themselves slip, by up to 14 % of their way.
    assert np.median(moved) < 3 * NOISE
    assert np.median(turned) < 3 * TURN_NOISE
