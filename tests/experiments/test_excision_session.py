"""A session of excisions, cut by ``segment``: what is said of the cuts, against the true ones."""

from __future__ import annotations

import numpy as np
import pytest

from noslip.demonstrations.excision import TOOL_FRAME, synthetic_session
from noslip.demonstrations.preparation import prepare
from noslip.demonstrations.segmentation import segment
from noslip.experiments.excision import REST, Session


@pytest.fixture(scope="module")
def given():
    made = synthetic_session(seed=3, count=3)
    blade = prepare(made.recording, tool_frame=TOOL_FRAME, lowpass=True)
    return made.recording, blade, made.cuts


def cut_at(given, times):
    recording, blade, cuts = given
    return Session(recording, segment(blade, times=times), cuts, [])


def test_ends_that_are_right_are_told_to_be(given):
    _, blade, cuts = given
    session = cut_at(given, cuts)
    assert list(session.found) == [0, 1, 2]
    # The samples inside of a cut are less than a period away from its ends.
    assert 0 <= session.late.min() <= session.late.max() <= blade.period
    assert session.missed.max() < 1e-4


def test_ends_that_are_wrong_are_told_by_how_much(given):
    _, blade, cuts = given
    early, late = 0.1, 0.8
    session = cut_at(given, [(start - early, end - late) for start, end in cuts])
    np.testing.assert_allclose(session.late, [[-early, late]] * 3, atol=1.01 * blade.period)
    for (_, end), (_, missed) in zip(cuts, session.missed, strict=True):
        here, there = blade.resampled(times=[end - late, end]).positions
        assert missed == pytest.approx(np.linalg.norm(there - here), rel=0.15)


def test_cuts_that_are_missed_and_pieces_that_are_none_are_not_counted(given):
    _, blade, cuts = given
    before_the_first = (blade.times[0], cuts[0, 0] - 0.1)
    session = cut_at(given, [before_the_first, cuts[2]])
    assert list(session.found) == [2]
    assert session.late.shape == session.missed.shape == (1, 2)
    nothing = cut_at(given, [before_the_first])
    assert not nothing.found
    assert nothing.late.shape == nothing.missed.shape == (0, 2)


def test_what_is_learned_of_a_piece_has_the_rest_around_it(monkeypatch):
    """The filter must see it; no primitive is learned here."""
    stretches = []
    monkeypatch.setattr("noslip.experiments.excision.Excision.run", stretches.append)
    told = []
    session = Session.run(seed=11, progress=lambda *done: told.append(done))
    assert told == [(k, 8) for k in range(1, 9)]
    assert len(session.found) == 8
    period = session.recording.period
    for stretch, piece in zip(stretches, session.segments.pieces, strict=True):
        around = (piece.times - stretch.times[0])[0], (stretch.times - piece.times[-1])[-1]
        np.testing.assert_allclose(around, REST, atol=1.01 * period)
        inside = np.isin(session.recording.times, stretch.times)
        np.testing.assert_array_equal(session.recording.positions[inside], stretch.positions)
