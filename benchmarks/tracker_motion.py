"""How the card of a benchmark sequence moves: paths of its centre, and its pose about it.

A card is a plane in front of a pinhole camera, so that its image changes by a homography with real
perspective. Its centre is put exactly on the path, which makes the speed exact.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

FOCAL_PX = 400.0
"""Short enough for a tilted card of 100 px to show perspective."""
ROLL, TILT, ZOOM = np.radians(25.0), np.radians(25.0), 0.15
"""Amplitudes of the swings [rad, rad, share]."""
Path = Callable[[float], np.ndarray]
"""Frame number to (2,) pixel of the card's centre."""
Pose = Callable[[float], np.ndarray]
"""Frame number (fractions are instants between frames) to (3, 3) from card pixels to image pixels."""


def plane(centre: np.ndarray, roll: float, tilt: tuple[float, float], zoom: float) -> np.ndarray:
    """(3, 3) homography of a plane turned by `roll` and `tilt` [rad], its origin seen at `centre` [px]."""
    (cr, sr), (ca, sa), (cb, sb) = ((np.cos(a), np.sin(a)) for a in (roll, *tilt))
    turn = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1.0]])
    lean = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]]) @ np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    r = turn @ lean
    local = np.vstack([FOCAL_PX * r[:2], r[2]])
    local[:, 2] = 0, 0, FOCAL_PX / zoom
    shift = np.array([[1, 0, centre[0]], [0, 1, centre[1]], [0, 0, 1.0]])
    return shift @ local


def swinging(rng: np.random.Generator, path: Path, period: float, amount: float = 1.0) -> Pose:
    """The card rolls, tilts and comes nearer and farther while its centre follows `path`.

    `period` [frames] is about that of the swings; `amount` scales their amplitudes.
    """
    periods = period * rng.uniform(0.8, 1.25, 4)
    phases = rng.uniform(0, 2 * np.pi, 4)

    def pose(k: float) -> np.ndarray:
        roll, a, b, zoom = amount * np.sin(2 * np.pi * k / periods + phases)
        return plane(path(k), ROLL * roll, (TILT * a, TILT * b), 1 + ZOOM * zoom)

    return pose


def period_of(speed: float) -> float:
    """Period of the swings [frames] at `speed` [px/frame]: what moves faster also turns faster."""
    return 160 / np.sqrt(max(speed, 0.5))


def resting(rng: np.random.Generator) -> Pose:
    """A card that does not move at all, tilted and at a fraction of a pixel."""
    roll, a, b, zoom = rng.uniform(-0.7, 0.7, 4)
    fixed = plane(_middle(rng), ROLL * roll, (TILT * a, TILT * b), 1 + ZOOM * zoom)
    return lambda k: fixed


def ring(rng: np.random.Generator, speed: float) -> Path:
    """A circle at exactly `speed` [px/frame] along the arc."""
    middle, radius = _middle(rng), rng.uniform(50, 85)
    phase, sense = rng.uniform(0, 2 * np.pi), rng.choice([-1, 1])

    def path(k: float) -> np.ndarray:
        angle = phase + sense * speed * k / radius
        return middle + radius * np.array([np.cos(angle), np.sin(angle)])

    return path


def zigzag(rng: np.random.Generator, speed: float, frames: int) -> Path:
    """Straight runs at `speed` [px/frame] that change direction at once: no prediction helps there."""
    middle = _middle(rng)
    at, heading, left = np.zeros(2), rng.uniform(0, 2 * np.pi), 0
    places = []
    for _ in range(frames + 1):
        places.append(middle + at)
        ahead = at + speed * np.array([np.cos(heading), np.sin(heading)])
        if left == 0 or np.hypot(*ahead) > 80:
            inward = np.arctan2(*(-at[::-1]))
            heading = inward + rng.uniform(-1.0, 1.0) if np.hypot(*at) > 40 else rng.uniform(0, 2 * np.pi)
            left = int(rng.integers(3, 9))
        at = at + speed * np.array([np.cos(heading), np.sin(heading)])
        left -= 1
    table = np.array(places)
    whole = np.arange(len(table))
    return lambda k: np.array([np.interp(k, whole, table[:, i]) for i in (0, 1)])


def excursion(rng: np.random.Generator, speed: float, side: float, size: tuple[int, int]) -> tuple[Path, int]:
    """Straight out over one border of the view and back, and the number of frames that takes.

    A region of `side` [px] at the card's centre is wholly out for about 18 frames.
    """
    half = np.array(size) / 2
    out = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)][int(rng.integers(4))], dtype=float)
    along = out[::-1] * rng.choice([-1, 1])
    room = 0.7 * side + rng.uniform(20, 40)
    start = half + out * (half - room) + along * rng.uniform(-60, 60)
    start = start + rng.uniform(0, 1, 2)
    depth = room + 0.85 * side + 9 * speed
    turn = depth / speed

    def path(k: float) -> np.ndarray:
        travelled = depth - abs(min(k, 2 * turn) - turn) * speed
        return start + out * travelled + along * 0.4 * k

    return path, int(2 * turn) + 14


def _middle(rng: np.random.Generator) -> np.ndarray:
    return np.array([320.0, 240.0]) + rng.uniform(-35, 35, 2)
