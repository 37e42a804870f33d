"""``noslip simulate``: a primitive in, an arm's joints out.

noslip simulate excision.json --robot panda --out arm/

noslip simulate excision.json --dynamics impedance --noise --delay 0.002 --out arm/

noslip simulate excision.json --placement 0.45,0.1,0.3,1.57 --duration 8 --out arm/

noslip simulate excision.json --bag arm.mcap --out arm/

noslip simulate excision.json --robot my_arm.xml --robot-tool scalpel_tip --video --out arm/
"""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer

from noslip import robots
from noslip._files import renewing, write_beside
from noslip.cli import options, output
from noslip.constraints.catalog import specification
from noslip.constraints.check import residual_text
from noslip.errors import InputError, MissingDependencyError
from noslip.figures import executed_slip, joint_limits, save_figure
from noslip.recordings import load_demonstrations, write_bag
from noslip.robots.placement import Level
from noslip.saving import load_primitive

Dynamics = Literal["torque", "impedance", "none"]
"""How the arm is controlled."""


def run(
    primitive: options.Primitive,
    out: Annotated[Path, options.out("the results: a folder, made if missing")],
    robot: options.RobotModel = "panda",
    robot_tool: options.RobotTool = None,
    dynamics: Annotated[
        Dynamics, typer.Option(help="Controller of the simulated arm; none: kinematics alone.")
    ] = "torque",
    noise: Annotated[bool, typer.Option("--noise", help="Noise of the joints' sensors.")] = False,
    delay: Annotated[float, typer.Option(metavar="S", help="Of the measurements.")] = 0.0,
    model_error: Annotated[
        float, typer.Option(help="Share by which the arm is heavier than its controller believes.")
    ] = 0.0,
    placement: Annotated[
        str,
        typer.Option(
            metavar="auto|X,Y,Z,YAW",
            help="Where the middle of the path lies before the base (m), and the turn about the "
            "vertical (rad); auto searches.",
        ),
    ] = "auto",
    level: Annotated[
        Level,
        typer.Option(
            help="recorded: the primitive's z axis is vertical.  tool: it is turned first such "
            "that the tool is upright on average."
        ),
    ] = "recorded",
    duration: options.Duration = None,
    ramp: Annotated[
        float,
        typer.Option(
            metavar="S", help="Over which the motion starts and stops; added to its duration."
        ),
    ] = robots.RAMP,
    recording: Annotated[
        Path | None,
        options.optional("FILE", "A person's own recording, whose slip is shown beside the arm's."),
    ] = None,
    bag: Annotated[
        Path | None,
        options.optional(
            "FILE",
            "Write the executed joints and tool poses as a ROS 2 bag too: FILE.mcap, or "
            "without suffix a folder.",
        ),
    ] = None,
    video: Annotated[bool, typer.Option("--video", help="Draw arm.mp4 too.")] = False,
    seed: options.Seed = 0,
    as_json: options.AsJson = False,
) -> None:
    """Execute a primitive with a robot arm that keeps the constraint, or say why it cannot.

    Writes joints.csv (t, q1.., dq1.., as commanded), executed.csv (the same, as the dynamics
    executed them), tool.csv (the executed tool, in the base's frame), figures and summary.json;
    noslip view shows the folder.  A motion that the arm cannot execute is refused: the message
    names the joint, the time and what is missing, and offers a duration or a placement.
    """
    if out.is_file():
        raise InputError(f"--out: {out} is a file; give a folder")
    if bag is not None:
        _refuse(bag)
    dmp = load_primitive(primitive)
    options.require_poses("simulate", primitive, dmp.law.space)
    arm = options.robot(robot, robot_tool)
    motion = dmp.rollout(duration=duration, time_step=robots.TIME_STEP)
    placed = None
    if placement != "auto":
        *middle, yaw = options.numbers("--placement", placement, (4,))
        placed = robots.Placement.of(motion, middle, yaw=yaw, level=level)
    with output.progress("tracking" if placed else "searching a placement, tracking", 1):
        tracked = robots.track(
            arm, motion, dmp.system, placement=placed, level=level, ramp=ramp, seed=seed
        )
    execution = None
    if dynamics != "none":
        with output.progress("dynamics", 1):
            execution = robots.execute(
                tracked,
                control=dynamics,
                noise=float(noise),
                delay=delay,
                model_error=model_error,
                seed=seed,
            )
    # By these, the arm and what it held are found again: noslip view shows them.
    path_middle, turn = tracked.placement.numbers(motion, level)
    found = robots.summary(tracked, execution) | {
        "placed": [*path_middle.tolist(), turn],
        "model": str(Path(robot).resolve()) if options.is_model(robot) else None,
        "tool": robot_tool,
        "constraints": [specification(constraint) for constraint in dmp.constraints],
    }
    if recording is not None:
        [person] = load_demonstrations(str(recording))
        found["recording_slip_distance"] = robots.slip_distance(person, dmp.system).tolist()
    with renewing(out / "summary.json"), output.progress("writing", 1):
        written = _write(tracked, execution, out, video, bag, found)
    if as_json:
        output.print_json(found | {"written": [str(path) for path in written]})
        return
    _print_summary(found)
    for path in written:
        typer.echo(f"wrote {path}")


def _write(
    tracked: robots.TrackedMotion,
    execution: robots.Execution | None,
    out: Path,
    video: bool,
    bag: Path | None,
    found: dict[str, Any],
) -> list[Path]:
    """Write all results of a run, whatever their format; return their paths."""
    done = execution or tracked
    written = [tracked.to_csv(out / "joints.csv")]
    if execution is not None:
        joints = {n: getattr(execution, n) for n in ("joint_positions", "joint_velocities")}
        written.append(replace(tracked, **joints).to_csv(out / "executed.csv"))
    written += [
        done.executed.to_csv(out / "tool.csv"),
        *save_figure(joint_limits(tracked), out / "joints.png"),
        *save_figure(executed_slip(tracked, execution), out / "slip.png"),
    ]
    if bag is not None:
        written.append(
            write_bag(
                bag,
                poses=done.executed,
                frame="base",
                joint_names=tracked.robot.joint_names,
                joint_times=tracked.times,
                joint_positions=done.joint_positions,
                joint_velocities=done.joint_velocities,
            )
        )
    if video:
        written.append(
            robots.render(tracked.robot, tracked.times, done.joint_positions, out / "arm.mp4")
        )
    summary = f"{json.dumps(found, indent=2, allow_nan=False)}\n".encode()
    return [*written, write_beside(out / "summary.json", summary)]


def _refuse(bag: Path) -> None:
    """Say that a bag cannot be written before the arm is simulated, not after."""
    bare = bag.suffix.lower() == ".mcap"
    if bag.suffix and not bare:
        raise InputError(f"--bag: {bag} must end in .mcap, or have no suffix for a folder")
    if bag.is_dir() or (bag.exists() and not bare):
        raise InputError(f"--bag: {bag} exists already; remove it or give another name")
    if find_spec("rosbags") is None:
        raise MissingDependencyError("--bag needs rosbags: pip install 'noslip[bags]'")


def _print_summary(found: dict[str, Any]) -> None:
    place = ",".join(f"{x:.4f}" for x in found["placed"])
    margins = found["margins"]
    typer.echo(f"{found['robot']}: {found['duration']:.3g} s, --placement {place}")
    typer.echo(
        f"least is left of {margins['smallest_of']}: {margins['smallest']:.0%}; bodies stay "
        f"{1e3 * margins['distance']:.3g} mm apart or more"
    )
    if found["unknown_limits"]:
        typer.echo(f"the model gives no limits of {', '.join(found['unknown_limits'])}: not kept")
    for kind in ("kinematic", "dynamic"):
        if kind in found:
            run = found[kind]
            slips = ", ".join(
                f"{name} {residual_text(peak, '1')}" for name, peak in run["slip"].items()
            )
            typer.echo(
                f"{kind}: residual {slips or 'none'}; off the path by at most "
                f"{1e3 * run['position_error']:.3g} mm ({1e3 * run['lateral_error']:.3g} mm "
                f"sideways) and {np.degrees(run['rotation_error']):.3g}°"
            )
    if "dynamic" in found:
        slipped = ", ".join(f"{1e3 * way:.3g}" for way in found["dynamic"]["slip_distance"])
        typer.echo(f"slipped in all: {slipped or 'nothing'} mm")
    if "recording_slip_distance" in found:
        person = ", ".join(f"{1e3 * way:.3g}" for way in found["recording_slip_distance"])
        typer.echo(f"the person: {person} mm")
