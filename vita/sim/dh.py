"""Serial arms in standard Denavit-Hartenberg form: forward kinematics in plain numpy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vita.errors import BadInput
from vita.types import Array


@dataclass(frozen=True)
class DHChain:
    """The four Denavit-Hartenberg parameters of each joint.

    T_(i-1)_i = Rz(q_i + offset_i) Tz(d_i) Tx(a_i) Rx(alpha_i): joint i turns about z of frame
    i - 1, and frame i sits at the far end of link i.
    """

    a: tuple[float, ...]
    """Link lengths along x [m]."""
    d: tuple[float, ...]
    """Link offsets along z [m]."""
    alpha: tuple[float, ...]
    """Link twists about x [rad]."""
    offset: tuple[float, ...]
    """Added to the joint positions [rad]."""

    def __post_init__(self) -> None:
        lengths = {len(self.a), len(self.d), len(self.alpha), len(self.offset)}
        if len(lengths) != 1:
            raise BadInput(f"a, d, alpha and offset need equal lengths, got {sorted(lengths)}", "DHChain")

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.a)

    def fixed(self, i: int) -> Array:
        """(4, 4) the part of joint i's transform that does not turn: Tz(d) Tx(a) Rx(alpha)."""
        c, s = np.cos(self.alpha[i]), np.sin(self.alpha[i])
        return np.array(
            [[1, 0, 0, self.a[i]], [0, c, -s, 0], [0, s, c, self.d[i]], [0, 0, 0, 1]], dtype=float
        )

    def link_frames(self, q: Sequence[float] | Array) -> Array:
        """(n+1, 4, 4) frames 0..n in the base frame (frame 0) at joint positions q (n,) [rad]."""
        q = np.asarray(q, dtype=float)
        if q.shape != (self.n,):
            raise BadInput(f"expected {self.n} joint positions, got shape {q.shape}", "q")
        frames = np.empty((self.n + 1, 4, 4))
        frames[0] = np.eye(4)
        for i in range(self.n):
            c, s = np.cos(q[i] + self.offset[i]), np.sin(q[i] + self.offset[i])
            turn = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
            frames[i + 1] = frames[i] @ turn @ self.fixed(i)
        return frames
