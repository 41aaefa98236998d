"""The lens through which one browser looks at the board: straight on, or orbiting the 3D world."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import viser

from vita.ui.layout import FOV, Rect, unproject, window_distance

STRAIGHT = np.array([1.0, 0.0, 0.0, 0.0])
GRACE_S = 0.4
"""So long after aiming, what the browser reports may still be the old view [s]."""
PATIENCE_S = 2.0
"""So long it may report another place altogether before it is asked again [s]."""
FARTHEST = 1e5
"""Beyond this from the board's middle lies the 3D world [board units]."""


class Lens:
    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._aimed_at = 0.0
        self._straight: tuple[float, float, float] | None = None
        """Place and distance of the straight view that was aimed last."""
        self.aspect = 0.0
        """Of the window for which the views were arranged last."""
        client.camera.max_orbit_distance = 1.0e6

    def aim(
        self, eye: Sequence[float], target: Sequence[float], fov: float = FOV,
        up: Sequence[float] = (0.0, -1.0, 0.0),
    ) -> None:
        camera = self._client.camera
        with self._client.atomic():
            camera.up_direction = up  # type: ignore
            camera.fov = float(fov)
            # A near plane close to the eye would leave the overlays no depth to stand before the images.
            camera.near, camera.far = 100.0, 1.0e5
            camera.position = eye  # type: ignore
            camera.look_at = target  # type: ignore
        self._aimed_at = time.monotonic()

    def show(self, rect: Rect, height: float) -> None:
        """Look straight at the middle of `rect` with `height` board units in the window."""
        x, y = rect.center
        self._face(x, y, window_distance(height))

    def _face(self, x: float, y: float, distance: float) -> None:
        self._straight = x, y, distance
        self.aim((x, y, -distance), (x, y, 0.0))

    def straighten(self) -> None:
        """Back to the straight view, at the zoom and place where it is."""
        camera = self._client.camera
        if self._astray() and self._straight is not None:
            self._face(*self._straight)
            return
        distance = float(np.linalg.norm(camera.look_at - camera.position))
        self._face(float(camera.look_at[0]), float(camera.look_at[1]), distance)

    def _astray(self) -> bool:
        """Whether the browser tells of a view, or of half a view, that is not of the board: on the way
        from the 3D world its messages may hold the one's place and the other's direction."""
        camera = self._client.camera
        off = abs(float(camera.fov) - FOV) > 1e-3 or abs(float(camera.look_at[2])) > 1.0
        return off or max(abs(float(camera.look_at[1])), abs(float(camera.position[1]))) > FARTHEST

    def take_aspect(self) -> None:
        """Remember the window's shape, so that `reshaped` tells when it has changed."""
        self.aspect = float(self._client.camera.aspect)

    @property
    def reshaped(self) -> bool:
        return abs(float(self._client.camera.aspect) - self.aspect) > 1e-3

    def tilted(self) -> bool:
        """Whether arrow keys or orbiting have turned a straight view; said once per aiming."""
        wxyz = self._client.camera.wxyz
        off = min(np.abs(wxyz - STRAIGHT).max(), np.abs(wxyz + STRAIGHT).max())
        # A slow browser goes on telling of the 3D world for a while: what it was asked for is on its way.
        grace = PATIENCE_S if self._astray() else GRACE_S
        if (off < 2e-3 and not self._astray()) or time.monotonic() - self._aimed_at < grace:
            return False
        self._aimed_at = time.monotonic()
        return True

    def unit(self) -> float:
        """Board units per screen pixel at the present zoom."""
        # viser reports device pixels, which adaptive resolution and dense screens change; the window's
        # own height is not told, so markers keep within what windows usually measure.
        window = float(np.clip(self._client.camera.image_height, 500.0, 1100.0))
        return self._height() / window

    def board_at(self, screen: tuple[float, float]) -> tuple[float, float]:
        """The place of the board under a place of the window (0 to 1 each)."""
        camera = self._client.camera
        place = tuple(float(p) for p in camera.position)
        return unproject(screen, place, float(camera.fov), float(camera.aspect))  # type: ignore

    def screen_at(self, x: float, y: float) -> tuple[float, float]:
        """The place of the window (0 to 1 each) where a place of the board is seen."""
        camera, height = self._client.camera, self._height()
        return (
            float((x - camera.position[0]) / (height * camera.aspect) + 0.5),
            float((y - camera.position[1]) / height + 0.5),
        )

    def moved_px(self, a: tuple[float, float], b: tuple[float, float]) -> float:
        """How far apart two places of the window are [screen pixels]."""
        camera = self._client.camera
        return float(np.hypot((b[0] - a[0]) * camera.image_width, (b[1] - a[1]) * camera.image_height))

    def _height(self) -> float:
        camera = self._client.camera
        return float(2.0 * abs(float(camera.position[2])) * np.tan(float(camera.fov) / 2.0))
