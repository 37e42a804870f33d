"""The paper's excision experiment (its section IV-B), on synthetic recordings.

The paper's own recordings are not public.  One recording of a tracked scalpel is generated that
holds eight cuts and the ways between them (see :mod:`noslip.demonstrations.excision`).  It is cut
by :func:`noslip.segment`, as the paper's was by hand, and each cut goes through the paper's whole
preparation.  When the blade truly moved is known here, and compared with what was found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from noslip._typing import Floats
from noslip.constraints.blade import Blade
from noslip.demonstrations.excision import RATE, TOOL_FRAME, synthetic_session
from noslip.demonstrations.preparation import PAPER_CUTOFF, prepare, trim_time
from noslip.demonstrations.segmentation import Interval, Segments, segment
from noslip.learning import learn
from noslip.merit import FiguresOfMerit, figures_of_merit
from noslip.primitive import ConstrainedDMP
from noslip.trajectory import PoseTrajectory

CONSTRAINT = Blade()
"""The scalpel's, as the paper has it."""
TRIM_SPEED = 0.005
"""Below it the scalpel waits (m/s): cuts exceed it at once, averaged tremor and noise never."""
REST = 0.3
"""Seconds kept before and after each piece of a session, for the filter to see the rest there."""


@dataclass(frozen=True, eq=False)
class Excision:
    """One excision: what the sensor recorded, the demonstration made of it, the primitive."""

    recording: PoseTrajectory
    demonstration: PoseTrajectory
    primitive: ConstrainedDMP

    @classmethod
    def run(cls, recording: PoseTrajectory) -> Excision:
        """Prepare a sensor recording by the paper's steps, and learn from it."""
        demonstration = prepare(
            recording,
            tool_frame=TOOL_FRAME,
            trim_speed=TRIM_SPEED,
            rate=RATE,
            lowpass=PAPER_CUTOFF,
            relative=True,
        )
        learned = learn(demonstration, [CONSTRAINT], project_start="velocity")
        return cls(recording, demonstration, learned)

    @cached_property
    def trained(self) -> PoseTrajectory:
        """The primitive's motion."""
        return self.primitive.rollout()

    @cached_property
    def merit(self) -> FiguresOfMerit:
        """The primitive's motion against the demonstration."""
        return figures_of_merit(self.trained, self.demonstration, [CONSTRAINT])


@dataclass(frozen=True, eq=False)
class Session:
    """A session of excisions: how it was cut, when the blade truly moved, what was learned.

    Attributes
    ----------
    recording : PoseTrajectory
        What the sensor recorded.
    segments : Segments
        The blade's motion, low-passed, and its pieces.
    cuts : array, shape (n, 2)
        True start and end of each cut (s), on the recording's clock.
    excisions : list of Excision
        One of each piece.
    """

    recording: PoseTrajectory
    segments: Segments
    cuts: Floats
    excisions: list[Excision]

    @classmethod
    def run(cls, *, seed: int = 7, progress: Callable[[int, int], None] | None = None) -> Session:
        """Generate a session of eight cuts, cut it at its rests, prepare and learn each piece.

        Parameters
        ----------
        seed : int
            Not negative.
        progress : callable, optional
            Told after each excision how many of how many are learned.
        """
        session = synthetic_session(seed=seed)
        recording = session.recording
        segments = segment(prepare(recording, tool_frame=TOOL_FRAME, lowpass=PAPER_CUTOFF))
        excisions = []
        for done, piece in enumerate(segments.pieces, start=1):
            start, end = piece.times[[0, -1]]
            stretch = trim_time(recording, start - REST, end + REST)
            excisions.append(Excision.run(replace(stretch, name=f"{recording.name}, cut {done}")))
            if progress is not None:
                progress(done, len(segments.pieces))
        return cls(recording, segments, session.cuts, excisions)

    @cached_property
    def found(self) -> dict[int, Interval]:
        """The piece that holds the middle of a cut, by the cut's number, counted from 0."""
        kept = [interval for interval in self.segments.intervals if interval.reason is None]
        return {
            number: piece
            for number, middle in enumerate(self.cuts.mean(axis=1))
            for piece in kept
            if piece.start <= middle <= piece.end
        }

    @cached_property
    def late(self) -> Floats:
        """How far within each cut that was found its piece starts and ends (s), shape (m, 2)."""
        inside = [
            (piece.start - self.cuts[number, 0], self.cuts[number, 1] - piece.end)
            for number, piece in self.found.items()
        ]
        return np.array(inside).reshape(-1, 2)

    @cached_property
    def missed(self) -> Floats:
        """How far the low-passed blade moves between the two (m), shape (m, 2)."""
        blade = self.segments.recording
        ends = np.array([(piece.start, piece.end) for piece in self.found.values()]).reshape(-1, 2)
        true = self.cuts[list(self.found)]
        here, there = (
            np.stack([np.interp(times, blade.times, axis) for axis in blade.positions.T], axis=-1)
            for times in (ends, true)
        )
        return np.asarray(np.linalg.norm(here - there, axis=-1))
