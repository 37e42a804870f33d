"""A small cut of the benchmark of distributions."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import noslip as ns
from benchmarks.distributions import coverage, excisions, likelihoods, sampling
from noslip.distribution import learn_distribution
from noslip.errors import NoslipWarning


@pytest.mark.slow
def test_demo_excisions_are_likelier_than_to_promp_and_cheap_to_sample() -> None:
    pytest.importorskip("movement_primitives")
    shown = excisions()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NoslipWarning)
        found = next(likelihoods(shown[:4], ns.Blade()))
        learned = learn_distribution(ns.learn(shown, ns.Blade()), shown)
        cost = sampling(learned, 16, 1, exact=1)
        shares = coverage(learned, 8, 1, 20)
    assert found.ours > max(found.theirs, found.hindsight)
    assert cost.residual <= 1e-10
    assert max(cost.via, cost.via_turn) <= 1e-8
    assert cost.end <= 1e-4
    assert cost.apart < 1e-2
    for level, each in shares.items():
        assert level - 0.1 < np.mean(each) <= 1
