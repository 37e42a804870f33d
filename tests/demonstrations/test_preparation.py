import inspect

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from noslip.demonstrations.preparation import (
    MINIMUM_SAMPLES,
    PAPER_CUTOFF,
    apply_tool_frame,
    lowpass,
    prepare,
    relative_to_start,
    tool_frame_matrix,
    trim_speed,
    trim_time,
)
from noslip.errors import InputError
from noslip.trajectory import PoseTrajectory

RATE = 120.0
INTERIOR = slice(75, -75)
"""Samples at 120 Hz that a filter of 4.8 Hz lets the ends have no part in."""

numbers = st.floats(-2, 2, allow_subnormal=False)


@st.composite
def turns(draw):
    """One rotation of any size and axis."""
    vector = draw(arrays(float, 4, elements=st.floats(-1, 1, allow_subnormal=False)))
    assume(np.linalg.norm(vector) > 0.1)
    return Rotation.from_quat(vector)


@st.composite
def motions(draw, samples=60, rate=RATE):
    """A smooth motion with some jitter, drawn through one seed."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return random_motion(rng, samples, rate)


def random_motion(rng, samples, rate=RATE, start=3.0, name="motion"):
    times = start + np.arange(samples) / rate
    clock = (times - start)[:, None]
    waves = [
        rng.uniform(0.2, 1, 3) * np.sin(rng.uniform(0.5, 4, 3) * clock + rng.uniform(0, 6, 3))
        for _ in range(2)
    ]
    jitter = Rotation.from_rotvec(0.02 * rng.standard_normal((samples, 3)))
    return PoseTrajectory(
        times=times,
        positions=waves[0] + 1e-3 * rng.standard_normal((samples, 3)),
        rotations=jitter * Rotation.from_rotvec(2 * waves[1]),
        name=name,
    )


def turning(rotations, rate=RATE):
    """A trajectory that only turns."""
    count = len(rotations)
    return PoseTrajectory(
        times=np.arange(count) / rate, positions=np.zeros((count, 3)), rotations=rotations
    )


def planar(angles, axis=(0.0, 0.6, 0.8), rate=RATE):
    return turning(Rotation.from_rotvec(np.outer(angles, axis)), rate)


def moving(positions, times):
    return PoseTrajectory(
        times=times, positions=positions, rotations=Rotation.identity(len(times)), name="slide"
    )


def angle_between(one, other):
    """Radians by which the rotations of two trajectories differ at each sample."""
    return (one.rotations * other.rotations.inv()).magnitude()


def homogeneous(rotation, position):
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.as_matrix()
    matrix[:3, 3] = position
    return matrix


def same(one, other):
    return (
        np.array_equal(one.times, other.times)
        and np.array_equal(one.positions, other.positions)
        and np.array_equal(one.rotations.as_quat(), other.rotations.as_quat())
        and np.array_equal(one.linear_velocities, other.linear_velocities)
        and np.array_equal(one.angular_velocities, other.angular_velocities)
        and one.name == other.name
    )


def is_one_line(error):
    return "\n" not in str(error.value)


# ---------------------------------------------------------------- tool frame


@given(motion=motions(samples=12), turn=turns(), shift=arrays(float, 3, elements=numbers))
def test_tool_frame_multiplies_homogeneous_matrices(motion, turn, shift):
    tool = homogeneous(turn, shift)
    blade = apply_tool_frame(motion, tool)
    for k in range(len(motion)):
        expected = homogeneous(motion.rotations[k], motion.positions[k]) @ tool
        found = homogeneous(blade.rotations[k], blade.positions[k])
        np.testing.assert_allclose(found, expected, atol=1e-12)
    assert blade.name == motion.name


@given(motion=motions(samples=12), turn=turns(), shift=arrays(float, 3, elements=numbers))
def test_inverse_tool_frame_leads_back(motion, turn, shift):
    tool = homogeneous(turn, shift)
    back = apply_tool_frame(apply_tool_frame(motion, tool), np.linalg.inv(tool))
    np.testing.assert_allclose(back.positions, motion.positions, atol=1e-12)
    assert angle_between(back, motion).max() < 1e-12
    np.testing.assert_allclose(back.linear_velocities, motion.linear_velocities, atol=1e-9)


@given(turn=turns(), shift=arrays(float, 3, elements=numbers), sign=st.sampled_from([-1, 1]))
def test_three_spellings_of_a_tool_frame(turn, shift, sign):
    matrix = homogeneous(turn, shift)
    seven = np.concatenate([shift, sign * turn.as_quat(scalar_first=True)])
    np.testing.assert_allclose(tool_frame_matrix(seven), matrix, atol=1e-12)
    np.testing.assert_allclose(tool_frame_matrix(matrix), matrix, atol=1e-12)
    np.testing.assert_array_equal(
        tool_frame_matrix(shift.tolist()), homogeneous(Rotation.identity(), shift)
    )


def test_tool_velocity_is_the_derivative_of_its_position():
    # Turning at constant rate about a moving point: the tool's path is known in closed form.
    times = np.linspace(1, 3, 400)
    rate, tip, drift = 2.5, np.array([0.052, 0, 0.013]), np.array([0.1, -0.2, 0.05])
    motion = PoseTrajectory(
        times=times,
        positions=np.outer(times, drift),
        rotations=Rotation.from_rotvec(np.outer(rate * times, [0, 0, 1])),
        linear_velocities=np.tile(drift, (400, 1)),
        angular_velocities=np.tile([0, 0, rate], (400, 1)),
    )
    around = (
        0.052 * rate * np.column_stack([-np.sin(rate * times), np.cos(rate * times), 0 * times])
    )
    blade = apply_tool_frame(motion, tip)
    np.testing.assert_allclose(blade.linear_velocities, drift + around, atol=1e-12)
    np.testing.assert_array_equal(blade.angular_velocities, motion.angular_velocities)


def test_tool_frame_rounded_to_four_digits_is_made_rigid():
    tool = homogeneous(Rotation.from_euler("xyz", [10, 20, 30], degrees=True), [0.1, 0, 0])
    matrix = tool_frame_matrix(np.round(tool, 4))
    np.testing.assert_allclose(matrix[:3, :3].T @ matrix[:3, :3], np.eye(3), atol=1e-14)
    np.testing.assert_allclose(matrix, tool, atol=2e-4)


def broken(change):
    matrix = np.eye(4)
    change(matrix)
    return matrix


@pytest.mark.parametrize(
    ("tool", "complaint"),
    [
        ([1, 2], r"shape \(2,\)"),
        (np.eye(3), r"shape \(3, 3\)"),
        ("blade", "not an array of numbers"),
        ([0, 0, np.nan], "not finite"),
        ([0, 0, 0, 0, 0, 0, 0], "length 0"),
        ([0, 0, 0, 1.01, 0, 0, 0], "length 1.01"),
        (2 * np.eye(4), "last row"),
        (broken(lambda m: m.__setitem__((0, 1), 0.1)), "not a rotation"),
        (broken(lambda m: m.__setitem__((2, 2), -1)), "right-handed"),
        (broken(lambda m: m.__setitem__((3, 0), 5.2)), "last row"),
    ],
)
def test_what_is_no_tool_frame_is_refused(tool, complaint):
    motion = random_motion(np.random.default_rng(1), 10, name="cut.csv")
    with pytest.raises(InputError, match=rf"^cut\.csv: tool_frame.*{complaint}") as error:
        apply_tool_frame(motion, tool)
    assert is_one_line(error)


# ---------------------------------------------------------------- trimming


@given(
    motion=motions(samples=100),
    start=st.none() | st.floats(2.5, 3.3),
    end=st.none() | st.floats(3.5, 4.5),
)
def test_trim_time_keeps_the_samples_between(motion, start, end):
    kept = trim_time(motion, start, end)
    inside = (motion.times >= (start or -np.inf)) & (motion.times <= (end or np.inf))
    np.testing.assert_array_equal(kept.times, motion.times[inside])
    np.testing.assert_array_equal(kept.positions, motion.positions[inside])
    np.testing.assert_array_equal(kept.angular_velocities, motion.angular_velocities[inside])
    assert kept.name == motion.name


@pytest.mark.parametrize(("start", "end"), [(5, None), (None, 1), (3.5, 3.4), (3.5, 3.55)])
def test_trim_time_refuses_to_leave_too_little(start, end):
    motion = random_motion(np.random.default_rng(1), 100, name="cut.csv")
    with pytest.raises(
        InputError, match=r"^cut\.csv: trim_time .*runs from 3 to 3\.825 s"
    ) as error:
        trim_time(motion, start, end)
    assert is_one_line(error)


def test_trim_time_refuses_nan():
    motion = random_motion(np.random.default_rng(1), 100)
    with pytest.raises(InputError, match="trim_time's end is not a number"):
        trim_time(motion, 3, np.nan)


def rest_motion_rest(times, begin, end, speed):
    """Positions along x: at rest, then at ``speed``, then at rest."""
    return np.outer(speed * np.clip(times - begin, 0, end - begin), [1.0, 0, 0])


@given(
    seed=st.integers(0, 2**32 - 1),
    rate=st.sampled_from([28.6, 60.0, 120.0, 500.0]),
    irregular=st.booleans(),
    begin=st.floats(0.5, 1.0),
    start=st.sampled_from([0.0, 17.3, 1.7e9]),
)
def test_trim_speed_finds_the_motion_under_sensor_noise(seed, rate, irregular, begin, start):
    rng = np.random.default_rng(seed)
    periods = rng.uniform(0.6, 1.4, int(3 * rate)) if irregular else np.ones(int(3 * rate))
    times = np.cumsum(periods) / rate
    positions = rest_motion_rest(times, begin, begin + 1, speed=0.04)
    # 0.05 mm at 120 Hz look like 8 mm/s from sample to sample, at 500 Hz like 35 mm/s.
    noise = 5e-5 * rng.standard_normal(positions.shape)
    kept = trim_speed(moving(positions + noise, start + times), 0.02)
    assert kept.times[0] - start == pytest.approx(begin, abs=0.02 + 2 / rate)
    assert kept.times[-1] - start == pytest.approx(begin + 1, abs=0.02 + 2 / rate)


def test_trim_speed_ignores_hand_tremor():
    times = np.arange(360) / RATE
    positions = rest_motion_rest(times, 1, 2, speed=0.03)
    tremor = 1.5e-4 * np.sin(2 * np.pi * 10 * times)  # up to 9 mm/s
    positions = positions + tremor[:, None] * [0, 1, 0]
    kept = trim_speed(moving(positions, times), 0.005)
    assert kept.times[0] == pytest.approx(1, abs=0.1)
    assert kept.times[-1] == pytest.approx(2, abs=0.1)


def test_trim_speed_keeps_rest_in_between():
    times = np.arange(600) / RATE
    positions = rest_motion_rest(times, 1, 2, 0.1) + rest_motion_rest(times, 3, 4, 0.1)
    kept = trim_speed(moving(positions, times), 0.05)
    np.testing.assert_allclose([kept.times[0], kept.times[-1]], [1, 4], atol=1 / RATE)


@given(samples=st.integers(MINIMUM_SAMPLES, 60), speed=st.floats(0.02, 1))
def test_trim_speed_keeps_a_motion_without_rest_whole(samples, speed):
    times = 5 + np.arange(samples) / RATE
    motion = moving(np.outer(times, [speed, 0, 0]), times)
    assert same(trim_speed(motion, 0.01), motion)


def test_trim_speed_names_the_top_speed_when_nothing_is_that_fast():
    times = np.arange(100) / RATE
    motion = moving(np.outer(times, [0.25, 0, 0]), times)
    with pytest.raises(
        InputError, match=r"^slide: .*trim_speed = 0\.3.*top speed is 0\.25"
    ) as error:
        trim_speed(motion, 0.3)
    assert is_one_line(error)


def test_trim_speed_refuses_to_leave_too_little():
    times = np.arange(40) / 10
    motion = moving(rest_motion_rest(times, 1, 1.5, 0.1), times)
    with pytest.raises(InputError, match=r"^slide: .*fewer than 8"):
        trim_speed(motion, 0.05)


@pytest.mark.parametrize("threshold", [0, -1, np.nan, np.inf])
def test_trim_speed_wants_a_positive_threshold(threshold):
    with pytest.raises(InputError, match="positive number of m/s"):
        trim_speed(random_motion(np.random.default_rng(1), 20), threshold)


# ---------------------------------------------------------------- low-pass filter


@given(motion=motions(samples=400), cutoff=st.floats(2, 40), order=st.integers(1, 5))
def test_positions_are_filtered_as_scipy_does(motion, cutoff, order):
    sections = butter(order, cutoff, fs=RATE, output="sos")
    expected = sosfiltfilt(sections, motion.positions, axis=0, padlen=len(motion) - 1)
    found = lowpass(motion, cutoff, order).positions
    # Only the lengths of the paddings differ, and only what outlasts them shows.
    np.testing.assert_allclose(found, expected, atol=1e-5)


@pytest.mark.parametrize("frequency", [0.5, 2.0, 4.8, 10.0, 20.0])
@pytest.mark.parametrize("order", [2, 3])
def test_frequency_response(frequency, order):
    times = np.arange(1200) / RATE
    wave = np.sin(2 * np.pi * frequency * times)
    motion = PoseTrajectory(
        times=times,
        positions=np.outer(wave, [1.0, 0, 0]),
        rotations=Rotation.from_rotvec(np.outer(0.5 * wave, [0, 1.0, 0])),
    )
    filtered = lowpass(motion, 4.8, order)
    # The bilinear transform bends the frequency axis; 1 / (1 + (f / fc)^2n) holds after it.
    bent = np.tan(np.pi * frequency / RATE) / np.tan(np.pi * 4.8 / RATE)
    kept = 1 / (1 + bent ** (2 * order))
    interior = slice(300, -300)
    np.testing.assert_allclose(filtered.positions[interior, 0], kept * wave[interior], atol=1e-4)
    turned = filtered.rotations.as_rotvec()[interior, 1]
    np.testing.assert_allclose(turned, 0.5 * kept * wave[interior], atol=1e-4)


@given(
    seed=st.integers(0, 2**32 - 1),
    samples=st.integers(10, 300),
    spin=st.floats(-60, 60),
    jitter=st.floats(0, 0.3),
)
def test_rotations_about_one_axis_are_filtered_as_their_angle(seed, samples, spin, jitter):
    rng = np.random.default_rng(seed)
    angles = spin * np.arange(samples) / RATE + jitter * rng.standard_normal(samples)
    motion = planar(angles)
    as_positions = moving(np.outer(angles, [1.0, 0, 0]), motion.times)
    expected = planar(lowpass(as_positions).positions[:, 0])
    assert angle_between(lowpass(motion), expected).max() < 1e-9


@given(motion=motions(samples=150), world=turns(), body=turns())
def test_rotation_filter_commutes_with_constant_rotations(motion, world, body):
    turned = turning(world * motion.rotations * body)
    filtered = lowpass(motion).rotations
    assert angle_between(lowpass(turned), turning(world * filtered * body)).max() < 1e-11


@given(motion=motions(samples=80), seed=st.integers(0, 2**32 - 1))
def test_signs_of_quaternions_do_not_matter(motion, seed):
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], size=(len(motion), 1))
    flipped = turning(Rotation.from_quat(signs * motion.rotations.as_quat()))
    assert angle_between(lowpass(flipped), lowpass(motion)).max() < 1e-12


@pytest.mark.parametrize("turns_made", [0.6, 10, 50])
def test_a_steady_spin_stays(turns_made):
    spin = planar(np.linspace(0, 2 * np.pi * turns_made, 600))
    assert angle_between(lowpass(spin), spin).max() < 1e-8 * turns_made


@pytest.mark.parametrize("turns_made", [0.6, 10])
@pytest.mark.parametrize("in_body", [False, True])
def test_tremor_across_a_spin_is_removed(turns_made, in_body):
    spin = planar(np.linspace(0, 2 * np.pi * turns_made, 600))
    wave = np.radians(1) * np.sin(2 * np.pi * 20 * spin.times)
    tremor = Rotation.from_rotvec(np.outer(wave, [1.0, 0, 0]))
    shaken = turning(spin.rotations * tremor if in_body else tremor * spin.rotations)
    left = angle_between(lowpass(shaken), spin)[INTERIOR]
    # What passes 4.8 Hz of a 20 Hz wave is 2e-4 of it; the spin moves it nearer in the body frame.
    assert left.max() < 2e-3 * np.radians(1)


def test_wild_rotation_noise_leaves_a_smooth_motion():
    rng = np.random.default_rng(3)
    times = np.arange(600) / RATE
    smooth = Rotation.from_rotvec(
        np.column_stack([1.5 * np.sin(2.5 * times), 2 * np.cos(1.9 * times), 3 * times])
    )
    noise = Rotation.from_rotvec(np.radians(5) * rng.standard_normal((600, 3)))
    filtered = lowpass(turning(noise * smooth))
    left = angle_between(filtered, turning(smooth))[INTERIOR]
    # White noise over 60 Hz, of which 4.8 Hz pass: sqrt(3 * 4.8 / 60) of 5 degrees is 2.4.
    assert np.sqrt(np.mean(left**2)) < np.radians(2.5)
    spectrum = np.abs(np.fft.rfft(filtered.angular_velocities[INTERIOR], axis=0))
    frequencies = np.fft.rfftfreq(450, 1 / RATE)
    assert spectrum[frequencies > 25].max() < 0.01 * spectrum.max()


@given(seed=st.integers(0, 2**32 - 1), samples=st.integers(2, 200), cutoff=st.floats(0.5, 40))
def test_ends_stay_where_they_are(seed, samples, cutoff):
    motion = random_motion(np.random.default_rng(seed), samples)
    filtered = lowpass(motion, cutoff)
    for end in (0, -1):
        np.testing.assert_allclose(filtered.positions[end], motion.positions[end], atol=1e-6)
        assert angle_between(filtered, motion)[end] < 1e-6


@given(samples=st.integers(2, 30), cutoff=st.floats(0.5, 59))
def test_a_short_straight_motion_is_left_alone(samples, cutoff):
    times = np.arange(samples) / RATE
    motion = PoseTrajectory(
        times=times,
        positions=np.outer(times, [1.0, -2, 0.5]),
        rotations=Rotation.from_rotvec(np.outer(times, [2.0, 0, 1])),
    )
    filtered = lowpass(motion, cutoff)
    np.testing.assert_allclose(filtered.positions, motion.positions, atol=1e-7)
    assert angle_between(filtered, motion).max() < 1e-7


def test_filtered_velocities_are_of_the_filtered_motion():
    filtered = lowpass(random_motion(np.random.default_rng(5), 300))
    anew = PoseTrajectory(
        times=filtered.times,
        positions=filtered.positions,
        rotations=filtered.rotations,
        name=filtered.name,
    )
    assert same(filtered, anew)


def test_lowpass_refuses_samples_that_are_not_uniform():
    times = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, 50)) / 28
    motion = moving(np.zeros((50, 3)), times)
    with pytest.raises(
        InputError, match=r"^slide: lowpass needs uniform.*resample first$"
    ) as error:
        lowpass(motion)
    assert is_one_line(error)


@pytest.mark.parametrize("cutoff", [0, -3, 60, 61, np.nan])
def test_lowpass_refuses_a_cutoff_out_of_range(cutoff):
    motion = random_motion(np.random.default_rng(1), 20)
    with pytest.raises(InputError, match=r"^motion: lowpass cutoff .* 60 Hz, half the sampling"):
        lowpass(motion, cutoff)


@pytest.mark.parametrize("order", [0, -1, 1.5, np.nan])
def test_lowpass_refuses_an_order_that_is_none(order):
    with pytest.raises(InputError, match="order"):
        lowpass(random_motion(np.random.default_rng(1), 20), order=order)


# ---------------------------------------------------------------- origin, and all of it


@given(motion=motions(samples=20))
def test_relative_to_start_moves_the_motion_to_the_origin(motion):
    moved = relative_to_start(motion)
    np.testing.assert_array_equal(moved.positions[0], 0)
    np.testing.assert_allclose(
        np.diff(moved.positions, axis=0), np.diff(motion.positions, axis=0), atol=1e-15
    )
    np.testing.assert_array_equal(moved.linear_velocities, motion.linear_velocities)
    np.testing.assert_array_equal(moved.rotations.as_quat(), motion.rotations.as_quat())


TOOL = (0.052, 0, 0.013)
STEPS = {
    "tool_frame": (TOOL, lambda m: apply_tool_frame(m, TOOL)),
    "trim_time": ((3.2, None), lambda m: trim_time(m, 3.2)),
    "trim_speed": (0.3, lambda m: trim_speed(m, 0.3)),
    "rate": (100.0, lambda m: m.resampled(rate=100)),
    "lowpass": (True, lambda m: lowpass(m, 4.8, 3)),
    "relative": (True, relative_to_start),
}
"""Argument of prepare -> what is given, and the same done by hand; in the documented order."""


@given(asked=st.sets(st.sampled_from(sorted(STEPS))), motion=motions(samples=200))
def test_prepare_composes_its_steps_in_the_papers_order(asked, motion):
    expected = motion
    for name, (_, by_hand) in STEPS.items():
        if name in asked:
            expected = by_hand(expected)
    given = {name: STEPS[name][0] for name in asked}
    assert same(prepare(motion, **given, order="paper"), expected)


def test_prepare_lists_its_arguments_in_the_order_of_the_steps():
    assert list(inspect.signature(prepare).parameters)[1:] == [*STEPS, "order"]


@given(motion=motions(samples=200), rate=st.sampled_from([None, 100.0]))
def test_trimming_cuts_the_same_out_of_a_filtered_recording(motion, rate):
    """The filter sees what lies outside; the same samples are left as in the paper's order."""
    trims = {"trim_time": (3.2, None), "trim_speed": 0.3}
    found = prepare(motion, **trims, rate=rate, lowpass=True)
    paper = prepare(motion, **trims, rate=rate, lowpass=True, order="paper")
    np.testing.assert_allclose(found.times, paper.times, rtol=0, atol=1e-12)
    if rate is None:
        whole = lowpass(motion, 4.8)
        kept = np.searchsorted(whole.times, found.times[[0, -1]])
        assert same(found, whole[kept[0] : kept[1] + 1])
    untrimmed = prepare(motion, rate=rate, lowpass=True)
    assert same(untrimmed, prepare(motion, rate=rate, lowpass=True, order="paper"))


def test_an_order_is_one_of_two():
    with pytest.raises(InputError, match="order is one of filter, paper; got 'trim'"):
        prepare(random_motion(np.random.default_rng(1), 20), order="trim")


def test_prepare_takes_a_cutoff_and_false():
    motion = random_motion(np.random.default_rng(1), 200)
    assert same(prepare(motion, lowpass=10), lowpass(motion, 10))
    assert same(prepare(motion, lowpass=False), motion)
    assert PAPER_CUTOFF == 4.8
    with pytest.raises(InputError, match="cutoff"):
        prepare(motion, lowpass=0)


def test_prepare_resamples_irregular_samples_at_their_median_rate_before_filtering():
    rng = np.random.default_rng(1)
    times = 40 + np.cumsum(rng.uniform(0.9, 1.1, 200)) / 28
    motion = moving(np.outer(times, [0.1, 0, 0]), times)
    expected = lowpass(motion.resampled(rate=1 / motion.period))
    assert same(prepare(motion, lowpass=True), expected)


@pytest.mark.parametrize("pair", [3.0, (1, 2, 3)])
def test_prepare_wants_a_pair_to_trim_by_time(pair):
    with pytest.raises(InputError, match=r"^motion: trim_time must be a pair"):
        prepare(random_motion(np.random.default_rng(1), 20), trim_time=pair)


def test_steps_leave_their_argument_alone():
    motion = random_motion(np.random.default_rng(2), 200)
    before = random_motion(np.random.default_rng(2), 200)
    prepare(motion, **{name: given for name, (given, _) in STEPS.items()})
    assert same(motion, before)


# ---------------------------------------------------------------- real recordings


CONTOUR_RUNS = [f"data_demo_{placement}_{run}.csv" for placement in "abcd" for run in (1, 2)]


def contour_run(recordings, file):
    """A recording at an irregular 28.6 Hz, and which of its samples are marked as moving."""
    table = np.genfromtxt(recordings / "contour_following" / file, delimiter=",", names=True)
    columns = np.column_stack([table[name] for name in table.dtype.names])
    motion = PoseTrajectory(
        times=columns[:, 0],
        positions=columns[:, 1:4],
        rotations=Rotation.from_quat(columns[:, 4:8], scalar_first=True),
        name=file,
    )
    return motion, table["moving"] > 0


@pytest.mark.recordings
@pytest.mark.parametrize("file", CONTOUR_RUNS)
def test_recorded_motion_is_cut_out_where_it_is_marked(recordings, file):
    motion, marked = contour_run(recordings, file)
    kept = trim_speed(motion, 0.05)
    inside = (motion.times >= kept.times[0]) & (motion.times <= kept.times[-1])
    # The marks are per sample and flicker at rest; the tool's way decides.
    assert np.mean(inside == marked) > 0.85
    assert kept.path_length > 0.95 * motion.path_length


@pytest.mark.recordings
@pytest.mark.parametrize("file", CONTOUR_RUNS)
def test_recorded_motion_is_smoothed_without_being_moved(recordings, file):
    motion, _ = contour_run(recordings, file)
    smooth = prepare(motion, lowpass=True)
    rough = motion.resampled(times=smooth.times)
    assert smooth.is_uniform
    assert np.linalg.norm(smooth.positions - rough.positions, axis=1).max() < 2e-3
    assert angle_between(smooth, rough).max() < np.radians(0.5)
    assert np.abs(np.diff(smooth.angular_velocities, axis=0)).max() < (
        np.abs(np.diff(rough.angular_velocities, axis=0)).max()
    )
