"""``controller.h``, ``controller.c`` of a primitive: Python's constants, the observer's graphs."""

from __future__ import annotations

from noslip.adapting import REPLANNED_SAMPLES
from noslip.adapting.constants import MOST_SAMPLES
from noslip.codegen import c99
from noslip.control import clock, controller, goal_filter, observer, planning
from noslip.law import clock as phase
from noslip.law.law import Law
from noslip.rule import Rule
from noslip.runtime.rollout import initial_state

_CONSTANTS = {
    phase: "DONE",
    clock: "HASTE AT_REST PLAN_AT_REST _LEAST_TURN _LEAST_TURN_CHANGE _LEAST_SPEED",
    goal_filter: "SMOOTH CONFIRM HELD _AVERAGED",
    observer: "LAG_STD KNOWN_LAG_STD LONGEST_LAG",
    planning: "SMOOTHER",
    controller: """
        TOLERANCE ANGLE_TOLERANCE BIAS ANGLE_BIAS FASTER PLAN_WITHIN FARTHEST MADE_GOOD
        HALTED SILENT SILENT_GAPS PERSIST ACCEPT CALM CALM_GAPS FOLLOW DEAREST NO_TOOL
        _SMALLEST FOLLOW_HASTE FUNNEL GOAL_TOLERANCE GOAL_ANGLE_TOLERANCE GOAL_JUMP
        GOAL_ANGLE_JUMP GOAL_SLOW BETWEEN_PLANS AFTER_FAILURE HASTY MOST_SLOWED _DETOUR
        _MORE _LEAST_TIME _MOST_TIME PATIENCE _LOOK_EVERY _LEAST_RUN _STANDING DRIFT_FUNNEL
        LATE LATE_WIDER
        """,
}


def sources(law: Law, rule: Rule) -> dict[str, str]:
    """The controller's files for a primitive."""
    reachable = planning.reachable(rule, initial_state(law, rule))
    rows = ", ".join("{" + ", ".join(map(repr, row)) + "}" for row in reachable.tolist())
    lines = [
        *c99.defined(_CONSTANTS),
        f"#define RUNS_IN_PLAN_TIME {int(clock.runs_in_plan_time(rule.system))}",
        c99.offsets("SEEN", observer.SEEN),
        "/* What rules do not forbid for good of a displacement. */",
        f"static const double reachable[3][3] = {{{rows}}};",
        "",
        c99.plain(observer.plain()),
    ]
    values = {
        "FUNCTIONS": law.basis.count,
        "KNOTS": REPLANNED_SAMPLES,
        "STEPS": MOST_SAMPLES - 1,
        "CELLS": clock.CELLS,
        "SEEN": observer.SEEN.size,
    }
    header = c99.template("controller.h")
    for name, value in values.items():
        header = header.replace(f"@{name}@", str(value))
    code = c99.template("controller.c").replace("@GENERATED@", "\n".join(lines))
    return {"controller.h": header, "controller.c": code}
