"""Synthetic sequences with exact ground truth: a textured card that moves over a textured scene.

Each frame is drawn at twice the resolution and averaged down, so that the only error left in the
truth is the tracker's. Everything is procedural and seeded: no pictures are needed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

SIZE = (320, 240)
CARD = 200
"""Side of the card's texture [texels]."""
Motion = Callable[[float], np.ndarray]


def texture(seed: int, side: int = CARD, contrast: float = 45.0) -> np.ndarray:
    """(side, side) float32 grey texture: soft noise of several sizes under random flat shapes."""
    rng = np.random.default_rng(seed)
    picture = np.zeros((side, side), np.float32)
    for cell in (4, 8, 16, 40):
        noise = rng.normal(size=(side // cell + 2, side // cell + 2)).astype(np.float32)
        picture += cv2.resize(noise, (side, side), interpolation=cv2.INTER_CUBIC) * cell**0.3
    picture *= contrast * 0.5 / picture.std()
    for _ in range(side * side // 900):
        centre = tuple(int(x) for x in rng.integers(0, side, 2))
        level = float(rng.normal(0, contrast))
        if rng.random() < 0.5:
            cv2.circle(picture, centre, int(rng.integers(3, 10)), level, -1)
        else:
            w, h = (int(x) for x in rng.integers(4, 16, 2))
            cv2.rectangle(picture, centre, (centre[0] + w, centre[1] + h), level, -1)
    return cv2.GaussianBlur(128 + picture, (0, 0), 1.0)


def similarity(du: float = 0.0, dv: float = 0.0, turn: float = 0.0, scale: float = 1.0) -> np.ndarray:
    """(3, 3) turn by `turn` [rad] and scale about the origin, then shift [px]."""
    c, s = scale * np.cos(turn), scale * np.sin(turn)
    return np.array([[c, -s, du], [s, c, dv], [0, 0, 1.0]])


@dataclass(frozen=True)
class Sequence:
    """`motion(k)` carries points relative to the card's centre to pixels relative to `home`."""

    motion: Motion
    frames: int = 60
    seed: int = 0
    noise: float = 2.0
    """Standard deviation of the pixel noise [grey levels]."""
    light: float = 0.0
    """Amplitude of the slow change of brightness, 0.3 is plus and minus 30 %."""
    cover: Callable[[int], tuple[float, float, float, float] | None] | None = None
    """Frame to (u0, v0, u1, v1) of a flat textured thing that passes in front, or None."""
    home: tuple[float, float] = (160.0, 120.0)
    card_side: float = 100.0
    """Side of the card in the image at motion = identity [px]."""

    def warp(self, k: int) -> np.ndarray:
        """(3, 3) from card pixels about its centre to image pixels of frame `k`."""
        shift = similarity(*self.home)
        return shift @ self.motion(k)

    def truth(self, uv: np.ndarray, k: int) -> np.ndarray:
        """(2,) where the point seen at `uv` in frame 0 is seen in frame `k`."""
        h = self.warp(k) @ np.linalg.inv(self.warp(0)) @ np.append(uv, 1.0)
        return h[:2] / h[2]

    def __iter__(self) -> Iterator[np.ndarray]:
        rng = np.random.default_rng([self.seed, 99])
        card, scene = texture(self.seed + 1), texture(self.seed + 1000, 700)
        thing = texture(self.seed + 2000, 700, contrast=60.0)
        width, height = SIZE
        scene = scene[: 2 * height, : 2 * width].copy()
        # Texel centres are at integers: card pixel x is at texel (x + side/2) * CARD/side - 0.5.
        ratio = CARD / self.card_side
        offset = 0.5 / ratio - self.card_side / 2
        into_card = np.array([[1 / ratio, 0, offset], [0, 1 / ratio, offset], [0, 0, 1.0]])
        double = np.array([[2.0, 0, 0.5], [0, 2.0, 0.5], [0, 0, 1]])
        for k in range(self.frames):
            picture = scene.copy()
            whole = double @ self.warp(k) @ into_card
            cv2.warpPerspective(
                card, whole, (2 * width, 2 * height), dst=picture, borderMode=cv2.BORDER_TRANSPARENT
            )
            box = self.cover(k) if self.cover else None
            if box is not None:
                u0, u1 = (round(float(np.clip(2 * x, 0, 2 * width))) for x in box[::2])
                v0, v1 = (round(float(np.clip(2 * x, 0, 2 * height))) for x in box[1::2])
                picture[v0:v1, u0:u1] = thing[v0:v1, u0:u1]
            picture = cv2.resize(picture, SIZE, interpolation=cv2.INTER_AREA)
            gain = 1 + self.light * np.sin(2 * np.pi * k / 40)
            picture = (picture - 128) * 0.8 * gain + 118 * gain + rng.normal(0, self.noise, picture.shape)
            frame = np.repeat(np.clip(np.rint(picture), 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)
            frame.setflags(write=False)
            yield frame


def circle(speed: float, radius: float = 30.0) -> Motion:
    """Translation along a circle at `speed` [px/frame], starting at the home position."""
    return lambda k: similarity(
        radius * np.sin(k * speed / radius), radius * (1 - np.cos(k * speed / radius))
    )


def swing(speed: float = 3.0, turn: float = 0.5, zoom: float = 0.2, tilt: float = 0.0) -> Motion:
    """A circle with slow rotation [rad], scale [share] and perspective [1/px] swings on top."""

    def motion(k: float) -> np.ndarray:
        base = circle(speed)(k) @ similarity(
            turn=turn * np.sin(k / 25), scale=1 + zoom * np.sin(k / 18)
        )
        lean = np.eye(3)
        lean[2, :2] = tilt * np.sin(k / 15), tilt * np.sin(k / 22)
        return base @ lean

    return motion
