"""A small cut of the benchmark of distributions."""

from __future__ import annotations

import warnings

import pytest

import noslip as ns
from benchmarks import distributions
from noslip.distribution import estimation, learn_distribution
from noslip.errors import NoslipWarning


@pytest.mark.slow
def test_demo_excisions_are_likelier_than_to_promp_and_sampled_on_the_constraint(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("movement_primitives")
    monkeypatch.setattr(distributions, "PEER_WEIGHTS", (10,))
    monkeypatch.setattr(estimation, "CHOICES", {"weights": (16, 24), "shrinkage": (0.5, 0.7)})
    shown = distributions.excisions(4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NoslipWarning)
        found = next(distributions.likelihoods(shown, ns.Blade()))
        learned = learn_distribution(ns.learn(shown, ns.Blade()), shown)
        cost = distributions.sampling(learned, 16, 1, exact=1)
    assert found.ours > max(found.theirs, found.hindsight)
    assert cost.residual <= 1e-10
    assert max(cost.via, cost.via_turn) <= 1e-8
    assert cost.end <= 1e-4
    assert cost.apart < 1e-2
