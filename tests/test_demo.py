"""The demo's files, judged from the CSV rows alone."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from measures import rms

pytestmark = pytest.mark.slow
EXCISIONS = range(1, 9)


class Rows:
    """A CSV as arrays, read without noslip."""

    def __init__(self, path: Path) -> None:
        with path.open() as file:
            reader = csv.reader(file)
            assert next(reader) == ["t", "x", "y", "z", "qw", "qx", "qy", "qz"]
            table = np.array([[float(cell) for cell in row] for row in reader])
        self.t, self.p, q = table[:, 0], table[:, 1:4], table[:, 4:8]
        np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-12)
        self.q = q
        # In the middle of each step: the sum of two unit quaternions halves the turn between them.
        sides = np.sign(np.sum(q[1:] * q[:-1], axis=1))[:, None]
        middle = q[1:] + sides * q[:-1]
        w, x, y, z = (middle / np.linalg.norm(middle, axis=1)[:, None]).T
        self.edge = np.column_stack(
            [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
        )
        self.lateral = np.column_stack(
            [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)]
        )
        self.velocity = np.diff(self.p, axis=0) / np.diff(self.t)[:, None]

    @property
    def slip(self) -> float:
        return float(np.abs(np.sum(self.lateral * self.velocity, axis=1)).max())

    @property
    def forward(self) -> float:
        return float(np.sum(self.edge * self.velocity, axis=1).min())

    def angular_velocity(self) -> np.ndarray:
        """Twice the vector part of q' q*, over its sine, times the angle."""
        a, b = self.q[1:], self.q[:-1]
        scalar = np.sum(a * b, axis=1)
        vector = (
            -a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])
        ) * np.sign(scalar)[:, None]
        size = np.linalg.norm(vector, axis=1)
        angle = 2 * np.arctan2(size, np.abs(scalar))
        return vector * (angle / np.maximum(size, 1e-300) / np.diff(self.t))[:, None]

    def angle_to(self, other: Rows) -> np.ndarray:
        inner = np.abs(np.sum(self.q * other.q, axis=1))
        return np.degrees(2 * np.arccos(np.clip(inner, 0, 1)))


@pytest.fixture(scope="module")
def example(demo) -> dict[str, Rows]:
    folder = demo / "numerical_example"
    names = ("demonstration", "regular", "constrained", "optimized")
    return {name: Rows(folder / f"{name}.csv") for name in names}


def test_demonstration_is_the_papers_formula(example):
    d = example["demonstration"]
    assert len(d.t) == 1000
    np.testing.assert_allclose(np.diff(d.t), 1e-3)
    np.testing.assert_allclose(d.p[:, 0], np.sin(np.pi * d.t) ** 2, atol=1e-15)
    np.testing.assert_allclose(d.p[:, 1], np.sin(np.pi * d.t / 2) ** 3, atol=1e-15)


def test_optimized_cannot_slip_and_follows_the_demonstration_gently(example):
    d, o = example["demonstration"], example["optimized"]
    assert o.slip <= 1e-10
    assert o.forward >= 0
    distance = np.linalg.norm(o.p - d.p, axis=1)
    assert rms(distance) <= 0.17e-3
    assert distance[-1] <= 1e-6
    assert rms(o.angle_to(d)) <= 67
    angular = o.angular_velocity()
    assert np.linalg.norm(angular, axis=1).max() <= 12
    assert np.linalg.norm(np.diff(angular, axis=0), axis=1).max() / 1e-3 <= 250


def test_regular_follows_and_slips_as_demonstrated(example):
    d, r = example["demonstration"], example["regular"]
    assert rms(np.linalg.norm(r.p - d.p, axis=1)) <= 1e-6
    assert r.slip == pytest.approx(d.slip, rel=1e-3)
    assert d.slip > 1


def test_constrained_keeps_orientation_and_constraint_and_loses_the_path(example):
    d, c = example["demonstration"], example["constrained"]
    assert c.slip <= 1e-10
    assert c.angle_to(d).max() <= 0.01
    assert rms(np.linalg.norm(c.p - d.p, axis=1)) > 0.1


@pytest.mark.parametrize("number", EXCISIONS)
def test_trained_excision_follows_its_demonstration_without_slip(demo, number):
    demonstration = Rows(demo / "excision" / f"demonstration_{number}.csv")
    trained = Rows(demo / "excision" / f"trained_{number}.csv")
    assert demonstration.slip > 1e-3
    assert trained.slip <= 1e-10
    # Steps of a rollout are the demonstration's, or a fraction of them.
    share = (len(trained.t) - 1) // (len(demonstration.t) - 1)
    times, positions = trained.t[::share], trained.p[::share]
    np.testing.assert_allclose(times, demonstration.t - demonstration.t[0], atol=1e-9)
    np.testing.assert_allclose(demonstration.p[0], 0.0)
    assert rms(np.linalg.norm(positions - demonstration.p, axis=1)) <= 0.5e-3


def test_summary_agrees_with_the_files_and_says_synthetic(demo, example):
    summary = json.loads((demo / "summary.json").read_text())
    assert summary["excision"]["synthetic"] is True
    optimized = summary["numerical_example"]["optimized"]
    assert optimized["residual_peak"] == pytest.approx(example["optimized"].slip, rel=0.5)
    angle = example["optimized"].angle_to(example["demonstration"])
    assert np.degrees(optimized["rotation_rms"]) == pytest.approx(rms(angle), rel=1e-6)
    assert len(summary["excision"]["trials"]) == 8


def test_the_session_holds_the_recordings_and_its_cuts_are_the_true_ones(demo):
    told = json.loads((demo / "summary.json").read_text())["excision"]["session"]
    session = Rows(demo / "excision" / "session.csv")
    kept = [cut for cut in told["intervals"] if cut["reason"] is None]
    assert told["found"] == list(EXCISIONS)
    for number, cut, (start, end) in zip(EXCISIONS, kept, told["cuts"], strict=True):
        assert max(abs(cut["start"] - start), abs(cut["end"] - end)) < 0.6
        recording = Rows(demo / "excision" / f"recording_{number}.csv")
        first = int(np.searchsorted(session.t, recording.t[0] - 1e-9))
        np.testing.assert_array_equal(session.p[first:][: len(recording.p)], recording.p)
        assert recording.t[0] < start < end < recording.t[-1]


ROWS = {
    "demonstration, and regular primitive": ("demonstration", "regular"),
    "constrained at run time only": ("constrained",),
    "**noslip: projected, then constrained**": ("optimized",),
}


def test_the_readme_tells_the_numbers_of_the_summary(demo):
    """In mm, m/s and rad/s, as rounded there; residuals that are rounding by their size."""
    summary = json.loads((demo / "summary.json").read_text())["numerical_example"]
    readme = (Path(__file__).resolve().parents[1] / "README.md").read_text()
    for row, motions in ROWS.items():
        told = re.search(rf"^\| {re.escape(row)} \|(.*)\|$", readme, re.MULTILINE)[1]
        rms_told, slip, turning = (float(cell.strip(" *").split()[0]) for cell in told.split("|"))
        found = [summary[name] for name in motions]
        assert max(m["position_rms"] for m in found) * 1e3 == pytest.approx(rms_told, rel=0.05)
        for motion in found:
            assert motion["residual_peak"] == pytest.approx(slip, rel=0.05, abs=1e-12)
            assert motion["angular_speed_peak"] == pytest.approx(turning, rel=0.05)


def test_figures_are_there_in_both_formats(demo):
    for folder, count in (("numerical_example", 2), ("excision", 4)):
        pictures = sorted((demo / folder).glob("*.png"))
        assert len(pictures) == count
        for picture in pictures:
            assert picture.read_bytes().startswith(b"\x89PNG")
            assert b"<svg" in picture.with_suffix(".svg").read_bytes()[:2000]
