"""Chains of joints: where the tool is, against products of matrices, and what they say of it."""

from __future__ import annotations

import copy
import json
import pickle
from dataclasses import replace
from functools import reduce
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import noslip as ns
from noslip._typing import Floats
from noslip.chain import Chain, Joint
from noslip.errors import InputError

FEW = 15
"""Examples of each property: every chain is a graph of its own, which takes 10 ms to build."""
parts = st.one_of(st.sampled_from([0.0, 1.0, -1.0, 1e-9]), st.floats(-1, 1))
"""Of axes and offsets, as arms have them: many along coordinate axes."""
vectors = st.tuples(parts, parts, parts)
directions = vectors.filter(any)
quaternions = st.one_of(
    st.sampled_from(
        [(1.0, 0.0, 0.0, 0.0), (0.5**0.5, 0.0, -(0.5**0.5), 0.0), (0.0, 1.0, 0.0, 0.0)]
    ),
    st.tuples(parts, parts, parts, parts)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: tuple((np.array(q) / np.linalg.norm(q)).tolist())),
)
angles = st.floats(-4.0, 4.0)


@st.composite
def chains(draw: Any, least: int = 1) -> Chain:
    count = draw(st.integers(least, 6))
    kinds = st.sampled_from(["hinge", "slide"])
    zeros = st.one_of(st.just(0.0), angles)
    joints = [
        Joint(f"j{k}", draw(kinds), draw(directions), draw(vectors), draw(quaternions), draw(zeros))
        for k in range(count)
    ]
    return Chain(joints, draw(vectors), draw(quaternions))


@st.composite
def moved(draw: Any) -> tuple[Chain, Floats]:
    chain = draw(chains())
    return chain, np.array(draw(st.lists(angles, min_size=chain.size, max_size=chain.size)))


def transform(position: Any, rotation: Rotation) -> Floats:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.as_matrix(), position
    return T


def factors(chain: Chain, q: Floats) -> tuple[list[Floats], list[Floats]]:
    """Matrices, 4 x 4, whose product is the tool's pose, and derivatives of every second one."""
    found, derivatives = [], []
    for joint, at in zip(chain.joints, q - [joint.zero for joint in chain.joints], strict=True):
        axis, screw = np.array(joint.axis), np.zeros((4, 4))
        found.append(transform(joint.position, turn(joint.rotation)))
        if joint.kind == "hinge":
            found.append(transform(np.zeros(3), Rotation.from_rotvec(at * axis)))
            screw[:3, :3] = np.cross(np.eye(3), axis)
        else:
            found.append(transform(at * axis, Rotation.identity()))
            screw[:3, 3] = axis
        derivatives.append(screw @ found[-1])
    return [*found, transform(chain.position, turn(chain.rotation))], derivatives


def turn(quaternion: Any) -> Rotation:
    return Rotation.from_quat(quaternion, scalar_first=True)


def product(chain: Chain, q: Floats) -> Floats:
    """The tool's pose, 4 x 4: the textbook's product of offsets and screws."""
    return np.asarray(reduce(np.matmul, factors(chain, q)[0]))


@given(moved())
@settings(max_examples=FEW)
def test_the_pose_is_the_product_of_offsets_and_screws(given: tuple[Chain, Floats]) -> None:
    chain, q = given
    position, rotation = chain.forward(q)
    expected = product(chain, q)
    assert np.abs(position - expected[:3, 3]).max() <= 1e-12
    assert np.abs(rotation.as_matrix() - expected[:3, :3]).max() <= 1e-12
    symbols = ca.SX.sym("q", chain.size)
    size = ca.Function("size", [symbols], [ca.norm_2(chain.pose(symbols)[1])])
    assert float(size(q)) == pytest.approx(1.0, abs=1e-14)


@given(moved(), st.data())
@settings(max_examples=FEW)
def test_the_jacobian_turns_rates_of_joints_into_the_twist(
    given: tuple[Chain, Floats], data: st.DataObject
) -> None:
    chain, q = given
    rates = np.array(data.draw(st.lists(parts, min_size=chain.size, max_size=chain.size)))
    symbols = ca.SX.sym("q", chain.size)
    J = np.array(ca.Function("J", [symbols], [chain.jacobian(symbols)])(q))
    # By the product rule.
    matrices, derivatives = factors(chain, q)
    rate = np.zeros((4, 4))
    for k, speed in enumerate(rates):
        changed = list(matrices)
        changed[2 * k + 1] = speed * derivatives[k]
        rate += reduce(np.matmul, changed)
    spin = rate[:3, :3] @ product(chain, q)[:3, :3].T
    expected = [*rate[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
    assert np.abs(J @ rates - expected).max() <= 1e-12


@given(chains(), st.data())
@settings(max_examples=FEW)
def test_quaternions_do_not_jump(chain: Chain, data: st.DataObject) -> None:
    """Not where a rotation's angle passes half a turn, and a whole turn of a hinge changes sign."""
    k = data.draw(st.integers(0, chain.size - 1))
    symbols = ca.SX.sym("q", chain.size)
    found = ca.Function("pose", [symbols], list(chain.pose(symbols)))
    q = np.zeros((chain.size, 201))
    q[k] = np.linspace(0.0, 2 * np.pi, 201)
    quaternions = np.array(found(q)[1]).T
    assert np.sum(quaternions[1:] * quaternions[:-1], axis=1).min() > 0.99
    sign = -1 if chain.joints[k].kind == "hinge" else 1
    assert np.allclose(quaternions[-1], sign * quaternions[0], atol=1e-14)


@given(chains(least=2), st.data())
@settings(max_examples=FEW)
def test_held_joints_stand_still(chain: Chain, data: st.DataObject) -> None:
    q = np.array(data.draw(st.lists(angles, min_size=chain.size, max_size=chain.size)))
    still = data.draw(st.sets(st.sampled_from(chain.joint_names), max_size=chain.size - 1))
    at = dict(zip(chain.joint_names, q.tolist(), strict=True))
    left = chain.held({name: at[name] for name in still})
    assert left.joint_names == tuple(name for name in chain.joint_names if name not in still)
    position, rotation = left.forward([at[name] for name in left.joint_names])
    expected = product(chain, q)
    assert np.abs(position - expected[:3, 3]).max() <= 1e-12
    assert np.abs(rotation.as_matrix() - expected[:3, :3]).max() <= 1e-12


@given(chains())
@settings(max_examples=10)
def test_a_chain_is_a_value(chain: Chain) -> None:
    text = json.dumps(chain.as_data(), allow_nan=False)
    for other in (
        Chain.from_data(json.loads(text)),
        pickle.loads(pickle.dumps(chain)),
        copy.deepcopy(chain),
        replace(chain),
    ):
        assert other == chain
        assert hash(other) == hash(chain)
    first = replace(chain.joints[0], zero=chain.joints[0].zero + 1)
    assert replace(chain, joints=(first, *chain.joints[1:])) != chain


def planar() -> Chain:
    """Two links of 0.5 m, in the plane."""
    joints = [
        Joint("shoulder", lower=-2.0, upper=2.0, velocity=3.0),
        Joint("elbow", position=(0.5, 0, 0), acceleration=9.0),
    ]
    return Chain(joints, (0.5, 0, 0), name="planar")


def test_poses_of_a_motion_have_the_twists_of_its_joints() -> None:
    times = np.linspace(1.0, 2.0, 101)
    q = np.column_stack([np.sin(times), times**2])
    rates = np.column_stack([np.cos(times), 2 * times])
    motion = planar().poses(times, q, rates)
    heading, turning = q.sum(axis=1), rates.sum(axis=1)
    both = np.column_stack([q[:, 0], heading])
    expected = 0.5 * np.column_stack(
        [np.cos(both).sum(axis=1), np.sin(both).sum(axis=1), 0 * times]
    )
    assert np.abs(motion.positions - expected).max() <= 1e-15
    assert np.abs(motion.angular_velocities - turning[:, None] * [0, 0, 1]).max() <= 1e-15
    vx = -0.5 * (np.sin(q[:, 0]) * rates[:, 0] + np.sin(heading) * turning)
    assert np.abs(motion.linear_velocities[:, 0] - vx).max() <= 1e-14
    assert motion.name == "planar"
    estimated = planar().poses(times, q, name="cut")
    assert np.abs(estimated.linear_velocities - motion.linear_velocities).max() <= 1e-3
    assert estimated.name == "cut"


def test_limits_are_those_of_the_joints() -> None:
    chain = planar()
    assert chain.lower.tolist() == [-2, -np.inf]
    assert chain.upper.tolist() == [2, np.inf]
    assert chain.velocity_limits.tolist() == [3, np.inf]
    assert chain.acceleration_limits.tolist() == [np.inf, 9]
    assert chain.units == ("rad", "rad")
    assert chain.held({"elbow": 0.0}).lower.tolist() == [-2]


def test_recordings_of_joints_are_read_with_a_chain(tmp_path: Any) -> None:
    times = np.linspace(0, 1, 20)
    q = np.column_stack([times, 0.5 * times])
    file = tmp_path / "joints.csv"
    rows = np.column_stack([times, q])
    np.savetxt(file, rows, delimiter=",", header="t,shoulder,elbow", comments="", fmt="%.17g")
    [read] = ns.load_demonstrations(file, robot=planar())
    assert np.abs(read.positions - planar().poses(times, q).positions).max() <= 1e-15


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: Joint(""), "a name is a text"),
        (lambda: Joint("a", "ball"), "joint 'a': kind must be hinge or slide, got 'ball'"),  # type: ignore[arg-type]
        (lambda: Joint("a", axis=(0, 0, 0)), "axis must not be zero"),
        (lambda: Joint("a", axis=(0, np.nan, 1)), "axis must be 3 finite numbers"),
        (lambda: Joint("a", rotation=(1, 1, 0, 0)), "norm 1"),
        (lambda: Joint("a", rotation=(1, np.nan, 0, 0)), "norm 1"),
        (lambda: Joint("a", zero=np.inf), "zero must be a finite number"),
        (lambda: Joint("a", lower=1.0, upper=1.0), "lower must be less than upper"),
        (lambda: Joint("a", lower=np.nan), "lower must be less than upper"),
        (lambda: Joint("a", velocity=0.0), "must be positive"),
        (lambda: Joint("a", acceleration=np.nan), "must be positive"),
        (lambda: Chain(()), "a chain has 1 to 64 joints, got 0"),
        (lambda: Chain([Joint("a"), Joint("a")]), "different names"),
        (lambda: Chain(["a"]), "joints must be joints"),  # type: ignore[list-item]
        (lambda: Chain([Joint("a")], (0, 0, np.inf)), "position must be 3 finite numbers"),
        (lambda: planar().forward([0.0, np.nan]), "must be 2 finite numbers a row"),
        (lambda: planar().forward([[[0.0, 0.0]]]), "must be 2 finite numbers a row"),
        (lambda: planar().poses([0, 1], np.zeros((2, 3))), "must be 2 finite numbers a row"),
        (lambda: planar().poses([0, 1], np.zeros((2, 2)), np.zeros((3, 2))), "but 3 velocities"),
        (lambda: planar().poses([0, 1, 2], np.zeros((2, 2))), "expected"),
        (lambda: planar().held({"wrist": 1.0}), "no joint is called 'wrist'; there are shoulder"),
        (lambda: planar().held({"elbow": np.nan}), "planar: elbow must be a finite number"),
        (lambda: planar().held({"elbow": 0.0, "shoulder": 0.0}), "1 to 64 joints, got 0"),
        (lambda: Chain.from_data({"joints": []}), "'position' is missing"),
        (lambda: Chain.from_data([]), "not what a chain is made of"),
        (lambda: Chain.from_data(planar().as_data() | {"joints": [{"n": 1}]}), "not what a chain"),
    ],
)
def test_what_is_no_chain_is_refused_in_one_line(wrong: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as refused:
        wrong()
    assert "\n" not in str(refused.value)
