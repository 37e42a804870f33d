"""Options that several commands share, and what they become."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal, cast, get_args, get_type_hints

import numpy as np
import typer
from scipy.spatial.transform import Rotation

from noslip import _arguments
from noslip._samples import Duplicates, Gaps, Lost, Mending, Unsorted
from noslip._turns import KINDS
from noslip._typing import Floats
from noslip.boundary import Boundary, End
from noslip.constraints.catalog import parse_constraint
from noslip.constraints.declaration import CATALOG, Constraint
from noslip.demonstrations.preparation import Order, prepare
from noslip.errors import InputError
from noslip.projection.metric import Metric
from noslip.recordings import load_demonstrations
from noslip.recordings.bags import Integrate
from noslip.recordings.twists import Twist
from noslip.runtime.rollout import ProjectStart
from noslip.space import Space
from noslip.trajectory import PoseTrajectory

_ROUNDING = 4 * np.finfo(np.float64).eps
"""Off the norm of a quaternion that was normalized."""
_PREPARATION = "Preparation (in this order)"
"""Headings of these options in the help: what is done to a recording, in the order of doing it."""
_WHERE = "Where in a bag or data set"
"""Headings of these options in the help."""


def optional(metavar: str, help: str, panel: str | None = None, flags: tuple[str, ...] = ()) -> Any:
    """Return an option that need not be given, under a heading of the help."""
    return typer.Option(
        *flags, metavar=metavar, help=help, rich_help_panel=panel, show_default=False
    )


def out(what: str, *, default: bool = False, also: str | None = None) -> Any:
    """Return the option ``--out`` of a command: where what it makes is written.

    Parameters
    ----------
    what : str
        That is written, in which formats.
    default : bool
        Whether the help shows where it is written if nothing is said.
    also : str, optional
        An older name of it, which goes on to be understood.
    """
    names = () if also is None else ("--out", also)
    return typer.Option(
        *names, metavar="PATH", help=f"Where to write {what}.", show_default=default
    )


FIGURES = (".png", ".svg", ".pdf")
"""Formats of figures: to look at, to edit, and to print."""

# What several commands take is declared here once, so that it is called and explained alike in all.

_RECORDINGS = typer.Argument(
    help="Recordings: CSV (t,x,y,z,qw,qx,qy,qz, t,x,y,theta or t,x,y,theta_deg), npz, ROS "
    "bags, LeRobot and robomimic data sets, Parquet, TUM; globs are expanded.",
    show_default=False,
)
Recordings = Annotated[list[str], _RECORDINGS]
Recording = Annotated[str, typer.Argument(help="A recording of any format.", show_default=False)]
Motions = Annotated[
    list[str],
    typer.Argument(
        help="Recordings of any format, primitives (JSON), which are rolled out, and folders "
        "that noslip simulate wrote.",
        show_default=False,
    ),
]
Primitive = Annotated[
    Path, typer.Argument(help="A primitive written by noslip learn.", show_default=False)
]
OptionalPrimitive = Annotated[
    Path | None, typer.Argument(help="A primitive written by noslip learn.", show_default=False)
]
Constraints = Annotated[
    list[str],
    optional(
        "NAME",
        f"What must hold; repeatable.  A name ({', '.join(sorted(CATALOG))}), a call such "
        "as \"blade(lateral='z')\", or your own as file.py:name.",
        flags=("--constraint",),
    ),
]
SampleRate = Annotated[
    float | None,
    optional(
        "HZ",
        "Rate at which files were recorded that number their samples (column i) instead of "
        "timing them.",
    ),
]
Topic = Annotated[
    str | None,
    optional("NAME", "Topic of a bag; noslip topics shows what there is.", _WHERE),
]
Frame = Annotated[
    str | None,
    optional(
        "NAME", "Frame of a bag in which the motion is seen; of tf by default the root.", _WHERE
    ),
]
ChildFrame = Annotated[
    str | None,
    optional("NAME", "Frame of a bag that moves.", _WHERE),
]
Publisher = Annotated[
    str | None,
    optional("NAME", "Publisher on a topic of a bag, where several alternate.", _WHERE),
]
Element = Annotated[
    int | None,
    optional("K", "Pose of a bag's PoseArray, from 0.", _WHERE),
]
IntegrateChoice = Annotated[
    Integrate | None,
    optional(
        "body|world", "Integrate a bag's TwistStamped, in the frame of the body or world.", _WHERE
    ),
]
Episode = Annotated[
    list[int],
    optional(
        "K", "Episode of a LeRobot or robomimic data set; repeatable, by default all.", _WHERE
    ),
]
_TABLE = "Columns of a table or data set, where their names do not tell"
"""Heading of these options in the help."""
Columns = Annotated[
    str | None,
    optional(
        "NAMES",
        "Position first, then the rotation, such as px,py,pz,qw,qx,qy,qz or "
        "observation.state[0:3,6,3:6]; of a file without a header their numbers from 0; or what "
        "the names of one of several poses begin with.",
        _TABLE,
    ),
]
ChannelColumns = Annotated[
    str | None,
    optional(
        "NAMES",
        "Columns beside the pose that go with it, such as gripper or fx,fy,fz: a primitive learns "
        "them with its phase.",
        _TABLE,
    ),
]
TimeColumn = Annotated[
    str | None, optional("NAME", "Time, or seconds and nanoseconds: sec,nanosec.", _TABLE)
]
TimeUnit = Annotated[
    Literal["s", "ms", "us", "ns"] | None,
    typer.Option(help="Of the times.", show_default=False, rich_help_panel=_TABLE),
]
LengthUnit = Annotated[
    Literal["m", "cm", "mm", "in"] | None,
    typer.Option(help="Of the positions.", show_default=False, rich_help_panel=_TABLE),
]
RotationKind = Annotated[
    str | None, optional("KIND", f"How rotations are written: {KINDS}.", _TABLE)
]
_ROBOT = "The robot"
"""Heading of these options in the help."""
_ROBOT_MODEL = optional(
    "NAME|FILE",
    "The arm: panda, or a model's file (MJCF or URDF).  A recording of its joints is read as the "
    "poses of its tool.",
    _ROBOT,
)
RobotModel = Annotated[str, _ROBOT_MODEL]
OptionalRobotModel = Annotated[str | None, _ROBOT_MODEL]
RobotTool = Annotated[
    str | None,
    optional(
        "NAME",
        "Site or body of --robot FILE that is the tool's frame: x along the edge's travel, y "
        "lateral, z out of the work.",
        _ROBOT,
    ),
]
AsValues = Annotated[
    bool,
    typer.Option(
        "--values",
        help="Read columns as they are, whatever they are; with --robot, its joints, which stay "
        "joints and carry its tool.",
        rich_help_panel=_TABLE,
    ),
]
_FAULTS = "Faults of a recording"
"""Heading of these options in the help."""
GapsChoice = Annotated[
    Gaps,
    typer.Option(
        help="A hole: make a recording of each piece, or fill it in.", rich_help_panel=_FAULTS
    ),
]
DuplicatesChoice = Annotated[
    Duplicates, typer.Option(help="Two poses at one time: which to keep.", rich_help_panel=_FAULTS)
]
UnsortedChoice = Annotated[
    Unsorted,
    typer.Option(
        help="Time runs backwards: sort, or make a recording of each piece.",
        rich_help_panel=_FAULTS,
    ),
]
LostChoice = Annotated[
    Lost,
    typer.Option(
        help="NaN, zero quaternions, poses that stand still and then jump: leave them out.",
        rich_help_panel=_FAULTS,
    ),
]
ToolFrame = Annotated[
    str | None,
    optional(
        "X,Y,Z[,QW,QX,QY,QZ]",
        "Tool frame in the sensor's frame (m): T_sb, so that T_wb = T_ws T_sb.",
        _PREPARATION,
    ),
]
TrimTime = Annotated[
    str | None,
    optional("START:END", "Keep this time (s); either side may be empty.", _PREPARATION),
]
TrimSpeed = Annotated[
    float | None,
    optional("M/S", "Keep from the first to the last sample that moves faster.", _PREPARATION),
]
FilterOrder = Annotated[
    Order,
    typer.Option(
        help="Whether the low-pass filter sees what trimming cuts off; in the paper's order not.",
        rich_help_panel=_PREPARATION,
    ),
]
Rate = Annotated[
    float | None,
    optional("HZ", "Resample uniformly by splines.", _PREPARATION),
]
Lowpass = Annotated[
    float | None,
    optional("HZ", "Zero-phase Butterworth filter of third order (the paper: 4.8).", _PREPARATION),
]
Relative = Annotated[
    bool,
    typer.Option(
        "--relative",
        help="Positions relative to the first sample.",
        rich_help_panel=_PREPARATION,
    ),
]
Kept = Annotated[
    Literal[End, "auto"],
    typer.Option(
        help="What of this end the projection keeps.  auto: to adapt, the pose; to learn, "
        "nothing of the start and the position of the end, unless a constraint on poses may want "
        "another."
    ),
]
_PROJECTION = "Weights of the projection"
"""Heading of these options in the help."""
PositionWeight = Annotated[
    float,
    typer.Option(
        metavar="X",
        help="Of the position's displacement; that of the rotation's is 1.",
        rich_help_panel=_PROJECTION,
    ),
]
PositionSmoothing = Annotated[
    float,
    typer.Option(
        metavar="X", help="Of the smoothness of the position.", rich_help_panel=_PROJECTION
    ),
]
RotationSmoothing = Annotated[
    float,
    typer.Option(
        metavar="X", help="Of the smoothness of the rotation.", rich_help_panel=_PROJECTION
    ),
]
Point = Annotated[str | None, optional("X,Y,Z", "Meters, world frame.")]
"""An option that is a position."""
Turn = Annotated[
    str | None, optional("QW,QX,QY,QZ", "Unit quaternion, which turns body into world.")
]
"""An option that is a rotation."""
Duration = Annotated[
    float | None,
    optional("S", "Of the motion; by default the primitive's.  Of a rhythm its period."),
]
StartProjected = Annotated[
    ProjectStart,
    typer.Option(
        help="What of a start off the constraints is replaced by the nearest on them: its "
        "velocity, its pose too, or nothing."
    ),
]
WhoGivesWay = Annotated[
    str,
    typer.Option(
        metavar="NAME|W,...",
        help="Who gives way at run time: position, shared, or six positive weights separated by "
        "commas; auto is position where that can hold all, else shared.",
    ),
]
MANY = "Many recordings"
"""Heading of these options in the help."""
Figure = Annotated[Path | None, optional("FILE", f"Draw what was found too: {', '.join(FIGURES)}.")]
Each = Annotated[
    bool,
    typer.Option(
        "--each",
        help="Each recording for itself: --out is a folder, of a data set its copy.",
        rich_help_panel=MANY,
    ),
]
Seed = Annotated[int, typer.Option(metavar="N", min=0, help="Of whatever is random.")]
Vias = Annotated[
    list[str],
    optional(
        "AT:[X,Y,Z][,QW,QX,QY,QZ]",
        "To pass at a fraction of the duration, 0 < AT < 1; of vectors and joints "
        "AT:V1,V2,...; repeatable.",
    ),
]
PointValues = Annotated[
    str | None,
    optional("V1,V2,...", "Of vectors and joints: a number a coordinate, in its own unit."),
]
"""An option that is a point of what does not turn."""
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


MENDING = tuple(each.name for each in fields(Mending))
"""Options of all formats, about faults."""


@dataclass(frozen=True)
class Where:
    """What is read of a file; the options of a command that reads recordings."""

    sample_rate: SampleRate = None
    topic: Topic = None
    frame: Frame = None
    child_frame: ChildFrame = None
    publisher: Publisher = None
    element: Element = None
    integrate: IntegrateChoice = None
    episode: Episode = field(default_factory=list)
    columns: Columns = None
    channels: ChannelColumns = None
    time_column: TimeColumn = None
    time_unit: TimeUnit = None
    length_unit: LengthUnit = None
    rotation: RotationKind = None
    robot: OptionalRobotModel = None
    robot_tool: RobotTool = None
    values: AsValues = False
    gaps: GapsChoice = "refuse"
    duplicates: DuplicatesChoice = "refuse"
    unsorted: UnsortedChoice = "refuse"
    lost: LostChoice = "refuse"

    def loading(self) -> dict[str, Any]:
        """Return what they ask of :func:`noslip.load_demonstrations`."""
        return {
            "rate": self.sample_rate,
            "topic": self.topic,
            "frame": self.frame,
            "child_frame": self.child_frame,
            "publisher": self.publisher,
            "element": self.element,
            "integrate": self.integrate,
            "episode": self.episode or None,
            "columns": self.columns,
            "channels": self.channels,
            "time": self.time_column,
            "units": [unit for unit in (self.time_unit, self.length_unit) if unit] or None,
            "rotation": self.rotation,
            "robot": None if self.robot is None else robot(self.robot, self.robot_tool),
            "values": self.values,
            "gaps": self.gaps,
            "duplicates": self.duplicates,
            "unsorted": self.unsorted,
            "lost": self.lost,
        }


_WRITING = "What is written of a motion"
"""Heading of these options in the help."""


@dataclass(frozen=True)
class Writing:
    """What is written of a motion; the options of a command that writes one."""

    twist: Annotated[
        Twist | None,
        typer.Option(
            help="Add vx,vy,vz,wx,wy,wz, to command at each row until the next, in this frame; of "
            "a planar motion v,omega.",
            show_default=False,
            rich_help_panel=_WRITING,
        ),
    ] = None
    planar: Annotated[
        bool,
        typer.Option("--planar", help="t,x,y,theta.", rich_help_panel=_WRITING),
    ] = False
    wheels: Annotated[
        str | None,
        optional(
            "track=M,radius=M",
            "Add the speeds left,right (rad/s) of a differential drive; the motion is planar.",
            _WRITING,
        ),
    ] = None

    def writing(self) -> dict[str, Any]:
        """Return what they ask of :func:`noslip.recordings.write_recording`."""
        wheels = None if self.wheels is None else measures("--wheels", self.wheels)
        return {"twist": self.twist, "planar": self.planar, "wheels": wheels}


def measures(option: str, text: str) -> dict[str, float]:
    """Return numbers by name from ``name=number,name=number``."""
    found = {}
    for part in text.split(","):
        name, _, value = part.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            raise InputError(
                f"{option}: expected name=number, separated by commas, got {part!r}"
            ) from None
    return found


@dataclass(frozen=True)
class Loading(Where):
    """And how it is prepared, in this order."""

    tool_frame: ToolFrame = None
    trim_time: TrimTime = None
    trim_speed: TrimSpeed = None
    rate: Rate = None
    lowpass: Lowpass = None
    relative: Relative = False
    order: FilterOrder = "filter"

    def loading(self) -> dict[str, Any]:
        """Return what they ask of :func:`noslip.load_demonstrations`: trimming goes first."""
        within = None if self.trim_time is None else _interval(self.trim_time)
        return {**super().loading(), "within": within}

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
            "order": self.order,
        }

    def load(self, recordings: list[str]) -> list[PoseTrajectory]:
        """Read recordings and prepare them as the options ask."""
        steps = self.preparation()
        read = load_demonstrations(recordings, **self.loading())
        return [prepare(demonstration, **steps) for demonstration in read]


def robot(name: str, tool: str | None) -> Any:
    """Return the arm that ``--robot`` and ``--robot-tool`` name."""
    # Its package is large, and few recordings are of joints.
    from noslip import robots

    if is_model(name):
        if tool is None:
            raise InputError(
                f"--robot {name} needs --robot-tool: the site or body that is the tool's frame"
            )
        return robots.named("", model=name, tool=tool)
    if tool is not None:
        raise InputError(f"--robot-tool is for a model's file; robot {name!r} has its own tool")
    return robots.named(name)


def is_model(name: str) -> bool:
    """Whether ``--robot`` names a file, not one of the arms that noslip brings."""
    return bool(Path(name).suffix)


def kept(**ends: str) -> dict[str, Any]:
    """Return what ``--start`` and ``--end`` say; auto is the default of what is called."""
    return {end: part for end, part in ends.items() if part != "auto"}


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


def metric(text: str) -> Metric:
    """Return the metric that ``--metric`` names: a word, or six weights."""
    # Why the rotation alone is none, learning says.
    if text in ("rotation", *get_args(get_args(Metric)[0])):
        return cast("Metric", text)
    if "," not in text:
        raise InputError(
            "--metric: expected auto, position, shared or six weights separated by commas, "
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


def vector(option: str, text: str | None) -> Floats | None:
    """Return the three finite numbers that an option gives (m)."""
    if text is None:
        return None
    return _arguments.vector(option, numbers(option, text, (3,)))


def point(option: str, text: str | None, space: Space) -> Floats | None:
    """Return the finite numbers, one a coordinate, that an option gives of what does not turn."""
    if text is None:
        return None
    if space.rotations:
        raise InputError(
            f"{option}: is for vectors and joints; this primitive has poses, of which give "
            f"{option.replace('values', 'position')} and {option.replace('values', 'rotation')}"
        )
    found = np.array(numbers(option, text, (space.linear,)))
    if not np.isfinite(found).all():
        raise InputError(f"{option}: expected finite numbers, got {text!r}")
    return found


def place(end: str, position: str | None, values: str | None, space: Space) -> Floats | None:
    """Return where the start or the goal is: meters of poses, or the values of all coordinates."""
    if position is not None and values is not None:
        raise InputError(f"--{end}-values: says what --{end}-position says; leave one of them out")
    if values is not None:
        return point(f"--{end}-values", values, space)
    if position is not None and not (space.bodies and space.is_placed):
        raise InputError(
            f"--{end}-position: is a place in meters; this primitive moves "
            f"{', '.join(space.coordinates)}: give --{end}-values"
        )
    return vector(f"--{end}-position", position)


def require_poses(command: str, name: object, space: Space) -> None:
    """Refuse a primitive of vectors or joints where a command is about poses."""
    if not space.rotations:
        raise InputError(
            f"{name}: moves {', '.join(space.coordinates)}, and noslip {command} is about poses; "
            "see it with noslip plot"
        )


def rotation(option: str, text: str | None) -> Rotation | None:
    """Return the rotation whose unit quaternion (qw,qx,qy,qz) an option gives."""
    if text is None:
        return None
    quaternion = np.array(numbers(option, text, (4,)))
    if not abs(np.linalg.norm(quaternion) - 1) < 1e-3:
        raise InputError(f"{option}: {text} is not a unit quaternion (qw,qx,qy,qz)")
    if abs(np.linalg.norm(quaternion) - 1) <= _ROUNDING:
        # Normalized again, it would not be the rotation to the bit that was written.
        return Rotation(quaternion[[1, 2, 3, 0]], normalize=False)
    return Rotation.from_quat(quaternion, scalar_first=True)


def output(path: Path | None, option: str = "--out") -> Path | None:
    """Refuse a folder where a file is to be written."""
    if path is not None and path.is_dir():
        raise InputError(f"{option}: {path} is a folder; give the name of a file")
    return path


def figure(path: Path | None, option: str = "--figure") -> Path | None:
    """Refuse what no figure can be written to."""
    if output(path, option) is not None and path is not None and path.suffix not in FIGURES:
        raise InputError(f"{option}: {path} must end in {', '.join(FIGURES)}")
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


def via(text: str, space: Space) -> Boundary:
    """Return a point to pass on the way, ``AT:X,Y,Z[,QW,QX,QY,QZ]``."""
    at, colon, pose = text.partition(":")
    try:
        fraction = float(at if colon else "")
    except ValueError:
        raise InputError(
            "--via: expected AT:X,Y,Z, AT:QW,QX,QY,QZ or AT:X,Y,Z,QW,QX,QY,QZ with 0 < AT < 1, "
            f"got {text!r}"
        ) from None
    turn = None
    if space.rotations:
        count = len(numbers("--via", pose, (3, 4, 7)))
        cells = pose.split(",")
        moved, turned = (cells, []) if count == 3 else (cells[:-4], cells[-4:])
        position = vector("--via", ",".join(moved) or None)
        turn = rotation("--via", ",".join(turned) or None)
    else:
        position = point("--via", pose, space)
    if not 0 < fraction < 1:
        raise InputError(f"--via: AT must be between 0 and 1, a fraction of the motion, got {at}")
    return Boundary.via((fraction, position, turn))
