"""The black and white of printed codes: families, detectors, and how well a picture agrees with a code."""

from __future__ import annotations

import math
from functools import cache

import cv2
import numpy as np

from vita.types import Array, frozen
from vita.vision.images import Crop

# Long codes come first: a coarse family reads a fine code by chance once in twenty, hardly ever the
# other way round. The small sets of a size come before the large, whose codes differ less.
FAMILIES = (
    "APRILTAG_36h11", "7X7_50", "6X6_50", "6X6_250", "5X5_50", "5X5_250", "ARUCO_ORIGINAL",
    "4X4_50", "4X4_250", "6X6_1000", "5X5_1000", "4X4_1000",
)  # fmt: skip
"""The dictionaries of OpenCV's aruco module that are tried at a click, in this order."""


LEAST_CONTRAST = 25.0
"""Black and white of a code differ by at least this [grey levels]."""
CORRECTED = 0.6
"""Share of the wrong cells that a family could correct which are tolerated; as in OpenCV's detector."""


@cache
def detector(family: str) -> cv2.aruco.ArucoDetector:
    """OpenCV's detector of one family; its own refinement is left off, see `vita.vision.quad`."""
    parameters = cv2.aruco.DetectorParameters()
    # The smallest default window, 3 px, outlines the camera noise and takes most of the time.
    parameters.adaptiveThreshWinSizeMin, parameters.adaptiveThreshWinSizeStep = 7, 8
    return cv2.aruco.ArucoDetector(_dictionary(family), parameters)


@cache
def _dictionary(family: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{family}"))


@cache
def outliner() -> cv2.aruco.ArucoDetector:
    """A detector for the sake of the outlines that it looks at, of whatever family."""
    parameters = detector("4X4_50").getDetectorParameters()
    # Else it keeps, of a code's frame and the white rim around that, whichever it can read.
    parameters.minMarkerDistanceRate = parameters.minGroupDistance = 0.01
    return cv2.aruco.ArucoDetector(_dictionary("4X4_50"), parameters)


class Code:
    """One marker of a family: its number and its pattern."""

    def __init__(self, family: str, number: int) -> None:
        self.family, self.number = family, number
        self.across = _dictionary(family).markerSize + 2
        """Cells along a side, with the black frame."""
        cells = cv2.aruco.generateImageMarker(_dictionary(family), number, self.across)
        self._white = cells.ravel() > 0
        self._between = 0.5 * (self._white / self._white.sum() + ~self._white / (~self._white).sum())
        """What makes of the cells' grey levels the one in the middle between black and white."""
        wanted = cells.astype(np.float64).ravel()
        wanted -= wanted.mean()
        self._wanted = wanted / np.linalg.norm(wanted)
        self.pattern = frozen(self._wanted.reshape(self.across, self.across))
        """(across, across) black and white of the cells, top row first, of zero mean and unit length."""

    def likeness(self, crop: Crop, plane: Array) -> tuple[float, int]:
        """How well the cells seen through `plane` (the square to the image) agree with the code.

        The correlation, 0 to 1, and the number of cells that read as the other colour.
        """
        values = _cells(crop, plane, self.across).ravel()
        wrong = int(np.count_nonzero((values > values @ self._between) != self._white))
        values -= values.sum() / values.size
        size = math.sqrt(values @ values)
        return (max(0.0, float(values @ self._wanted) / size) if size > 1e-6 else 0.0), wrong


def read(crop: Crop, plane: Array) -> tuple[str, int] | None:
    """Family and number of the code seen through `plane`, whichever way up; None when it is none."""
    for across in (10, 9, 8, 7, 6):
        cells = _cells(crop, plane, across)
        frame = np.concatenate([cells[0], cells[-1], cells[1:-1, 0], cells[1:-1, -1]])
        level = 0.5 * (cells.min() + cells.max())
        if np.ptp(cells) < LEAST_CONTRAST or np.mean(frame < level) < 0.9:
            continue
        bits = (cells[1:-1, 1:-1] > level).astype(np.uint8)
        for family in FAMILIES:
            dictionary = _dictionary(family)
            if dictionary.markerSize + 2 == across:
                known, number, _ = dictionary.identify(bits, CORRECTED)
                if known:
                    return family, int(number)
    return None


def _cells(crop: Crop, plane: Array, across: int) -> Array:
    """(across, across) grey levels of the cells seen through `plane`."""
    u, v, w = plane @ _grid(across)
    places = np.stack([u / w - crop.origin[0], v / w - crop.origin[1]], axis=-1, dtype=np.float32)
    gray = crop.gray.astype(np.float32)
    seen = cv2.remap(gray, places.reshape(4, -1, 2), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    return np.asarray(seen, np.float64).sum(axis=0).reshape(across, across) * 0.25


@cache
def _grid(across: int) -> Array:
    """(3, 4 across^2) four places about the middle of each cell: its rim is mixed with the neighbours'."""
    middle, near = (np.arange(across) + 0.5) * 2.0 / across - 1.0, np.array([-0.25, 0.25]) / across
    v, u, y, x = np.meshgrid(near, near, middle, middle, indexing="ij")
    return frozen(np.stack([(x + u).ravel(), (y + v).ravel(), np.ones(x.size)]))
