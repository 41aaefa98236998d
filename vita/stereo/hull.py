"""How thick an arm is: capsules fixed to its links that together contain all its meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.errors import BadInput
from vita.types import Array, frozen


@dataclass(frozen=True, eq=False)
class ArmHull:
    """Capsules that move with the arm."""

    frames: tuple[int, ...]
    """(s,) the joint with which each moves, counted from 0; n is the tool, -1 stays with the base."""
    starts: Array
    """(s, 3) one end of each axis, in that joint's frame [m]."""
    ends: Array
    """(s, 3) the other end [m]."""
    radii: Array
    """(s,) [m]."""

    def __post_init__(self) -> None:
        count = len(self.frames)
        for name, shape in (("starts", (count, 3)), ("ends", (count, 3)), ("radii", (count,))):
            values = frozen(getattr(self, name))
            if values.shape != shape or not np.isfinite(values).all():
                words = f"expected finite numbers of shape {shape}, got {values.shape}"
                raise BadInput(words, f"hull.{name}")
            object.__setattr__(self, name, values)

    def segments(self, frames: Array) -> tuple[Array, Array]:
        """(s, 3) starts and (s, 3) ends in the base frame [m], at the (n + 1, 4, 4) frames of the joints and
        the tool that `ArmModel.frames` gives."""
        if max(self.frames, default=0) >= len(frames):
            raise BadInput(f"{len(frames)} frames are too few for joint {max(self.frames)}", "hull")
        T = np.concatenate([frames, np.eye(4)[None]])[list(self.frames)]  # -1 is the last: the base.
        starts, ends = (
            np.einsum("sij,sj->si", T[:, :3, :3], points) + T[:, :3, 3] for points in (self.starts, self.ends)
        )
        return starts, ends
