"""Files from strangers: refused in one line, before they cost time, memory or anything believed."""

from __future__ import annotations

import copy
import hashlib
import json
import tempfile
import time
import tracemalloc
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import noslip as ns
import refusals
from learned import cutting
from motions import cut
from noslip.constraints.catalog import specification
from noslip.errors import InputError, NoslipError
from rules import no_roll

BEYOND = 10.0
"""Processor time (s) of this thread that no refusal takes, on a machine at a tenth of its speed."""


def refusal(path: Path, call: Callable[[Path], Any]) -> str:
    before = time.thread_time()
    message = refusals.refusal(InputError, call, path)
    assert time.thread_time() - before < BEYOND
    assert message.startswith(f"{path}") and message.isprintable() and len(message) < 1000
    return message


# -------------------------------------------------------------------- primitives


@cache
def saved() -> str:
    """A primitive with a rule of its own, a spread, a record and a history."""
    two = [cut(), cut(0.12)]
    dmp = ns.learn(two, [ns.Blade(), no_roll], basis_functions=8, metric="shared")
    there = dmp.adapt(goal_position=dmp.goal_position + [0.01, 0.0, 0.0])
    there = replace(there, spread=dmp.spread)
    with tempfile.TemporaryDirectory() as folder:
        return there.save(Path(folder) / "cut.json").read_text()


def signed(document: dict[str, Any]) -> str:
    """Renew the checksum, as whoever writes such files would."""
    text = json.dumps(document["content"], sort_keys=True, separators=(",", ":"))
    return json.dumps(
        document | {"checksum": f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"}
    )


def paths(content: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths to everything in a document, of long lists to the first and last two."""
    if path:
        yield path
    if isinstance(content, dict):
        for key, value in content.items():
            yield from paths(value, (*path, key))
    elif isinstance(content, list):
        for k in sorted({*range(min(2, len(content))), *range(len(content))[-2:]}):
            yield from paths(content[k], (*path, k))


def changed(path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(saved())
    entry = document["content"]
    for key in path[:-1]:
        entry = entry[key]
    entry[path[-1]] = value
    return document


WRONG: list[Any] = [
    *(None, True, -1, 0.5, 5e-324, 1e300, -1e300, float("nan"), 10**400, 2**63, "", "x", "1"),
    *("\x1b[2J", "HOLDS\r\nnoslip: done", [], {}, [[]], [None], ["x"], {"x": 1}, [[1, 2], [3]]),
    *({"type": "blade", "arguments": {}}, {"instructions": []}, {"travel": "x"}, [1e300] * 7),
    [[1.0, 0.0, 0.0, 0.0]] * 3,
]


def used(dmp: ns.ConstrainedDMP) -> None:
    """What is done first with a primitive."""
    repr(dmp), dmp._repr_html_(), hash(dmp)
    motion = dmp.rollout(time_step=dmp.duration / 20)
    for name in ("positions", "linear_velocities", "angular_velocities", "constraint_residuals"):
        assert np.isfinite(getattr(motion, name)).all(), name


@pytest.mark.parametrize("part", ["law", "demonstrated", "rule", "spread", "record", "history"])
def test_a_field_of_any_wrong_kind_is_refused_or_harmless(tmp_path: Path, part: str) -> None:
    """Loaded, a primitive can be used: what cannot be is refused when it is read."""
    path = tmp_path / "cut.json"
    refused = tried = 0
    every = [found for found in paths(json.loads(saved())["content"]) if found[0] == part]
    assert every
    for index, where in enumerate(every):
        # All values where there are few places, some in turn where there are many.
        step = 1 + len(every) // 8
        for value in WRONG[index % step :: step]:
            path.write_text(signed(changed(where, copy.deepcopy(value))))
            tried += 1
            try:
                used(ns.load_primitive(path))
            except NoslipError as error:
                refused += 1
                message = str(error)
                assert message.isprintable() and len(message) < 1000, (where, value)
            except Exception as error:
                raise AssertionError(f"{where} = {value!r}: {error!r}") from error
    # An option may be of many kinds.
    assert refused > (0.1 if part == "history" else 0.5) * tried


@pytest.mark.parametrize(
    ("where", "value", "found"),
    [
        ("law.start.3", 5.0, "norm 5"),
        ("law.winding.0", [5.0, 0.0, 0.0, 0.0], "norm 5"),
        ("law.winding", [], "winding"),
        ("law.goal_position.0", 1e300, "1e+300"),
        ("law.weights.0.0", 1e300, "1e+300"),
        ("law.begin", 1e300, "1e+300"),
        ("law.steps", 10**9, "2000000 or less"),
        ("law.duration", 1e-300, "from 1e-09 to 1e+12"),
        ("rule.inverse_metric.0", 1e300, "inverse_metric"),
        ("rule.stabilization", 1e300, "stabilization"),
        ("record.0.demonstration", ["x"], "demonstration"),
        ("record.0.demonstration", "a\r\nnoslip: wrote it", "demonstration"),
        ("record.0.samples", "many", "samples"),
        ("record.0.residual", "small", "residual"),
        ("record.0.left_out", "limit", "left_out"),
        ("record.0.left_out", [3], "left_out"),
        ("history.0.options", {"no_such": 1}, "no option 'no_such'"),
        ("history.0.options", [], "options"),
        ("history.1.options.via", 5, "via"),
        ("history.0.options.metric", "\x1b]0;owned\x07", "can be printed"),
        ("rule.constraints.1.name", "HOLDS\r\nnoslip: done", "characters that can be printed"),
        ("rule.constraints.1.name", ["x"], "name"),
        ("rule.constraints.1.unit", 5, "unit"),
        ("rule.constraints.1.priority", 1.5, "priority"),
        ("rule.constraints.1.level", "speed", "level"),
        ("rule.constraints.1.edge", 7, "edge"),
        ("rule.constraints.0.arguments", 7, "constraints"),
        ("rule.constraints.0.arguments.lateral", ["y"], "body axis"),
    ],
)
def test_what_no_primitive_holds_is_named(
    tmp_path: Path, where: str, value: Any, found: str
) -> None:
    path = tmp_path / "cut.json"
    keys = tuple(int(key) if key.isdigit() else key for key in where.split("."))
    path.write_text(signed(changed(keys, value)))
    message = refusal(path, ns.load_primitive)
    assert any(str(key) in message for key in keys[1:])
    assert found in message


def own_rule(name: str, instructions: list[Any]) -> dict[str, Any]:
    return {**specification(no_roll), "name": name, "expression": {"instructions": instructions}}


def tower(operations: int) -> list[Any]:
    """The y of the velocity, and a sine of it of a sine of it ..."""
    steps: list[Any] = [["INPUT", 0, 3, 1]]
    steps += [["SIN", 0, 0] for _ in range(operations - 2)]
    return [*steps, ["OUTPUT", 0, 0]]


def block(rows: int) -> list[Any]:
    return [["INPUT", 0, 3, 1], *(["OUTPUT", row, 0] for row in range(rows))]


def in_frames(deep: int) -> dict[str, Any]:
    held: dict[str, Any] = {"type": "blade", "arguments": {}}
    for _ in range(deep):
        held = {"type": "in-moving-frame", "arguments": {"constraint": held}}
    return held


@pytest.mark.parametrize(
    ("constraints", "found"),
    [
        ([own_rule("deep", tower(400_000))], "at most 2000 operations, found 400000"),
        ([own_rule("wide", block(1999))], "1999 rows, at most 64"),
        ([own_rule(f"rule {k}", tower(1500)) for k in range(300)], "operations, at most 2000"),
        ([{"type": "blade", "arguments": {}}] * 300, "65 rows, at most 64"),
        ([in_frames(300)], "constraints"),
        ([in_frames(60)], "constraints"),
        ([own_rule("bad", [["ADD", 0, "0", 0]])], "no operation"),
        ([own_rule("bad", [["CONST", 0, "1"]])], "no operation"),
        ([own_rule("bad", [["CONST", 0, [1]]])], "no operation"),
        ([own_rule("bad", [{"SIN": 0}])], "no operation"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_rules_without_end_are_refused_at_once(
    tmp_path: Path, constraints: list[Any], found: str
) -> None:
    path = tmp_path / "cut.json"
    path.write_text(signed(changed(("rule", "constraints"), constraints)))
    assert found in refusal(path, ns.load_primitive)


def test_a_file_beyond_any_primitive_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "cut.json"
    with path.open("wb") as file:
        file.truncate(2**40)
    assert "more than 33,554,432 bytes" in refusal(path, ns.load_primitive)


def test_what_is_learned_is_loaded_again(tmp_path: Path) -> None:
    """The schema refuses nothing that noslip writes."""
    dmp = cutting()
    for k, made in enumerate([dmp, dmp.replan(dmp.step(dmp.initial_state(), 0.1))]):
        assert ns.load_primitive(made.save(tmp_path / f"{k}.json")) == made


# -------------------------------------------------------------------- recordings


def poses(count: int = 20) -> dict[str, Any]:
    """Arrays of a motion that would be read."""
    times = np.arange(count) / 100
    line = np.column_stack([times, 0 * times, 0 * times])
    return {
        "times": times,
        "positions": line,
        "quaternions": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
    }


@pytest.fixture
def measured() -> Iterator[None]:
    """The test takes less than 200 MB of Python's memory at its peak."""
    tracemalloc.start()
    yield
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 200e6


def header(shape: tuple[int, ...], kind: str) -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}}}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize(
    ("name", "shape", "kind", "found"),
    [
        ("times", (2**30,), "<f8", "1,073,741,824 samples, at most 2,000,000"),
        ("positions", (2**30, 3), "<f8", "shape (1073741824, 3), expected (20, 3)"),
        ("positions", (20, 3), "|V1000000000", "not real numbers"),
        ("quaternions", (2**62, 4), "<f8", "expected (20, 4)"),
        ("times", (-1,), "<f8", ""),
    ],
)
def test_an_npz_says_how_much_it_holds_before_it_is_decompressed(
    tmp_path: Path, name: str, shape: tuple[int, ...], kind: str, found: str
) -> None:
    path = tmp_path / "bomb.npz"
    np.savez(path, **{key: value for key, value in poses().items() if key != name})
    with (
        zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive,
        archive.open(f"{name}.npy", "w", force_zip64=True) as file,
    ):
        file.write(header(shape, kind))
        for _ in range(300):
            file.write(bytes(1_000_000))
    assert path.stat().st_size < 2e6
    assert found in refusal(path, ns.load_demonstrations)


def test_an_npz_compressed_like_no_numpy_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "odd.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        for name, values in poses().items():
            with archive.open(f"{name}.npy", "w") as file:
                np.lib.format.write_array(file, values)
    assert "compressed otherwise" in refusal(path, ns.load_demonstrations)


def table_file(path: Path, columns: dict[str, Any], **how: Any) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    feather, parquet = (pytest.importorskip(f"pyarrow.{kind}") for kind in ("feather", "parquet"))
    write = feather.write_feather if path.suffix == ".feather" else parquet.write_table
    write(pyarrow.table(columns), path, **how)


@pytest.mark.parametrize("suffix", [".parquet", ".feather"])
def test_a_table_says_how_much_it_holds_before_it_is_decompressed(
    tmp_path: Path, suffix: str
) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    path = tmp_path / f"bomb{suffix}"
    names = ("t", "x", "y", "z", "qw", "qx", "qy", "qz")
    zeros = np.zeros(2_000_001)
    table_file(path, dict.fromkeys(names, zeros), compression="zstd")
    assert path.stat().st_size < 3e5
    before = pyarrow.default_memory_pool().bytes_allocated()
    assert "2,000,001 samples, at most 2,000,000" in refusal(path, ns.load_demonstrations)
    assert pyarrow.default_memory_pool().bytes_allocated() - before < 1e6


@pytest.mark.parametrize("suffix", [".parquet", ".feather"])
def test_few_rows_may_not_be_long(tmp_path: Path, suffix: str) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    path = tmp_path / f"bomb{suffix}"
    rows = pyarrow.FixedSizeListArray.from_arrays(
        pyarrow.array(np.zeros(8 * 20_000_000)), 20_000_000
    )
    table_file(path, {"t": np.arange(8.0), "state": rows}, compression="zstd")
    message = refusal(path, ns.load_demonstrations)
    assert "bytes when decompressed, at most 1,073,741,824" in message


@pytest.mark.parametrize("compression", ["uncompressed", "lz4", "zstd"])
def test_tables_within_bounds_are_read(tmp_path: Path, compression: str) -> None:
    """However they are compressed, and in several batches."""
    path = tmp_path / "cut.feather"
    count = 150_000
    columns = {"t": np.arange(count) / 100.0, "x": np.arange(count) / 1e5}
    columns |= {name: np.zeros(count) for name in ("y", "z", "qx", "qy", "qz")}
    table_file(path, columns | {"qw": np.ones(count)}, compression=compression)
    (loaded,) = ns.load_demonstrations(path)
    np.testing.assert_array_equal(loaded.positions[:, 0], columns["x"])


def robomimic(path: Path, change: Callable[[Any, Any, Any], None]) -> Path:
    """A data set of one demonstration, changed by a stranger."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_kwargs": {"control_freq": 100}})
        observations = data.create_group("demo_0/obs")
        observations["robot0_eef_pos"] = poses()["positions"]
        observations["robot0_eef_quat"] = np.roll(poses()["quaternions"], -1, axis=1)
        change(h5py, file, observations)
    return path


OTHER = "other.hdf5"


def _linked(at: str) -> Callable[[Any, Any, Any], None]:
    def change(h5py: Any, file: Any, observations: Any) -> None:
        del file[at]
        file[at] = h5py.ExternalLink(OTHER, at)

    return change


def _soft(h5py: Any, file: Any, observations: Any) -> None:
    """Through a link of this file into another one."""
    file["door"] = h5py.ExternalLink(OTHER, "/")
    del file["data/demo_0"]
    file["data/demo_0"] = h5py.SoftLink("/door/data/demo_0")


def _stored(h5py: Any, file: Any, observations: Any) -> None:
    del observations["robot0_eef_pos"]
    outside = [("secret.bin", 0, 20 * 3 * 8)]
    observations.create_dataset("robot0_eef_pos", (20, 3), "f8", external=outside)


def _virtual(h5py: Any, file: Any, observations: Any) -> None:
    del observations["robot0_eef_pos"]
    layout = h5py.VirtualLayout((20, 3), "f8")
    layout[:] = h5py.VirtualSource(OTHER, "data/demo_0/obs/robot0_eef_pos", (20, 3))
    observations.create_virtual_dataset("robot0_eef_pos", layout)


def _zeros(shape: tuple[int, ...], **how: Any) -> Callable[[Any, Any, Any], None]:
    def change(h5py: Any, file: Any, observations: Any) -> None:
        del observations["robot0_eef_pos"]
        observations.create_dataset("robot0_eef_pos", shape, "f8", **how)

    return change


@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize(
    ("change", "found"),
    [
        (_linked("data"), "link to elsewhere"),
        (_linked("data/demo_0"), "link to elsewhere"),
        (_linked("data/demo_0/obs"), "link to elsewhere"),
        (_linked("data/demo_0/obs/robot0_eef_pos"), "link to elsewhere"),
        (_soft, "link to elsewhere"),
        (_stored, "in another file"),
        (_virtual, "in another file"),
        (_zeros((10**9, 3), chunks=(1000, 3), compression="gzip"), "1,000,000,000 samples"),
        (_zeros((20, 10**9), chunks=(1, 1000), compression="gzip"), "more numbers than"),
        (
            _zeros((20, 3), chunks=(10**8, 3), maxshape=(None, 3), compression="gzip"),
            "more numbers than",
        ),
    ],
)
def test_hdf5_is_read_from_itself_alone_and_no_more_than_a_motion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: Any, found: str
) -> None:
    monkeypatch.chdir(tmp_path)
    robomimic(tmp_path / OTHER, lambda *_: None)
    (tmp_path / "secret.bin").write_bytes(poses()["positions"].tobytes())
    path = robomimic(tmp_path / "mine.hdf5", change)
    message = refusal(path, lambda p: ns.load_demonstrations(p, columns=COLUMNS))
    assert found in message


COLUMNS = "robot0_eef_pos[0:3],robot0_eef_quat[3,0:3]"


def test_the_data_set_unchanged_is_read(tmp_path: Path) -> None:
    path = robomimic(tmp_path / "mine.hdf5", lambda *_: None)
    (loaded,) = ns.load_demonstrations(path, columns=COLUMNS)
    np.testing.assert_array_equal(loaded.positions, poses()["positions"])


@pytest.mark.parametrize(
    "template",
    [
        "../../other/data/episode_{episode_index:06d}.parquet",
        "data/../../other.parquet",
        "/etc/passwd",
        "data/{episode_index:999999999d}.parquet",
        "data/{episode_index.__class__}.parquet",
        "data/{episode_chunk!r}.parquet",
        "data/{0}.parquet",
        "data/\x1b[2J.parquet",
    ],
)
def test_a_data_set_names_files_of_its_own(tmp_path: Path, template: str) -> None:
    pytest.importorskip("pyarrow")
    info: dict[str, Any] = {"codebase_version": "v2.1", "fps": 100, "data_path": template}
    info["features"] = {"state": {"dtype": "float32", "shape": [7], "names": None}}
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text(json.dumps(info))
    (tmp_path / "meta" / "episodes.jsonl").write_text('{"episode_index": 0}\n')
    message = refusal(tmp_path, lambda p: ns.load_demonstrations(p, columns="state[0:7]"))
    assert "not a template this version knows" in message or "no such file" in message
    assert "no such file" not in message or template == "data/\x1b[2J.parquet"


# -------------------------------------------------------------------- what is printed

FORGED = "cut\r\nHOLDS\x1b[2J\u202e[bold].csv"


def test_a_file_forges_no_line(noslip: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / FORGED
    path.write_bytes(cut().to_csv(tmp_path / "cut.csv").read_bytes())
    for command in (
        ["check", path, "--constraint", "blade"],
        ["learn", path, "--constraint", "blade", "--out", tmp_path / "cut.json"],
        ["segment", path, "--out", tmp_path / "pieces"],
        ["learn", path, path.with_suffix(".txt"), "--each", "--out", tmp_path / "each"],
        ["check", path.with_suffix(".none"), "--constraint", "blade"],
    ):
        told = noslip(*command)
        assert told.out or told.err
        for line in (told.out + told.err).splitlines():
            assert line.isprintable() and not line.startswith("HOLDS"), command


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("digits.json", b"1" * 1_000_000),
        ("long.csv", b"t,x,y,theta\n" + b"1" * 3_000_000 + b",0,0,0\n" * 9),
        ("empty.npz", b""),
        ("empty.json", b""),
        ("pickle.npz", b"\x80\x04cos\nsystem\n(S'true'\ntR."),
        ("table.parquet", b"PAR1" * 4),
    ],
)
def test_a_file_that_is_none_of_its_kind_is_refused_in_a_line(
    name: str, content: bytes, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    read: Callable[[Path], Any] = (
        ns.load_primitive if path.suffix == ".json" else ns.load_demonstrations
    )
    refusal(path, read)
