"""Options that several commands share, and what they become."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, cast, get_args, get_type_hints

import numpy as np
import typer
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip.constraints.catalog import CATALOG, parse_constraint
from noslip.constraints.declaration import Constraint
from noslip.demonstrations.preparation import prepare
from noslip.errors import InputError
from noslip.projection.metric import Metric
from noslip.recordings import load_demonstrations
from noslip.trajectory import PoseTrajectory

LONGEST, FASTEST = 86400.0, 20.0
"""Beyond a day (s), or this mean speed (m/s), units are asked after."""
_PREPARATION = "Preparation (in this order)"
_WHERE = "Where in a bag or data set"

Recordings = Annotated[
    list[str],
    typer.Argument(
        help="Recordings: CSV (t,x,y,z,qw,qx,qy,qz, t,x,y,theta or t,x,y,theta_deg), npz, ROS "
        "bags, LeRobot and robomimic data sets, Parquet, TUM; globs are expanded.",
        show_default=False,
    ),
]
Constraints = Annotated[
    list[str],
    typer.Option(
        "--constraint",
        metavar="NAME",
        help=f"What must hold; repeatable.  A name ({', '.join(sorted(CATALOG))}), a call such "
        "as \"blade(lateral='z')\", or your own as file.py:name.",
        show_default=False,
    ),
]
SampleRate = Annotated[
    float | None,
    typer.Option(
        metavar="HZ",
        help="Rate at which files were recorded that number their samples (column i) instead of "
        "timing them.",
        show_default=False,
    ),
]
Topic = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Topic of a bag; noslip topics shows what there is.",
        rich_help_panel=_WHERE,
        show_default=False,
    ),
]
Frame = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Frame of a bag in which the motion is seen; of tf by default the root.",
        rich_help_panel=_WHERE,
        show_default=False,
    ),
]
ChildFrame = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Frame of a bag that moves.",
        rich_help_panel=_WHERE,
        show_default=False,
    ),
]
Episode = Annotated[
    list[int],
    typer.Option(
        metavar="K",
        help="Episode of a LeRobot or robomimic data set; repeatable, by default all.",
        rich_help_panel=_WHERE,
        show_default=False,
    ),
]
Columns = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help="Columns of a data set or table that hold x, y, z, qw, qx, qy, qz, such as "
        '"observation.state[0:3,6,3:6]".',
        rich_help_panel=_WHERE,
        show_default=False,
    ),
]
ToolFrame = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z[,QW,QX,QY,QZ]",
        help="Tool frame in the sensor's frame (m): T_sb, so that T_wb = T_ws T_sb.",
        rich_help_panel=_PREPARATION,
        show_default=False,
    ),
]
TrimTime = Annotated[
    str | None,
    typer.Option(
        metavar="START:END",
        help="Keep this time (s); either side may be empty.",
        rich_help_panel=_PREPARATION,
        show_default=False,
    ),
]
TrimSpeed = Annotated[
    float | None,
    typer.Option(
        metavar="M/S",
        help="Keep from the first to the last sample that moves faster.",
        rich_help_panel=_PREPARATION,
        show_default=False,
    ),
]
Rate = Annotated[
    float | None,
    typer.Option(
        metavar="HZ",
        help="Resample uniformly by splines.",
        rich_help_panel=_PREPARATION,
        show_default=False,
    ),
]
Lowpass = Annotated[
    float | None,
    typer.Option(
        metavar="HZ",
        help="Zero-phase Butterworth filter of third order (the paper: 4.8).",
        rich_help_panel=_PREPARATION,
        show_default=False,
    ),
]
Relative = Annotated[
    bool,
    typer.Option(
        "--relative",
        help="Positions relative to the first sample.",
        rich_help_panel=_PREPARATION,
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


@dataclass(frozen=True)
class Where:
    """What is read of a file; the options of a command that reads recordings."""

    sample_rate: SampleRate = None
    topic: Topic = None
    frame: Frame = None
    child_frame: ChildFrame = None
    episode: Episode = field(default_factory=list)
    columns: Columns = None

    def loading(self) -> dict[str, Any]:
        """Return what they ask of :func:`noslip.load_demonstrations`."""
        return {
            "rate": self.sample_rate,
            "topic": self.topic,
            "frame": self.frame,
            "child_frame": self.child_frame,
            "episode": self.episode or None,
            "columns": self.columns,
        }


@dataclass(frozen=True)
class Loading(Where):
    """And how it is prepared, in this order."""

    tool_frame: ToolFrame = None
    trim_time: TrimTime = None
    trim_speed: TrimSpeed = None
    rate: Rate = None
    lowpass: Lowpass = None
    relative: Relative = False

    def preparation(self) -> dict[str, Any]:
        """Return what they ask of :func:`noslip.prepare`."""
        tool = self.tool_frame
        return {
            "tool_frame": None if tool is None else numbers("--tool-frame", tool, (3, 7)),
            "trim_time": None if self.trim_time is None else _interval(self.trim_time),
            "trim_speed": self.trim_speed,
            "rate": self.rate,
            "lowpass": self.lowpass,
            "relative": self.relative,
        }

    def load(self, recordings: list[str]) -> list[PoseTrajectory]:
        """Read recordings and prepare them as the options ask."""
        steps = self.preparation()
        read = load_demonstrations(recordings, **self.loading())
        for warning in filter(None, map(_odd_units, read)):
            typer.echo(f"noslip: warning: {warning}", err=True)
        return [prepare(demonstration, **steps) for demonstration in read]


def _odd_units(recording: PoseTrajectory) -> str:
    """What speaks against seconds and meters; empty if nothing does."""
    told = ""
    if recording.duration > LONGEST:
        told = f"lasts {recording.duration:.3g} s; are its times in other units than seconds?"
    elif recording.path_length > FASTEST * recording.duration:
        speed = recording.path_length / recording.duration
        told = f"moves at {speed:.3g} m/s; are its positions in other units than meters?"
    return told and f"{recording.name}: {told}"


def grouped(run: Callable[..., None]) -> Callable[..., None]:
    """Let a command take options in groups: Typer sees the fields of each dataclass instead."""
    hints = get_type_hints(run, include_extras=True)
    parameters: list[Parameter] = []
    groups: dict[str, Any] = {}
    for name, given in signature(run).parameters.items():
        kind = hints[name]
        if not is_dataclass(kind):
            parameters.append(given.replace(annotation=kind, kind=Parameter.KEYWORD_ONLY))
            continue
        groups[name] = kind
        of_fields = get_type_hints(kind, include_extras=True)
        for option in fields(kind):
            default = option.default
            if option.default_factory is not MISSING:
                default = option.default_factory()
            parameters.append(
                Parameter(
                    option.name,
                    Parameter.KEYWORD_ONLY,
                    default=default,
                    annotation=of_fields[option.name],
                )
            )

    @wraps(run)
    def command(**given: Any) -> None:
        for name, kind in groups.items():
            given[name] = kind(**{option.name: given.pop(option.name) for option in fields(kind)})
        run(**given)

    del command.__wrapped__
    command.__annotations__ = {p.name: p.annotation for p in parameters}
    command.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    return command


def constraints(texts: list[str]) -> list[Constraint]:
    """Return the constraints that ``--constraint`` names."""
    return [parse_constraint(text) for text in texts]


def metric(text: str | None) -> Metric | None:
    """Return the metric that ``--metric`` names: a word, or six weights."""
    if text is None or text in get_args(get_args(Metric)[0]):
        return cast("Metric | None", text)
    if "," not in text:
        raise InputError(
            "--metric: expected position, rotation, shared or six weights separated by commas, "
            f"got {text!r}"
        )
    return numbers("--metric", text, (6,))


def numbers(option: str, text: str, counts: tuple[int, ...]) -> list[float]:
    """Numbers separated by commas; an error names the option."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts:
        wanted = " or ".join(map(str, counts))
        raise InputError(f"{option}: expected {wanted} numbers separated by commas, got {text!r}")
    return values


def vector(option: str, text: str | None) -> list[float] | None:
    """Return the three finite numbers that an option gives (m)."""
    if text is None:
        return None
    return list(_arguments.vector(option, numbers(option, text, (3,))))


def rotation(option: str, text: str | None) -> Rotation | None:
    """Return the rotation whose unit quaternion (qw,qx,qy,qz) an option gives."""
    if text is None:
        return None
    quaternion = np.array(numbers(option, text, (4,)))
    if not abs(np.linalg.norm(quaternion) - 1) < 1e-3:
        raise InputError(f"{option}: {text} is not a unit quaternion (qw,qx,qy,qz)")
    return Rotation.from_quat(quaternion, scalar_first=True)


def output(path: Path | None, option: str = "--out") -> Path | None:
    """Refuse a folder where a file is to be written."""
    if path is not None and path.is_dir():
        raise InputError(f"{option}: {path} is a folder; give the name of a file")
    return path


def _interval(text: str) -> tuple[float | None, float | None]:
    start, colon, end = text.partition(":")
    try:
        if not colon:
            raise ValueError
        return (float(start) if start.strip() else None, float(end) if end.strip() else None)
    except ValueError:
        raise InputError(
            f"--trim-time: expected START:END in seconds, either side may be empty; got {text!r}"
        ) from None
