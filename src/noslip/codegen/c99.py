"""C99 code of a step function: its expression graph, with phase, forces and attractor around."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np

from noslip.errors import InputError
from noslip.law import clock
from noslip.law.layout import Field, Layout, layouts
from noslip.law.step import step_function
from noslip.space import POSE, Space

_CONSTANT = re.compile(r"(?<![\w.])(\d+\.\d*(?:e[-+]?\d+)?)")
_CONDITION = re.compile(r"\((\w+)\?")
_NEGATED = re.compile(r"\(!(\w+)\)")
_BOTH = re.compile(r"\((\w+)(&&|\|\|)(\w+)\)")
_INPUT = re.compile(r"arg\[(\d)\]\? arg\[\d\]\[(\d+)\] : 0")
_OUTPUT = re.compile(r"if \(res\[(\d)\]!=0\) res\[\d\]\[(\d+)\]=")
_CALL = re.compile(r"if \(casadi_f(\d+)\(([^,]*), ([^,]*), iw, ([^,]*), 0\)\) return 1;")
_LOOK_UP = re.compile(
    r"  arg\[\d+\]=w\+(\d+);\n  res\[\d+\]=w\+(\d+);\n((?:  w\[\d+\] = \w+;\n)+)"
    r"  if \(casadi_f(\d+)\(arg\+\d+, res\+\d+, iw, w\+\d+, 0\)\) return 1;"
)
"""Of a graph of expressions: the call of a function that looks something up."""
_BODY = re.compile(
    r"^/\* (\w+):.*\nstatic int casadi_f(\d+)\(.*\{\n((?:.*\n)*?)  return 0;\n\}", re.MULTILINE
)
"""Name, number and statements of a function."""
_HELPER = re.compile(r"^casadi_real casadi_\w+\(.*\) \{(?:.*\}|\n(?:.*\n)*?\})$", re.MULTILINE)
_STEPS = "LONGEST_STEP LATEST"
MOST_CELLS = 2**18
"""Of a grid that is looked up in C: one MiB, and a second to write."""
_COMMENT_COLUMN = 40
"""Where comments begin in a struct, so that they stand under each other."""


def template(name: str) -> str:
    """Text of a file in the folder ``c``."""
    return (files("noslip.codegen") / "c" / name).read_text(encoding="utf-8")


def header(equalities: int, limits: int, bound: str = "", space: Space = POSE) -> str:
    """``noslip.h`` for so many rows of equalities and limits, in a space."""
    text, places = template("noslip.h"), layouts(space)
    rows = equalities + limits
    for name, value in {
        "LINEAR": str(space.linear),
        "ROTATIONS": str(space.rotations),
        "WEIGHTS": _weights_text(space),
        "EQUALITIES": str(equalities),
        "LIMITS": str(limits),
        "ROWS": str(max(1, rows)),
        "PRIMITIVE": declared(places.primitive),
        "STATE": declared(places.memory_fields(rows)),
    }.items():
        text = text.replace(f"@{name}@", value)
    return text.replace("\n@BOUND@ */", f"{bound} */")


def _weights_text(space: Space) -> str:
    if space.is_pose:
        return "Rows of weights: x, y, z (m), then the rotation vector (rad)."
    both = zip(space.coordinates, space.units, strict=True)
    names = ", ".join(f"{name} ({unit})" for name, unit in both)
    turns = ", then rotation vectors (rad)" if space.rotations else ""
    return textwrap.fill(f"Rows of weights: {names}{turns}.", 90).replace("\n", "\n * ")


def source(function: ca.Function, rows: int, *, parts: bool = True, space: Space = POSE) -> str:
    """``noslip.c`` around a step function.

    Parameters
    ----------
    function : casadi.Function
        (carried, row of the step table) -> (carried, outputs); expressions alone.
    rows : int
        Of constraints.
    parts : bool
        Whether it returns all outputs, each row's own force too; else up to the multipliers.
    space : Space
        That it steps in.
    """
    table = layouts(space)
    layout = table.output(rows)
    outputs = layout.size if parts else layout["multipliers"].stop
    placed = {
        "STATE": table.carried(rows),
        "STEP": table.step,
        "BEGINNING": table.beginning,
        "DRIVE": table.drive,
        "OUTPUT": layout,
    }
    places = "\n".join(
        [*(offsets(name, each) for name, each in placed.items()), *defined({clock: _STEPS})]
    )
    text = template("noslip.c").replace("@OUTPUTS@", str(outputs)).replace("@OFFSETS@", places)
    free = Plain({"free": step_function(None, 0, space=space)}, *_STEPPING)
    return text + "\n" + core(function, outputs, free)


def declared(fields: Sequence[Field]) -> str:
    """Declarations of a struct's fields."""
    lines = []
    for field in fields:
        if field.shape and not field.size:
            continue
        shape = "".join(f"[{size}]" for size in field.shape)
        text = {
            "int": f"int {field.name};",
            "real": f"noslip_real {field.name}{shape};",
            "array": f"const noslip_real (*{field.name}){shape};"
            if shape
            else f"const noslip_real *{field.name};",
        }[field.kind]
        comment = f"/* {field.comment} */" if field.comment else ""
        lines.append(f"    {text:<{_COMMENT_COLUMN}}{comment}".rstrip())
    return "\n".join(lines)


def defined(constants: Mapping[ModuleType, str]) -> Iterator[str]:
    """Definitions of modules' constants, by the same names without what marks them as private."""
    for module, names in constants.items():
        for name in names.split():
            value = getattr(module, name)
            text = repr(float(value)) if isinstance(value, float) else str(value)
            yield f"#define {name.removeprefix('_')} {text}"


def offsets(prefix: str, layout: Layout) -> str:
    """Definitions of where each part of a row of numbers begins, and of its size."""
    places = {name: layout.index(name) for name in layout} | {"size": layout.size}
    return "\n".join(f"#define {prefix}_{name.upper()} {at}" for name, at in places.items())


def core(function: ca.Function, outputs: int, *others: Plain) -> str:
    """A step's expression graphs in C; ``noslip_core``, of plain arrays, is the step.

    Parameters
    ----------
    function : casadi.Function
        As for :func:`source`.
    outputs : int
        How many of its outputs are wanted.
    others : Plain
        What stands beside it.
    """
    alone = function.is_a("SXFunction")
    parts = [function] if alone else [function.find_function(name) for name in ("short", "whole")]
    for index, part in enumerate(parts):
        if outputs != part.numel_out(1):
            state, step = (ca.SX.sym(name, part.numel_in(i)) for i, name in enumerate("st"))
            after, output, *more = part(state, step)
            found = [after, output[:outputs], *more]
            parts[index] = ca.Function(part.name(), [state, step], ca.cse(found))
    if alone:
        return plain(Plain({"core": parts[0]}, *_STEPPING), *others)
    helpers, _ = _generated([*parts, *(f for each in others for f in each.functions.values())])
    _, text = _generated(parts)
    look_ups = looked_up(*parts)
    texts = [helpers, *_look_ups(look_ups), _screened(text, look_ups, *parts)]
    texts += [line for each in others for line in each.lines()]
    return "\n".join(texts).replace("casadi_", "noslip_")


def looked_up(*functions: ca.Function) -> dict[str, ca.Function]:
    """What graphs call to look something up in a grid, by name.

    See :meth:`noslip.constraints.DistanceField.expression`.
    """
    called = (each for function in functions for each in function.find_functions())
    return {each.name(): each for each in called if each.name().startswith("grid_")}


def grids(*functions: ca.Function) -> dict[str, str]:
    """``grids.c``, the numbers that graphs look up; nothing if they look up none.

    Raises
    ------
    InputError
        If a grid is too large for C.
    """
    lines = ["/* Grids that constraints look up, such as distances to obstacles. */"]
    for name, function in sorted(looked_up(*functions).items()):
        count = _require_small(function)
        cells = (
            np.array(function.find_function("cells").map(count)(np.arange(count)[None]))
            .ravel()
            .tolist()
        )
        lines.append(f"extern const float noslip_{name}[{len(cells)}];")
        lines.append(f"const float noslip_{name}[{len(cells)}] = {{")
        rows = (cells[k : k + 8] for k in range(0, len(cells), 8))
        lines += ["    " + ", ".join(f"{value:#.9g}f" for value in row) + "," for row in rows]
        lines.append("};")
    return {"grids.c": "\n".join([*lines, ""])} if len(lines) > 1 else {}


def _require_small(look_up: ca.Function) -> int:
    """How many numbers a function looks up, if C holds them."""
    places = look_up.find_function("places")
    # Beyond its end the last one is nearest.
    count = int(np.array(places([1e12] * places.numel_in(0))[0]).max()) + 1
    if count > MOST_CELLS:
        raise InputError(
            f"a field of {count:,} cells is too large for C, at most {MOST_CELLS:,} are exported "
            "(1 MiB); take larger cells, or cut out the part that matters"
        )
    return count


def _look_ups(found: Mapping[str, ca.Function]) -> Iterator[str]:
    """Functions of C that look something up, of CasADi's names."""
    splines = set()
    for name, function in found.items():
        parts = {part.name(): part for part in function.find_functions()}
        places, spline, axes = parts["places"], parts["spline"], function.numel_in(0)
        yield from _plain({f"places_in_{name}": places}, ("at",), ("numbers", "u"))
        if axes not in splines:
            yield from _plain({f"spline_{axes}": spline}, ("near", "u"), ("found",))
        splines.add(axes)
        yield _filled("grid.c", NAME=name, NEAR=spline.numel_in(0), AXES=axes)


def _generated(functions: Iterable[ca.Function]) -> tuple[str, str]:
    """What the code of graphs calls, such as casadi_sq, and all that CasADi generates of them."""
    generator = ca.CodeGenerator("core", {"with_header": False, "casadi_int": "int"})
    for function in functions:
        for look_up in looked_up(function).values():
            # Of a large one, to write it takes longer than anyone waits.
            _require_small(look_up)
        generator.add(function)
    text = generator.dump()
    # It stands between the macros and the version.
    helpers = (f"static {helper}" for helper in _HELPER.findall(text.partition("/* Conf")[0]))
    told = "/* Generated by CasADi from the declaration of the constraints. */"
    return "\n".join([told, *helpers, ""]), text


@dataclass(frozen=True)
class Plain:
    """Expression graphs that call no others, as C functions of plain arrays.

    Attributes
    ----------
    functions : dict of casadi.Function
        By what they are called after ``noslip_``.
    inputs, outputs : tuple of str
        Names of the arrays; of inputs, a function with fewer takes the first ones.
    """

    functions: dict[str, ca.Function]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def lines(self) -> Iterator[str]:
        """Their code, of CasADi's names."""
        return _plain(self.functions, self.inputs, self.outputs)


_STEPPING = ("state", "step"), ("after", "output")


def plain(*several: Plain) -> str:
    """Code of expression graphs that call no others."""
    functions = [f for each in several for f in each.functions.values()]
    helpers, _ = _generated(functions)
    lines = (line for each in several for line in each.lines())
    found = looked_up(*functions)
    return "\n".join([helpers, *_look_ups(found), *lines]).replace("casadi_", "noslip_")


def _with_types(code: str) -> str:
    """Statements whose constants are of the type of all numbers, and whose conditions are told."""
    code = _CONSTANT.sub(r"REAL(\1)", code)
    code = _CONDITION.sub(r"(NOT_ZERO(\1)?", code)
    code = _NEGATED.sub(r"(!NOT_ZERO(\1))", code)
    return _BOTH.sub(r"(NOT_ZERO(\1)\2NOT_ZERO(\3))", code).rstrip()


def _plain(
    functions: dict[str, ca.Function], inputs: Sequence[str], outputs: Sequence[str]
) -> Iterator[str]:
    _, text = _generated(functions.values())
    bodies = _bodies(text, looked_up(*functions.values()))
    for (name, function), (_, _, body) in zip(functions.items(), bodies, strict=True):
        code = _INPUT.sub(lambda m: f"{inputs[int(m[1])]}[{m[2]}]", body)
        code = _OUTPUT.sub(lambda m: f"{outputs[int(m[1])]}[{m[2]}]=", code)
        given = [f"const noslip_real *{each}" for each in inputs[: function.n_in()]]
        found = [f"noslip_real *{each}" for each in outputs]
        head = f"static void noslip_{name}("
        between = ",\n" + " " * len(head)
        head += between.join([", ".join(given), ", ".join(found)]) + ") {"
        unused = [n for n in (*inputs[: function.n_in()], *outputs) if f"{n}[" not in code]
        yield head
        yield from (f"  (void){name};" for name in unused)
        if "w[" in code:
            yield f"  noslip_real w[{function.sz_w()}];"
        yield from (_with_types(code), "}", "")


def _bodies(text: str, look_ups: Mapping[str, ca.Function]) -> list[tuple[str, str, str]]:
    """Names, numbers and statements of functions, but of those that look something up."""
    found = _BODY.findall(text)
    names = {number: name for name, number, _ in found}
    called = (each for function in look_ups.values() for each in function.find_functions())
    hidden = {*look_ups, *(each.name() for each in called)}

    def look_up(call: re.Match[str]) -> str:
        if names[call[4]] not in look_ups:
            return call[0]
        return f"{call[3]}  noslip_look_up_{names[call[4]]}(w+{call[1]}, w+{call[2]});"

    return [
        (name, number, _LOOK_UP.sub(look_up, body))
        for name, number, body in found
        if name not in hidden
    ]


def _screened(
    text: str, look_ups: Mapping[str, ca.Function], short: ca.Function, whole: ca.Function
) -> str:
    """Graphs that call others; what decides and repeats is written by hand."""
    found, names = [], {}
    for name, number, body in _bodies(text, look_ups):
        names[number] = name
        if name in ("some", "none", "up_to"):
            continue
        if name.startswith("push_"):
            push, (_, kind, most) = whole.find_function(name), name.split("_")
            sizes = {"ARGUMENTS": push.sz_arg(), "RESULTS": push.sz_res(), "MOST": most}
            state = 5 * push.numel_in(1)
            found.append(_filled("push.c", **sizes, KIND=kind, STATE=state))
            continue
        code = _INPUT.sub(r"arg[\1][\2]", body)
        code = _CALL.sub(lambda m: f"noslip_{names[m[1]]}({m[2]}, {m[3]}, {m[4]});", code)
        found += [
            f"static void noslip_{name}(const noslip_real **arg, noslip_real **res,",
            "    noslip_real *w) {",
            "  (void)w;",
            _with_types(code),
            "}",
            "",
        ]
    both = short, whole
    sizes = {
        "ARGUMENTS": max(part.sz_arg() for part in both),
        "RESULTS": max(part.sz_res() for part in both),
        "WORK": max(1, *(part.sz_w() for part in both)),
    }
    return "\n".join([*found, _filled("screened.c", **sizes)])


def _filled(name: str, **values: Any) -> str:
    """A file in the folder ``c`` with its places filled in."""
    text = template(name)
    for key, value in values.items():
        text = text.replace(f"@{key}@", str(value))
    return text
