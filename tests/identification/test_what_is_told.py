"""What a person is told of a finding: sentences, options to paste, a figure; all of it true."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import BLADE_AT, BLADE_TURNED, sensed_blade
from noslip._typing import Floats
from noslip.constraints.catalog import constraint_text, parse_constraint
from noslip.figures import identified_constraint, save_figure
from noslip.figures.identified import way_slipped
from noslip.identification import Identified, Place, tool_frame
from noslip.identification.identified import axis_text
from noslip.recordings import write_recording
from strategies import seeds


@pytest.fixture(scope="module")
def blade() -> Identified:
    return ns.identify([sensed_blade(seed, (0.6, 0.6, 0.9)) for seed in range(3)])


@pytest.fixture(scope="module")
def nothing() -> Identified:
    return ns.identify([sensed_blade(seed, (0.6, 0.6, 0.9), free=0.06) for seed in range(3)])


def test_a_blade_is_told_with_its_axis_and_its_point(blade: Identified) -> None:
    assert blade.kinds == ("blade",)
    first, axes, place, slip = str(blade).splitlines()
    assert first == "blade in 3 recordings"
    lateral = BLADE_TURNED.apply([0, 1, 0])
    (angle,) = re.findall(r"lateral axis y turned by ([\d.]+) ± [\de.-]+ degrees", axes)
    assert float(angle) == pytest.approx(np.degrees(np.arccos(lateral[1])), abs=0.3)
    # Across the lateral axis; the point nearest the origin.
    told = BLADE_AT - lateral * (lateral @ BLADE_AT)
    for letter, value in (("x", told[0]), ("z", told[2])):
        (found, error) = re.findall(rf"{letter} (-?[\d.]+) ± ([\de.-]+)", place)[0]
        assert float(found) == pytest.approx(1e3 * value, abs=max(0.1, 4 * float(error)))
    assert place.endswith("along y it may be anywhere")
    assert re.search(r"slips [\d.]+ % of its speed, [\d.]+ % about the origin", slip)


def test_the_motion_that_is_said_to_tell_does_tell(blade: Identified) -> None:
    flat = ns.identify([sensed_blade(seed, (0.0, 0.0, 0.9)) for seed in range(3)])
    assert flat.kinds == ("blade",)
    assert "along z nothing tells where it is: turn about x" in str(flat)
    turned = ns.identify([sensed_blade(seed, (0.6, 0.0, 0.9)) for seed in range(3)])
    assert "nothing tells" not in str(turned)
    assert turned.reference_point is not None
    assert turned.reference_point[2] == pytest.approx(BLADE_AT[2], abs=2e-3)


def test_where_nothing_holds_that_is_said(nothing: Identified) -> None:
    assert nothing.constraints == () and nothing.tool_frame is None
    assert str(nothing).startswith("no constraint in 3 recordings\n  the stillest direction is ")


def test_it_is_plain_data(blade: Identified, nothing: Identified) -> None:
    for found in (blade, nothing):
        data = json.loads(json.dumps(found.to_dict(), allow_nan=False))
        assert tuple(data["kinds"]) == found.kinds
        assert len(data["rows"]) == len(found.rows) and "recordings" not in data
        assert found._repr_html_().startswith("<table>")
    data = blade.to_dict()
    (read,) = map(parse_constraint, data["constraints"])
    assert isinstance(read, ns.Blade) and blade.reference_point is not None
    np.testing.assert_allclose(read.reference_point, blade.reference_point, atol=1e-6)
    np.testing.assert_array_equal(data["tool_frame"], blade.tool_frame)


def test_in_the_frame_of_the_tool_it_is_a_plain_blade(blade: Identified) -> None:
    for recording in blade.recordings:
        there = ns.check(ns.prepare(recording, tool_frame=blade.tool_frame), ns.Blade())
        here = ns.check(recording, blade.constraints)
        # The step's chord and its velocity differ by the square of its turn.
        assert there.rms == pytest.approx(here.rms, rel=1e-3)


@given(seeds, st.sampled_from([0, 3, 40]))
def test_a_direction_is_told_by_the_nearest_axis(seed: int, degrees: int) -> None:
    rng = np.random.default_rng(seed)
    k, sign = rng.integers(3), rng.choice([-1, 1])
    about = np.eye(3)[(k + rng.integers(1, 3)) % 3]
    axis = sign * Rotation.from_rotvec(np.radians(degrees) * about).apply(np.eye(3)[k])
    letter = ("-" if sign < 0 else "") + "xyz"[k]
    expected = {0: letter, 3: f"{letter} turned by 3.0 degrees"}.get(degrees)
    assert axis_text(axis) == expected or degrees == 40
    if degrees == 40:
        numbers = [float(part) for part in axis_text(axis)[1:-1].split(",")]
        np.testing.assert_allclose(numbers, axis, atol=1e-3)


@given(seeds)
def test_a_text_makes_the_same_constraint(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axes, point = np.round(rng.normal(size=(2, 3)), 5), np.round(rng.normal(size=3), 5)
    assume(np.linalg.norm(np.cross(*axes)) > 0.2 * np.prod(np.linalg.norm(axes, axis=1)))
    for constraint in (
        ns.Blade(axes[0].tolist(), axes[1].tolist(), point.tolist()),
        ns.Needle("-x", 0.25, reference_point=point.tolist()),
        ns.Wheel(normal=None),
        ns.constraints.ForwardOnly(edge="-x", minimum=0.5),
        ns.constraints.PlaneContact(point.tolist(), axes[0].tolist()),
    ):
        assert parse_constraint(constraint_text(constraint)) == constraint


def plane(off: float, holds: bool, **values: Any) -> Place:
    table = ns.constraints.PlaneContact((0, 0, 0.05), (0, 0, 1), (0.01, 0, 0))
    return Place(
        kind="plane",
        constraints=(table,),
        rows=1,
        residual=off,
        holdout=1.2 * off,
        ratio=1.1,
        holds=holds,
        values={"point": np.array([0, 0, 0.05]), "normal": np.array([0.0, 0.0, 1.0])} | values,
        errors={"point": 1e-4, "normal": 1e-3},
        notes=("plane: a note",) if holds else (),
    )


def test_places_are_told_with_the_tools_rule_and_without(
    blade: Identified, nothing: Identified
) -> None:
    held, not_held = plane(1e-4, True), plane(3e-2, False, radius=0.06)
    both = replace(
        blade,
        constraints=(*blade.constraints, *held.constraints),
        kinds=("blade", "plane-contact"),
        surfaces=(held, not_held),
    )
    said = str(both)
    assert said.startswith("blade and plane in 3 recordings\n")
    assert (
        "  plane: point (0, 0, 50) mm, normal (0, 0, 1); off by 0.1 mm (rms), 0.12 where it was "
        "not fitted\n  plane: a note"
    ) in said
    assert said.count("plane:") == 2
    alone = replace(
        nothing, constraints=held.constraints, kinds=("plane-contact",), surfaces=(held, not_held)
    )
    assert str(alone).startswith("plane in 3 recordings\n  plane: point")
    data = json.loads(json.dumps(alone.to_dict(), allow_nan=False))
    assert [place["holds"] for place in data["surfaces"]] == [True, False]
    assert parse_constraint(data["constraints"][0]) == held.constraints[0]
    for found in (both, alone):
        *_, places = found.plot().axes
        drawn = [float(line.get_xdata()[0]) for line in places.lines]
        np.testing.assert_allclose(drawn, [0.12, 36])


# ---------------------------------------------------------------- the command


def written(found: Identified, folder: Path) -> list[Path]:
    """Files of the recordings in which something was found."""
    return [write_recording(each, folder / f"{each.name}.csv") for each in found.recordings]


def pasted(line: str) -> list[str]:
    return shlex.split(line)


def test_the_options_that_it_prints_say_the_same(
    noslip: Callable[..., Any], tmp_path: Path, blade: Identified
) -> None:
    files = written(blade, tmp_path)
    result = noslip("identify", *files, "--figure", tmp_path / "why.png")
    assert result.code == 0
    assert (tmp_path / "why.png").read_bytes()[:4] == b"\x89PNG"
    here, there = [line for line in result.out.splitlines() if line.startswith("--")]
    slips = []
    for line in (here, there):
        checked = json.loads(noslip("check", files[0], *pasted(line), "--json").out)
        slips.append(checked[0]["constraints"][0]["rms"])
    assert slips[0] == pytest.approx(slips[1], rel=1e-3)
    # A frame that was given is part of the one to give.
    moved = noslip("identify", *files, "--tool-frame", "0.03,0.02,0,0.5,0.5,0.5,0.5")
    again = [line for line in moved.out.splitlines() if line.startswith("--tool-frame")]
    one, other = (np.array(pasted(line)[1].split(","), dtype=float) for line in (there, again[0]))
    np.testing.assert_allclose(one[3:], other[3:], atol=5e-3)
    # Each is the point nearest to its own origin along the lateral axis.
    lateral = Rotation.from_quat(one[3:], scalar_first=True).apply([0, 1, 0])
    np.testing.assert_allclose(np.cross(lateral, one[:3] - other[:3]), 0, atol=2e-4)


def test_a_tool_that_is_known_is_placed(
    noslip: Callable[..., Any], tmp_path: Path, blade: Identified
) -> None:
    files = written(blade, tmp_path)
    known = ("identify", *files, "--constraint", "blade")
    told = noslip(*known)
    assert told.code == 0 and "blade, taken as known, in " in told.out
    line = told.out.splitlines()[-1]
    numbers = np.array(pasted(line)[1].split(","), dtype=float)
    placed = tool_frame(blade.recordings, ns.Blade())
    np.testing.assert_allclose(numbers[:3], placed.matrix[:3, 3], atol=1e-8)
    turn = Rotation.from_quat(numbers[3:], scalar_first=True).as_matrix()
    np.testing.assert_allclose(turn, placed.matrix[:3, :3], atol=1e-8)
    np.testing.assert_allclose(
        json.loads(noslip(*known, "--json").out)["matrix"], placed.matrix, atol=1e-12
    )
    # In that frame the tool slips less; what is left is the noise, which the fit takes off.
    slips = [
        json.loads(noslip("check", files[0], *options, "--json").out)[0]["constraints"][0]
        for options in (pasted(line), ("--constraint", "blade"))
    ]
    assert slips[0]["slip_share"] < 0.4 * slips[1]["slip_share"]
    assert "leave --constraint out" in noslip(*known, "--figure", tmp_path / "why.png").err
    assert "Blade, a Needle or a Wheel" in noslip(*known[:-1], "tool-axis").err


def test_it_is_an_exit_code_and_json(
    noslip: Callable[..., Any], tmp_path: Path, nothing: Identified
) -> None:
    files = written(nothing, tmp_path)
    result = noslip("identify", *files, "--json")
    assert result.code == 1
    assert json.loads(result.out)["constraints"] == []
    plain = noslip("identify", *files)
    assert plain.code == 1 and "--constraint" not in plain.out
    assert noslip("identify", *files, "--figure", tmp_path / "why.txt").code == 2


# ---------------------------------------------------------------- the figure


def test_the_figure_says_the_finding_and_carries_it(blade: Identified, tmp_path: Path) -> None:
    figure = blade.plot()
    title = figure.get_suptitle().replace("\n", " ")
    assert title.startswith("Blade in 3 recordings: lateral axis y turned by")
    slip, point, time, *_ = figure.axes
    drawn = sorted(x for line in slip.lines if line.get_marker() == "o" for x in line.get_xdata())
    shares = [100 * s for row in blade.candidates for s in (row.given, row.holdout)]
    np.testing.assert_allclose(drawn, sorted(max(share, 1e-2) for share in shares))
    assert point.get_xlabel() == "x of the body (mm)"
    assert point.get_ylabel() == "z of the body (mm)"
    assert blade.reference_point is not None
    ends = [line.get_ydata()[-1] for line in time.lines]
    assert len(ends) == 2 * len(blade.recordings)
    # Noise aside, the point does not slip; the origin does.
    assert max(map(abs, ends[1::2])) < 1 < max(map(abs, ends[::2]))
    assert [path.name for path in save_figure(figure, tmp_path / "why.svg")] == ["why.svg"]


def test_the_region_is_that_of_the_covariance(blade: Identified) -> None:
    row, (_, ax, *_) = blade.rows[0], blade.plot().axes
    (region,) = [line for line in ax.lines if len(line.get_xdata()) > 50]
    legend = [text.get_text() for text in ax.figure.legends[0].get_texts()]
    (name,) = [text for text in legend if text.startswith("95 % region")]
    times = float((re.findall(r", (\d+) times", name) or ["1"])[0])
    away = (region.get_xydata() - 1e3 * row.point[[0, 2]]) / 1e3 / times
    covariance = row.point_covariance[np.ix_([0, 2], [0, 2])]
    distance = np.einsum("ki,ij,kj->k", away, np.linalg.inv(covariance), away)
    # Of 100,000 points drawn from it, 95 % lie within.
    drawn = np.random.default_rng(0).multivariate_normal([0, 0], covariance, 100_000)
    inside = np.einsum("ki,ij,kj->k", drawn, np.linalg.inv(covariance), drawn) < distance.max()
    assert inside.mean() == pytest.approx(0.95, abs=0.005)
    np.testing.assert_allclose(distance, distance[0], rtol=1e-6)


def test_a_point_of_which_nothing_is_told_is_not_drawn(blade: Identified) -> None:
    untold = replace(blade, rows=tuple(replace(row, unknown=np.eye(3)) for row in blade.rows))
    _, point, *_ = untold.plot().axes
    assert point.get_title() == "where the point is: not told"
    assert len(point.lines) == 1
    assert "nothing tells where its point is: turn it in other ways as it moves" in str(untold)


@pytest.mark.parametrize("name", ["blade", "nothing"])
def test_all_that_it_says_is_inside(request: pytest.FixtureRequest, name: str) -> None:
    figure = identified_constraint(request.getfixturevalue(name))
    figure.canvas.draw()
    page = figure.bbox
    for text in [*(label for ax in figure.axes for label in ax.get_yticklabels()), *figure.texts]:
        box = text.get_window_extent()
        assert page.x0 <= box.x0 and box.x1 <= page.x1, text.get_text()
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert page.x0 <= box.x0 and box.x1 <= page.x1 and page.y0 <= box.y0


def test_the_way_slipped_is_that_of_the_point() -> None:
    recording = sensed_blade(5, (0.6, 0.6, 0.9))
    way: Floats = way_slipped(recording, np.array([0.0, 1.0, 0.0]), BLADE_AT)
    tips = recording.positions + recording.rotations.apply(BLADE_AT)
    middles = recording.step_middles()[2].apply([0, 1, 0])
    expected = np.append(0.0, np.cumsum(np.sum(middles * np.diff(tips, axis=0), axis=1)))
    np.testing.assert_allclose(way, expected, atol=1e-5)
