"""The ideal tracker of experiments: ground truth with errors of one's choice."""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np

from vita.errors import BadInput, UnknownName
from vita.scenario.schema import NoiseSpec
from vita.types import Array, Feature, Image, frozen
from vita.vision.images import inside

NOISE_KINDS = ("perfect", "integer", "gaussian", "distance")
PERIOD_S = 1 / 30
"""Time from one frame to the next [s]."""


def tracker_seed(seed: int, name: str) -> int:
    """A seed of a tracker's own, so that adding one does not change the others' noise."""
    return zlib.crc32(f"{seed}/{name}".encode())


class ProjectedTracker:
    """Reports the pixel that `project()` gives, (2,) [px], with errors; lost where that is not seen.

    The errors are those of the thesis' simulations (5.1.2, 5.2.4): none, whole pixels, or Gaussian
    noise of a constant deviation. It ends on the remark (5.3) that constant noise is not realistic,
    because real trackers get worse with the distance to the camera, and gives no formula. `distance`
    is the plainest model of that: a deviation in proportion to the distance, as the target has
    fewer pixels in proportion. Drift, covered spells and single wrong frames go with any kind.
    """

    kind = "projected"

    def __init__(
        self,
        project: Callable[[], Array],
        noise: NoiseSpec | None = None,
        seed: int = 0,
        size: tuple[int, int] | None = None,
        *,
        distance: Callable[[], float] | None = None,
        period_s: float = PERIOD_S,
    ) -> None:
        """`size` is the image's (width, height); None takes it from each frame.

        `distance()` is that of the point to the camera [m], needed by the noise of that name. Time
        is counted in frames, one every `period_s`, starting at 0 with the first update.
        """
        self._noise = _checked(noise or NoiseSpec())
        if self._noise.kind == "distance" and distance is None:
            raise BadInput("this noise needs to know the distance to the camera", "noise.kind")
        self._project, self._distance, self._size = project, distance, size
        self._random = np.random.default_rng(seed)
        # Directions have a stream of their own, so that drift and jumps leave the noise as it was.
        self._directions = np.random.default_rng([seed, 1])
        self._drift = self._noise.drift_px_s * period_s * _direction(self._directions)
        jumps = self._noise.jump_every_s
        self._jump_every = max(1, round(jumps / period_s)) if jumps > 0 else 0
        self._period_s, self._frame = period_s, -1
        self._uv = frozen([0.0, 0.0])

    def update(self, frame: Image) -> Feature:
        """The point's pixel in the next frame."""
        self._frame += 1
        # Drawn in lost frames too: the noise of a frame then does not depend on what came before.
        noise = self._random.standard_normal(2)
        jump = self._jump()
        truth = np.asarray(self._project(), dtype=np.float64)
        size = self._size or (frame.shape[1], frame.shape[0])
        if truth.shape != (2,) or not inside(truth, size):
            return Feature(self._uv, "lost", 0.0, None, detail="outside the image")
        # Half a period of slack keeps rounding from deciding on which frame a spell begins.
        now = (self._frame + 0.5) * self._period_s
        if any(start <= now < end for start, end in self._noise.occluded):
            return Feature(self._uv, "lost", 0.0, None, detail="covered, as its noise model says")
        uv = truth + self._deviation() * noise + self._frame * self._drift + jump
        self._uv = frozen(np.rint(uv) if self._noise.kind == "integer" else uv)
        return Feature(self._uv, "ok", 1.0, None, detail=f"ground truth, {self._noise.kind}")

    def _deviation(self) -> float:
        """Standard deviation of this frame's noise [px]."""
        if self._noise.kind == "gaussian":
            return self._noise.sigma_px
        if self._noise.kind == "distance":
            assert self._distance is not None  # The constructor sees to it.
            return self._noise.sigma_px * float(self._distance()) / self._noise.at_m
        return 0.0

    def _jump(self) -> Array:
        """(2,) how far this one frame is off [px]; zero in all but every so many."""
        if not self._jump_every or self._frame == 0 or self._frame % self._jump_every:
            return np.zeros(2)
        return self._noise.jump_px * _direction(self._directions)


def _direction(random: np.random.Generator) -> Array:
    """(2,) random unit vector."""
    angle = random.uniform(0.0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _checked(noise: NoiseSpec) -> NoiseSpec:
    """`noise`, or `BadInput` that names what is wrong with it."""
    if noise.kind not in NOISE_KINDS:
        raise UnknownName("noise", noise.kind, NOISE_KINDS, "noise.kind")
    if not 0 <= noise.sigma_px < np.inf:
        raise BadInput(f"{noise.sigma_px} is not a standard deviation in pixels", "noise.sigma_px")
    if not 0 < noise.at_m < np.inf:
        raise BadInput(f"{noise.at_m} is not a distance in metres", "noise.at_m")
    for key in ("drift_px_s", "jump_px", "jump_every_s"):
        value = getattr(noise, key)
        if not 0 <= value < np.inf:
            raise BadInput(f"{value} must be 0 or more", f"noise.{key}")
    if (noise.jump_px > 0) != (noise.jump_every_s > 0):
        raise BadInput("jump_px and jump_every_s belong together", "noise.jump_px")
    for i, (start, end) in enumerate(noise.occluded):
        if not 0 <= start < end:
            raise BadInput(f"{start:g} to {end:g} s is not a span of time", f"noise.occluded[{i}]")
    return noise
