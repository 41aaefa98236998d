"""The controller's own model of an arm agrees with the robot's drawing and with finite differences."""

from pathlib import Path

import numpy as np
import pytest

from vita.errors import BadInput
from vita.impedance.arm_model import ArmModel
from vita.sim.robots import ROBOTS, RobotModel, load_robot

CROOKED = """<robot name="crooked">
  <link name="floor"/><link name="a"/><link name="b"/><link name="c"/><link name="plate"/>
  <joint name="stand" type="fixed"><parent link="floor"/><child link="a"/>
    <origin xyz="0.1 -0.2 0.3" rpy="0.2 -0.4 0.9"/></joint>
  <joint name="turn" type="KIND"><parent link="a"/><child link="b"/>
    <origin xyz="0 0.05 0.2" rpy="0.5 0 -0.3"/><axis xyz="1 2 -2"/>
    <limit lower="-2" upper="2" velocity="1" effort="9"/></joint>
  <joint name="bridge" type="fixed"><parent link="b"/><child link="c"/>
    <origin xyz="0.3 0 0" rpy="0 1.1 0"/></joint>
  <joint name="bend" type="revolute"><parent link="c"/><child link="plate"/>
    <origin xyz="0 0.1 0.2" rpy="-0.7 0.1 0"/><axis xyz="0 -1 0"/>
    <limit lower="-1" upper="2" velocity="1" effort="9"/></joint>
  <link name="tip"/>
  <joint name="screwed" type="fixed"><parent link="plate"/><child link="tip"/>
    <origin xyz="0 0 0.15" rpy="0 0 0.4"/></joint>
</robot>
"""


def crooked(folder: Path, kind: str = "revolute") -> RobotModel:
    path = folder / "crooked.urdf"
    path.write_text(CROOKED.replace("KIND", kind))
    return load_robot(str(path))


def model_of(name: str, folder: Path) -> RobotModel:
    return crooked(folder) if name == "crooked" else load_robot(name)


def random_poses(arm: ArmModel, count: int, seed: int = 4) -> np.ndarray:
    lower, upper = ([getattr(joint, side) for joint in arm.joints] for side in ("lower", "upper"))
    return np.random.default_rng(seed).uniform(lower, upper, (count, arm.n))


@pytest.mark.parametrize("name", [*ROBOTS, "crooked"])
def test_the_model_stands_where_the_robot_stands(name, tmp_path):
    """The tool to 1e-12 m, and every joint's frame on the link that it turns."""
    model = model_of(name, tmp_path)
    arm = model.arm_model()
    turned = [model.bodies[joint.child] for joint in model.urdf_joints]
    for q in random_poses(arm, 50):
        poses, frames = model.poses(q), arm.frames(q)
        np.testing.assert_allclose(arm.pose(q), poses["tool"], atol=1e-12)
        np.testing.assert_allclose(frames[arm.n], poses["tool"], atol=1e-12)
        for body, frame in zip(turned, frames, strict=False):
            np.testing.assert_allclose(frame, poses[body], atol=1e-12)


def moved(arm: ArmModel, q: np.ndarray, last: int, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The point `local` of frame `last` in the base frame, and the frame's rotation."""
    frame = arm.frames(q)[last]
    return frame[:3, :3] @ local + frame[:3, 3], frame[:3, :3]


@pytest.mark.parametrize("joints", [None, 2])
@pytest.mark.parametrize("name", [*ROBOTS, "crooked"])
def test_the_jacobian_is_the_derivative_of_the_frames(name, joints, tmp_path):
    """Central differences, of the tool and of a point on an inner link, which later joints do not move."""
    arm, h = model_of(name, tmp_path).arm_model(), 1e-6
    local = np.zeros(3) if joints is None else np.array([0.05, -0.1, 0.2])
    last = arm.n if joints is None else joints - 1
    for q in random_poses(arm, 10):
        point, R = moved(arm, q, last, local)
        J = arm.jacobian(arm.frames(q), None if joints is None else point, joints)
        expected = np.zeros((6, arm.n))
        for i in range(arm.n):
            there, R_there = moved(arm, q + h * np.eye(arm.n)[i], last, local)
            back, R_back = moved(arm, q - h * np.eye(arm.n)[i], last, local)
            spin = (R_there - R_back) @ R.T / (2 * h)
            expected[:, i] = *((there - back) / (2 * h)), spin[2, 1], spin[0, 2], spin[1, 0]
        np.testing.assert_allclose(J, expected, atol=1e-8)
    if joints is not None:
        assert (J[:, joints:] == 0).all()


def test_an_arm_that_slides_is_refused_by_the_joints_name(tmp_path):
    with pytest.raises(BadInput, match="'turn' slides"):
        crooked(tmp_path, "prismatic").arm_model()


def test_a_wrong_number_of_joints_and_wrong_shapes_are_refused():
    arm = load_robot("tx90").arm_model()
    with pytest.raises(BadInput, match="6 joints"):
        arm.frames(np.zeros(7))
    with pytest.raises(BadInput, match=r"axes"):
        ArmModel("x", arm.joints, arm.before, arm.axes[:5], arm.T_last_tool)
    with pytest.raises(BadInput, match="finite"):
        ArmModel("x", arm.joints, arm.before * np.nan, arm.axes, arm.T_last_tool)


def test_the_plain_data_of_the_model_cannot_be_changed():
    arm = load_robot("wam4").arm_model()
    with pytest.raises(ValueError, match="read-only"):
        arm.before[0] = 0.0


def across(v: np.ndarray, axis: np.ndarray) -> np.ndarray:
    return v - axis * (v @ axis)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_reach_from_shoulder_to_wrist_is_the_elbows_alone_and_longest_where_it_is_straight(name):
    """At random poses moving any other joint leaves the distance; where it is longest, upper arm and forearm
    are parallel, seen along the elbow's axis."""
    arm = load_robot(name).arm_model()
    assert arm.landmarks is not None
    shoulder, elbow, wrist = arm.landmarks

    def reach(q: np.ndarray) -> float:
        frames = arm.frames(q)
        return float(np.linalg.norm(frames[wrist, :3, 3] - frames[shoulder, :3, 3]))

    for q, other in zip(random_poses(arm, 20, 1), random_poses(arm, 20, 2), strict=True):
        other[elbow] = q[elbow]
        assert reach(q) == pytest.approx(reach(other), abs=1e-12)
    q, lengths = np.zeros(arm.n), []
    angles = np.linspace(-np.pi, np.pi, 3601)
    for q[elbow] in angles:
        lengths.append(reach(q))
    assert np.ptp(lengths) > 0.5, "an elbow that can stretch"
    q[elbow] = angles[int(np.argmax(lengths))]
    frames = arm.frames(q)
    axis = frames[elbow, :3, :3] @ arm.axes[elbow]
    upper = across(frames[elbow, :3, 3] - frames[shoulder, :3, 3], axis)
    fore = across(frames[wrist, :3, 3] - frames[elbow, :3, 3], axis)
    cosine = upper @ fore / np.linalg.norm(upper) / np.linalg.norm(fore)
    assert np.degrees(np.arccos(min(1.0, cosine))) < 0.2


def test_a_foreign_arm_has_no_landmarks_and_keeps_its_names(tmp_path):
    arm = crooked(tmp_path).arm_model()
    assert arm.landmarks is None and [joint.name for joint in arm.joints] == ["turn", "bend"]
    assert arm.n == 2 and arm.name == "crooked"
