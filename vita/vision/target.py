"""What a patch tracker holds on to: a region of the first frame, and where it was seen last."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vita.types import Array, Feature, Image, frozen
from vita.vision import layers, robust, warps
from vita.vision.images import Crop, Gray, to_gray
from vita.vision.layers import Layers
from vita.vision.template import Fit, Template

DISC_PX, DISC_GREY = 4.0, 6.0
"""The click's surroundings have at least this radius, and so much contrast (standard deviation)."""
TORN_SHARE = 0.75
"""A fit of which less agrees may lie between two motions."""
WEAK_PX = 0.12
"""A region whose corners camera noise shakes by more than this is weak [px]."""


@dataclass
class Target:
    """The region's templates, where the click is in it and where it is now."""

    size: tuple[int, int]
    """(width, height) of the frames."""
    side: float
    """Side of the region in the first frame [px]."""
    scene: NDArray[np.uint8]
    """(h, w) the first frame."""
    first: Crop
    """The same around the region, in colour if it was."""
    home: Array
    """(3, 3) the region's warp in the first frame."""
    click: Array
    """(2,) the clicked pixel of the first frame."""
    coarse: Template
    fine: Template
    warp: Array
    """(3, 3) the region's warp where it was seen last."""
    before: Crop
    """The last good frame around the region."""
    uv: Array
    outline: Array
    """(3, 3) from the square of the region chosen at the click to that of the present region."""
    disc: NDArray[np.intp]
    """Indices of the fine template's pixels around the click."""
    score: float = 1.0
    share: float = 1.0
    """Share of the region that agreed in the last fit."""
    velocity: Array = field(default_factory=lambda: np.zeros(2))
    """Motion in the last frame [px]."""
    surprise: float = 0.0
    """How far the last motion was from the one before [px]."""
    doubtful: int = 0
    """Frames on end that were only fair."""
    missing: int = 0
    """Frames on end without a fit."""
    estranged: int = 0
    """Frames on end in which the click's surroundings did not look like themselves."""
    looks: int = 0
    """Frames on end in which a second motion was to be looked for."""
    intruder: int = 0
    """Frames on end in which the region's edge was covered while the click was not."""
    usual: float = 1.0
    """Correlation with the template in the frames of late."""
    noise: float = math.inf
    """Least noise seen, over the template's deviation."""
    settled: bool = False
    """Whether the region was chosen anew, on one of two motions."""
    proven: bool = False
    """Whether the click was seen to move along with the region."""

    @classmethod
    def at(cls, frame: Image, first: Crop, click: Array, center: Array, side: float) -> Target:
        """The square region of `side` [px] around `center` (2,) that holds `click` (2,)."""
        home = warps.square(center, side / 2)
        coarse, fine = _templates(first, home, side, None)
        return cls(
            size=(frame.shape[1], frame.shape[0]),
            side=side,
            scene=to_gray(frame).copy(),
            first=first,
            home=home,
            click=click,
            coarse=coarse,
            fine=fine,
            warp=home,
            before=first,
            uv=click,
            outline=np.eye(3),
            disc=_disc(fine, home, click),
        )

    def place(self, warp: Array) -> Array:
        """(2,) the clicked point under a warp of the region [px]."""
        return warps.apply(warp @ np.linalg.inv(self.home), self.click[None])[0]

    def corners(self) -> Array:
        """(4, 2) outline of the region chosen at the click, where it was seen last [px]."""
        return warps.corners(self.warp @ self.outline)

    def travel(self, warp: Array) -> float:
        """How far the clicked point is from where it was clicked [px]."""
        return float(np.linalg.norm(self.place(warp) - self.click))

    def strange(self, fit: Fit) -> float:
        """How badly the click's surroundings agree: what noise does not explain, over the contrast."""
        if fit.residual is None:
            return 0.0
        near, look = fit.residual[self.disc], self.fine.plain_shape.ravel()[self.disc]
        noise = 1.4826 * robust.median(np.abs(fit.residual))
        # A blurred or noisy frame is bad everywhere, which says nothing of the click. A fit between two
        # motions is, too, but leaves much out; then the best frame says what noise there is.
        if fit.score > 0.95:
            self.noise = min(self.noise, noise)
        if fit.share < TORN_SHARE:
            noise = min(noise, self.noise, 1.6 / self.fine.deviation)
        excess = float(near.var()) - 1.7 * noise**2
        return math.sqrt(max(0.0, excess) / (float(look.var()) + 1e-9))

    def settle(self, found: Layers, which: int) -> tuple[Array, Template, Template, Array]:
        """A region on one of two motions: its home, templates and warp in the present frame.

        The click is in it or on its border; the middle of what moves that way is as near to the
        region's middle as that allows.
        """
        reach = 0.47 * self.side
        center = self.click + np.clip(layers.middle(found, which) - self.click, -reach, reach)
        half = self.side / 2
        limit = np.array(self.size, dtype=np.float64)
        center = np.clip(center, half - 0.5, np.maximum(limit - half - 0.5, half - 0.5))
        home = warps.square(center, half)
        n = _grid(self.side)
        coarse, fine = _templates(self.first, home, self.side, layers.trust_for(found, which, home, n))
        return home, coarse, fine, found.motions[which] @ home

    def adopt(self, home: Array, coarse: Template, fine: Template) -> None:
        """Make that region the target's own."""
        self.outline = np.linalg.inv(home) @ self.home @ self.outline
        self.home, self.coarse, self.fine = home, coarse, fine
        self.disc = _disc(fine, home, self.click)
        self.noise, self.settled = math.inf, True

    def feature(self, lost: str = "", score: float | None = None) -> Feature:
        """What to report of it; `lost` says why it is."""
        value = float(np.clip(self.score if score is None else score, 0, 1))
        weak = ", weak: little texture" if self.fine.shake > WEAK_PX or self.fine.dof < 6 else ""
        detail = lost or f"patch {self.side:.0f} px{weak}"
        return Feature(self.uv, "lost" if lost else "ok", value, frozen(self.corners()), detail=detail)


def _grid(side: float) -> int:
    return int(np.clip(round(side), 16, 50))


def _templates(first: Crop, home: Array, side: float, trust: Gray | None) -> tuple[Template, Template]:
    n = _grid(side)
    fine = Template(first, home, n, 8, trust)
    coarse = Template(first, home, min(25, n), min(4, fine.dof))
    if trust is not None:
        coarse.believe(trust)
    return coarse, fine


def _disc(fine: Template, home: Array, click: Array) -> NDArray[np.intp]:
    """The smallest disc of pixels around the click with some contrast."""
    n = fine.n
    axis = (np.arange(n) + 0.5) * 2 / n - 1
    x, y = np.meshgrid(axis, axis)
    at = warps.apply(home, np.stack([x.ravel(), y.ravel()], axis=1))
    away = np.linalg.norm(at - click, axis=1)
    look = fine.plain_shape.ravel() * fine.deviation
    away[fine.trust.ravel() < 0.5] = np.inf
    radius = max(DISC_PX, 1.01 * float(away.min()))
    while True:
        inside = np.flatnonzero(away <= radius)
        if len(inside) >= 9 and float(look[inside].std()) >= DISC_GREY or radius > 4 * n:
            return inside
        radius *= 1.25
