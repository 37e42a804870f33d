"""``shield.h`` and ``shield.c``: what Python runs, and what a robot gets."""

from __future__ import annotations

from noslip.codegen import c99
from noslip.control import observer
from noslip.law.layout import FORCE, STATE, STEP, Field, Layout, layouts
from noslip.rule import Rule
from noslip.runtime.stepper import stepper_of
from noslip.shielding.following import GIVEN, HEARD, SLOWEST, follow_function
from noslip.space import POSE

TOLERANCES = 2e-3, 0.04
"""m and rad, between command and tool, that are nobody's concern, besides lag, bias and noise."""
BIASES = 5e-3, 0.03
"""m and rad, standard deviations of what may stand between them for ever."""
NO_TOOL = 1e3
"""m: what is measured farther from the command is no tool."""
SMALLEST = 1e-12
"""Squared length of a quaternion that still is one; the largest is as large."""
_FOLLOWING = ("state", "heard", "given"), ("heard_after", "step")


def memory_fields(rows: int) -> tuple[Field, ...]:
    """``noslip_shield`` under so many constraint rows: all that a shield in a stream knows."""
    # C knows no empty arrays.
    rows = max(1, rows)
    comments = {
        "command": "the last one: x, y, z, qw, qx, qy, qz",
        "since": "s since it changed",
        "gap": "s between two changes, on average",
        "heard": "the same without jumps",
        "hand_position": "what is followed: smooth",
        "linear_peak": "of the hand's own speed, m/s",
        "angular_peak": "rad/s",
    }
    return (
        Field("time", comment="s"),
        *(Field(name, (STATE.width(name),)) for name in STATE),
        Field("values", (rows,), "residuals, then margins"),
        Field("acceleration", (FORCE.size,), "of the last step, m/s^2 and rad/s^2"),
        Field("force", (FORCE.size,), "the constraints' part of it"),
        Field("multipliers", (rows,)),
        *(
            Field(
                name, (HEARD.width(name),) if HEARD.width(name) > 1 else (), comments.get(name, "")
            )
            for name in HEARD
        ),
        Field("seen", (observer.SEEN.size,), "what is known of lag, bias and noise"),
    )


def memory_layout(rows: int) -> Layout:
    """``noslip_shield`` as a row of numbers."""
    return Layout(**{field.name: field.size for field in memory_fields(rows)})


def observer_of(period: float) -> observer.Observer:
    """What tells lag, bias and noise of the measured apart from a tool that is far."""
    return observer.Observer(TOLERANCES, BIASES, None, period)


def sources(rule: Rule, period: float) -> dict[str, str]:
    """C of a shield under a rule, for commands that come so many seconds apart."""
    system = rule.system
    rows = system.size
    outputs = layouts(POSE).output(rows)
    wanted = outputs["multipliers"].stop
    graphs = c99.Plain({"follow": follow_function(system, period)}, *_FOLLOWING)
    placed = {
        "STATE": layouts(POSE).carried(rows),
        "STEP": STEP,
        "OUTPUT": outputs,
        "HEARD": HEARD,
        "GIVEN": GIVEN,
        "SEEN": observer.SEEN,
        "SHIELD": memory_layout(rows),
    }
    generated = [
        *(c99.offsets(name, each) for name, each in placed.items()),
        f"#define OUTPUTS {wanted}",
        f"#define ALL_ROWS {rows}",
        f"#define NO_TOOL {NO_TOOL!r}",
        f"#define SMALLEST {SMALLEST!r}",
        f"#define LINEAR_PEAK {SLOWEST[0]!r}",
        f"#define ANGULAR_PEAK {SLOWEST[1]!r}",
        "",
        c99.core(stepper_of(rule).function, wanted, graphs, observer.plain()),
    ]
    header = c99.template("shield.h")
    for name, value in {
        "EQUALITIES": system.equalities.size,
        "LIMITS": system.limits.size,
        "ROWS": max(1, rows),
        "PERIOD": repr(period),
        "FIELDS": c99.declared(memory_fields(rows)).replace("noslip_real", "double"),
    }.items():
        header = header.replace(f"@{name}@", str(value))
    code = c99.template("shield.c").replace("@GENERATED@", "\n".join(generated))
    start = ", ".join(map(repr, observer_of(period).seen.tolist()))
    code = code.replace("@SEEN@", start)
    return {"shield.h": header, "shield.c": code, **c99.grids(stepper_of(rule).function)}
