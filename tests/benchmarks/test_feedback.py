"""The test bench of generators in a loop: its plants, its sensors, its judge, and one quick run."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks import peers
from benchmarks.feedback import cartesian, judge, program, scenarios, tasks, trial
from benchmarks.feedback.conditions import Clock, Conditions, Disturbance, Robot, Sensor
from benchmarks.feedback.generators import Plain
from benchmarks.feedback.judge import Bounds, Figures
from benchmarks.feedback.loop import Record, run
from benchmarks.feedback.plant import Plant
from benchmarks.feedback.poses import Floats, Pose, body_axis, size, turn_between, turned
from benchmarks.feedback.sensing import Eye, Goal

UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
HERE = Pose(np.zeros(3), UNTURNED)
THERE = Pose(np.array([0.1, 0.2, -0.3]), turned(np.array([0.3, -0.4, 1.2]), UNTURNED))
DURATION, LENGTH = 2.0, 0.5
NONE = Disturbance()


def executed(
    robot: Robot, happening: Disturbance, command: Pose, seconds: float, period: float = 5e-3
) -> tuple[Floats, list[Pose], list[bool]]:
    """Times, poses and touches of a robot, at rest in the origin, under a constant command."""
    plant = Plant(robot, happening, HERE, DURATION, LENGTH)
    times, poses, touched = [], [], []
    while plant.time < seconds - 1e-9:
        plant.advance(command, period)
        times.append(plant.time)
        poses.append(plant.pose)
        touched.append(plant.is_touched)
    return np.array(times), poses, touched


# ---------------------------------------------------------------- poses


def test_single_rotations_are_scipys() -> None:
    random = np.random.default_rng(0)
    for turn in [*random.normal(size=(20, 3)), np.zeros(3), 1e-12 * np.ones(3)]:
        q = random.normal(size=4)
        q /= np.linalg.norm(q)
        begin = Rotation.from_quat(q, scalar_first=True)
        end = Rotation.from_rotvec(turn) * begin
        found = turned(turn, q)
        assert (Rotation.from_quat(found, scalar_first=True) * end.inv()).magnitude() < 1e-14
        assert turn_between(q, found) == pytest.approx((end * begin.inv()).as_rotvec(), abs=1e-14)
        assert turn_between(q, -found) == pytest.approx(turn_between(q, found), abs=1e-14)
        for k in range(3):
            assert body_axis(q, k) == pytest.approx(begin.as_matrix()[:, k], abs=1e-14)
        assert size(turn) == pytest.approx(np.linalg.norm(turn))


# ---------------------------------------------------------------- plants


@pytest.mark.parametrize("period", [1e-3, 5e-3, 7.3e-3, 0.04])
def test_a_lag_answers_a_step_as_an_exponential_after_its_delay(period: float) -> None:
    robot = Robot(lag=0.05, delay=0.013, turning_lag=0.08)
    times, poses, _ = executed(robot, NONE, THERE, 0.3, period)
    since = np.maximum(times - 0.013, 0.0)
    for share, wanted in ((0.05, THERE.position), (0.08, turn_between(UNTURNED, THERE.quaternion))):
        found = [
            pose.position if share == 0.05 else turn_between(UNTURNED, pose.quaternion)
            for pose in poses
        ]
        closed = -np.expm1(-since / share)[:, None] * wanted
        assert np.allclose(found, closed, atol=1e-12)


def test_a_robot_without_lag_is_where_it_was_sent_a_delay_ago() -> None:
    plant = Plant(Robot(delay=0.02), NONE, HERE, DURATION, LENGTH)
    for k in range(20):
        plant.advance(Pose(np.full(3, 0.01 * (k + 1)), UNTURNED), 5e-3)
        # What was sent before cycle k - 3 has arrived within this one.
        assert plant.pose.position == pytest.approx(np.full(3, 0.01 * max(k - 3, 0)), abs=1e-15)


@pytest.mark.parametrize("damping", [0.7, 1.0])
def test_an_impedance_answers_a_step_in_second_order(damping: float) -> None:
    w = 30.0
    times, poses, _ = executed(Robot(frequency=w, damping=damping), NONE, THERE, 0.4)
    if damping == 1.0:
        left = np.exp(-w * times) * (1 + w * times)
    else:
        root = np.sqrt(1 - damping**2)
        swing = np.cos(w * root * times) + damping / root * np.sin(w * root * times)
        left = np.exp(-damping * w * times) * swing
    found = np.array([pose.position for pose in poses])
    assert np.allclose(found, (1 - left)[:, None] * THERE.position, atol=1e-12)
    turn = turn_between(UNTURNED, THERE.quaternion)
    share = -np.expm1(-times * w / (2 * damping))
    assert np.allclose(
        [turn_between(UNTURNED, p.quaternion) for p in poses], share[:, None] * turn, atol=1e-12
    )


def test_a_force_displaces_an_impedance_by_what_it_says_at_rest_and_lets_go() -> None:
    force = Disturbance("force", size=0.02, at=0.1, held=0.8)
    _, poses, touched = executed(Robot(frequency=30.0), force, HERE, 2.0)
    aside = np.array([pose.position[1] for pose in poses])
    assert aside[39] == 0.0
    assert aside[200] == pytest.approx(0.02 * LENGTH, rel=1e-3)
    assert aside[-1] == pytest.approx(0.0, abs=1e-6)
    # From the first cycle that it acts in to the last: 0.2 s to 1.1 s.
    assert np.flatnonzero(touched)[[0, -1]].tolist() == [40, 219]


def test_a_hand_leads_a_tool_aside_whatever_is_commanded() -> None:
    hand = Disturbance("hand", size=0.1, at=0.1, held=0.3)
    times, poses, touched = executed(Robot(lag=0.03), hand, HERE, 1.0)
    aside = np.array([pose.position[1] for pose in poses])
    assert aside[(times > 0.3) & (times < 0.6)] == pytest.approx(0.1 * LENGTH)
    after = times > 0.6 + 1e-9
    closed = 0.1 * LENGTH * np.exp(-(times[after] - 0.6) / 0.03)
    assert aside[after] == pytest.approx(closed, abs=1e-12)
    assert np.sum(touched) == 80


def test_a_stalled_robot_stands() -> None:
    stall = Disturbance("stall", at=0.01, held=0.1)
    times, poses, touched = executed(Robot(lag=0.05), stall, THERE, 0.3)
    x = np.array([pose.position[0] for pose in poses])
    assert np.ptp(x[(times >= 0.02) & (times < 0.1201)]) < 1e-12
    assert x[-1] == pytest.approx(-0.1 * np.expm1(-0.2 / 0.05))
    assert not any(touched)


# ---------------------------------------------------------------- sensors and goals


def seen(sensor: Sensor, seconds: float, period: float = 5e-3) -> list[tuple[float, Pose]]:
    """When what was seen of a robot that moves at a meter a second along x."""
    eye = Eye(sensor, np.random.default_rng(3))
    samples = []
    for k in range(round(seconds / period)):
        sample = eye.see(k * period, Pose(np.array([k * period, 0.0, 0.0]), UNTURNED))
        if sample is not None:
            samples.append((k * period, sample))
    return samples


def test_noise_and_bias_have_the_moments_that_they_are_given() -> None:
    sensor = Sensor(noise=0.3e-3, turning_noise=0.01, bias=(1e-3, -2e-3, 0.5e-3))
    samples = seen(sensor, 50.0)
    off = np.array([pose.position - [t, 0, 0] for t, pose in samples])
    turns = np.array([turn_between(UNTURNED, pose.quaternion) for _, pose in samples])
    few = 4 / np.sqrt(len(samples))
    assert len(samples) == 10_000
    assert np.abs(off.mean(axis=0) - sensor.bias).max() < few * 0.3e-3
    assert off.std(axis=0) == pytest.approx([0.3e-3] * 3, rel=few)
    assert turns.std(axis=0) == pytest.approx([0.01] * 3, rel=few)


@pytest.mark.parametrize("rate", [30.0, 67.0, 120.0])
def test_a_sensor_samples_at_its_rate_and_tells_late(rate: float) -> None:
    samples = seen(Sensor(rate=rate, age=0.02), 10.0)
    # The last ones are still on their way.
    assert len(samples) == pytest.approx((10 - 0.02) * rate, abs=1)
    # What is told now was there when it was taken.
    assert {round(t - pose.position[0], 9) for t, pose in samples} == {0.02}
    assert len(seen(Sensor(rate=rate, lost=0.3), 50.0)) == pytest.approx(35 * rate, rel=0.1)


def test_quantized_positions_are_multiples_and_outliers_are_far() -> None:
    x = np.array([pose.position for _, pose in seen(Sensor(quantum=1e-3, noise=1e-3), 5.0)])
    assert np.allclose(x, 1e-3 * np.round(x / 1e-3), atol=1e-15)
    far = [size(p.position - [t, 0, 0]) > 1e-3 for t, p in seen(Sensor(outliers=0.1), 50.0)]
    assert np.mean(far) == pytest.approx(0.1, abs=0.015)


def test_a_silent_sensor_says_nothing_until_it_speaks_again() -> None:
    eye = Eye(Sensor(), np.random.default_rng(0), silent=(0.1, 0.2))
    told = [eye.see(k * 0.005, HERE) is not None for k in range(60)]
    assert told == [not 20 <= k < 40 for k in range(60)]


def test_goals_go_where_they_are_said_to() -> None:
    def goal(happening: Disturbance) -> Goal:
        return Goal(happening, HERE, DURATION, LENGTH, np.random.default_rng(0))

    stepping = goal(Disturbance("two goals", size=0.1, at=0.5))
    assert size(stepping.told(0.99)) == 0.0
    assert stepping.told(1.0) == pytest.approx([0.025, 0.0435, 0.0])
    assert stepping.told(1.6) == pytest.approx([0.025, -0.0435, 0.0])
    drifting = goal(Disturbance("drift", size=0.1, at=0.25))
    assert size(drifting.told(0.5)) == 0.0
    assert size(drifting.told(1.0)) == pytest.approx(0.1 * LENGTH / 4)
    assert size(drifting.told(9.0)) == pytest.approx(0.1 * LENGTH * 3 / 4)
    noisy = goal(Disturbance("noisy goal", size=1e-3))
    told = np.array([noisy.told(k / 60) for k in range(3000)])
    assert told.std(axis=0) == pytest.approx([1e-3] * 3, rel=0.06)
    assert size(noisy.true) == 0.0
    assert goal(NONE).told(1.0) is None


# ---------------------------------------------------------------- the judge


@pytest.fixture(scope="module")
def s_cut() -> tasks.Task:
    return tasks.task("s-cut")


PERIOD = 0.005


def ideal(task: tasks.Task) -> Record:
    """The plain motion on a robot that does what it is told."""
    return run(task, lambda: Plain(task, PERIOD), PERIOD, Conditions(), 0)


def test_the_plain_motion_on_an_ideal_robot_is_the_measure_of_all(s_cut: tasks.Task) -> None:
    found = judge.judged(s_cut, ideal(s_cut))
    assert found.finished and found.plans == 0 and found.slip == 0.0
    assert found.time == pytest.approx(1.0, abs=PERIOD)
    for name in ("turning", "speed", "turning_gain", "gain"):
        assert getattr(found, name) == pytest.approx(1.0, abs=1e-9)
    assert found.path < 1e-4 and found.skipped < 1e-3 and found.end < 1e-5 and found.drift == 0.0


@pytest.mark.parametrize("name", ["needle", "beveled needle", "wheel"])
def test_no_task_slips_by_itself(name: str) -> None:
    task = tasks.task(name)
    assert judge.judged(task, ideal(task)).slip == 0.0


def test_what_is_commanded_sideways_is_found(s_cut: tasks.Task) -> None:
    record = ideal(s_cut)
    commanded = record.commanded.copy()
    # From cycle 100 on a micrometer to the left.
    left = Rotation.from_quat(commanded[100, 3:], scalar_first=True).apply([0, 1, 0])
    commanded[100:, :3] += 1e-6 * left
    found = judge.judged(s_cut, replace(record, commanded=commanded))
    top = s_cut.peaks(PERIOD)[0]
    assert found.slip == pytest.approx(1e-6 / PERIOD / top, rel=1e-3)
    led = np.zeros(len(commanded), dtype=bool)
    led[100] = True
    assert judge.judged(s_cut, replace(record, commanded=commanded, led=led)).slip < 1e-5


def test_rates_are_those_of_the_clock(s_cut: tasks.Task) -> None:
    record = ideal(s_cut)
    twice = replace(record, period=PERIOD / 2, elapsed=record.elapsed / 2, times=record.times / 2)
    found = judge.judged(s_cut, twice)
    assert found.speed == pytest.approx(2.0, rel=1e-3)
    assert found.turning == pytest.approx(2.0, rel=1e-3)
    assert found.gain == pytest.approx(4.0, rel=1e-2)
    assert found.turning_gain == pytest.approx(4.0, rel=1e-2)
    assert found.time == pytest.approx(0.5, abs=PERIOD)


def test_a_jump_is_an_acceleration_unless_its_cycle_came_late(s_cut: tasks.Task) -> None:
    record = ideal(s_cut)
    commanded = record.commanded.copy()
    commanded[200:, :3] += [1e-3, 0, 0]
    jumped = replace(record, commanded=commanded)
    peak = s_cut.peaks(PERIOD)[2]
    before = judge.judged(s_cut, jumped).gain
    assert before == pytest.approx(1e-3 / PERIOD**2 / peak, rel=0.05)
    elapsed = record.elapsed.copy()
    elapsed[200] = 0.03
    assert judge.judged(s_cut, replace(jumped, elapsed=elapsed)).gain == pytest.approx(1, abs=0.05)


def test_ends_paths_and_finishing_are_measured(s_cut: tasks.Task) -> None:
    record, length = ideal(s_cut), s_cut.length
    raised = record.executed.copy()
    raised[150:170, 2] = 0.01 * length
    found = judge.judged(s_cut, replace(record, executed=raised))
    assert found.path == pytest.approx(0.01, rel=1e-6)
    assert 0 < found.skipped <= 0.011
    touched = np.zeros(len(raised), dtype=bool)
    touched[150:170] = True
    found = judge.judged(s_cut, replace(record, executed=raised, touched=touched))
    assert found.path < 1e-4
    away = judge.judged(s_cut, replace(record, goal=record.goal + [0, 0, 0.02 * length]))
    assert away.end == pytest.approx(0.02, rel=1e-3)
    # Said to be done, and then not any more: it is done from the last time on.
    done = record.done.copy()
    done[-30] = False
    later = judge.judged(s_cut, replace(record, done=done))
    assert later.time == pytest.approx(record.times[-29] / s_cut.duration)
    since = judge.judged(s_cut, replace(record, done=done, since=0.5 * s_cut.duration))
    assert since.time == pytest.approx(later.time - 0.5)
    done[-1] = False
    assert not judge.judged(s_cut, replace(record, done=done)).finished
    assert not judge.judged(s_cut, replace(record, failure="ValueError: no")).finished


def test_distances_from_a_path_are_to_its_segments() -> None:
    path = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    points = np.array([[0.5, 0, 0.2], [1.3, 0.5, 0], [-0.4, 0.3, 0], [0.9, 0.2, 0]])
    assert judge.off_path(path, points) == pytest.approx([0.2, 0.3, 0.5, 0.1])


def test_bounds_name_what_is_beyond_them() -> None:
    good = Figures(True, 1.0, 0, 0.0, 1.0, 1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-4, 0.0)
    bounds = Bounds(time=1.03, plans=0, beyond_lag=1e-4, end=4e-3)
    assert bounds.broken(good, good) == []
    assert bounds.broken(replace(good, time=1.1, plans=1), good) == [
        "time 1.1 > 1.03",
        "plans 1 > 0",
    ]
    assert bounds.broken(replace(good, path=2e-3), good) == ["beyond_lag 0.001 > 0.0001"]
    assert bounds.broken(replace(good, end=np.nan), good) == ["end nan > 0.004"]
    [text] = bounds.broken(replace(good, finished=False, failure="ran away"), good)
    assert text == "not finished (ran away)"


def test_a_generator_that_raises_or_runs_away_has_not_finished(s_cut: tasks.Task) -> None:
    class Failing(Plain):
        def step(self, elapsed: float, measured: Pose | None, goal: Floats | None) -> Pose:
            self.steps = getattr(self, "steps", 0) + 1
            if self.steps > 10:
                raise ValueError("no")
            return super().step(elapsed, measured, goal)

    class Fleeing(Plain):
        def step(self, elapsed: float, measured: Pose | None, goal: Floats | None) -> Pose:
            pose = super().step(elapsed, measured, goal)
            return Pose(pose.position + [1e3, 0, 0], pose.quaternion)

    for kind, failure in ((Failing, "ValueError: no"), (Fleeing, "RuntimeError: ran away")):
        record = run(s_cut, lambda kind=kind: kind(s_cut, PERIOD), PERIOD, Conditions(), 0)
        assert record.failure == failure
        assert not judge.judged(s_cut, record).finished


def test_late_cycles_come_as_often_as_they_are_said_to(s_cut: tasks.Task) -> None:
    clock = Clock(jitter=0.1, late=0.1, lateness=0.02)
    record = run(s_cut, lambda: Plain(s_cut, 1e-3), 1e-3, Conditions(clock=clock), 1)
    late = record.elapsed > 2e-3
    assert np.mean(late) == pytest.approx(0.1, abs=0.04)
    assert record.elapsed.max() <= 0.0211 and record.elapsed.min() >= 0.9e-3
    # In true time it is over when it should be.
    assert judge.judged(s_cut, record).time == pytest.approx(1.0, abs=0.02)


# ---------------------------------------------------------------- others


@pytest.mark.skipif(bool(peers.MISSING), reason=peers.MISSING)
def test_the_peer_follows_the_motion_where_nothing_disturbs_it(s_cut: tasks.Task) -> None:
    for make in (cartesian.Cartesian, cartesian.PhaseStopping):
        found = judge.judged(
            s_cut, run(s_cut, lambda make=make: make(s_cut, PERIOD), PERIOD, Conditions(), 0)
        )
        assert found.finished and found.time == pytest.approx(1.0, abs=PERIOD)
        assert found.path < 5e-3 and found.end < 4e-3


@pytest.mark.skipif(bool(peers.MISSING), reason=peers.MISSING)
def test_phase_stopping_waits_for_a_robot_that_stands(s_cut: tasks.Task) -> None:
    stalled = Conditions(Robot(lag=0.01), disturbance=Disturbance("stall", at=0.5, held=0.8))
    gains = cartesian.Gains(20.0, 1e4, 0.0)

    def waited(conditions: Conditions) -> float:
        make = cartesian.PhaseStopping
        record = run(s_cut, lambda: make(s_cut, PERIOD, gains=gains), PERIOD, conditions, 0)
        return judge.judged(s_cut, record).time

    assert waited(stalled) > waited(Conditions(Robot(lag=0.01))) + 0.2


# ---------------------------------------------------------------- all of it


def test_conditions_are_alike_for_all_generators_and_lie_in_their_ranges(s_cut: tasks.Task) -> None:
    for scenario in scenarios.SCENARIOS:
        one, again = (trial.conditions_of(scenario, s_cut, 200.0, 5) for _ in range(2))
        assert one == again
        assert 0 <= one.robot.lag <= 0.1 and 0 <= one.robot.delay <= 0.02
        assert one.sensor.noise <= 0.5e-3 and one.sensor.turning_noise <= np.radians(0.3) + 1e-12
        assert np.linalg.norm(one.sensor.bias) <= 0.025 * s_cut.length * (1 + 1e-12)
    assert len({scenario.name for scenario in scenarios.SCENARIOS}) == len(scenarios.SCENARIOS)


def test_the_program_prints_its_table_and_fails_where_a_bound_is_broken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "runs.json"
    words = ["--scenario", "lag and delay", "--task", "s-cut", "--rate", "200", "--seeds", "1"]
    short = tmp_path / "table.md"
    words += ["--processes", "1", "--gate", "--markdown", str(short), "--json", str(file)]
    plain = [*words, "--generator", "without feedback"]
    assert program.run(plain) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["lag", "and", "delay", "at", "most", "all", "(1.03)", "0"] in [x[:8] for x in lines]
    assert any(line[:5] == ["without", "feedback", "1", "of", "1"] for line in lines)
    assert short.read_text().splitlines() == [
        "| | without feedback |",
        "|---|---|",
        "| lag and delay | 100%, 1.00 T, 4e-06; 1 of 1 |",
    ]
    [one] = json.loads(file.read_text())["runs"]
    assert one["figures"]["finished"] and one["broken"] == [] and one["beyond_lag"] == 0.0
    # From files alone: nothing is run; bounds are those of now.
    again, table = tmp_path / "again.json", tmp_path / "again.md"
    late = json.loads(file.read_text())
    late["runs"][0] |= {"seed": 7, "generator": "fed back literally"}
    late["runs"][0]["figures"] |= {"time": None, "finished": False}
    (other := tmp_path / "other.json").write_text(json.dumps(late))
    monkeypatch.setattr(program, "tried", None)
    added = ["--add", str(file), "--add", str(other)]
    assert program.run([*added, "--json", str(again), "--markdown", str(table)]) == 0
    monkeypatch.undo()
    late["runs"][0]["broken"] = ["not finished"]
    assert json.loads(again.read_text())["runs"] == [one, *late["runs"]]
    assert table.read_text().splitlines() == [
        "| | without feedback | fed back literally |",
        "|---|---|---|",
        "| lag and delay | 100%, 1.00 T, 4e-06; 1 of 1 | 0%, 4e-06; 0 of 1 |",
    ]
    # The gate is of noslip alone; a bound that nothing can keep closes it.
    monkeypatch.setattr(program, "OURS", "without feedback")
    assert program.run(plain) == 0
    monkeypatch.setattr(program, "MEDIAN_END", 0.0)
    assert program.run(plain) == 1
    assert "lag and delay: median end" in capsys.readouterr().err
    monkeypatch.undo()
    monkeypatch.setattr(program, "OURS", "without feedback")
    strict = replace(trial.NAMED["lag and delay"], bounds=Bounds(time=0.5))
    monkeypatch.setitem(trial.NAMED, "lag and delay", strict)
    assert program.run(plain) == 1
    assert "lag and delay, s-cut, 200 Hz, seed 0: time 0.99" in capsys.readouterr().err


@pytest.mark.parametrize("scenario", ["all at once", "push, waits", "push, follows", "goal step"])
def test_the_controller_keeps_every_bound_in_a_quick_run(scenario: str) -> None:
    [outcome] = trial.tried(trial.Trial(scenario, "s-cut", 200.0, 0, (trial.OURS,)))
    assert outcome.broken == ()
    assert outcome.figures.finished


def test_a_goal_that_drifts_is_met_where_it_is_then() -> None:
    ends = []
    for seed in range(3):
        for task in ("needle", "wheel"):
            [found] = trial.tried(trial.Trial("drifting goal", task, 200.0, seed, (trial.OURS,)))
            assert found.broken == ()
            ends.append(found.figures.end)
    assert np.median(ends) <= scenarios.MEDIAN_END


def test_a_plan_that_bends_too_sharply_is_not_handed_over_at_speed() -> None:
    # A beveled needle, whose goal steps aside in the middle of its way, must draw back.
    [found] = trial.tried(trial.Trial("goal step", "beveled needle", 200.0, 9, (trial.OURS,)))
    bounds = Bounds()
    for name in ("turning", "speed", "turning_gain", "gain", "slip"):
        assert getattr(found.figures, name) <= getattr(bounds, name)
    assert found.figures.arrived


@pytest.mark.parametrize("content", [None, "", "[]", '{"runs": 3}', '{"runs": [{"figures": {}}]}'])
def test_a_file_that_holds_no_runs_is_named(
    content: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "runs.json"
    if content is not None:
        file.write_text(content)
    assert program.run(["--add", str(file)]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"--add {file}: no runs as --json writes them")
    assert told.count("\n") == 1
