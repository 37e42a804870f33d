"""The catalog's limits: margins against NumPy formulas, slopes everywhere, text and JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip import Constraint, DepthLimit, KeepOutSphere, NoslipError, SpeedLimit
from noslip._typing import Floats
from noslip.constraints import (
    AccelerationLimit,
    AngularRateLimit,
    Box,
    ConstraintSystem,
    ForwardOnly,
    HalfSpace,
    KeepOutCapsule,
    TurningRadius,
)
from noslip.constraints.catalog import CATALOG, build, parse_constraint, restore, specification
from noslip.constraints.declaration import constraint_function
from noslip.constraints.limit import Limit
from noslip.errors import ConstraintError
from refusals import refusal
from strategies import AXES

Vector = tuple[float, float, float]

LIMITS: list[type[Limit]] = [
    AccelerationLimit,
    AngularRateLimit,
    Box,
    DepthLimit,
    ForwardOnly,
    HalfSpace,
    KeepOutCapsule,
    KeepOutSphere,
    SpeedLimit,
    TurningRadius,
]
NAMES = {
    "half-space": HalfSpace,
    "depth-limit": DepthLimit,
    "box": Box,
    "keep-out-sphere": KeepOutSphere,
    "keep-out-capsule": KeepOutCapsule,
    "speed-limit": SpeedLimit,
    "angular-rate-limit": AngularRateLimit,
    "acceleration-limit": AccelerationLimit,
    "forward-only": ForwardOnly,
    "turning-radius": TurningRadius,
}

# -------------------------------------------------------------------- states


@dataclass(frozen=True)
class Moment:
    """One instant of a motion, as numbers."""

    position: Vector = (0.0, 0.0, 0.0)
    turn: Vector = (0.0, 0.0, 0.0)
    linear_velocity: Vector = (0.0, 0.0, 0.0)
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    linear_acceleration: Vector = (0.0, 0.0, 0.0)
    angular_acceleration: Vector = (0.0, 0.0, 0.0)

    @property
    def rotation(self) -> Rotation:
        return Rotation.from_rotvec(self.turn)

    def axis(self, name: str) -> Floats:
        sign = -1.0 if name[0] == "-" else 1.0
        return sign * self.rotation.as_matrix()[:, "xyz".index(name[-1])]

    def place(self, reference_point: Vector) -> Floats:
        return np.asarray(self.position + self.rotation.apply(reference_point))

    def velocity(self, reference_point: Vector) -> Floats:
        swing = np.cross(self.angular_velocity, self.rotation.apply(reference_point))
        return np.asarray(self.linear_velocity + swing)


def margins(limit: Constraint, m: Moment) -> Floats:
    """What noslip says."""
    return ConstraintSystem(limit).residuals(
        0.0,
        m.position,
        m.rotation.as_quat(scalar_first=True),
        m.linear_velocity,
        m.angular_velocity,
        m.linear_acceleration,
        m.angular_acceleration,
    )[0]


def symbols() -> list[Any]:
    return [ca.SX.sym("t"), *(ca.SX.sym("u", *s) for s in [(3,), (3, 3), *[(3,)] * 4])]


@cache
def slope_function(limit: Constraint) -> ca.Function:
    given = symbols()
    margin = constraint_function(limit)(*given)
    return ca.Function("slope", given, [ca.jacobian(margin, ca.vertcat(*map(ca.vec, given[1:])))])


def slopes(limit: Constraint, m: Moment) -> Floats:
    """Derivatives of the margins by p, R's entries, v, w, a and alpha: shape (rows, 24)."""
    return np.array(slope_function(limit)(0.0, *quantities(m)))


def quantities(m: Moment) -> list[Any]:
    return [
        m.position,
        m.rotation.as_matrix(),
        m.linear_velocity,
        m.angular_velocity,
        m.linear_acceleration,
        m.angular_acceleration,
    ]


def vectors(size: float = 1.0) -> st.SearchStrategy[Vector]:
    number = st.floats(-size, size)
    return st.tuples(number, number, number)


def directions() -> st.SearchStrategy[Vector]:
    return vectors(10).filter(lambda n: float(np.linalg.norm(n)) > 1e-3)


def sizes(least: float = 1e-3) -> st.SearchStrategy[float]:
    return st.floats(least, 2.0)


moments = st.builds(Moment, vectors(), vectors(4), vectors(), vectors(5), vectors(10), vectors(10))
axes = st.sampled_from(AXES)
CLOSE: dict[str, float] = {"rtol": 1e-12, "atol": 1e-11}


# -------------------------------------------------------------------- margins


@given(moments, vectors(), directions(), vectors())
def test_half_space_is_the_distance_to_its_plane(
    m: Moment, point: Vector, normal: Vector, r: Vector
) -> None:
    limit = HalfSpace(point, normal, r)
    # The plane's point nearest to the tool, from the normal equations of the plane.
    n = np.array(normal)
    step = n @ (m.place(r) - point) / (n @ n)
    expected = math.copysign(float(np.linalg.norm(step * n)), step)
    np.testing.assert_allclose(margins(limit, m), [expected], **CLOSE)


@given(moments, st.floats(0, 0.5), vectors(), directions(), vectors())
def test_depth_limit_is_what_is_left_of_the_depth(
    m: Moment, depth: float, surface: Vector, normal: Vector, r: Vector
) -> None:
    limit = DepthLimit(depth, surface, normal, r)
    n = np.array(normal) / np.linalg.norm(normal)
    below = -n @ (m.place(r) - surface)
    np.testing.assert_allclose(margins(limit, m), [depth - below], **CLOSE)


@given(
    moments,
    st.tuples(*[st.floats(-2, 0) | st.none()] * 3),
    st.tuples(*[st.floats(0.1, 2) | st.none()] * 3),
    vectors(),
)
def test_box_has_a_row_for_each_side(m: Moment, lower: Any, upper: Any, r: Vector) -> None:
    count = 6 - (lower + upper).count(None)
    if count == 0:
        with pytest.raises(ConstraintError, match="box: lower and upper"):
            Box(lower, upper)
        return
    found = margins(Box(lower, upper, r), m)
    p = m.place(r)
    expected = [p[i] - lower[i] for i in range(3) if lower[i] is not None]
    expected += [upper[i] - p[i] for i in range(3) if upper[i] is not None]
    assert len(found) == count
    np.testing.assert_allclose(found, expected, **CLOSE)


def test_infinite_sides_of_a_box_are_left_out() -> None:
    inf = math.inf
    assert Box([-inf, -1, None], (1, np.inf, inf)) == Box((None, -1.0, None), (1.0, None, None))  # type: ignore[arg-type]
    assert ConstraintSystem(Box()).size == 6
    assert ConstraintSystem(Box(lower=(None, None, None))).size == 3
    assert ConstraintSystem(Box((None, None, None), (None, None, 0.2))).size == 1


@given(moments, vectors(), sizes(), vectors())
def test_keep_out_sphere_is_the_distance_to_it(
    m: Moment, center: Vector, radius: float, r: Vector
) -> None:
    found = margins(KeepOutSphere(center, radius, r), m)
    expected = math.dist(m.place(r), center) - radius
    np.testing.assert_allclose(found, [expected], **CLOSE)


def distance_to_segment(p: Floats, a: Floats, b: Floats) -> float:
    """The least of many, then of many around that one."""
    low, high = 0.0, 1.0
    for _ in range(8):
        shares = np.linspace(low, high, 101)
        distances = np.linalg.norm(p - (a + shares[:, None] * (b - a)), axis=1)
        best = shares[np.argmin(distances)]
        low, high = max(0.0, best - (high - low) / 50), min(1.0, best + (high - low) / 50)
    return float(np.min(distances))


@given(moments, vectors(), vectors(), sizes(), vectors())
def test_keep_out_capsule_is_the_distance_to_it(
    m: Moment, start: Vector, end: Vector, radius: float, r: Vector
) -> None:
    found = margins(KeepOutCapsule(start, end, radius, r), m)
    nearest = distance_to_segment(m.place(r), np.array(start), np.array(end))
    np.testing.assert_allclose(found, [nearest - radius], rtol=0, atol=1e-9)


@given(moments, vectors(), sizes(), vectors())
def test_a_capsule_without_length_is_a_sphere(
    m: Moment, center: Vector, radius: float, r: Vector
) -> None:
    capsule = margins(KeepOutCapsule(center, center, radius, r), m)
    np.testing.assert_allclose(capsule, margins(KeepOutSphere(center, radius, r), m), **CLOSE)


@given(moments, sizes(), vectors())
def test_speed_limit_is_what_is_left_of_the_speed(m: Moment, speed: float, r: Vector) -> None:
    found = margins(SpeedLimit(speed, r), m)
    np.testing.assert_allclose(found, [speed - math.hypot(*m.velocity(r))], **CLOSE)


@given(moments, sizes())
def test_angular_rate_limit_is_what_is_left_of_the_rate(m: Moment, rate: float) -> None:
    expected = [rate - math.hypot(*m.angular_velocity)]
    np.testing.assert_allclose(margins(AngularRateLimit(rate), m), expected, **CLOSE)


@given(moments, sizes() | st.none(), sizes() | st.none())
def test_acceleration_limit_has_a_row_for_each_kind(
    m: Moment, linear: float | None, angular: float | None
) -> None:
    if linear is None and angular is None:
        with pytest.raises(ConstraintError, match="acceleration-limit: linear and angular"):
            AccelerationLimit(linear, angular)
        return
    expected = []
    if linear is not None:
        expected.append(linear - math.hypot(*m.linear_acceleration))
    if angular is not None:
        expected.append(angular - math.hypot(*m.angular_acceleration))
    np.testing.assert_allclose(margins(AccelerationLimit(linear, angular), m), expected, **CLOSE)


@given(moments, vectors())
def test_the_acceleration_of_a_point_is_the_second_difference_of_its_places(
    m: Moment, r: Vector
) -> None:
    @ns.keep_nonnegative(level="acceleration")
    def point(motion: Any) -> Any:
        return motion.at(r).linear_acceleration

    def place(t: float) -> Floats:
        turned = t * np.array(m.angular_velocity) + t**2 / 2 * np.array(m.angular_acceleration)
        moved = t * np.array(m.linear_velocity) + t**2 / 2 * np.array(m.linear_acceleration)
        return moved + (Rotation.from_rotvec(turned) * m.rotation).apply(r)

    t = 1e-4
    expected = (place(t) - 2 * place(0) + place(-t)) / t**2
    np.testing.assert_allclose(margins(point, m), expected, rtol=0, atol=1e-4)


@given(moments, axes, st.floats(0, 1), vectors())
def test_forward_only_is_the_speed_along_the_edge(
    m: Moment, edge: str, minimum: float, r: Vector
) -> None:
    found = margins(ForwardOnly(edge, minimum, r), m)
    # In the body's frame, where the edge is an axis.
    body = m.rotation.inv().apply(m.velocity(r))
    forward = math.copysign(1, -(edge[0] == "-") + 0.5) * body["xyz".index(edge[-1])]
    np.testing.assert_allclose(found, [forward - minimum], **CLOSE)


@given(moments, sizes(), axes, axes, vectors())
def test_turning_radius_is_the_speed_beyond_what_the_bend_needs(
    m: Moment, radius: float, edge: str, up: str, r: Vector
) -> None:
    if edge[-1] == up[-1]:
        with pytest.raises(ConstraintError, match="turning-radius: up and edge"):
            TurningRadius(radius, edge, up, r)
        return
    found = margins(TurningRadius(radius, edge, up, r), m)
    forward = m.axis(edge) @ m.velocity(r)
    turning = m.axis(up) @ np.array(m.angular_velocity)
    expected = forward + np.array([-1, 1]) * radius * turning
    np.testing.assert_allclose(found, expected, **CLOSE)
    np.testing.assert_allclose(min(found), forward - radius * abs(turning), **CLOSE)


def test_a_circle_driven_forward_is_as_tight_as_its_radius() -> None:
    """A tool on a circle of 0.2 m: a limit of 0.2 m holds with nothing left, on either side."""
    for turn in (1.5, -1.5):
        m = Moment(linear_velocity=(0.3, 0.0, 0.0), angular_velocity=(0.0, 0.0, turn))
        assert min(margins(TurningRadius(0.2), m)) == pytest.approx(0.0, abs=1e-15)
        assert min(margins(TurningRadius(0.19), m)) > 0
        assert min(margins(TurningRadius(0.21), m)) < 0


# -------------------------------------------------------------------- which side is permitted


@pytest.mark.parametrize(
    ("limit", "permitted", "forbidden"),
    [
        (HalfSpace(), Moment((0, 0, 0.1)), Moment((0, 0, -0.1))),
        (HalfSpace(normal=(-3, 0, 0)), Moment((-1, 0, 0)), Moment((1, 0, 0))),
        (DepthLimit(0.02), Moment((0, 0, -0.019)), Moment((0, 0, -0.021))),
        (DepthLimit(0.0), Moment((0, 0, 0.001)), Moment((0, 0, -0.001))),
        (Box(), Moment((0.9, -0.9, 0.9)), Moment((0, 0, -1.1))),
        (Box(upper=(None, None, 0.5)), Moment((9, 9, 0.4)), Moment((0, 0, 0.6))),
        (KeepOutSphere(), Moment((0.06, 0, 0)), Moment((0.04, 0, 0))),
        (KeepOutCapsule(), Moment((0.03, 0, 0.05)), Moment((0.01, 0, 0.05))),
        (KeepOutCapsule(), Moment((0, 0, 0.13)), Moment((0, 0, 0.11))),
        (KeepOutCapsule(), Moment((0, 0, -0.03)), Moment((0, 0, -0.01))),
        (SpeedLimit(), Moment(), Moment(linear_velocity=(0.1, 0.1, 0))),
        (SpeedLimit(reference_point=(1, 0, 0)), Moment(), Moment(angular_velocity=(0, 0, 1))),
        (AngularRateLimit(), Moment(), Moment(angular_velocity=(0, -1.1, 0))),
        (AccelerationLimit(), Moment(), Moment(linear_acceleration=(0, -1.1, 0))),
        (AccelerationLimit(None, 2), Moment(), Moment(angular_acceleration=(2, 1, 0))),
        (
            ForwardOnly(),
            Moment(linear_velocity=(1, 5, 0)),
            Moment(linear_velocity=(-1, 5, 0)),
        ),
        (
            ForwardOnly("-x", 0.5),
            Moment(linear_velocity=(-1, 0, 0)),
            Moment(linear_velocity=(-0.4, 0, 0)),
        ),
        (
            TurningRadius(),
            Moment(linear_velocity=(0.1, 0, 0), angular_velocity=(9, 9, 1.9)),
            Moment(linear_velocity=(0.1, 0, 0), angular_velocity=(0, 0, -2.1)),
        ),
        (
            TurningRadius(),
            Moment(linear_velocity=(0.1, 0, 0)),
            Moment(linear_velocity=(-0.1, 0, 0)),
        ),
    ],
    ids=lambda value: value.name if isinstance(value, Limit) else "",
)
def test_the_margin_is_negative_on_the_forbidden_side_alone(
    limit: Limit, permitted: Moment, forbidden: Moment
) -> None:
    assert min(margins(limit, permitted)) > 0
    assert min(margins(limit, forbidden)) < 0


MOVED: list[Limit] = [
    HalfSpace(normal=(1, 2, 3)),
    DepthLimit(),
    Box(),
    KeepOutSphere(),
    KeepOutCapsule(),
    SpeedLimit(),
    ForwardOnly(),
    TurningRadius(),
]


@pytest.mark.parametrize("limit", MOVED, ids=lambda limit: limit.name)
@given(m=moments, r=vectors())
def test_a_reference_point_is_a_frame_moved_there(limit: Any, m: Moment, r: Vector) -> None:
    """Same margins as of a tool recorded at that point."""
    x, y, z = m.place(r)
    vx, vy, vz = m.velocity(r)
    moved = replace(m, position=(x, y, z), linear_velocity=(vx, vy, vz))
    found = margins(replace(limit, reference_point=r), m)
    np.testing.assert_allclose(found, margins(limit, moved), **CLOSE)


# -------------------------------------------------------------------- slopes

VARIED: list[Limit] = [
    *MOVED,
    *(replace(limit, reference_point=(0.1, -0.3, 0.2)) for limit in MOVED),  # type: ignore[call-arg]
    KeepOutCapsule((0.1, 0.2, 0.3), (-0.5, 0.2, 0.1)),
    KeepOutCapsule(end=(0, 0, 0)),
    AngularRateLimit(),
    AccelerationLimit(2.0, 3.0),
    TurningRadius(edge="-y", up="x"),
]


@pytest.mark.parametrize("limit", VARIED, ids=lambda limit: limit.name)
@given(m=moments)
def test_slopes_are_those_of_finite_differences(limit: Limit, m: Moment) -> None:
    function = constraint_function(limit)
    start = np.concatenate([np.ravel(q, order="F") for q in quantities(m)])

    def margins_at(x: Floats) -> Floats:
        """Of instants in columns, shape (24, N)."""
        parts = np.split(x, [3, 12, 15, 18, 21])
        parts[1] = parts[1].reshape(3, -1, order="F")
        return np.array(function(np.zeros((1, x.shape[1])), *parts))

    h = 1e-6
    found = slopes(limit, m)
    steps = h * np.eye(24)
    ahead, here, back = (margins_at(start[:, None] + s * steps) for s in (1, 0, -1))
    # Next to a kink (a sphere's center, rest) the slopes on both sides differ.
    smooth = np.abs((ahead - here) / h - (here - back) / h) < 1e-4
    middle = (ahead - back) / (2 * h)
    np.testing.assert_allclose(found[smooth], middle[smooth], rtol=0, atol=2e-4)


@pytest.mark.parametrize("limit", VARIED, ids=lambda limit: limit.name)
@pytest.mark.parametrize(
    "m",
    [
        Moment(),
        Moment((0.0, 0.0, 0.05)),
        Moment((0.0, 0.0, 0.1)),
        Moment((0.0, 0.0, 1.0)),
        Moment((0.1, 0.2, 0.3)),
        Moment((-0.2, 0.2, 0.2)),
        Moment((-0.1, 0.3, -0.2)),
        Moment((1e-13, 0, 0), (0, 0, 0), (1e-300, 0, 0), (1e-13, 0, 0), (1e-20, 0, 0)),
    ],
    ids=["center", "on the axis", "end", "beyond", "start", "oblique", "tip at center", "tiny"],
)
def test_slopes_are_finite_and_bounded_at_singular_points(limit: Limit, m: Moment) -> None:
    found = slopes(limit, m)
    assert np.all(np.isfinite(found))
    # Lipschitz in what is limited; reference points and rates are below 1 here.
    assert np.all(np.abs(found) <= 1 + 1e-12)
    if limit.level == "acceleration":
        return
    A, b = ConstraintSystem(limit).acceleration_form(
        0.0,
        m.position,
        m.rotation.as_quat(scalar_first=True),
        m.linear_velocity,
        m.angular_velocity,
    )
    assert np.all(np.isfinite(A))
    assert np.all(np.isfinite(b))


@given(st.floats(1e-3, 10), vectors(), st.sampled_from([0, 1e-16, 1e-13, 1e-10, 1e-6, 1.0]))
def test_margins_are_never_overestimated(scale: float, unit: Vector, size: float) -> None:
    """Neither at a sphere's center nor at rest; the error is within 1e-9 of the limit's scale."""
    x, y, z = (size * scale * u for u in unit)
    length = math.hypot(x, y, z)
    slack = 4e-16 * (scale + length)
    for limit, m, expected in [
        (KeepOutSphere(radius=scale), Moment((x, y, z)), length - scale),
        (KeepOutCapsule(end=(0, 0, 0), radius=scale), Moment((x, y, z)), length - scale),
        (SpeedLimit(scale), Moment(linear_velocity=(x, y, z)), scale - length),
        (AngularRateLimit(scale), Moment(angular_velocity=(x, y, z)), scale - length),
        (AccelerationLimit(scale), Moment(linear_acceleration=(x, y, z)), scale - length),
    ]:
        (found,) = margins(limit, m)
        assert found <= expected + slack, limit
        assert found >= expected - 1e-9 * scale - slack, limit


@pytest.mark.parametrize("normal", [(0, 0, 1e-200), (0, 0, 1e12), (0, 0, 5e-324)])
def test_normals_of_any_length_do(normal: Vector) -> None:
    m = Moment((0.1, 0.2, 0.3))
    assert margins(HalfSpace(normal=normal), m) == pytest.approx([0.3], abs=1e-15)


# -------------------------------------------------------------------- levels, units, text and JSON


@pytest.mark.parametrize(("name", "limit"), NAMES.items())
def test_each_limit_is_in_the_catalog_and_has_defaults(name: str, limit: type[Limit]) -> None:
    assert CATALOG[name] is limit
    made = parse_constraint(name)
    assert made == limit()
    assert (made.name, made.relation) == (name, "nonnegative")
    system = ConstraintSystem(made)
    assert system.limits is system
    assert system.equalities.size == 0


@pytest.mark.parametrize(
    ("limit", "level", "units"),
    [
        (HalfSpace(), "position", ["m"]),
        (DepthLimit(), "position", ["m"]),
        (Box(), "position", ["m"] * 6),
        (KeepOutSphere(), "position", ["m"]),
        (KeepOutCapsule(), "position", ["m"]),
        (SpeedLimit(), "velocity", ["m/s"]),
        (AngularRateLimit(), "velocity", ["rad/s"]),
        (AccelerationLimit(), "acceleration", ["m/s²"]),
        (AccelerationLimit(None, 1), "acceleration", ["rad/s²"]),
        (AccelerationLimit(1, 1), "acceleration", ["m/s²", "rad/s²"]),
        (ForwardOnly(), "velocity", ["m/s"]),
        (TurningRadius(), "velocity", ["m/s"] * 2),
    ],
)
def test_levels_and_units(limit: Limit, level: str, units: list[str]) -> None:
    system = ConstraintSystem(limit)
    assert system.row_levels == [level] * len(units)
    assert system.row_units == units


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("half-space(point=(0,0,-1), normal=[0, 1, 0])", HalfSpace((0, 0, -1), (0, 1, 0))),
        ("half_space(priority=2)", HalfSpace(priority=2)),
        ("depth-limit(depth=0.002, barrier_rate=20)", DepthLimit(0.002, barrier_rate=20.0)),
        ("depth-limit(surface_point=(0, 0, .1))", DepthLimit(surface_point=(0, 0, 0.1))),
        ("box(lower=(None, -1, None), upper=[1, 2, 1e999])", Box((None, -1, None), (1, 2, None))),
        (
            "keep-out-sphere(center=[.1, 0, 0], radius=1, priority=9, barrier_rate=2.5)",
            KeepOutSphere((0.1, 0, 0), 1.0, priority=9, barrier_rate=2.5),
        ),
        (
            "keep-out-capsule(start=(0,0,0), end=(1,0,-1), radius=.1)",
            KeepOutCapsule((0, 0, 0), (1, 0, -1), 0.1),
        ),
        (
            "speed-limit(speed=0.2, reference_point=(0, 0, -0.1))",
            SpeedLimit(0.2, (0, 0, -0.1)),
        ),
        ("angular-rate-limit(rate=3)", AngularRateLimit(3.0)),
        ("acceleration-limit(linear=None, angular=5)", AccelerationLimit(None, 5.0)),
        ("forward-only(edge='-x', minimum=0.01)", ForwardOnly("-x", 0.01)),
        ("turning-radius(radius=.1, edge='y', up='-z')", TurningRadius(0.1, "y", "-z")),
    ],
)
def test_limits_are_made_from_text_and_saved_as_json(text: str, expected: Limit) -> None:
    made = parse_constraint(text)
    assert made == expected
    assert hash(made) == hash(expected)
    data = json.loads(json.dumps(specification(made), allow_nan=False))
    again = restore(data)
    assert again == made
    assert type(again) is type(made)
    m = Moment((0.1, 0.2, 0.3), (0.3, 0, 1), (1, 2, 3), (4, 5, 6), (7, 8, 9), (1, 2, 3))
    np.testing.assert_array_equal(margins(again, m), margins(made, m))


@given(vectors(), directions(), vectors())
def test_saved_numbers_are_those_given(point: Vector, normal: Vector, r: Vector) -> None:
    made = HalfSpace(list(point), np.array(normal), list(r))  # type: ignore[arg-type]
    assert made == HalfSpace(point, normal, r)
    assert (made.point, made.normal, made.reference_point) == (point, normal, r)
    assert restore(json.loads(json.dumps(specification(made)))) == made


# -------------------------------------------------------------------- errors

Make = Callable[[], Any]


def wrong(limit: type[Limit], **arguments: Any) -> tuple[type[Limit], dict[str, Any]]:
    return limit, arguments


@pytest.mark.parametrize(
    ("limit", "arguments"),
    [
        wrong(HalfSpace, normal=(0, 0, 0)),
        wrong(HalfSpace, normal=(0, 0)),
        wrong(HalfSpace, normal="z"),
        wrong(HalfSpace, point=3),
        wrong(HalfSpace, point=(0, 0, math.inf)),
        wrong(HalfSpace, reference_point=[[0, 0, 0]]),
        wrong(DepthLimit, depth=-0.01),
        wrong(DepthLimit, depth="deep"),
        wrong(DepthLimit, depth=math.nan),
        wrong(DepthLimit, surface_point=(1, 2, None)),
        wrong(DepthLimit, normal=[0, 0, 0]),
        wrong(DepthLimit, reference_point=None),
        wrong(Box, lower=(0, 0)),
        wrong(Box, lower=(2, 0, 0)),
        wrong(Box, lower=(1, 0, 0)),
        wrong(Box, lower=(math.inf, 0, 0)),
        wrong(Box, lower=(math.nan, 0, 0)),
        wrong(Box, lower=0.5),
        wrong(Box, upper="low"),
        wrong(Box, upper=(0, 0, -math.inf)),
        wrong(Box, upper=(0, 0, 10**400)),
        wrong(Box, upper=[[1, 1, 1], [1, 1, 1]]),
        wrong(Box, reference_point=()),
        wrong(KeepOutSphere, radius=0),
        wrong(KeepOutSphere, radius=None),
        wrong(KeepOutSphere, center=(0, 0, 0, 0)),
        wrong(KeepOutSphere, reference_point="tip"),
        wrong(KeepOutCapsule, radius=-1),
        wrong(KeepOutCapsule, start=(0, math.nan, 0)),
        wrong(KeepOutCapsule, end=()),
        wrong(KeepOutCapsule, reference_point=1),
        wrong(SpeedLimit, speed=0),
        wrong(SpeedLimit, speed=[1]),
        wrong(SpeedLimit, reference_point={}),
        wrong(AngularRateLimit, rate=-1),
        wrong(AngularRateLimit, rate=math.inf),
        wrong(AccelerationLimit, linear=0),
        wrong(AccelerationLimit, angular="fast"),
        wrong(AccelerationLimit, linear=None),
        wrong(ForwardOnly, edge="w"),
        wrong(ForwardOnly, edge=None),
        wrong(ForwardOnly, minimum=-0.1),
        wrong(ForwardOnly, reference_point="x"),
        wrong(TurningRadius, radius=0),
        wrong(TurningRadius, edge="z"),
        wrong(TurningRadius, edge=1),
        wrong(TurningRadius, up="-x"),
        wrong(TurningRadius, up="upwards"),
        wrong(TurningRadius, reference_point=(None, 0, 0)),
    ],
)
def test_wrong_arguments_are_refused_in_one_line_by_name(
    limit: type[Limit], arguments: dict[str, Any]
) -> None:
    for make in (lambda: limit(**arguments), lambda: build(limit.name, arguments)):
        message = refusal(ConstraintError, make)
        assert message.startswith(f"{limit.name}: ")
        assert next(iter(arguments)) in message


@pytest.mark.parametrize("limit", LIMITS)
@pytest.mark.parametrize(
    "arguments",
    [
        {"priority": -1},
        {"priority": 10},
        {"priority": 1.5},
        {"priority": "soft"},
        {"priority": None},
        {"priority": True},
        {"barrier_rate": 0},
        {"barrier_rate": -3.0},
        {"barrier_rate": math.inf},
        {"barrier_rate": "fast"},
    ],
    ids=str,
)
def test_wrong_priorities_and_rates_are_refused_by_the_system(
    limit: type[Limit], arguments: dict[str, Any]
) -> None:
    message = refusal(NoslipError, ConstraintSystem, [limit(**arguments)])
    assert repr(limit.name) in message
    assert next(iter(arguments)) in message


@pytest.mark.parametrize("limit", LIMITS)
def test_unknown_arguments_are_refused_with_those_known(limit: type[Limit]) -> None:
    with pytest.raises(ConstraintError, match=r"it has .*barrier_rate.*priority"):
        parse_constraint(f"{limit.name}(strength=3)")
