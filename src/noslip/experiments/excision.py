"""The paper's excision experiment (its section IV-B), on synthetic recordings.

The paper's own recordings are not public.  Eight recordings of a tracked scalpel are generated
(see :mod:`noslip.demonstrations.excision`) and go through the paper's whole preparation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from noslip.constraints.blade import Blade
from noslip.demonstrations.excision import RATE, TOOL_FRAME, synthetic_excisions
from noslip.demonstrations.preparation import PAPER_CUTOFF, prepare
from noslip.learning import learn
from noslip.merit import FiguresOfMerit, figures_of_merit
from noslip.primitive import ConstrainedDMP
from noslip.trajectory import PoseTrajectory

CONSTRAINT = Blade()
"""The scalpel's, as the paper has it."""
TRIM_SPEED = 0.005
"""Below it the scalpel waits (m/s): cuts exceed it at once, averaged tremor and noise never."""


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


def run_excisions(
    *, seed: int = 7, progress: Callable[[int, int], None] | None = None
) -> list[Excision]:
    """Prepare and learn eight synthetic excisions."""
    recordings = synthetic_excisions(seed=seed)
    excisions = []
    for index, recording in enumerate(recordings):
        excisions.append(Excision.run(recording))
        if progress is not None:
            progress(index + 1, len(recordings))
    return excisions
