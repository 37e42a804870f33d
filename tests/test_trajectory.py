"""PoseTrajectory: an immutable value whose velocities belong to its poses."""

from __future__ import annotations

import errno
import re
from collections.abc import Callable
from dataclasses import FrozenInstanceError, dataclass, fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from noslip import PoseTrajectory
from noslip._typing import Floats
from noslip.errors import InputError
from refusals import refusal

ARRAYS = ("times", "positions", "linear_velocities", "angular_velocities")


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


@st.composite
def trajectories(draw: st.DrawFn, *, least: int = 2, most: int = 40) -> PoseTrajectory:
    """Any motion on an irregular grid that starts anywhere."""
    count = draw(st.integers(least, most))
    start = draw(st.sampled_from([0.0, -3.7, 12.5, 1.7e9]) | numbers(-1e4, 1e4))
    periods = draw(arrays(np.float64, count - 1, elements=numbers(0.01, 0.05)))
    vectors = arrays(np.float64, (count, 3), elements=numbers(-10.0, 10.0))
    return PoseTrajectory(
        times=start + np.concatenate([[0.0], np.cumsum(periods)]),
        positions=draw(vectors),
        rotations=Rotation.from_rotvec(draw(vectors)),
        name="drawn",
    )


@given(arrays(np.float64, (5, 3), elements=st.floats(-9.0, 9.0)), st.sampled_from([1, 1e-3, 1e-9]))
def test_steps_turn_by_what_leads_from_each_rotation_to_the_next(vectors, scale):
    rotations = Rotation.from_rotvec(scale * np.concatenate([vectors, vectors[-1:]]))
    motion = PoseTrajectory(np.arange(6.0), np.zeros((6, 3)), rotations)
    _, turns = motion.step_velocities()
    assert np.linalg.norm(turns, axis=1).max() <= np.pi
    np.testing.assert_array_equal(turns[-1], 0.0)
    left = Rotation.from_rotvec(turns.copy()) * rotations[:-1] * rotations[1:].inv()
    assert left.magnitude().max() <= 1e-14
    np.testing.assert_allclose(
        turns, (rotations[1:] * rotations[:-1].inv()).as_rotvec(), rtol=0, atol=4e-15
    )


@dataclass(frozen=True)
class Motion:
    """A motion known in closed form: Exp(t u) Exp(t v) turns at u + Exp(t u) v."""

    u: tuple[float, float, float] = (0.4, -1.1, 0.8)
    v: tuple[float, float, float] = (-0.9, 0.3, 1.7)

    def positions(self, t: Floats) -> Floats:
        return np.stack([np.cos(t), np.sin(2 * t), np.exp(-t) * t], axis=1)

    def linear(self, t: Floats) -> Floats:
        return np.stack([-np.sin(t), 2 * np.cos(2 * t), np.exp(-t) * (1 - t)], axis=1)

    def rotations(self, t: Floats) -> Rotation:
        return self._exp(self.u, t) * self._exp(self.v, t)

    def angular(self, t: Floats) -> Floats:
        return np.asarray(self.u) + self._exp(self.u, t).apply(self.v)

    @staticmethod
    def _exp(axis: tuple[float, float, float], t: Floats) -> Rotation:
        return Rotation.from_rotvec(t[:, None] * np.asarray(axis))

    def sampled(self, times: Floats) -> PoseTrajectory:
        return PoseTrajectory(
            times=times, positions=self.positions(times), rotations=self.rotations(times)
        )


def uniform(count: int) -> Floats:
    return np.linspace(0.5, 3.5, count)


def stretched(count: int) -> Floats:
    """Periods that differ up to five times, smoothly."""
    s = np.linspace(0.0, 1.0, count)
    return 0.5 + 3.0 * (s + 0.65 * np.sin(2 * np.pi * s) / (2 * np.pi))


def jittered(count: int) -> Floats:
    """Periods that differ up to four times from one sample to the next."""
    periods = np.random.default_rng(7).uniform(0.5, 2.0, count - 1)
    return 0.5 + 3.0 * np.concatenate([[0.0], np.cumsum(periods)]) / periods.sum()


def plain(count: int = 10, **changes: object) -> PoseTrajectory:
    """Build a motion with one thing wrong."""
    given: dict[str, object] = {
        "times": np.arange(count) / 10,
        "positions": np.zeros((count, 3)),
        "rotations": Rotation.identity(count),
        "name": "run.csv",
    }
    return PoseTrajectory(**{**given, **changes})  # type: ignore[arg-type]


# -------------------------------------------------------------------- a value


@given(trajectories())
def test_nothing_in_a_trajectory_can_be_changed(trajectory: PoseTrajectory) -> None:
    for field in fields(trajectory):
        with pytest.raises(FrozenInstanceError):
            setattr(trajectory, field.name, None)
    for name in ARRAYS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(trajectory, name)[0] = 0.0


def test_a_trajectory_keeps_copies_of_what_it_is_given() -> None:
    motion = Motion()
    times = uniform(20)
    given = {
        "times": times.copy(),
        "positions": motion.positions(times),
        "linear_velocities": motion.linear(times),
        "angular_velocities": motion.angular(times),
    }
    rotations = motion.rotations(times)
    trajectory = PoseTrajectory(**given, rotations=rotations)
    quaternions = trajectory.quaternions
    before = {name: array.copy() for name, array in given.items()}
    for array in given.values():
        array += 1.0
    rotations[3] = Rotation.identity()
    for name, array in before.items():
        np.testing.assert_array_equal(getattr(trajectory, name), array)
    np.testing.assert_array_equal(trajectory.quaternions, quaternions)


@given(trajectories(), st.data())
def test_a_slice_holds_the_same_samples_with_the_same_velocities(
    trajectory: PoseTrajectory, data: st.DataObject
) -> None:
    start = data.draw(st.integers(0, len(trajectory) - 2))
    stop = data.draw(st.integers(start + 2, len(trajectory)))
    step = data.draw(st.integers(1, stop - start - 1))
    index = slice(start, stop, step)
    part = trajectory[index]
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(part, name), getattr(trajectory, name)[index])
    np.testing.assert_array_equal(part.rotations.as_quat(), trajectory.rotations.as_quat()[index])
    assert part.name == trajectory.name


def test_a_trajectory_is_neither_indexed_nor_iterated() -> None:
    trajectory = plain()
    with pytest.raises(TypeError, match="sliced"):
        trajectory[3]  # type: ignore[index]
    with pytest.raises(TypeError, match="positions"):
        iter(trajectory)
    with pytest.raises(InputError, match=r"run\.csv.* 2 samples, got 1"):
        trajectory[3:4]
    with pytest.raises(InputError, match=r"run\.csv.* must increase"):
        trajectory[::-1]


def test_length_duration_path_and_period() -> None:
    trajectory = plain(positions=np.arange(10)[:, None] * [3.0, 4.0, 0.0])
    assert len(trajectory) == 10
    assert trajectory.duration == pytest.approx(0.9)
    assert trajectory.path_length == pytest.approx(45.0)
    assert trajectory.period == pytest.approx(0.1)
    assert repr(trajectory) == "PoseTrajectory('run.csv', 10 samples, 0.9 s, path 45 m)"


@pytest.mark.parametrize("start", [0.0, -5.0, 1.7e9])
def test_uniform_sampling_is_recognized_wherever_time_starts(start: float) -> None:
    assert plain(200, times=start + np.arange(200) / 14.5).is_uniform
    late = np.arange(200) / 14.5
    late[70] += 1e-4
    assert not plain(200, times=start + late).is_uniform


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"times": np.zeros((10, 1))}, r"times has shape \(10, 1\), expected \(10,\)"),
        ({"times": 5.0}, r"times has shape \(\)"),
        ({"times": ["a"] * 10}, r"times is not an array of numbers"),
        ({"positions": np.zeros((10, 2))}, r"positions has shape \(10, 2\), expected \(10, 3\)"),
        ({"positions": np.zeros((9, 3))}, r"positions has shape \(9, 3\), expected \(10, 3\)"),
        ({"positions": [[0, 0, 0], [0, 0]]}, r"positions is not an array of numbers"),
        ({"linear_velocities": np.zeros((9, 3))}, r"linear_velocities has shape \(9, 3\)"),
        ({"angular_velocities": np.zeros(10)}, r"angular_velocities has shape \(10,\)"),
        ({"rotations": Rotation.identity(9)}, r"10 times but 9 rotations"),
        ({"rotations": Rotation.identity()}, r"10 times but not a row of rotations"),
        (
            {"rotations": np.tile([1.0, 0, 0, 0], (10, 1))},
            r"got ndarray; of quaternions take Rotation.from_quat\(quaternions, scalar_first=True",
        ),
    ],
)
def test_what_does_not_fit_together_is_refused(changes: dict[str, object], message: str) -> None:
    assert re.search(rf"^run\.csv: .*{message}", refusal(InputError, plain, **changes))


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ARRAYS)
def test_a_number_that_is_not_finite_is_refused(name: str, wrong: float) -> None:
    array = np.arange(10.0) if name == "times" else np.zeros((10, 3))
    array[6] = wrong
    with pytest.raises(InputError, match=rf"run\.csv: {name}\[6\] is not finite"):
        plain(**{name: array})


@pytest.mark.parametrize("step", [0.0, -0.25])
def test_times_that_do_not_increase_are_refused_by_name(step: float) -> None:
    times = 1.7e9 + np.arange(10.0)
    times[4] = times[3] + step
    message = rf"sample 4 is at {3 + step:g} s after its start, the one before at 3 s after"
    with pytest.raises(InputError, match=message):
        plain(times=times)


# -------------------------------------------------------------------- velocities


def errors(grid: Callable[[int], Floats], count: int) -> tuple[float, float]:
    """Return the largest errors of the estimated linear and angular velocities."""
    motion, times = Motion(), grid(count)
    trajectory = motion.sampled(times)
    return (
        float(np.abs(trajectory.linear_velocities - motion.linear(times)).max()),
        float(np.abs(trajectory.angular_velocities - motion.angular(times)).max()),
    )


@pytest.mark.parametrize("grid", [uniform, stretched, jittered])
@pytest.mark.parametrize("kind", [0, 1], ids=["linear", "angular"])
def test_velocities_converge_at_second_order(grid: Callable[[int], Floats], kind: int) -> None:
    counts = np.array([100, 200, 400, 800, 1600])
    found = [errors(grid, count)[kind] for count in counts]
    order = -np.polyfit(np.log(counts), np.log(found), 1)[0]
    assert 1.8 < order < 2.5
    assert found[-1] < 1e-4


def test_two_samples_have_the_velocity_of_their_one_step() -> None:
    trajectory = plain(
        2,
        positions=[[0, 0, 0], [0.2, 0, 0]],
        rotations=Rotation.from_rotvec([[0, 0, 0], [0, 0, 0.3]]),
    )
    np.testing.assert_allclose(trajectory.linear_velocities, [[2, 0, 0]] * 2)
    np.testing.assert_allclose(trajectory.angular_velocities, [[0, 0, 3]] * 2)


@given(st.integers(0, 2**32 - 1))
def test_a_constant_screw_motion_has_constant_velocities_on_any_grid(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = rng.uniform(-5, 5) + np.cumsum(rng.uniform(0.01, 0.1, 30))
    velocity, spin = rng.normal(size=3), rng.normal(size=3) * 5
    trajectory = PoseTrajectory(
        times=times,
        positions=times[:, None] * velocity,
        rotations=Rotation.from_rotvec(times[:, None] * spin)
        * Rotation.from_quat(rng.normal(size=4)),
    )
    np.testing.assert_allclose(trajectory.linear_velocities, np.tile(velocity, (30, 1)), atol=1e-9)
    np.testing.assert_allclose(trajectory.angular_velocities, np.tile(spin, (30, 1)), atol=1e-9)


def test_many_turns_neither_wrap_nor_flip() -> None:
    times = jittered(1500) * 10  # 30 s, 50 samples a turn
    spin = np.array([0.0, -3.0, 4.0]) * 2
    trajectory = PoseTrajectory(
        times=times,
        positions=np.zeros((len(times), 3)),
        rotations=Rotation.from_rotvec(times[:, None] * spin),
    )
    assert trajectory.duration * np.linalg.norm(spin) / (2 * np.pi) > 45
    np.testing.assert_allclose(
        trajectory.angular_velocities, np.broadcast_to(spin, (len(times), 3)), atol=1e-9
    )
    quaternions = trajectory.quaternions
    assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0.9)
    finer = trajectory.resampled(rate=200.0)
    # Of fourth order in the eighth of a radian between two samples, of third at the ends.
    np.testing.assert_allclose(
        finer.angular_velocities, np.broadcast_to(spin, (len(finer), 3)), atol=5e-4
    )


@given(trajectories())
def test_steps_reproduce_the_motion(trajectory: PoseTrajectory) -> None:
    linear, angular = trajectory.step_velocities()
    assert linear.shape == angular.shape == (len(trajectory) - 1, 3)
    periods = np.diff(trajectory.times)[:, None]
    after = trajectory.positions[:-1] + periods * linear
    np.testing.assert_allclose(after, trajectory.positions[1:], atol=1e-13)
    turned = Rotation.from_rotvec(periods * angular) * trajectory.rotations[:-1]
    apart = (turned * trajectory.rotations[1:].inv()).magnitude()
    np.testing.assert_allclose(apart, 0, atol=1e-14)


@given(trajectories(), st.data())
def test_the_sign_of_a_quaternion_means_nothing(
    trajectory: PoseTrajectory, data: st.DataObject
) -> None:
    signs = data.draw(arrays(np.float64, (len(trajectory), 1), elements=st.sampled_from([-1, 1])))
    flipped = PoseTrajectory(
        times=trajectory.times,
        positions=trajectory.positions,
        rotations=Rotation.from_quat(trajectory.rotations.as_quat() * signs),
    )
    quaternions = flipped.quaternions
    assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=1) >= 0)
    same = np.sign(np.sum(quaternions[0] * trajectory.quaternions[0]))
    # Exactly half a turn apart, either sign is continuous: compare rotations, and signs elsewhere.
    np.testing.assert_allclose(
        (flipped.rotations * trajectory.rotations.inv()).magnitude(), 0, atol=1e-14
    )
    steps = np.sum(trajectory.quaternions[1:] * trajectory.quaternions[:-1], axis=1)
    if np.all(steps > 1e-12):
        np.testing.assert_allclose(quaternions, same * trajectory.quaternions, atol=1e-14)
        np.testing.assert_allclose(
            flipped.angular_velocities, trajectory.angular_velocities, atol=1e-9
        )


# -------------------------------------------------------------------- resampling


@pytest.mark.parametrize("grid", [uniform, stretched, jittered])
def test_resampled_poses_and_velocities_are_those_of_the_motion(
    grid: Callable[[int], Floats],
) -> None:
    motion = Motion()
    resampled = motion.sampled(grid(600)).resampled(rate=333.0)
    times = resampled.times
    np.testing.assert_allclose(resampled.positions, motion.positions(times), atol=1e-8)
    np.testing.assert_allclose(resampled.linear_velocities, motion.linear(times), atol=1e-5)
    apart = (resampled.rotations * motion.rotations(times).inv()).magnitude()
    spin_apart = np.abs(resampled.angular_velocities - motion.angular(times)).max(axis=1)
    assert apart.max() < 5e-5
    assert spin_apart.max() < 1e-2
    # SciPy's rotation spline starts and ends without acceleration, which this motion does not;
    # that is felt for a dozen samples.
    inner = slice(len(times) // 8, -len(times) // 8)
    assert apart[inner].max() < 1e-9
    assert spin_apart[inner].max() < 1e-7


@given(trajectories())
def test_resampling_at_the_samples_gives_them_back(trajectory: PoseTrajectory) -> None:
    again = trajectory.resampled(times=trajectory.times)
    np.testing.assert_array_equal(again.times, trajectory.times)
    np.testing.assert_allclose(again.positions, trajectory.positions, atol=1e-9)
    apart = (again.rotations * trajectory.rotations.inv()).magnitude()
    np.testing.assert_allclose(apart, 0, atol=1e-9)
    assert again.name == trajectory.name


@pytest.mark.parametrize("start", [0.0, -5.0, 1.7e9])
@pytest.mark.parametrize("rate", [10.0, 14.5, 20.0, 1000 / 3])
def test_resampling_to_a_rate_keeps_both_ends(start: float, rate: float) -> None:
    times = start + np.arange(101) / rate
    resampled = plain(101, times=times).resampled(rate=2 * rate)
    assert len(resampled) == 201
    assert resampled.times[0] == times[0]
    assert resampled.times[-1] == times[-1]
    assert resampled.is_uniform


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "either a rate or times"),
        ({"rate": 10, "times": [0.1, 0.2]}, "either a rate or times"),
        ({"rate": 0}, "rate must be positive, got 0"),
        ({"rate": np.nan}, "rate must be positive, got nan"),
        ({"rate": 0.5}, "fewer than 2 samples in 0.9 s"),
        ({"times": [0.1]}, "2 or more finite times"),
        ({"times": [0.1, np.nan]}, "2 or more finite times"),
        ({"times": [0.5, 1.0]}, "recorded from 0 to 0.9 s, cannot be resampled from 0.5 to 1 s"),
        ({"times": [0.2, 0.1]}, "times must increase"),
    ],
)
def test_resampling_that_cannot_be_is_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        plain().resampled(**arguments)  # type: ignore[arg-type]


# -------------------------------------------------------------------- files


@pytest.mark.parametrize("kind", ["csv", "npz"])
@given(trajectory=trajectories(least=8))
def test_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, kind: str, trajectory: PoseTrajectory
) -> None:
    path = tmp_path_factory.getbasetemp() / f"round_trip.{kind}"
    if kind == "csv":
        assert trajectory.to_csv(path) == path
        back = PoseTrajectory.from_csv(path)
    else:
        assert trajectory.to_npz(path) == path
        back = PoseTrajectory.from_npz(path)
    exact = ARRAYS if kind == "npz" else ("times", "positions")
    for name in exact:
        np.testing.assert_array_equal(getattr(back, name), getattr(trajectory, name))
    np.testing.assert_allclose(back.quaternions, trajectory.quaternions, rtol=0, atol=1e-15)
    assert back.name == str(path)


def test_a_csv_holds_what_its_header_says(tmp_path: Path) -> None:
    turned = Rotation.from_quat(np.tile([0.0, 0.0, 0.6, 0.8], (8, 1)))
    path = plain(8, rotations=turned).to_csv(tmp_path / "new" / "folder" / "run.csv")
    header, first, *_ = path.read_text().splitlines()
    assert header == "t,x,y,z,qw,qx,qy,qz"
    assert first == "0.0,0.0,0.0,0.0,0.8,0.0,0.0,0.6"


@pytest.mark.parametrize("write", [PoseTrajectory.to_csv, PoseTrajectory.to_npz])
@pytest.mark.parametrize("failure", ["write", "rename", "interrupt"])
def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    write: Callable[[PoseTrajectory, Path], Path],
    failure: str,
) -> None:
    path = tmp_path / "run"
    path.write_text("old")
    full = OSError(errno.ENOSPC, "No space left on device")

    def fail(*_: object) -> None:
        raise KeyboardInterrupt if failure == "interrupt" else full

    if failure == "write":
        written = Path.write_bytes

        def half(file: Path, content: bytes) -> int:
            written(file, content[: len(content) // 2])
            raise full

        monkeypatch.setattr("noslip._files.Path.write_bytes", half)
    else:
        monkeypatch.setattr(Path, "replace", fail)

    expected = KeyboardInterrupt if failure == "interrupt" else InputError
    with pytest.raises(expected) as caught:
        write(plain(), path)
    if expected is InputError:
        assert str(caught.value) == f"{path}: cannot be written: No space left on device"
    monkeypatch.undo()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_write_into_a_file_as_a_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        plain().to_csv(tmp_path / "file" / "run.csv")
