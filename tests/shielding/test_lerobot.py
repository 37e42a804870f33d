"""The step of LeRobot's pipelines: in the real package where it is installed, else in a double."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from enum import StrEnum
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import noslip as ns
from motions import planar_cut
from noslip.errors import InputError
from noslip.shielding import shield_each

RATE = 30.0


def double() -> ModuleType:
    """What the step needs of ``lerobot.processor``, by its documentation (0.4.4)."""

    class TransitionKey(StrEnum):
        OBSERVATION = "observation"
        ACTION = "action"

    class ProcessorStepRegistry:
        steps: ClassVar[dict[str, type]] = {}

        @classmethod
        def register(cls, name: str) -> Callable[[type], type]:
            def enter(step: type) -> type:
                if name in cls.steps:
                    raise ValueError(f"{name} is registered")
                cls.steps[name] = step
                return step

            return enter

        @classmethod
        def get(cls, name: str) -> type:
            return cls.steps[name]

        @classmethod
        def unregister(cls, name: str) -> None:
            cls.steps.pop(name, None)

    class RobotActionProcessorStep(ABC):
        transition: dict[str, Any]

        @abstractmethod
        def action(self, action: dict[str, Any]) -> dict[str, Any]: ...

        @abstractmethod
        def transform_features(self, features: Any) -> Any: ...

        def __call__(self, transition: dict[str, Any]) -> dict[str, Any]:
            self.transition = transition.copy()
            action = self.transition[TransitionKey.ACTION]
            return self.transition | {TransitionKey.ACTION: self.action(action.copy())}

    module = ModuleType("lerobot.processor")
    for part in (TransitionKey, ProcessorStepRegistry, RobotActionProcessorStep):
        setattr(module, part.__name__, part)
    return module


@pytest.fixture(scope="module")
def processor() -> Iterator[Any]:
    """LeRobot's package of processors, or its double."""
    with pytest.MonkeyPatch.context() as patch:
        try:
            module = importlib.import_module("lerobot.processor")
        except ImportError:
            module = double()
            patch.setitem(sys.modules, "lerobot", ModuleType("lerobot"))
            patch.setitem(sys.modules, "lerobot.processor", module)
        patch.delitem(sys.modules, "noslip.shielding.lerobot", raising=False)
        yield module
        module.ProcessorStepRegistry.unregister("noslip_shield")
    sys.modules.pop("noslip.shielding.lerobot", None)


@pytest.fixture
def step(processor: Any) -> type:
    return importlib.import_module("noslip.shielding.lerobot").ShieldActionStep


def actions(count: int = 40) -> list[dict[str, Any]]:
    """A cut whose blade stands beside its path, as end-effector actions of a policy."""
    cut = planar_cut(beside=0.1, count=61).resampled(rate=RATE)[:count]
    poses = np.hstack([cut.positions, cut.rotations.as_rotvec()])
    names = ("ee.x", "ee.y", "ee.z", "ee.wx", "ee.wy", "ee.wz")
    return [
        dict(zip(names, map(float, pose), strict=True)) | {"ee.gripper_pos": 0.1 * k, "task": "cut"}
        for k, pose in enumerate(poses)
    ]


def run(one: Any, processor: Any, given: list[dict[str, Any]]) -> list[dict[str, Any]]:
    key = processor.TransitionKey
    return [one({key.ACTION: action, key.OBSERVATION: None})[key.ACTION] for action in given]


def motion_of(found: list[dict[str, Any]]) -> ns.PoseTrajectory:
    poses = np.array(
        [[action[f"ee.{k}"] for k in ("x", "y", "z", "wx", "wy", "wz")] for action in found]
    )
    return ns.PoseTrajectory(
        np.arange(len(poses)) / RATE, poses[:, :3], Rotation.from_rotvec(poses[:, 3:])
    )


def test_actions_keep_the_constraint_and_all_else_passes(step, processor) -> None:
    given = actions()
    found = run(step(["blade"], RATE), processor, given)
    assert np.abs(motion_of(given).body_velocities[:, 1]).max() > 1e-3
    assert np.abs(motion_of(found).body_velocities[:, 1]).max() < 1e-10
    for before, after in zip(given, found, strict=True):
        assert after.keys() == before.keys()
        assert after["ee.gripper_pos"] == before["ee.gripper_pos"]
        assert after["task"] == "cut"
        assert all(type(value) is type(before[key]) for key, value in after.items())


def test_it_is_what_the_shield_says(step, processor) -> None:
    shield, given = ns.Shield([ns.Blade()], rate=RATE), actions()
    wanted = motion_of(given)
    states = [
        shield.step((position, rotation))
        for position, rotation in zip(wanted.positions, wanted.rotations, strict=True)
    ]
    found = motion_of(run(step([ns.Blade()], RATE), processor, given))
    np.testing.assert_allclose(found.positions, [s.position for s in states], atol=1e-12)


def test_an_episode_begins_anew(step, processor) -> None:
    one = step(["blade"], RATE)
    first = run(one, processor, actions())
    one.reset()
    assert run(one, processor, actions()) == first


def test_it_is_saved_and_made_again(step, processor, tmp_path: Path) -> None:
    one = step(["blade(lateral='-y')"], RATE, limits=[ns.SpeedLimit(1.0)], measured=False)
    config = json.loads(json.dumps(one.get_config()))
    again = processor.ProcessorStepRegistry.get("noslip_shield")(**config)
    assert again.get_config() == one.get_config()
    assert run(again, processor, actions()) == run(one, processor, actions())


def test_a_pipeline_of_lerobot_keeps_it(step, tmp_path: Path) -> None:
    lerobot = pytest.importorskip("lerobot.processor", reason="needs the extra lerobot")
    if not hasattr(lerobot, "RobotProcessorPipeline"):
        pytest.skip("needs the extra lerobot")
    from lerobot.processor.converters import robot_action_to_transition, transition_to_robot_action

    ways = {"to_transition": robot_action_to_transition, "to_output": transition_to_robot_action}
    pipeline = lerobot.RobotProcessorPipeline(steps=[step(["blade"], RATE)], **ways)
    found = [pipeline(action) for action in actions()]
    assert np.abs(motion_of(found).body_velocities[:, 1]).max() < 1e-10
    pipeline.save_pretrained(tmp_path, config_filename="shield.json")
    again = lerobot.RobotProcessorPipeline.from_pretrained(
        tmp_path, config_filename="shield.json", **ways
    )
    assert [again(action) for action in actions()] == found


def test_lerobot_reads_a_data_set_of_its_own_that_was_shielded(tmp_path: Path) -> None:
    sets = pytest.importorskip(
        "lerobot.datasets.lerobot_dataset", reason="needs the extra lerobot"
    ).LeRobotDataset
    given = np.array([list(action.values())[:7] for action in actions()], dtype=np.float32)
    feature = {"dtype": "float32", "shape": (7,), "names": list(actions()[0])[:7]}
    features = {"observation.state": feature, "action": feature}
    made = sets.create("me/cuts", int(RATE), features, root=tmp_path / "cuts", use_videos=False)
    for _ in range(2):
        for row in given:
            made.add_frame({"observation.state": row, "action": row, "task": "cut"})
        made.save_episode()
    made.finalize()
    shield_each(tmp_path / "cuts", [ns.Blade()], tmp_path / "kept")
    kept = sets("me/cuts", root=tmp_path / "kept")
    found = np.array([kept[k]["observation.state"].numpy() for k in range(len(kept))])
    for episode in np.split(found, 2):
        poses = Rotation.from_rotvec(episode[:, 3:6])
        motion = ns.PoseTrajectory(np.arange(len(episode)) / RATE, episode[:, :3], poses)
        assert np.abs(motion.body_velocities[:, 1]).max() < 1e-5
        np.testing.assert_array_equal(episode[:, 6], given[:, 6])
    np.testing.assert_array_equal([kept[k]["action"].numpy() for k in range(len(given))], given)
    said = kept.meta.stats["observation.state"]
    for name, of in {"min": np.min, "max": np.max, "mean": np.mean, "std": np.std}.items():
        np.testing.assert_allclose(said[name], of(found, axis=0), atol=1e-6)


def test_what_is_measured_is_of_the_observation(step, processor) -> None:
    seen = []

    class Told(step):  # type: ignore[misc, valid-type]
        def __post_init__(self) -> None:
            super().__post_init__()
            follow = self.shield.step

            def note(command: Any, measured: Any = None) -> Any:
                seen.append(measured)
                return follow(command, measured)

            self.shield.step = note

    given, key = actions(3), processor.TransitionKey
    one = Told(["blade"], RATE, measured=True)
    for action, observed in zip(given, reversed(given), strict=True):
        one({key.ACTION: action, key.OBSERVATION: observed})
    positions = [measured[0] for measured in seen]
    np.testing.assert_array_equal(positions, motion_of(given[::-1]).positions)
    with pytest.raises(InputError, match=r"observation: no ee\.x"):
        one({key.ACTION: given[0], key.OBSERVATION: {}})


@pytest.mark.parametrize("broken", [{"ee.wx": None}, {"ee.z": float("nan")}])
def test_an_action_that_is_no_pose_is_refused(step, processor, broken) -> None:
    with pytest.raises(InputError, match=rf"action.*{next(iter(broken))}"):
        run(step(["blade"], RATE), processor, [actions()[0] | broken])


def test_features_stay(step) -> None:
    features = {"action": {"ee.x": 1}}
    assert step(["blade"], RATE).transform_features(features) == features


def test_without_lerobot_its_extra_is_named() -> None:
    code = (
        "import sys; sys.modules['lerobot'] = None\n"
        "try:\n    import noslip.shielding.lerobot\n"
        "except ImportError as error:\n    print(error)"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "pip install 'noslip[lerobot]'" in told.stdout + told.stderr
