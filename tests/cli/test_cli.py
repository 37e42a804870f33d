"""The command line: what it writes, what it says, and with which code it exits."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import under
from motions import planar_cut
from noslip.cli import main
from noslip.figures import constraint_history, save_figure


@pytest.fixture
def slipping(tmp_path) -> Path:
    """A planar cut whose blade is 20 degrees off its path."""
    return planar_cut(beside=np.radians(20), count=241).to_csv(tmp_path / "slipping.csv")


@pytest.fixture
def primitive(noslip, slipping, tmp_path) -> Path:
    path = tmp_path / "cut.json"
    assert noslip("learn", slipping, "--constraint", "blade", "--out", path).code == 0
    return path


def test_version_and_help_are_short_and_exit_with_zero(noslip):
    assert noslip("--version") == (0, f"noslip {ns.__version__}\n", "")
    for command in ("demo", "check", "learn", "rollout", "plot", "simulate"):
        result = noslip(command, "--help")
        assert result.code == 0
        assert f"noslip {command}" in result.out
        assert "Examples" in result.out


def test_check_says_violated_with_the_measured_slip_and_exits_with_one(noslip, slipping):
    result = noslip("check", slipping, "--constraint", "blade")
    assert result.code == 1
    assert "VIOLATED" in result.out
    data = json.loads(noslip("check", slipping, "--constraint", "blade", "--json").out)
    slip = data[0]["constraints"][0]["slip_distance"]
    assert slip == pytest.approx(0.1 * np.sin(np.radians(20)), rel=0.02)


def test_what_slips_slowly_does_not_hold(noslip, slipping, tmp_path):
    # 34 mm of 100 mm, at a fiftieth of a millimeter a second.
    cut = ns.load_demonstrations(slipping)[0]
    slow = tmp_path / "slow.csv"
    ns.PoseTrajectory(2500 * cut.times, cut.positions, cut.rotations).to_csv(slow)
    result = noslip("check", slow, "--constraint", "blade")
    assert result.code == 1
    assert "blade: VIOLATED  peak 6.84e-06 m/s" in result.out
    assert "(34 % of its way, more than 1 %)" in result.out
    # Allowed to slip that share, nothing is known: no moment was as fast as the tolerance.
    asked = ("check", slow, "--constraint", "blade", "--slip-share", 0.4)
    result = noslip(*asked)
    assert result.code == 0
    assert "blade: HOLDS" in result.out
    waver = cut.rotations * Rotation.from_euler(
        "z", np.where(np.arange(len(cut)) % 40, -20, 20), degrees=True
    )
    ns.PoseTrajectory(2500 * cut.times, cut.positions, waver).to_csv(slow)
    result = noslip("check", slow, "--constraint", "blade", "--slip-share", 0.1)
    assert result.code == 1
    assert "blade: UNDECIDED" in result.out and "give a smaller one" in result.out
    (report,) = json.loads(
        noslip("check", slow, "--constraint", "blade", "--slip-share", 0.1, "--json").out
    )
    assert report["verdict"] == "undecided: blade"
    assert not report["satisfied"]


def test_a_rule_that_is_undefined_is_told_in_one_line(noslip, tmp_path):
    rules = tmp_path / "rules.py"
    rules.write_text(
        "import casadi as ca\nimport noslip as ns\n@ns.velocity_constraint\n"
        "def heading(m):\n    return ca.atan2(m.linear_velocity[1], m.linear_velocity[0])\n"
    )
    positions = np.outer(np.clip(np.arange(100), 20, 80), [1e-3, 0, 0])
    rests = ns.PoseTrajectory(0.01 * np.arange(100), positions, Rotation.identity(100))
    rests.to_csv(tmp_path / "rests.csv")
    for command in (["check"], ["learn", "--out", tmp_path / "cut.json"]):
        result = noslip(*command, tmp_path / "rests.csv", "--constraint", f"{rules}:heading")
        assert result.code == 2
        assert result.err.startswith("noslip: error: constraint 'heading' is nan at 0")
        assert "atan2(" in result.err and ") is undefined" in result.err
        assert result.err.count("\n") == 1


def test_learned_motion_passes_the_check_that_its_recording_fails(noslip, primitive, tmp_path):
    motion = tmp_path / "motion.csv"
    assert noslip("rollout", primitive, "--out", motion).code == 0
    result = noslip("check", motion, "--constraint", "blade", "--tolerance", "1e-10")
    assert result.code == 0
    assert "HOLDS" in result.out


def test_rollout_takes_goals_durations_and_rates(noslip, primitive, tmp_path):
    motion = tmp_path / "motion.npz"
    dmp = ns.load_primitive(primitive)
    goal = dmp.goal_position + [0.01, 0.0, 0.0]
    result = noslip(
        *("rollout", primitive, "--out", motion, "--duration", 4, "--time-step", 0.01, "--json"),
        *("--goal-position", ",".join(map(repr, goal.tolist()))),
    )
    # The coupling term alone leads a blade to no other goal: it is said, and no success.
    assert result.code == 1
    told = json.loads(result.out)
    assert told["samples"] == 401
    assert f"ends {told['end_error'] * 1e3:.3g} mm" in result.err and "adapt" in result.err
    read = ns.PoseTrajectory.from_npz(motion)
    expected = dmp.rollout(goal_position=goal, duration=4.0, time_step=0.01)
    np.testing.assert_array_equal(read.positions, expected.positions)


@pytest.mark.parametrize("metric", ["shared", "1,1,1,2,2,4"])
def test_learn_takes_a_metric_and_a_barrier_rate(noslip, slipping, tmp_path, metric):
    out = tmp_path / "cut.json"
    result = noslip(
        *("learn", slipping, "--constraint", "blade", "--out", out, "--metric", metric),
        *("--metric-length", "0.01", "--barrier-rate", "50"),
    )
    assert result.code == 0
    named = metric if metric.isalpha() else [float(weight) for weight in metric.split(",")]
    demonstration = ns.PoseTrajectory.from_csv(slipping)
    expected = ns.learn(
        demonstration, [ns.Blade()], metric=named, metric_length=0.01, barrier_rate=50
    )
    found = ns.load_primitive(out)
    assert found.rule == expected.rule
    assert found.rule.barrier_rate == 50


def test_rollout_takes_a_start_off_the_constraint(noslip, slipping, tmp_path):
    out, motion = tmp_path / "cut.json", tmp_path / "motion.npz"
    demonstration = ns.PoseTrajectory.from_csv(slipping)
    ns.learn(demonstration, [ns.constraints.PlaneContact(point=(0, 0, 0.002))]).save(out)
    heights = {}
    for how in ("pose", "nothing"):
        options = ("--project-start", how, "--pull-in", "10", "--start-position", "0,0,0")
        noslip("rollout", out, "--out", motion, *options)
        heights[how] = ns.PoseTrajectory.from_npz(motion).positions[:, 2]
    np.testing.assert_allclose(heights["pose"], 0.002, atol=1e-12)
    assert heights["nothing"][0] == 0
    expected = ns.load_primitive(out).rollout(
        start_position=[0, 0, 0], project_start="nothing", pull_in=10
    )
    np.testing.assert_array_equal(heights["nothing"], expected.positions[:, 2])


def test_learn_refuses_limits_that_the_demonstration_cannot_keep(noslip, slipping, tmp_path):
    out = tmp_path / "cut.json"
    limit = "box(lower=(None,None,None),upper=(0.05,None,None))"
    result = noslip(
        *("learn", slipping, "--constraint", "blade(edge='x')", "--constraint", limit),
        *("--constraint", "forward-only(minimum=0.05)", "--out", out),
    )
    assert result.code == 1 and not out.exists()
    assert "error: " in result.err and "box" in result.err


def test_rollout_without_out_writes_the_csv_alone_to_standard_output(noslip, primitive):
    result = noslip("rollout", primitive)
    assert result.code == 0
    assert result.out == ns.load_primitive(primitive).rollout().csv_text()


def test_regular_variant_slips_and_is_not_blamed_for_it(noslip, primitive, tmp_path):
    motion = tmp_path / "regular.csv"
    result = noslip("rollout", primitive, "--variant", "regular", "--out", motion)
    assert result.code == 0
    assert "VIOLATED" in result.out


def test_learn_prepares_as_the_options_ask(noslip, slipping, tmp_path):
    out = tmp_path / "prepared.json"
    result = noslip(
        *("learn", slipping, "--constraint", "blade", "--out", out, "--json"),
        *("--tool-frame", "0.01,0,0.02", "--trim-time", "0.1:1.9", "--trim-speed", "0.01"),
        *("--rate", "60", "--lowpass", "4.8", "--relative", "--project-start", "velocity"),
    )
    assert result.code == 0
    demonstration = ns.prepare(
        ns.PoseTrajectory.from_csv(slipping),
        tool_frame=[0.01, 0, 0.02],
        trim_time=(0.1, 1.9),
        trim_speed=0.01,
        rate=60,
        lowpass=4.8,
        relative=True,
    )
    expected = ns.learn(demonstration, [ns.Blade()], project_start="velocity").rollout()
    np.testing.assert_array_equal(ns.load_primitive(out).rollout().positions, expected.positions)
    assert json.loads(result.out)["residual_peak"] <= 1e-10


def test_learning_warns_of_what_a_person_should_look_at(noslip, slipping, tmp_path):
    out = tmp_path / "cut.json"
    quiet = noslip("learn", slipping, "--constraint", "blade", "--out", out)
    assert quiet.err == ""
    wrong = noslip("learn", slipping, "--constraint", "blade(lateral='x',edge='-y')", "--out", out)
    assert wrong.code == 0
    assert wrong.err.startswith("noslip: warning: ")
    assert "turns the tool by" in wrong.err


def test_numbers_that_ask_for_too_much_are_refused(noslip, slipping, primitive, tmp_path):
    out = tmp_path / "motion.csv"
    for arguments in (
        ["check", slipping, "--constraint", "blade", "--rate", "1e9"],
        ["rollout", primitive, "--out", out, "--time-step", "1e-9"],
        ["rollout", primitive, "--out", out, "--time-step", "1e9"],
        ["rollout", primitive, "--out", out, "--duration", "1e300", "--time-step", "1"],
        ["learn", slipping, "--out", out, "--basis-functions", "100000"],
    ):
        result = noslip(*arguments)
        assert result.code == 2
        assert result.err.startswith("noslip: error: ")
        assert result.err.count("\n") == 1
        assert not out.exists()


def test_own_constraint_from_a_file_and_calls_with_literals(noslip, slipping, tmp_path):
    rules = tmp_path / "my_rules.py"
    rules.write_text(
        "import noslip as ns\n\n"
        "@ns.position_constraint\n"
        "def stay_flat(motion):\n"
        "    return motion.position[2]\n"
    )
    assert noslip("check", slipping, "--constraint", f"{rules}:stay_flat").code == 0
    out = tmp_path / "both.json"
    result = noslip(
        *("learn", slipping, "--out", out, "--constraint", f"{rules}:stay_flat"),
        *("--constraint", "blade(lateral='-y', edge='x')"),
    )
    assert result.code == 0
    assert [c.name for c in ns.load_primitive(out).constraints] == ["stay flat", "blade"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["check", "missing.csv", "--constraint", "blade"], "missing.csv"),
        (["check", "{file}", "--constraint", "sword"], "known are"),
        (["check", "{file}", "--constraint", "blade(lateral=open('x'))"], "nothing is evaluated"),
        (["check", "{file}", "--constraint", "blade(width=3)"], "no argument 'width'"),
        (["check", "{file}", "--constraint", "nowhere.py:rule"], "nowhere.py: no such file"),
        (["check", "{file}", "--constraint", "blade", "--trim-time", "1-2"], "--trim-time"),
        (["check", "{file}", "--constraint", "blade", "--tool-frame", "1,2"], "--tool-frame"),
        (["check", "{file}", "--constraint", "blade", "--tolerance", "nan"], "tolerance"),
        (["learn", "{file}", "--constraint", "blade", "--out", "{folder}"], "is a folder"),
        (["learn", "{file}", "--out", "{folder}/p.json", "--metric", "both"], "--metric"),
        (["learn", "{file}", "--out", "{folder}/p.json", "--metric", "1,2"], "6 numbers"),
        *(
            ([*command, "{file}", "--out", "{folder}/x"], "a recording, not a primitive; learn one")
            for command in (["rollout"], ["adapt"], ["sample"], ["export"], ["simulate"])
        ),
        (["report", "{file}", "--out", "{folder}/x.pdf"], "a recording, not a primitive"),
        (["plot", "{file}", "--out", "{folder}/figure.gif"], "figure.gif"),
    ],
)
def test_bad_input_gets_one_line_that_names_it_and_exit_code_two(
    noslip, slipping, tmp_path, arguments, said
):
    filled = [a.format(file=slipping, folder=tmp_path) for a in arguments]
    result = noslip(*filled)
    assert result.code == 2
    assert result.out == ""
    assert result.err.startswith("noslip: error: ")
    assert result.err.count("\n") == 1
    assert said in result.err


@pytest.mark.parametrize("command", ["learn", "identify", "convert", "segment", "shield"])
def test_a_primitive_where_a_recording_is_read_is_to_be_rolled_out(noslip, tmp_path, command):
    (tmp_path / "a cut.json").write_text("{}")
    rule = () if command in ("identify", "convert", "segment") else ("--constraint", "blade")
    out = () if command == "identify" else ("--out", tmp_path / "out.csv")
    result = noslip(command, tmp_path / "a cut.json", *out, *rule)
    assert result.code == 2 and result.err.count("\n") == 1
    assert f"noslip rollout '{tmp_path}/a cut.json' --out motion.csv" in result.err


def test_refused_work_leaves_no_file(noslip, slipping, tmp_path):
    before = sorted(tmp_path.iterdir())
    out = tmp_path / "cut.json"
    result = noslip("learn", slipping, "--constraint", "blade(edge='q')", "--out", out)
    assert result.code == 2
    assert sorted(tmp_path.iterdir()) == before


def test_a_projection_that_cannot_converge_exits_with_one(noslip, slipping, tmp_path):
    rules = tmp_path / "rules.py"
    rules.write_text(
        "import casadi as ca, noslip as ns\n\n"
        "@ns.velocity_constraint\n"
        "def impossible(motion):\n"
        "    return ca.sumsqr(motion.linear_velocity) + 1\n"
    )
    out = tmp_path / "cut.json"
    result = noslip("learn", slipping, "--constraint", f"{rules}:impossible", "--out", out)
    assert result.code == 1
    assert "impossible" in result.err
    assert not out.exists()


def test_plot_draws_recordings_and_primitives(noslip, slipping, primitive, tmp_path):
    for suffix in ("png", "svg", "pdf"):
        out = tmp_path / f"figure.{suffix}"
        assert noslip("plot", slipping, primitive, "--out", out).code == 0
        assert out.stat().st_size > 5000


def test_plot_of_a_primitive_alone_shows_what_its_constraints_do(noslip, primitive, tmp_path):
    alone, asked, motion = (tmp_path / f"{name}.svg" for name in ("alone", "asked", "motion"))
    assert noslip("plot", primitive, "--out", alone).code == 0
    assert noslip("plot", primitive, "--show", "constraints", "--out", asked).code == 0
    assert noslip("plot", primitive, "--show", "motion", "--out", motion).code == 0
    dmp = ns.load_primitive(primitive)
    (expected,) = save_figure(
        constraint_history(dmp.rollout(), dmp.constraints), tmp_path / "expected.svg"
    )
    assert alone.read_bytes() == asked.read_bytes() == expected.read_bytes()
    assert motion.read_bytes() != alone.read_bytes()


@pytest.mark.parametrize(
    "others", [["{file}"], ["--constraint", "blade"], ["{file}", "--constraint", "blade"]]
)
def test_constraints_are_shown_of_one_primitive_alone(
    noslip, slipping, primitive, others, tmp_path
):
    filled = [other.format(file=slipping) for other in others]
    out = tmp_path / "figure.png"
    result = noslip("plot", primitive, *filled, "--show", "constraints", "--out", out)
    assert result.code == 2
    assert "--show constraints" in result.err
    assert not out.exists()


# ---------------------------------------------------------------- limits


@ns.velocity_constraint
def advance(motion):
    return motion.linear_velocity[0] - 0.03


def with_constraints(primitive, constraints, path) -> Path:
    """Save a primitive that is made to hold other constraints."""
    return under(ns.load_primitive(primitive), constraints).save(path)


@pytest.mark.parametrize(("priority", "kind"), [(0, "hard"), (2, "soft, priority 2")])
def test_rollout_says_what_gave_way_and_that_the_goal_is_missed(
    noslip, primitive, tmp_path, priority, kind
):
    limits = [ns.SpeedLimit(speed=0.01, priority=priority), ns.constraints.Box()]
    path = with_constraints(primitive, [advance, *limits], tmp_path / "contradictory.json")
    out = tmp_path / "motion.csv"
    result = noslip("rollout", path, "--out", out)
    assert result.code == 1
    assert "from the goal" in result.out
    motion = ns.load_primitive(path).rollout()
    (limit,) = motion.gave_way
    assert limit.violation > 0.019
    (line,) = [line for line in result.out.splitlines() if "gave way" in line]
    assert line.startswith(f"speed-limit ({kind}) gave way by up to {limit.violation:.3g} m/s, at ")
    assert "speed-limit: VIOLATED" in result.out

    result = noslip("rollout", path, "--out", out, "--json")
    assert result.code == 1
    (told,) = json.loads(result.out)["gave_way"]
    assert told == {
        "name": "speed-limit",
        "violation": limit.violation,
        "time": limit.time,
        "share": limit.share,
        "unit": "m/s",
        "priority": priority,
    }
    # The motion's own text stays free of it.
    result = noslip("rollout", path)
    assert result.code == 1
    assert result.out == motion.csv_text()
    assert "gave way" in result.err


def test_a_violated_equality_is_blamed_beside_soft_limits(noslip, primitive, tmp_path):
    soft = ns.SpeedLimit(speed=1.0, priority=1)
    path = with_constraints(primitive, [above_the_table, soft], tmp_path / "above.json")
    assert noslip("rollout", path, "--out", tmp_path / "motion.csv").code == 1


@ns.position_constraint
def above_the_table(motion):
    return motion.position[2] - 0.1


def test_rollout_in_which_nothing_gives_way_says_nothing(noslip, primitive, tmp_path):
    result = noslip("rollout", primitive, "--out", tmp_path / "motion.csv", "--json")
    assert json.loads(result.out)["gave_way"] == []
    assert "gave way" not in noslip("rollout", primitive, "--out", tmp_path / "motion.csv").out


def test_check_tells_margins_in_their_units(noslip, slipping):
    arguments = ["--constraint", "speed-limit(speed=0.06)", "--constraint", "box(upper=(0.05,1,1))"]
    result = noslip("check", slipping, *arguments)
    assert result.code == 1
    assert "speed-limit: HOLDS  least margin 0.01 m/s at" in result.out
    assert "box: VIOLATED  by " in result.out and " mm at " in result.out
    (report,) = json.loads(noslip("check", slipping, *arguments, "--json").out)
    speed, box = report["constraints"]
    assert speed["margin"] == pytest.approx(0.01, abs=1e-6)
    assert box["peak"] == -box["margin"] > 0
    assert (speed["unit"], box["unit"]) == ("m/s", "m")


def test_learn_tells_the_margins_of_its_motion(noslip, slipping, tmp_path):
    out = tmp_path / "cut.json"
    arguments = ("learn", slipping, "--out", out, "--constraint", "speed-limit(speed=0.06)")
    result = noslip(*arguments)
    assert result.code == 0
    assert "speed-limit of its motion: least margin " in result.out
    assert "residual of its motion" not in result.out
    told = json.loads(noslip(*arguments, "--json").out)
    found = ns.check(ns.load_primitive(out).rollout(), ns.SpeedLimit(speed=0.06))
    assert told["least_margins"] == {"speed-limit": found["speed-limit"].margin}
    assert told["residual_peak"] == 0.0


def test_a_closed_pipe_is_no_error(primitive):
    command = [sys.executable, "-m", "noslip", "rollout", str(primitive)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stderr is not None
    process.stdout.read(100)
    process.stdout.close()
    assert process.stderr.read() == b""
    process.stderr.close()
    process.wait()


@pytest.mark.parametrize(
    ("time", "length", "said"),
    [(1e9, 1.0, "are its times in other units"), (1.0, 1e3, "are its positions in other units")],
)
def test_odd_units_are_asked_after(
    time: float,
    length: float,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    s = np.linspace(0, 1, 50)
    motion = ns.PoseTrajectory(
        3 * time * s, length * np.column_stack([s, 0 * s, 0 * s]), Rotation.identity(50)
    )
    file = motion.to_npz(tmp_path / "odd.npz")
    monkeypatch.setattr("sys.argv", ["noslip", "check", str(file), "--constraint", "blade"])
    with contextlib.suppress(SystemExit):
        main()
    assert said in capsys.readouterr().err
