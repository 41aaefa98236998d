"""The scene of thesis 5.2.4: cameras that move back from the place where a WAM's tool is to go.

The thesis took its cameras' intrinsics from a calibration and prints none of them, nor the poses:
the lens (focal length 600 px, 56 degrees over 640 pixels), start, goal and points are ours. As in the
thesis' simulation, a point may leave the image and is still seen.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from vita.experiments.arms import ARMS, Arm
from vita.experiments.cameras import Cameras, Reading, facing
from vita.experiments.trial import World
from vita.types import Array, frozen

FOCAL_PX = 600.0
GOAL = frozen([0.0, 0.75, 0.0, 2.0])
START = frozen(GOAL + np.radians([8.0, -6.0, 8.0, -8.0]))
"""(4,) joints [rad]; the tool has 0.14 m to go."""
JITTER_RAD = np.radians(1.0)
"""Every trial starts up to this far from `START` in each joint."""
POINTS = frozen([[0.05, 0.0, 0.0], [-0.025, 0.043, 0.02], [-0.025, -0.043, -0.02]])
"""(3, 3) the tracked points in the tool frame [m]."""
APART_M = 0.40
NEAREST_M = 0.40
RIGS = ("aligned", "orthogonal", "single")
RIG_NAMES = {
    "aligned": "two cameras side by side, 40 cm apart",
    "orthogonal": "two cameras 90 degrees apart",
    "single": "one camera",
}


def arm() -> Arm:
    """The WAM with 4 joints; the thesis' tool plate adds 3.5 cm."""
    wam = ARMS["wam4"]
    tool = wam.tool.copy()
    tool[2, 3] += 0.035
    return replace(wam, tool=frozen(tool))


@dataclass(frozen=True)
class Fading(Reading):
    """A tracker whose noise grows with the distance of the cameras.

    The thesis calls constant noise "not entirely realistic" (5.2.4). A tracker averages over the pixels
    of its region, so that its noise goes with one over the region's size in the image, hence with the
    distance (vita's template tracker: 0.007, 0.012 and 0.021 px for regions of 100, 60 and 30 pixels).
    """

    distance_m: float | Array = NEAREST_M
    """Of the cameras, one for all or (runs, 1); `sigma_px` is the noise at `NEAREST_M`."""

    def of(self, pixels: Array, random: np.random.Generator) -> Array:
        sigma = self.sigma_px * self.distance_m / NEAREST_M
        return pixels + sigma * random.standard_normal(pixels.shape)


@dataclass(frozen=True, eq=False)
class Scene(World):
    """A world that does the kinematics of each pose once; it is asked for it several times."""

    _last: list[tuple[Array, Array]] = field(default_factory=list, repr=False)

    def features(self, q: Array) -> Array:
        pixels = self.cameras.project(self._points(q))
        return pixels.reshape(*q.shape[:-1], -1)

    def distance(self, q: Array) -> Array:
        return np.abs(self._points(q) - self._points(self.goal)).sum((-1, -2))

    def _points(self, q: Array) -> Array:
        """(runs, k, 3), kept for the goal and for the latest pose."""
        for known, points in self._last:
            if known is q:
                return points
        points = self.arm.points(q, self.local)
        self._last[1 if q is not self.goal else 0 :] = [(q, points)]
        return points


def scene(rig: str, distances: Array, trials: int, reading: Reading, seed: int) -> Scene:
    """`trials` runs at each of `distances` (d,) [m], those of the first distance first."""
    robot = arm()
    runs = len(distances) * trials
    random = np.random.default_rng([seed, len(rig)])
    start = START + JITTER_RAD * random.uniform(-1.0, 1.0, (trials, 4))
    poses = np.repeat(_cameras(rig, robot.pose(GOAL)[:3, 3], distances), trials, axis=0)
    made = Scene(
        robot, Cameras(poses, FOCAL_PX), POINTS, np.tile(start, (len(distances), 1)),
        np.tile(GOAL, (runs, 1)), reading,
    )  # fmt: skip
    made._last.append((made.goal, robot.points(made.goal, POINTS)))
    return made


def _cameras(rig: str, target: Array, distances: Array) -> Array:
    """(d, c, 4, 4) world to camera of `rig` at each distance from `target` (3,) [m]."""
    if rig == "orthogonal":
        angles, asides = np.radians([135.0, -135.0]), np.zeros(2)
    else:
        angles = np.full(2 if rig == "aligned" else 1, np.pi)
        asides = APART_M / 2 * np.array([-1.0, 1.0]) if rig == "aligned" else np.zeros(1)
    forward = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)
    side = np.stack([-np.sin(angles), np.cos(angles), np.zeros_like(angles)], axis=-1)
    eyes = target - distances[:, None, None] * forward + asides[:, None] * side
    return facing(eyes, np.broadcast_to(forward, eyes.shape))
