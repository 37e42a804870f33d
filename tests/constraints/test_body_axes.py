"""A body axis is a letter or a direction: the same constraint, of a body that is turned."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from measures import apart, speed_along
from noslip import Constraint
from noslip._typing import Floats
from noslip.constraints import ConstraintSystem, ForwardOnly, RemoteCenter, RollingDisc, ToolAxis
from noslip.constraints.catalog import parse_constraint, restore, specification
from noslip.constraints.travel import TurningRadius
from noslip.edge import Edge, other_axes, unit_axis
from noslip.errors import ConstraintError
from noslip.experiments.numerical_example import demonstration
from strategies import AXES, axis_vector, seeds, triple

CENTER, UP, POINT = (0.3, -0.2, 0.5), (0.1, 0.2, 1.0), (0.02, 0.05, -0.1)
KINDS: dict[str, Callable[[Any], Constraint]] = {
    "blade": lambda of: ns.Blade(of("y"), of("-x"), of(POINT)),
    "wheel": lambda of: ns.Wheel(of("-y"), of("z"), UP, of(POINT)),
    "needle": lambda of: ns.Needle(of("-x"), bevel=of("z"), reference_point=of(POINT)),
    "curved needle": lambda of: ns.Needle(of("z"), 4.0, of("-y"), of(POINT)),
    "remote center": lambda of: RemoteCenter(CENTER, of("z"), of(POINT)),
    "rolling disc": lambda of: RollingDisc(0.1, of("y"), UP, of(POINT)),
    "tool axis": lambda of: ToolAxis(of("z"), UP),
    "tool at an angle": lambda of: ToolAxis(of("-x"), UP, 0.4),
    "forward only": lambda of: ForwardOnly(edge=of("-x"), reference_point=of(POINT)),
    "turning radius": lambda of: TurningRadius(0.2, of("x"), of("-z"), of(POINT)),
}


def turned(turn: Rotation, length: float = 1.0) -> Callable[[Any], Any]:
    """Axes and points of a body, in the frame from which the body's is turned away."""
    return lambda value: (
        triple(length * turn.apply(axis_vector(value)))
        if isinstance(value, str)
        else triple(turn.apply(value))
    )


def residuals(constraint: Constraint, rotation: Rotation, rest: tuple[Any, ...]) -> Floats:
    t, p, v, w = rest
    quaternion = rotation.as_quat(scalar_first=True)
    return ConstraintSystem(constraint).residuals(t, p, quaternion, v, w)[0]


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds, length=st.sampled_from([1e-200, 0.3, 1e5]))
@settings(max_examples=15)
def test_a_direction_is_the_axis_of_a_body_that_is_turned(
    kind: str, seed: int, length: float
) -> None:
    rng = np.random.default_rng(seed)
    turn, rotation = Rotation.random(2, random_state=rng)
    rest = (0.3, *rng.normal(size=(3, 3)))
    there = residuals(KINDS[kind](turned(turn, length)), rotation, rest)
    here = residuals(KINDS[kind](lambda value: value), rotation * turn, rest)
    # Which two axes across another one are meant is free: their length together is not.
    pairs = {"needle": 2, "curved needle": 2, "remote center": 2, "tool axis": 2}.get(kind, 1)
    np.testing.assert_allclose(
        *(
            np.linalg.norm(rows.reshape(-1, pairs), axis=1) if pairs > 1 else rows
            for rows in (there, here)
        ),
        rtol=0,
        atol=1e-13,
    )


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds)
@settings(max_examples=5)
def test_what_has_directions_is_saved_and_written_as_it_is(kind: str, seed: int) -> None:
    turn = Rotation.random(random_state=np.random.default_rng(seed))
    constraint = KINDS[kind](turned(turn))
    assert restore(json.loads(json.dumps(specification(constraint)))) == constraint
    arguments = specification(constraint)["arguments"].items()
    text = ", ".join(f"{name}={value!r}" for name, value in arguments)
    assert parse_constraint(f"{constraint.name}({text})") == constraint


@pytest.mark.parametrize("axis", AXES)
def test_a_direction_along_a_body_axis_is_that_axis(axis: str) -> None:
    direction = triple(2.5 * axis_vector(axis))
    leads = "z" if axis[-1] == "x" else "x"
    assert ns.Blade(direction, edge=leads) == ns.Blade(axis, edge=leads)
    np.testing.assert_array_equal(unit_axis(direction), unit_axis(axis))


@given(seeds)
def test_the_axes_across_a_direction_complete_it(seed: int) -> None:
    direction = np.random.default_rng(seed).normal(size=3)
    axes = np.array([unit_axis(direction), *other_axes(triple(direction))])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-14)


@given(seeds)
def test_the_edge_leads_across_the_lateral_axis(seed: int) -> None:
    lateral, travel = np.random.default_rng(seed).normal(size=(2, 3))
    # Nearly parallel axes are refused.
    apart = np.linalg.norm(np.cross(lateral, travel))
    assume(apart > 0.11 * np.linalg.norm(lateral) * np.linalg.norm(travel))
    frame = Edge(triple(travel), triple(lateral)).frame
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-13)
    assert np.linalg.det(frame) == pytest.approx(1)
    assert frame[1] @ lateral == pytest.approx(np.linalg.norm(lateral))
    # Travel is the direction nearest to the given one of those across the lateral axis.
    assert frame[0] @ travel == pytest.approx(np.linalg.norm(np.cross(travel, frame[1])))


@pytest.mark.parametrize(
    "make",
    [
        lambda axis: ns.Blade(axis),
        lambda axis: ns.Needle(bevel=axis),
        lambda axis: ns.Wheel(axis),
        lambda axis: TurningRadius(up=axis),
    ],
)
@pytest.mark.parametrize("axis", ["x", (-2, 0, 0), (1, 0.05, -0.05)])
def test_parallel_axes_are_refused(make: Any, axis: Any) -> None:
    with pytest.raises(ConstraintError, match="must not be parallel"):
        make(axis)


@pytest.mark.parametrize("axis", [(0, 0, 0), (1, 2), (1, np.nan, 0), ("x", "y", "z"), True])
def test_what_is_no_direction_is_refused(axis: Any) -> None:
    with pytest.raises(ConstraintError, match=r"three numbers, not all 0; got"):
        ns.Blade(axis)


def test_a_turned_sensor_learns_the_same_motion() -> None:
    # The recorder's frame is turned from the blade's: the blade is told in that frame.
    turn = Rotation.from_rotvec([0.3, -0.5, 0.8])
    straight = demonstration()
    recorded = ns.PoseTrajectory(
        straight.times, straight.positions, straight.rotations * turn.inv()
    )
    blade = ns.Blade(*map(turned(turn), ("y", "x")))
    there, here = ns.learn(recorded, [blade]).rollout(), ns.learn(straight, [ns.Blade()]).rollout()
    assert np.abs(speed_along(there, turn.apply([0, 1, 0]))).max() < 1e-10
    back = ns.PoseTrajectory(there.times, there.positions, there.rotations * turn)
    assert apart(back, here) < (1e-9, 1e-6)
