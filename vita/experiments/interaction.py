"""Interaction matrices of a calibrated camera, and the rigid motions that they need.

A twist (v, w) is the linear and angular velocity of a frame, both in the frame's own axes.
"""

from __future__ import annotations

import numpy as np

from vita.types import Array

SMALL = 1e-4
"""Angles below this use the first terms of the series [rad]."""


def point_interaction(x: Array, depth: Array) -> Array:
    """(..., 2, 6) L with dx/dt = L (v, w) for a fixed point in the view of a camera moving with the
    twist (v, w) (thesis eq. 2.9 to 2.14).

    `x` (..., 2) are normalised coordinates (pixels over focal length), `depth` (...,) is Z [m]. The
    last entry of the second row is -x: it follows from eq. 2.12, while eq. 2.14 prints it without its
    sign.
    """
    u, v, z = x[..., 0], x[..., 1], 1.0 / np.asarray(depth, float)
    none = np.zeros_like(u)
    return np.stack(
        [
            np.stack([-z, none, u * z, u * v, -(1.0 + u**2), v], axis=-1),
            np.stack([none, -z, v * z, 1.0 + v**2, -u * v, -u], axis=-1),
        ],
        axis=-2,
    )


def rotation_interaction(theta_u: Array) -> Array:
    """(..., 3, 3) L with d(theta u)/dt = L w, for the rotation theta u (..., 3) [rad] of the camera
    relative to the goal (c* to c) that turns with w in its own axes (thesis eq. 2.7).

    The term theta/2 [u]x carries a plus here. Eq. 2.7 prints a minus, which belongs to -L for the
    opposite rotation, that of the goal relative to the camera; finite differences tell them apart.
    """
    theta = np.linalg.norm(theta_u, axis=-1)[..., None, None]
    cross = skew(theta_u)
    half = np.where(theta < SMALL, 1.0, 0.5 * theta)
    # (1 - sinc(theta) / sinc(theta/2)^2) / theta^2, where the quotient is (theta/2) / tan(theta/2).
    rest = np.where(theta < SMALL, 1.0 / 12.0, (1.0 - half / np.tan(half)) / (4.0 * half**2))
    return np.eye(3) + 0.5 * cross + rest * (cross @ cross)


def skew(a: Array) -> Array:
    """(..., 3, 3) [a]x, with [a]x b = a x b."""
    x, y, z, none = a[..., 0], a[..., 1], a[..., 2], np.zeros_like(a[..., 0])
    rows = [np.stack(row, axis=-1) for row in ((none, -z, y), (z, none, -x), (-y, x, none))]
    return np.stack(rows, axis=-2)


def adjoint(pose: Array) -> Array:
    """(..., 6, 6) that takes a body's twist in frame b to that in frame a, for `pose` T_a_b (..., 4, 4)."""
    turn, shift = pose[..., :3, :3], pose[..., :3, 3]
    out = np.zeros((*pose.shape[:-2], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = turn
    out[..., :3, 3:] = skew(shift) @ turn
    return out


def inverse(pose: Array) -> Array:
    """(..., 4, 4) inverse of rigid poses."""
    out = np.zeros(pose.shape)
    out[..., :3, :3] = pose[..., :3, :3].swapaxes(-1, -2)
    out[..., :3, 3] = -(out[..., :3, :3] @ pose[..., :3, 3:])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def turned(theta_u: Array) -> Array:
    """(..., 3, 3) rotation by theta u (..., 3) [rad] (Rodrigues)."""
    theta = np.linalg.norm(theta_u, axis=-1)[..., None, None]
    cross = skew(theta_u)
    # numpy's sinc(x) is sin(pi x) / (pi x).
    first, second = np.sinc(theta / np.pi), 0.5 * np.sinc(theta / (2 * np.pi)) ** 2
    return np.eye(3) + first * cross + second * (cross @ cross)


def theta_u_of(turn: Array) -> Array:
    """(..., 3) theta u [rad] of rotations (..., 3, 3), theta below pi."""
    w = 0.5 * np.stack(
        [
            turn[..., 2, 1] - turn[..., 1, 2],
            turn[..., 0, 2] - turn[..., 2, 0],
            turn[..., 1, 0] - turn[..., 0, 1],
        ],
        axis=-1,
    )
    sine = np.linalg.norm(w, axis=-1)
    theta = np.arctan2(sine, 0.5 * (np.trace(turn, axis1=-2, axis2=-1) - 1.0))
    return np.where(sine < 1e-12, 1.0, theta / np.maximum(sine, 1e-12))[..., None] * w


def moved(twist: Array) -> Array:
    """(..., 4, 4) the pose reached by the constant `twist` (..., 6) in unit time (exponential map)."""
    shift, theta_u = twist[..., :3], twist[..., 3:]
    theta = np.linalg.norm(theta_u, axis=-1)[..., None, None]
    cross = skew(theta_u)
    safe = np.where(theta < SMALL, 1.0, theta)
    second = 0.5 * np.sinc(theta / (2 * np.pi)) ** 2
    third = np.where(theta < SMALL, 1.0 / 6.0, (1.0 - np.sinc(theta / np.pi)) / safe**2)
    bend = np.eye(3) + second * cross + third * (cross @ cross)
    out = np.zeros((*twist.shape[:-1], 4, 4))
    out[..., :3, :3] = turned(theta_u)
    out[..., :3, 3] = (bend @ shift[..., None])[..., 0]
    out[..., 3, 3] = 1.0
    return out
