"""Streams of commands: slip, speed, lag, rest, drop-outs, jumps, what is measured; and their C."""

from __future__ import annotations

import copy
import json
import pickle
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from streams import HANDS, RATE, Followed, followed, recorded

import noslip as ns
from measures import degrees, speed_along
from noslip._typing import Floats
from noslip.errors import InputError
from objects import objects

CC = shutil.which("cc")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-O1")
X, Y, Z = np.eye(3)
RUNS: dict[str, tuple[ns.Constraint, list[Floats], float]] = {
    "contour_following/data_demo_a_1.csv": (ns.Blade(), [Y], 12),
    "contour_following/data_demo_d_2.csv": (ns.Blade(), [Y], 12),
    "needle_insertion/trial_01.csv": (ns.Needle(shaft="-x"), [Y, Z], 8),
    "wheeled_robots/diff_free__030120210006_run-01.csv": (ns.Wheel(), [Y], 12),
    "wheeled_robots/diff_square__230620202042_run-04.csv": (ns.Wheel(), [Y], 25),
}
"""Recordings, their constraint, the axes along which it forbids to move, and seconds of them."""
RESTED = slice(-200, None)
"""Samples of the last fifth of a second, long after the hand has come to rest."""


def slip(found: Followed, axes: list[Floats]) -> float:
    """Largest speed along axes, from the commanded poses alone (m/s)."""
    return max(float(np.abs(speed_along(found.tool, axis)).max()) for axis in axes)


def made_for(*constraints: ns.Constraint) -> ns.Shield:
    shield = ns.Shield(constraints, rate=RATE)
    assert shield._follower.wait()
    return shield


@pytest.mark.recordings
@pytest.mark.parametrize("run", RUNS)
def test_recorded_hands_are_followed_without_slip(
    run: str, recordings: Path, compiling: Path
) -> None:
    constraint, axes, seconds = RUNS[run]
    hand, shield = recorded(recordings, run, seconds), made_for(constraint)
    for seed, lag in ((1, 0), (2, 100)):
        found = followed(shield, hand, seed, lag)
        assert slip(found, axes) <= 1e-10
        assert found.turned_faster <= 2
        # As told: of a fast hand 60 ms, of a slow one 200 ms.
        assert 0.06 <= found.lag <= 0.2
        assert found.off(round(found.lag * RATE)).max() <= 3e-3
        # 0.01 rad/s of noise are left, and no spin.
        assert np.linalg.norm(found.angular[RESTED], axis=1).max() <= 0.03


@pytest.mark.parametrize("name", HANDS)
def test_made_up_hands_are_followed_without_slip(name: str, compiling: Path) -> None:
    hand, shield = HANDS[name](), made_for(ns.Blade())
    turns = np.linalg.norm(hand.step_velocities()[1], axis=1).max() > 0.1
    for seed, lag in ((None, None), (1, 100)):
        found = followed(shield, hand, seed, lag)
        assert slip(found, [Y]) <= 1e-10
        if turns:
            assert found.turned_faster <= 2
        rested = np.linalg.norm(found.angular[RESTED], axis=1).max()
        assert rested <= (1e-3 if seed is None else 0.03)
        assert found.distances[-1] <= 5e-3
        np.testing.assert_allclose(
            found.distances[-1],
            np.linalg.norm(hand.positions[-1] - found.tool.positions[-1]),
            atol=1e-12 if seed is None else 3e-3,
        )


def test_a_feasible_hand_is_reached(compiling: Path) -> None:
    found = followed(made_for(ns.Blade()), HANDS["a turn in place"](), seed=None)
    assert found.distances[-1] <= 1e-12
    assert found.angles[-1] <= 1e-4
    # Critically damped: it comes from behind and never overshoots.
    yaw = found.tool.rotations.as_rotvec()[:, 2]
    assert (np.diff(yaw) >= -1e-12).all()
    assert yaw.max() <= 1 + 1e-9


def test_a_tool_pushed_straight_aside_stays_and_says_how_far(compiling: Path) -> None:
    shield = made_for(ns.Blade())
    shield.reset((np.zeros(3), Rotation.identity()))
    for k in range(3000):
        aside = np.array([0.0, min(k, 1000) * 5e-5, 0.0])
        state = shield.step((aside, Rotation.identity()))
    assert np.abs(state.vector()[[0, 1, 2]]).max() <= 1e-12
    assert np.abs(state.angular_velocity).max() <= 1e-12
    np.testing.assert_allclose(shield.distance, 0.05, rtol=1e-12)
    assert shield.angle <= 1e-12


def test_the_angle_is_that_between_command_and_tool(compiling: Path) -> None:
    shield = made_for(ns.Blade())
    turned = Rotation.from_rotvec([0.3, -0.2, 0.5])
    shield.reset((np.zeros(3), Rotation.identity()))
    state = shield.step((np.zeros(3), turned))
    assert degrees(state.rotation, turned) == pytest.approx(np.degrees(shield.angle), abs=1e-6)
    assert shield.angle > 0.5


def test_a_jump_is_followed_within_the_speed_that_the_hand_had(compiling: Path) -> None:
    shield = made_for(ns.Blade())
    speeds = []
    for k in range(8000):
        x = 0.05 * min(k, 2000) * 1e-3 + (0.1 if k > 4000 else 0.0)
        speeds.append(np.linalg.norm(shield.step((x * X, Rotation.identity())).linear_velocity))
    # It began at once, which is smoothed the less the faster it goes.
    assert max(speeds[:4000]) <= 1.1 * 0.05
    assert max(speeds) <= 2 * 0.05
    assert shield.distance <= 1e-4


def test_a_tool_that_must_not_turn_fast_is_not_turned_fast(compiling: Path) -> None:
    limit = ns.constraints.AngularRateLimit(rate=0.2)
    shield = ns.Shield(ns.Blade(), rate=RATE, limits=[limit, ns.SpeedLimit(speed=0.03)])
    found = followed(shield, HANDS["a wave"](), seed=3)
    assert np.linalg.norm(found.angular, axis=1).max() <= 0.2 * (1 + 1e-9)
    assert np.linalg.norm(found.linear, axis=1).max() <= 0.03 * (1 + 1e-9)
    assert slip(found, [Y]) <= 1e-10


def test_a_tool_stays_out_of_an_obstacle_that_the_hand_enters(compiling: Path) -> None:
    ball = ns.KeepOutSphere(center=(0.15, 0.0, 0.0), radius=0.03)
    found = followed(ns.Shield(ns.Blade(), rate=RATE, limits=ball), HANDS["a wave"](), seed=4)
    apart = np.linalg.norm(found.tool.positions - [0.15, 0, 0], axis=1)
    assert np.linalg.norm(found.hand.positions - [0.15, 0, 0], axis=1).min() < 0.02
    assert apart.min() >= 0.03 - 1e-9
    assert slip(found, [Y]) <= 1e-10


def test_without_commands_it_goes_on_to_the_last_and_rests(compiling: Path) -> None:
    shield = made_for(ns.Blade())
    for k in range(1000):
        shield.step((1e-4 * k * X, Rotation.identity()))
    assert shield.distance > 5e-3
    for _ in range(2000):
        state = shield.step()
    assert shield.distance <= 1e-6
    assert np.abs(state.linear_velocity).max() <= 1e-6


def test_commands_that_come_seldom_are_followed_as_smoothly(compiling: Path) -> None:
    """A hand of 30 Hz, held in between, is no series of jumps."""
    hand = HANDS["a wave"]()
    seldom = np.arange(len(hand)) // 33 * 33
    held = ns.PoseTrajectory(hand.times, hand.positions[seldom], hand.rotations[seldom])
    found = followed(made_for(ns.Blade()), held, seed=None)
    speed = np.linalg.norm(hand.step_velocities()[1], axis=1).max()
    assert np.linalg.norm(found.angular, axis=1).max() <= 1.2 * speed
    assert np.linalg.norm(found.tool.positions - hand.positions, axis=1)[-1] <= 1e-3


def test_what_is_not_finite_is_refused_and_the_state_kept(compiling: Path) -> None:
    shield = made_for(ns.Blade())
    for k in range(50):
        shield.step((1e-4 * k * X, Rotation.identity()))
    twin = copy.deepcopy(shield)
    for bad in ((np.nan, 0, 0), (0, np.inf, 0)):
        with pytest.raises(InputError, match=r"^command: not finite: x, y, z"):
            shield.step((np.array(bad), Rotation.identity()))
    # A measurement that was lost is none.
    lost = np.array([np.nan, 0, 0]), Rotation.identity()
    one, other = shield.step(None, lost), twin.step()
    np.testing.assert_array_equal(one.vector(), other.vector())
    # Finite, but from one to the other it is not.
    kept = shield.step((1e308 * X, Rotation.identity()))
    with pytest.raises(InputError, match="the state is kept"):
        shield.step((-1e308 * X, Rotation.identity()))
    np.testing.assert_array_equal(shield._follower.state.vector(), kept.vector())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (None, "command: none came yet; give the first, or the pose at a reset"),
        ((0, 0, 0), "command must be a State or a pair (position, Rotation), got tuple"),
        ((np.zeros(2), Rotation.identity()), "command: a position has shape (3,), got (2,)"),
        ((np.zeros(3), np.eye(3)), "command: a Rotation stands second, got ndarray"),
        ((np.zeros(3), Rotation.identity(2)), "command: one rotation stands second, got 2"),
        (("a", Rotation.identity()), "command: a position is 3 numbers, got 'a'"),
    ],
)
def test_what_is_no_command_is_refused(given: object, message: str) -> None:
    with pytest.raises(InputError) as refused:
        ns.Shield(ns.Blade(), rate=RATE).step(given)  # type: ignore[arg-type]
    assert str(refused.value) == message


def test_a_tool_that_stands_is_waited_for_and_one_that_lags_is_not(compiling: Path) -> None:
    hand = HANDS["pauses"]()

    def commanded(stuck: bool) -> Floats:
        shield, x = made_for(ns.Blade()), []
        for k, position in enumerate(hand.positions[:1500]):
            held = k - 100 if not stuck or k < 700 else 600
            seen = (np.array([x[max(held, 0)], 0, 0]) if x else np.zeros(3)), Rotation.identity()
            x.append(shield.step((position, Rotation.identity()), seen).position[0])
        return np.array(x)

    free, stuck = commanded(False), commanded(True)
    np.testing.assert_allclose(free, [s.position[0] for s in _unmeasured(hand, 1500)], atol=1e-9)
    # It stops within a band of lag, noise and bias of where the tool stands.
    assert stuck[-1] - stuck[600] < 0.6 * (free[-1] - free[600])
    assert stuck[-1] - stuck[-100] < 1e-4
    assert free[-1] - free[-100] > 5e-4


def _unmeasured(hand: ns.PoseTrajectory, count: int) -> list[ns.State]:
    shield = made_for(ns.Blade())
    return [shield.step((p, Rotation.identity())) for p in hand.positions[:count]]


def test_machine_code_makes_the_steps_of_the_virtual_machine(
    compiling: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hand = HANDS["a push aside"]()[:1500]
    sphere = ns.KeepOutSphere(center=(0.05, 0.0, 0.0), radius=0.01)
    for constraints in ([ns.Blade(reference_point=(0.02, 0, 0.01))], [ns.Needle(), sphere]):
        found = []
        for allowed in ("1", "0"):
            monkeypatch.setenv("NOSLIP_COMPILE", allowed)
            shield = ns.Shield(constraints, rate=RATE)
            shield._follower.wait()
            found.append(followed(shield, hand, 5, 50))
        np.testing.assert_allclose(
            found[0].tool.positions, found[1].tool.positions, rtol=0, atol=1e-12
        )
        np.testing.assert_allclose(found[0].angular, found[1].angular, rtol=0, atol=1e-12)


def test_a_tool_in_moving_work_goes_along_with_it(compiling: Path) -> None:
    work = ns.constraints.InMovingFrame(ns.Blade(), amplitude=(0.0, 0.005, 0.0), period=2.0)
    found = followed(made_for(work), HANDS["pauses"](), seed=6)
    assert np.abs(found.residuals).max() <= 1e-10
    # The hand rests at last; the tool sways with the work across its edge, and does not turn.
    sway = np.pi * 0.005 * np.cos(np.pi * (found.tool.times[1:] - 5e-4))
    np.testing.assert_allclose(speed_along(found.tool, Y)[-500:], sway[-500:], atol=1e-4)
    assert np.linalg.norm(found.angular[RESTED], axis=1).max() <= 0.03


def test_a_copy_goes_on_alike(compiling: Path) -> None:
    shield = made_for(ns.Blade())
    for k in range(300):
        shield.step((1e-4 * k * X, Rotation.from_rotvec(1e-3 * k * Z)))
    for other in (copy.deepcopy(shield), pickle.loads(pickle.dumps(shield))):
        mine = [copy.deepcopy(shield).step((0.05 * X, Rotation.identity())).vector()]
        theirs = [other.step((0.05 * X, Rotation.identity())).vector()]
        np.testing.assert_array_equal(mine, theirs)


@st.composite
def streams(draw: st.DrawFn) -> list[tuple[Floats, Rotation] | None]:
    """Hands that wander, jump, tremble, turn and let go."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    speed, tremor, jumps, silent = (draw(st.floats(0, most)) for most in (1e-3, 2e-3, 0.05, 0.5))
    place, turn, found = rng.normal(size=3), Rotation.random(random_state=rng), []
    way, spin = rng.normal(size=(2, 3))
    for _ in range(150):
        way, spin = way + 0.1 * rng.normal(size=3), spin + 0.1 * rng.normal(size=3)
        place = place + speed * way + (rng.normal(size=3) if rng.random() < jumps else 0.0)
        turn = Rotation.from_rotvec(10 * speed * spin) * turn
        seen = (
            place + tremor * rng.normal(size=3),
            Rotation.from_rotvec(10 * tremor * rng.normal(size=3)) * turn,
        )
        found.append(None if found and rng.random() < silent else seen)
    return found


@settings(max_examples=15)
@given(hand=streams(), rate=st.sampled_from([30.0, 200.0, 1000.0]))
def test_whatever_the_hand_does_the_tool_does_not_slip(
    hand: list[tuple[Floats, Rotation] | None], rate: float
) -> None:
    point = (0.02, 0.01, -0.03)
    shield = ns.Shield(ns.Blade(reference_point=point), rate=rate)
    states = [shield.step(command) for command in hand]
    vectors = np.array([state.vector() for state in states])
    tool = ns.PoseTrajectory(
        np.arange(len(hand)) / rate,
        vectors[:, :3],
        Rotation.from_quat(vectors[:, 3:7], scalar_first=True),
    )
    size = 1 + np.abs(vectors[:, 7:]).max()
    assert np.abs(speed_along(tool, Y, point)).max() <= 1e-10 * size
    # No faster than twice the peaks that it took for the hand's own.
    peaks = shield._follower.data[shield._follower._places.span("linear_peak", "angular_peak")]
    assert np.linalg.norm(vectors[:, 10:], axis=1).max() <= 2 * peaks[1]


# ---------------------------------------------------------------- in C


@pytest.mark.skipif(CC is None, reason="no C compiler (cc) on this machine")
@pytest.mark.parametrize("name", ["blade", "needle", "limits", "surface"])
def test_the_stream_in_c_is_that_in_python(name: str, tmp_path: Path, uncounted: None) -> None:
    exported(name).export_c(tmp_path)
    tested = run(tmp_path, "shield_test.c")
    assert tested.returncode == 0, tested.stdout
    drawn = run(tmp_path, "shield_example.c")
    assert drawn.returncode == 0
    rows = np.array([line.split(",") for line in drawn.stdout.splitlines()[1:]], dtype=float)
    assert rows.shape[1] == 10
    assert np.isfinite(rows).all()


def exported(name: str) -> ns.Shield:
    limits = [ns.KeepOutSphere(center=(0.36, 0.1, 0.2), radius=0.02), ns.SpeedLimit(speed=0.15)]
    return {
        "blade": ns.Shield(ns.Blade(reference_point=(0.03, 0, 0.01)), rate=1000),
        "needle": ns.Shield(ns.Needle(), rate=500),
        "limits": ns.Shield(ns.Blade(), rate=1000, limits=limits),
        "surface": ns.Shield(ns.constraints.PlaneContact(point=(0, 0, 0.2)), rate=250),
    }[name]


def run(folder: Path, *sources: str) -> subprocess.CompletedProcess[str]:
    program = sources[-1].removesuffix(".c")
    made = objects(folder, ("shield.c", *sources), CC, *STRICT)
    subprocess.run([str(CC), *map(str, made), "-lm", "-o", program], cwd=folder, check=True)
    return subprocess.run([f"./{program}"], cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.skipif(CC is None, reason="no C compiler (cc) on this machine")
def test_two_exports_with_prefixes_link_into_one_program(tmp_path: Path, uncounted: None) -> None:
    for prefix, name in (("left", "blade"), ("right", "needle")):
        exported(name).export_c(tmp_path / prefix, prefix=prefix)
        (tmp_path / prefix / "shield.h").rename(tmp_path / f"{prefix}.h")
        text = (tmp_path / prefix / "shield.c").read_text().replace("shield.h", f"{prefix}.h")
        (tmp_path / f"{prefix}.c").write_text(text)
    (tmp_path / "shield.c").write_text("typedef int nothing;\n")
    (tmp_path / "both.c").write_text("""
#include "left.h"
#include "right.h"
int main(void) {
    static left_shield one;
    static right_shield other;
    const double pose[7] = {0, 0, 0, 1, 0, 0, 0};
    return left_shield_start(&one, pose) || right_shield_start(&other, pose)
        || left_shield_step(&one, pose, 0) || right_shield_step(&other, 0, pose);
}
""")
    assert run(tmp_path, "left.c", "right.c", "both.c").returncode == 0


@pytest.mark.skipif(shutil.which("valgrind") is None or CC is None, reason="no valgrind or cc")
def test_the_header_tells_the_instructions_of_a_step(tmp_path: Path) -> None:
    found = ns.Shield(ns.Blade(), rate=1000).export_c(tmp_path)
    assert found.instructions is not None
    # At 8 to 10 instructions a nanosecond: under a microsecond.
    assert 3000 < found.instructions < 10_000
    assert f"At most {found.instructions} instructions" in (tmp_path / "shield.h").read_text()


@pytest.mark.skipif(CC is None, reason="no C compiler (cc) on this machine")
def test_c_refuses_what_python_refuses(tmp_path: Path, uncounted: None) -> None:
    exported("blade").export_c(tmp_path)
    (tmp_path / "hard.c").write_text("""
#include "shield.h"
#include <math.h>
#include <string.h>
int main(void) {
    static noslip_shield s, kept;
    double pose[7] = {0, 0, 0, 1, 0, 0, 0}, bad[7] = {0, 0, 0, 1, 0, 0, 0};
    if (noslip_shield_start(&s, pose)) return 1;
    kept = s;
    bad[1] = NAN;
    if (!noslip_shield_step(&s, bad, 0) || memcmp(&s, &kept, sizeof s)) return 2;
    bad[1] = 0;
    bad[3] = 0;
    if (!noslip_shield_step(&s, bad, 0) || !noslip_shield_start(&s, bad)) return 3;
    if (memcmp(&s, &kept, sizeof s)) return 4;
    pose[0] = 1e308;
    if (noslip_shield_step(&s, pose, 0)) return 5;
    kept = s;
    pose[0] = -1e308;
    if (!noslip_shield_step(&s, pose, 0) || memcmp(&s, &kept, sizeof s)) return 6;
    pose[0] = 0;
    bad[0] = INFINITY;
    return noslip_shield_step(&s, pose, bad);
}
""")
    assert run(tmp_path, "hard.c").returncode == 0


@pytest.mark.skipif(CC is None, reason="no C compiler (cc) on this machine")
@pytest.mark.parametrize("name", ["blade", "limits"])
def test_c_bears_whatever_it_is_given(name: str, tmp_path: Path, uncounted: None) -> None:
    exported(name).export_c(tmp_path)
    (tmp_path / "wild.c").write_text("""
#include "shield.h"
#include <math.h>
#include <string.h>
static unsigned long long random_state = 88172645463325252ull;
static double uniform(void) {
    random_state ^= random_state << 13;
    random_state ^= random_state >> 7;
    random_state ^= random_state << 17;
    return (double)(random_state >> 11) / 9007199254740992.0;
}
static double wild(void) {
    static const double given[] = {NAN, INFINITY, -1e308, 1e200, 1e-300};
    const double x = 50 * uniform();
    return x < 5 ? given[(int)x] : (2 * uniform() - 1) * pow(10, 6 * uniform() - 5);
}
int main(void) {
    static noslip_shield s, kept;
    const double *all = (const double *)&s;
    double hand[7] = {0.3, 0.1, 0.2, 1, 0, 0, 0}, seen[7], speed;
    long k, refused = 0;
    unsigned long i;
    noslip_shield_start(&s, hand);
    for (k = 0; k < 20000; ++k) {
        for (i = 0; i < 7; ++i) {
            hand[i] = k / 1000 % 2 ? wild() : 0.3 + 0.01 * sin(1e-3 * (double)k + (double)i);
            seen[i] = wild();
        }
        kept = s;
        if (noslip_shield_step(&s, uniform() < 0.3 ? 0 : hand, uniform() < 0.5 ? 0 : seen)) {
            ++refused;
            if (memcmp(&s, &kept, sizeof s)) return 1;
        }
        for (i = 0; i < sizeof s / sizeof(double); ++i) {
            if (!isfinite(all[i])) return 2;
        }
        for (speed = 1, i = 0; i < 3; ++i) speed = fmax(speed, fabs(s.linear_velocity[i]));
        for (i = 0; i < NOSLIP_SHIELD_EQUALITIES; ++i) {
            if (!(fabs(s.values[i]) <= 1e-10 * speed)) return 3;
        }
    }
    return refused ? 0 : 4;
}
""")
    assert run(tmp_path, "wild.c").returncode == 0


def test_the_command_exports_a_shield(
    noslip: Callable[..., Any], tmp_path: Path, uncounted: None
) -> None:
    out = tmp_path / "out"
    given = "--shield", "--constraint", "blade(lateral='z')", "--loop-rate", "500"
    result = noslip("export", *given, "--out", out, "--prefix", "knife", "--json")
    assert result.code == 0, result.err
    files = [Path(file) for file in json.loads(result.out)["files"]]
    assert {file.name for file in files} == {
        *("shield.h", "shield.c", "shield_example.c", "shield_test.c")
    }
    ns.Shield(ns.Blade(lateral="z"), rate=500).export_c(tmp_path / "same", prefix="knife")
    for file in files:
        assert file.read_text() == (tmp_path / "same" / file.name).read_text()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([], "give a primitive, or --shield with --constraint and --loop-rate"),
        (
            ["--shield", "--loop-rate", "9"],
            "--shield takes what must hold (--constraint) and --loop-rate",
        ),
        (["--shield", "--constraint", "blade"], "--shield takes what must hold (--constraint)"),
        (["cut.json", "--shield"], "--shield takes no primitive and no --name"),
        (["cut.json", "--loop-rate", "9"], "--constraint and --loop-rate are for --shield"),
    ],
)
def test_what_the_command_cannot_export_is_refused(
    given: list[str], message: str, noslip: Callable[..., Any], tmp_path: Path
) -> None:
    result = noslip("export", *given, "--out", tmp_path / "out")
    assert result.code == 2
    assert message in result.err
    assert not (tmp_path / "out").exists()
