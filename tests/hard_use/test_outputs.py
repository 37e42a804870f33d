"""Outputs under hard use: what stands in the way of a file, kills, many processes at once."""

from __future__ import annotations

import errno
import json
import os
import stat
import subprocess
import sys
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from noslip import PoseTrajectory
from noslip._files import locked, making, renewing, scratch, write_beside
from noslip.errors import InputError
from noslip.many.learning import learn_each
from noslip.result_table import read_results

posix = pytest.mark.skipif(sys.platform == "win32", reason="devices, pipes and flock are POSIX")


def recordings(folder: Path, names: Sequence[str | bytes]) -> list[Path]:
    folder.mkdir(exist_ok=True)
    times = np.linspace(0.0, 1.0, 30)
    line = np.column_stack([times, np.sin(times), 0 * times])
    motion = PoseTrajectory(times, line, Rotation.identity(30))
    text = motion.csv_text().encode()
    files = [folder / os.fsdecode(name) for name in names]
    for file in files:
        file.write_bytes(text)
    return files


# ---------------------------------------------------------------- what stands in a file's way


@posix
def test_a_device_is_written_to_and_stays_one() -> None:
    before = Path(os.devnull).stat()
    write_beside(os.devnull, b"gone")
    assert stat.S_ISCHR(Path(os.devnull).stat().st_mode)
    assert Path(os.devnull).stat().st_ino == before.st_ino


@posix
def test_a_pipe_is_written_to_and_stays_one(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    found: list[bytes] = []
    reader = threading.Thread(target=lambda: found.append(pipe.read_bytes()), daemon=True)
    reader.start()
    write_beside(pipe, b"through")
    reader.join()
    assert found == [b"through"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@posix
@pytest.mark.parametrize("is_there", [True, False])
def test_a_link_stays_and_its_target_is_replaced(tmp_path: Path, is_there: bool) -> None:
    (tmp_path / "folder").mkdir()
    target, link = tmp_path / "folder" / "target", tmp_path / "link"
    if is_there:
        target.write_text("old")
    link.symlink_to("folder/target")
    assert write_beside(link, b"new") == link
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert not target.is_symlink()


@posix
def test_a_ring_of_links_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(InputError, match="cannot be written"):
        write_beside(tmp_path / "a", b"new")
    assert (tmp_path / "a").is_symlink()


@posix
def test_a_read_only_file_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "kept"
    file.write_text("old")
    file.chmod(0o444)
    with pytest.raises(InputError, match="kept: is read-only; make it writable"):
        write_beside(file, b"new")
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


@posix
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o755])
def test_a_file_keeps_its_mode(tmp_path: Path, mode: int) -> None:
    file = tmp_path / "file"
    file.write_text("old")
    file.chmod(mode)
    write_beside(file, b"new")
    assert (file.read_text(), stat.S_IMODE(file.stat().st_mode)) == ("new", mode)


@pytest.mark.parametrize("error", [KeyboardInterrupt, InputError, OSError(errno.ENOSPC, "full")])
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_what_is_interrupted_while_it_is_made_is_not_there(tmp_path: Path, error, kind) -> None:
    def make() -> None:
        with making(tmp_path / "in" / "copy") as beside:
            if kind == "folder":
                beside.mkdir()
                beside /= "half"
            beside.write_text("half")
            raise error

    with pytest.raises((KeyboardInterrupt, InputError)):
        make()
    assert list((tmp_path / "in").iterdir()) == []


@posix
@pytest.mark.parametrize("there", ["file", "folder", "link"])
def test_what_is_there_is_not_made_again(tmp_path: Path, there) -> None:
    target = tmp_path / "mine"
    if there == "link":
        target.symlink_to("nowhere")
    elif there == "folder":
        target.mkdir()
    else:
        target.write_text("mine")
    with pytest.raises(InputError, match="mine: is there already"), making(target):
        pytest.fail("it was begun")
    assert list(tmp_path.iterdir()) == [target]


# ---------------------------------------------------------------- one at a time


@posix
def test_a_folder_is_one_process_s_until_it_is_killed(tmp_path: Path) -> None:
    holding = f"""
import time; from pathlib import Path; from noslip._files import locked
with locked(Path({str(tmp_path)!r})): print("held", flush=True); time.sleep(600)
"""
    with subprocess.Popen([sys.executable, "-c", holding], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        with pytest.raises(InputError, match="another noslip is writing there"):
            locked(tmp_path, wait=False).__enter__()
        process.kill()
        process.wait()
    with locked(tmp_path, wait=False):
        assert not list(tmp_path.iterdir())


def test_the_old_summary_goes_before_the_first_new_file(tmp_path: Path) -> None:
    summary = tmp_path / "summary.csv"
    summary.write_text("of old files")
    with pytest.raises(KeyboardInterrupt), renewing(summary) as last:
        assert last == summary
        raise KeyboardInterrupt
    assert not summary.exists()


# ---------------------------------------------------------------- learn --each


def test_a_second_run_into_the_same_folder_loses_no_row(tmp_path: Path) -> None:
    one = recordings(tmp_path / "one", ["a.csv", "b.csv"])
    two = recordings(tmp_path / "two", ["c.csv"])
    out = tmp_path / "out"

    def meanwhile(done: int, _: int) -> None:
        if done == 1:
            learn_each(two, out=out)

    learn_each(one, out=out, progress=meanwhile)
    assert {row.name for row in read_results(out / "results.csv")} == {"a", "b", "c"}


@pytest.mark.parametrize("garbage", ["", "{", "{}", None])
def test_what_is_garbage_is_learned_again(tmp_path: Path, garbage: str | None) -> None:
    files = recordings(tmp_path / "in", ["a.csv", "b.csv"])
    learn_each(files, out=tmp_path / "out")
    primitive = tmp_path / "out" / "a.json"
    whole = primitive.read_text()
    primitive.write_text(whole[: len(whole) // 2] if garbage is None else garbage)
    assert learn_each(files, out=tmp_path / "out").kept == 1
    assert primitive.read_text() == whole
    assert learn_each(files, out=tmp_path / "out").kept == 2


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are UTF-8 there")
def test_a_name_that_is_not_utf_8_stands_in_the_table(tmp_path: Path) -> None:
    files = recordings(tmp_path / "in", [b"bad\xff.csv", b"good.csv"])
    assert not learn_each(files, out=tmp_path / "out").failed
    rows = read_results(tmp_path / "out" / "results.csv")
    assert {row.name for row in rows} == {"bad\\udcff", "good"}
    assert learn_each(files, out=tmp_path / "out").kept == 2


def killed(rounds: int, code: str = "") -> tuple[list[dict[str, Any]], int]:
    """Return what the bench told of two and of ten processes, and how it ended."""
    run = (
        "import contextlib, sys; from noslip.many import learning; from benchmarks import kills\n"
        f"{code}sys.exit(kills.main(['--rounds', '{rounds}']))"
    )
    # In a process of its own: it forks, which what else runs here may not bear.
    done = subprocess.run([sys.executable, "-c", run], capture_output=True, text=True, check=False)
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert [found["processes"] for found in told] == [2, 10], done.stderr
    # Of two processes on an idle machine hardly one a round is still there to be killed.
    assert all(found["killed"] and found["rows told"] for found in told)
    return told, done.returncode


@posix
def test_killed_processes_lose_no_row_and_tear_no_file() -> None:
    told, _ = killed(10)
    for found in told:
        # A hidden file may stay whose row was told already: nobody writes it again.
        assert all(kind.startswith("left in the folder") for kind in found["faults"])


@posix
def test_the_same_rounds_without_locks_find_what_is_lost() -> None:
    """Or the bench would see nothing; that two meet is chance, so it has several tries."""
    without = "learning.locked = lambda folder: contextlib.nullcontext()\n"
    for _ in range(10):
        told, code = killed(4, without)
        if any(kind.startswith("rows lost") for kind in told[1]["faults"]):
            assert code == 1
            return
    pytest.fail("no row was ever lost")


@posix
def test_what_a_killed_process_left_is_used_again(tmp_path: Path) -> None:
    writing = f"""
import os; from pathlib import Path; from noslip._files import write_beside
Path.replace = lambda *_: os.kill(os.getpid(), 9)
write_beside({str(tmp_path / "file")!r}, b"half of a longer one")
"""
    subprocess.run([sys.executable, "-c", writing], check=False)
    (left,) = tmp_path.iterdir()
    assert left.name.startswith(".file.")
    write_beside(tmp_path / "file", b"whole")
    assert [file.name for file in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_bytes() == b"whole"


@posix
def test_a_file_without_locks_is_written_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", none)
    write_beside(tmp_path / "file", b"whole")
    assert [file.read_bytes() for file in tmp_path.iterdir()] == [b"whole"]


@posix
def test_threads_that_write_one_file_wait_for_one_another(tmp_path: Path) -> None:
    contents = [bytes([65 + k]) * 100_000 for k in range(8)]

    def write(content: bytes) -> None:
        for _ in range(20):
            write_beside(tmp_path / "file", content)
            assert (tmp_path / "file").read_bytes() in contents

    with ThreadPoolExecutor(len(contents)) as pool:
        list(pool.map(write, contents))
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


# ---------------------------------------------------------------- the machine


@posix
def test_doctor_without_a_home(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path\n"
        "def none(): raise RuntimeError('Could not determine home directory.')\n"
        "Path.home = none\n"
        "from noslip.cli import main; sys.argv = ['noslip', 'doctor']; main()"
    )
    environment = {k: v for k, v in os.environ.items() if k not in ("HOME", "XDG_CACHE_HOME")}
    environment.pop("NOSLIP_CACHE", None)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "NOSLIP_CACHE" in done.stdout


def test_a_full_temporary_folder_is_named() -> None:
    with pytest.raises(InputError, match=r"temporary folder .*No space left"), scratch() as folder:
        assert folder.is_dir()
        raise OSError(errno.ENOSPC, "No space left on device")


def test_no_temporary_folder_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    with pytest.raises(InputError, match="temporary folder"), scratch():
        pass
