"""Holding still what does not move: registration noise is not passed on as motion."""

from __future__ import annotations

import numpy as np

from vita.types import Array
from vita.vision.template import Fit, Template

CALM = 1.0
"""How strongly motion no larger than noise is held back; 0 is not at all."""


def calm(template: Template, fit: Fit, before: Array) -> Array:
    """The pose of `fit`, held back towards the pose `before` as far as noise explains the difference.

    With m the Mahalanobis distance between the two under the fit's own noise, the motion is
    scaled by m^4 / (m^4 + CALM dof^2): a real motion passes, and what is no larger than noise hardly.
    """
    a = np.linalg.solve(before, fit.warp)
    a = a / a[2, 2] - np.eye(3)
    p = np.array(
        [
            a[0, 2],
            a[1, 2],
            0.5 * (a[1, 0] - a[0, 1]),
            0.5 * (a[0, 0] + a[1, 1]),
            0.5 * (a[0, 0] - a[1, 1]),
            0.5 * (a[0, 1] + a[1, 0]),
            -a[2, 0],
            -a[2, 1],
        ]
    )[: template.dof]
    noise = template.grain * max(1 / max(fit.score, 0.1) ** 2 - 1, 1e-9)
    squared = float(p @ template.information @ p) / noise
    excess = (squared / template.dof) ** 2
    moved = before @ (np.eye(3) + a * (excess / (excess + CALM)))
    return moved / moved[2, 2]
