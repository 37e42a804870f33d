"""What is said of random jobs is so; and the judge notices what is not.

``make sweep`` tries 2000 of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.sweep import judge, rules, trial
from benchmarks.sweep.judge import Asked, Facts
from benchmarks.sweep.track import Track, angles, quaternion, rotation_vectors, times

FEW, MORE = range(5000, 5008), range(5012, 5016)


@pytest.mark.parametrize("seed", FEW)
def test_nothing_that_is_said_of_a_job_is_untrue(seed: int) -> None:
    assert not trial.of_seed(seed).contradictions


@pytest.mark.slow
@pytest.mark.parametrize("seed", MORE)
def test_nothing_that_is_said_of_more_jobs_is_untrue(seed: int) -> None:
    assert not trial.of_seed(seed).contradictions


# Far goals beside limits; via points; goals missed by steps of a controller; soft limits.
@pytest.mark.parametrize("seed", [31, 90, 145, 202])
def test_what_was_untrue_once_is_true(seed: int) -> None:
    assert not trial.of_seed(seed).contradictions


@pytest.mark.slow
@pytest.mark.parametrize("seed", [49, 74, 148, 2074])
def test_what_was_untrue_once_is_true_slowly(seed: int) -> None:
    assert not trial.of_seed(seed).contradictions


# -------------------------------------------------------------------- the judge


def slid(slip: float = 0.0, short: float = 0.0, samples: int = 201) -> Track:
    """A meter along x in a second, with some speed along y and some way not gone."""
    t = np.linspace(0, 1, samples)
    path = np.column_stack([(1 - short) * t, slip * t, 0 * t])
    return Track(t, path, np.tile([1.0, 0, 0, 0], (samples, 1)))


def facts(motion: Track, *held: rules.Rule) -> Facts:
    asked = Asked(held, np.array([1.0, 0, 0]), np.array([1.0, 0, 0, 0]), (), 1.0, True)
    return Facts(asked, (motion,), (slid(),), 0.0, is_learned=False)


def test_what_is_silent_and_right_is_left_alone() -> None:
    held = rules.blade(np.zeros(3)), rules.speed(1.1), rules.forward_only()
    assert not list(judge.silences(facts(slid(), *held), []))


def test_it_notices_what_was_not_said() -> None:
    (slipped,) = judge.silences(facts(slid(slip=1e-6), rules.blade(np.zeros(3))), [])
    assert "violates blade by 1e-06" in slipped
    (missed,) = judge.silences(facts(slid(short=0.01)), [])
    assert "misses its goal by 0.01 m" in missed
    (broken,) = judge.silences(facts(slid(), rules.speed(0.9)), [])
    assert "breaks speed-limit by 0.1" in broken
    (late,) = judge.silences(facts(replace(slid(), times=1.5 * slid().times)), [])
    assert "takes 1.5 s, not 1" in late


@pytest.mark.parametrize(
    ("sentence", "is_true"),
    [
        ("the motion ends 10 mm (0.01 of its path) from its goal; and so on", True),
        ("the motion ends 12 mm (0.01 of its path) from its goal; and so on", False),
        ("the motion ends 10 mm (0.02 of its path) from its goal; and so on", False),
        ("the motion ends 10 mm (0.01 of its path) and 3 degrees from its goal; so", False),
        ("the motion breaks speed-limit by 0.09 m/s; and so on", True),
        ("the motion breaks speed-limit by 0.19 m/s; and so on", False),
        ("the primitive ends 10 mm from where demonstrations do, which break box", True),
        ("the primitive ends 14 mm from where demonstrations do, which break box", False),
        ("the primitive starts 10 mm from where demonstrations do, which break box", False),
        ("the primitive ends facing away from 1 of 3, the most a, by 0 degrees; so", True),
        ("the primitive ends facing away from 1 of 3, the most a, by 120 degrees; so", False),
    ],
)
def test_it_holds_numbers_against_the_files(sentence: str, is_true: bool) -> None:
    found = facts(slid(short=0.01), rules.speed(0.9))
    assert [told for _, told, _ in judge.readings(found, [sentence])] == [is_true]


def test_it_does_not_pass_over_what_it_cannot_read() -> None:
    assert [kind for kind, *_ in judge.readings(facts(slid()), ["all is well"])] == ["unread"]


def test_a_number_agrees_but_for_its_rounding() -> None:
    assert judge.agrees("0.12", 0.1249) and not judge.agrees("0.12", 0.13)
    assert judge.agrees("2e-06", 2.4e-6) and not judge.agrees("2e-06", 3e-6)
    assert judge.agrees("1.23e+03", 1234.0)


def test_its_rotations_are_rotations() -> None:
    rng = np.random.default_rng(0)
    vectors = rng.normal(size=(50, 3))
    np.testing.assert_allclose(rotation_vectors(quaternion(vectors)), vectors, atol=1e-14)
    a, b = quaternion(rng.normal(size=(2, 50, 3)))
    np.testing.assert_allclose(angles(times(a, b), b), np.linalg.norm(rotation_vectors(a), axis=1))
