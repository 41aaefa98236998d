"""The attraction: a spring that never pulls harder than it may (TUM eq. 16 in a correct form).

The force is K e while that is below `most`, and of size `most` along e beyond. It belongs to the potential

    U(e) = K |e|^2 / 2               where K |e| <= most,
    U(e) = most (|e| - most / 2 K)   beyond,

which is smooth, so a far target neither jerks the arm nor outweighs what keeps it clear of things.
The report also has a term -K X_m (eq. 13), which pulls the mass towards the robot's base wherever the target
is; with K_m = 100 and K = 10 it would come to rest at 0.909 of the way. It is left out.
"""

from __future__ import annotations

import math


def pull_share(length: float, stiffness: float, most: float) -> float:
    """The factor c with which force = c e for a deviation e of this length [N/m]."""
    return stiffness if stiffness * length <= most else most / length


def pull_energy(length: float, stiffness: float, most: float) -> float:
    """Potential energy of the spring at a deviation of this length [J]."""
    if stiffness * length <= most:
        return 0.5 * stiffness * length * length
    return most * (length - 0.5 * most / stiffness)


def length(x: float, y: float, z: float) -> float:
    """Length of a vector."""
    return math.sqrt(x * x + y * y + z * z)
