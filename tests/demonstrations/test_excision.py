import numpy as np
import pytest

from measures import assert_same_poses
from noslip.constraints.blade import Blade
from noslip.demonstrations import excision
from noslip.demonstrations.excision import TOOL_FRAME, synthetic_excisions, synthetic_session
from noslip.demonstrations.preparation import apply_tool_frame, prepare
from noslip.errors import InputError
from noslip.projection.trajectory import project_trajectory

OUTLIER = 5
BLADE = Blade()


@pytest.fixture(scope="module")
def excisions():
    return synthetic_excisions()


@pytest.fixture(scope="module")
def cuts(excisions):
    """The blade's motion, by the paper's steps."""
    return [
        prepare(
            recording,
            tool_frame=TOOL_FRAME,
            trim_speed=0.005,
            rate=120,
            lowpass=4.8,
            relative=True,
        )
        for recording in excisions
    ]


def body_velocities(cut):
    # The copy is for SciPy 1.17, whose rotations reject read-only arrays.
    return cut.rotations.inv().apply(cut.linear_velocities.copy())


def test_tool_frame_is_the_papers_in_meters():
    np.testing.assert_array_equal(TOOL_FRAME[:3, 3], [0.052, 0, 0.013])
    np.testing.assert_array_equal(TOOL_FRAME[:3, :3], np.eye(3))
    assert not TOOL_FRAME.flags.writeable


def test_recordings_are_labeled_synthetic(excisions):
    assert [r.name for r in excisions] == [f"synthetic excision {k}" for k in range(1, 9)]
    assert "Synthetic" in excision.__doc__


def test_recordings_look_like_a_trackers(excisions):
    for recording in excisions:
        assert recording.is_uniform
        assert recording.period == pytest.approx(1 / 120)
        assert recording.times[0] > 1
        assert 3.6 <= recording.duration <= 7
        assert np.linalg.norm(recording.positions[0]) > 0.2


def test_a_seed_gives_the_same_recordings_whatever_their_number(excisions):
    for again, recording in zip(synthetic_excisions(count=3), excisions, strict=False):
        assert_same_poses(again, recording)


def test_another_seed_gives_other_recordings(excisions):
    other = synthetic_excisions(seed=8, count=1)[0]
    assert other.times[0] != excisions[0].times[0]


def test_values_are_those_of_every_platform(excisions):
    # Pinned, so that a change of the generator does not go unnoticed.
    found = [(len(r), *r.positions[100]) for r in (excisions[0], excisions[-1])]
    np.testing.assert_allclose(found, PINNED, atol=1e-9)


PINNED = [
    (739, 0.295775659885, -0.187981569429, 0.0779805466724),
    (612, 0.29029543029, -0.183399815043, 0.0732879788131),
]


def test_paths_are_parabolas_of_a_few_centimeters(excisions):
    for recording in excisions:
        blade = apply_tool_frame(recording, TOOL_FRAME)
        chord = blade.positions[-1] - blade.positions[0]
        assert 0.038 < np.linalg.norm(chord) < 0.052
        lateral = np.cross([0, 0, 1], chord / np.linalg.norm(chord))
        assert 0.014 < ((blade.positions - blade.positions[0]) @ lateral).max() < 0.021
        assert 0.0015 < np.ptp(blade.positions[:, 2]) < 0.0045


def test_blade_rests_before_and_after(excisions, cuts):
    for recording, cut in zip(excisions, cuts, strict=True):
        assert cut.times[0] - recording.times[0] > 0.3
        assert recording.times[-1] - cut.times[-1] > 0.3
        blade = apply_tool_frame(recording, TOOL_FRAME)
        assert blade.positions[:36].std(axis=0).max() < 2e-4
        assert blade.positions[-36:].std(axis=0).max() < 2e-4


def test_prepared_cuts_move_forward_throughout(cuts):
    for cut in cuts:
        speeds = np.linalg.norm(cut.linear_velocities, axis=1)
        assert body_velocities(cut)[:, 0].min() > 0
        assert speeds.min() > 0.1 * speeds.max()


def test_speed_is_bell_shaped(cuts):
    for cut in cuts:
        speeds = np.linalg.norm(cut.linear_velocities, axis=1)
        assert 0.3 < np.argmax(speeds) / len(cut) < 0.7
        assert 0.015 < speeds.max() < 0.05
        calm = np.convolve(speeds, np.ones(36) / 36, mode="valid")
        peak = np.argmax(calm)
        assert np.all(np.diff(calm[: peak - 24 : 12]) > 0)
        assert np.all(np.diff(calm[peak + 24 :: 12]) < 0)


def test_blade_slips_along_its_positive_lateral_axis_most_of_all_midway(cuts):
    for cut in cuts:
        forward, lateral, _ = body_velocities(cut).T
        assert np.mean(lateral > 0) > 0.7
        assert 0.3 < np.argmax(lateral) / len(cut) < 0.7
        middle = slice(len(cut) // 3, -len(cut) // 3)
        assert 10 < np.degrees(np.arctan2(lateral, forward))[middle].max() < 45


def test_one_of_eight_is_held_differently(cuts):
    rolls = np.array([np.median(cut.rotations.as_euler("xyz", degrees=True)[:, 0]) for cut in cuts])
    assert rolls[OUTLIER] > 20
    assert np.abs(np.delete(rolls, OUTLIER)).max() < 10


def test_trials_differ(cuts):
    assert np.ptp([cut.duration for cut in cuts]) > 0.5
    assert np.ptp([cut.path_length for cut in cuts]) > 0.003


@pytest.fixture(scope="module")
def session():
    return synthetic_session()


@pytest.fixture(scope="module")
def blade(session):
    """The blade's motion through the session, by the paper's steps."""
    return prepare(session.recording, tool_frame=TOOL_FRAME, lowpass=4.8)


def test_a_session_holds_the_same_cuts(session, blade, excisions):
    """Where the single recordings have them, but for tremor and noise."""
    assert session.recording.is_uniform
    assert session.cuts.shape == (8, 2)
    for (start, end), single in zip(session.cuts, excisions, strict=True):
        alone = prepare(single, tool_frame=TOOL_FRAME, lowpass=4.8).positions
        here = blade.resampled(times=np.linspace(start, end, 100)).positions
        nearest = np.linalg.norm(here[:, None] - alone, axis=2).min(axis=1)
        assert nearest.max() < 0.5e-3
        assert np.linalg.norm(here[[0, -1]] - alone[[0, -1]], axis=1).max() < 0.5e-3


def test_a_session_rests_around_each_cut_and_moves_freely_between_them(session, blade):
    speeds = np.linalg.norm(blade.linear_velocities, axis=1)
    for start, end in session.cuts:
        for rest in ((start - 0.25, start), (end, end + 0.25)):
            assert speeds[(blade.times > rest[0]) & (blade.times < rest[1])].max() < 5e-3
    ends = [blade.times[0], *session.cuts.ravel(), blade.times[-1]]
    for end, start in zip(ends[::2], ends[1::2], strict=True):
        inside = (blade.times > end) & (blade.times < start)
        assert 0.04 < speeds[inside].max() < 0.4
        assert np.ptp(blade.positions[inside, 2]) > 0.01


@pytest.mark.parametrize("made", [synthetic_excisions, synthetic_session])
@pytest.mark.parametrize("wrong", [{"count": 0}, {"seed": -1}])
def test_nonsense_is_refused(made, wrong):
    with pytest.raises(InputError, match=rf"^{made.__name__}: "):
        made(**wrong)


def turn_near_its_ends(motion, seconds=0.1):
    """Way turned (degrees) in the first and in the last tenth of a second."""
    _, angular = motion.step_velocities()
    turned = np.degrees(np.linalg.norm(angular, axis=1) * np.diff(motion.times))
    steps = round(seconds / motion.period)
    return max(turned[:steps].sum(), turned[-steps:].sum())


@pytest.mark.parametrize("trim_speed", [None, 0.001, 0.002, 0.005])
def test_noise_at_rest_turns_no_blade(excisions, cuts, trim_speed):
    """Wherever it is trimmed, a blade that begins and ends slowly heads where it moves."""
    made = (
        cuts
        if trim_speed == 0.005
        else [
            prepare(r, tool_frame=TOOL_FRAME, trim_speed=trim_speed, lowpass=4.8) for r in excisions
        ]
    )
    assert max(turn_near_its_ends(project_trajectory(c, BLADE).trajectory) for c in made) < 2.2


def test_filtered_after_trimming_the_noise_of_the_ends_turns_it(excisions):
    preparation = {"tool_frame": TOOL_FRAME, "trim_speed": 0.005, "lowpass": 4.8}
    made = [prepare(r, **preparation, order="paper") for r in excisions]
    turns = [turn_near_its_ends(project_trajectory(c, BLADE).trajectory) for c in made]
    assert max(turns) > 5
