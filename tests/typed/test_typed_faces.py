"""What a type checker knows of the public faces.

``mypy`` reads this file too (``make check``): where a line says ``type: ignore``, it must find the
fault that is named, or it complains that there is nothing to ignore.  Run, each says the same.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, assert_type, get_type_hints

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.adapting import adapt
from noslip.constraints import AcceleratedInstant, FunctionConstraint
from noslip.distribution import MotionDistribution
from noslip.errors import ConstraintError, InputError
from noslip.learning import Learning, learn
from noslip.primitive import Controlling
from noslip.recordings.formats import Reading, ReadingColumns, load_demonstrations

Floats = NDArray[np.float64]
R = Rotation.identity(3)


def straight() -> ns.PoseTrajectory:
    """40 samples along x, the blade along its way."""
    places = np.outer(np.linspace(0, 0.1, 40), [1, 0, 0])
    return ns.PoseTrajectory(np.linspace(0, 2, 40), places, Rotation.identity(40))


def learned_of(cuts: list[ns.PoseTrajectory]) -> None:
    """Read by mypy alone: what learning returns, by whether a distribution is asked for."""
    assert_type(ns.learn(cuts, [ns.Blade()], distribution=True), MotionDistribution)
    assert_type(ns.learn(cuts, ns.Blade(), align=True), ns.ConstrainedDMP)
    assert_type(ns.learn(cuts, distribution=False), ns.ConstrainedDMP)


def test_what_is_like_an_array_is_taken_and_kept_as_one() -> None:
    poses = ns.PoseTrajectory([0, 1, 2], [[0, 0, 0]] * 3, R)
    assert_type(poses.positions, Floats)
    assert_type(poses.linear_velocities, Floats)
    vectors = ns.Trajectory([0, 1, 2], [[0.0, 1]] * 3, ["q1", "q2"], units=["rad", "rad"])
    assert_type(vectors.values, Floats)
    assert_type(vectors.names, tuple[str, ...])
    passed = ns.Boundary(0.5, [0, 0, 1], linear_velocity=(1, 0, 0))
    assert_type(passed.position, Floats | None)
    assert poses.positions.shape == (3, 3) and vectors.values.dtype == np.float64
    assert passed.position is not None and passed.position.tolist() == [0, 0, 1]


def test_misspelt_keywords_are_told_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(TypeError):
        ns.PoseTrajectory([0, 1, 2], [[0, 0, 0]] * 3, R, nam="cut")  # type: ignore[call-arg]
    with pytest.raises(TypeError):
        ns.Trajectory([0, 1, 2], [[0.0]] * 3, unit=["m"])  # type: ignore[call-arg]
    with pytest.raises(TypeError):
        ns.Boundary(0.5, positions=[0, 0, 0])  # type: ignore[call-arg]
    with pytest.raises(TypeError):
        ns.learn(straight(), ns.Blade(), hold_positions=True)  # type: ignore[call-overload]
    with pytest.raises(TypeError):
        ns.load_trajectory(tmp_path / "a.csv", colums="x")  # type: ignore[call-arg]
    with pytest.raises(InputError, match=r"did you mean basis_functions\?"):
        ns.learn_each(tmp_path / "a.csv", ns.Blade(), bassis_functions=20)  # type: ignore[call-arg]
    dmp = ns.learn(straight(), ns.Blade(), basis_functions=20)
    with pytest.raises(TypeError):
        dmp.rollout(goal_positon=[0, 0, 0])  # type: ignore[call-arg]
    with pytest.raises(TypeError):
        dmp.adapt(goal_positon=[0, 0, 0])  # type: ignore[call-arg]
    with pytest.raises(TypeError):
        dmp.controller(time_step=0.01, follow=True)  # type: ignore[call-arg]
    with pytest.raises(TypeError):
        ns.Blade(laterall="y")  # type: ignore[call-arg]


def test_primitives_return_what_they_say() -> None:
    dmp = ns.learn(straight(), ns.Blade(), basis_functions=20)
    assert_type(dmp.rollout(duration=3), ns.Motion)
    there = [0.1, 0, 0], Rotation.identity()
    assert_type(dmp.rollout(goal=there, start_position=[0, 0, 0]), ns.Motion)
    assert_type(dmp.adapt(goal=there, via=[(0.5, [0.05, 0, 0])], samples=50), ns.ConstrainedDMP)
    with pytest.raises(InputError):
        dmp.rollout(goal_form="minimum jerk")  # type: ignore[arg-type]


# ---------------------------------------------------------------- rules of one's own


@ns.velocity_constraint
def plain(motion: ns.Instant) -> Any:
    return motion.linear_velocity[1]


@ns.velocity_constraint(name="the screw")
def screw(motion: ns.Instant, *, lead: float = 0.002, axis: tuple[float, ...] = (0, 0, 1)) -> Any:
    """Along its axis, the driver advances by the lead for each turn."""
    along = motion.rotation @ np.array(axis)
    return along.T @ motion.linear_velocity - lead / (2 * np.pi) * along.T @ motion.angular_velocity


@ns.keep_nonnegative(level="acceleration", priority=1)
def gentle(motion: AcceleratedInstant, most: float) -> Any:
    return most - motion.linear_acceleration[0]


def test_the_decorator_types_what_a_rule_is_given() -> None:
    ns.position_constraint(name="flat")(lambda motion: assert_type(motion, ns.Instant).position[2])
    ns.keep_nonnegative(level="acceleration")(
        lambda motion: assert_type(motion, AcceleratedInstant).linear_acceleration[0]
    )
    assert_type(plain, FunctionConstraint[[]])

    def of_another(motion: ns.Motion) -> Any:
        return motion.positions

    ns.velocity_constraint(of_another)  # type: ignore[arg-type]

    @ns.velocity_constraint
    def misspelt(motion: ns.Instant) -> Any:
        return motion.linear_velocty[0]  # type: ignore[attr-defined]

    with pytest.raises(ConstraintError, match=r"did you mean linear_velocity\?"):
        ns.check(straight(), misspelt)


def test_parameters_are_typed() -> None:
    assert_type(screw(lead=0.003).parameters, dict[str, Any])
    assert isinstance(gentle(2.0), ns.Constraint)
    with pytest.raises(ConstraintError, match=r"did you mean lead\?"):
        screw(laed=0.003)  # type: ignore[call-arg]
    with pytest.raises(ConstraintError, match="is a finite number, a text"):
        screw(lead=straight())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "of", "more"),
    [
        (Learning, learn, {"demonstrations", "constraints", "distribution", "context", "progress"}),
        (ReadingColumns, load_demonstrations, {"paths"}),
    ],
)
def test_options_that_are_handed_on_are_all_of_them(options: Any, of: Any, more: set[str]) -> None:
    hints = get_type_hints(of)
    known = {name: kind for name, kind in hints.items() if name not in {*more, "return"}}
    assert get_type_hints(options) == known


def test_options_of_controllers_are_those_of_either() -> None:
    from noslip.control import Controller
    from noslip.control.coordinates import SpaceController

    known = {*get_type_hints(Controller.__init__), *get_type_hints(SpaceController.__init__)}
    assert set(get_type_hints(Controlling)) == known - {"dmp", "time_step", "return"}
    assert set(get_type_hints(Reading)) < set(get_type_hints(ReadingColumns))
    assert "goal" in get_type_hints(adapt)
