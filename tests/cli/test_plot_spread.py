"""``noslip plot --show spread``: what it draws, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest

import noslip as ns
from motions import planar_cut
from noslip.figures import learned_spread, save_figure


@pytest.fixture(scope="module")
def cuts(tmp_path_factory) -> list[Path]:
    folder = tmp_path_factory.mktemp("cuts")
    return [planar_cut(0.5 + 0.1 * k).to_csv(folder / f"cut_{k}.csv") for k in range(3)]


@pytest.fixture
def primitive(noslip, cuts, tmp_path) -> Path:
    out = tmp_path / "cut.json"
    assert noslip("learn", *cuts, "--constraint", "blade", "--out", out).code == 0
    return out


def test_it_draws_the_spread_that_learn_kept(noslip, primitive, tmp_path):
    out = tmp_path / "spread.svg"
    result = noslip("plot", primitive, "--show", "spread", "--out", out)
    assert (result.code, result.out) == (0, f"wrote {out}\n")
    figure = learned_spread(ns.load_primitive(primitive))
    assert figure.get_suptitle().startswith("3 demonstrations agree least ")
    (expected,) = save_figure(figure, tmp_path / "expected.svg")
    assert out.read_bytes() == expected.read_bytes()


def test_the_title_can_be_given(noslip, primitive, tmp_path):
    out = tmp_path / "spread.svg"
    asked = ("plot", primitive, "--show", "spread", "--title", "mine", "--out", out)
    assert noslip(*asked).code == 0
    (expected,) = save_figure(
        learned_spread(ns.load_primitive(primitive), title="mine"), tmp_path / "expected.svg"
    )
    assert out.read_bytes() == expected.read_bytes()


def test_a_primitive_of_one_demonstration_has_none(noslip, cuts, tmp_path):
    single, out = tmp_path / "single.json", tmp_path / "spread.png"
    assert noslip("learn", cuts[0], "--out", single).code == 0
    result = noslip("plot", single, "--show", "spread", "--out", out)
    assert result.code == 2
    assert "no spread" in result.err and "several demonstrations" in result.err
    assert not out.exists()


@pytest.mark.parametrize(
    "others", [["{file}"], ["{second}"], ["--constraint", "blade"], ["{file}", "--rate", "60"]]
)
def test_it_is_of_one_primitive_alone(noslip, primitive, cuts, others, tmp_path):
    second = ns.load_primitive(primitive).save(tmp_path / "second.json")
    filled = [other.format(file=cuts[0], second=second) for other in others]
    out = tmp_path / "spread.png"
    result = noslip("plot", primitive, *filled, "--show", "spread", "--out", out)
    assert result.code == 2
    assert "--show spread: give one primitive" in result.err
    assert not out.exists()


def test_a_recording_has_no_spread(noslip, cuts, tmp_path):
    out = tmp_path / "spread.png"
    result = noslip("plot", cuts[0], "--show", "spread", "--out", out)
    assert result.code == 2 and "--show spread" in result.err
    assert not out.exists()
