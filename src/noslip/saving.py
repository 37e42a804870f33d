"""Primitives in files: JSON with a version and a checksum."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from noslip import _arguments
from noslip._files import write_beside
from noslip._typing import Floats
from noslip._version import __version__
from noslip.constraints.catalog import restore, specification
from noslip.errors import InputError, NoslipError
from noslip.learning import BARRIER_RATE, ConstrainedDMP, LearningRecord
from noslip.primitives.attractor import Attractor
from noslip.primitives.basis import Basis
from noslip.primitives.forcing import ForcingTerm
from noslip.primitives.orientation import OrientationDMP
from noslip.primitives.phase import Phase
from noslip.primitives.pose import PoseDMP
from noslip.primitives.position import PositionDMP
from noslip.primitives.winding import Winding
from noslip.spread import Spread

T = TypeVar("T")

FORMAT = "noslip-primitive"
VERSION = 1


def save_primitive(dmp: ConstrainedDMP, path: str | Path) -> Path:
    """Write a primitive as JSON; every float is written such that it is read back the same."""
    content = {
        "phase": {"alpha_s": dmp.phase.alpha_s},
        "attractor": asdict(dmp.position.attractor),
        "basis_functions": dmp.position.forcing.basis.count,
        "duration": dmp.duration,
        "steps": dmp.steps,
        "constraints": [specification(constraint) for constraint in dmp.constraints],
        "inverse_metric": list(dmp.inverse_metric),
        "stabilization": dmp.stabilization,
        "barrier_rate": dmp.barrier_rate,
        "primitive": _parts(dmp),
        "regular": _parts(dmp.regular),
        "begin": dmp.begin,
        "spread": None if dmp.spread is None else _spread(dmp.spread),
        "learned_from": [asdict(record) for record in dmp.record],
    }
    document = {
        "format": FORMAT,
        "version": VERSION,
        "noslip": __version__,
        "checksum": _checksum(content),
        "content": content,
    }
    return write_beside(path, (json.dumps(document, indent=1) + "\n").encode())


def load_primitive(path: str | Path) -> ConstrainedDMP:
    """Read a primitive that :meth:`ConstrainedDMP.save` wrote; its motion is the same to the bit.

    Raises
    ------
    InputError
        If the file is missing, is not a noslip primitive, was written by a later version, was
        changed since, or lacks a field; the message names the file and the field.
    """
    path = Path(path)
    try:
        document = json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not a noslip primitive (not JSON: {error})") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(f"{path}: not a noslip primitive (no format {FORMAT!r})")
    version = document.get("version")
    if version != VERSION:
        raise InputError(
            f"{path}: field version is {version!r}, this noslip reads {VERSION}; "
            "update noslip or learn the primitive again"
        )
    content = document.get("content")
    if not isinstance(content, dict) or document.get("checksum") != _checksum(content):
        raise InputError(
            f"{path}: changed or damaged since it was saved (field checksum does not match); "
            "save it again from noslip"
        )
    read = _Reader(path)
    phase = Phase(read.positive(read.part(content, "phase"), "alpha_s"))
    constants = read.part(content, "attractor")
    attractor = Attractor(read.positive(constants, "alpha"), read.positive(constants, "beta"))
    basis = Basis(read.count(content, "basis_functions"), phase)
    duration, steps = read.positive(content, "duration"), read.count(content, "steps")
    regular = PoseDMP(*read.parts(content, "regular", attractor, basis), phase, duration, steps)
    position, orientation = read.parts(content, "primitive", attractor, basis)
    try:
        constraints = tuple(restore(entry) for entry in content["constraints"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, NoslipError):
            raise InputError(f"{path}: field constraints: {error}") from error
        raise InputError(f"{path}: field constraints is incomplete: {error}") from error
    return ConstrainedDMP(
        position=position,
        orientation=orientation,
        phase=phase,
        duration=duration,
        steps=steps,
        constraints=constraints,
        regular=regular,
        inverse_metric=read.field(content, "inverse_metric", _arguments.inverse_metric),
        stabilization=read.field(
            content, "stabilization", lambda x: _arguments.not_negative("stabilization", x)
        ),
        # Files written before there were limits have none.
        barrier_rate=(
            read.positive(content, "barrier_rate") if "barrier_rate" in content else BARRIER_RATE
        ),
        begin=read.finite({"begin": 0.0} | content, "begin"),
        spread=read.spread(content),
        record=tuple(read.records(content)),
    )


def _parts(dmp: PoseDMP) -> dict[str, Any]:
    return {
        "position": {
            "weights": dmp.position.forcing.weights.tolist(),
            "start": dmp.position.start.tolist(),
            "goal": dmp.position.goal.tolist(),
            "start_velocity": dmp.position.start_velocity.tolist(),
        },
        "orientation": {
            "weights": dmp.orientation.forcing.weights.tolist(),
            "start": dmp.orientation.start_quaternion.tolist(),
            "winding": dmp.orientation.winding.quaternions.tolist(),
            "start_velocity": dmp.orientation.start_velocity.tolist(),
        },
    }


def _spread(spread: Spread) -> dict[str, Any]:
    return {
        "demonstrations": spread.demonstrations,
        "positions": spread.positions.tolist(),
        "rotations": spread.rotations.tolist(),
    }


def _checksum(content: dict[str, Any]) -> str:
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return "sha256:" + hashlib.sha256(canonical.encode()).hexdigest()


def _list_of_parts(value: Any) -> list[dict[str, Any]]:
    if not isinstance(value, list) or not all(isinstance(entry, dict) for entry in value):
        raise TypeError("expected a list of objects")
    return value


class _Reader:
    """Takes fields out of a document; an error names the file and the field."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def field(self, data: dict[str, Any], name: str, kind: Callable[[Any], T]) -> T:
        try:
            return kind(data[name])
        except KeyError:
            raise InputError(f"{self.path}: field {name} is missing") from None
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.path}: field {name} is wrong: {error}") from error

    def part(self, data: dict[str, Any], name: str) -> dict[str, Any]:
        return self.field(data, name, dict)

    def positive(self, data: dict[str, Any], name: str) -> float:
        return self.field(data, name, lambda value: _arguments.positive(name, value))

    def finite(self, data: dict[str, Any], name: str) -> float:
        return self.field(data, name, lambda value: _arguments.finite(name, value))

    def count(self, data: dict[str, Any], name: str) -> int:
        return self.field(data, name, lambda value: _arguments.count(name, value))

    def array(self, data: dict[str, Any], name: str, shape: tuple[int | None, ...]) -> Floats:
        value = self.field(data, name, lambda x: np.array(x, dtype=np.float64))
        matches = len(shape) == value.ndim and all(
            want in (None, have) for want, have in zip(shape, value.shape, strict=True)
        )
        if not matches or not np.all(np.isfinite(value)):
            raise InputError(
                f"{self.path}: field {name} has shape {value.shape}, expected finite {shape}"
            )
        return value

    def parts(
        self, content: dict[str, Any], name: str, attractor: Attractor, basis: Basis
    ) -> tuple[PositionDMP, OrientationDMP]:
        parts = self.part(content, name)
        position, orientation = self.part(parts, "position"), self.part(parts, "orientation")
        weights = (basis.count, 3)
        return (
            PositionDMP(
                attractor,
                ForcingTerm(basis, self.array(position, "weights", weights)),
                self.array(position, "start", (3,)),
                self.array(position, "goal", (3,)),
                self.array(position, "start_velocity", (3,)),
            ),
            OrientationDMP(
                attractor,
                ForcingTerm(basis, self.array(orientation, "weights", weights)),
                self.array(orientation, "start", (4,)),
                Winding(self.array(orientation, "winding", (None, 4))),
                self.array(orientation, "start_velocity", (3,)),
            ),
        )

    def spread(self, content: dict[str, Any]) -> Spread | None:
        # Files written before it was kept have none.
        if content.get("spread") is None:
            return None
        part = self.part(content, "spread")
        positions, rotations = (
            self.array(part, name, (None, 3, 3)) for name in ("positions", "rotations")
        )
        # Its own errors are values that are wrong; here they get the file and the field.
        return self.field(
            content,
            "spread",
            lambda _: Spread(self.count(part, "demonstrations"), positions, rotations),
        )

    def records(self, content: dict[str, Any]) -> list[LearningRecord]:
        # Records written before there were limits left none out.
        names = [f.name for f in fields(LearningRecord) if f.name != "left_out"]
        entries = self.field(content, "learned_from", _list_of_parts)
        return [
            LearningRecord(
                **{name: self.field(entry, name, lambda x: x) for name in names},
                left_out=tuple(entry.get("left_out", ())),
            )
            for entry in entries
        ]
