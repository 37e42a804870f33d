"""``replan.h`` and ``replan.c`` for a rule: its graphs, and the constants that Python has, too."""

from __future__ import annotations

import casadi as ca
import numpy as np

from noslip import boundary, verification
from noslip.adapting import constants
from noslip.codegen import c99
from noslip.constraints.declaration import UNITS, Constraint, relative_function
from noslip.constraints.system import ConstraintSystem
from noslip.law import fitting, forcing, winding
from noslip.projection import feasibility, heading, nearest, newton, planner, problem, request
from noslip.projection import trajectory as projecting
from noslip.projection.stage import Stage
from noslip.rotations import rotation_matrix
from noslip.rule import Rule

_CONSTANTS = {
    constants: "DETOUR SETTLED LEAST_TIME FEWEST_LEFT FEWEST_SAMPLES OFF",
    boundary: "_AT_REST",
    fitting: "FEWEST_STEPS",
    forcing: "RIDGE",
    winding: "FARTHEST_FROM_GOAL FARTHEST_FROM_WINDING",
    heading: "REACH REST BACKWARDS PLUNGING SIDEWAYS _ROUNDED",
    problem: """
        _REST_WEIGHT _SLOPE _SLOW _TURNED_REFERENCE _RESIDUAL_TOLERANCE _LAST_BARRIER
        _LIMIT_TOLERANCE _APPROACH
        """,
    projecting: "_CLEARANCE _LIMIT_PATIENCE",
    nearest: "_LOST",
    feasibility: "_APPROACHING _APART",
    newton: "SMALL_TURN",
    verification: "MISSED MISSED_TURN BROKEN",
}
"""By the same names in C, without what marks them as a module's own."""
_DEPENDENT = 1e-13
"""Of the largest square of a row, below which what others leave of it is rounding."""


def sources(rule: Rule) -> dict[str, str]:
    """The planner's files for a rule: ``plan.h``, ``plan.c``, ``replan.h`` and ``replan.c``."""
    system = rule.system
    stage = Stage.of(system, hold_position=False)
    levels = system.equalities.row_levels + system.limits.row_levels
    units = system.equalities.row_units + system.limits.row_units
    priorities = [
        priority
        for part in (system.equalities, system.limits)
        for priority in part.per_row(c.priority for c in part.constraints)
    ]
    kinds = ("position", "velocity", "acceleration")
    lines = [
        *c99.defined(_CONSTANTS),
        f"#define STEPS_PER_FUNCTION {fitting.SAMPLES_PER_BASIS_FUNCTION}",
        f"#define MOST_PASSES {nearest._MOST_ITERATIONS}",
        f"#define ON_SURFACE {feasibility._ON!r}",
        f"#define MOST_ITERATIONS {request.MAX_ITERATIONS}",
        f"#define DEPENDENT {_DEPENDENT!r}",
        f"#define POSITION_WEIGHT {request.ADAPTING.position!r}",
        f"#define POSITION_SMOOTHING {request.ADAPTING.position_smoothing!r}",
        f"#define ROTATION_SMOOTHING {request.ADAPTING.rotation_smoothing!r}",
        *(f"#define {name.upper()} {k}" for k, name in enumerate(kinds)),
        f"#define MOST_PRIORITY {max(priorities, default=0) + 1}",
        f"#define ATTEMPTS {len(projecting._ATTEMPTS)}",
        f"#define LIMIT_ATTEMPTS {len(projecting._LIMIT_ATTEMPTS)}",
        "static const struct { double factor; int careful, patience; } attempts[] = {",
        *(f"    {{{f!r}, {int(c)}, {p}}}," for f, c, p in projecting._ATTEMPTS),
        "};",
        "static const struct { double factor, barrier; int careful; } limit_attempts[] = {",
        *(f"    {{{f!r}, {b!r}, {int(c)}}}," for f, b, c in projecting._LIMIT_ATTEMPTS),
        "};",
        _table("int", "row_levels", [kinds.index(level) for level in levels]),
        _table("int", "row_priorities", priorities),
        _table(
            "int",
            "row_has_clearance",
            [
                int(
                    k >= system.equalities.size and (level, unit) == ("position", UNITS["position"])
                )
                for k, (level, unit) in enumerate(zip(levels, units, strict=True))
            ],
        ),
        _table("double", "inverse_metric", np.broadcast_to(rule.inverse_metric, 6).tolist()),
        *_graphs(system),
    ]
    files = planner.sources(stage)
    files["replan.h"] = c99.template("replan.h")
    files["replan.c"] = c99.template("replan.c").replace("@GENERATED@", "\n".join(lines))
    return files


def _table(kind: str, name: str, values: list[int] | list[float]) -> str:
    # C knows no empty arrays.
    return f"static const {kind} {name}[] = {{{', '.join(map(repr, values or [0]))}}};"


def _graphs(system: ConstraintSystem) -> list[str]:
    """What the constraints ask of an instant; where their edge is, relative to the work."""
    functions = {}
    if system.equalities.size:
        functions["instant"] = system.equalities.owned("instant", system.equalities._instant)
    constraint = system.edged
    lines = []
    if constraint is None or constraint.edge is None or constraint.edge.lateral is None:
        lines.append("#define NOSLIP_HAS_EDGE 0")
    else:
        frame = constraint.edge.frame.ravel().tolist()
        lines += ["#define NOSLIP_HAS_EDGE 1", _table("double", "edge_frame", frame)]
        functions["edge"] = _edge(constraint)
    return [*lines, c99.plain(c99.Plain(functions, ("given",), ("found",))) if functions else ""]


def _edge(constraint: Constraint) -> ca.Function:
    """(time, position, quaternion) -> point of the edge and rotation of the tool, as seen."""
    assert constraint.edge is not None
    given = ca.SX.sym("given", 8)
    time, position, quaternion = given[0], given[1:4], given[4:8]
    rotation = rotation_matrix(quaternion)
    if relative := relative_function(constraint):
        still = ca.SX(3, 1)
        seen = relative(time, position, rotation, still, still)
        position, rotation = seen[:3], ca.reshape(seen[3:12], 3, 3)
    point = position + rotation @ ca.DM(np.array(constraint.edge.point))
    return ca.Function("edge", [given], [ca.densify(ca.vertcat(point, ca.vec(rotation)))])
