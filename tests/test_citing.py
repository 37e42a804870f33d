"""What is cited is what was used: each method by its entry, and no other."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from importlib.resources import files

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import eased
from noslip import constraints
from noslip.provenance import Origin

U = eased(np.linspace(0, 1, 51))


def cited(used: object) -> set[str]:
    file = io.StringIO()
    ns.cite(used, file=file)  # type: ignore[arg-type]
    keys = re.findall(r"^@\w+\{(\w+),$", file.getvalue(), re.MULTILINE)
    assert len(keys) == len(set(keys))
    return set(keys)


def hand(bend: float = 0.005) -> ns.PoseTrajectory:
    path = np.column_stack([0.1 * U, bend * np.sin(np.pi * U), 0 * U])
    return ns.PoseTrajectory(2 * U, path, Rotation.from_euler("z", 0.1 * np.cos(np.pi * U)))


ALWAYS = {"noslip", "ijspeert2013"}
POSES = ALWAYS | {"ude2014"}
HELD = POSES | {"straizys2022", "udwadia1992", "andersson2019"}
LIMITED = {"ames2019", "goldfarb1983", "andersson2019"}
PLANE = constraints.HalfSpace(normal=(0, 0, 1), point=(0, 0, -1))


@cache
def blade() -> ns.ConstrainedDMP:
    return ns.learn(hand(), ns.Blade())


def vectors() -> ns.ConstrainedDMP:
    return ns.learn(ns.Trajectory(2 * U, np.column_stack([U, U**2])))


CASES: dict[str, tuple[Callable[[], object], set[str]]] = {
    "vectors": (vectors, ALWAYS),
    "poses": (lambda: ns.learn(hand()), POSES),
    "a blade": (blade, HELD),
    "a limit alone": (lambda: ns.learn(hand(), PLANE), POSES | LIMITED),
    "a needle that another rule is of": (
        lambda: ns.learn(
            hand(0.0),
            constraints.InMovingFrame(ns.Needle(), amplitude=(0, 0, 0.001), period=4.0),
        ),
        HELD | {"webster2006"},
    ),
    "a goal moved": (
        lambda: blade().adapt(goal_position=blade().goal_position + [0, 0.005, 0]),
        HELD | {"flash1985"},
    ),
    "a path turned and stretched": (
        lambda: blade().adapt(
            goal_position=blade().goal_position + [0.02, 0, 0], scaling="rotation-dilation"
        ),
        HELD | {"flash1985", "ginesi2021"},
    ),
    "a distribution": (
        lambda: ns.learn([hand(k) for k in (0.004, 0.005, 0.007)], ns.Blade(), distribution=True),
        HELD | {"paraschos2013"},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_what_was_used_is_cited_and_nothing_else(case: str) -> None:
    make, keys = CASES[case]
    assert cited(make()) == keys


CALLS = {
    "right-straight-left, 2.31 m": ("adapt", {"dubins1957"}),
    "42% of the demonstration, then back right-straight-left, 1.2 m": ("adapt", {"reeds1990"}),
    "turn left, straight, turn right, 0.051 m": ("adapt", set()),
    "roll left, ahead, 0.1 m": ("adapt", set()),
    "": ("replan", {"flash1985"}),
}
"""Maneuvers as a record names them, with the call and what it adds."""


@pytest.mark.parametrize("maneuver", CALLS)
def test_a_maneuver_cites_whose_it_is(maneuver: str) -> None:
    verb, keys = CALLS[maneuver]
    dmp = blade()
    record = (replace(dmp.record[0], maneuver=maneuver),)
    called = replace(dmp, history=(*dmp.history, Origin(verb, {})), record=record)  # type: ignore[arg-type]
    assert cited(called) == HELD | keys


def test_a_search_and_a_robot_bring_theirs() -> None:
    dmp = blade()
    found = replace(dmp, history=(Origin("learn", {"robot": "panda"}), Origin("improve", {})))
    assert cited(found) == HELD | {"hansen2001", "todorov2012"}


def test_what_was_used_is_known_of_a_file_too(tmp_path: object) -> None:
    path = blade().save(f"{tmp_path}/blade.json")
    assert cited(ns.load_primitive(path)) == HELD


def test_it_prints_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    ns.cite(blade())
    assert f"version = {{{ns.__version__}}}" in capsys.readouterr().out


def test_what_was_not_made_here_is_refused() -> None:
    with pytest.raises(ns.NoslipError, match="cite: takes a primitive or a distribution"):
        ns.cite(hand())  # type: ignore[arg-type]


def test_entries_are_whole_bibtex() -> None:
    text = (files("noslip") / "references.bib").read_text(encoding="utf-8")
    entries = text.strip().split("\n\n")
    assert len(entries) > 10
    for entry in entries:
        assert re.fullmatch(r"@\w+\{\w+,\n(  \w+ = \{.+\},\n)+\}", entry), entry
        assert entry.count("{") == entry.count("}")
        fields = set(re.findall(r"^  (\w+) =", entry, re.MULTILINE))
        assert {"author", "title"} <= fields
        assert "year" in fields or entry.startswith("@software")
