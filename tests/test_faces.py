"""What things say of themselves at a prompt and in a notebook."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import cutting
from motions import cut
from noslip.constraints import ConstraintSystem
from noslip.constraints.declaration import CATALOG

BOWL = ns.constraints.SurfaceContact(lambda p: p[2] - 0.1 * p[0] ** 2)
RULES = [
    ns.Blade(lateral="-z", edge="-x"),
    ns.Blade(reference_point=(0.1, 0, 0)),
    ns.DepthLimit(depth=0.2, priority=1),
    ns.KeepOutSphere(center=(0.1, 0, 0.25), radius=0.02, barrier_rate=5.0),
    ns.constraints.Box(lower=(None, -1, 0), upper=(1, 2, None)),
    ns.constraints.ForwardOnly(edge="-y"),
    ns.constraints.InMovingFrame(ns.Needle(curvature=2.5), period=3.0),
    ns.constraints.ToolAxis(axis="-z", surface="x + z**2"),
]


POSED = [kind() for name, kind in CATALOG.items() if name != "joint-limits"]
"""Each of the catalog that is declared of poses."""


@cache
def things() -> dict[str, Any]:
    dmp = cutting()
    motion = dmp.rollout()
    law, (record,), (origin,) = dmp.law, dmp.record, dmp.history
    return {
        "trajectory": cut(),
        "primitive": dmp,
        "motion": motion,
        "law": law,
        "rule": dmp.rule,
        "goal": law.goal,
        "forcing": law.forcing,
        "record": record,
        "origin": origin,
        "state": dmp.initial_state(),
        "controller": dmp.controller(time_step=0.01),
        "projected": ns.project_trajectory(cut(), ns.Blade()),
        "via": ns.Boundary(0.5, [0.1, 0.2, 0.3], Rotation.from_euler("z", 0.5)),
        "system": dmp.system,
        "long system": ConstraintSystem(POSED),
        "long name": replace(cut(), name="/data/" + 40 * "session/" + "cut.csv"),
        "bowl": BOWL,
    }


NAMES = list(things())


@pytest.mark.parametrize("name", NAMES)
def test_a_repr_is_one_line_that_names_the_type_and_lists_no_numbers(name: str) -> None:
    thing = things()[name]
    told = repr(thing)
    assert told.startswith(f"{type(thing).__name__}(")
    assert "\n" not in told and len(told) < 120
    assert "[" not in told and "object at" not in told


SAID = [kind() for name, kind in CATALOG.items() if name != "keep-out"]
"""Without that of a field, which has too many numbers to be said."""


@pytest.mark.parametrize("rule", [*SAID, *RULES], ids=repr)
def test_a_constraint_says_how_it_is_made(rule: ns.Constraint) -> None:
    assert eval(repr(rule), vars(ns.constraints)) == rule


def test_reprs_say_what_is_given() -> None:
    assert repr(ns.Blade()) == "Blade(lateral='y')"
    assert repr(RULES[0]) == "Blade(lateral='-z', edge='-x')"
    assert repr(ns.velocity_constraint(lambda m: m.linear_velocity[0], name="stay")) == (  # type: ignore[call-arg]
        "<velocity constraint 'stay'>"
    )
    assert repr(ConstraintSystem([ns.Blade(), ns.Blade()])) == "ConstraintSystem(blade, blade 2)"
    assert repr(things()["rule"]) == "Rule(blade; position gives way)"
    assert repr(things()["primitive"]) == (
        "ConstrainedDMP(40 basis functions, 2 s, 300 steps, blade; position gives way)"
    )
    assert "position=(0.1, 0.2, 0.3), rotation=Rotation((0, 0, 28.65)°)" in repr(things()["via"])
    assert repr(things()["long name"]).endswith("cut.csv', 301 samples, 2 s, path 1.05191 m)")


def test_a_check_is_its_table() -> None:
    report = ns.check(things()["motion"], things()["system"])
    assert repr(report) == str(report)
    assert repr(report["blade"]) == "blade: HOLDS  no slip (below 1e-9 m/s)"


@pytest.mark.parametrize("name", ["trajectory", "primitive", "motion", "check"])
def test_a_notebook_shows_a_small_table_that_runs_nothing(name: str) -> None:
    evil = "<script>alert('cut')</script>"

    def rule(motion: Any) -> Any:
        return motion.rotation[:, 1].T @ motion.linear_velocity

    constraint = ns.velocity_constraint(name=evil)(rule)
    dmp = ns.learn(cut(), [constraint], basis_functions=20)
    shown = {
        "trajectory": replace(cut(), name=evil),
        "primitive": dmp,
        "motion": dmp.rollout(),
        "check": ns.check(dmp.rollout(), constraint),
    }[name]
    table = shown._repr_html_()
    assert table.startswith("<table>") and table.endswith("</table>")
    assert "&lt;script&gt;" in table and "<script" not in table
    assert len(table) < 2000


@pytest.mark.parametrize(("least", "shown"), [(1e-12, "0"), (3.0, "3")])
def test_a_notebook_shows_the_least_margin_of_a_limit(least: float, shown: str) -> None:
    motion = ns.learn(cut(), [ns.SpeedLimit(speed=10.0)]).rollout()
    margins = np.maximum(motion.margins - motion.margins.min(), least)
    table = replace(motion, margins=margins)._repr_html_()
    assert f"<td>speed-limit, least margin</td><td>{shown}</td>" in table


def test_what_moves_draws_itself() -> None:
    motion, demonstration = things()["motion"], things()["trajectory"]
    report = ns.check(motion, ns.Blade())
    drawn = [demonstration.plot(), motion.plot(), motion.plot(ns.Blade()), report.plot()]
    for figure in drawn:
        assert isinstance(figure, Figure)
        assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    # Beside pose and path: what the rollout's constraint added, or its residual.
    assert [len(figure.axes) for figure in drawn] == [6, 8, 8, 8]
    assert "return" in ns.PoseTrajectory.plot.__doc__


def test_a_report_compares_by_what_it_found() -> None:
    motion = things()["motion"]
    again = replace(motion, positions=np.array(motion.positions))
    assert ns.check(motion, ns.Blade()) == ns.check(again, ns.Blade())
