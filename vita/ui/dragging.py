"""Moving things of the simulated scene with the mouse: from rays in a 3D view to commands.

A thing follows the mouse in the horizontal plane through the place where it was taken, or, with Shift, up
and down. The planes are ours and not viser's, which drags parallel to the window.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import viser.transforms as vtf

from vita import commands as c
from vita.errors import BadInput, NotNow
from vita.snapshot import Snapshot
from vita.types import Array
from vita.ui.mode import following

FIRST = ("target", "person", "tripod", "ball")
"""Kinds of objects that people will want to move, most wanted first."""
PERIOD_S = 1 / 15
"""Commands follow one another no faster [s]."""
FOLLOW_S = 0.1
"""So long the thing takes to where the mouse is [s]."""
NUDGE_S = 0.5
"""So long it takes for a press of a button [s]."""
HELD_S = 0.6
"""So long after a command a thing is taken to be where it was asked to be [s]."""
FARTHEST_M, LOWEST_M, HIGHEST_M = 3.0, -0.3, 2.5
"""Nothing is carried out of the room: distance from the base along x and y, and height [m]."""
GRAZING_M = 2.0
"""How far from where it was taken a nearly level glance may still carry a thing at once [m]."""


def movable(snapshot: Snapshot) -> tuple[str, ...]:
    """Names of the objects that may be dragged: those that stand in the world, in this mode only."""
    if not following(snapshot):
        return ()
    loose = [spec for spec in snapshot.scenario.scene.objects if spec.mount is None]
    order = {kind: rank for rank, kind in enumerate(FIRST)}
    return tuple(spec.name for spec in sorted(loose, key=lambda spec: order.get(spec.kind, len(order))))


@dataclass(frozen=True, eq=False)
class Grip:
    """A thing in somebody's hand."""

    name: str
    origin: Array
    """(3,) where it stood when it was taken [m]."""
    point: Array
    """(3,) where it was touched [m]."""
    upright: bool = False
    """Whether the mouse moves it up and down instead of about."""

    def at(self, eye: Array, aim: Array) -> Array | None:
        """(3,) where it belongs when the pointer is seen from `eye` through `aim` (3,) [m]; None when the
        glance misses the plane or meets it too far away to be meant."""
        ray = np.asarray(aim, float) - eye
        normal = np.array([0.0, 0.0, 1.0])
        if self.upright:
            normal = np.array([*(np.asarray(eye) - self.point)[:2], 0.0])
        against = float(normal @ ray)
        if abs(against) < 1e-9:
            return None
        share = float(normal @ (self.point - eye)) / against
        move = eye + share * ray - self.point
        if share <= 0.0 or np.linalg.norm(move) > GRAZING_M:
            return None
        if self.upright:
            move = np.array([0.0, 0.0, move[2]])
        return inside(self.origin + move)


def inside(place: Array) -> Array:
    """`place` (3,), kept within the room [m]."""
    low = [-FARTHEST_M, -FARTHEST_M, LOWEST_M]
    return np.clip(place, low, [FARTHEST_M, FARTHEST_M, HIGHEST_M])


@dataclass
class Mover:
    """Turns drags and presses into commands, at a bearable rate. Shared by all browsers."""

    submit: Callable[[object], None]
    snapshot: Callable[[], Snapshot]
    clock: Callable[[], float] = time.monotonic
    selected: str | None = None
    """What the buttons move."""
    _asked: dict[str, tuple[float, Array]] = field(default_factory=dict)
    _sent: dict[str, float] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def pose(self, name: str) -> Array:
        """(4, 4) where a thing stands, or where it was just asked to be."""
        asked = self._asked.get(name)
        if asked is not None and self.clock() - asked[0] < HELD_S:
            return asked[1].copy()
        poses: Mapping[str, Array] = self.snapshot().poses
        if name not in poses:
            raise NotNow(f"{name!r} is not in the scene any more")
        return np.array(poses[name], float)

    def take(self, name: str, point: Array, upright: bool) -> Grip:
        """Take a thing at `point` (3,) [m]."""
        if name not in movable(self.snapshot()):
            raise BadInput(f"{name!r} cannot be moved")
        self.selected = name
        return Grip(name, self.pose(name)[:3, 3], np.asarray(point, float), upright)

    def drag(self, grip: Grip, eye: Array, aim: Array, last: bool = False) -> None:
        """Carry it to where the pointer is. What comes too fast is left out, except for the last place."""
        place = grip.at(eye, aim)
        now = self.clock()
        if place is None or (not last and now - self._sent.get(grip.name, -1.0) < PERIOD_S):
            return
        self._sent[grip.name] = now
        T = self.pose(grip.name)
        T[:3, 3] = place
        self._ask(grip.name, T, FOLLOW_S, turned=False)

    def raise_by(self, name: str, height: float) -> None:
        """Up by `height` [m], from where it was last asked to be."""
        T = self.pose(name)
        T[:3, 3] = inside(T[:3, 3] + [0.0, 0.0, height])
        self._ask(name, T, NUDGE_S, turned=False)

    def turn_by(self, name: str, axis: int, angle_deg: float) -> None:
        """Turn it about the vertical (axis 2), or about its own x or y (axis 0, 1)."""
        T = self.pose(name)
        turn = vtf.SO3.exp(np.radians(angle_deg) * np.eye(3)[axis]).as_matrix()
        T[:3, :3] = turn @ T[:3, :3] if axis == 2 else T[:3, :3] @ turn
        self._ask(name, T, NUDGE_S, turned=True)

    def _ask(self, name: str, T: Array, over_s: float, turned: bool) -> None:
        with self._lock:
            self._asked[name] = self.clock(), T
        arguments: dict[str, object] = {
            "object": name, "xyz": [round(float(x), 5) for x in T[:3, 3]], "over_s": over_s
        }
        if turned:
            roll_pitch_yaw = vtf.SO3.from_matrix(T[:3, :3]).as_rpy_radians()
            angles = (roll_pitch_yaw.roll, roll_pitch_yaw.pitch, roll_pitch_yaw.yaw)
            arguments["rpy_deg"] = [round(float(np.degrees(a)), 4) for a in angles]
        self.submit(c.Perform("drag_target", arguments))
