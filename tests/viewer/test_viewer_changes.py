"""New goals and pushes, as the viewer asks for them; files dropped onto it."""

from __future__ import annotations

import tempfile
from dataclasses import replace

import numpy as np
import pytest

import noslip as ns
from refusals import refusal

pytest.importorskip("viser", reason="the viewer needs viser (extra: viewer)")

from noslip.strangers import StrangersReader
from noslip.viewer.changes import Adapter, PushedRun, Wish
from noslip.viewer.uploads import read_upload

EXACT = 1e-10


def moved(primitive: ns.ConstrainedDMP, *by: float) -> Wish:
    return Wish(goal=ns.Boundary(1, primitive.goal_position + by))


@pytest.mark.parametrize("coarse", [True, False])
def test_a_moved_goal_is_reached_without_slipping(primitive, coarse):
    found = Adapter(primitive)(moved(primitive, 0.01, 0.005, 0.0), coarse=coarse)
    assert found.message == ""
    assert found.residual < EXACT and found.goal_error < 1e-4
    report = ns.check(found.motion, primitive.system, tolerance=EXACT)
    assert report.satisfied
    assert np.abs(found.motion.constraint_residuals).max() == found.residual
    assert "residual below 1e-9" in str(found)


def test_while_it_is_dragged_a_motion_takes_fewer_samples(primitive):
    adapter, goal = Adapter(primitive), moved(primitive, 0.004, 0.002, 0.0)
    coarse, fine = (adapter(goal, coarse=rough).primitive.record[0] for rough in (True, False))
    assert coarse.samples < 0.6 * fine.samples


def test_what_the_adapted_primitives_share_changes_nothing(primitive):
    wish = moved(primitive, 0.01, 0.005, 0.0)
    shared = Adapter(primitive)(wish).motion
    alone = primitive.adapt(goal_position=wish.goal.position).rollout()
    assert shared.positions.tolist() == alone.positions.tolist()
    assert shared.rotations.as_quat().tolist() == alone.rotations.as_quat().tolist()


def test_a_goal_that_cannot_be_reached_is_explained(primitive):
    found = Adapter(primitive)(moved(primitive, 0.0, 0.0, 0.01))
    assert found.primitive is None and found.motion is None
    assert "plane-contact" in found.message and "\n" not in found.message
    assert str(found).startswith("no such motion: ")


def test_start_duration_and_metric_change_too(primitive):
    start = primitive.start_position + [-0.01, 0.004, 0.0]
    found = Adapter(primitive)(Wish(start=ns.Boundary(0, start), duration=6.0, metric="shared"))
    assert found.motion.positions[0] == pytest.approx(start, abs=1e-9)
    assert found.motion.duration == pytest.approx(6.0, rel=1e-3)
    assert found.primitive.rule.inverse_metric[3:] != primitive.rule.inverse_metric[3:]
    assert found.residual < EXACT


def test_wishing_for_nothing_gives_the_motion_as_learned(primitive):
    found = Adapter(primitive)(Wish())
    assert found.motion.positions == pytest.approx(primitive.rollout().positions, abs=0)


def test_a_pushed_tool_comes_back_and_never_slips(primitive):
    run = PushedRun(primitive)
    run.advance(1.5)
    assert run.clock == pytest.approx(1.5, abs=0.02)
    path = primitive.rollout().positions
    assert run.off(path) < 1e-3
    run.push([0.0, 0.004, 0.0])
    run.advance(1.52)
    assert run.off(path) > 2e-3
    while not run.done:
        run.advance(run.clock + 0.5)
    assert run.goal_error < 2e-3
    assert run.residual < EXACT
    assert len(run.path) == len(run.states)


def test_a_run_that_is_over_goes_nowhere(primitive):
    run = PushedRun(replace(primitive, law=replace(primitive.law, steps=150)))
    while not run.done:
        run.advance(run.clock + 1.0)
    count = len(run.states)
    run.advance(run.clock + 1.0)
    assert len(run.states) == count


def test_a_push_is_three_finite_numbers(primitive):
    with pytest.raises(ns.errors.InputError, match="push"):
        PushedRun(primitive).push([0.0, np.nan, 0.0])


# ---------------------------------------------------------------- files


def test_an_uploaded_recording_is_the_one_that_was_saved(cut):
    read, warned = read_upload("runs\\cut 1.csv", cut.csv_text().encode(), StrangersReader())
    assert not warned
    assert read.name == "cut 1.csv"
    assert read.positions.tolist() == cut.positions.tolist()


def test_an_uploaded_primitive_is_read(primitive, tmp_path):
    content = primitive.save(tmp_path / "cut.json").read_bytes()
    read, _ = read_upload("cut.json", content, StrangersReader())
    assert read.rollout().positions.tolist() == primitive.rollout().positions.tolist()


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("broken.csv", b"t,x,y\n0,1,2\n", "broken.csv: "),
        ("../../etc/short.csv", b"t,x,y,z,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n", "short.csv: "),
        ("picture.png", b"\x89PNG", "picture.png: .png is not a known kind of recording"),
        ("nan.csv", b"t,x,y,theta\n" + b"nan,0,0,0\n" * 9, "nan.csv: "),
        ("list.json", b"[]", "list.json: not a noslip primitive"),
        ("", b"", "upload: no suffix is not a known kind"),
    ],
)
def test_a_broken_file_gives_one_line_that_names_it(name, content, expected):
    message = refusal(ns.errors.InputError, read_upload, name, content, StrangersReader())
    assert message.startswith(expected)
    assert tempfile.gettempdir() not in message
