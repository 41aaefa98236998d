"""Edges and ellipses with exact ground truth, drawn in closed form: smooth steps in floating point."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr

SIZE = (320, 240)
V, U = np.mgrid[0 : SIZE[1], 0 : SIZE[0]].astype(float)
BLUR = 0.7
"""Standard deviation of the optics that blur every edge [px]."""


def edge(middle, angle: float, dark: float | np.ndarray = 80.0, bright: float = 200.0) -> np.ndarray:
    """(h, w) a straight edge through `middle`; bright where `across` points to."""
    share = ndtr((np.stack([U, V], axis=-1) - middle) @ across(angle) / BLUR)
    return dark * (1 - share) + bright * share


def along(angle: float) -> np.ndarray:
    return np.array([math.cos(angle), math.sin(angle)])


def across(angle: float) -> np.ndarray:
    return np.array([-math.sin(angle), math.cos(angle)])


def ellipse(
    center, half_axes, angle: float, inside: float = 200.0, outside: float | np.ndarray = 80.0
) -> np.ndarray:
    """(h, w) an ellipse by its half axes [px] and the angle of the first one [rad].

    Averaged over 4 x 4 points of each pixel; `outside` may be a picture.
    """
    reach = max(half_axes) + 1
    u0, v0 = np.clip(np.floor(center - reach), 0, SIZE).astype(int)
    u1, v1 = np.clip(np.ceil(center + reach) + 1, 0, SIZE).astype(int)
    box = np.s_[v0:v1, u0:u1]
    share = np.zeros_like(U)
    grid = (np.arange(4) - 1.5) / 4
    for du in grid:
        for dv in grid:
            away = np.stack([U[box] + du, V[box] + dv], axis=-1) - center
            x, y = away @ along(angle) / half_axes[0], away @ across(angle) / half_axes[1]
            share[box] += (x * x + y * y < 1) / 16
    return outside * (1 - share) + inside * share


def frame(picture: np.ndarray, rng: np.random.Generator, noise: float = 2.0) -> np.ndarray:
    """(h, w, 3) uint8 with Gaussian noise [grey levels], read-only."""
    noisy = np.clip(np.rint(picture + rng.normal(0, noise, picture.shape)), 0, 255).astype(np.uint8)
    out = np.repeat(noisy[:, :, None], 3, axis=2)
    out.setflags(write=False)
    return out
