"""Constraints on one moving point: onto a point, onto a line."""

from __future__ import annotations

import numpy as np

from vita.constraints.base import Constraint, register, signed_distance
from vita.types import Array


class PointToPoint(Constraint):
    """The moving point meets the goal point: e = f1 - f2 (thesis eq. 2.1, 3.5)."""

    kind = "point_to_point"
    title = "Point to point"
    roles = ("moving point", "goal point")
    moving = 1
    components = ("u", "v")
    color = (46, 204, 64)

    def residual(self, points: Array) -> Array:
        return points[..., 0, :] - points[..., 1, :]


class PointToLine(Constraint):
    """The moving point lies on the goal line: e = l . f1 with l = f2 x f3 (thesis eq. 3.4),
    scaled to the unit normal."""

    kind = "point_to_line"
    title = "Point to line"
    roles = ("moving point", "goal line, one end", "goal line, other end")
    moving = 1
    components = ("distance",)
    color = (255, 159, 28)

    def residual(self, points: Array) -> Array:
        distance = signed_distance(points[..., 0, :], points[..., 1, :], points[..., 2, :])
        return np.expand_dims(distance, -1)

    def lines(self) -> tuple[tuple[int, int], ...]:
        return ((1, 2),)


register(PointToPoint())
register(PointToLine())
