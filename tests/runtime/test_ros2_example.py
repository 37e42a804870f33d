"""The ROS 2 example: compiled against stubs of what it takes of ROS, and run against a robot.

The stubs (``ros_stubs``) have the signatures of Humble (rclcpp 16) and of Jazzy (28), so that types
are checked where there is no ROS; they do enough for a loop to run.
"""

from __future__ import annotations

import os
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cpp import CXX, OBJECTS, needs_cpp, ran
from test_replan_in_c import of

PACKAGE = Path(__file__).resolve().parents[2] / "examples" / "ros2" / "noslip_controller"
STUBS = Path(__file__).parent / "ros_stubs"
STRICT = ("-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
RCLCPP = {"humble": 16, "jazzy": 28}
pytestmark = pytest.mark.skipif(not PACKAGE.is_dir(), reason="the examples are not here")


def drive(
    folder: Path, where: Path, part: str, distribution: str, *arguments: str
) -> dict[str, str]:
    """What a driver prints of a part of the example, compiled for a distribution of ROS."""
    objects = [folder / name for name in OBJECTS]
    sources = PACKAGE / "src" / f"{part}.cpp", STUBS / f"drive_{part}.cpp"
    version = f"-DRCLCPP_VERSION_MAJOR={RCLCPP[distribution]}"
    flags = (*STRICT, "-O1", version, "-I", STUBS, "-I", folder)
    ran(CXX, *flags, *sources, *objects, "-o", "drive", folder=where)
    told = ran("./drive", *arguments, folder=where)
    return dict(line.split(" ", 1) for line in told.splitlines())


@needs_cpp
@pytest.mark.parametrize(
    ("name", "distribution", "goals"),
    [("blade", "humble", "topic"), ("wheel", "jazzy", "topic"), ("blade", "jazzy", "chained")],
)
def test_the_controller_leads_a_robot_to_its_goals(
    name: str, distribution: str, goals: str, tmp_path: Path, exported: Callable[[str], Path]
) -> None:
    """Refused away from the start; a motion, a new goal, a silent sensor; then it is put off."""
    path = of(name).rollout().positions
    length = of(name).rollout().path_length
    step = 0.04 * length * (path[-1] - path[-30]) / np.linalg.norm(path[-1] - path[-30])
    told = drive(exported(name), tmp_path, "controller", distribution, *map(str, step), goals)
    assert 0 < int(told["done"]) <= 1.3e3 * of(name).duration
    assert float(told["missed"]) <= 4e-3 * length
    assert (told["status"], told["plans"]) == ("hold true", "1")
    assert told["blind"] == "silent 1"
    assert (told["allocations"], told["twist"]) == ("0", "0")


@needs_cpp
@pytest.mark.parametrize("distribution", RCLCPP)
def test_the_node_leads_a_robot_to_its_goal(
    distribution: str,
    tmp_path: Path,
    exported: Callable[[str], Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dmp = of("blade")
    start = dmp.initial_state()
    pose = [*start.position, *start.rotation.as_quat()]
    monkeypatch.setitem(os.environ, "START", " ".join(map(repr, map(float, pose))))
    told = drive(exported("blade"), tmp_path, "node", distribution)
    motion = dmp.rollout()
    tool = np.array(told["tool"].split(), dtype=float)
    assert np.linalg.norm(tool - motion.positions[-1]) <= 4e-3 * motion.path_length
    assert (told["status"], told["at"]) == ("hold", "rest 1")
    assert told["published"] == told["cycles"]
    assert 0 < float(told["fastest"]) <= 1.3 * np.abs(motion.linear_velocities).max()


@needs_cpp
def test_every_setting_is_a_parameter_that_the_page_tells(
    exported: Callable[[str], Path],
) -> None:
    header = (exported("blade") / "controller.h").read_text()
    settings = header[header.index("/* Settings:") : header.index("/* What it tells. */")]
    names = re.findall(r"^    (?:double|int) (\w+);", settings, re.M)
    assert {"time_step", "follows", "knots"} <= set(names)
    sources = "".join(path.read_text() for path in (PACKAGE / "src").iterdir())
    declared = re.findall(r'parameter(?:<[\w:]+>)?\(\*?[\w()]+, "(\w+)"', sources)
    assert set(names) <= set(declared)
    page = (PACKAGE / "README.md").read_text().split("## Parameters")[1]
    told = re.findall(r"^\| `([^|]+?)` *\|", page, re.M)
    assert set(declared) == {name for cell in told for name in re.findall(r"\w+", cell)}


def test_what_the_package_depends_on_is_found_and_linked() -> None:
    package = ET.parse(PACKAGE / "package.xml").getroot()
    depends = {element.text for element in package.iter("depend")}
    built = (PACKAGE / "CMakeLists.txt").read_text()
    found = set(re.findall(r"find_package\((\w+) REQUIRED\)", built)) - {"ament_cmake"}
    sources = "".join(path.read_text() for path in (PACKAGE / "src").iterdir())
    included = set(re.findall(r'#include "(\w+)/', sources))
    assert depends == found == included
    plugin = ET.parse(PACKAGE / "noslip_controller.xml").getroot()
    (declared,) = plugin.iter("class")
    exported_class = re.search(r"PLUGINLIB_EXPORT_CLASS\(([\w:]+), ([\w:]+)\)", sources)
    assert (declared.get("type"), declared.get("base_class_type")) == exported_class.groups()
    assert f"add_library({plugin.get('path')} SHARED" in built


@pytest.mark.slow
@needs_cpp
@pytest.mark.skipif(shutil.which("cmake") is None, reason="cmake is missing")
def test_cmake_builds_the_package(tmp_path: Path, exported: Callable[[str], Path]) -> None:
    """With packages of stubs in the place of ROS."""
    package = ET.parse(PACKAGE / "package.xml").getroot()
    for element in [*package.iter("depend"), *package.iter("buildtool_depend")]:
        name = str(element.text)
        found = f"if(NOT TARGET {name}::{name})\n  add_library({name}::{name} INTERFACE IMPORTED)\n"
        found += f'  target_include_directories({name}::{name} INTERFACE "{STUBS}")\nendif()\n'
        if name.endswith("_msgs"):
            found += f"set({name}_TARGETS {name}::{name})\n"
        if name == "ament_cmake":
            found = "function(ament_package)\nendfunction()\n"
        if name == "pluginlib":
            found += "function(pluginlib_export_plugin_description_file base file)\n"
            found += "  if(NOT EXISTS ${CMAKE_CURRENT_SOURCE_DIR}/${file})\n"
            found += '    message(FATAL_ERROR "no ${file}")\n  endif()\nendfunction()\n'
        (tmp_path / "ros").mkdir(exist_ok=True)
        (tmp_path / "ros" / f"{name}Config.cmake").write_text(found)
    # Nothing but main calls it, and there is no executor.
    (tmp_path / "spin.cpp").write_text(
        '#include "rclcpp/rclcpp.hpp"\n'
        "void rclcpp::spin(rclcpp::node_interfaces::NodeBaseInterface::SharedPtr) {}\n"
    )
    ran(CXX, "-std=c++17", "-c", "-fPIC", "-I", STUBS, "spin.cpp", folder=tmp_path)
    given = (f"-DCMAKE_PREFIX_PATH={tmp_path}/ros", f"-DNOSLIP_EXPORT={exported('blade')}")
    given = (*given, f"-DCMAKE_EXE_LINKER_FLAGS={tmp_path}/spin.o")
    given = (*given, "-DCMAKE_BUILD_TYPE=Debug")
    installed = f"-DCMAKE_INSTALL_PREFIX={tmp_path}/installed"
    ran("cmake", "-S", PACKAGE, "-B", tmp_path / "build", *given, installed, folder=tmp_path)
    ran("cmake", "--build", tmp_path / "build", folder=tmp_path)
    ran("cmake", "--install", tmp_path / "build", folder=tmp_path)
    written = {path.name for path in (tmp_path / "installed").rglob("*") if path.is_file()}
    assert written >= {"libnoslip_controller.so", "noslip_node", "robot.yaml"}
