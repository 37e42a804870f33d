"""Whether several demonstrations show one motion: noticed, named, refused; silent where they do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.demonstrations.agreement import require_agreement
from noslip.demonstrations.excision import TOOL_FRAME, synthetic_excisions
from noslip.errors import InputError, RecordingWarning
from noslip.trajectory import PoseTrajectory
from refusals import refusal
from strategies import seeds


def bow(
    *,
    turned: float = 0.0,
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    timing: float = 0.0,
    size: float = 0.1,
    name: str = "bow",
) -> PoseTrajectory:
    """A bowed cut from rest to rest, its edge ahead; ``timing`` of up to 1 does it late."""
    u = np.linspace(0, 1, 201)
    s = u**2 * (3 - 2 * u)
    s = s + timing * s * (s - 1)
    path = size * np.column_stack([s, 0.8 * s * (1 - s), 0 * s])
    yaw = Rotation.from_euler("z", np.arctan2(0.8 * (1 - 2 * s), np.ones_like(s)))
    place = Rotation.from_euler("z", turned)
    return PoseTrajectory(3 * u, place.apply(path) + at, place * yaw, name=name)


def backwards(motion: PoseTrajectory, *, name: str = "back") -> PoseTrajectory:
    """The same path run the other way, the tool held alike."""
    return PoseTrajectory(motion.times, motion.positions[::-1], motion.rotations[::-1], name=name)


@given(
    seed=seeds,
    count=st.integers(2, 6),
    size=st.sampled_from([1e-3, 0.1, 10.0]),
)
@settings(max_examples=30)
def test_repeats_of_one_motion_agree(seed: int, count: int, size: float) -> None:
    """With other timing, rates, noise and places, each by as much as a hand does."""
    rng = np.random.default_rng(seed)
    repeats = []
    for _ in range(count):
        motion = bow(timing=rng.uniform(-0.2, 0.2), size=size, turned=rng.uniform(-0.1, 0.1))
        motion = motion[:: rng.integers(1, 4)]
        noise = size * 1e-3 * rng.standard_normal((len(motion), 3))
        turns = Rotation.from_rotvec(0.02 * rng.standard_normal((len(motion), 3)))
        place = size * rng.uniform(-0.02, 0.02, 3)
        repeats.append(
            PoseTrajectory(
                rng.uniform(0.5, 2) * motion.times,
                motion.positions + noise + place,
                turns * motion.rotations,
            )
        )
    require_agreement(repeats)


@pytest.mark.parametrize("size", [1e-3, 0.1, 10.0])
def test_starts_that_lie_apart_are_noticed(size: float) -> None:
    repeats = [
        bow(size=size, name="one"),
        bow(size=size, name="two", at=(0.5 * size, 0, 0)),
        bow(size=size, name="three", at=(0, 0.3 * size, 0)),
    ]
    with pytest.warns(RecordingWarning, match="two and three: their starts lie") as told:
        ns.learn(repeats, basis_functions=20)
    message = str(told[0].message)
    assert f"starts lie {np.hypot(0.5, 0.3) * size:.2g} m apart" in message
    for remedy in ("--relative", "prepare(..., relative=True)", "--each", "learn_each"):
        assert remedy in message
    # What it names is a remedy.
    require_agreement([ns.prepare(motion, relative=True) for motion in repeats])


def test_relative_is_no_remedy_for_paths_that_differ() -> None:
    with pytest.warns(RecordingWarning, match="relative to their starts they differ too") as told:
        require_agreement([bow(), bow(turned=1.5, at=(0.3, 0, 0))])
    assert "--relative" not in str(told[0].message)


@pytest.mark.parametrize("relative", [False, True])
def test_a_forward_and_a_backward_one_are_refused(relative: bool) -> None:
    repeats = [bow(name="one"), bow(name="two", timing=0.2), backwards(bow(timing=-0.1))]
    repeats = [ns.prepare(motion, relative=relative) for motion in repeats]
    message = refusal(InputError, ns.learn, repeats)
    assert "one and back run in opposite directions" in message
    assert "--each (learn_each)" in message


def test_a_loop_run_both_ways_round_is_refused() -> None:
    a = np.linspace(0, 2 * np.pi, 301)
    loop = PoseTrajectory(
        a, np.column_stack([np.cos(a), np.sin(a), 0 * a]), Rotation.identity(301), name="loop"
    )
    refusal(InputError, require_agreement, [loop, backwards(loop)])
    require_agreement([loop, loop])


def test_a_motion_out_and_back_is_its_own_reverse() -> None:
    a = np.linspace(0, np.pi, 301)
    there = np.column_stack([np.sin(a), 0.1 * np.sin(a) ** 2, 0 * a])
    motion = PoseTrajectory(a, there, Rotation.identity(301))
    require_agreement([motion, backwards(motion)])


def test_a_tool_held_the_other_way_round_is_refused() -> None:
    other = bow(name="other")
    other = PoseTrajectory(
        other.times,
        other.positions,
        other.rotations * Rotation.from_euler("z", 170, degrees=True),
        name="other",
    )
    message = refusal(InputError, ns.learn, [bow(name="one"), other])
    assert "one and other hold the tool opposite ways" in message


def test_out_of_step_align_is_named() -> None:
    repeats = [bow(timing=0.9, name="late"), bow(timing=-0.9, name="early")]
    with pytest.warns(RecordingWarning, match=r"late and 1 more: are out of step.*--align"):
        ns.learn(repeats, basis_functions=20)
    require_agreement(repeats, aligned=True)


def test_turning_on_the_spot_has_no_direction() -> None:
    t = np.linspace(0, 2, 101)
    turn = PoseTrajectory(t, np.zeros((101, 3)), Rotation.from_euler("z", t))
    require_agreement([turn, turn])


# ---------------------------------------------------------------- real recordings


def test_excisions_made_relative_agree() -> None:
    cuts = [
        ns.prepare(r, tool_frame=TOOL_FRAME, trim_speed=0.005, lowpass=True)
        for r in synthetic_excisions()
    ]
    require_agreement([ns.prepare(cut, relative=True) for cut in cuts])
    with pytest.warns(RecordingWarning, match="--relative"):
        require_agreement(cuts)


@pytest.mark.recordings
@pytest.mark.parametrize("placement", "bcd")
@pytest.mark.parametrize("preparation", [{}, {"trim_speed": 0.05, "relative": True}])
def test_contour_runs_at_one_placement_agree(
    placement: str, preparation: dict[str, object], recordings: Path
) -> None:
    runs = ns.load_demonstrations(recordings / "contour_following" / f"data_demo_{placement}_*.csv")
    require_agreement([ns.prepare(run, **preparation) for run in runs])  # type: ignore[arg-type]


@pytest.mark.recordings
def test_contour_runs_at_several_placements_do_not(recordings: Path) -> None:
    runs = ns.load_demonstrations(recordings / "contour_following" / "*.csv")
    with pytest.warns(RecordingWarning, match=r"starts lie 0\.\d+ m apart.*--each"):
        require_agreement(runs)


@pytest.mark.recordings
def test_needle_insertions_made_relative_agree(recordings: Path) -> None:
    runs = ns.load_demonstrations(recordings / "needle_insertion" / "*.csv", rate=14.5)
    require_agreement([ns.prepare(run, relative=True) for run in runs])
