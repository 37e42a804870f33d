"""Laws, rules and spreads as plain data, and documents of them: JSON with a version and a checksum.

Every float is written such that it is read back the same.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from shlex import quote
from typing import Any, TypeVar, get_args, get_type_hints

import numpy as np

from noslip import _arguments
from noslip._files import write_beside
from noslip._pose_checks import MAX_NORM_ERROR
from noslip._typing import Floats
from noslip._version import __version__
from noslip.chain import Chain
from noslip.constraints.catalog import restore, specification
from noslip.constraints.declaration import MOST_COORDINATES
from noslip.constraints.system import ConstraintSystem
from noslip.errors import InputError, NoslipError
from noslip.law.attractor import Attractor
from noslip.law.basis import Basis
from noslip.law.channels import Channels
from noslip.law.clock import Clock, Cycle, Phase
from noslip.law.forcing import ForcingTerm
from noslip.law.law import Law
from noslip.law.points import Goal
from noslip.law.winding import Winding
from noslip.projection.pointwise import Push
from noslip.recordings.formats import is_recording
from noslip.rule import Rule
from noslip.space import POSE, Carried, Placed, Space
from noslip.spread import Spread

T = TypeVar("T")

FORMAT = "noslip-primitive"
"""What a document says it is, so that any other JSON is refused by name."""
VERSION = 2
"""Grows whenever a document would be read wrongly by the version before."""

MOST_BYTES = 2**25
"""Of a JSON file: ten times what the largest primitive takes, and read in a gigabyte."""
MOST_DEEP = 8
"""Lists in lists, of options: twice as many as any takes."""
SHORTEST = 1e-9
"""Of a duration (s): below, velocities overflow."""


def write_document(path: str | Path, content: dict[str, Any]) -> Path:
    """Write content as a document."""
    document = {
        "format": FORMAT,
        "version": VERSION,
        "noslip": __version__,
        "checksum": _checksum(content),
        "content": content,
    }
    return write_beside(path, (json.dumps(document, indent=1) + "\n").encode())


def read_json(path: Path, kind: str) -> Any:
    """Read what a file of some kind holds, or say why that cannot be."""
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise InputError(f"{path}: not {kind} (more than {MOST_BYTES:,} bytes)")
        return json.loads(content)
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not {kind} (not JSON: {error})") from error


def read_document(path: str | Path) -> dict[str, Any]:
    """Read the content of a document.

    Raises
    ------
    InputError
        If the file is missing, is not a noslip primitive, is of another version, or was changed
        since; the message names the file and the field.
    """
    path = Path(path)
    try:
        document = read_json(path, "a noslip primitive")
    except InputError:
        if is_recording(path):
            raise InputError(
                f"{path}: a recording, not a primitive; learn one from it first: noslip learn "
                f"{quote(str(path))} --out {quote(path.stem)}.json"
            ) from None
        raise
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(f"{path}: not a noslip primitive (no format {FORMAT!r})")
    version = document.get("version")
    if version != VERSION:
        older = isinstance(version, int) and version < VERSION
        raise InputError(
            f"{path}: field version is {version!r}, this noslip reads {VERSION}; "
            + ("learn the primitive again" if older else "update noslip")
        )
    content = document.get("content")
    if not isinstance(content, dict) or document.get("checksum") != _checksum(content):
        raise InputError(
            f"{path}: changed or damaged since it was saved (field checksum does not match); "
            "save it again from noslip"
        )
    return content


def law_to_data(law: Law) -> dict[str, Any]:
    """Return plain data from which :meth:`Reader.law` makes the same law again."""
    return {
        "attractor": asdict(law.attractor),
        **_clock_to_data(law.clock),
        "basis_functions": law.basis.count,
        "weights": law.forcing.weights.tolist(),
        "start": law.start.tolist(),
        "start_velocity": law.start_velocity.tolist(),
        "goal_position": law.goal.position.tolist(),
        **_windings_to_data(law.goal.windings),
        **({} if law.space.is_pose else {"space": space_to_data(law.space)}),
        "duration": law.duration,
        "steps": law.steps,
        "begin": law.begin,
    }


def _windings_to_data(windings: Sequence[Winding]) -> dict[str, Any]:
    several = [winding.quaternions.tolist() for winding in windings]
    return {"winding": several[0]} if len(several) == 1 else {"windings": several}


def space_to_data(space: Space) -> dict[str, Any]:
    """Return plain data from which :meth:`Reader.space` makes an equal space again."""
    bodies = []
    for body in space.bodies:
        if isinstance(body, Placed):
            bodies.append({"name": body.name, "first": body.first, "turn": body.turn})
        else:
            assert isinstance(body, Carried) and isinstance(body.kinematics, Chain)
            bodies.append({"name": body.name, "chain": body.kinematics.as_data()})
    return {
        "coordinates": list(space.coordinates),
        "units": list(space.units),
        "rotations": space.rotations,
        "bodies": bodies,
    }


def rule_to_data(rule: Rule) -> dict[str, Any]:
    """Return plain data from which :meth:`Reader.rule` makes the same rule again."""
    return {
        "constraints": [specification(constraint) for constraint in rule.system.constraints],
        "inverse_metric": list(rule.inverse_metric),
        "push": rule.push,
        "stabilization": rule.stabilization,
        "barrier_rate": rule.barrier_rate,
    }


def _clock_to_data(clock: Clock) -> dict[str, Any]:
    return {"cyclic": True} if clock.returns else {"alpha_s": clock.alpha_s}


def channels_to_data(channels: Channels) -> dict[str, Any]:
    """Return plain data from which :meth:`Reader.channels` makes the same channels again."""
    return {
        **_clock_to_data(channels.basis.phase),
        "basis_functions": channels.basis.count,
        "trend": channels.trend.tolist(),
        "weights": channels.weights.tolist(),
        "least": channels.least.tolist(),
        "most": channels.most.tolist(),
        "names": list(channels.names),
        "units": list(channels.units),
        "begin": channels.begin,
    }


def spread_to_data(spread: Spread) -> dict[str, Any]:
    """Return plain data from which :meth:`Reader.spread` makes the same spread again."""
    return {
        "demonstrations": spread.demonstrations,
        "positions": spread.positions.tolist(),
        "rotations": spread.rotations.tolist(),
    }


def _checksum(content: dict[str, Any]) -> str:
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return "sha256:" + hashlib.sha256(canonical.encode()).hexdigest()


def _brief(error: Exception) -> str:
    """Return what an error says, but not all of what a file holds."""
    text = str(error)
    return text if len(text) <= 500 else f"{text[:500]}..."


class Reader:
    """Takes fields out of a document, each by what it must be; an error names file and field.

    All that a file may say is read through here: kinds, finite numbers, bounds, sizes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def field(self, data: dict[str, Any], name: str, kind: Callable[[Any], T]) -> T:
        try:
            return kind(data[name])
        except KeyError:
            raise InputError(f"{self.path}: field {name} is missing") from None
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.path}: field {name} is wrong: {_brief(error)}") from error

    def part(self, data: dict[str, Any], name: str) -> dict[str, Any]:
        return self.field(data, name, partial(_instance, dict, "an object"))

    def parts(self, data: dict[str, Any], name: str) -> list[dict[str, Any]]:
        return self.field(data, name, partial(_each, partial(_instance, dict, "objects")))

    def number(
        self,
        data: dict[str, Any],
        name: str,
        check: Callable[[str, Any], float] = _arguments.positive,
    ) -> float:
        return self.field(data, name, partial(check, name))

    def values(self, kind: type[T], data: dict[str, Any]) -> T:
        """Read a dataclass of texts, whole and other numbers that are not negative."""
        kinds: dict[Any, Callable[[str, Any], Any]] = {
            str: lambda _, value: text(value),
            int: lambda _, value: _whole(value),
            float: _arguments.not_negative,
            tuple[str, ...]: lambda _, value: tuple(_each(text, value)),
        }
        hints = get_type_hints(kind)
        return kind(**{name: self.number(data, name, kinds[hint]) for name, hint in hints.items()})

    def count(self, data: dict[str, Any], name: str) -> int:
        most = _arguments.MOST_SAMPLES
        return self.field(data, name, partial(_arguments.count, name, most=most))

    def array(self, data: dict[str, Any], name: str, shape: tuple[int | None, ...]) -> Floats:
        value = self.field(data, name, lambda x: _arguments.numbers(name, x))
        matches = len(shape) == value.ndim and all(
            want in (None, have) for want, have in zip(shape, value.shape, strict=True)
        )
        if not matches or not np.all(np.abs(value) <= _arguments.LARGEST):
            raise InputError(
                f"{self.path}: field {name} has shape {value.shape} and numbers up to "
                f"{np.abs(value).max(initial=0.0):.3g}, expected {shape} and finite ones up to "
                f"{_arguments.LARGEST:g}"
            )
        return value

    def texts(self, data: dict[str, Any], name: str) -> tuple[str, ...]:
        return self.field(data, name, lambda value: tuple(_each(text, value)))

    def unit_quaternions(
        self, data: dict[str, Any], name: str, shape: tuple[int | None, ...], first: int = 0
    ) -> Floats:
        """Read an array whose last axis holds unit quaternions from a place on."""
        value = self.array(data, name, shape)
        parts = value[..., first:]
        if value.size and not parts.size:
            return value
        norms = np.linalg.norm(parts.reshape(*parts.shape[:-1], -1, 4), axis=-1)
        if not (value.size and np.all(np.abs(norms - 1) <= MAX_NORM_ERROR)):
            farthest = norms.flat[np.argmax(np.abs(norms - 1))] if value.size else 0.0
            raise InputError(
                f"{self.path}: field {name} holds a quaternion of norm {farthest:.6g}; norms must "
                f"be 1 to within {MAX_NORM_ERROR:g}"
            )
        return value

    def law(self, content: dict[str, Any], name: str) -> Law:
        data = self.part(content, name)
        constants = self.part(data, "attractor")
        attractor = Attractor(self.number(constants, "alpha"), self.number(constants, "beta"))
        count, space = self.count(data, "basis_functions"), self.space(data)
        n, basis = space.linear, self._basis(data, count)
        size = space.velocity_size
        return Law(
            attractor,
            ForcingTerm(basis, self.array(data, "weights", (count, size))),
            self.unit_quaternions(data, "start", (space.point_size,), n),
            self.array(data, "start_velocity", (size,)),
            Goal(
                self.array(data, "goal_position", (n,)),
                *self._windings(data, space, basis.phase.returns),
            ),
            self.number(data, "duration", _duration),
            self.count(data, "steps"),
            float(self.array(data, "begin", ())),
            space,
        )

    def _basis(self, data: dict[str, Any], count: int) -> Basis:
        is_cycle = data.get("cyclic") is True
        return Basis(count, Cycle() if is_cycle else Phase(self.number(data, "alpha_s")))

    def _windings(self, data: dict[str, Any], space: Space, cyclic: bool) -> list[Winding]:
        if space.rotations == 1:
            return [Winding(self.unit_quaternions(data, "winding", (None, 4)), cyclic)]
        several = self.field(data, "windings", partial(_each, lambda knots: {"winding": knots}))
        if len(several) != space.rotations:
            raise InputError(
                f"{self.path}: field windings has {len(several)}, expected {space.rotations}"
            )
        knots = (self.unit_quaternions(one, "winding", (None, 4)) for one in several)
        return [Winding(each, cyclic) for each in knots]

    def space(self, data: dict[str, Any]) -> Space:
        """Read what a law moves in; a pose, if nothing is said."""
        if "space" not in data:
            return POSE
        part = self.part(data, "space")
        names, units = (
            self.field(part, name, lambda value: tuple(_each(text, value)))
            for name in ("coordinates", "units")
        )
        rotations = self.field(part, "rotations", _whole)
        bodies = tuple(self._body(body) for body in self.parts(part, "bodies"))
        fits = all(
            isinstance(body, Carried)
            or (body.first + 3 <= len(names) and (body.turn is None or body.turn < rotations))
            for body in bodies
        )
        carried = [body.kinematics.size for body in bodies if isinstance(body, Carried)]
        if len(names) > MOST_COORDINATES or rotations > MOST_COORDINATES or not fits:
            raise InputError(f"{self.path}: field space: bodies are not of its coordinates")
        if any(size != len(names) for size in carried):
            raise InputError(f"{self.path}: field space: a chain has other joints than coordinates")
        return self.field(data, "space", lambda _: Space(names, units, rotations, bodies))

    def _body(self, data: dict[str, Any]) -> Any:
        name = self.field(data, "name", text)
        if "chain" in data:
            return Carried(self.field(data, "chain", Chain.from_data), name)
        turn = self.field(data, "turn", lambda value: None if value is None else _whole(value))
        return Placed(name, self.field(data, "first", _whole), turn)

    def system(self, data: dict[str, Any], space: Space = POSE) -> ConstraintSystem:
        entries = self.parts(data, "constraints")
        try:
            return ConstraintSystem(map(restore, entries), space)
        except NoslipError as error:
            raise InputError(f"{self.path}: field constraints: {_brief(error)}") from error
        except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
            reason = f"{type(error).__name__}: {_brief(error)}"
            raise InputError(f"{self.path}: field constraints is wrong: {reason}") from error

    def rule(self, content: dict[str, Any], space: Space = POSE) -> Rule:
        data, size = self.part(content, "rule"), space.velocity_size
        return Rule(
            self.system(data, space),
            self.field(data, "inverse_metric", partial(_arguments.inverse_metric, size=size)),
            self.field(data, "push", partial(one_of, Push)),
            self.number(data, "stabilization", _arguments.not_negative),
            self.number(data, "barrier_rate"),
        )

    def spread(self, content: dict[str, Any], space: Space = POSE) -> Spread | None:
        if self.field(content, "spread", lambda x: x) is None:
            return None
        part = self.part(content, "spread")
        sizes = {"positions": space.linear, "rotations": space.angular}
        # Nothing turns in vectors: empty rows have lost their second dimension in JSON.
        positions, rotations = (
            self.array(part, name, (None, size, size))
            if size
            else self.array(part, name, (None, 0))[:, :, None][:, :, :0]
            for name, size in sizes.items()
        )
        # Its own errors are values that are wrong; here they get the file and the field.
        return self.field(
            content,
            "spread",
            lambda _: Spread(self.count(part, "demonstrations"), positions, rotations),
        )

    def channels(self, content: dict[str, Any]) -> Channels | None:
        """Read what follows the phase; None if nothing does."""
        if "channels" not in content:
            return None
        part = self.part(content, "channels")
        names, units = (
            self.field(part, name, lambda value: tuple(_each(text, value)))
            for name in ("names", "units")
        )
        count, k = self.count(part, "basis_functions"), len(names)
        basis = self._basis(part, count)
        trend, weights = self.array(part, "trend", (2, k)), self.array(part, "weights", (count, k))
        least, most = (self.array(part, name, (k,)) for name in ("least", "most"))
        begin = self.number(part, "begin", _arguments.not_negative)
        return self.field(
            content,
            "channels",
            lambda _: Channels(basis, trend, weights, least, most, names, units, begin),
        )


def one_of(words: Any, value: Any) -> Any:
    """Return a value that is one of a Literal's words."""
    if not isinstance(value, str) or value not in get_args(words):
        raise ValueError(
            f"one of {', '.join(get_args(words))} was expected, got {_arguments.short(value)}"
        )
    return value


def text(value: Any) -> str:
    """Return a text that can be printed on a line."""
    if not isinstance(value, str) or not value.isprintable():
        raise ValueError(f"a text that can be printed was expected, got {_arguments.short(value)}")
    return value


def plain(value: Any, deep: int = 0) -> Any:
    """Return what options are made of: texts, numbers, truth values, none, lists and objects."""
    if deep > MOST_DEEP:
        raise ValueError(f"it is nested more than {MOST_DEEP} deep")
    if isinstance(value, dict):
        return {text(name): plain(part, deep + 1) for name, part in value.items()}
    if isinstance(value, list):
        return [plain(part, deep + 1) for part in value]
    return text(value) if isinstance(value, str) else value


def _each(kind: Callable[[Any], T], value: Any) -> list[T]:
    return list(map(kind, _instance(list, "a list", value)))


def _instance(kind: type[T], wanted: str, value: Any) -> T:
    if not isinstance(value, kind):
        raise ValueError(f"expected {wanted}, got {_arguments.short(value)}")
    return value


def _whole(value: Any) -> int:
    if type(value) is not int or not 0 <= value <= _arguments.MOST_SAMPLES:
        raise ValueError(f"expected a whole number, 0 or more, got {_arguments.short(value)}")
    return value


def _duration(name: str, value: Any) -> float:
    return _arguments.between(name, value, SHORTEST, _arguments.LARGEST)
