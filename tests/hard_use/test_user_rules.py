"""A user's own rules that end the program, never end, or are too large: one line, and no file."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import pytest

import noslip as ns
from motions import planar_cut
from noslip.constraints import InMovingFrame, Instant, SurfaceContact
from noslip.constraints.catalog import parse_constraint
from noslip.constraints.declaration import MOST_OPERATIONS, MOST_ROWS
from noslip.constraints.system import ConstraintSystem
from noslip.errors import ConstraintError
from refusals import refusal
from waiting import PATIENCE, heed_ctrl_c, until

HEADER = "import os, sys\nimport casadi as ca\nimport noslip as ns\n"
RULE = HEADER + "@ns.velocity_constraint\ndef rule(motion):\n    "
OWN = HEADER + "class Own(ns.Constraint):\n    name = 'own'\n"
MOVED = "    def residual(self, motion):\n        return motion.linear_velocity[1]\n"


def rule_file(folder: Path, source: str) -> str:
    path = folder / "mine.py"
    path.write_text(source)
    return f"{path}:rule"


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "cut.csv"
    planar_cut().to_csv(path)
    return path


# -------------------------------------------------------------------- exits

ENDINGS = ["sys.exit()", "sys.exit(0)", "raise SystemExit(3)", "exit()", "raise GeneratorExit"]
PLACES = {
    "importing": HEADER + "{}\n",
    "the rule": RULE + "{}\n",
    "its class": OWN + MOVED + "    def __init__(self):\n        {}\nrule = Own\n",
    "its name": OWN.replace("name = 'own'", "@property\n    def name(self):\n        {}")
    + MOVED
    + "rule = Own()\n",
    "its relative motion": OWN
    + MOVED
    + "    def relative(self, motion):\n        {}\nrule = Own()\n",
    "its frame": HEADER
    + "def frame(t):\n    {}\nrule = ns.constraints.InMovingFrame(frame=frame)\n",
    "its surface": HEADER
    + "def surface(p):\n    {}\nrule = ns.constraints.SurfaceContact(surface)\n",
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("ending", ENDINGS)
def test_a_rule_that_exits_is_an_error_of_that_rule(
    noslip: Callable[..., Any], recording: Path, tmp_path: Path, place: str, ending: str
) -> None:
    rule = rule_file(tmp_path, PLACES[place].format(ending))
    out = tmp_path / "cut.json"
    told = noslip("learn", recording, "--constraint", rule, "--out", out)
    assert told.code == 2
    assert told.err.startswith("noslip: error: ") and told.err.count("\n") == 1
    assert "Exit" in told.err
    assert told.out == "" and not out.exists()


def test_what_a_rule_raises_is_told_with_its_kind(tmp_path: Path) -> None:
    rule = rule_file(tmp_path, RULE + "return {}['speed']\n")
    message = refusal(ConstraintError, lambda: ConstraintSystem(parse_constraint(rule)))
    assert "'rule' cannot be evaluated: KeyError: 'speed'" in message


@pytest.mark.parametrize("name", ["", "two\nlines", "\x1b[2Jgone", "a\rb", "\u202eabc", "x" * 300])
def test_names_that_cannot_be_printed_are_refused(name: str) -> None:
    if name:
        declare = ns.velocity_constraint(name=name)
        constraint = declare(lambda motion: motion.linear_velocity[0])
    else:
        constraint = ns.velocity_constraint(lambda motion: motion.linear_velocity[0])
        constraint.name = name
    message = refusal(ConstraintError, ConstraintSystem, [constraint])
    assert "its name must be a text of 1 to 200 characters" in message


# -------------------------------------------------------------------- sizes


def nested(depth: int) -> ns.Constraint:
    @ns.velocity_constraint(name="nested")
    def rule(motion: Instant) -> Any:
        value = motion.linear_velocity[1]
        for _ in range(depth):
            value = ca.sin(value) + motion.position[0] * value
        return value

    return rule


def rows(count: int) -> ns.Constraint:
    @ns.velocity_constraint(name="many")
    def rule(motion: Instant) -> Any:
        return [motion.linear_velocity[1] * (k + 1) for k in range(count)]

    return rule


def refused_at_once(make: Callable[[], Any]) -> str:
    # By the processor's time of this thread, so that a loaded machine changes nothing.
    before = time.thread_time()
    message = refusal(ConstraintError, make)
    assert time.thread_time() - before < 10
    return message


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (lambda: ConstraintSystem(nested(3000)), "operations, at most 2000"),
        (lambda: ConstraintSystem(nested(20_000)), "operations, at most 2000"),
        (lambda: ConstraintSystem([nested(400), nested(401)]), "operations, at most 2000"),
        (lambda: ConstraintSystem(rows(2000)), "2000 rows, at most 64"),
        (lambda: ConstraintSystem([ns.Blade()] * 300), "rows, at most 64"),
        (lambda: ConstraintSystem([rows(40), rows(30)]), "70 rows, at most 64"),
        (lambda: ConstraintSystem(InMovingFrame(nested(3000))), "operations, at most 2000"),
        (lambda: SurfaceContact("+".join(["x*y"] * 5000)), "longer than 10000 characters"),
        (lambda: ConstraintSystem(SurfaceContact("+".join(
            f"sin(cos(tan(x*{k})*y)*z)*x" for k in range(300)))), "operations, at most 2000"),
    ],
)  # fmt: skip
def test_what_would_never_end_is_refused_with_what_is_held(
    make: Callable[[], Any], found: str
) -> None:
    message = refused_at_once(make)
    assert found in message
    assert len(message) < 400


def test_what_is_held_is_learned() -> None:
    """The budgets refuse nothing that is in them: rows, and operations."""
    assert ConstraintSystem([ns.Blade()] * MOST_ROWS).size == MOST_ROWS
    system = ConstraintSystem(nested(MOST_OPERATIONS // 4 - 2))
    assert system.function.n_instructions() > MOST_OPERATIONS / 2


# -------------------------------------------------------------------- Ctrl-C

ENDLESS = {
    "importing": HEADER + "{}while True:\n    pass\n",
    "the rule": RULE + "{}\n    while True:\n        pass\n",
    "a growing graph": RULE
    + "{}\n    x = motion.linear_velocity[0]\n    while True:\n        x = ca.sin(x)\n",
}


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("where", ENDLESS)
def test_a_rule_that_never_ends_is_interrupted(tmp_path: Path, recording: Path, where: str) -> None:
    started = tmp_path / "started"
    rule = rule_file(tmp_path, ENDLESS[where].format(f"open({str(started)!r}, 'w').close()\n"))
    out = tmp_path / "cut.json"
    source = Path(ns.__file__).parents[1]
    before = set(tmp_path.iterdir())
    running = subprocess.Popen(
        [sys.executable, "-m", "noslip", "learn", str(recording), "--constraint", rule]
        + ["--out", str(out)],
        env={**os.environ, "PYTHONPATH": str(source)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_ctrl_c,
    )

    def runs() -> bool:
        assert running.poll() is None, running.communicate()
        return started.exists()

    try:
        until(runs, "the rule to be called")
        running.send_signal(signal.SIGINT)
        shown, said = running.communicate(timeout=PATIENCE)
    finally:
        running.kill()
    assert running.returncode == 130
    # Typer says nothing of its own.
    assert said.strip() in ("", "noslip: interrupted") and shown == ""
    left = {path.name for path in set(tmp_path.iterdir()) - before}
    assert left <= {"started", "__pycache__"}
