"""noslip's controller as it is exported: C, compiled for this machine, behind a few functions."""

from __future__ import annotations

import ctypes
import tempfile
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.feedback import loop, tasks
from benchmarks.feedback.generators import Controlled
from benchmarks.feedback.poses import Floats, Pose
from benchmarks.feedback.tasks import Task
from benchmarks.feedback.trial import NAMED, Trial, conditions_of
from noslip.codegen.library import built

SOURCES = ("noslip.c", "plan.c", "replan.c", "controller.c", "primitive.c")
SETTINGS = ("follows", "replans", "real_time", "units", "knots", "lag", "faster", "braking")
"""Of those of the C struct, in the order in which the bridge takes them; NaN: the usual."""
TOLD = 24
BRIDGE = r"""
#include "primitive.h"
#include "controller.h"
#include <math.h>
#include <string.h>

int bridge_size(void) { return (int)sizeof(noslip_controller); }

int bridge_start(noslip_controller *c, double time_step, const double *settings, int begin) {
    noslip_state from;
    noslip_controller_init(c, &primitive, time_step);
    if (!isnan(settings[0])) c->follows = (int)settings[0];
    if (!isnan(settings[1])) c->replans = (int)settings[1];
    if (!isnan(settings[2])) c->real_time = (int)settings[2];
    if (!isnan(settings[3])) c->units = (int)settings[3];
    if (!isnan(settings[4])) c->knots = (int)settings[4];
    if (!isnan(settings[5])) c->lag = settings[5];
    if (!isnan(settings[6])) c->faster = settings[6];
    if (!isnan(settings[7])) c->braking = settings[7];
    if (begin == 0) return noslip_controller_start(c, 0);
    noslip_start(&primitive, &from);
    for (; begin > 0; --begin) noslip_step(&primitive, &from, time_step);
    return noslip_controller_start(c, &from);
}

int bridge_step(noslip_controller *c, double elapsed, const double *measured,
                const double *position, const double *quaternion, double *told) {
    const int refused = noslip_controller_step(c, elapsed, measured, position, quaternion);
    memcpy(told, c->state.position, 3 * sizeof(double));
    memcpy(told + 3, c->state.quaternion, 4 * sizeof(double));
    memcpy(told + 7, c->twist, 6 * sizeof(double));
    told[13] = c->speed;
    told[14] = c->mode;
    told[15] = noslip_controller_reason(c);
    told[16] = c->plans;
    told[17] = c->failures;
    told[18] = noslip_controller_done(c);
    told[19] = c->state.time;
    told[20] = noslip_controller_lag_and_bias(c, told + 21);
    return refused;
}

void bridge_head_for(noslip_controller *c, double speed, double within) {
    if (speed > 0) noslip_controller_resume(c, within);
    else noslip_controller_pause(c, within);
}
"""
MODES = ("track", "yield", "hold", "fault")
REASONS = ("", "fault", "blocked", "silent", "held", "no plan", "paused", "waits")


def compiled(dmp: Any) -> Any:
    """Machine code of a primitive's controller."""
    with tempfile.TemporaryDirectory() as scratch:
        dmp.export_c(scratch)
        texts = {path.name: path.read_text() for path in Path(scratch).glob("*.[ch]")}
    wanted = {file: text for file, text in texts.items() if file.endswith(".h") or file in SOURCES}
    code = ctypes.CDLL(str(built("controller", {**wanted, "bridge.c": BRIDGE})))
    pointer, number = ctypes.c_void_p, ctypes.c_double
    code.bridge_start.argtypes = [pointer, number, pointer, ctypes.c_int]
    code.bridge_step.argtypes = [pointer, number, *[pointer] * 4]
    code.bridge_head_for.argtypes = [pointer, number, number]
    return code


class Exported:
    """The exported controller of a primitive.

    Parameters
    ----------
    code : CDLL
        See :func:`compiled`.
    period : float
        Of the loop (s).
    begin : int
        Steps of the primitive, after which it takes over.
    settings : float
        See :data:`SETTINGS`.

    Attributes
    ----------
    told : array, shape (24,)
        Pose, twist, speed of the clock, mode, reason, plans, failures, done, time, lag, bias.
    """

    def __init__(self, code: Any, period: float, *, begin: int = 0, **settings: float) -> None:
        # Numbers, for their alignment.
        self._controller, self._code = np.zeros(-(-code.bridge_size() // 8)), code
        self._address = self._controller.ctypes.data
        self.told, self._given = np.zeros(TOLD), np.zeros((3, 7))
        chosen = np.array([settings.pop(name, np.nan) for name in SETTINGS], dtype=float)
        if settings:
            raise TypeError(f"not settings: {', '.join(settings)}")
        if code.bridge_start(self._address, period, chosen.ctypes.data, begin):
            raise RuntimeError("the controller did not start")

    @property
    def mode(self) -> str:
        """As that in Python."""
        return MODES[int(self.told[14])]

    @property
    def reason(self) -> str:
        """In a word."""
        return REASONS[int(self.told[15])]

    @property
    def plans(self) -> int:
        """Those that were found."""
        return int(self.told[16])

    @property
    def done(self) -> bool:
        """See :class:`noslip.Controller`."""
        return bool(self.told[18])

    def step(
        self,
        elapsed: float,
        measured: Floats | None = None,
        position: Floats | None = None,
        quaternion: Floats | None = None,
    ) -> Floats:
        """Return the next pose, shape (7,); of what is given None is nothing."""
        places = []
        for row, given in zip(self._given, (measured, position, quaternion), strict=True):
            if given is None:
                places.append(None)
            else:
                row[: len(given)] = given
                places.append(row.ctypes.data)
        if self._code.bridge_step(self._address, elapsed, *places, self.told.ctypes.data):
            raise ValueError("refused")
        return self.told[:7].copy()

    def head_for(self, speed: float, within: float = -1.0) -> None:
        """Pause (0) or resume (1), within some seconds; less than 0 is as fast as may be."""
        self._code.bridge_head_for(self._address, speed, within)


@lru_cache
def _compiled(task: Task) -> Any:
    return compiled(task.dmp)


class InC(Controlled):
    """The exported controller in the bench; ``follows`` says that the robot is compliant."""

    def __init__(self, task: Task, period: float, *, follows: bool = False) -> None:
        self.controller = Exported(_compiled(task), period, follows=follows)

    @property
    def plans(self) -> int:
        """Those that were found."""
        return self.controller.plans

    def step(self, elapsed: float, measured: Pose | None, goal: Floats | None) -> Pose:
        """See :class:`benchmarks.feedback.generators.Generator`."""
        seen = None if measured is None else np.concatenate(measured)
        pose = self.controller.step(elapsed, seen, goal)
        return Pose(pose[:3], pose[3:])


def difference(trial: Trial) -> float:
    """How far what both command differs (m, and of quaternions); inf where plans or ends differ."""
    scenario, task, period = NAMED[trial.scenario], tasks.task(trial.task), 1 / trial.rate
    conditions = conditions_of(scenario, task, trial.rate, trial.seed)
    python, c = (
        loop.run(
            task,
            partial(make, task, period, follows=scenario.follows),
            period,
            conditions,
            trial.seed,
        )
        for make in (Controlled, InC)
    )
    alike = (python.plans, python.failure) == (c.plans, c.failure)
    same = (np.array_equal(python.done, c.done), np.array_equal(python.led, c.led))
    if not (alike and all(same)):
        return np.inf
    return float(np.abs(python.commanded - c.commanded).max())
