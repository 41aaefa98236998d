"""The blob tracker: the centre of a patch of one colour, such as a ball, a dot or a cap."""

from __future__ import annotations

import math

import cv2
import numpy as np

from vita.errors import BadInput, Untrackable
from vita.types import Array, Feature, Image, frozen
from vita.vision.blob_region import LIKELY, Region, grown, measured, surroundings
from vita.vision.colour import ColourModel, colour_name, to_rgb
from vita.vision.images import check_frame, check_pixel, inside, is_frame

SMALLEST, LARGEST = 1 / 3, 3.0
"""Area against the one at the click beyond which it cannot be the same blob any more."""
AREA, SHAPE = 0.75, 0.85
"""Area and axis ratio, against those of the last second, below which something covers a part of it."""
AREA_LATER, LATER = 0.55, 15
"""The same for one that was missing for 15 frames: it may have come nearer or gone away meanwhile."""
EVERYWHERE = 0.12
"""Share of the picture that may have the blob's colour without being it."""
MEMORY = 0.05
"""Share of the way that the remembered area and axis ratio go to those of a new frame."""
_CAMSHIFT = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 1)


class BlobTracker:
    """CAMSHIFT finds the blob, the moments of its pixels give the centre.

    CAMSHIFT (Bradski 1998) alone is off by half a pixel: its window is whole pixels. The moments are
    weighted by how much of each pixel the blob covers.
    """

    kind = "blob"

    def __init__(self, frame: Image, uv: object, *, size_px: float | None = None) -> None:
        """`size_px` bounds the blob: what is further than that from the click does not belong to it."""
        self._size = check_frame(frame)
        pixel = check_pixel(uv, self._size)
        if size_px is not None and not 4 <= size_px <= max(self._size):
            raise BadInput(f"a region of {size_px:g} px is outside 4 to {max(self._size)} px", "size_px")
        rgb = to_rgb(frame)
        try:
            self._model, self._seen = _learned(rgb, pixel, size_px)
        except Untrackable as failure:
            raise _with_suggestion(failure, rgb, pixel, size_px) from None
        self._first = self._area = self._seen.area
        self._shape = self._seen.roundness
        self._velocity = np.zeros(2)
        self._missing = 0

    def update(self, frame: Image) -> Feature:
        """Find the blob in the next frame."""
        if not is_frame(frame, self._size):
            return self._lost("the camera gave no usable frame")
        rgb = to_rgb(frame)
        why = f"no {colour_name(self._model.lab)} blob here"
        found = self._near(rgb) if self._missing == 0 else None
        if found is not None:
            why = self._wrong(found)
        if (found is None or why) and (self._missing < 3 or self._missing % 2 == 0):
            again = self._anywhere(rgb)
            if again is not None:
                found, why = again, ""
        if found is None or why:
            return self._lost(why)
        self._velocity = found.center - self._seen.center if self._missing == 0 else np.zeros(2)
        score = _likeness(found.area, self._area) * found.contrast
        pace = 1.0 if self._missing > LATER else MEMORY
        self._area += pace * (found.area - self._area)
        self._shape += pace * (found.roundness - self._shape)
        self._seen, self._missing = found, 0
        detail = f"{colour_name(self._model.lab)} blob {found.diameter:.0f} px"
        return Feature(
            frozen(found.center),
            "ok",
            float(np.clip(score, 0, 1)),
            outline=frozen(found.outline()),
            detail=detail,
        )

    def _lost(self, why: str) -> Feature:
        self._missing += 1
        self._velocity = np.zeros(2)
        return Feature(
            frozen(self._seen.center), "lost", 0.0, outline=frozen(self._seen.outline()), detail=why
        )

    def _wrong(self, found: Region) -> str:
        """Why `found` cannot be the blob that was followed; empty when it can."""
        if not inside(found.center, self._size) or found.cut:
            return "left the view"
        least = AREA_LATER if self._missing > LATER else AREA
        if found.area < SMALLEST * self._first or found.area < least * self._area:
            return "covered, or much smaller than it was"
        if found.area > LARGEST * self._first or found.area > self._area / least:
            return "it runs into something of the same colour"
        if _likeness(found.roundness, self._shape) < SHAPE:
            return "covered in part, or no longer of the same shape"
        if self._model.differs(found.lab):
            return f"it is no longer {colour_name(self._model.lab)}"
        return ""

    def _near(self, rgb: Image) -> Region | None:
        """The blob around where it should be now."""
        ahead, width = self._seen.center + self._velocity, self._seen.diameter
        crop, origin = _cut(rgb, ahead, 1.2 * width + 12 + 2 * math.hypot(*self._velocity))
        if min(crop.shape[:2]) < 4:
            return None
        likely = self._model.likelihood(crop)
        side = max(4, round(width))
        x, y = (round(c - side / 2) for c in (ahead - origin).tolist())
        _, (x, y, w, h) = cv2.CamShift(likely, _clipped((x, y, side, side), crop.shape), _CAMSHIFT)
        at = np.array([x + 0.5 * (w - 1), y + 0.5 * (h - 1)])
        return measured(crop, likely, at, origin, self._size)

    def _anywhere(self, rgb: Image) -> Region | None:
        """The blob that is most like the lost one, looked for over the whole frame at low resolution."""
        area = self._area
        shrink = float(np.clip(math.sqrt(area) / 5, 1, 6))
        small = cv2.resize(rgb, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA)
        likely = self._model.likelihood(small)  # type: ignore[arg-type]
        count, _, stats, centers = cv2.connectedComponentsWithStats((likely > LIKELY).astype(np.uint8))
        sizes = stats[1:count, cv2.CC_STAT_AREA] * shrink**2 / area
        order = [k for k in np.argsort(np.abs(np.log(np.maximum(sizes, 1e-6)))) if 0.3 < sizes[k] < 3.5]
        best, best_off = None, math.inf
        for k in order[:4]:
            center = np.asarray((centers[k + 1] + 0.5) * shrink - 0.5, np.float64)
            crop, origin = _cut(rgb, center, 1.5 * self._seen.diameter + 12)
            found = measured(crop, self._model.likelihood(crop), center - origin, origin, self._size)
            if found is None or self._wrong(found):
                continue
            off = 0.002 * math.hypot(*(found.center - self._seen.center)) - math.log(
                _likeness(found.area, self._area) * _likeness(found.roundness, self._shape)
            )
            if off < best_off:
                best, best_off = found, off
        return best


def _cut(rgb: Image, center: Array, reach: float) -> tuple[Image, Array]:
    """The part of a frame within `reach` [px] of `center`, and its top-left pixel (2,); may be empty."""
    low = np.maximum(np.floor(center - reach), 0).astype(int)
    high = np.maximum(np.ceil(center + reach).astype(int) + 1, low)
    return rgb[low[1] : high[1], low[0] : high[0]], low.astype(np.float64)


def _likeness(a: float, b: float) -> float:
    """1 for equal positive numbers, less the more they differ."""
    return min(a, b) / max(a, b)


def _clipped(window: tuple[int, ...], shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """A window (x, y, w, h) moved into an image, as CamShift wants it."""
    x, y, w, h = window
    w, h = min(w, shape[1]), min(h, shape[0])
    return min(max(x, 0), shape[1] - w), min(max(y, 0), shape[0] - h), w, h


def _learned(rgb: Image, pixel: Array, size_px: float | None) -> tuple[ColourModel, Region]:
    """The colour of the blob under the click and where the blob is; `Untrackable` when there is none."""
    size = (rgb.shape[1], rgb.shape[0])
    blob = grown(rgb, pixel, size_px)
    model = ColourModel(rgb, blob, surroundings(blob))
    likely = model.likelihood(rgb)
    name = colour_name(model.lab)
    beside = likely[surroundings(blob)] > 128
    elsewhere = np.count_nonzero((likely > 128) & ~blob)
    if float(beside.mean()) > 0.25 or elsewhere > EVERYWHERE * likely.size:
        raise Untrackable(f"{name} is all around here too: a blob needs a colour of its own.")
    found = measured(rgb, likely, _middle(blob), np.zeros(2), size)
    if found is None or found.cut or model.differs(found.lab):
        raise Untrackable(f"the {name} here has no clear outline.")
    if not 0.4 < found.area / np.count_nonzero(blob) < 2.5:
        raise Untrackable(f"the {name} here has no clear outline.")
    return model, found


def _middle(blob: np.ndarray) -> Array:
    rows, columns = np.nonzero(blob)
    return np.array([columns.mean(), rows.mean()])


def _with_suggestion(failure: Untrackable, rgb: Image, pixel: Array, size_px: float | None) -> Untrackable:
    """The same refusal with the nearest place that would do, if a strongly coloured one is in sight."""
    hsv = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV)
    strong = (hsv[:, :, 1] > 150) & (hsv[:, :, 2] > 60)
    _, _, stats, centers = cv2.connectedComponentsWithStats(strong.astype(np.uint8))
    areas = stats[:, cv2.CC_STAT_AREA]
    fitting = [k for k in range(1, len(areas)) if 40 < areas[k] < 0.03 * strong.size]
    fitting.sort(key=lambda k: math.hypot(*(centers[k] - pixel)))
    for k in fitting[:6]:
        try:
            _, found = _learned(rgb, centers[k], size_px)
        except Untrackable:
            continue
        u, v = found.center.tolist()
        return Untrackable(
            f"{failure} The nearest good place is pixel ({u:.0f}, {v:.0f}).", suggestion=(u, v)
        )
    return failure
