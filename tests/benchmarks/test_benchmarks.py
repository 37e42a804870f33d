"""What the benchmark measures, and that what it compares with is what it says."""

from __future__ import annotations

import io
import json
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from benchmarks import command, comparison, goals, paper_method, peers, perturbation, report
from benchmarks.case import Case, prepare
from benchmarks.environment import environment
from benchmarks.example import DURATION, MOVED_GOAL, SAMPLES, demonstration
from benchmarks.growth import Growth, grow, run_case
from benchmarks.timing import Candidate, Timing, forget, measure
from noslip import Blade, PoseTrajectory, check
from noslip.law import basis
from noslip.merit import figures_of_merit

needs_peer = pytest.mark.skipif(bool(peers.MISSING), reason=peers.MISSING)


# ---------------------------------------------------------------- the demonstration


def test_the_demonstration_is_the_papers() -> None:
    given = demonstration()
    assert len(given) == SAMPLES
    assert np.allclose(np.diff(given.times), 1e-3, atol=1e-12)
    assert given.times[-1] == DURATION
    assert np.allclose(given.positions[-1], [0.0, 1.0, 0.0], atol=1e-4)
    yaw_at_the_end = given.rotations[-1].as_euler("xyz")[2]
    assert yaw_at_the_end == pytest.approx(np.pi / 2, abs=1e-4)


# ---------------------------------------------------------------- the paper's method


def test_loss_is_the_formula_of_the_paper() -> None:
    random = np.random.default_rng(1)
    previous, wanted = Rotation.from_rotvec(random.normal(size=(2, 3)))
    velocity, free, w = random.normal(size=(3, 3))
    dt = 0.01

    cross_matrix = np.cross(w, np.eye(3)).T
    optimized = expm(cross_matrix * dt) @ previous.as_matrix()
    c = optimized @ [0.0, 1.0, 0.0]
    b = -np.cross(w, c) @ velocity
    force = np.linalg.pinv(c[None]) @ [b - c @ free]
    expected = np.linalg.norm(force) + np.linalg.norm(wanted.as_matrix() - optimized)

    quaternions = [tuple(r.as_quat(scalar_first=True)) for r in (previous, wanted)]
    loss = paper_method.loss_of_step(*quaternions, velocity, free, dt)
    assert loss(w) == pytest.approx(expected, rel=1e-12)


@pytest.fixture(scope="module")
def coarse() -> dict[int, paper_method.PaperResult]:
    return {n: paper_method.run(demonstration(n), basis_functions=20) for n in (31, 61, 121)}


def test_paper_method_satisfies_the_constraint_to_the_order_of_the_step(
    coarse: dict[int, paper_method.PaperResult],
) -> None:
    residuals = {n: check(r.motion, Blade()).peak for n, r in coarse.items()}
    for samples, residual in residuals.items():
        motion = coarse[samples].motion
        linear, angular = (np.linalg.norm(v, axis=1) for v in motion.step_velocities())
        # It holds the constraint at one end of a step: half the step's turn off in the middle.
        assert 1e-9 < residual < np.max(linear * angular) * DURATION / (samples - 1) / 2
    assert residuals[121] < residuals[61] / 2 * 1.1


def test_paper_method_follows_the_path(coarse: dict[int, paper_method.PaperResult]) -> None:
    for samples, result in coarse.items():
        merit = figures_of_merit(result.motion, demonstration(samples))
        assert merit.position_rms < 0.01
        assert merit.end_error < 0.01


def test_optimizing_is_what_keeps_the_path(coarse: dict[int, paper_method.PaperResult]) -> None:
    given = demonstration(61)
    assert check(given, Blade()).peak > 1.0
    turned = (coarse[61].motion.rotations * given.rotations.inv()).magnitude()
    assert turned.max() > 0.5


def test_uncoupled_primitives_reproduce_the_demonstrated_orientation() -> None:
    given = demonstration(200)
    turns = paper_method.orientation_rollout(paper_method.UncoupledPrimitives.fit(given))
    error = Rotation.from_quat(turns, scalar_first=True) * given.rotations.inv()
    assert error.magnitude().max() < 1e-3


def test_paper_method_comes_to_rest_without_force_after_its_end() -> None:
    given = demonstration(61)
    primitives = paper_method.UncoupledPrimitives.fit(given, 20)
    stepping = paper_method.Stepping(primitives, turning=np.zeros((60, 3)))
    states = [stepping.start()]
    while len(states) < 4 * len(given):
        states.append(stepping.step(states[-1]))
    assert np.linalg.norm(states[60].velocity) > 0.1
    assert np.linalg.norm(states[-1].velocity) < 1e-3


def test_kept_orientations_are_the_optimized_ones(
    coarse: dict[int, paper_method.PaperResult],
) -> None:
    primitives = paper_method.UncoupledPrimitives.fit(demonstration(61), 20)
    kept = paper_method.rollout(primitives, turning=coarse[61].turning)
    assert kept.evaluations == 0
    assert np.allclose(kept.motion.positions, coarse[61].motion.positions, atol=1e-12)


# ---------------------------------------------------------------- goals that move


@pytest.fixture(scope="module")
def arrivals() -> list[goals.Arrival]:
    return goals.move_goals(samples=61, basis_functions=20, shifts=(0.2,))


def test_goals_are_moved_by_every_method_alike(arrivals: list[goals.Arrival]) -> None:
    methods = [a.method for a in arrivals if a.direction == "unmoved"]
    assert len(methods) == 5
    assert [a.method for a in arrivals] == 5 * methods
    assert {a.shift for a in arrivals} == {0.0, 0.2}


def test_adapt_arrives_where_a_coupling_term_alone_stops_short(
    arrivals: list[goals.Arrival],
) -> None:
    for a in arrivals:
        if a.method in (goals.ADAPTED, goals.TO_THE_DEMONSTRATED):
            assert a.position < 0.005
            assert a.rotation < 0.01
            assert a.residual < 1e-10
    (short,) = (
        a for a in arrivals if a.method == goals.COUPLED and a.direction.endswith("arrives")
    )
    assert 0.01 < short.position < 0.2


def test_the_moved_goal_lies_along_the_demonstrated_lateral_axis() -> None:
    given = demonstration(61)
    moved = given.positions[-1] + 0.2 * given.rotations[-1].apply([0.0, 1.0, 0.0])
    assert np.allclose(MOVED_GOAL, moved, atol=1e-4)


# ---------------------------------------------------------------- pushes


@pytest.fixture(scope="module")
def recoveries(tmp_path_factory: pytest.TempPathFactory) -> list[perturbation.Recovery]:
    absent = tmp_path_factory.mktemp("recordings") / "absent"
    return perturbation.perturb(
        samples=61, basis_functions=20, cases=2, optimized_every=2, recordings=absent
    )


def test_what_is_optimized_is_of_all_motions_and_kinds_alike() -> None:
    optimized = perturbation.pushes(252, ["a", "b", "c"])[:: perturbation.OPTIMIZED_EVERY]
    assert set(Counter((p.motion, p.kind) for p in optimized).values()) == {6}


def test_pushes_are_half_sideways_and_always_the_same() -> None:
    names = ["one", "two"]
    pushes = perturbation.pushes(40, names)
    assert sum(p.kind == perturbation.SIDEWAYS for p in pushes) == 20
    assert {(p.motion, p.kind) for p in pushes} == {
        (name, kind) for name in names for kind in (perturbation.SIDEWAYS, perturbation.ANYWHERE)
    }
    again = perturbation.pushes(40, names)
    for p, same in zip(pushes, again, strict=True):
        assert (p.at, p.size) == (same.at, same.size)
        assert 0.01 <= p.size <= 0.2
        turn = Rotation.from_rotvec([0.3, 0.2, 0.1])
        shift = p.shift(turn, 2.0)
        assert np.linalg.norm(shift) == pytest.approx(2 * p.size)
        if p.kind == perturbation.SIDEWAYS:
            across = turn.inv().apply(shift)
            assert np.allclose(across[[0, 2]], 0, atol=1e-12)


def test_all_methods_get_the_same_pushes(recoveries: list[perturbation.Recovery]) -> None:
    kinds = [perturbation.NOT_PUSHED, perturbation.SIDEWAYS, perturbation.ANYWHERE]
    for method in (perturbation.NOSLIP, perturbation.COUPLED):
        assert [r.kind for r in recoveries if r.method == method] == kinds
    # Every other one was asked for, the first one among them.
    assert [r.kind for r in recoveries if r.method == perturbation.OPTIMIZED] == kinds[:2]
    for r in recoveries:
        assert np.isfinite([r.error, r.residual, r.angular_speed]).all()
        assert r.duration >= 1
        if r.method == perturbation.NOSLIP:
            assert r.residual < 1e-10
        if r.kind == perturbation.NOT_PUSHED:
            assert r.error < 0.01


def test_summaries_count_what_was_reached() -> None:
    errors = [0.0, 0.002, 0.01, 0.3]
    found = [
        perturbation.Recovery("m", "motion", perturbation.SIDEWAYS, 0.5, 0.1, e, e, 2.0, 1.1)
        for e in errors
    ]
    by_group = {s.cases: s for s in perturbation.summaries(found)}
    assert set(by_group) == {"all pushes", perturbation.SIDEWAYS, "motion"}
    s = by_group["all pushes"]
    assert (s.count, s.reached, s.worst, s.residual) == (4, 0.75, 0.3, 0.3)
    assert s.median == pytest.approx(0.006)


# ---------------------------------------------------------------- figures of merit


def test_merit_agrees_with_check() -> None:
    given = demonstration(100)
    merit = figures_of_merit(given, given, Blade())
    assert merit.position_rms == merit.end_error == 0.0
    assert merit.residual_peak == pytest.approx(check(given, [Blade()]).constraints[0].peak)


def test_merit_of_a_uniform_turn() -> None:
    times = np.linspace(0.0, 2.0, 41)
    turning = PoseTrajectory(
        times=times,
        positions=np.zeros((41, 3)),
        rotations=Rotation.from_rotvec(times[:, None] * [0.0, 0.0, 1.5]),
    )
    merit = figures_of_merit(turning, turning)
    assert merit.angular_speed_peak == pytest.approx(1.5)
    assert merit.angular_acceleration_peak == pytest.approx(0.0, abs=1e-9)


def test_merit_of_motions_sampled_otherwise_is_at_the_same_fraction_of_them() -> None:
    def going(duration: float, samples: int) -> PoseTrajectory:
        share = np.linspace(0.0, 1.0, samples)
        return PoseTrajectory(
            times=duration * share,
            positions=share[:, None] * [1.0, 0.0, 0.0],
            rotations=Rotation.identity(samples),
        )

    merit = figures_of_merit(going(3.0, 30), going(1.0, 41))
    assert merit.position_rms == pytest.approx(0.0, abs=1e-12)
    assert merit.speed_peak == pytest.approx(1 / 3)


# ---------------------------------------------------------------- timing


def test_candidates_take_turns() -> None:
    calls: list[str] = []
    candidates = [
        Candidate("a", "a", "x", lambda: calls.append("a"), per_round=2),
        Candidate("b", "b", "x", lambda: calls.append("b"), warm_up=lambda: calls.append("w")),
    ]
    timings = measure(candidates, rounds=2)
    assert calls == ["a", "w", "a", "a", "b", "a", "a", "b"]
    assert (timings["a"].runs, timings["b"].runs) == (4, 2)


def test_quartiles_surround_the_median() -> None:
    timing = Timing.of(Candidate("a", "a", "x", lambda: None), [5.0, 1.0, 2.0, 3.0, 4.0])
    assert (timing.minimum, timing.lower_quartile, timing.median, timing.upper_quartile) == (
        1.0,
        2.0,
        3.0,
        4.0,
    )


def test_forget_empties_the_caches_of_noslip() -> None:
    caches = [c for c in vars(basis).values() if hasattr(c, "cache_info")]
    prepare("rollout", 50, 10)()
    assert any(cache.cache_info().currsize for cache in caches)
    forget()
    assert not any(cache.cache_info().currsize for cache in caches)


# ---------------------------------------------------------------- growth


def _cases(seconds: dict[int, float], memory: dict[int, int]) -> Growth:
    cases = tuple(Case("learn", n, 100, s, s, memory[n]) for n, s in seconds.items())
    return Growth("learn", "samples", cases)


def test_exponent_is_the_slope_between_the_two_largest_sizes() -> None:
    growth = _cases({10: 5.0, 100: 1.0, 1000: 100.0}, {10: 0, 100: 2_000_000, 1000: 20_000_000})
    assert growth.time_exponent == pytest.approx(2.0)
    assert growth.memory_exponent == pytest.approx(1.0)


def test_exponent_is_absent_where_there_is_none() -> None:
    assert _cases({10: 1.0}, {10: 5_000_000}).time_exponent is None
    assert _cases({10: 1.0, 100: 2.0}, {10: 4096, 100: 8192}).memory_exponent is None


def test_a_case_runs_in_a_process_of_its_own() -> None:
    case = run_case("fit", 100, 10)
    assert case is not None
    assert (case.task, case.samples, case.basis_functions) == ("fit", 100, 10)
    assert 0 < case.seconds < 60
    assert case.memory is None or case.memory >= 0


def test_no_case_is_started_without_time_left() -> None:
    assert run_case("fit", 100, 10, seconds_left=0.0) is None


def test_a_failing_case_says_why() -> None:
    with pytest.raises(RuntimeError, match="no such task: dance"):
        run_case("dance", 100, 10)


@needs_peer
def test_growth_of_the_other_library_is_measured_at_the_same_steps() -> None:
    times, poses = prepare("open_loop", 51, 10)()
    assert len(times) == len(poses) == 51


# ---------------------------------------------------------------- the whole

TINY = {"samples": 40, "rounds": 1, "basis_functions": 10, "repeat_fast": 1}


@pytest.fixture(scope="module")
def compared() -> comparison.Comparison:
    return comparison.compare(**TINY)


@pytest.fixture(scope="module")
def growths() -> list[Growth]:
    return grow(sample_sizes=(50, 100), basis_sizes=(), tasks=("fit",))


def test_comparison_measures_all_methods(compared: comparison.Comparison) -> None:
    timings, merits = compared.timings, compared.merits
    assert {"paper", "fit", "learn", "rollout", "step"} <= set(timings)
    assert {"imitate", "open_loop"} <= set(timings) or peers.MISSING
    assert merits["noslip"].residual_peak < 1e-10 < merits["the paper's method"].residual_peak
    first = compared.ratios[0]
    assert first.value == pytest.approx(timings["paper"].median / timings["learn"].median)
    assert first.met == (first.value >= 80)


@needs_peer
def test_the_other_library_follows_the_demonstration(compared: comparison.Comparison) -> None:
    assert compared.merits["movement-primitives, unconstrained"].end_error < 0.05
    assert "orientation" in peers.step_functions()


@pytest.fixture(scope="module")
def results(
    compared: comparison.Comparison,
    growths: list[Growth],
    arrivals: list[goals.Arrival],
    recoveries: list[perturbation.Recovery],
) -> report.Results:
    return report.Results(compared, growths, arrivals, recoveries, environment())


def test_json_holds_everything(compared: comparison.Comparison, results: report.Results) -> None:
    content = json.loads(report.as_json(results))
    assert content["environment"]["numpy"] == np.__version__
    assert content["demonstration"]["samples"] == 40
    assert {t["key"] for t in content["timings"]} == set(compared.timings)
    assert [set(r) for r in content["ratios"]] == [
        {"name", "value", "target", "of_lowest", "met"}
    ] * 5
    assert content["merits"]["noslip"]["position_rms"] < 0.1
    assert [g["axis"] for g in content["growth"]] == ["samples"]
    assert [c["samples"] for c in content["growth"][0]["cases"]] == [50, 100]
    assert content["growth"][0]["time_exponent"] is not None
    assert len(content["moved_goals"]) == len(results.arrivals)
    assert len(content["pushes"]["cases"]) == len(results.recoveries)
    assert content["pushes"]["summaries"][0]["cases"] == perturbation.NOT_PUSHED


def test_tables_show_every_measurement(
    compared: comparison.Comparison, results: report.Results
) -> None:
    shown = io.StringIO()
    report.show(Console(file=shown, width=140), results)
    text = shown.getvalue()
    for timing in compared.timings.values():
        assert timing.label in text
    for name in compared.merits:
        assert name in text
    for ratio in compared.ratios:
        assert ratio.name in text
    assert "noslip fit" in text
    for arrival in results.arrivals:
        assert arrival.method in text
        assert arrival.direction in text
    for summary in perturbation.summaries(results.recoveries):
        assert summary.cases in text


def test_without_the_other_library_the_tables_say_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(peers, "MISSING", "movement-primitives is left out: not installed")
    compared = comparison.compare(**TINY)
    assert "imitate" not in compared.timings
    assert [ratio.met for ratio in compared.ratios[1:3]] == [None, None]
    results = report.Results(compared, [], [], [], environment())
    shown = io.StringIO()
    report.show(Console(file=shown, width=140), results)
    assert "movement-primitives is left out" in shown.getvalue()
    assert "not measured" in shown.getvalue()
    assert json.loads(report.as_json(results))["left_out"]


def test_command_prints_and_writes(
    uncounted: None,
    results: report.Results,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(command, "compare", lambda **_: results.comparison)
    monkeypatch.setattr(command, "grow", lambda **_: list(results.growths))
    # What is patched is no other process's.
    monkeypatch.setattr(
        command, "ProcessPoolExecutor", lambda count, mp_context: ThreadPoolExecutor(count)
    )
    monkeypatch.setattr(command, "move_goals", lambda **_: results.arrivals)
    monkeypatch.setattr(command, "perturb", lambda **_: results.recoveries)
    out = tmp_path / "new" / "results.json"
    assert command.run(["--quick", "--out", str(out)]) == 0
    assert json.loads(out.read_text())["format"] == report.FORMAT
    captured = capsys.readouterr()
    assert "learn with projection" in captured.out
    assert not captured.err


def test_help_has_examples(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        command.run(["--help"])
    assert stopped.value.code == 0
    assert "python -m benchmarks --quick" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(5.361, "5.36 s"), (0.0953, "95.3 ms"), (0.000146, "146 µs"), (3e-7, "0.30 µs")],
)
def test_durations_have_three_digits(seconds: float, text: str) -> None:
    assert report.duration(seconds) == text
