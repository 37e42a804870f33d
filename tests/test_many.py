"""Many recordings: what is learned, kept, done again, and what dies on the way."""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
import signal
import sys
import threading
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import fields, replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import noslip as ns
from motions import planar_cut
from noslip.many import cluster, executors, find_recordings, learn_each, worker
from noslip.many import settings as run_settings
from noslip.merit import figures_of_merit
from noslip.result_table import RecordingResult, read_results, write_results

FEW = {"basis_functions": 15}


def recording(number: int) -> ns.PoseTrajectory:
    """A curved cut that slips a little sideways."""
    bend, slip = np.random.default_rng(number).uniform([0.3, 0.05], [0.8, 0.2])
    return planar_cut(bend, wavering=slip, count=60)


def write(folder: Path, count: int) -> Path:
    for k in range(count):
        recording(k).to_csv(folder / f"cut_{k:02}.csv")
    return folder


@pytest.fixture
def runs(tmp_path) -> Path:
    return write(tmp_path / "runs", 4)


def without_times(result: RecordingResult) -> RecordingResult:
    return replace(result, seconds=None)


# ---------------------------------------------------------------- what is learned


def test_each_primitive_is_that_of_learning_its_recording_alone(runs, tmp_path):
    out = tmp_path / "out"
    learned = learn_each(runs, ns.Blade(), out=out, **FEW)
    assert [result.name for result in learned.results] == [f"cut_{k:02}" for k in range(4)]
    for result in learned.results:
        (given,) = ns.load_demonstrations(result.recording)
        alone = ns.learn(given, ns.Blade(), **FEW).save(tmp_path / "alone.json")
        assert Path(result.primitive).read_bytes() == alone.read_bytes()


def test_figures_are_those_of_the_primitive_in_the_file(runs, tmp_path):
    # Graphs are shared between recordings; read back, each primitive builds its own.
    constraints = [ns.Blade(), ns.SpeedLimit(0.06)]
    learned = learn_each(runs, constraints, out=tmp_path / "out", **FEW)
    for result in learned.results:
        (given,) = ns.load_demonstrations(result.recording)
        dmp = ns.load_primitive(result.primitive)
        motion = dmp.rollout()
        figures = figures_of_merit(motion, given, constraints)
        assert result.residual_peak == figures.residual_peak
        assert result.position_rms_m == figures.position_rms
        assert result.slowest_edge_speed_m_s == figures.slowest_edge_speed
        (margin,) = figures.least_margins.values()
        assert result.least_margins == f"speed-limit={margin:.6g}"
        assert result.holds == ns.check(motion, constraints).satisfied
        before = ns.check(given, ns.Blade())["blade"]
        assert result.recording_residual_peak == pytest.approx(before.peak)
        assert result.recording_residual_peak > 1e-3 > 1e-9 > result.residual_peak
        linear = np.linalg.norm(motion.constraint_forces[:, :3], axis=1)
        assert result.force_peak_m_s2 == linear.max()
        turned = (motion.rotations[-1].inv() * given.rotations[-1]).magnitude()
        assert result.end_rotation_error_deg == pytest.approx(np.degrees(turned))
        (record,) = dmp.record
        assert (result.iterations, result.smoothing) == (record.iterations, record.smoothing)
        assert result.position_change_m == record.position_change
        assert result.rotation_change_deg == pytest.approx(np.degrees(record.rotation_change))
        assert (result.samples, result.duration_s) == (len(given), given.duration)
        assert 0 < result.seconds < 60


def test_preparation_and_options_reach_the_worker(runs, tmp_path):
    learned = learn_each(
        runs / "cut_00.csv",
        ns.Blade(),
        out=tmp_path / "out",
        preparation={"rate": 50.0, "relative": True, "tool_frame": np.array([0.01, 0, 0])},
        project_start="velocity",
        metric=np.full(6, 2.0),
        **FEW,
    )
    given = ns.prepare(
        ns.load_demonstrations(runs / "cut_00.csv")[0],
        rate=50.0,
        relative=True,
        tool_frame=[0.01, 0, 0],
    )
    options = {"metric": [2.0] * 6, **FEW}
    alone = ns.learn(given, ns.Blade(), project_start="velocity", **options)
    path = alone.save(tmp_path / "alone.json")
    assert Path(learned.results[0].primitive).read_bytes() == path.read_bytes()


def test_without_constraints_and_without_a_folder_only_figures_are_kept(runs, tmp_path):
    learned = learn_each(runs, **FEW)
    assert learned.table is None and not learned.failed
    assert {result.primitive for result in learned.results} == {""}
    assert {result.iterations for result in learned.results} == {0}
    assert all(result.position_rms_m < 1e-3 for result in learned.results)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["runs"]


def test_a_failure_stops_no_other_and_leaves_no_primitive(runs, tmp_path):
    out = tmp_path / "out"
    learn_each(runs, ns.Blade(), out=out, **FEW)
    (runs / "cut_01.csv").write_text("t,x,y,theta\n0,0,0,nonsense\n")
    learned = learn_each(runs, ns.Blade(), out=out, **FEW)
    (failure,) = learned.failed
    assert (failure.name, failure.primitive, failure.samples) == ("cut_01", "", None)
    assert failure.message.startswith(f"{runs / 'cut_01.csv'}: line 2, column theta")
    assert learned.kept == 3
    assert not (out / "cut_01.json").exists() and (out / "cut_02.json").exists()


# ---------------------------------------------------------------- going on


def test_what_is_learned_is_kept_until_content_or_settings_change(runs, tmp_path):
    out = tmp_path / "out"

    def kept(**options) -> int:
        return learn_each(runs, ns.Blade(), out=out, **{**FEW, **options}).kept

    assert kept() == 0
    assert kept() == 4
    assert kept(alpha=25.0) == 4, "the default, named"
    assert kept(preparation={"relative": False}) == 4
    (out / "cut_03.json").unlink()
    assert kept() == 3
    recording(9).to_csv(runs / "cut_02.csv")
    assert kept() == 3
    assert kept(preparation={"relative": True}) == 0
    assert kept(basis_functions=16) == 0
    assert learn_each(runs, ns.Wheel(), out=out, **FEW).kept == 0
    assert learn_each(runs, ns.Wheel(), out=out, **FEW).kept == 4


def test_other_versions_learn_again(runs, tmp_path, monkeypatch):
    out = tmp_path / "out"
    learn_each(runs, out=out, **FEW)
    for module in (run_settings, worker):
        monkeypatch.setattr(module, "__version__", "99")
    assert learn_each(runs, out=out, **FEW).kept == 0


class Interruption(BaseException):
    """As Ctrl-C is, no Exception."""


def test_interrupted_it_leaves_a_whole_table_and_goes_on_from_there(runs, tmp_path):
    out = tmp_path / "out"

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise Interruption

    with pytest.raises(Interruption):
        learn_each(runs, ns.Blade(), out=out, progress=stop, **FEW)
    rows = read_results(out / "results.csv")
    assert len(rows) == 2 and {row.status for row in rows} == {"learned"}
    assert not [path for path in out.iterdir() if path.name.startswith(".")]
    for path in out.glob("*.json"):
        ns.load_primitive(path)
    learned = learn_each(runs, ns.Blade(), out=out, **FEW)
    assert learned.kept == 2 and not learned.failed
    assert read_results(out / "results.csv") == list(learned.results)


def test_what_is_about_to_change_leaves_the_table_first(runs, tmp_path):
    # Else a primitive learned anew just before the machine stopped would pass for the old one.
    out, told = tmp_path / "out", []
    learn_each(runs, ns.Blade(), out=out, **FEW)

    def look(done: int, total: int) -> None:
        if done == 1:
            told.extend(read_results(out / "results.csv"))

    learn_each(runs, ns.Blade(), out=out, progress=look, basis_functions=16)
    assert len(told) <= 1


def test_rows_of_other_recordings_stay(runs, tmp_path):
    out = tmp_path / "out"
    first = learn_each(runs / "cut_00.csv", ns.Blade(), out=out, **FEW)
    second = learn_each(str(runs / "cut_0[12].csv"), ns.Blade(), out=out, **FEW)
    assert len(second.results) == 2
    assert read_results(out / "results.csv") == [*first.results, *second.results]


def test_a_primitive_of_another_recording_is_not_replaced(runs, tmp_path):
    out = tmp_path / "out"
    learn_each(runs / "cut_00.csv", out=out, **FEW)
    other = recording(7).to_csv(tmp_path / "other" / "cut_00.csv")
    with pytest.raises(
        ns.errors.InputError, match=r"would replace cut_00.json, learned from .*runs"
    ):
        learn_each(other, out=out, **FEW)
    # The same content elsewhere is the same recording.
    copy = tmp_path / "copy" / "cut_00.csv"
    copy.parent.mkdir()
    copy.write_bytes((runs / "cut_00.csv").read_bytes())
    assert learn_each(copy, out=out, **FEW).kept == 1


# ---------------------------------------------------------------- what is asked for


def test_folders_are_searched_and_keep_their_folders(tmp_path):
    write(tmp_path / "a" / "monday", 1)
    write(tmp_path / "a" / "tuesday", 1)
    write(tmp_path / "a" / ".hidden", 1)
    recording(1).to_npz(tmp_path / "a" / "cut.v1.npz")
    found = find_recordings(tmp_path / "a")
    assert sorted(found) == ["cut.v1", "monday/cut_00", "tuesday/cut_00"]
    out = tmp_path / "a"  # Beside the recordings; the table is none.
    assert not learn_each(tmp_path / "a", out=out, **FEW).failed
    assert (out / "monday" / "cut_00.json").exists() and (out / "cut.v1.json").exists()
    assert learn_each(tmp_path / "a", out=out, **FEW).kept == 3


def test_two_recordings_of_one_name_are_both_named(tmp_path):
    for folder in ("a", "b"):
        write(tmp_path / folder, 1)
    with pytest.raises(
        ns.errors.InputError, match=r"b.cut_00.csv: .*cut_00.json, as that of .*a.cut_00"
    ):
        find_recordings([tmp_path / "a" / "cut_00.csv", tmp_path / "b" / "cut_00.csv"])
    recording(0).to_csv(tmp_path / "a" / "CUT_00.csv")
    with pytest.raises(ns.errors.InputError, match=r"rename one"):
        find_recordings(tmp_path / "a")
    # One file given in two ways is one.
    assert len(find_recordings([tmp_path / "b", tmp_path / "b" / "cut_00.csv"])) == 1


def test_what_cannot_be_is_refused_before_anything_is_learned(runs, tmp_path):
    (tmp_path / "empty").mkdir()
    out = tmp_path / "out"
    for error, match, call in (
        (ns.errors.InputError, "no recording in this folder", {"recordings": tmp_path / "empty"}),
        (ns.errors.InputError, "no such file", {"recordings": [runs, tmp_path / "missing.csv"]}),
        (ns.errors.InputError, "no recordings given", {"recordings": []}),
        (ns.errors.InputError, "learn has no option 'basis'", {"basis": 3}),
        (ns.errors.InputError, "prepare has no option 'speed'", {"preparation": {"speed": 3}}),
        (ns.errors.InputError, "alpha must be made of numbers and texts", {"alpha": object()}),
        (ns.errors.InputError, r"ends in .csv or .parquet", {"table": tmp_path / "table.xlsx"}),
        (ns.errors.InputError, "is a file; give a folder", {"out": runs / "cut_00.csv"}),
        (ns.errors.InputError, "not a table of results", {"table": runs / "cut_01.csv"}),
        (ns.errors.InputError, "jobs must be a whole number", {"jobs": 0}),
        (ns.errors.ConstraintError, "expected a constraint", {"constraints": [3]}),
    ):
        with pytest.raises(error, match=match):
            learn_each(**{"recordings": runs, "out": out, **call})
    assert not out.exists()


def test_users_constraints_go_to_workers_as_expressions(runs, tmp_path):
    threshold = threading.Lock()  # Nothing that could be pickled.

    @ns.velocity_constraint
    def straight(motion):
        assert threshold
        return motion.rotation[:, 1].T @ motion.linear_velocity

    learned = learn_each(runs, straight, out=tmp_path / "out", jobs=2, **FEW)
    assert not learned.failed
    assert max(result.residual_peak for result in learned.results) < 1e-9


def test_constraints_that_cannot_be_sent_are_named(runs):
    outside = ca.interpolant("table", "linear", [[0, 1]], [0, 1])

    @ns.position_constraint
    def looked_up(motion):
        return outside(motion.position[0])

    with pytest.raises(ns.errors.ConstraintError, match="'looked up' cannot be sent to a worker"):
        learn_each(runs, looked_up)


# ---------------------------------------------------------------- the table


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_tables_are_read_back_as_they_were(tmp_path, suffix):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow", reason="needs noslip[tables]")
    rows = [
        RecordingResult(name="a", status="failed", message='no, "not"\tthat; é', recording="a.csv"),
        RecordingResult(
            name="b/c",
            status="learned",
            recording="b/c.csv",
            samples=200,
            duration_s=1 / 3,
            holds=False,
            residual_peak=5e-324,
            least_margins="box=0.1, box 2=-1e-09",
        ),
        RecordingResult(name="d", status="learned", recording="d", holds=True, smoothing=1e-6),
    ]
    path = write_results(rows, tmp_path / f"table{suffix}")
    assert read_results(path) == rows
    write_results([], path)
    assert read_results(path) == []


def test_parquet_has_types_that_other_programs_understand(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs noslip[tables]")
    path = tmp_path / "table.parquet"
    write_results([RecordingResult(name="a", status="failed", recording="a.csv")], path)
    table = parquet.read_table(path)
    assert table.column_names == [field.name for field in fields(RecordingResult)]
    types = {name: str(table.schema.field(name).type) for name in table.column_names}
    assert types["samples"] == "int64" and types["holds"] == "bool"
    assert types["seconds"] == "double" and types["message"] == "string"
    assert table["residual_peak"].null_count == 1


def test_csv_is_plain(runs, tmp_path):
    learn_each(runs, ns.Blade(), out=tmp_path, **FEW)
    with (tmp_path / "results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == ["learned"] * 4
    assert rows[0]["holds"] == "true" and float(rows[0]["residual_peak"]) < 1e-9


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_damaged_tables_are_refused_by_name(tmp_path, suffix):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow", reason="needs noslip[tables]")
    path = tmp_path / f"table{suffix}"
    path.write_bytes(b"\xff\xfe nothing of ours")
    with pytest.raises(ns.errors.InputError, match=f"table{suffix}: not a table of results"):
        read_results(path)


def test_a_wrong_cell_is_named(tmp_path):
    path = tmp_path / "table.csv"
    write_results([RecordingResult(name="a", status="failed", recording="a", samples=7)], path)
    path.write_text(path.read_text().replace(",7,", ",many,"))
    with pytest.raises(ns.errors.InputError, match=r"table.csv: row 2, column samples: .*many"):
        read_results(path)


# ---------------------------------------------------------------- executors


def test_threads_do_the_same(runs, tmp_path):
    here = learn_each(runs, ns.Blade(), out=tmp_path / "here", **FEW)
    with ThreadPoolExecutor(4) as executor:
        there = learn_each(runs, ns.Blade(), out=tmp_path / "there", executor=executor, **FEW)
        assert executor.submit(int).result() == 0, "it is left running"
    for a, b in zip(here.results, there.results, strict=True):
        assert without_times(a) == without_times(replace(b, primitive=a.primitive))
        assert Path(a.primitive).read_bytes() == (
            Path(b.primitive).read_text().replace(str(runs.absolute()), str(runs)).encode()
        )


def test_what_an_executor_loses_is_listed(runs, tmp_path):
    class Lossy(ThreadPoolExecutor):
        def submit(self, function, *arguments, **options):
            if arguments[1] == "cut_01":
                raise RuntimeError("cannot schedule new futures after shutdown")
            if arguments[1] == "cut_02":
                lost: Future = Future()
                lost.set_exception(ConnectionError("gone"))
                return lost
            return super().submit(function, *arguments, **options)

    with Lossy(1) as executor:
        learned = learn_each(runs, ns.Blade(), out=tmp_path / "out", executor=executor, **FEW)
    assert [result.status for result in learned.results] == [
        "learned",
        "failed",
        "failed",
        "learned",
    ]
    assert learned.failed[1].message == "ConnectionError: gone"
    assert learn_each(runs, ns.Blade(), out=tmp_path / "out", **FEW).kept == 2


def test_a_worker_of_another_version_refuses(runs, tmp_path):
    settings = run_settings.settings_text((), {}, {}, {})
    other = json.dumps({**json.loads(settings), "noslip": "0.0.1"})
    with pytest.raises(ns.NoslipError, match=r"a worker runs noslip .*, this is 0.0.1"):
        worker.learn_one(other, "cut", str(runs / "cut_00.csv"), None)


@pytest.mark.slow
def test_processes_do_the_same(runs, tmp_path):
    before = dict(os.environ)
    here = learn_each(runs, ns.Blade(), out=tmp_path / "here", **FEW)
    there = learn_each(runs, ns.Blade(), out=tmp_path / "there", jobs=2, **FEW)
    assert dict(os.environ) == before
    for a, b in zip(here.results, there.results, strict=True):
        assert without_times(a) == without_times(replace(b, primitive=a.primitive))
        assert Path(a.primitive).read_bytes() == Path(b.primitive).read_bytes()


@pytest.mark.slow
def test_a_process_killed_half_way_loses_nothing(tmp_path):
    runs, killed = write(tmp_path / "runs", 24), []

    def kill(done: int, total: int) -> None:
        if done == total // 2:
            killed.append(multiprocessing.active_children()[0].pid)
            os.kill(killed[0], signal.SIGKILL)

    learned = learn_each(runs, ns.Blade(), out=tmp_path / "out", jobs=2, progress=kill, **FEW)
    assert killed and not learned.failed
    assert len(list((tmp_path / "out").glob("*.json"))) == 24
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_a_recording_that_kills_its_process_is_the_only_one_listed(tmp_path, monkeypatch):
    runs = write(tmp_path / "runs", 8)
    # Whatever process opens this file dies at once, as one does that runs out of memory.
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, sys\n"
        "def die(event, arguments):\n"
        "    if event == 'open' and str(arguments[0]).endswith('cut_03.csv'):\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
        "sys.addaudithook(die)\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    learned = learn_each(runs, ns.Blade(), out=tmp_path / "out", jobs=2, **FEW)
    (failure,) = learned.failed
    assert failure.name == "cut_03" and "died each time" in failure.message
    assert len(list((tmp_path / "out").glob("*.json"))) == 7


@pytest.mark.slow
def test_processes_that_cannot_start_are_an_error(runs, tmp_path, monkeypatch):
    (tmp_path / "sitecustomize.py").write_text("import os\nos._exit(3)\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(ns.NoslipError, match="worker processes cannot be started"):
        learn_each(runs, ns.Blade(), out=tmp_path / "out", jobs=2, **FEW)


# ---------------------------------------------------------------- a cluster


@pytest.mark.slow
def test_a_dask_worker_killed_half_way_loses_nothing(tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs noslip[cluster]")
    runs, out, killed = write(tmp_path / "runs", 40), tmp_path / "out", []
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options, silence_logs=50) as local:

        def kill(done: int, total: int) -> None:
            if done == total // 2:
                # The worker itself; its nanny sees it die, and starts another.
                worker = next(iter(local.workers.values()))
                killed.append(worker.pid)
                os.kill(worker.pid, signal.SIGKILL)

        with cluster(local.scheduler_address) as executor:
            learned = learn_each(runs, ns.Blade(), out=out, executor=executor, progress=kill, **FEW)
    assert killed and not learned.failed and learned.kept == 0
    assert len(learned.results) == 40
    rows = read_results(out / "results.csv")
    assert sorted(row.name for row in rows) == [f"cut_{k:02}" for k in range(40)]
    for row in rows:
        ns.load_primitive(row.primitive)
    assert learn_each(runs, ns.Blade(), out=out, **FEW).kept == 40


@pytest.mark.slow
def test_an_address_without_a_scheduler_is_refused(monkeypatch):
    pytest.importorskip("distributed", reason="needs noslip[cluster]")
    monkeypatch.setattr(executors, "_WORKERS_WITHIN", 3.0)
    with (
        pytest.raises(ns.errors.InputError, match=r"tcp://127.0.0.1:1: no Dask scheduler answers"),
        cluster("tcp://127.0.0.1:1"),
    ):
        pass


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(ns.errors.MissingDependencyError, match=r"noslip\[cluster\]"),
        cluster("tcp://127.0.0.1:8786"),
    ):
        pass


@pytest.mark.slow
def test_a_pool_that_breaks_is_no_hang(tmp_path):
    runs = write(tmp_path / "runs", 12)
    context = multiprocessing.get_context("spawn")

    def kill(done: int, total: int) -> None:
        if done == 4:
            for process in list(executor._processes.values()):
                process.kill()

    with ProcessPoolExecutor(1, mp_context=context) as executor:
        learned = learn_each(
            runs, ns.Blade(), out=tmp_path / "out", executor=executor, progress=kill, **FEW
        )
    assert 0 < len(learned.failed) < 12
    assert {result.message.partition(":")[0] for result in learned.failed} == {"BrokenProcessPool"}
    assert not learn_each(runs, ns.Blade(), out=tmp_path / "out", **FEW).failed
