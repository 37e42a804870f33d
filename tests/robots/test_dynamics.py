"""The arm under torque control: what its dynamics leave of a tracked motion."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco", reason="the extra robots is not installed")
pytest.importorskip("daqp", reason="the extra robots is not installed")

import noslip as ns
from measures import slip
from noslip import robots

from .arms import arc, published_motion

BLADE = ns.Blade()


@pytest.fixture(scope="module")
def tracked() -> robots.TrackedMotion:
    placement = robots.Placement(np.array([0.4, 0.0, 0.3]), Rotation.identity())
    return robots.track(
        robots.panda(), arc(duration=1.5), BLADE, placement=placement, start=robots.panda().home
    )


def test_an_ideal_arm_follows_to_the_hundredth_of_a_millimeter(
    tracked: robots.TrackedMotion,
) -> None:
    done = robots.execute(tracked)
    executed = published_motion(tracked.times, done.joint_positions)
    off = np.linalg.norm(executed.positions - tracked.commanded.positions, axis=1)
    assert off.max() <= 2e-5
    speeds = slip(executed)
    assert done.slip[:, 0] == pytest.approx(speeds, abs=1e-9)
    assert done.slip_distance[0] == pytest.approx(np.abs(speeds).sum() * 1e-3, rel=1e-6)
    assert done.slip_distance[0] <= 5e-5
    assert done.saturated == 0
    assert np.all(done.torque_share < 1)
    # The arm holds itself up: at rest, its shoulder's torque is gravity's.
    assert abs(done.torques[0, 1]) > 1


@pytest.mark.parametrize("control", ["torque", "impedance"])
def test_noise_delay_and_a_wrong_model_cost_a_millimeter_at_most(
    tracked: robots.TrackedMotion, control: robots.Control
) -> None:
    ideal = robots.execute(tracked, control=control)
    done = robots.execute(tracked, control=control, noise=1.0, delay=0.002, model_error=0.05)
    again = robots.execute(tracked, control=control, noise=1.0, delay=0.002, model_error=0.05)
    assert np.array_equal(done.joint_positions, again.joint_positions)
    assert ideal.errors.position.max() < done.errors.position.max() <= 1.5e-3
    assert ideal.slip_distance[0] < done.slip_distance[0] <= 2e-3
    assert done.errors.rotation.max() <= np.radians(0.3)
    errors = done.errors
    total = np.sqrt(errors.along**2 + errors.lateral**2 + errors.depth**2)
    executed = published_motion(tracked.times, done.joint_positions)
    off = executed.positions - tracked.commanded.positions
    assert np.allclose(total, np.linalg.norm(off, axis=1), atol=1e-12)
    across = np.einsum("ki,ki->k", off, tracked.commanded.rotations.apply([0, 1, 0]))
    assert np.allclose(errors.lateral, across, atol=1e-12)


def test_torques_stay_within_their_limits_or_the_arm_is_lost(
    tracked: robots.TrackedMotion,
) -> None:
    weak = robots.panda().with_limits(torque=2.0)
    feeble = robots.track(
        weak, arc(duration=1.5), placement=tracked.placement, start=tracked.joint_positions[0]
    )
    with pytest.raises(ns.errors.ConvergenceError, match=r"out of control at 0\.\d+ s"):
        robots.execute(feeble)
    barely = robots.panda().with_limits(torque=[30, 30, 30, 16, 3, 3, 3])
    done = robots.execute(
        robots.track(barely, arc(duration=1.5), placement=tracked.placement, start=weak.home),
        noise=5.0,
    )
    assert np.all(np.abs(done.torques) <= barely.torque_limits)


def test_what_touches_nothing_keeps_its_distance(tracked: robots.TrackedMotion) -> None:
    done = robots.execute(tracked, noise=1.0)
    assert done.distance == pytest.approx(tracked.margins.distance, abs=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"control": "bang-bang"}, "control must be"),
        ({"noise": -1.0}, "noise must be"),
        ({"delay": 0.5}, "delay must be 0.02 s or less"),
        ({"delay": float("nan")}, "delay must be"),
        ({"model_error": 3.0}, "model_error must lie"),
    ],
)
def test_arguments_are_checked(
    tracked: robots.TrackedMotion, arguments: dict[str, object], message: str
) -> None:
    with pytest.raises(ns.errors.InputError, match=message):
        robots.execute(tracked, **arguments)  # type: ignore[arg-type]


def test_another_rate_than_the_controllers_is_refused(tracked: robots.TrackedMotion) -> None:
    coarse = robots.track(
        robots.panda(), arc(step=0.01), placement=tracked.placement, time_step=0.01
    )
    with pytest.raises(ns.errors.InputError, match="1 kHz"):
        robots.execute(coarse)


def test_nothing_is_logged_into_the_current_folder(
    tracked: robots.TrackedMotion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo writes its warnings to a file there, unless told otherwise."""
    mujoco = pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    with robots.model.mujoco_warnings() as warned:
        data = mujoco.MjData(tracked.robot.model)
        data.qpos[:] = np.nan
        mujoco.mj_step(tracked.robot.model, data)
    assert warned
    assert list(tmp_path.iterdir()) == []


def test_the_summary_is_plain_data_with_all_figures(tracked: robots.TrackedMotion) -> None:
    done = robots.execute(tracked)
    found = json.loads(json.dumps(robots.summary(tracked, done), allow_nan=False))
    assert found["kinematic"]["slip"]["blade"] == np.abs(tracked.slip).max()
    assert found["dynamic"]["slip_distance"] == done.slip_distance.tolist()
    assert found["margins"]["smallest"] == tracked.margins.smallest[0]
    assert "dynamic" not in robots.summary(tracked)


def test_the_joints_are_written_as_they_are(tracked: robots.TrackedMotion, tmp_path: Path) -> None:
    file = tracked.to_csv(tmp_path / "joints.csv")
    table = np.genfromtxt(file, delimiter=",", names=True)
    assert table.dtype.names == (
        "t",
        *(f"q{k}" for k in range(1, 8)),
        *(f"dq{k}" for k in range(1, 8)),
    )
    assert np.array_equal(table["q7"], tracked.joint_positions[:, 6])
    assert np.array_equal(table["dq1"], tracked.joint_velocities[:, 0])
