"""The user's own units outside, pixels and radians inside.

Everything in the servo that has a size (noise floors, the leap that counts as divergence, the first
trust radius) was chosen for errors in pixels and joints in radians. An error in metres or degrees is
therefore scaled so that what the user calls done is what done means in pixels, row by row, and a
joint in millimetres so that a motion of usual size is one of usual size.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vita.errors import BadInput
from vita.types import Array, Joint, frozen


@dataclass(frozen=True, eq=False)
class Units:
    """What the user's units are worth."""

    px: Array
    """() or (m,): pixels for one unit of each error row."""
    rad: Array
    """() or (n,): radians for one unit of each joint."""
    done_px: float
    """The tolerance inside [px]."""
    own: bool
    """Whether the errors are in units other than pixels."""

    @classmethod
    def of(
        cls, tolerance: ArrayLike | None, done_px: float, joint_scale: ArrayLike, joints: Sequence[Joint]
    ) -> Units:
        """Units in which errors of `tolerance`, () or (m,), count as `done_px` pixels, and joint motions
        of `joint_scale`, () or (n,), as a radian."""
        scale = _positive(joint_scale, "joint_scale")
        if scale.shape not in ((), (len(joints),)):
            raise BadInput(f"give one value or one for each of the {len(joints)} joints", "joint_scale")
        px = frozen(1.0) if tolerance is None else frozen(done_px / _positive(tolerance, "tolerance"))
        return cls(px, frozen(1.0 / scale), done_px, tolerance is not None)

    def joints(self, joints: Sequence[Joint]) -> tuple[Joint, ...]:
        """The robot's joints in radians."""
        each = np.broadcast_to(self.rad, (len(joints),))
        return tuple(
            Joint(j.name, float(j.lower * r), float(j.upper * r), float(j.max_speed * r))
            for j, r in zip(joints, each, strict=True)
        )

    def jacobian(self, inside: Array) -> Array:
        """(m, n) in the user's units from one in px/rad."""
        m, n = inside.shape
        rows = self.px if self.px.ndim == 0 or m == self.px.size else np.ones(m)
        return inside / np.broadcast_to(rows, (m,))[:, None] * np.broadcast_to(self.rad, (n,))

    def words(self, message: str) -> str:
        """`message` with its pixels told as multiples of the tolerance, where errors are no pixels."""
        if not self.own:
            return message
        return re.sub(
            r"(\d+(?:\.\d+)?) px", lambda m: f"{float(m[1]) / self.done_px:.3g} x the tolerance", message
        )


def _positive(values: ArrayLike, path: str) -> Array:
    array = np.asarray(values, float)
    if array.ndim > 1 or not (np.isfinite(array) & (array > 0.0)).all():
        raise BadInput(f"expected a number above zero, or one for each, got {values!r}", path)
    return array
