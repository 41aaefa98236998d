"""What a geometric constraint is, and the registry of the kinds that people can draw.

Theory, once for all kinds. A task is accomplished when its encoding of the image features is
zero (thesis eq. 3.1 to 3.3). Each kind turns the pixels of a few point features, all of one
camera, into signed residual rows:

- The rows are in pixels whatever the geometry, so that they can be stacked: points give pixel
  differences, lines are used with unit normals so that l . p is a signed pixel distance (the raw
  product of thesis eq. 3.4 has the same zero set and sign, but its size depends on how far apart
  the line's two points were clicked), and angles are multiplied by the moving segment's length.
- Signs are kept. A norm would have the same zero but no direction to move in.
- Moving features come first, goals after, so that e = s - s* (thesis eq. 2.1).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from vita.errors import BadInput, UnknownName
from vita.types import Array

MIN_LINE_PX = 3.0
"""Two points nearer than this do not define a line: a pixel of noise would turn it by 20 degrees."""


class Constraint(ABC):
    """One kind of geometric constraint; stateless, one instance serves every use."""

    kind: ClassVar[str]
    title: ClassVar[str]
    """Name for people."""
    roles: ClassVar[tuple[str, ...]]
    """What each point is, in the order in which they are given, moving ones first."""
    moving: ClassVar[int]
    """How many of the points are the moving feature."""
    components: ClassVar[tuple[str, ...]]
    """Name of each residual row."""
    color: ClassVar[tuple[int, int, int]]
    """RGB in which it is drawn (thesis fig. 4.5)."""

    @property
    def arity(self) -> int:
        return len(self.roles)

    @abstractmethod
    def residual(self, points: Array) -> Array:
        """(..., rows) signed residuals [px] of `points`, (..., arity, 2) [px].

        A row is NaN where a point is NaN or a line is shorter than `MIN_LINE_PX`. Leading axes are
        many drawings at once, as a search over poses of the hand asks for.
        """

    def lines(self) -> tuple[tuple[int, int], ...]:
        """Pairs of point indices that form a line."""
        return ()

    def fits(self, widths: Sequence[int]) -> bool:
        """Whether trackers that give `widths` points each (1, or 2 for a tracked line), in this order,
        fill the roles: a tracked line must stand where the two ends of one line are asked for."""
        place = 0
        for width in widths:
            if width == 2 and (place, place + 1) not in self.lines():
                return False
            place += width
        return place == self.arity

    def check(self, points: Array) -> None:
        """Raise `BadInput` when visible `points`, (arity, 2) [px], cannot carry the constraint."""
        for a, b in self.lines():
            length = float(np.linalg.norm(points[a] - points[b]))
            if length < MIN_LINE_PX:
                raise BadInput(
                    f"{self.title}: {self.roles[a]} and {self.roles[b]} are {length:.1f} px apart; "
                    f"a line needs at least {MIN_LINE_PX:g} px. Move one of them."
                )


def signed_distance(point: Array, a: Array, b: Array) -> Array:
    """(...,) signed distance [px] of `point` (..., 2) to the line through `a` and `b` (..., 2): the
    unit-normal form of (a x b) . p in homogeneous coordinates (thesis eq. 3.4). NaN for a line too short."""
    direction, away = b - a, point - a
    length = long_enough(direction)
    return (away[..., 1] * direction[..., 0] - away[..., 0] * direction[..., 1]) / length


def long_enough(direction: Array) -> Array:
    """(...,) length [px] of lines `direction` (..., 2); NaN for those that are too short to be one."""
    length = np.hypot(direction[..., 0], direction[..., 1])
    # Written so that NaN stays NaN.
    return np.where(length >= MIN_LINE_PX, length, np.nan)


CONSTRAINTS: dict[str, Constraint] = {}
"""Kind to constraint."""


def register(constraint: Constraint) -> Constraint:
    """Add a kind. Raises `ValueError` on a name that is taken."""
    if constraint.kind in CONSTRAINTS:
        raise ValueError(f"constraint kind {constraint.kind!r} is registered twice")
    CONSTRAINTS[constraint.kind] = constraint
    return constraint


def constraint_of(kind: str, path: str = "") -> Constraint:
    """The constraint of a kind; raises `UnknownName` with the choices."""
    try:
        return CONSTRAINTS[kind]
    except KeyError:
        raise UnknownName("constraint kind", kind, CONSTRAINTS, path) from None
