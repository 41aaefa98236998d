"""People and obstacles as a safety scanner would report them: thick segments in the robot's base frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from vita.impedance.view import Capsule
from vita.scenario.schema import ObjectSpec
from vita.sim.people import SEGMENTS
from vita.types import Array, frozen


def obstacle_capsules(objects: Sequence[ObjectSpec], poses: Mapping[str, Array]) -> tuple[Capsule, ...]:
    """The capsules of every person and ball among the objects, where `poses` (4, 4) has them now."""
    found = []
    for spec in objects:
        if spec.kind in SEGMENTS:
            T = poses[spec.name]
            for start, end, radius in SEGMENTS[spec.kind]:
                ends = np.array([start, end]) @ T[:3, :3].T + T[:3, 3]
                found.append(Capsule(spec.name, frozen(ends[0]), frozen(ends[1]), radius))
    return tuple(found)
