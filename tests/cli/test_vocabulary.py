"""The vocabulary of the command line: one meaning a word, in all commands."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import noslip as ns
from motions import planar_cut
from noslip import errors
from noslip.cli import PANELS, _Commands
from noslip.figures.segments import recording_cuts

COMMANDS = {name: command.params for name, command in _Commands().items()}
OWN = {"--out"}
"""What each command says of it is its own: where it writes, and in which formats."""


def said(parameter: Any) -> tuple[Any, ...]:
    """What a person learns of an option or an argument, and what it takes."""
    kind = parameter.type_descriptor.annotation
    look = parameter.metavar, parameter.help, parameter.rich_help_panel
    return (*look, tuple(parameter.secondary_opts), str(kind))


def test_a_word_means_the_same_in_every_command() -> None:
    meanings: dict[str, dict[tuple[Any, ...], list[str]]] = defaultdict(lambda: defaultdict(list))
    for command, parameters in COMMANDS.items():
        for parameter in parameters:
            for word in parameter.opts:
                meanings[word][said(parameter)].append(command)
    several = {
        word: dict(found) for word, found in meanings.items() if len(found) > 1 and word not in OWN
    }
    assert not several
    # What is checked: words that several commands share, among them those that once differed.
    shared = {word for word, found in meanings.items() if sum(map(len, found.values())) > 1}
    assert {"--project-start", "--robot", "--rate", "--metric", "--figure", "--end"} <= shared


def test_each_out_says_where_in_the_same_words() -> None:
    outs = [p for parameters in COMMANDS.values() for p in parameters if "--out" in p.opts]
    assert len(outs) > 8
    for out in outs:
        assert out.metavar == "PATH" and out.help.startswith("Where to write ")


def test_every_word_is_explained() -> None:
    for command, parameters in COMMANDS.items():
        for parameter in parameters:
            assert parameter.help, (command, parameter.name)


def test_every_command_has_json() -> None:
    without = [
        name
        for name, parameters in COMMANDS.items()
        if not any("--json" in parameter.opts for parameter in parameters)
    ]
    assert not without
    assert set(COMMANDS) == {name for names in PANELS.values() for name in names}


def test_recordings_and_primitives_are_taken_alike_by_what_measures_and_what_shows() -> None:
    for command in ("check", "plot", "view"):
        assert "motions" in {parameter.name for parameter in COMMANDS[command]}


@pytest.fixture
def cutting(noslip, tmp_path) -> tuple[Path, Path]:
    """A recording, and a primitive learned from it."""
    recording = planar_cut(0.5, beside=np.radians(20)).to_csv(tmp_path / "cut.csv")
    primitive = tmp_path / "cut.json"
    learned = ("--constraint", "blade", "--project-start", "velocity", "--out", primitive)
    assert noslip("learn", recording, *learned).code == 0
    return recording, primitive


def test_check_takes_what_plot_takes(noslip, cutting, tmp_path):
    recording, primitive = cutting
    result = noslip("check", primitive, "--json")
    assert result.code == 0
    (report,) = json.loads(result.out)
    dmp = ns.load_primitive(primitive)
    motion = replace(dmp.rollout(), name=str(primitive))
    assert report == ns.check(motion, dmp.constraints).to_dict()
    # With a recording beside it, that is held against what the primitive holds; with a figure too.
    figure = tmp_path / "both.svg"
    result = noslip("check", recording, primitive, "--figure", figure)
    assert result.code == 1
    assert [line for line in result.out.splitlines() if "VIOLATED" in line or "HOLDS" in line]
    assert "VIOLATED" in result.out and "HOLDS" in result.out and figure.stat().st_size > 5000


def test_json_of_what_draws_and_converts(noslip, cutting, tmp_path):
    recording, primitive = cutting
    drawn = json.loads(noslip("plot", primitive, "--out", tmp_path / "p.png", "--json").out)
    assert drawn["written"] == [str(tmp_path / "p.png")] and drawn["title"]
    (told,) = json.loads(noslip("convert", recording, "--json").out)
    cut = ns.PoseTrajectory.from_csv(recording)
    assert told["samples"] == len(cut) and told["path_length"] == cut.path_length
    assert told["written"] is None and told["understood"]
    (told,) = json.loads(noslip("convert", recording, "--out", tmp_path / "c.npz", "--json").out)
    assert ns.PoseTrajectory.from_npz(told["written"]).path_length == cut.path_length
    pages = json.loads(noslip("docs", "--json").out)
    page = json.loads(noslip("docs", "recordings", "--json").out)
    assert page["title"] == pages["recordings"] and page["text"].startswith("#")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["chekc"], "no command 'chekc' (did you mean check?)"),
        (["--versoin"], "no such option --versoin (did you mean --version?)"),
        (["rollout", "cut.json", "--rate", "500"], "--rate (did you mean --time-step?)"),
        (
            ["adapt", "cut.json", "--goal", "0,0,0"],
            "(did you mean --goals, --goal-position, --goal-rotation, --goal-values or ",
        ),
        (["plot", "{cut}", "--shwo", "motion"], "no such option --shwo (did you mean --show?)"),
        (["check", "{cut}", "--constraint", "blad"], "(did you mean blade?)"),
        (["check", "{cut}", "--constraint", "blade(latteral='y')"], "(did you mean lateral?)"),
        (["check", "{cut}", "--columns", "t,x,y,zz,qw,qx,qy,qz"], "no column zz (did you mean z?)"),
        (["convert", "{cut}", "--time-column", "tt"], "no column tt (did you mean t?)"),
        (["convert", "{cut}", "--robot", "Pandaa"], "(did you mean panda?)"),
        (["docs", "blaed"], "(did you mean blade?)"),
        (["check"], "Missing argument 'motions'"),
        (["convert", "{cut}", "--gaps", "spilt"], "'spilt' is not one of 'refuse', 'split'"),
    ],
)
def test_what_is_misspelt_is_one_line_that_says_what_was_meant(noslip, tmp_path, arguments, said):
    cut = planar_cut(0.5).to_csv(tmp_path / "cut.csv")
    result = noslip(*(argument.format(cut=cut) for argument in arguments))
    assert result.code == 2 and result.out == ""
    assert result.err.startswith("noslip: error: ") and result.err.count("\n") == 1
    assert said in result.err


def test_messages_name_pages_that_are_there(noslip):
    named = {kind.page for kind in _kinds(errors.NoslipError) if kind.page}
    assert len(named) >= 4
    for page in named:
        shown = noslip("docs", page)
        assert shown.code == 0 and shown.out.startswith("#")


def _kinds(kind: type[errors.NoslipError]) -> list[type[errors.NoslipError]]:
    return [kind, *(found for below in kind.__subclasses__() for found in _kinds(below))]


def test_no_message_names_a_file_of_the_source() -> None:
    package = Path(ns.__file__).parent
    texts = {file: file.read_text("utf-8") for file in package.rglob("*.py")}
    assert len(texts) > 200
    assert not [file for file, text in texts.items() if re.search(r"docs/[\w/-]+\.md", text)]


EPOCH = 1764446400.25
"""Seconds since 1970, as ROS stamps them."""


def test_stamps_of_1970_are_told_and_asked_for_from_the_start(noslip, tmp_path):
    slow = planar_cut(0.5, beside=0.3, wavering=0.2)
    near, far = (
        ns.PoseTrajectory(begin + slow.times, slow.positions, slow.rotations).to_csv(
            tmp_path / f"{name}.csv"
        )
        for name, begin in (("near", 0.0), ("far", EPOCH))
    )
    held = ("--constraint", "blade", "--constraint", "box(upper=(0.5,1,1))")
    told = {file: noslip("check", file, *held).out for file in (near, far)}
    lines = [told[file].splitlines()[1:] for file in (near, far)]
    assert [line.replace(" after its start", "") for line in lines[1]] == lines[0]
    assert "e+09" not in told[far] and told[far].count(" s after its start") == 2
    # In data the recording's own clock stays.
    (report,) = json.loads(noslip("check", far, *held, "--json").out)
    assert report["constraints"][0]["worst_time"] > EPOCH == report["constraints"][0]["first_time"]
    # What was told can be asked for, and so can the clock's own count.
    for option in ("0.5:1.5", f"{EPOCH + 0.5}:{EPOCH + 1.5}"):
        (cut,) = json.loads(noslip("convert", far, "--trim-time", option, "--json").out)
        assert cut["samples"] == 61
    pieces = ("--at", "times", "--times", "0.2:0.8", "--times", "1:1.8", "--out", tmp_path / "cuts")
    table = noslip("segment", far, *pieces).out
    assert "times after its start" in table and "17644" not in table
    drawn = recording_cuts(ns.segment(ns.load_demonstrations(far)[0], times=[(0.2, 0.8)]))
    assert drawn.axes[0].get_xlim() == pytest.approx((0, 2), abs=1e-6)
    assert drawn.axes[0].get_xlabel() == "time since start (s)"
    result = noslip("check", far, "--trim-time", "5:6", *held)
    assert result.code == 2 and "they go from 0 to 2 s after its start" in result.err
