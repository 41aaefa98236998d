"""Judging a fit in a frame that motion has blurred."""

from __future__ import annotations

import math

import cv2
import numpy as np

from vita.types import Array
from vita.vision import robust
from vita.vision.images import Crop, Gray
from vita.vision.template import Fit, Template


def through_blur(template: Template, crop: Crop, fit: Fit, motion: Array) -> Fit:
    """`fit` judged against the template as a moving camera shows it, if that agrees better.

    `motion` (2,) is the way in one frame period [px]; the shutter is open for a part of it.
    The blur is even on both sides, so the pose is as good as before; only the looks differ.
    """
    slope = fit.warp[:2, :2] - np.outer(fit.warp[:2, 2], fit.warp[2, :2])
    cells = np.linalg.solve(slope, motion) * template.n / 2
    if float(np.abs(cells).max()) < 1.5:
        return fit
    values = template.sample(crop, fit.warp).ravel()
    trust, best = template.trust.ravel(), fit
    for share in (0.3, 0.6, 0.9):
        blurred = _smear(template.plain_shape, cells * share).ravel()
        gain, bias = robust.light(values, blurred, trust)
        if gain < 0.3 * template.deviation:
            continue
        residual = (values - np.float32(bias)) * np.float32(1 / gain) - blurred
        weights = robust.tukey(np.abs(residual), trust, 0.06)
        seen = template.seen(fit.warp, robust.correlation(values, blurred, weights), residual, gain)
        if seen.quality > best.quality:
            best = seen
    return best


def _smear(picture: Gray, by: Array) -> Gray:
    """`picture` (n, n) blurred evenly along (2,) `by` [cells]."""
    total = np.zeros_like(picture)
    steps = max(3, 2 * math.ceil(float(np.abs(by).max())) + 1)
    for at in np.linspace(-0.5, 0.5, steps):
        moved = np.array([[1.0, 0.0, at * by[0]], [0.0, 1.0, at * by[1]]])
        total += cv2.warpAffine(picture, moved, picture.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(total / steps, dtype=np.float32)
