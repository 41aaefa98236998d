"""Constraints on a moving line, given by two points: onto a line, parallel to a line."""

from __future__ import annotations

import numpy as np

from vita.constraints.base import Constraint, long_enough, register, signed_distance
from vita.types import Array

ROLES = ("moving line, one end", "moving line, other end", "goal line, one end", "goal line, other end")


class LineToLine(Constraint):
    """The moving line lies on the goal line: both of its points do,
    e = [l . f1, l . f2] with l = f3 x f4 scaled to the unit normal."""

    kind = "line_to_line"
    title = "Line to line"
    roles = ROLES
    moving = 2
    components = ("distance 1", "distance 2")
    color = (224, 33, 186)

    def residual(self, points: Array) -> Array:
        moving, a, b = points[..., :2, :], points[..., 2:3, :], points[..., 3:4, :]
        return signed_distance(moving, a, b)

    def lines(self) -> tuple[tuple[int, int], ...]:
        return ((0, 1), (2, 3))


class ParallelLines(Constraint):
    """The moving line is parallel to the goal line, in either sense.

    The third component of (f1 x f2) x (f3 x f4) is |d1| |d2| sin(angle); divided by the goal's
    length it is the moving segment's length times the sine, in pixels: how much farther from the
    goal line one end of the moving segment is than the other.
    """

    kind = "parallel_lines"
    title = "Parallel lines"
    roles = ROLES
    moving = 2
    components = ("angle",)
    color = (30, 120, 255)

    def residual(self, points: Array) -> Array:
        moving, goal = points[..., 1, :] - points[..., 0, :], points[..., 3, :] - points[..., 2, :]
        across = moving[..., 0] * goal[..., 1] - moving[..., 1] * goal[..., 0]
        # The moving segment's length is in `across`; it only has to be long enough to be a line.
        angle = across / long_enough(goal) + 0.0 * long_enough(moving)
        return np.expand_dims(angle, -1)

    def lines(self) -> tuple[tuple[int, int], ...]:
        return ((0, 1), (2, 3))


register(LineToLine())
register(ParallelLines())
