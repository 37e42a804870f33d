"""The paper's method: its authors' code, where there is a copy, and our writing of it.

Their code is at github.com/straizys/nonholonomic-dmp.  It has no license, so nothing of it is here:
``--authors FOLDER`` names a clone.  It is run as its notebook runs it.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks import paper_method
from benchmarks.example import ALPHA, BASIS_FUNCTIONS, BETA
from benchmarks.side_by_side.job import Job, Row, judged
from noslip import PoseTrajectory

AUTHORS, WRITING = "the authors' code", "the paper's method, our writing"
NAMES = (AUTHORS, WRITING)
MODULES = ("utils", "nonholonomic_dmps")
ABSENT = "a clone of github.com/straizys/nonholonomic-dmp, as --authors FOLDER"


@dataclass(frozen=True, eq=False)
class Authors:
    """A clone of their repository, at any of its commits.

    Attributes
    ----------
    folder : Path
    """

    folder: Path

    @property
    def missing(self) -> str:
        """Return why it cannot be run."""
        absent = [name for name in MODULES if not (self.folder / f"{name}.py").is_file()]
        if absent:
            return f"{self.folder} has no {' and no '.join(f'{name}.py' for name in absent)}"
        try:
            self._load()
        except ImportError as error:
            return f"{self.folder}: {error}"
        return ""

    def _load(self) -> Any:
        """Import their modules by their own names, which are common ones, and leave none behind."""
        before = {name: sys.modules.pop(name, None) for name in MODULES}
        sys.path.insert(0, str(self.folder))
        try:
            return importlib.import_module(MODULES[-1])
        finally:
            sys.path.remove(str(self.folder))
            for name, module in before.items():
                sys.modules.pop(name, None)
                if module is not None:
                    sys.modules[name] = module

    def motion(self, job: Job, *, optimized: bool = True) -> PoseTrajectory:
        """Fit and roll out; without optimization the regular primitives alone.

        The code draws axes of a plane at random, from NumPy's global generator: a matter of
        rounding, which its optimizations magnify to a thousandth.
        """
        given = job.given
        np.random.seed(0)  # noqa: NPY002
        code = self._load().NonholonomicDMP(
            N_bf=BASIS_FUNCTIONS, alphaz=ALPHA, betaz=BETA, dt=job.time_step
        )
        code.imitate(np.hstack([given.positions, given.rotations.as_quat()]))
        code.xT = job.goal
        positions, _, _, quaternions, *_ = code.rollout(con=optimized, optim=optimized)
        return PoseTrajectory(given.times, positions, Rotation.from_quat(quaternions))


def rows(job: Job, folders: Sequence[Path]) -> Iterator[Row]:
    """Both, once each: the authors' takes minutes."""
    if not folders:
        yield Row(AUTHORS, "", "", job.name, skipped=ABSENT)
    for folder in folders:
        authors = Authors(folder)
        if reason := authors.missing:
            yield Row(AUTHORS, folder.name, "", job.name, skipped=reason)
            continue
        move = partial(authors.motion, job)
        yield judged(AUTHORS, folder.name, "BFGS at each step", job, move)

    def written() -> PoseTrajectory:
        primitives = paper_method.UncoupledPrimitives.fit(job.given, BASIS_FUNCTIONS)
        return paper_method.rollout(primitives, goal_position=job.goal).motion

    yield judged(WRITING, "", "BFGS at each step", job, written)
