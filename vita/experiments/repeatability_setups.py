"""The thesis' four repeatability set-ups (section 5.2.3), as far as it tells them.

It tells distances and the baseline. Poses, the points on the cards and the lens are ours: images of
640 by 480 pixels with a focal length of 600 pixels (56 by 44 degrees, a common webcam).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.experiments.arms import Arm, arm_of
from vita.experiments.cameras import Cameras, look_at
from vita.sim.dh import DHChain
from vita.types import Array, frozen

FOCAL_PX, WIDTH_PX, HEIGHT_PX = 600.0, 640, 480
ELBOW_M = 0.55
"""The WAM's elbow is so far from the first joint's axis when the upper arm is level."""


@dataclass(frozen=True, eq=False)
class Setup:
    """An arm at its goal pose, the points that are tracked, and the cameras."""

    key: str
    title: str
    table: str
    """Number of the thesis' table."""
    arm: Arm
    goal: Array
    """(n,) joints at the goal [rad]."""
    points: Array
    """(k, 3) tracked points in the tool frame; with `in_hand`, where they are in it at the goal [m]."""
    cameras: Cameras
    """World to camera; with `in_hand`, tool to camera."""
    in_hand: bool
    reported_mm: float
    """The thesis' mean error to a reported pose."""
    commanded_mm: float
    servo_mm: float
    """The thesis' mean error with visual servoing."""

    @property
    def rows(self) -> int:
        return 2 * self.cameras.count * len(self.points)

    def pixels(self, q: Array, push: Array | float = 0.0) -> Array:
        """(..., c, k, 2) true pixels at joints `q` (..., n), the tool pushed aside by `push` (3,) [m]."""
        if not self.in_hand:
            return self.cameras.project(self.arm.points(q, self.points) + push)
        world = self.arm.points(self.goal, self.points)
        pose = self.arm.pose(q)
        seen = (world - push - pose[..., None, :3, 3]) @ pose[..., :3, :3]
        return self.cameras.project(seen)

    def features(self, q: Array, push: Array | float = 0.0) -> Array:
        """(..., m) the same in one row."""
        return self.pixels(q, push).reshape(*q.shape[:-1], self.rows)

    def in_view(self, q: Array) -> float:
        """Share of poses `q` (..., n) at which every point is inside every image."""
        inside = np.abs(self.pixels(q)) < np.array([WIDTH_PX, HEIGHT_PX]) / 2
        return float(inside.all((-3, -2, -1)).mean())


def setups() -> tuple[Setup, ...]:
    """All of them, in the thesis' order."""
    return (_one_joint(), _to_hand(), _in_hand("stereo"), _in_hand("mono"), _seven_joints())


def setup_of(key: str) -> Setup:
    return next(setup for setup in setups() if setup.key == key)


CARD = np.array([[0.03, 0.03, 0.0], [-0.03, 0.03, 0.0], [0.0, -0.03, 0.02]])
"""(3, 3) middles of three tracked regions on playing cards [m]."""
WIDE = np.array([[0.06, 0.02, 0.03], [-0.06, 0.02, -0.03], [0.0, -0.03, 0.03]])
"""(3, 3) the same on cards in front of a camera, at somewhat different depths [m]."""


def _one_joint() -> Setup:
    """Table 5.4: the first joint alone presses the dial with a flat surface on the elbow."""
    tool = np.eye(4)
    tool[0, 3] = ELBOW_M
    chain = DHChain((0.0,), (0.0,), (0.0,), (0.0,))
    arm = Arm("WAM, joint 1", chain, arm_of("wam4").limits[:1], frozen(tool))
    markers = np.array([[0.0, 0.0, 0.02], [0.0, 0.0, -0.02]])
    target = arm.pose(np.zeros(1))[:3, 3]
    cameras = around(target, 0.20, np.radians([-45.0, 45.0]), height=0.0)
    return Setup("one", "1 joint", "5.4", arm, np.zeros(1), markers, cameras, False, 0.163, 0.093, 0.038)


def _to_hand() -> Setup:
    """Table 5.5: 4 joints, cameras 50 cm from the target and 30 cm apart."""
    arm, goal = arm_of("wam4"), np.array([0.0, 0.75, 0.0, 2.0])
    cameras = _stereo(arm.pose(goal)[:3, 3])
    return Setup("four", "4 joints, eye-to-hand", "5.5", arm, goal, CARD, cameras, False, 0.165, 0.132, 0.036)


def _in_hand(kind: str) -> Setup:
    """Table 5.6: cameras on the arm, 40 cm apart, the target 35 cm ahead; or the left one alone."""
    arm, goal, ahead = arm_of("wam4"), np.array([0.0, 0.75, 0.0, 2.0]), np.array([0.0, 0.0, 0.35])
    eyes = np.array([[-0.2, 0.0, 0.0], [0.2, 0.0, 0.0]])
    # Aimed a little aside of the target, or it would leave the images at the start.
    poses = look_at(eyes, ahead - [0.0, 0.06, 0.0], up=np.array([0.0, 1.0, 0.0]))
    if kind == "mono":
        poses = poses[:1]
    means = (0.155, 0.099, 0.036 if kind == "stereo" else 0.038)
    title = f"4 joints, eye-in-hand, {kind}"
    return Setup(kind, title, "5.6", arm, goal, WIDE + ahead, Cameras(poses, FOCAL_PX), True, *means)


def _seven_joints() -> Setup:
    """Table 5.7: 7 joints in a configuration like that of table 5.5."""
    arm, goal = arm_of("wam7"), np.array([0.1, 0.7, 0.1, 2.0, 0.2, 0.8, 0.1])
    cameras = _stereo(arm.pose(goal)[:3, 3])
    return Setup("seven", "7 joints", "5.7", arm, goal, CARD, cameras, False, 0.472, 0.140, 0.093)


def around(target: Array, distance: float, azimuths: Array, height: float) -> Cameras:
    """Cameras at a distance from `target` (3,) [m] that look at it from the front, at `azimuths` [rad]."""
    aside = np.stack([np.cos(azimuths), np.sin(azimuths), np.full(len(azimuths), height)], axis=-1)
    eyes = target + distance * aside / np.linalg.norm(aside, axis=-1, keepdims=True)
    return Cameras(look_at(eyes, target), FOCAL_PX)


def _stereo(target: Array) -> Cameras:
    half = np.arcsin(0.15 / 0.50)
    return around(target, 0.50, np.array([-half, half]), height=0.0)
