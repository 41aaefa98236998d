"""Which bodies stand still, as seen by one camera: what its cached background may contain."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vita.sim.render import STILL_AFTER
from vita.types import Array


class StillBodies:
    """Decides when the cached background is out of date, and what goes into the next one.

    A body that moved is drawn live until it has stood still for `patience` pictures, so that a body
    which stops and starts does not make the background anew each time.
    """

    def __init__(self, patience: int = 15) -> None:
        self.bodies: frozenset[str] = frozenset()
        """The bodies in the background."""
        self._patience = patience
        self._valid = False
        self._view: tuple[float, Array] | None = None
        self._poses: dict[str, Array] = {}
        self._age: dict[str, int] = {}
        self._view_age = 0

    def see(self, fov_deg: float, T_world_camera: Array, poses: Mapping[str, Array]) -> None:
        """Take note of the next picture's camera pose and bodies' poses."""
        view = (fov_deg, T_world_camera.copy())
        same = self._view is not None and self._view[0] == fov_deg
        if same and self._view is not None and np.array_equal(self._view[1], T_world_camera):
            self._view_age += 1
        else:
            # The first picture counts as one of a camera that stands still.
            self._view_age = 0 if self._view is not None else STILL_AFTER
            self._view, self._valid = view, False
        for body, T in poses.items():
            last = self._poses.get(body)
            if last is None:
                self._poses[body], self._age[body] = T.copy(), self._patience
            elif np.array_equal(last, T):
                self._age[body] += 1
            else:
                self._poses[body], self._age[body] = T.copy(), 0
                if body in self.bodies:
                    self._valid = False

    @property
    def camera_moved(self) -> bool:
        """Whether this or one of the last pictures was seen from elsewhere than the one before it."""
        return self._view_age < STILL_AFTER

    @property
    def stale(self) -> bool:
        """Whether the background must be drawn anew before this picture."""
        return not self._valid or any(
            age >= self._patience and body not in self.bodies for body, age in self._age.items()
        )

    def renew(self) -> None:
        """Declare the background as of now: all that stands still."""
        self.bodies = frozenset(body for body, age in self._age.items() if age > 0)
        self._valid = True
