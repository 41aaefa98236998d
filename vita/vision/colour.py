"""What colour a blob has, and where in a picture that colour is."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.types import Array, Image

Mask = NDArray[np.bool_]
COLOURED = 18.0
"""Chroma (Lab) from which on a colour has a hue worth looking at; black, grey and white have less."""
_BINS, _RANGES = (30, 32), (0, 180, 0, 256)


def to_rgb(frame: Image) -> Image:
    """(h, w, 3) of an RGB or grey frame."""
    return frame if frame.ndim == 3 else cv2.cvtColor(frame, cv2.COLOR_GRAY2RGB)  # type: ignore[return-value]


def to_lab(rgb: NDArray[np.generic]) -> NDArray[np.float32]:
    """(h, w, 3) CIE Lab, L from 0 to 100."""
    return cv2.cvtColor(rgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)  # type: ignore[return-value]


def lab_of(rgb: Array) -> Array:
    """(3,) Lab of one (3,) RGB colour, 0 to 255."""
    return to_lab(np.asarray(rgb, np.float32)[None, None])[0, 0].astype(np.float64)


class ColourModel:
    """The likelihood that a pixel belongs to the blob, learned from one picture.

    Coloured blobs: the share that the blob has in each cell of a hue and saturation histogram,
    against the surroundings (Bradski, "Computer vision face tracking for use in a perceptual user
    interface", 1998, with the background weighting of Comaniciu, Ramesh and Meer, PAMI 2003). Light
    and shade change neither. Black, grey and white ones have no hue: there it is the distance in Lab.
    """

    def __init__(self, rgb: Image, blob: Mask, around: Mask) -> None:
        """`blob` and `around` (h, w) tell the blob's pixels of `rgb` from those of its surroundings."""
        lab = to_lab(rgb)
        inside = lab[blob].astype(np.float64)
        self.lab: Array = inside.mean(axis=0)
        """(3,) mean Lab of the blob."""
        spread = inside.std(axis=0)
        # A shaded ball is bright on one side; what is printed flat is not, and gets a narrower range.
        self._scale = np.array(
            [max(9.0, 2.5 * spread[0]), max(6.0, 2.5 * spread[1]), max(6.0, 2.5 * spread[2])]
        )
        self._table = _table(rgb, blob, around) if self.chroma >= COLOURED else None
        if self._table is not None and self._contrast(rgb, blob, around) < 0.5:
            # The surroundings have the same hue: brightness must tell.
            by_hue, table = self._contrast(rgb, blob, around), self._table
            self._table = None
            if self._contrast(rgb, blob, around) < by_hue:
                self._table = table

    @property
    def chroma(self) -> float:
        return math.hypot(self.lab[1], self.lab[2])

    @property
    def by_hue(self) -> bool:
        """Whether hue and saturation tell the blob from the rest, and not Lab."""
        return self._table is not None

    def likelihood(self, rgb: Image) -> NDArray[np.uint8]:
        """(h, w) 0 to 255."""
        if self._table is not None:
            hsv = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV)
            return cv2.calcBackProject([hsv], [0, 1], self._table, list(_RANGES), 1)  # type: ignore[return-value]
        off = (to_lab(rgb) - self.lab.astype(np.float32)) / self._scale.astype(np.float32)
        return np.rint(255 * np.exp(-0.5 * np.square(off).sum(axis=2))).astype(np.uint8)

    def differs(self, lab: Array) -> bool:
        """Whether (3,) mean `lab` is another colour than the one learned, light and shade apart."""
        off = np.abs(lab - self.lab)
        return bool(off[0] > 30 or math.hypot(off[1], off[2]) > max(14.0, 0.4 * self.chroma))

    def _contrast(self, rgb: Image, blob: Mask, around: Mask) -> float:
        """Mean likelihood in the blob less that in its surroundings, -1 to 1."""
        seen = self.likelihood(rgb)
        return (float(seen[blob].mean()) - float(seen[around].mean())) / 255 if around.any() else 0.0


def _table(rgb: Image, blob: Mask, around: Mask) -> NDArray[np.float32]:
    """Hue and saturation histogram, 0 to 255: the blob's share of each cell."""
    hsv = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV)
    shares = []
    for mask in (blob, around, np.ones_like(blob)):
        counts = cv2.calcHist([hsv], [0, 1], mask.astype(np.uint8), list(_BINS), list(_RANGES))
        # Hue is a circle: red is at both of its ends.
        ring = np.vstack([counts[-2:], counts, counts[:2]])
        ring = cv2.GaussianBlur(ring, (0, 0), 0.8, borderType=cv2.BORDER_REPLICATE)[2:-2]
        shares.append(ring / max(1.0, float(ring.sum())))
    own, near, all_of_it = shares
    known = own > 0.02 * own.max()
    return np.where(known, 255 * own / (own + 0.5 * near + 0.5 * all_of_it + 1e-9), 0).astype(np.float32)


def colour_name(lab: Array) -> str:
    """A plain word for (3,) `lab`."""
    light, a, b = (float(x) for x in lab)
    chroma, hue = math.hypot(a, b), math.degrees(math.atan2(b, a)) % 360
    if chroma < 10:
        return "black" if light < 25 else "white" if light > 82 else "grey"
    if 20 < hue < 85 and light < 45 and chroma < 50:
        return "brown"
    # Hue angles of Lab, not of HSV: red is at 40 degrees, yellow at 100, green at 140, blue at 290.
    for limit, name in (
        (15, "pink"), (48, "red"), (78, "orange"), (112, "yellow"), (170, "green"), (230, "turquoise"),
        (314, "blue"), (340, "purple"), (360, "pink"),
    ):  # fmt: skip
        if hue < limit:
            return name
    return "pink"
