"""What was found to hold, as the viewer draws it: regions, cones, lines."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import noslip as ns
from noslip.identification import Identified, Row

pytest.importorskip("viser", reason="the viewer needs viser (extra: viewer)")

from noslip.viewer.found import LENGTH, REACH, ROD, WIDEST, found_parts, placed_parts, region

SIZE = 0.3


def a_row(axis=(0.0, 1.0, 0.0), point=(0.05, 0.0, 0.01), lean=0.0, off=0.0, unknown=None) -> Row:
    """A direction whose angle and point are known with standard deviations (rad, m)."""
    axis = np.asarray(axis) / np.linalg.norm(axis)
    across = np.eye(3) - np.outer(axis, axis)
    unknown = axis[None] if unknown is None else np.asarray(unknown)
    covariances = lean**2 * across, off**2 * (np.eye(3) - unknown.T @ unknown)
    return Row(axis, np.asarray(point), *covariances, unknown, 0.1, 0.01, 0.01)


def found(*rows: Row, constraints: tuple = (), travel=None) -> Identified:
    point = rows[0].point if rows else None
    return Identified(
        constraints=constraints,
        kinds=tuple(c.name for c in constraints),
        travel=travel,
        lateral=rows[0].axis if rows else None,
        reference_point=point,
        rows=rows,
        candidates=rows,
        surfaces=(),
        curvature=None,
        curvature_error=None,
        turning_radius=None,
        noise=(1e-4, 1e-3),
        speed=0.1,
        names=("a.csv",),
    )


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 2))
def test_the_region_is_where_its_share_of_normal_draws_lies(seed, count):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=rng).as_matrix()
    unknown, known = turn[:count], turn[count:]
    root = rng.normal(size=(3 - count, 3 - count)) * 1e-3
    covariance = known.T @ root @ root.T @ known
    # What is given along unknown directions does not matter.
    axes, lengths = region(covariance + unknown.T @ unknown, unknown)
    assert axes @ axes.T == pytest.approx(np.eye(3 - count), abs=1e-12)
    assert axes @ unknown.T == pytest.approx(np.zeros((3 - count, count)), abs=1e-12)
    # Its rim is the level of the density that 95 % of the draws exceed.
    level = chi2.ppf(0.95, 3 - count)
    rim = lengths[:, None] * axes @ known.T
    assert np.einsum("ij,jk,ik->i", rim, np.linalg.inv(root @ root.T), rim) == pytest.approx(
        np.full(3 - count, level), rel=1e-3
    )


def test_axis_cone_point_and_line_stand_where_they_were_found():
    row = a_row(lean=np.radians(2.0), off=0.004)
    rod, cones, line, ellipsoid = found_parts(found(row), SIZE)
    for part, reach in ((rod, LENGTH * SIZE), (line, REACH * SIZE)):
        along = (part.vertices - row.point) @ row.axis
        assert (along.min(), along.max()) == pytest.approx((-reach, reach))
        off = np.linalg.norm(part.vertices - row.point - along[:, None] * row.axis, axis=1)
        assert off.max() <= ROD * SIZE * (1 + 1e-9)
    arms = cones.vertices - row.point
    arms = arms[np.linalg.norm(arms, axis=1) > 0]
    angles = np.arccos(np.abs(arms @ row.axis) / np.linalg.norm(arms, axis=1))
    assert angles == pytest.approx(np.full(len(arms), np.sqrt(chi2.ppf(0.95, 2)) * np.radians(2)))
    out = ellipsoid.vertices - row.point
    across = np.linalg.norm(out - np.outer(out @ row.axis, row.axis), axis=1)
    assert across.max() == pytest.approx(np.sqrt(chi2.ppf(0.95, 2)) * 0.004, rel=0.01)
    assert np.abs(out @ row.axis).max() == pytest.approx(2 * ROD * SIZE, rel=0.01)


def test_what_is_known_exactly_is_seen_and_what_is_not_at_all_stays_in_the_scene():
    sure, vague = a_row(), a_row(lean=3.0, off=10.0)
    for row in (sure, vague, a_row(unknown=np.eye(3))):
        for part in found_parts(found(row), SIZE):
            assert np.isfinite(part.vertices).all()
            reach = np.linalg.norm(part.vertices - row.point, axis=1).max()
            assert reach <= max(REACH, LENGTH / np.cos(WIDEST)) * SIZE + ROD * SIZE
    *_, ellipsoid = found_parts(found(sure), SIZE)
    assert np.ptp(ellipsoid.vertices, axis=0).min() >= 2 * ROD * SIZE


def test_the_travel_is_an_arrow_from_the_point():
    travel = np.array([-0.6, 0.0, 0.8])
    *_, shaft, head = found_parts(found(a_row(), travel=travel), SIZE)
    along = [(part.vertices - a_row().point) @ travel for part in (shaft, head)]
    assert along[0].min() == pytest.approx(0.0, abs=1e-12)
    assert along[1].min() == pytest.approx(along[0].max())
    assert along[1].max() > LENGTH * SIZE


def test_a_surface_that_was_found_is_placed_in_the_world():
    plane = ns.constraints.PlaneContact(point=(0.0, 0.0, 0.02), normal=(0.0, 0.0, 1.0))
    what = found(constraints=(plane, ns.Blade()))
    (part,) = placed_parts(what, np.zeros(3), SIZE)
    assert part.vertices[:, 2] == pytest.approx(np.full(len(part.vertices), 0.02))
    assert found_parts(what, SIZE) == []
