"""The way of docs/arm.md from a bag with tf alone to an arm's motion, as it stands there."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip.demonstrations.excision import TOOL_FRAME, synthetic_excisions

pytest.importorskip("rosbags", reason="needs noslip[bags]")
pytest.importorskip("mujoco", reason="needs noslip[robots]")
pytestmark = pytest.mark.slow

PAGE = Path(__file__).resolve().parents[1] / "docs" / "arm.md"


def block(name: str) -> list[str]:
    """Return the commands of the page's console block that mentions a file."""
    blocks = re.findall(r"```console\n(.*?)```", PAGE.read_text(), re.S)
    (text,) = (text for text in blocks if name in text)
    lines = text.replace("\\\n", " ").splitlines()
    return [line.partition("#")[0].removeprefix("$ ").strip() for line in lines if line.strip()]


def write_tf_bag(folder: Path) -> None:
    """A tracker's bag: the sensor in the world 120 times a second, the knife in the sensor once."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types

    def transform(time: float, parent: str, child: str, place: Any, turn: Rotation) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](*divmod(round(1e9 * time), 10**9))
        header = types["std_msgs/msg/Header"](stamp, parent)
        moved = types["geometry_msgs/msg/Transform"](
            types["geometry_msgs/msg/Vector3"](*map(float, place)),
            types["geometry_msgs/msg/Quaternion"](*map(float, turn.as_quat())),
        )
        return types["geometry_msgs/msg/TransformStamped"](header, child, moved)

    recording = synthetic_excisions()[0]
    kind = "tf2_msgs/msg/TFMessage"
    with Writer(folder, version=9) as writer:
        moving = writer.add_connection("/tf", kind, typestore=store)
        fixed = writer.add_connection("/tf_static", kind, typestore=store)

        def write(connection: Any, time: float, *link: Any) -> None:
            message = types[kind]([transform(time, *link)])
            writer.write(connection, round(1e9 * time), store.serialize_cdr(message, kind))

        write(fixed, 1.0, "sensor", "knife", TOOL_FRAME[:3, 3], Rotation.identity())
        for time, place, turn in zip(
            recording.times, recording.positions, recording.rotations, strict=True
        ):
            write(moving, 100.0 + time, "world", "sensor", place, turn)


def test_four_commands_lead_from_a_bag_to_an_arm(tmp_path: Path) -> None:
    write_tf_bag(tmp_path / "session")
    commands = block("session")
    assert len(commands) == 4
    told = []
    for command in commands:
        words = shlex.split(command)
        assert words[0] == "noslip"
        done = subprocess.run(
            [sys.executable, "-m", "noslip", *words[1:]],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, command + "\n" + done.stdout + done.stderr
        told.append(done.stdout)
    assert "/tf" in told[0]
    assert "HOLDS" in told[3]
    summary = json.loads((tmp_path / "arm" / "summary.json").read_text())
    assert summary
    (executed,) = ns.load_demonstrations(tmp_path / "arm" / "tool.csv")
    report = ns.check(executed, [ns.Blade()], tolerance=1e-3)
    assert report.satisfied
    joints = np.genfromtxt(tmp_path / "arm" / "joints.csv", delimiter=",", names=True)
    assert len(joints) > 1000
    assert np.abs(np.diff(joints["q1"])).max() < 0.01
    shutil.rmtree(tmp_path / "arm")
