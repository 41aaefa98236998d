"""A scenario's joint limits: never wider than the robot's own."""

from __future__ import annotations

from collections.abc import Sequence

from vita.errors import BadInput
from vita.servo.config import Limits
from vita.servo.limits import apply_limits
from vita.types import Joint


def limits_in_force(robot: Sequence[Joint], limits: Limits) -> tuple[Joint, ...]:
    """The robot's joints with the `[limits]` table applied."""
    for i, one in enumerate(limits.joint):
        if not 0 <= one.joint < len(robot):
            path = f"limits.joint[{i}].joint"
            raise BadInput(f"this robot has joints 0 to {len(robot) - 1}, not {one.joint}", path)
    return within(apply_limits(robot, limits), robot)


def within(wanted: Sequence[Joint], robot: Sequence[Joint]) -> tuple[Joint, ...]:
    """The wanted limits, cut to the robot's own where they are wider."""
    if len(wanted) != len(robot):
        raise BadInput(f"this robot has {len(robot)} joints, got limits of {len(wanted)}")
    joints = []
    for want, own in zip(wanted, robot, strict=True):
        lower, upper = max(want.lower, own.lower), min(want.upper, own.upper)
        if not lower <= upper:  # NaN fails the comparison
            raise BadInput(
                f"limits {want.lower:.3f} to {want.upper:.3f} rad leave joint {own.name!r} no room; "
                f"the robot's own are {own.lower:.3f} to {own.upper:.3f}"
            )
        joints.append(Joint(own.name, lower, upper, min(want.max_speed, own.max_speed)))
    return tuple(joints)
