"""Random tools of each kind, seen by random sensors: how many are told, how well, how surely.

``NOSLIP_WORLDS`` says how many of a kind (``make identified``: 100, with the table printed).
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.stats import binom

import noslip as ns
from identification.test_identify import (
    COARSE,
    EXACT,
    FINE,
    RULES,
    TOOLS,
    askew,
    is_right,
    is_within,
    misplaced,
)
from identification.test_places import RULES as PLACES
from identification.test_places import deviations
from identification.test_places import is_within as is_place_within
from identification.worlds import world

WORLDS = int(os.environ.get("NOSLIP_WORLDS", "1"))
FIRST = 1000
"""Seed of the first: none that anything was tuned on."""
SURE = 1e-3
"""How improbable it is that a rate which is met is taken for missed."""


def is_met(hits: list[bool], rate: float) -> bool:
    """Whether so few misses are likely enough where each hits at a rate or more."""
    misses = len(hits) - sum(hits)
    return bool(binom.sf(misses - 1, len(hits), 1 - rate) > SURE)


@dataclass
class Told:
    """Of each world of a kind, whether it was told; of those told, how well, how surely."""

    right: list[bool] = field(default_factory=list)
    near: list[bool] = field(default_factory=list)
    within: list[bool] = field(default_factory=list)


def told(kind: str, noise: tuple[float, float]) -> Told:
    """What is told of so many worlds of a kind; printed as a line of the table."""
    table = Told()
    right, near, within = table.right, table.near, table.within
    for seed in range(FIRST, FIRST + WORLDS):
        seen = world(kind, seed, noise)
        found = ns.identify(seen.trajectory)
        right.append(is_right(kind, found))
        if not right[-1]:
            continue
        if kind in TOOLS:
            place, turn = np.linalg.norm(misplaced(seen, found)), askew(kind, seen, found)
            near.append(bool(place < 5e-4 and turn < 0.5))
            within.append(is_within(misplaced(seen, found), found.rows[0].point_covariance))
            if kind != "needle":
                _, y, _ = seen.axes
                assert found.lateral is not None
                error = found.lateral * np.sign(found.lateral @ y) - y
                within.append(is_within(error, found.rows[0].axis_covariance))
        elif kind in PLACES:
            (place_found,) = [place for place in found.surfaces if place.holds]
            for name, (error, covariance) in deviations(kind, seen, place_found).items():
                length = "point" in name or name == "radius"
                near.append(bool(np.linalg.norm(error) < (5e-4 if length else np.radians(0.5))))
                within.append(is_place_within(error, covariance))
    words = f"{kind:15}{1e3 * noise[0]:4.1f} mm  {np.mean(right):6.1%} right"
    if near:
        words += f", {np.mean(near):6.1%} near, {np.mean(within):6.1%} within their 95 % regions"
    print(words)
    return table


@pytest.mark.slow
@pytest.mark.parametrize("kind", RULES)
def test_tools_are_told(kind: str) -> None:
    rates = {EXACT: 0.98, FINE: 0.98, COARSE: 0.9}
    # A car seldom at the stop of its steering is a wheel, and some wheels bend as cars do.
    less = 0.06 if kind in ("car", "wheel") else 0.0
    found = {noise: told(kind, noise) for noise in rates}
    # Of few worlds only all noises together can tell of a miss too many.
    assert is_met(
        [hit for table in found.values() for hit in table.right],
        float(np.mean(list(rates.values()))) - less,
    )
    for noise, rate in rates.items():
        assert is_met(found[noise].right, rate - less)
    if near := found[FINE].near:
        assert is_met(near, 0.98)
        assert is_met(found[FINE].within, 0.9)
