"""Rendering the benchmark's sequences, with a ground truth that is exact.

A textured card is drawn through its homography at twice the resolution over a photographed scene,
averaged down, and then treated like a camera treats light: exposure over an interval, defocus,
gain and bias, noise, eight bits. Sub-frames are averaged for motion blur; the truth is then the mean
place of a point over the exposure, which is where the centre of its streak is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from tracker_motion import Pose
from tracker_photos import OVERSAMPLING

SIZE = (640, 480)
Box = tuple[float, float, float, float]
Layer = tuple[np.ndarray, np.ndarray]
"""Texture (h, w, 3) and the (3, 3) that carries its texels to pixels."""
_MID = (OVERSAMPLING - 1) / 2
_FINER = np.array([[OVERSAMPLING, 0, _MID], [0, OVERSAMPLING, _MID], [0, 0, 1.0]])
"""From frame pixels to those of the finer picture: centres are at integers in both."""
_AXIS = (np.arange(32) + 0.5) / 32 - 0.5
_GRID = np.stack(np.meshgrid(_AXIS, _AXIS), axis=-1).reshape(-1, 2)
"""(1024, 2) points spread evenly over a square of side 1 about the origin."""


@dataclass(frozen=True, eq=False)
class PhotoSequence:
    """A card that moves over a scene, its frames and its truth."""

    card: np.ndarray
    """(n, n, 3) float32 texture, `OVERSAMPLING` texels a pixel at zoom 1."""
    backdrop: np.ndarray
    """(2 h, 2 w, 3) float32 picture of the scene at the finer resolution."""
    pose: Pose
    frames: int
    seed: int
    noise: float = 2.0
    """Standard deviation [grey levels], the same in the three channels, so that grey has it too."""
    light: Callable[[int], tuple[float, float]] | None = None
    """Frame to gain and bias [grey levels]."""
    exposure: float = 0.0
    """Share of the frame period that the shutter is open; above 0 there is motion blur."""
    focus: Callable[[int], float] | None = None
    """Frame to the standard deviation of defocus [px]."""
    cover: Callable[[int], Box | None] | None = None
    """Frame to (u0, v0, u1, v1), in pixels of frame 0, of a thing that rides in front of the card."""
    thing: np.ndarray | None = None
    """(m, m, 3) float32 texture of that thing."""
    name: str = ""

    @cached_property
    def _start_inverse(self) -> np.ndarray:
        return np.linalg.inv(self.pose(0.0))

    def instants(self, k: int) -> np.ndarray:
        """Times [frames] whose pictures are averaged into frame `k`; frame 0 is always sharp."""
        if self.exposure == 0 or k == 0:
            return np.array([float(k)])
        (u0, v0), (u1, v1) = (_apply(self.pose(t), np.zeros((1, 2)))[0] for t in (k - 0.5, k + 0.5))
        count = int(np.clip(np.ceil(1.5 * self.exposure * np.hypot(u1 - u0, v1 - v0)), 3, 16))
        return k + self.exposure * ((np.arange(count) + 0.5) / count - 0.5)

    def truth(self, points: np.ndarray, k: int) -> np.ndarray:
        """(n, 2) where the `points` (n, 2) of frame 0 are seen in frame `k` [px]."""
        points = np.asarray(points, dtype=float).reshape(-1, 2)
        return np.mean([self._carry(points, t) for t in self.instants(k)], axis=0)

    def visible(self, click: np.ndarray, side: float, k: int) -> float:
        """Share of the square region about `click` (2,) of frame 0 that frame `k` shows."""
        spread = np.asarray(click) + side * _GRID
        seen = self.truth(spread, k)
        inside = np.all((seen > -0.5) & (seen < np.array(SIZE) - 0.5), axis=1)
        box = self.cover(k) if self.cover else None
        if box is not None:
            u, v = spread.T
            inside &= ~((u > box[0]) & (u < box[2]) & (v > box[1]) & (v < box[3]))
        return float(inside.mean())

    def __iter__(self) -> Iterator[np.ndarray]:
        """(h, w, 3) RGB uint8 frames, read-only."""
        rng = np.random.default_rng([self.seed, 77])
        width, height = SIZE
        speckle = rng.normal(0, self.noise, (height + 97, width + 89)).astype(np.float32)
        speckle = cv2.merge([speckle] * 3)
        plain = _averaged(self.backdrop)
        for k in range(self.frames):
            picture = self._exposed(plain, k)
            sigma = self.focus(k) if self.focus else 0.0
            if sigma > 0.05:
                picture = cv2.GaussianBlur(picture, (0, 0), sigma)
            gain, bias = self.light(k) if self.light else (1.0, 0.0)
            # One large field of noise, read from another place each time, turned at random.
            x, y = int(rng.integers(0, 90)), int(rng.integers(0, 98))
            field = speckle[y : y + height, x : x + width]
            sign = float(rng.choice([-1.0, 1.0]))
            frame = cv2.addWeighted(picture, gain, field, sign, bias, dtype=cv2.CV_8U)
            frame.setflags(write=False)
            yield frame

    def _exposed(self, plain: np.ndarray, k: int) -> np.ndarray:
        """(h, w, 3) float32: what falls on the sensor during frame `k`; drawn only where things move."""
        picture = plain.copy()
        instants = [self._layers(t, k) for t in self.instants(k)]
        (x0, y0), (x1, y1) = _extent([layer for layers in instants for layer in layers])
        if x1 <= x0 or y1 <= y0:
            return picture
        s = OVERSAMPLING
        behind = self.backdrop[s * y0 : s * y1, s * x0 : s * x1]
        local = _FINER @ np.array([[1, 0, -x0], [0, 1, -y0], [0, 0, 1.0]])
        drawn = [_draw(behind, layers, local) for layers in instants]
        picture[y0:y1, x0:x1] = _averaged(np.mean(drawn, axis=0) if len(drawn) > 1 else drawn[0])
        return picture

    def _layers(self, t: float, k: int) -> list[Layer]:
        """Card and thing as they are at instant `t`, the nearest last."""
        layers = [(self.card, self.pose(t) @ _card_square(len(self.card)))]
        box = self.cover(k) if self.cover else None
        if box is not None and self.thing is not None:
            # A texture has whole texels, so the box has whole halves of pixels.
            u0, v0, u1, v1 = (round(OVERSAMPLING * x) for x in box)
            cut = self.thing[: v1 - v0, : u1 - u0]
            if min(cut.shape[:2]) > 2:
                place = np.array([[1, 0, u0 / OVERSAMPLING], [0, 1, v0 / OVERSAMPLING], [0, 0, 1.0]])
                layers.append((cut, self.pose(t) @ self._start_inverse @ place @ _texels()))
        return layers

    def _carry(self, points: np.ndarray, t: float) -> np.ndarray:
        return _apply(self.pose(t) @ self._start_inverse, points)


def _extent(layers: list[Layer]) -> tuple[np.ndarray, np.ndarray]:
    """(2,) first and end pixel of the part of the view that the layers can touch."""
    ends = []
    for texture, matrix in layers:
        h, w = texture.shape[:2]
        ends.append(_apply(matrix, np.array([[0, 0], [w, 0], [w, h], [0, h]], float)))
    corners = np.concatenate(ends)
    low, high = np.floor(corners.min(axis=0)) - 2, np.ceil(corners.max(axis=0)) + 3
    return np.clip(low, 0, SIZE).astype(int), np.clip(high, 0, SIZE).astype(int)


def _draw(behind: np.ndarray, layers: list[Layer], local: np.ndarray) -> np.ndarray:
    fine = behind.copy()
    for texture, matrix in layers:
        cv2.warpPerspective(
            texture, local @ matrix, (fine.shape[1], fine.shape[0]), dst=fine,
            flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT,
        )  # fmt: skip
    return fine


def _averaged(fine: np.ndarray) -> np.ndarray:
    size = fine.shape[1] // OVERSAMPLING, fine.shape[0] // OVERSAMPLING
    return cv2.resize(fine, size, interpolation=cv2.INTER_AREA)


def _texels() -> np.ndarray:
    """(3, 3) from texels to pixels with the first texel's corner at the origin."""
    return np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, OVERSAMPLING]]) / OVERSAMPLING


def _card_square(n: int) -> np.ndarray:
    """(3, 3) from the texels of an (n, n) card to pixels about its centre."""
    half = n / OVERSAMPLING / 2
    return np.array([[1, 0, -half], [0, 1, -half], [0, 0, 1.0]]) @ _texels()


def _apply(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    h = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return h[:, :2] / h[:, 2:]
