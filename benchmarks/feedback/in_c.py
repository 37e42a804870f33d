"""noslip's controller as it is exported: C, compiled for this machine, behind three functions."""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.feedback import tasks
from benchmarks.feedback.poses import Floats, Pose
from noslip.codegen.library import built

SOURCES = ("noslip.c", "plan.c", "replan.c", "controller.c", "primitive.c")
BRIDGE = r"""
#include "primitive.h"
#include "controller.h"
#include <string.h>

/* Numbers that the bridge tells of a cycle. */
#define TOLD 20

int bridge_size(void) { return (int)sizeof(noslip_controller); }

int bridge_start(noslip_controller *c, double time_step, int follows) {
    noslip_controller_init(c, &primitive, time_step);
    c->follows = follows;
    return noslip_controller_start(c, 0);
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
    told[19] = c->time;
    return refused;
}
"""
MODES = ("track", "yield", "hold", "fault")


@lru_cache
def bridge(name: str) -> Any:
    """Machine code of a task's controller."""
    with tempfile.TemporaryDirectory() as scratch:
        tasks.task(name).dmp.export_c(scratch)
        texts = {path.name: path.read_text() for path in Path(scratch).glob("*.[ch]")}
    wanted = {file: text for file, text in texts.items() if file.endswith(".h") or file in SOURCES}
    code = ctypes.CDLL(str(built("controller", {**wanted, "bridge.c": BRIDGE})))
    pointer, number = ctypes.c_void_p, ctypes.c_double
    code.bridge_start.argtypes = [pointer, number, ctypes.c_int]
    code.bridge_step.argtypes = [pointer, number, *[pointer] * 4]
    return code


class InC:
    """The exported controller; ``follows`` says that the robot is compliant.

    Attributes
    ----------
    told : array, shape (20,)
        Pose, twist, speed of the clock, mode, reason, plans, failures, done, time.
    """

    def __init__(self, task: tasks.Task, period: float, *, follows: bool = False) -> None:
        code = bridge(task.name)
        # Numbers, for their alignment.
        self._controller = np.zeros(-(-code.bridge_size() // 8))
        self._step: Callable[..., int] = code.bridge_step
        self._address = self._controller.ctypes.data
        self.told, self._measured, self._goal = np.zeros(20), np.zeros(7), np.zeros(3)
        if code.bridge_start(self._address, period, follows):
            raise RuntimeError("the controller did not start")

    @property
    def plans(self) -> int:
        """Those that were found."""
        return int(self.told[16])

    @property
    def done(self) -> bool:
        """See :class:`benchmarks.feedback.generators.Generator`."""
        return bool(self.told[18])

    @property
    def mode(self) -> str:
        """As that in Python."""
        return MODES[int(self.told[14])]

    @property
    def is_led(self) -> bool:
        """See :class:`benchmarks.feedback.generators.Generator`."""
        return self.mode == "yield"

    def step(self, elapsed: float, measured: Pose | None, goal: Floats | None) -> Pose:
        """See :class:`benchmarks.feedback.generators.Generator`."""
        seen = to = None
        if measured is not None:
            self._measured[:3], self._measured[3:] = measured.position, measured.quaternion
            seen = self._measured.ctypes.data
        if goal is not None:
            self._goal[:] = goal
            to = self._goal.ctypes.data
        if self._step(self._address, elapsed, seen, to, None, self.told.ctypes.data):
            raise RuntimeError("refused")
        return Pose(self.told[:3].copy(), self.told[3:7].copy())
