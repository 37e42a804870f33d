"""``noslip learn --each``: many recordings, one table."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import noslip as ns
from motions import planar_cut
from noslip.result_table import read_results
from waiting import PATIENCE, heed_ctrl_c, until

LEARN = ("learn", "--each", "--constraint", "blade", "--basis-functions", "15")


def write(folder: Path, count: int) -> Path:
    """Curved cuts that slip a little sideways."""
    for k in range(count):
        cut = planar_cut(0.4 + 0.01 * k, wavering=0.1, count=60)
        cut.to_csv(folder / f"cut_{k:03}.csv")
    return folder


@pytest.fixture
def runs(tmp_path) -> Path:
    return write(tmp_path / "runs", 3)


def test_a_primitive_each_and_one_table(noslip, runs, tmp_path):
    out = tmp_path / "out"
    result = noslip(*LEARN, runs, "--out", out)
    assert (result.code, result.err) == (0, ""), "quiet when piped"
    learned, residual, wrote = result.out.splitlines()
    assert learned == "learned 3 of 3 recordings"
    assert residual.startswith("residual of their motions: below 1e-9 (")
    assert wrote == f"wrote {out} and {out / 'results.csv'}"
    for row in read_results(out / "results.csv"):
        motion = ns.load_primitive(row.primitive).rollout()
        assert ns.check(motion, ns.Blade(), tolerance=1e-9).satisfied
    again = noslip(*LEARN, runs, "--out", out)
    assert again.out.splitlines()[0] == "learned 3 of 3 recordings, 3 of them before"


def test_failures_are_listed_a_line_each_and_the_rest_finished(noslip, runs, tmp_path):
    out, table = tmp_path / "out", tmp_path / "tables" / "cuts.csv"
    (runs / "broken.csv").write_text("t,x,y,theta\n0,0,0,nonsense\n")
    (runs / "notes.csv").write_bytes(b"\xff\xfe\x00")
    (runs / "empty.npz").write_bytes(b"")
    (runs / "gone.csv").symlink_to(tmp_path / "missing.csv")
    result = noslip(*LEARN, str(runs / "*"), "--out", out, "--table", table)
    assert result.code == 1 and result.err == ""
    failed = [line for line in result.out.splitlines() if line.startswith("FAILED ")]
    assert len(failed) == 4
    for line, name in zip(
        failed, ("broken.csv", "empty.npz", "gone.csv", "notes.csv"), strict=True
    ):
        assert line.startswith(f"FAILED {runs / name}: ")
    assert "learned 3 of 7 recordings" in result.out
    rows = {row.name: row for row in read_results(table)}
    assert len(rows) == 7 and not (out / "results.csv").exists()
    assert "line 2, column theta" in rows["broken"].message
    assert sorted(path.stem for path in out.iterdir()) == ["cut_000", "cut_001", "cut_002"]


def test_a_file_that_may_not_be_read_is_a_failure(noslip, runs, tmp_path):
    locked = runs / "cut_001.csv"
    locked.chmod(0)
    if os.access(locked, os.R_OK):
        # Whoever may read everything meets a folder in the file's place instead.
        locked.unlink()
        locked.mkdir()
    result = noslip(*LEARN, *sorted(runs.iterdir()), "--out", tmp_path / "out")
    assert result.code in (1, 2) and str(locked) in result.out + result.err


def test_changed_settings_are_learned_again(noslip, runs, tmp_path):
    out = tmp_path / "out"

    def kept(*options: object) -> int:
        result = noslip(*LEARN, runs, "--out", out, "--json", *options)
        assert result.code == 0
        return json.loads(result.out)["kept"]

    assert kept() == 0
    assert kept("--jobs", 2) == 3
    assert kept("--relative") == 0
    assert kept("--relative", "--rotation-smoothing", 1e-5) == 0
    assert kept("--relative", "--rotation-smoothing", 1e-5) == 3
    assert kept("--constraint", "speed-limit(speed=0.08)") == 0


def test_json_tells_what_the_table_does(noslip, runs, tmp_path):
    (runs / "broken.csv").write_text("nothing\n")
    result = noslip(*LEARN, runs, "--out", tmp_path / "out", "--json")
    assert result.code == 1
    told = json.loads(result.out)
    assert told["failed"] == 1 and told["table"] == str(tmp_path / "out" / "results.csv")
    assert [row["name"] for row in told["recordings"]] == [
        "broken",
        "cut_000",
        "cut_001",
        "cut_002",
    ]
    assert told["recordings"][1]["holds"] is True


def test_parquet(noslip, runs, tmp_path):
    pytest.importorskip("pyarrow", reason="needs noslip[tables]")
    table = tmp_path / "cuts.parquet"
    assert noslip(*LEARN, runs, "--out", tmp_path / "out", "--table", table).code == 0
    assert [row.name for row in read_results(table)] == ["cut_000", "cut_001", "cut_002"]
    told = noslip(*LEARN, runs, "--out", tmp_path / "out", "--table", table).out
    assert "3 of them before" in told


def test_constraints_of_ones_own_go_to_processes(noslip, runs, tmp_path):
    (tmp_path / "mine.py").write_text(
        "import noslip as ns\n"
        "@ns.velocity_constraint\n"
        "def straight(motion):\n"
        "    return motion.rotation[:, 1].T @ motion.linear_velocity\n"
    )
    own = ("learn", "--each", "--constraint", f"{tmp_path / 'mine.py'}:straight", "--jobs", 2)
    result = noslip(*own, runs, "--out", tmp_path / "out", "--basis-functions", 15)
    assert result.code == 0, result.out + result.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--each", "{empty}", "--out", "{out}"), "no recording in this folder"),
        (("--each", "{runs}/*.npz", "--out", "{out}"), "no file matches"),
        (("--each", "{runs}", "{copy}/cut_000.csv", "--out", "{out}"), "cut_000.json, as that of"),
        (("--each", "{runs}", "--out", "{runs}/cut_000.csv"), "give a folder"),
        (("--each", "{runs}", "--out", "{out}", "--table", "t.txt"), "ends in .csv or .parquet"),
        (("--each", "{runs}", "--out", "{out}", "--table", "{runs}/cut_000.csv"), "not a table"),
        (("--each", "{runs}", "--out", "{out}", "--jobs", "2", "--cluster", "x"), "--jobs"),
        (("{runs}/cut_000.csv", "--out", "{out}", "--table", "t.csv"), "--table: goes with --each"),
        (("{runs}/cut_000.csv", "--out", "{out}", "--cluster", "x"), "--cluster: goes with --each"),
        (("{runs}/cut_000.csv", "--out", "{out}", "--jobs", "2"), "--jobs: goes with --each"),
    ],
)
def test_bad_usage_is_one_line_and_writes_nothing(noslip, runs, tmp_path, arguments, said):
    places = {name: tmp_path / name for name in ("runs", "out", "empty", "copy")}
    places["empty"].mkdir()
    write(places["copy"], 1)
    result = noslip("learn", *(text.format(**places) for text in arguments))
    assert result.code == 2 and result.out == ""
    (line,) = result.err.splitlines()
    assert said in line
    assert not places["out"].exists()


def started(*arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "noslip", *map(str, arguments)]
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heed_ctrl_c,
    )


def wait_for_primitives(process: subprocess.Popen[str], out: Path, count: int) -> None:
    def written() -> bool:
        assert process.poll() is None
        return len(list(out.glob("*.json"))) >= count

    until(written, f"{count} primitives")


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_ctrl_c_leaves_a_whole_table_and_the_next_run_goes_on(noslip, tmp_path, jobs):
    runs, out = write(tmp_path / "runs", 40), tmp_path / "out"
    process = started(*LEARN, runs, "--out", out, "--jobs", jobs)
    wait_for_primitives(process, out, 10)
    os.killpg(process.pid, signal.SIGINT)  # As a terminal does: to all of its processes.
    told, error = process.communicate(timeout=PATIENCE)
    assert (process.returncode, told) == (130, "") and "Traceback" not in error
    rows = read_results(out / "results.csv")
    # What a worker had written and not yet told is learned again.
    assert 5 <= len(rows) < 40 and all(row.status == "learned" for row in rows)
    for path in out.glob("*.json"):
        ns.load_primitive(path)
    result = noslip(*LEARN, runs, "--out", out)
    assert result.code == 0
    assert f"learned 40 of 40 recordings, {len(rows)} of them before" in result.out


@pytest.mark.slow
def test_killed_it_leaves_no_process_and_nothing_half_written(tmp_path):
    psutil = pytest.importorskip("psutil", reason="comes with noslip[cluster]")
    runs, out = write(tmp_path / "runs", 200), tmp_path / "out"
    process = started(*LEARN, runs, "--out", out, "--jobs", 2)
    wait_for_primitives(process, out, 10)
    workers = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.communicate(timeout=PATIENCE)
    assert len(workers) >= 2
    assert not psutil.wait_procs(workers, timeout=PATIENCE)[1]
    read_results(out / "results.csv")
    for path in out.glob("*.json"):
        ns.load_primitive(path)


@pytest.mark.slow
def test_a_cluster_by_its_address(noslip, runs, tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs noslip[cluster]")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options, silence_logs=50) as local:
        address = local.scheduler_address
        result = noslip(*LEARN, runs, "--out", tmp_path / "out", "--cluster", address)
    assert result.code == 0, result.out + result.err
    assert "learned 3 of 3 recordings" in result.out
