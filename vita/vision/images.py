"""Frames as trackers see them: checked, grey, cut out around the target and blurred.

Every tracker works on a small crop, so converting and blurring cost next to nothing and no
cache over frames is needed: a cache keyed by identity would silently serve an old picture when
a camera driver fills the same buffer again.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput
from vita.types import Array, Image, frozen

# Trackers are many and small: OpenCV's thread pool costs more than it gives (measured).
cv2.setNumThreads(1)

Gray = NDArray[np.float32]
_SAMPLING = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP


def is_frame(frame: object, size: tuple[int, int] | None = None) -> bool:
    """Whether `frame` is an RGB or grey uint8 picture, of (width, height) `size` if that is given."""
    if not isinstance(frame, np.ndarray) or frame.dtype != np.uint8:
        return False
    if frame.ndim not in (2, 3) or frame.size == 0 or (frame.ndim == 3 and frame.shape[2] != 3):
        return False
    return size is None or (frame.shape[1], frame.shape[0]) == size


def check_frame(frame: Image) -> tuple[int, int]:
    """(width, height) of a frame; `BadInput` when it is none."""
    if not is_frame(frame):
        got = f"{frame.dtype} array of shape {frame.shape}" if isinstance(frame, np.ndarray) else repr(frame)
        raise BadInput(f"expected a (height, width, 3) uint8 frame, got {got}")
    return frame.shape[1], frame.shape[0]


def check_pixel(uv: object, size: tuple[int, int]) -> Array:
    """`uv` as a read-only (2,) array; `BadInput` naming the size when it is not inside the frame."""
    try:
        pixel = frozen(uv)
    except (TypeError, ValueError):
        raise BadInput(f"expected a pixel (column, row), got {uv!r}") from None
    if pixel.shape != (2,):
        raise BadInput(f"expected a pixel (column, row), got {uv!r}")
    if not inside(pixel, size):
        raise BadInput(
            f"pixel ({pixel[0]:g}, {pixel[1]:g}) is outside the frame of {size[0]} x {size[1]} pixels"
        )
    return pixel


def inside(uv: Array, size: tuple[int, int]) -> bool:
    """Whether a pixel lies in a frame of (width, height) `size`; False for NaN."""
    return bool(-0.5 <= uv[0] <= size[0] - 0.5 and -0.5 <= uv[1] <= size[1] - 0.5)


def to_gray(frame: Image) -> NDArray[np.uint8]:
    """(h, w) uint8 of an RGB or grey frame."""
    return cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) if frame.ndim == 3 else frame  # type: ignore[return-value]


class Crop:
    """A part of a frame, with its grey and blurred versions made once and only when asked for."""

    def __init__(self, raw: NDArray[np.uint8], origin: Array) -> None:
        """`raw` (h, w) or (h, w, 3) has its top-left pixel at `origin` (2,) of the frame."""
        self.raw, self.origin = raw, origin
        self._into = np.array([[1.0, 0.0, -origin[0]], [0.0, 1.0, -origin[1]], [0.0, 0.0, 1.0]])
        self._gray: NDArray[np.uint8] | None = None
        self._blurred: dict[float, Gray] = {}

    @classmethod
    def cut(cls, frame: Image, points: Array, margin: float) -> Crop:
        """The part of a frame that holds `points` (k, 2) [px] and `margin` [px] around them."""
        (x0, x1), (y0, y1) = _span(points, margin, frame.shape)
        # The copy matters: a view would change with the caller's buffer.
        return cls(frame[y0:y1, x0:x1].copy(), np.array([x0, y0], dtype=np.float64))

    def part(self, points: Array, margin: float) -> Crop:
        """The same for a part of this crop: converting and blurring less is most of the saving."""
        (x0, x1), (y0, y1) = _span(points - self.origin, margin, self.raw.shape)
        return Crop(self.raw[y0:y1, x0:x1], self.origin + (x0, y0))

    @property
    def gray(self) -> NDArray[np.uint8]:
        """(h, w)."""
        if self._gray is None:
            self._gray = to_gray(self.raw)
        return self._gray

    def blurred(self, sigma: float) -> Gray:
        """(h, w) float32, Gaussian blur of `sigma` [px]."""
        if sigma not in self._blurred:
            gray = self.gray.astype(np.float32)
            # A kernel that ends at 2.5 sigma: template and image get the same, and it costs half.
            side = 2 * round(2.5 * sigma) + 1
            blurred = cv2.GaussianBlur(gray, (side, side), sigma, borderType=cv2.BORDER_REPLICATE)
            self._blurred[sigma] = np.asarray(blurred, dtype=np.float32)
        return self._blurred[sigma]

    def sample(self, image: Gray, warp: Array, n: int) -> Gray:
        """(n, n) values of `image` (one of this crop's) at the grid that `warp` carries there.

        `warp` is a (3, 3) homography from grid indices to pixels of the whole frame.
        """
        local = self._into @ warp
        return cv2.warpPerspective(image, local, (n, n), flags=_SAMPLING, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[return-value]


def _span(points: Array, margin: float, shape: tuple[int, ...]) -> list[tuple[int, int]]:
    """Column and row ranges around `points` within a picture, never empty."""
    spans = []
    for values, limit in zip(points.T.tolist(), (shape[1], shape[0]), strict=True):
        start = int(min(max(min(values) - margin, 0), limit - 2))
        spans.append((start, int(min(max(max(values) + margin + 2, start + 2), limit))))
    return spans
