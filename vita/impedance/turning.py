"""Rotations for the inner loop: quaternions (w, x, y, z) as plain tuples, which beat small arrays by far."""

from __future__ import annotations

import math

import numpy as np

from vita.types import Array

Quaternion = tuple[float, float, float, float]
Triple = tuple[float, float, float]


def times(a: Quaternion, b: Quaternion) -> Quaternion:
    """The rotation b followed by a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def turned(vector: Triple) -> Quaternion:
    """The rotation by |vector| about `vector` [rad]."""
    x, y, z = vector
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return 1.0, 0.5 * x, 0.5 * y, 0.5 * z
    s = math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), s * x, s * y, s * z


def vector_of(q: Quaternion) -> Triple:
    """The shortest rotation vector of a unit quaternion [rad], at most pi long."""
    w, x, y, z = q if q[0] >= 0 else (-q[0], -q[1], -q[2], -q[3])
    s = math.sqrt(x * x + y * y + z * z)
    c = 2.0 if s < 1e-12 else 2.0 * math.atan2(s, w) / s
    return c * x, c * y, c * z


def between(goal: Quaternion, now: Quaternion) -> Triple:
    """The rotation vector, in the base frame, that turns `now` into `goal` [rad]."""
    w, x, y, z = now
    return vector_of(times(goal, (w, -x, -y, -z)))


def unit(q: Quaternion) -> Quaternion:
    """The same rotation with rounding errors taken off."""
    w, x, y, z = q
    c = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    return c * w, c * x, c * y, c * z


def matrix_of(q: Quaternion) -> Array:
    """(3, 3) rotation matrix."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of(R: Array) -> Quaternion:
    """Quaternion of a (3, 3) rotation matrix; the largest of its four parts is found first, for accuracy."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    sizes = (1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i)
    best = sizes.index(max(sizes))
    s = math.sqrt(sizes[best])
    t = 0.5 / s
    if best == 0:
        q = (0.5 * s, t * (h - f), t * (c - g), t * (d - b))
    elif best == 1:
        q = (t * (h - f), 0.5 * s, t * (b + d), t * (c + g))
    elif best == 2:
        q = (t * (c - g), t * (b + d), 0.5 * s, t * (f + h))
    else:
        q = (t * (d - b), t * (c + g), t * (f + h), 0.5 * s)
    return unit(q)
