"""Bags as others wrote them: each gives its right value, or the refusal that says how to go on."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from noslip import load_demonstrations
from noslip.errors import RecordingError, RecordingWarning
from noslip.recordings import bag_topics
from refusals import refusal

pytest.importorskip("rosbags", reason="needs the extra bags")

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases"
pytestmark = pytest.mark.skipif(
    not CASES.is_dir(), reason="the cases (../shared/cases, seen from the repository) are absent"
)


def require_motion(path: Path, samples: range, start: float = 1.7e9, **options: Any) -> None:
    """Sample k is at 0.01 k s, at 0.001 k m, turned by 0.01 k rad about z."""
    (found,) = load_demonstrations(path, **options)
    k = np.array(samples)
    np.testing.assert_allclose(found.times, start + 0.01 * k, rtol=0, atol=3e-7)
    np.testing.assert_allclose(found.positions[:, 0], 0.001 * k, rtol=0, atol=1e-9)
    turned = found.rotations.as_rotvec()[:, 2]
    np.testing.assert_allclose(turned, 0.01 * k, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "name",
    ["pose_cov.bag", "mcap_short_type_pose.mcap", "mcap_ros1_profile.mcap", "db3_wal/sq.db3"],
)
def test_all_of_what_is_there(name: str) -> None:
    require_motion(CASES / name, range(200))


def test_a_write_ahead_log_is_read_and_left_as_it_is(tmp_path: Path) -> None:
    """In a folder that may be written to, SQLite would fold it into the database."""
    for file in (CASES / "db3_wal").iterdir():
        shutil.copyfile(file, tmp_path / file.name)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    require_motion(tmp_path / "sq.db3", range(200))
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("name", "samples", "command"),
    [
        ("crash_active.bag", 200, "rosbag reindex"),
        ("mcap_crash_no_footer.mcap", 172, "mcap recover"),
    ],
)
def test_a_killed_recorder_leaves_what_is_whole(name: str, samples: int, command: str) -> None:
    with pytest.warns(RecordingWarning, match=command):
        require_motion(CASES / name, range(samples))


def test_channels_in_json_are_named() -> None:
    beside = CASES / "mcap_pose_beside_json.mcap"
    with pytest.warns(RecordingWarning, match=r"/event \(my.Event in json\)"):
        require_motion(beside, range(200))
    require_motion(beside, range(200), topic="/tool_pose")
    only = CASES / "foxglove_json.mcap"
    message = refusal(RecordingError, load_demonstrations, only)
    assert "not read: /tool_pose (foxglove.PoseInFrame in json)" in message


def test_a_schema_that_cannot_be_parsed_costs_no_other_topic() -> None:
    found = bag_topics(CASES / "mcap_service_event_schema_real.mcap")
    assert [topic.messages for topic in found] == [4, 4, 1, 1]
    assert [topic.name for topic in found][2:] == ["/test_topic1", "/test_topic2"]


def test_faults_at_the_start_are_trimmed_past() -> None:
    nan = CASES / "nan_pose.bag"
    assert "sample 50, position: found [nan" in refusal(RecordingError, load_demonstrations, nan)
    require_motion(nan, range(53, 200), within=(1.7e9 + 0.6, None))
    simulated = CASES / "sim_time_start_zero.bag"
    assert "0 s is also the time of" in refusal(RecordingError, load_demonstrations, simulated)
    (found,) = load_demonstrations(simulated, within=(101.0, None))
    np.testing.assert_allclose(np.diff(found.positions[:, 0]), 0.001, atol=1e-9)
    assert len(found) > 100


def test_a_link_with_one_sample_is_one_error() -> None:
    message = refusal(
        RecordingError, load_demonstrations, CASES / "tf_one_sample_link.bag", child_frame="tool"
    )
    assert "one transform, so no motion" in message
